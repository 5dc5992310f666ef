"""The documents that commands write: typed, so that their JSON schemas come from the code.

Parts of documents that say how well a model does on data, and what the data were.

What ``result.json`` says of motors beside parameters.

The part of ``result.json`` that says how a cross-validation went.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document
from rotorid.documents.base import FindingDocument as FindingDocument
from rotorid.documents.base import ManeuverDocument as ManeuverDocument
from rotorid.documents.base import ProvenanceDocument as ProvenanceDocument
from rotorid.verification.fixed_parameters import CrossValidation, FixedParameterScores, Kind, Model, fit_percent
from rotorid.verification.verification import Verdict


class PairCost(Document):
    """Cost of one response."""

    value: float
    band_rad_s: tuple[float, float]
    points: int


class ScoreDocument(Document):
    """How one output of the model predicts one unseen record."""

    nrmse_fit_percent: float
    tic: float
    rms: float
    bias: float
    reference_shift: float


class RangeDocument(Document):
    """What the fitted data covered of a quantity."""

    unit: str
    lowest: float
    highest: float
    rms: float


class TrimDocument(Document):
    """State about which a maneuver moves, SI units; in hover the speeds count as zero."""

    values: dict[str, float]
    hover: bool


class AheadScoreDocument(Document):
    """How one output is predicted over one horizon; a skill of 0 is that of "stays as it is"."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float
    skill: float
    over_quiet: float | None = None


class AheadDocument(Document):
    """Predictions over one horizon, restarted at every sample from the state that the time before shows."""

    horizon_s: float
    outputs: dict[str, AheadScoreDocument]


class LoopScoreDocument(Document):
    """How one output or command is predicted in closed loop."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float


class ClosedLoopDocument(Document):
    """The model under the controller that flew.

    ``setpoints`` names the channel that drove the controller of each command, ``controller_tic`` says how well that
    controller alone makes the measured command of the measured rate. Rates flatter the model, because the controller
    makes them; commands and accelerations tell more.
    """

    setpoints: dict[str, str]
    controller_tic: dict[str, float]
    scores: dict[str, LoopScoreDocument]


class ManeuverVerificationDocument(Document):
    """One unseen maneuver: open loop, prediction ahead, closed loop, and what follows."""

    record: str
    axis: str
    kind: str
    start_s: float
    stop_s: float
    verdict: Verdict
    scores: dict[str, ScoreDocument]
    j_rms: float
    biases: dict[str, float]
    growth_1_s: float
    low_pass_rad_s: float | None = None
    moved: list[str]
    ahead: list[AheadDocument] = Field(default_factory=list)
    holds_s: dict[str, float] = Field(default_factory=dict)
    closed_loop: ClosedLoopDocument | None = None
    trim: TrimDocument | None = None


class SweepVerificationDocument(Document):
    """Cost of the model against each response of sweeps that were not fitted."""

    records: list[str]
    pairs: dict[str, PairCost]


class DerivedDocument(Document):
    """A quantity that follows from the parameters."""

    value: float
    std: float
    unit: str


class ExcitationDocument(Document):
    """How far the motors explain the slow motion of a stretch: a correlation up to 5 Hz, and the axes that counted."""

    record: str
    start_s: float
    stop_s: float
    sample_rate_hz: float
    correlation: dict[str, float]
    counted: list[str]


class BothWaysDocument(Document):
    """An inertia by acceleration on torque and by torque on acceleration: plain, and without the bias of noise."""

    axis: str
    parameter: str
    unit: str
    plain: tuple[float, float]
    corrected: tuple[float, float]
    std: tuple[float, float]
    agrees: bool


class MotorsDocument(Document):
    """Motors, rotors and thrust of a fit of ``physical.motors``.

    ``outputs`` says what the motors are known by (``output``, ``thrust_demand`` or ``speed``), ``source`` where from.
    ``rotors`` are positions forward, right and down, in meters where ``arm_m`` is known and else in units of the arm,
    with the direction of their torque (+1 turns the nose right). ``derived`` holds thrust of a rotor at the mean output
    of the flights (``thrust_hover``), its slope there, thrust at full output and that over weight; ``flown_outputs`` is
    the range of the outputs but for one percent at each end, beyond which thrust is extrapolated. ``scale`` names what
    fixed the scale of mass, thrust and inertia, or is ``null``: then all three are per kilogram.
    """

    layout: str
    arm_m: float | None
    rotors: list[list[float]]
    spins: list[float]
    outputs: str
    source: str
    outputs_rate_hz: float
    curve: str
    curve_assumed: bool = False
    reference_v: float | None = None
    hover_output: float
    flown_outputs: tuple[float, float]
    scale: str | None
    derived: dict[str, DerivedDocument] = Field(default_factory=dict)
    both_ways: list[BothWaysDocument] = Field(default_factory=list)
    excitation: list[ExcitationDocument] = Field(default_factory=list)


class FrozenScoreDocument(Document):
    """How one output was predicted with frozen parameters; a fit is ``null`` where the output did not move."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float


class FoldParameterDocument(Document):
    """A parameter as one fold has it."""

    value: float
    std: float | None = None


class FoldDocument(Document):
    """One identification: on which records, and its scores by record and output, seen records included.

    ``mean_percent`` and ``spread_percent``, a standard deviation over records, are those of unseen records only.
    """

    identified: list[str]
    unseen: list[str]
    scores: dict[str, dict[str, FrozenScoreDocument]]
    mean_percent: float | None = None
    spread_percent: float | None = None
    parameters: dict[str, FoldParameterDocument] = Field(default_factory=dict)
    cause: str = ""


class BestFoldDocument(Document):
    """The record that is best to identify on, chosen by the very scores that stand here: optimistic."""

    record: str
    mean_percent: float
    spread_percent: float | None = None


class CrossValidationDocument(Document):
    """A cross-validation: ``each`` record alone or ``leave_one_out``, scored on records that were not identified on.

    ``mean_percent`` is over all unseen scores, ``spread_percent`` their standard deviation. ``horizon_s`` is ``null``
    where records were simulated whole; else the models are unstable and were predicted so far ahead, again and again.
    ``band_rad_s`` is what was looked at, ``null`` for everything.
    """

    kind: Kind
    records: list[str]
    outputs: list[str]
    horizon_s: float | None = None
    band_rad_s: tuple[float, float] | None = None
    folds: list[FoldDocument]
    mean_percent: float | None = None
    spread_percent: float | None = None
    best: BestFoldDocument | None = None


def frozen_scores(group: tuple[FixedParameterScores, ...]) -> dict[str, FrozenScoreDocument]:
    """Scores of a group of records by output, as means over its records."""
    names = dict.fromkeys(name for one in group for name in one.scores)
    return {name: _mean_score(group, name) for name in names}


def _mean_score(group: tuple[FixedParameterScores, ...], name: str) -> FrozenScoreDocument:
    every = [one.scores[name] for one in group if name in one.scores]
    return FrozenScoreDocument(
        nrmse_fit_percent=finite(fit_percent(group, name)),
        tic=sum(score.tic for score in every) / len(every),
        rms=sum(score.rms for score in every) / len(every),
    )


def finite(value: float) -> float | None:
    """A number, or ``None`` where it is not finite."""
    return float(value) if math.isfinite(value) else None


def cross_validation_document(
    found: CrossValidation[Model],
    parameters: tuple[dict[str, FoldParameterDocument], ...],
    band_rad_s: tuple[float, float] | None = None,
) -> CrossValidationDocument:
    """A cross-validation as a document.

    Parameters
    ----------
    found
        What was found.
    parameters
        Those of the model of each fold.
    band_rad_s
        What was looked at.
    """
    means, spreads = found.fold_means, found.fold_spreads
    best = found.best
    horizons_s = found.horizons_s
    return CrossValidationDocument(
        kind=found.kind,
        records=list(found.records),
        outputs=list(found.outputs),
        horizon_s=finite(horizons_s[0]) if horizons_s else None,
        band_rad_s=band_rad_s,
        folds=[
            FoldDocument(
                identified=list(fold.identified),
                unseen=[name for name in found.records if name not in fold.identified],
                scores={
                    name: frozen_scores(group) for name, group in zip(found.records, fold.scores, strict=True) if group
                },
                mean_percent=finite(means[row]),
                spread_percent=finite(spreads[row]),
                parameters=parameters[row],
                cause=fold.cause,
            )
            for row, fold in enumerate(found.folds)
        ],
        mean_percent=finite(found.mean),
        spread_percent=finite(found.spread),
        best=None
        if best is None
        else BestFoldDocument(
            record=found.records[best], mean_percent=float(means[best]), spread_percent=finite(spreads[best])
        ),
    )


Status = Literal["free", "fixed", "tied", "dropped"]


class ParameterDocument(Document):
    """One parameter with its uncertainty; percents are CIFER's, ``std`` covers random errors, not a wrong structure."""

    value: float
    unit: str
    std: float | None = None
    cramer_rao_percent: float | None = None
    insensitivity_percent: float | None = None
    status: Status


class CostDocument(Document):
    """Frequency-domain cost: the average, and each response on its own."""

    average: float
    pairs: dict[str, PairCost]


class DelaysDocument(Document):
    """Delays of inputs and outputs in seconds, in the order of the names."""

    inputs: list[float]
    outputs: list[float]


class MatricesDocument(Document):
    """Matrices of ``M x' = F x + G u(t - tau)``, ``y = H0 x + H1 x'`` at the identified values."""

    M: list[list[float]]
    F: list[list[float]]
    G: list[list[float]]
    H0: list[list[float]]
    H1: list[list[float]]
    delays_s: DelaysDocument


class PoleDocument(Document):
    """An eigenvalue of the model; standard deviations are ``null`` where it is (nearly) a multiple one."""

    real: float
    imag: float
    damping: float
    frequency_rad_s: float
    real_std: float | None = None
    imag_std: float | None = None
    damping_std: float | None = None
    frequency_std_rad_s: float | None = None


class VerificationDocument(Document):
    """Scores per unseen record and output, and costs of responses on unseen sweeps.

    ``records`` and ``frequency`` are the short form; ``maneuvers`` and ``sweeps`` say everything.
    """

    records: dict[str, dict[str, ScoreDocument]] = Field(default_factory=dict)
    frequency: dict[str, float] = Field(default_factory=dict)
    maneuvers: list[ManeuverVerificationDocument] = Field(default_factory=list)
    sweeps: list[SweepVerificationDocument] = Field(default_factory=list)


class CombinationDocument(Document):
    """Parameters that the data cannot tell apart, in words and as a vector over parameter names."""

    words: str
    vector: dict[str, float]


class StepDocument(Document):
    """One step of the reduction: a parameter that was looked at, what became of it, and why."""

    parameter: str
    action: Literal["dropped", "kept", "protected"]
    reason: str
    value_before: float
    insensitivity_percent: float | None
    cramer_rao_percent: float | None
    mean_cost_before: float
    mean_cost_after: float | None


class CorrelationDocument(Document):
    """Correlation of the free parameters, in the order of the names."""

    names: list[str]
    matrix: list[list[float]]


class FitDocument(Document):
    """How the fit went.

    ``weights`` says what was minimized last: CIFER's cost, errors weighed by their measured covariance, or in time the
    errors of the outputs, or of the equations, by the covariance that they have (``likelihood``). ``trace`` is CIFER's
    cost, summed over the responses, or the sum of squares in time, after each accepted step. ``inflation`` is the
    factor on standard deviations because residuals were larger than the errors of the data, or in time because they
    are not white.
    """

    weights: Literal["cifer", "covariance", "likelihood"]
    outcome: str
    evaluations: int
    trace: list[float]
    inflation: float


class RecordFitDocument(Document):
    """A stretch of a record that was fitted in time: share of each output's motion that the model explains."""

    record: str
    start_s: float
    stop_s: float
    samples: int
    sample_rate_hz: float
    pieces: int = 1
    fit_percent: dict[str, float]


class ComparedDocument(Document):
    """A parameter as the fit in the frequency domain has it.

    ``hold_s`` is the part of a delay that the response contains and a simulation with held inputs has apart.
    """

    value: float
    std: float | None = None
    hold_s: float = 0.0


class MinimumDocument(Document):
    """Another place where a search came to rest: its sum of squares, outputs weighed by size, and its parameters."""

    cost: float
    parameters: dict[str, float]


class BasinDocument(Document):
    """A minimum of a search: its cost, its parameters, and the share of the local searches that ended there."""

    cost: float
    share: float
    parameters: dict[str, float]


class SearchDocument(Document):
    """A global search before the fit.

    ``name`` is the search with its options, ``objective`` what it minimized: CIFER's cost, summed over the responses,
    or the squared output errors, weighed by the size of the outputs. ``evaluations`` of the cost are its own,
    ``polishing`` those of its ``local_searches``. ``minima`` begin with the one that the fit went on from, then lowest
    first. ``trace`` is the lowest cost so far after so many evaluations.
    """

    name: str
    objective: Literal["frequency", "output_error"]
    evaluations: int
    polishing: int
    local_searches: int
    minima: list[BasinDocument]
    trace: list[tuple[int, float]]


class SpreadDocument(Document):
    """A parameter over the runs of a bootstrap; ``low``, ``median`` and ``high`` are percentiles 2.5, 50 and 97.5."""

    mean: float
    std: float
    relative_percent: float | None
    low: float
    median: float
    high: float


class BootstrapDocument(Document):
    """Refits to noise drawn anew: errors of the ``responses``, or noise of the ``outputs``.

    ``left_out`` says why runs do not count, and how many. ``correlation`` is that of the runs.
    """

    source: Literal["responses", "outputs"]
    runs: int
    seed: int
    left_out: dict[str, int]
    parameters: dict[str, SpreadDocument]
    correlation: CorrelationDocument


class EquationDocument(Document):
    """How well an equation of motion holds: ``q'`` for the derivative of a state, an output by its name.

    ``r_squared`` is the share of its left side that is explained, ``misfit`` the rms of its residual over that of its
    left side, ``press`` the squared error of predicting each of its rows by all others.
    """

    name: str
    r_squared: float
    press: float
    misfit: float


class InformationDocument(Document):
    """Information criteria; ``numbers`` counts parameters, initial states, trims and the noise covariance."""

    aic: float
    bic: float
    numbers: int


class ResidualsDocument(Document):
    """Residuals of a fit in time.

    ``memory`` is the order of the autoregression that describes their color, ``inflation`` the factor that it puts on
    standard deviations. ``autocorrelation`` of each output is at lags of ``step_s``, from zero on; that of white
    residuals would stay within ``chance``, two standard deviations.
    """

    memory: int
    inflation: float
    step_s: float
    chance: float
    autocorrelation: dict[str, list[float]]


class DelayDocument(Document):
    """Delays on the way from an input to an output, in seconds: a motor lag counts as a delay of its time constant."""

    input_delay_s: float
    motor_lag_s: float
    output_delay_s: float
    total_s: float
    total_std_s: float | None
    known_filters_s: float | None = None


class ResultDocument(Document):
    """``result.json``: everything that an identification answers."""

    schema_name: Annotated[Literal["rotorid.result/1"], Field(alias="schema")] = "rotorid.result/1"
    model: str
    inputs: list[str]
    outputs: list[str]
    states: list[str]
    parameters: dict[str, ParameterDocument] = Field(default_factory=dict)
    cost: CostDocument | None = None
    fit_percent: dict[str, float] | None = None
    fit: FitDocument | None = None
    method: Literal["frequency", "output_error", "prediction_error", "equation_error"] = "frequency"
    hold: Literal["zero", "first"] | None = None
    pieces_s: float | None = None
    records: list[RecordFitDocument] = Field(default_factory=list)
    noise: dict[str, float] | None = None
    log_likelihood: float | None = None
    information: InformationDocument | None = None
    residuals: ResidualsDocument | None = None
    minima: list[MinimumDocument] = Field(default_factory=list)
    search: SearchDocument | None = None
    bootstrap: BootstrapDocument | None = None
    equations: list[EquationDocument] = Field(default_factory=list)
    frequency_fit: dict[str, ComparedDocument] | None = None
    reduction: list[StepDocument] = Field(default_factory=list)
    correlation: CorrelationDocument | None = None
    constants: dict[str, float] = Field(default_factory=dict)
    matrices: MatricesDocument | None = None
    poles: list[PoleDocument] = Field(default_factory=list)
    delays: dict[str, DelayDocument] = Field(default_factory=dict)
    covered: dict[str, RangeDocument] = Field(default_factory=dict)
    verification: VerificationDocument = Field(default_factory=VerificationDocument)
    cross_validation: CrossValidationDocument | None = None
    identifiability: list[CombinationDocument] = Field(default_factory=list)
    motors: MotorsDocument | None = None
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument
