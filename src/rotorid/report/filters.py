"""What pages and terminals say of filters that could fly with the gains."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.data.display import capital, listed
from rotorid.data.quantity import with_ends
from rotorid.documents.filter_curve import FilterCurveDocument, FilterPointDocument
from rotorid.plot.filters import choices
from rotorid.report.frame import Picture, drawn

_SHORT = ("INS_HNTCH", "INS_HNTC2")
"""Notches of ArduPilot: their base frequency is enough in a row."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ChoiceRow:
    """A point of the curve on the page: number, filters, noise, attitude error, M_s, and a mark."""

    number: int
    filters: str
    noise: str
    attitude: str
    peak: str
    mark: str


def choice_rows(curve: FilterCurveDocument) -> tuple[ChoiceRow, ...]:
    """The points, the least noise first."""
    return tuple(
        ChoiceRow(
            number=point.point,
            filters=_filters(point, curve),
            noise=_noise(point),
            attitude=f"{100.0 * point.attitude_ratio:.0f} %",
            peak=_peak(point),
            mark=_mark(curve, point.point),
        )
        for point in curve.points
    )


def choice_lines(curve: FilterCurveDocument | None) -> list[str]:
    """The points for the terminal; none where filters were not looked for."""
    if curve is None:
        return []
    lines = [choice_sentence(curve)]
    for row in choice_rows(curve):
        mark = f" ({row.mark})" if row.mark else ""
        lines.append(f"  {row.number}  noise {row.noise}, attitude error {row.attitude}, M_s {row.peak}{mark}")
        lines.append(f"     {row.filters}")
    return lines


def choice_sentence(curve: FilterCurveDocument) -> str:
    """What to do with the curve."""
    if curve.picked is not None and curve.picked > 0:
        return f"Filters and gains of choice {curve.picked} are proposed; all numbers are in % of today's."
    if not curve.recommended:
        return (
            "Keep your filters: no others make less noise with as small an attitude error. For less noise, "
            "fly another choice (--filters NUMBER). In % of today's:"
        )
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
