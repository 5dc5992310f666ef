"""Several responses of one pair on one Bode plot: records, methods, windows, models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.plot.bode import COHERENCE_GUIDELINE, Curve, bands, coherence_panel, curve
from rotorid.plot.curves import Style, line, magnitude_axis, phase_axis, points
from rotorid.plot.figure import Figure, Trace
from rotorid.plot.phase import reference_deg
from rotorid.plot.quantity import magnitude_label
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import DASHES, SERIES, SYMBOLS, translucent
from rotorid.plot.view import Frequency, Magnitude, View
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_BAND_OPACITY = 0.16


@dataclass(frozen=True, kw_only=True, eq=False)
class Named:
    """One response with a name for the legend.

    Parameters
    ----------
    name
        Different from the names beside it.
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``; each response may have its own.
    values
        Shape ``(f,)``; what is not finite is a gap.
    random_error
        Relative standard deviation of the magnitude, which is that of the phase in radians, shape ``(f,)``.
    coherence
        Shape ``(f,)``.
    measured
        Whether it is drawn as points; a model is a line.

    Raises
    ------
    UsageError
        An array has another shape than the frequencies.
    """

    name: str
    omega_rad_s: FloatArray
    values: ComplexArray
    random_error: FloatArray | None = None
    coherence: FloatArray | None = None
    measured: bool = True

    def __post_init__(self) -> None:
        arrays = {"values": self.values, "random_error": self.random_error, "coherence": self.coherence}
        for name, array in arrays.items():
            if array is not None and array.shape != self.omega_rad_s.shape:
                raise UsageError(
                    f"{name} of the curve {self.name!r} came with the shape {array.shape}",
                    needed=f"the shape {self.omega_rad_s.shape} of its frequencies",
                )

    @classmethod
    def of(cls, response: FrequencyResponse, *, output: str, input: str, name: str) -> Self:
        """One pair of a measured response, with its error and coherence."""
        row = response.pair(output, input)
        return cls(
            name=name,
            omega_rad_s=response.omega_rad_s,
            values=response.values[row],
            random_error=response.random_error[row],
            coherence=response.coherence[row],
        )


def overlay(
    curves: Sequence[Named],
    *,
    output: str,
    input: str,
    least_coherence: float = COHERENCE_GUIDELINE,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Several responses ``output/input`` on one Bode plot, each with its band of :math:`\pm 2\sigma`.

    Each phase is unwrapped by itself and then shifted by whole turns to lie nearest to the first one. The band is
    drawn where the coherence is above its guideline, and everywhere for a curve without coherence. A click in the
    legend hides a curve with its band.

    Parameters
    ----------
    curves
        At least one. The first six differ in color, dash and symbol; then the colors return with other dashes.
    output, input
        The pair, for the words and units of the axis.
    least_coherence
        Guideline, drawn as a line.
    frequency, magnitude
        Units of the picture.

    Raises
    ------
    UsageError
        No curve was given, two have one name, or a unit is unknown.

    Examples
    --------
    >>> omega = np.geomspace(1.0, 50.0, 20)
    >>> slow, fast = (Named(name=f"{1e3 * tau:g} ms", omega_rad_s=omega, measured=False,
    ...     values=8.0 * np.exp(-1j * omega * tau) / (1j * omega)) for tau in (0.04, 0.01))
    >>> figure = overlay([slow, fast], output="p", input="roll_command")
    >>> [trace["name"] for trace in figure["data"] if trace["showlegend"]]
    ['40 ms', '10 ms']
    """
    view = View(frequency=frequency, magnitude=magnitude)
    names = [one.name for one in curves]
    if not names or len(set(names)) < len(names):
        raise UsageError(
            f"an overlay of the curves {names} was asked for", needed="at least one curve, each with a name of its own"
        )
    papers = _on_one_branch([_paper(one, least_coherence) for one in curves])
    inked = [_ink(view, *both, number, least_coherence) for number, both in enumerate(zip(curves, papers, strict=True))]
    # All bands first: none of them may lie over the points of another curve.
    level, turn, trust = (
        sorted((trace for one in inked for trace in one[part]), key=lambda trace: "fill" not in trace)
        for part in range(3)
    )
    panels = [
        Panel(
            label=magnitude_label(output, input, in_db=magnitude == "dB"),
            traces=level,
            height_px=250,
            axis=magnitude_axis(view, level),
        ),
        Panel(label="Phase [°]", traces=turn, height_px=180, axis=phase_axis(turn)),
    ]
    if trust:
        panels.append(coherence_panel(trust, least_coherence))
    return stacked(panels, x_axis=view.axis(np.concatenate([one.omega_rad_s for one in curves])))


def _trusted(one: Named, least_coherence: float) -> BoolArray:
    finite = np.isfinite(one.values)
    return finite if one.coherence is None else finite & (one.coherence >= least_coherence)


def _paper(one: Named, least_coherence: float) -> Curve:
    lean_deg = reference_deg(one.omega_rad_s, one.values, _trusted(one, least_coherence))
    error = np.zeros(one.omega_rad_s.size) if one.random_error is None else one.random_error
    return curve(one.omega_rad_s, one.values, error, lean_deg)


def _on_one_branch(papers: Sequence[Curve]) -> list[Curve]:
    """Each phase shifted by whole turns to lie nearest to the first where both are seen."""
    first = papers[0]
    seen = np.isfinite(first.phase_deg)
    if not seen.any():
        return list(papers)
    shifted = []
    for paper in papers:
        there = np.interp(np.log(paper.omega_rad_s), np.log(first.omega_rad_s[seen]), first.phase_deg[seen])
        gap = (there - paper.phase_deg)[np.isfinite(paper.phase_deg)]
        turns = np.round(np.median(gap) / 360.0) if gap.size else 0.0
        shifted.append(replace(paper, phase_deg=paper.phase_deg + 360.0 * turns))
    return shifted


def _ink(
    view: View, one: Named, paper: Curve, number: int, least_coherence: float
) -> tuple[list[Trace], list[Trace], list[Trace]]:
    """Traces of magnitude, phase and coherence of one curve."""
    level: list[Trace] = []
    turn: list[Trace] = []
    color = SERIES[number % len(SERIES)]
    if one.random_error is not None:
        shade = Style(name=one.name, color=translucent(color, _BAND_OPACITY))
        level, turn = bands(view, paper, _trusted(one, least_coherence), shade)
    style = Style(
        name=one.name,
        color=color,
        width=1.8,
        # The second round of colors comes with other dashes.
        dash=DASHES[(number + number // len(SERIES)) % len(DASHES)],
        symbol=SYMBOLS[(number + number // len(SERIES)) % len(SYMBOLS)],
        size=4.5,
        unit="dB" if view.magnitude == "dB" else "",
        legend=True,
    )
    quiet = replace(style, unit="°", legend=False)
    draw = points if one.measured else line
    level.append(draw(view, one.omega_rad_s, view.height(paper.magnitude_db), style))
    turn.append(draw(view, one.omega_rad_s, paper.phase_deg, quiet))
    if one.coherence is None:
        return level, turn, []
    return level, turn, [draw(view, one.omega_rad_s, one.coherence, replace(quiet, unit=""))]
