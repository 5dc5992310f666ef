"""Pictures of a page, in every unit that its buttons offer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Protocol, get_args

from rotorid.plot.figure import Figure
from rotorid.plot.view import Frequency, Magnitude


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure, and what it shows for those who cannot see it.

    Parameters
    ----------
    key
        Identifier on the page.
    description
        What it shows, in words.
    figure
        The picture as it is drawn first.
    views
        The same picture in other units, by frequency and magnitude (``"Hz linear"``) or by frequency alone (``"Hz"``).
        Empty where there is one view.
    converted
        Whether the page's script makes the numbers of the other views: frequencies by a factor and, where there is a
        view for each magnitude, heights in the first panel from decibels. Else each view brings its own.
    """

    key: str
    description: str
    figure: Figure
    views: Mapping[str, Figure] = field(default_factory=dict)
    converted: bool = False

    def for_script(self) -> dict[str, Any]:
        """The picture as the page's script takes it.

        Of other views a converted picture brings only what is no plain conversion of numbers: four copies of every
        response would make the file several times as long.
        """
        if not self.views:
            return {"data": self.figure["data"], "layout": _layout(self.figure)}
        if not self.converted:
            own = {units: {"data": view["data"], "layout": _layout(view)} for units, view in self.views.items()}
            return {"views": own}
        views = {
            units: {"layout": _layout(view), "hover": [trace.get("hovertemplate") for trace in view["data"]]}
            for units, view in self.views.items()
        }
        return {"data": self.figure["data"], "views": views}


class Drawn(Protocol):
    """A picture that can be drawn in all units of frequency and magnitude."""

    def __call__(self, *, frequency: Frequency, magnitude: Magnitude) -> Figure: ...


class Spread(Protocol):
    """A picture over frequency without a magnitude."""

    def __call__(self, *, frequency: Frequency) -> Figure: ...


def in_all_units(draw: Drawn, *, key: str, description: str, converted: bool = False) -> Picture:
    """A picture with a view for each unit of frequency and magnitude.

    Parameters
    ----------
    draw
        Draws one view.
    key, description, converted
        As in :class:`Picture`.
    """
    units: list[tuple[Frequency, Magnitude]] = list(product(get_args(Frequency), get_args(Magnitude)))
    views = {
        f"{frequency} {magnitude}": draw(frequency=frequency, magnitude=magnitude) for frequency, magnitude in units
    }
    return Picture(key=key, description=description, figure=views["rad/s dB"], views=views, converted=converted)


def over_frequency(draw: Spread, *, key: str, description: str, converted: bool = False) -> Picture:
    """A picture with a view for each unit of frequency; the other parameters are those of :class:`Picture`."""
    views = {frequency: draw(frequency=frequency) for frequency in get_args(Frequency)}
    return Picture(key=key, description=description, figure=views["rad/s"], views=views, converted=converted)


def _layout(figure: Figure) -> dict[str, Any]:
    # The template is the same for all figures, and the page picks the light or the dark one.
    return {key: value for key, value in figure["layout"].items() if key != "template"}
