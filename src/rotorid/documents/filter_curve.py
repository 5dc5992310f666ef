"""The curve of filters with gains as ``tune.json`` holds it."""

from __future__ import annotations

from pydantic import Field

from rotorid.documents.base import Document
from rotorid.documents.review import QuantityDocument
from rotorid.models.autopilots.betaflight_settings import command_line_name
from rotorid.proposing.filter_curve import FilterCurve, FilterPoint
from rotorid.typing import Axis


class FilterValueDocument(Document):
    """A parameter of a filter as flown (null where the log has none) and at a point of the curve."""

    flown: float | None
    proposed: float


class AxisPointDocument(Document):
    """Gains of an axis at a point, by the firmware's names, the larger M_s, and the attitude error over today's."""

    gains: dict[str, float]
    sensitivity_peak: QuantityDocument
    attitude_ratio: QuantityDocument


class FilterPointDocument(Document):
    """Filters and gains that may be flown together.

    ``point`` is the number that ``--filters`` takes; zero has the flown filters. ``noise_limit`` is the noise of each
    command that was allowed, over that of today; ``saves_percent`` is what of it is saved, of all axes together.
    """

    point: int
    filters: dict[str, FilterValueDocument]
    noise_limit: float
    saves_percent: QuantityDocument
    attitude_ratio: float
    axes: dict[Axis, AxisPointDocument]


class FilterCurveDocument(Document):
    """The points, the least noise first, which of them is recommended, and which was picked (null for none)."""

    points: list[FilterPointDocument] = Field(default_factory=list)
    recommended: int
    picked: int | None = None


def curve_document(curve: FilterCurve | None) -> FilterCurveDocument | None:
    """A curve of filters with gains; ``None`` where none was asked for."""
    if curve is None:
        return None
    points = [_point(point) for point in curve.points]
    return FilterCurveDocument(points=points, recommended=curve.recommended, picked=curve.picked)


def _point(point: FilterPoint) -> FilterPointDocument:
    return FilterPointDocument(
        point=point.number,
        filters={
            command_line_name(name): FilterValueDocument(flown=flown, proposed=new)
            for name, (flown, new) in point.filters.items()
        },
        noise_limit=point.noise_limit,
        saves_percent=QuantityDocument.model_validate(point.saves_percent),
        attitude_ratio=point.attitude,
        axes={
            axis: AxisPointDocument(
                gains=dict(one.parameters),
                sensitivity_peak=QuantityDocument.model_validate(one.sensitivity_peak),
                attitude_ratio=QuantityDocument.model_validate(one.attitude_ratio),
            )
            for axis, one in point.axes.items()
        },
    )
