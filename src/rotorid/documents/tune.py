"""``tune.json``, schema ``rotorid.tune/1``: gains proposed for a vehicle, and what they will do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.documents.review import QuantityDocument
from rotorid.pipeline.results import Refused
from rotorid.pipeline.tuning import AxisTuning, TuningProposal
from rotorid.tuning.loops import LoopFigures
from rotorid.typing import Axis, FloatArray

TUNE, SIGNALS = "tune.json", "tune.npz"

_UNITS: Mapping[str, tuple[str, str, float]] = {
    "crossover_rad_s": ("crossover_rad_s", "rad/s", 1.0),
    "phase_margin_deg": ("phase_margin_rad", "deg", float(np.degrees(1.0))),
    "gain_margin_db": ("gain_margin", "dB", 0.0),
    "delay_margin_s": ("delay_margin_s", "s", 1.0),
    "sensitivity_peak": ("sensitivity_peak", "1", 1.0),
    "rejection_bandwidth_rad_s": ("rejection_bandwidth_rad_s", "rad/s", 1.0),
}


class GainDocument(Document):
    """A parameter of the firmware as it was flown and as it is proposed; one that stays has both alike."""

    flown: float
    proposed: float


class AxisTuneDocument(Document):
    """An axis: margins of the rate loop alone and of the whole loop, flown and proposed, and its parameters.

    ``attitude_ratio`` is the attitude's deviation under a moment, proposed over flown; ``noise_ratio`` that of the
    command by noise of the rate.
    """

    changed: bool
    band_rad_s: tuple[float, float]
    flown: dict[str, QuantityDocument]
    proposed: dict[str, QuantityDocument]
    flown_whole: dict[str, QuantityDocument]
    proposed_whole: dict[str, QuantityDocument]
    attitude_ratio: QuantityDocument
    noise_ratio: float
    gains: dict[str, GainDocument]
    reasons: list[str] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)


class TuneDocument(Document):
    """``tune.json``: a proposal, its files, and those that lead back."""

    schema_name: Annotated[Literal["rotorid.tune/1"], Field(alias="schema")] = "rotorid.tune/1"
    autopilot: str = ""
    firmware: str = ""
    changed: bool = False
    axes: dict[Axis, AxisTuneDocument] = Field(default_factory=dict)
    files: list[str] = Field(default_factory=list)
    rollback_files: list[str] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def tune_document(proposal: TuningProposal) -> TuneDocument:
    """A proposal as ``tune.json`` holds it."""
    return TuneDocument(
        autopilot=proposal.autopilot,
        firmware=proposal.firmware,
        changed=proposal.changed,
        axes={axis: _axis(one) for axis, one in proposal.axes.items()},
        files=list(proposal.files),
        rollback_files=list(proposal.rollback_files),
        findings=[FindingDocument.model_validate(finding) for finding in proposal.findings],
        provenance=ProvenanceDocument.model_validate(proposal.provenance),
    )


def refused_tune_document(refused: Refused) -> TuneDocument:
    """The document of flights from which no gains can be proposed: its findings say why."""
    return TuneDocument(
        findings=[FindingDocument.model_validate(finding) for finding in refused.findings],
        provenance=ProvenanceDocument.model_validate(refused.provenance),
    )


def tune_arrays(proposal: TuningProposal) -> dict[str, np.ndarray]:
    """Loops and steps on all plants, by axis."""
    found: dict[str, np.ndarray] = {}
    for axis, one in proposal.axes.items():
        found |= {f"{axis}/omega_rad_s": np.asarray(one.omega_rad_s), f"{axis}/step_s": np.asarray(one.step_s)}
        found |= {f"{axis}/loops/{name}": np.asarray(loop) for name, loop in one.loops.items()}
        found |= {f"{axis}/steps/{name}": np.asarray(step) for name, step in one.steps.items()}
    return found


def _axis(one: AxisTuning) -> AxisTuneDocument:
    proposal = one.proposal
    flown, proposed = proposal.flown, proposal.proposed
    return AxisTuneDocument(
        changed=proposal.changed,
        band_rad_s=one.plant.band_rad_s,
        flown=figures_document(flown.rate),
        proposed=figures_document(proposed.rate),
        flown_whole=figures_document(flown.whole),
        proposed_whole=figures_document(proposed.whole),
        attitude_ratio=_quantity(proposed.attitude_rms / flown.attitude_rms, "1"),
        noise_ratio=proposed.noise / flown.noise,
        gains={name: GainDocument(flown=before, proposed=after) for name, (before, after) in one.parameters.items()},
        reasons=list(proposal.reasons),
        notes=list(one.controller.notes),
    )


def figures_document(figures: LoopFigures) -> dict[str, QuantityDocument]:
    """Figures of a loop with their intervals; what most plants do not show is left out."""
    found = {}
    for name, (field, unit, factor) in _UNITS.items():
        values = np.asarray(getattr(figures, field), dtype=np.float64)
        values = 20.0 * np.log10(values) if factor == 0.0 else factor * values
        if np.isfinite(values).mean() > 0.5:
            found[name] = _quantity(values[np.isfinite(values)], unit)
    return found


def _quantity(values: FloatArray, unit: str) -> QuantityDocument:
    """Median of the draws with their interval of 95 %."""
    low, middle, high = np.quantile(values, (0.025, 0.5, 0.975))
    return QuantityDocument(
        value=float(middle), std=float(np.std(values)), lower=float(low), upper=float(high), unit=unit
    )
