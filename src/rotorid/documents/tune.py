"""``tune.json``, schema ``rotorid.tune/1``: gains proposed for a vehicle, and what they will do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.data.quantity import Quantity
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.documents.review import QuantityDocument
from rotorid.pipeline.results import Refused
from rotorid.pipeline.tuning.proposal import AxisTuning, TuningProposal
from rotorid.tuning.loops import over_draws, quantities
from rotorid.typing import Axis

TUNE, SIGNALS = "tune.json", "tune.npz"


class GainDocument(Document):
    """A parameter of the firmware as it was flown and as it is proposed; one that stays has both alike."""

    flown: float
    proposed: float


class FilterPriceDocument(Document):
    """A filter of a loop: degrees of phase at the crossover that it takes, and noise of the command without it."""

    name: str
    phase_deg: float
    noise_ratio: float


class ThrustDocument(Document):
    """What straightens the curve of thrust; ranges are gains of the loops over that in hover, as the throttle moves."""

    parameter: str
    flown: float
    proposed: float
    best: QuantityDocument
    flown_range: tuple[float, float]
    proposed_range: tuple[float, float]
    hover_gain: float
    hover_demand: float


class AxisTuneDocument(Document):
    """An axis: margins of the rate loop alone and of the whole loop, flown and proposed, and its parameters.

    ``flown_attitude`` and ``proposed_attitude`` say how the attitude follows its set-point, ``attitude_ratio`` is its
    deviation under a moment, proposed over flown; ``noise_ratio`` that of the command by noise of the rate, which is
    ``noise_flown`` of the command's range where the log shows it. ``filters`` has the phase that each filter of the
    loop takes at its crossover, ``ends`` margins of the proposed rate loop where D moves in flight.
    """

    changed: bool
    band_rad_s: tuple[float, float]
    flown: dict[str, QuantityDocument]
    proposed: dict[str, QuantityDocument]
    flown_whole: dict[str, QuantityDocument]
    proposed_whole: dict[str, QuantityDocument]
    flown_attitude: dict[str, QuantityDocument] = Field(default_factory=dict)
    proposed_attitude: dict[str, QuantityDocument] = Field(default_factory=dict)
    attitude_ratio: QuantityDocument
    noise_ratio: float
    noise_flown: float | None = None
    gains: dict[str, GainDocument]
    filters: list[FilterPriceDocument] = Field(default_factory=list)
    ends: dict[str, dict[str, QuantityDocument]] = Field(default_factory=dict)
    reasons: list[str] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)


class TuneDocument(Document):
    """``tune.json``: a proposal, its files, and those that lead back."""

    schema_name: Annotated[Literal["rotorid.tune/1"], Field(alias="schema")] = "rotorid.tune/1"
    autopilot: str = ""
    firmware: str = ""
    changed: bool = False
    axes: dict[Axis, AxisTuneDocument] = Field(default_factory=dict)
    thrust: ThrustDocument | None = None
    scale: float | None = None
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
        thrust=None if proposal.thrust is None else ThrustDocument.model_validate(proposal.thrust),
        scale=proposal.scale,
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
        found |= {f"{axis}/responses/{name}": np.asarray(row) for name, row in one.responses.items()}
        found |= {f"{axis}/steps/{name}": np.asarray(step) for name, step in one.steps.items()}
    return found


def _axis(one: AxisTuning) -> AxisTuneDocument:
    proposal = one.proposal
    flown, proposed = proposal.flown, proposal.proposed
    return AxisTuneDocument(
        changed=one.changed,
        band_rad_s=one.plant.band_rad_s,
        flown=quantity_documents(quantities(flown.rate)),
        proposed=quantity_documents(quantities(proposed.rate)),
        flown_whole=quantity_documents(quantities(flown.whole)),
        proposed_whole=quantity_documents(quantities(proposed.whole)),
        flown_attitude=quantity_documents(quantities(flown.attitude)),
        proposed_attitude=quantity_documents(quantities(proposed.attitude)),
        attitude_ratio=QuantityDocument.model_validate(over_draws(proposed.attitude_rms / flown.attitude_rms, "1")),
        noise_ratio=proposed.noise / flown.noise,
        noise_flown=flown.noise if one.noise_seen else None,
        gains={name: GainDocument(flown=before, proposed=after) for name, (before, after) in one.parameters.items()},
        filters=[FilterPriceDocument.model_validate(price) for price in one.prices],
        ends={name: quantity_documents(quantities(end.rate)) for name, end in one.ends.items()},
        reasons=list(proposal.reasons),
        notes=list(one.controller.notes),
    )


def quantity_documents(found: Mapping[str, Quantity]) -> dict[str, QuantityDocument]:
    """Numbers with their intervals, by name."""
    return {name: QuantityDocument.model_validate(one) for name, one in found.items()}
