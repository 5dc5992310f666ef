"""What pages and terminals say of filters that could fly with the gains."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass

from rotorid.data.display import capital, listed
from rotorid.data.quantity import MISSING, with_ends
from rotorid.documents.base import ProvenanceDocument
from rotorid.documents.filter_curve import FilterCurveDocument, FilterPointDocument
from rotorid.documents.tune import TuneDocument
from rotorid.plot.filters import choices
from rotorid.report.frame import Picture, drawn

_SHORT = ("INS_HNTCH", "INS_HNTC2")
"""Notches of ArduPilot: their base frequency is enough in a row."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ChoiceRow:
    """A point of the curve on the page: number, filters, noise, attitude error, M_s, and a mark.

    ``parameters`` are names with the flown and the new value, and ``command`` is what writes its files.
    """

    number: int
    filters: str
    noise: str
    attitude: str
    peak: str
    mark: str
    parameters: tuple[tuple[str, str, str], ...]
    command: str


def choice_rows(document: TuneDocument) -> tuple[ChoiceRow, ...]:
    """The points, the least noise first; none where filters were not looked for."""
    curve = document.filter_curve
    if curve is None:
        return ()
    return tuple(
        ChoiceRow(
            number=point.point,
            filters=_filters(point, curve),
            noise=_noise(point),
            attitude=f"{100.0 * point.attitude_ratio:.0f} %",
            peak=_peak(point),
            mark=_mark(curve, point.point),
            parameters=tuple(_values(point, document)),
            command=_command(document.provenance, point.point),
        )
        for point in curve.points
    )


def _values(point: FilterPointDocument, document: TuneDocument) -> Iterator[tuple[str, str, str]]:
    """Name, flown and new value of each filter and gain of a point."""
    for name, value in point.filters.items():
        yield name, MISSING if value.flown is None else f"{value.flown:g}", f"{value.proposed:g}"
    for axis, one in point.axes.items():
        flown = document.axes[axis].gains if axis in document.axes else {}
        for name, gain in one.gains.items():
            before = flown[name].flown if name in flown else None
            yield name, MISSING if before is None else f"{before:.4g}", f"{gain:.4g}"


_PLACES = ("--out", "--filters")
"""Options with a value that the command of another choice has no use for, or another value of."""


def _command(provenance: ProvenanceDocument, number: int) -> str:
    """The command that writes the files of a point: that of this page with its number."""
    words = provenance.command or ["rotorid", "tune", *provenance.inputs]
    kept = [
        word
        for before, word in zip(["", *words], words, strict=False)
        if before not in _PLACES and word.partition("=")[0] not in (*_PLACES, "--open")
    ]
    return shlex.join([*kept, "--filters", str(number)])


def choice_lines(document: TuneDocument) -> list[str]:
    """The points for the terminal, a line each; none where filters were not looked for.

    The one that is proposed or recommended comes with its filters; the page has those of all.
    """
    if document.filter_curve is None:
        return []
    lines = [choice_sentence(document.filter_curve)]
    for row in choice_rows(document):
        mark = f" ({row.mark}: {row.filters})" if row.mark else ""
        lines.append(f"  {row.number}  noise {row.noise}, attitude error {row.attitude}, M_s {row.peak}{mark}")
    return lines


def choice_sentence(curve: FilterCurveDocument) -> str:
    """What to do with the curve."""
    if curve.picked is not None and curve.picked > 0:
        return f"Filters and gains of choice {curve.picked} are proposed; all numbers are in % of today's."
    if not curve.recommended:
        # The least noise comes first.
        quieter = curve.points[0].point != 0
        other = "For less noise, fly another choice (--filters NUMBER)." if quieter else "No choice makes less noise."
        return f"Keep your filters: no others make less noise with as small an attitude error. {other} In % of today's:"
    return f"Better filters for these gains: --filters {curve.recommended}, or another number. In % of today's:"


def choice_picture(curve: FilterCurveDocument) -> Picture:
    """Noise against attitude error."""
    marked = curve.picked if curve.picked is not None else curve.recommended
    points = curve.points
    return Picture(
        key="filters-curve",
        description="Attitude error over noise at the motors, a point for each choice of filters with its gains",
        figure=drawn(
            choices,
            [point.point for point in points],
            [100.0 - point.saves_percent.value for point in points],
            [100.0 * point.attitude_ratio for point in points],
            marked=marked,
        ),
    )


def _filters(point: FilterPointDocument, curve: FilterCurveDocument) -> str:
    """Filters of a point, and the limit of its gains where another one has the same filters."""
    twice = sum(other.filters == point.filters for other in curve.points) > 1
    gains = f", gains with at most {100.0 * point.noise_limit:.0f} % noise" if twice else ""
    if not point.filters:
        return f"Filters as flown{gains}"
    shown = [
        f"{name} {value.proposed:g}"
        for name, value in point.filters.items()
        if not name.startswith(_SHORT) or name.endswith("_FREQ")
    ]
    return f"{capital(listed(shown))}{gains}"


def _noise(point: FilterPointDocument) -> str:
    saved = point.saves_percent
    low, high = (None if end is None else 100.0 - end for end in (saved.upper, saved.lower))
    return f"{with_ends(100.0 - saved.value, low, high)} %"


def _peak(point: FilterPointDocument) -> str:
    return f"{max(axis.sensitivity_peak.value for axis in point.axes.values()):.2f}"


def _mark(curve: FilterCurveDocument, number: int) -> str:
    if number == curve.picked:
        return "proposed"
    recommended = curve.picked is None and number == curve.recommended > 0
    return "recommended" if recommended else ""
