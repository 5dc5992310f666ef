"""``verification.json``, schema ``rotorid.verify/1``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from rotorid.checking.checks import flight_scores, sweep_check
from rotorid.data.display import counted
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument, Shown, ShownDocument, finding_lines
from rotorid.results.model import Refused
from rotorid.results.summary import FlightScores, ManeuverCheck, Range, SweepCheck
from rotorid.verification.flight import together
from rotorid.verification.scores import scaled_guidelines

if TYPE_CHECKING:
    from rotorid.identifying.verification import Verified


class GuidelineDocument(Document):
    """Guideline of J_rms, 1 to 2 at full scale, for a vehicle N times smaller: with the root of N, and as printed."""

    scale: float
    root: tuple[float, float]
    printed: tuple[float, float]


class VerifyDocument(ShownDocument):
    """``verification.json``: how well a model predicts data that it was not fitted to."""

    schema_name: Annotated[Literal["rotorid.verify/1"], Field(alias="schema")] = "rotorid.verify/1"
    model: str
    inputs: list[str]
    outputs: list[str]
    states: list[str]
    band_rad_s: tuple[float, float] | None = None
    maneuvers: list[ManeuverCheck] = Field(default_factory=list)
    frequency: list[SweepCheck] = Field(default_factory=list)
    j_rms_guideline: GuidelineDocument | None = None
    flight: FlightScores | None = None
    covered: dict[str, Range] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument

    def shown(self) -> Shown:
        """Each maneuver with its verdict and scores, and costs of responses."""
        rows: list[tuple[str, ...]] = [
            (
                check.verdict,
                f"{check.record}: {check.axis} {check.kind}, {check.start_s:.1f} to {check.stop_s:.1f} s",
                ", ".join(f"TIC of {name} {scores.tic:.2f}" for name, scores in check.scores.items()),
            )
            for check in self.maneuvers
        ]
        rows += [
            ("cost", pair, f"{cost.value:.3g} ({', '.join(sweep.records)})")
            for sweep in self.frequency
            for pair, cost in sweep.pairs.items()
        ]
        return Shown(
            f"{self.model} on {counted(len(self.maneuvers), 'unseen maneuver')}",
            ("verdict", "flight", "scores"),
            [*rows, *finding_lines(self.findings, 3)],
        )


def verify_document(verified: Verified) -> VerifyDocument:
    """The document of a verification."""
    structure = verified.candidate.structure
    return VerifyDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        band_rad_s=verified.candidate.band_rad_s,
        maneuvers=list(verified.maneuvers),
        frequency=[sweep_check(sweep) for sweep in verified.found.sweeps],
        j_rms_guideline=guideline_document(verified.scale),
        flight=_flight(verified),
        covered=dict(verified.covered),
        findings=[FindingDocument.model_validate(finding) for finding in verified.findings],
        provenance=ProvenanceDocument.model_validate(verified.provenance),
    )


def _flight(verified: Verified) -> FlightScores | None:
    """All stretches together, of a physical model."""
    judged = [check.flight for check in verified.found.maneuvers if check.flight is not None]
    return flight_scores(together(judged)) if judged else None


def refused_verify_document(refused: Refused) -> VerifyDocument:
    """The document of logs that cannot verify a model: findings with the reason, and no numbers."""
    structure = refused.structure
    return VerifyDocument(
        model=refused.name,
        inputs=list(structure.inputs if structure else ()),
        outputs=list(structure.outputs if structure else ()),
        states=list(structure.states if structure else ()),
        findings=[FindingDocument.model_validate(finding) for finding in refused.findings],
        provenance=ProvenanceDocument.model_validate(refused.provenance),
    )


def guideline_document(scale: float | None) -> GuidelineDocument | None:
    """Both forms of the guideline, where the scale of the vehicle is given."""
    if scale is None:
        return None
    root, printed = scaled_guidelines(scale)
    return GuidelineDocument(scale=scale, root=root, printed=printed)
