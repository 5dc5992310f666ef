"""``stitched.json``, schema ``rotorid.stitched/1``, and the results that it is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from rotorid.data.display import counted, listed
from rotorid.data.quantity import with_error
from rotorid.documents.base import (
    Document,
    FindingDocument,
    Numbers,
    ProvenanceDocument,
    Shown,
    ShownDocument,
    finding_lines,
)
from rotorid.results.summary import finite

if TYPE_CHECKING:
    from rotorid.flying.stitching import SpeedCurve, Stitched, StitchedPoint, ThroughSpeeds
    from rotorid.results.model import IdentifiedModel


class StitchedPointDocument(Document):
    """One result: its speed along the body, and its trim: speeds, angles and mean commands."""

    label: str
    model: str
    speed_m_s: float
    trim: dict[str, float]


class SpeedCurveDocument(Document):
    """A parameter over speed, linear in between; ``std`` is ``null`` where it was dropped and is zero."""

    unit: str
    speed_m_s: Numbers
    value: Numbers
    std: list[float | None]


class ThroughScoreDocument(Document):
    """How one channel of a flight was predicted, about its mean; ``std`` is the mean spread by the parameters."""

    tic: float | None
    nrmse_fit_percent: float | None
    rms: float
    std: float


class ThroughSpeedsDocument(Document):
    """A flight through the speeds. ``setpoints`` names, for each command, the channel that drove its controller."""

    record: str
    start_s: float
    stop_s: float
    speed_m_s: tuple[float, float]
    low_pass_rad_s: float | None
    setpoints: dict[str, str]
    scores: dict[str, ThroughScoreDocument]


class StitchedDocument(ShownDocument):
    """``stitched.json``: models of several speeds as one over speed."""

    schema_name: Annotated[Literal["rotorid.stitched/1"], Field(alias="schema")] = "rotorid.stitched/1"
    points: list[StitchedPointDocument] = Field(default_factory=list)
    parameters: dict[str, dict[str, SpeedCurveDocument]] = Field(default_factory=dict)
    flights: list[ThroughSpeedsDocument] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument

    def shown(self) -> Shown:
        """Each parameter at its speeds, and flights through the speeds."""
        rows = [
            (
                name,
                curve.unit,
                "; ".join(
                    f"{with_error(value, std)} at {speed:.3g} m/s"
                    for speed, value, std in zip(curve.speed_m_s, curve.value, curve.std, strict=True)
                ),
            )
            for curves in self.parameters.values()
            for name, curve in curves.items()
        ]
        rows += [
            (
                flown.record,
                "",
                ", ".join(
                    f"TIC of {name} {score.tic:.2f}" for name, score in flown.scores.items() if score.tic is not None
                ),
            )
            for flown in self.flights
        ]
        return Shown(
            f"{listed(list(self.parameters))} over speed, from {counted(len(self.points), 'result')}",
            ("what", "unit", "values"),
            [*rows, *finding_lines(self.findings, 3)],
        )


def stitched_document(found: Stitched) -> StitchedDocument:
    """The document of a stitched model."""
    return StitchedDocument(
        points=[_point(point) for point in found.points],
        parameters={
            model: {name: _curve(curve) for name, curve in curves.items()} for model, curves in found.curves.items()
        },
        flights=[_flight(flown) for flown in found.flights],
        findings=[FindingDocument.model_validate(finding) for finding in found.findings],
        provenance=ProvenanceDocument.model_validate(found.provenance),
    )


def _point(point: StitchedPoint) -> StitchedPointDocument:
    return StitchedPointDocument(
        label=point.label, model=point.model.name, speed_m_s=point.speed_m_s, trim=dict(point.trim)
    )


def _curve(curve: SpeedCurve) -> SpeedCurveDocument:
    return SpeedCurveDocument(
        unit=curve.unit,
        speed_m_s=curve.speed_m_s.tolist(),
        value=curve.value.tolist(),
        std=[finite(float(std)) for std in curve.std],
    )


def _flight(flown: ThroughSpeeds) -> ThroughSpeedsDocument:
    speed = flown.measured["u"]
    return ThroughSpeedsDocument(
        record=flown.record,
        start_s=flown.start_s,
        stop_s=flown.stop_s,
        speed_m_s=(float(speed.min()), float(speed.max())),
        low_pass_rad_s=flown.low_pass_rad_s,
        setpoints=dict(flown.setpoints),
        scores={
            name: ThroughScoreDocument(
                tic=finite(loop_scores.tic),
                nrmse_fit_percent=finite(loop_scores.nrmse_fit_percent),
                rms=loop_scores.rms,
                std=float(flown.spread[name].mean()),
            )
            for name, loop_scores in flown.scores.items()
        },
    )


def read_models(paths: Sequence[Path]) -> Mapping[str, IdentifiedModel]:
    """Read results of ``identify``, by the names of their folders.

    Parameters
    ----------
    paths
        Folders, or ``result.json`` files with their ``model.toml``, at least two different ones.

    Raises
    ------
    UsageError
        A path is no result, one is given twice, or fewer than two are given.
    """
    from rotorid.documents.compare import read_results

    return {entry.label: entry.model for entry in read_results(paths)}
