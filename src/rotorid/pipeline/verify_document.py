"""What ``verification.json`` holds, schema ``rotorid.verify/1``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document
from rotorid.documents.result import (
    AheadDocument,
    AheadScoreDocument,
    ClosedLoopDocument,
    FindingDocument,
    LoopScoreDocument,
    ManeuverVerificationDocument,
    PairCost,
    ProvenanceDocument,
    RangeDocument,
    ScoreDocument,
    SweepVerificationDocument,
    TrimDocument,
)
from rotorid.pipeline.coverage import Trim
from rotorid.pipeline.frequency_check import FrequencyCheck
from rotorid.verification.closed_loop import ClosedLoop
from rotorid.verification.prediction import Prediction
from rotorid.verification.scores import scaled_guidelines
from rotorid.verification.verification import Verification, verdict


class GuidelineDocument(Document):
    """Guideline of J_rms, 1 to 2 at full scale, for a vehicle N times smaller: with the root of N, and as printed."""

    scale: float
    root: tuple[float, float]
    printed: tuple[float, float]


class VerifyDocument(Document):
    """``verification.json``: how a model does on data that it has not seen."""

    schema_name: Annotated[Literal["rotorid.verify/1"], Field(alias="schema")] = "rotorid.verify/1"
    model: str
    inputs: list[str]
    outputs: list[str]
    states: list[str]
    band_rad_s: tuple[float, float] | None = None
    maneuvers: list[ManeuverVerificationDocument] = Field(default_factory=list)
    frequency: list[SweepVerificationDocument] = Field(default_factory=list)
    j_rms_guideline: GuidelineDocument | None = None
    covered: dict[str, RangeDocument] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def maneuver_verification(
    check: Verification, states: Sequence[str], trim: Trim | None
) -> ManeuverVerificationDocument:
    """One maneuver as a document; an output that did not move at all has no fit and is left out.

    Parameters
    ----------
    check
        What was found.
    states
        Names of the states, for the biases.
    trim
        Trim before the maneuver, where it was seen.
    """
    return ManeuverVerificationDocument(
        record=check.record,
        axis=check.maneuver.axis,
        kind=check.maneuver.kind,
        start_s=check.maneuver.start_s,
        stop_s=check.maneuver.stop_s,
        verdict=verdict(check),
        scores={
            name: ScoreDocument(
                nrmse_fit_percent=scores.nrmse_fit_percent,
                tic=scores.tic,
                rms=scores.rms,
                bias=scores.bias,
                reference_shift=scores.reference_shift,
            )
            for name, scores in check.scores.items()
            if math.isfinite(scores.nrmse_fit_percent)
        },
        j_rms=check.j_rms,
        biases=dict(zip(states, map(float, check.biases), strict=True)),
        growth_1_s=check.growth_1_s,
        low_pass_rad_s=check.low_pass_rad_s,
        moved=list(check.moved),
        ahead=_ahead(check.ahead) if check.ahead else [],
        holds_s=dict(check.ahead.holds_s) if check.ahead else {},
        closed_loop=_closed_loop(check.closed_loop) if check.closed_loop else None,
        trim=TrimDocument(values=dict(trim.values), hover=trim.hover) if trim else None,
    )


def _ahead(prediction: Prediction) -> list[AheadDocument]:
    return [
        AheadDocument(
            horizon_s=horizon.horizon_s,
            outputs={
                name: AheadScoreDocument(
                    nrmse_fit_percent=scores.nrmse_fit_percent if math.isfinite(scores.nrmse_fit_percent) else None,
                    tic=scores.tic,
                    rms=scores.rms,
                    skill=scores.skill,
                    over_quiet=scores.over_quiet,
                )
                for name, scores in horizon.scores.items()
            },
        )
        for horizon in prediction.horizons
    ]


def _closed_loop(flown: ClosedLoop) -> ClosedLoopDocument:
    return ClosedLoopDocument(
        setpoints=dict(flown.setpoints),
        controller_tic=dict(flown.controller_tic),
        scores={
            name: LoopScoreDocument(
                nrmse_fit_percent=scores.nrmse_fit_percent if math.isfinite(scores.nrmse_fit_percent) else None,
                tic=scores.tic,
                rms=scores.rms,
            )
            for name, scores in flown.scores.items()
        },
    )


def sweep_verification(judged: FrequencyCheck) -> SweepVerificationDocument:
    """Unseen sweeps as a document."""
    return SweepVerificationDocument(
        records=list(judged.records),
        pairs={
            name: PairCost(value=pair.cost, band_rad_s=pair.band_rad_s, points=pair.points)
            for name, pair in judged.pairs.items()
        },
    )


def guideline_document(scale: float | None) -> GuidelineDocument | None:
    """Both forms of the guideline, where the scale of the vehicle is given."""
    if scale is None:
        return None
    root, printed = scaled_guidelines(scale)
    return GuidelineDocument(scale=scale, root=root, printed=printed)
