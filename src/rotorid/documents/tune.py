"""``tune.json``, schema ``rotorid.tune/1``: gains proposed for a vehicle, and what they will do."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.data.quantity import Quantity
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.documents.review import QuantityDocument
from rotorid.loops.rate_loops import shown_quantities
from rotorid.proposing.proposal import AxisTuning, PathStep, TuningProposal
from rotorid.results.model import Refused
from rotorid.tuning.loops import over_draws, quantities
from rotorid.tuning.proposal import Judged, robustness_in_words
from rotorid.typing import Axis

TUNE, SIGNALS = "tune.json", "tune.npz"

LIMIT_IS_KEPT = "95 of 100 likely plants keep it, so intervals may end a little above it"
"""Why the upper end of a 95 % interval may lie above a limit that the gains keep."""


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


class PathStepDocument(Document):
    """Gains of one of several flights: the first is what is proposed, the last, the ``goal``, keeps the limits alone.

    Margins are foretold with the plant of today. ``attitude_ratio`` is the deviation under a moment over that with the
    flown gains, ``noise_ratio`` that of the command, ``sweep_to_rad_s`` the upper end of a sweep that shows the loop.
    """

    flight: int
    goal: bool
    gains: dict[str, float]
    rate: dict[str, QuantityDocument]
    whole: dict[str, QuantityDocument]
    attitude_ratio: QuantityDocument
    noise_ratio: float
    sweep_to_rad_s: float


class AxisTuneDocument(Document):
    """An axis: margins of the rate loop alone and of the whole loop, flown and proposed, and its parameters.

    What the flight does not show of the flown loops is absent, as in ``review``.
    ``flown_attitude`` and ``proposed_attitude`` say how the attitude follows its set-point, ``attitude_ratio`` is its
    deviation under a moment, proposed over flown; ``noise_ratio`` that of the command by noise of the rate, which is
    ``noise_flown`` of the command's range where the log shows it. ``filters`` has the phase that each filter of the
    loop takes at its crossover, ``ends`` margins of the proposed rate loop where D moves in flight. ``path`` leads over
    several flights to the gains that keep the limits of the loop alone; it is empty where one flight reaches them.
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
    path: list[PathStepDocument] = Field(default_factory=list)
    filters: list[FilterPriceDocument] = Field(default_factory=list)
    ends: dict[str, dict[str, QuantityDocument]] = Field(default_factory=dict)
    reasons: list[str] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)


class TuneDocument(Document):
    """``tune.json``: a proposal, its files, and those that lead back; ``robustness`` is the limit in words."""

    schema_name: Annotated[Literal["rotorid.tune/1"], Field(alias="schema")] = "rotorid.tune/1"
    autopilot: str = ""
    firmware: str = ""
    changed: bool = False
    axes: dict[Axis, AxisTuneDocument] = Field(default_factory=dict)
    thrust: ThrustDocument | None = None
    robustness: str = ""
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
        axes={axis: _axis(tuning) for axis, tuning in proposal.axes.items()},
        thrust=None if proposal.thrust is None else ThrustDocument.model_validate(proposal.thrust),
        robustness=robustness_in_words(proposal.robustness),
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
    for axis, tuning in proposal.axes.items():
        found |= {f"{axis}/omega_rad_s": np.asarray(tuning.omega_rad_s), f"{axis}/step_s": np.asarray(tuning.step_s)}
        found |= {f"{axis}/loops/{name}": np.asarray(loop) for name, loop in tuning.loops.items()}
        found |= {f"{axis}/responses/{name}": np.asarray(row) for name, row in tuning.responses.items()}
        found |= {f"{axis}/steps/{name}": np.asarray(step) for name, step in tuning.steps.items()}
    return found


def _axis(tuning: AxisTuning) -> AxisTuneDocument:
    proposal = tuning.proposal
    flown, proposed = proposal.flown, proposal.proposed
    return AxisTuneDocument(
        changed=tuning.changed,
        band_rad_s=tuning.plant.band_rad_s,
        flown=quantity_documents(shown_quantities(flown.rate, tuning.plant)),
        proposed=quantity_documents(quantities(proposed.rate)),
        flown_whole=quantity_documents(shown_quantities(flown.whole, tuning.plant)),
        proposed_whole=quantity_documents(quantities(proposed.whole)),
        flown_attitude=quantity_documents(quantities(flown.attitude)),
        proposed_attitude=quantity_documents(quantities(proposed.attitude)),
        attitude_ratio=QuantityDocument.model_validate(over_draws(proposed.attitude_rms / flown.attitude_rms, "1")),
        noise_ratio=proposed.noise / flown.noise,
        noise_flown=flown.noise if tuning.noise_seen else None,
        gains={name: GainDocument(flown=before, proposed=after) for name, (before, after) in tuning.parameters.items()},
        path=[_step(step, flown, tuning.needed_rad_s) for step in tuning.path],
        filters=[FilterPriceDocument.model_validate(price) for price in tuning.prices],
        ends={name: quantity_documents(quantities(end.rate)) for name, end in tuning.ends.items()},
        reasons=list(proposal.reasons),
        notes=list(tuning.controller.notes),
    )


def _step(step: PathStep, flown: Judged, sweep_to_rad_s: float) -> PathStepDocument:
    scores = step.judged
    return PathStepDocument(
        flight=step.flight,
        goal=step.goal,
        gains=dict(step.parameters),
        rate=quantity_documents(quantities(scores.rate)),
        whole=quantity_documents(quantities(scores.whole)),
        attitude_ratio=QuantityDocument.model_validate(over_draws(scores.attitude_rms / flown.attitude_rms, "1")),
        noise_ratio=scores.noise / flown.noise,
        sweep_to_rad_s=sweep_to_rad_s,
    )


def end_of(tuning: AxisTuneDocument) -> str:
    """Where in its range the D of the numbers of an axis is; empty for a D that does not move in flight."""
    known = tuning.proposed.get("crossover_rad_s")
    each = {name: end.get("crossover_rad_s") for name, end in tuning.ends.items()}
    same = [name for name, end in each.items() if known and end and math.isclose(end.value, known.value)]
    return same[0] if len(same) == 1 else ""


def step_name(step: PathStepDocument) -> str:
    """What people call a flight of the path."""
    return f"{step.flight}, proposed" if step.flight == 1 else f"{step.flight}, goal" if step.goal else f"{step.flight}"


_WORTH_A_FACTOR = 1.0 / 1.5
"""A deviation over another one, up to which it is said as a factor, and beyond in percent."""


def path_sentence(tuning: AxisTuneDocument) -> str:
    """How the path of an axis is flown."""
    first, *_, goal = tuning.path
    left = goal.attitude_ratio.value / first.attitude_ratio.value
    less = f"{1.0 / left:.2g} times" if left <= _WORTH_A_FACTOR else f"{100.0 * (1.0 - left):.0f} %"
    return (
        "P, D and A (angle) at most double in one flight. Fly the proposed gains with a sweep up to "
        f"{goal.sweep_to_rad_s:.0f} rad/s, check that flight, and tune again. With the goal a disturbance tilts the "
        f"vehicle {less} less than with the proposed gains."
    )


def quantity_documents(found: Mapping[str, Quantity]) -> dict[str, QuantityDocument]:
    """Numbers with their intervals, by name."""
    return {name: QuantityDocument.model_validate(quantity) for name, quantity in found.items()}
