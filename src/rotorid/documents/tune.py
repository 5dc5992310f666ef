"""``tune.json``, schema ``rotorid.tune/1``: gains proposed for a vehicle, and their predicted effect."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.documents.filter_curve import FilterCurveDocument, curve_document
from rotorid.documents.review import QuantityDocument, quantity_documents
from rotorid.documents.verdict import VerdictDocument, verdict_fields
from rotorid.loops.rate_loops import shown_quantities
from rotorid.proposing.axis_tuning import AxisTuning, PathStep
from rotorid.proposing.judging import AxisJudgment, JudgedGains
from rotorid.proposing.proposal import TuningProposal
from rotorid.results.model import Refused
from rotorid.tuning.judging import Verdict
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import over_draws, quantities
from rotorid.tuning.proposal import Judged, robustness_in_words
from rotorid.typing import LoopName

TUNE: str = "tune.json"
SIGNALS: str = "tune.npz"


class GainDocument(Document):
    """A parameter of the firmware, flown and proposed; both are equal where it does not change."""

    flown: float
    proposed: float


class FilterPriceDocument(Document):
    """A filter of a loop: its phase lag at the crossover in degrees, and the command's noise without it, relative."""

    name: str
    phase_deg: float
    noise_ratio: float


class ThrustDocument(Document):
    """The parameter that linearizes thrust; ranges are the loop gain relative to hover over the flown throttle."""

    parameter: str
    flown: float
    proposed: float
    best: QuantityDocument
    flown_range: tuple[float, float]
    proposed_range: tuple[float, float]
    hover_gain: float
    hover_demand: float


class PathStepDocument(Document):
    """Gains of one of several flights: the first has the proposed gains, the last, the ``goal``, the best ones.

    Margins are predicted with the plant of today. ``attitude_ratio`` is the attitude error under a disturbance relative
    to the flown gains, ``noise_ratio`` the command's noise, ``sweep_to_rad_s`` the upper end of the sweep to fly.
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

    Flown margins that the flight does not show are absent, as in ``review``.
    ``flown_attitude`` and ``proposed_attitude`` describe how the attitude follows its set-point, ``attitude_ratio`` is
    its error under a disturbance, proposed over flown; ``noise_ratio`` the command's noise, proposed over flown, which
    is ``noise_flown`` of the command's range where the log shows it. ``filters`` has the phase lag of each filter at
    the crossover, ``without_d`` the phase margin of the rate loop without D, by ``flown`` and ``proposed`` gains (null:
    it may be unstable), ``ends`` margins of the proposed rate loop where D changes in flight. ``path`` lists the
    flights to the best gains within the limits; it is empty where one flight reaches them.
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
    without_d: dict[str, QuantityDocument | None] = Field(default_factory=dict)
    ends: dict[str, dict[str, QuantityDocument]] = Field(default_factory=dict)
    reasons: list[str] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)


class AxisJudgedDocument(VerdictDocument):
    """Foreign gains on an axis: their verdict, their margins, and what to lower.

    ``rate``, ``whole`` and ``attitude`` have the margins as ``proposed``, ``proposed_whole`` and ``proposed_attitude``
    have them for proposed gains; ``lower`` has values of parameters with which the loops may fly.
    """

    rate: dict[str, QuantityDocument] = Field(default_factory=dict)
    whole: dict[str, QuantityDocument] = Field(default_factory=dict)
    attitude: dict[str, QuantityDocument] = Field(default_factory=dict)
    attitude_ratio: QuantityDocument | None = None
    noise_ratio: float | None = None
    noise: float | None = None
    gains: dict[str, GainDocument] = Field(default_factory=dict)
    lower: dict[str, float] = Field(default_factory=dict)
    reasons: list[str] = Field(default_factory=list)


class JudgedDocument(Document):
    """The verdict on the gains of a file: that of every axis that they may change, and the worst of them."""

    source: str = ""
    axes: dict[LoopName, AxisJudgedDocument] = Field(default_factory=dict)
    verdict: Verdict


class TuneDocument(Document):
    """``tune.json``: a proposal, its files, and the files to go back; ``robustness`` is the limit in words.

    ``filter_curve`` is there where filters were looked for with the gains.
    ``judged`` is there where foreign gains were judged; ``breaks`` has the likely plants that break
    their axes: gain and phase over the likeliest plant, at the frequency where the loop breaks.
    """

    schema_name: Annotated[Literal["rotorid.tune/1"], Field(alias="schema")] = "rotorid.tune/1"
    autopilot: str = ""
    firmware: str = ""
    changed: bool = False
    axes: dict[LoopName, AxisTuneDocument] = Field(default_factory=dict)
    thrust: ThrustDocument | None = None
    robustness: str = ""
    scale: float | None = None
    files: list[str] = Field(default_factory=list)
    rollback_files: list[str] = Field(default_factory=list)
    filter_curve: FilterCurveDocument | None = None
    judged: JudgedDocument | None = None
    breaks: dict[str, float] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def tune_document(proposal: TuningProposal) -> TuneDocument:
    """A proposal as written to ``tune.json``."""
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
        filter_curve=curve_document(proposal.curve),
        judged=None if proposal.judged is None else _judged(proposal.judged),
        breaks={} if proposal.judged is None else _breaks(proposal.judged),
        findings=[FindingDocument.model_validate(finding) for finding in proposal.findings],
        provenance=ProvenanceDocument.model_validate(proposal.provenance),
    )


def refused_tune_document(refused: Refused, *, judging: str = "") -> TuneDocument:
    """The document of flights that support no gains; its findings give the reasons.

    Parameters
    ----------
    judging
        Name of the file whose gains were to be judged.
    """
    return TuneDocument(
        judged=JudgedDocument(source=judging, verdict="not_enough_data") if judging else None,
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
    for axis, judged in proposal.judged.axes.items() if proposal.judged is not None else ():
        found |= {f"{axis}/judged/{name}": np.asarray(step) for name, step in judged.steps.items()}
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
        without_d={
            name: None if margin is None else QuantityDocument.model_validate(margin)
            for name, margin in tuning.without_derivative.items()
        },
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


def _judged(gains: JudgedGains) -> JudgedDocument:
    axes = {axis: _judged_axis(found) for axis, found in gains.axes.items()}
    axes |= {axis: AxisJudgedDocument(verdict="not_enough_data", reasons=[why]) for axis, why in gains.unknown.items()}
    in_order = {axis: axes[axis] for axis in KINDS if axis in axes}
    return JudgedDocument(source=gains.source, axes=in_order, verdict=gains.verdict)


def _judged_axis(found: AxisJudgment) -> AxisJudgedDocument:
    scores = found.judged
    return AxisJudgedDocument(
        **{**verdict_fields(found.found), "verdict": found.verdict},
        rate=quantity_documents(quantities(scores.rate)),
        whole=quantity_documents(quantities(scores.whole)),
        attitude=quantity_documents(quantities(scores.attitude)),
        attitude_ratio=QuantityDocument.model_validate(over_draws(scores.attitude_rms / found.flown.attitude_rms, "1")),
        noise_ratio=found.noise.ratio,
        noise=found.noise.rms,
        gains={
            name: GainDocument(flown=flown, proposed=foreign) for name, (flown, foreign) in found.parameters.items()
        },
        lower=dict(found.lower),
        reasons=list(found.reasons),
    )


def _breaks(gains: JudgedGains) -> dict[str, float]:
    """For every axis not to be flown the likely plant that breaks it; empty where there is none."""
    broken = {axis: found for axis, found in gains.axes.items() if found.verdict == "do_not_fly"}
    found: dict[str, float] = {}
    for axis, one in broken.items():
        plant = one.found.breaking
        found |= {f"{axis}_gain": plant.gain, f"{axis}_phase_deg": plant.phase_deg, f"{axis}_rad_s": plant.omega_rad_s}
    return found
