"""The numbers of an identified model, each once.

They are what ``result.json`` holds. :mod:`rotorid.documents.result` writes them as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.models.flight import Airframe
from rotorid.models.parameter import Status
from rotorid.verification.verification import Kind, Scores, Verdict

Objective: TypeAlias = Literal["frequency", "output_error", "accelerations"]

FitWeights: TypeAlias = Literal["cifer", "covariance", "likelihood", "absolute"]

Color: TypeAlias = Literal["green", "yellow", "red", "gray"]

MethodName: TypeAlias = Literal["frequency", "output_error", "prediction_error", "equation_error", "accelerations"]


class MethodWords(NamedTuple):
    """Name of a fitting method on pages, and its description in a sentence."""

    name: str
    how: str = ""


METHODS: Mapping[str, MethodWords] = MappingProxyType(
    {
        "frequency": MethodWords("frequency responses"),
        "output_error": MethodWords(
            "output error",
            "Output error: the model was simulated from the inputs alone, and the remaining error of the outputs "
            "was minimized, weighed by its covariance.",
        ),
        "prediction_error": MethodWords(
            "prediction error",
            "Prediction error: the model predicted every sample from those before it, with a fitted noise model, "
            "so feedback causes no bias.",
        ),
        "equation_error": MethodWords(
            "equation error",
            "Equation error: the equations of motion were fitted to measured accelerations and states. Noise in "
            "the states biases the result.",
        ),
        "accelerations": MethodWords(
            "accelerations",
            "Accelerations: the sum of their absolute errors up to 5 Hz was minimized, each relative to its own "
            "spread. Noise fed back by the controller biases the result.",
        ),
    }
)


@dataclass(frozen=True, kw_only=True, slots=True)
class FitVerdict:
    """How a fit is to be taken, by :mod:`rotorid.results.verdicts`: a word, a color, and the reason in one sentence.

    ``gray`` stands for what is not known. ``number`` is the cost or the percent that was judged.
    """

    word: str
    color: Color
    reason: str
    number: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Range:
    """Range of a quantity in the fitted data."""

    unit: str
    lowest: float
    highest: float
    rms: float
    mean: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Trim:
    """State about which a maneuver moves, SI units; in hover the speeds count as zero."""

    values: Mapping[str, float]
    hover: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class PairCost:
    """Cost of one response."""

    value: float
    band_rad_s: tuple[float, float]
    points: int


@dataclass(frozen=True, kw_only=True, slots=True)
class AheadScore:
    """How one output is predicted over one horizon; a skill of 0 is that of "stays as it is"."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float
    skill: float
    over_quiet: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Ahead:
    """Predictions over one horizon, restarted at every sample from the state that the time before shows."""

    horizon_s: float
    outputs: Mapping[str, AheadScore]


@dataclass(frozen=True, kw_only=True, slots=True)
class SignalScore:
    """How one signal was predicted; a fit is ``None`` where it did not move."""

    nrmse_fit_percent: float | None
    tic: float
    rms: float


@dataclass(frozen=True, kw_only=True, slots=True)
class ClosedLoopScores:
    """The model under the controller that flew.

    ``setpoints`` names the channel that drove the controller of each command, ``controller_tic`` says how well that
    controller alone makes the measured command of the measured rate. Rates flatter the model, because the controller
    makes them; commands and accelerations show more.
    """

    setpoints: Mapping[str, str]
    controller_tic: Mapping[str, float]
    scores: Mapping[str, SignalScore]


@dataclass(frozen=True, kw_only=True, slots=True)
class AxisLoads:
    """Root mean square error of force along an axis and of moment about it; ``null`` where the model has none."""

    force_rms_n: float | None = None
    moment_rms_nm: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class StepError:
    """Mean error of one quantity after one time, and that of a state that is kept."""

    horizon_s: float
    model: float
    naive: float


@dataclass(frozen=True, kw_only=True, slots=True)
class StepsAhead:
    """Predictions by motors alone over ``steps`` steps up to ``horizon_s``, from ``starts`` states of the log.

    ``errors`` has some of the steps, in m, m/s, rad and rad/s by ``position``, ``velocity``, ``attitude`` and
    ``rates``; ``ratios`` the sums over all steps, as shares of those of a state that is kept.
    """

    horizon_s: float
    steps: int
    starts: int
    errors: Mapping[str, tuple[StepError, ...]]
    ratios: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class FlightScores:
    """A physical model on unseen flight, in units of force and moment.

    ``force_rms_n`` and ``moment_rms_nm`` are root mean squares of the length of the error vector, over the ``axes``
    (``x``, ``y``, ``z``) that the model has. ``outside_percent`` is the share of the time outside of the identified
    range, ``outside`` that of each range (``airspeed``, ``climb``, ``load``, ``motors``). ``wind_m_s`` blows toward
    north and east, motors were stamped ``skew_s`` early, and the center of gravity was at ``center_m`` (``x_cg``,
    ``y_cg``), as found in this flight.
    """

    force_rms_n: float | None
    moment_rms_nm: float | None
    axes: Mapping[str, AxisLoads]
    outside_percent: float | None = None
    outside: Mapping[str, float] = field(default_factory=dict)
    ahead: StepsAhead | None = None
    wind_m_s: tuple[float, float] | None = None
    skew_s: float | None = None
    center_m: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, slots=True)
class ManeuverCheck:
    """One unseen maneuver: open loop, prediction ahead, closed loop, and what follows."""

    record: str
    axis: str
    kind: str
    start_s: float
    stop_s: float
    verdict: Verdict
    scores: Mapping[str, Scores]
    j_rms: float
    biases: Mapping[str, float]
    growth_1_s: float
    low_pass_rad_s: float | None = None
    moved: tuple[str, ...]
    ahead: tuple[Ahead, ...] = ()
    holds_s: Mapping[str, float] = field(default_factory=dict)
    closed_loop: ClosedLoopScores | None = None
    trim: Trim | None = None
    flight: FlightScores | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class SweepCheck:
    """Cost of the model against each response of sweeps that were not fitted."""

    records: tuple[str, ...]
    pairs: Mapping[str, PairCost]


@dataclass(frozen=True, kw_only=True, slots=True)
class Derived:
    """A quantity that follows from the parameters."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, kw_only=True, slots=True)
class ExcitedFlight:
    """How far the motors explain the motion of a stretch: a correlation, the axes that counted, and where they do.

    ``band_hz`` is the band of each axis: up to 5 Hz, or the octaves in which the motors explain an agile flight.
    """

    record: str
    start_s: float
    stop_s: float
    sample_rate_hz: float
    correlation: Mapping[str, float]
    counted: tuple[str, ...]
    band_hz: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, slots=True)
class InertiaEstimate:
    """An inertia by acceleration on torque and by torque on acceleration: plain, and without the bias of noise."""

    axis: str
    parameter: str
    unit: str
    plain: tuple[float, float]
    corrected: tuple[float, float]
    std: tuple[float, float]
    agrees: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class ControllerSettings:
    """The controller that flew, by the names and values of its firmware.

    Parameters
    ----------
    autopilot
        As the log has it.
    firmware
        The one whose controller flew, which may be another one than the log names.
    loop_rate_hz
        Steps per second; ``None`` where the log does not say.
    gains, filters
        Parameters of the rate and angle loops, and of the filters in them.
    settings
        All parameters on which the loops depend, those of the gyro's filters included, by the names in the log; empty
        in results that do not hold them.
    throttle
        Usual share of the throttle, by which Betaflight moves them; ``None`` for others.
    """

    autopilot: str
    firmware: str
    loop_rate_hz: float | None
    gains: dict[str, float]
    filters: dict[str, float]
    settings: dict[str, float] = field(default_factory=dict)
    throttle: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Straightening:
    """How the autopilot that flew makes outputs of demands of thrust, by its own parameters.

    ``expo`` is the curve that it takes out, ``low`` and ``high`` are the outputs of no and of full thrust.
    ``hover_share`` is the share of full thrust that the logged outputs ask of a motor by that curve, in the mean over
    the flights.
    """

    expo: float
    low: float
    high: float
    hover_share: float


@dataclass(frozen=True, kw_only=True, slots=True)
class LogThrust:
    """Thrust over mass of one log over that of the fit: alike unless payload, rotors or battery changed."""

    record: str
    ratio: float
    std: float


@dataclass(frozen=True, kw_only=True, slots=True)
class VoltageExponent:
    """The power by which thrust follows the voltage of the battery, from within each log."""

    exponent: float
    std: float
    reference_v: float
    lowest_v: float
    highest_v: float


@dataclass(frozen=True, kw_only=True, slots=True)
class MotorPhysics:
    """Motors, rotors and thrust of a fit of ``physical.motors`` or ``physical.flight``.

    ``outputs`` says what the motors are known by (``output``, ``thrust_demand`` or ``speed``), ``source`` where from.
    ``rotors`` are positions forward, right and down, in meters where ``arm_m`` is known and else in units of the arm,
    with the direction of their torque (+1 turns the nose right). ``derived`` holds thrust of a rotor at the mean output
    of the flights (``thrust_hover``), its slope there, thrust at full output and that over weight; ``flown_outputs`` is
    the range of the outputs but for one percent at each end, beyond which thrust is extrapolated. ``scale`` names what
    fixed the scale of mass, thrust and inertia, or is ``null``: then all three are per kilogram. ``straightening`` is
    what the autopilot does with demands, where its log says so. ``logs`` has thrust over mass of each log where there
    are several, and ``voltage`` the power by which thrust follows the battery, where it sagged enough.
    ``load_factor`` is the measured mean specific force over gravity: one in hover, 1.16 in a circle of 30° of bank.
    Of ``physical.flight``, ``hover_output`` is the output of hover, which that model computes, and the factor is one.
    """

    layout: str
    arm_m: float | None
    rotors: tuple[tuple[float, ...], ...]
    spins: tuple[float, ...]
    outputs: str
    source: str
    outputs_rate_hz: float
    curve: str
    curve_assumed: bool = False
    reference_v: float | None = None
    hover_output: float
    flown_outputs: tuple[float, float]
    scale: str | None
    straightening: Straightening | None = None
    derived: Mapping[str, Derived] = field(default_factory=dict)
    both_ways: tuple[InertiaEstimate, ...] = ()
    excitation: tuple[ExcitedFlight, ...] = ()
    logs: tuple[LogThrust, ...] = ()
    voltage: VoltageExponent | None = None
    load_factor: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class HoverRotors:
    """Rotors of a fit of ``physical.hover``.

    ``rotors`` are positions forward, right and down in units of the arm, with the direction of their torque (+1 turns
    the nose right); ``mixer`` is what commands of roll, pitch, yaw and thrust add to the output of each, and
    ``hover_output`` the mean output of the fitted flights, or ``null`` where the log has none.
    """

    layout: str
    rotors: tuple[tuple[float, ...], ...]
    spins: tuple[float, ...]
    mixer: tuple[tuple[float, ...], ...]
    hover_output: float | None = None


VelocityClass: TypeAlias = Literal["measured", "attitude", "none"]


@dataclass(frozen=True, kw_only=True, slots=True)
class LadderStep:
    """Terms of ``physical.flight`` that were tried together: error of force on unseen data without and with them, N.

    ``why`` says why they were left out; empty where they entered.
    """

    terms: tuple[str, ...]
    before_n: float
    after_n: float
    entered: bool
    why: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class MotorOctave:
    """How far the motors explain an axis in an octave, and whether the torque of the vehicle was fitted there."""

    axis: str
    low_hz: float
    high_hz: float
    correlation: float
    fitted: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class FlightOfLog:
    """What a stretch says of its air and clocks, and how well it was fitted.

    ``wind_m_s`` blows toward north and east; ``null`` where none could be found. ``skew_s`` is by how much the stamps
    of the motors are earlier than those of the gyro. Errors are root mean squares, of force along x, y, z and of the
    length of the vector, of moment of the length.
    """

    record: str
    start_s: float
    stop_s: float
    sample_rate_hz: float
    wind_m_s: tuple[float, float] | None = None
    wind_std_m_s: tuple[float, float] | None = None
    skew_s: float = 0.0
    force_rms_n: float
    force_axes_n: tuple[float, float, float]
    moment_rms_nm: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class FlightLimits:
    """Range of the fitted flights but for half a percent at each end; beyond it the model extrapolates.

    ``edge_m_s`` is the airspeed along the discs, ``climb_m_s`` along the rotors' axis, ``load`` the specific force
    along it over gravity, ``motors`` the speed of the rotors in rad/s, or as a share of the full one.
    """

    edge_m_s: tuple[float, float]
    climb_m_s: tuple[float, float]
    load: tuple[float, float]
    motors: tuple[float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class DragPoint:
    """Mean force against the airspeed along the discs, measured and modeled, N, in a bin of that airspeed."""

    airspeed_m_s: float
    measured_n: float
    modeled_n: float
    seconds: float


@dataclass(frozen=True, kw_only=True, slots=True)
class FlightPhysics:
    """The air of a fit of ``physical.flight``; rotors and motors are in ``motors``.

    ``velocity`` says how the velocity over ground was had: ``measured``, from the ``attitude`` and the accelerometer,
    or not at all; ``velocity_source`` where it was logged. ``disc_m2`` is the area of a rotor, which nobody gave where
    ``disc_assumed``. ``ladder`` has the terms that were tried and ``missing`` those that these flights cannot show,
    with the reason. ``octaves`` says where the motors explain an axis. ``hover`` has what does not trade as
    coefficients do: thrust of a rotor by its speed squared, its slope there, the induced velocity and the speed in
    hover, and the drag of all rotors over mass. ``scatter`` says whether the spread between flights was measured
    (``flights``) or ``assumed``; ``null`` where errors have none. ``predictor`` has numbers that predict this closed
    loop best: they are no properties of the vehicle.
    """

    velocity: VelocityClass
    velocity_source: str = ""
    disc_m2: float
    disc_assumed: bool
    density_kg_m3: float
    cutoff_hz: float | None = None
    ladder: tuple[LadderStep, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    octaves: tuple[MotorOctave, ...] = ()
    logs: tuple[FlightOfLog, ...]
    limits: FlightLimits
    hover: Mapping[str, Derived]
    drag: tuple[DragPoint, ...] = ()
    scatter: Literal["flights", "assumed"] | None = None
    predictor: Mapping[str, float] = field(default_factory=dict)


def airframe_of(motors: MotorPhysics, flight: FlightPhysics, mass_kg: float) -> Airframe:
    """The vehicle of a result of ``physical.flight``, for the equations of :mod:`rotorid.models.flight`.

    Parameters
    ----------
    motors, flight
        Of the result.
    mass_kg
        Its ``m``; one where all numbers are per kilogram.
    """
    return Airframe(
        positions=np.array(motors.rotors, dtype=np.float64),
        spins=np.array(motors.spins, dtype=np.float64),
        mass_kg=mass_kg,
        disc_m2=flight.disc_m2,
        density_kg_m3=flight.density_kg_m3,
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class FoldParameter:
    """A parameter as one fold has it."""

    value: float
    std: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class FoldSummary:
    """One identification: its records, and its scores by record and output, fitted records included.

    ``mean_percent`` and ``spread_percent``, a standard deviation over records, are those of unseen records only.
    """

    identified: tuple[str, ...]
    unseen: tuple[str, ...]
    scores: Mapping[str, Mapping[str, SignalScore]]
    mean_percent: float | None = None
    spread_percent: float | None = None
    parameters: Mapping[str, FoldParameter] = field(default_factory=dict)
    cause: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class BestFold:
    """The best record to identify on; optimistic, because the same scores chose it."""

    record: str
    mean_percent: float
    spread_percent: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class CrossValidationSummary:
    """A cross-validation: ``each`` record alone or ``leave_one_out``, scored on records that were not identified on.

    ``mean_percent`` is over all unseen scores, ``spread_percent`` their standard deviation. ``horizon_s`` is ``null``
    where records were simulated whole; else the models are unstable and were predicted so far ahead, again and again.
    ``band_rad_s`` is what was looked at, ``null`` for everything.
    """

    kind: Kind
    records: tuple[str, ...]
    outputs: tuple[str, ...]
    horizon_s: float | None = None
    band_rad_s: tuple[float, float] | None = None
    folds: tuple[FoldSummary, ...]
    mean_percent: float | None = None
    spread_percent: float | None = None
    best: BestFold | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class ParameterEstimate:
    """One parameter with its uncertainty.

    ``std`` is one standard deviation of random and model errors together, ``std_random`` and ``std_model`` are its
    parts, ``lower`` and ``upper`` the interval of 95 % from ``std``. Percents are CIFER's.
    """

    value: float
    unit: str
    std: float | None = None
    std_random: float | None = None
    std_model: float | None = None
    lower: float | None = None
    upper: float | None = None
    cramer_rao_percent: float | None = None
    insensitivity_percent: float | None = None
    status: Status


@dataclass(frozen=True, kw_only=True, slots=True)
class PoleEstimate:
    """An eigenvalue of the model; standard deviations are ``None`` where none was stated."""

    real: float
    imag: float
    damping: float
    frequency_rad_s: float
    real_std: float | None = None
    imag_std: float | None = None
    damping_std: float | None = None
    frequency_std_rad_s: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Cost:
    """Frequency-domain cost: the average, and each response on its own."""

    average: float
    pairs: Mapping[str, PairCost]


@dataclass(frozen=True, kw_only=True, slots=True)
class Checks:
    """Scores per unseen record and output, and costs of responses on unseen sweeps.

    ``records`` and ``frequency`` are the short form; ``maneuvers`` and ``sweeps`` say everything.
    """

    records: Mapping[str, Mapping[str, Scores]] = field(default_factory=dict)
    frequency: Mapping[str, float] = field(default_factory=dict)
    maneuvers: tuple[ManeuverCheck, ...] = ()
    sweeps: tuple[SweepCheck, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class UnseenCombination:
    """Parameters that the data cannot separate, in words and as a vector over parameter names."""

    words: str
    vector: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class ReductionStep:
    """One step of the reduction: a parameter, the decision and its reason."""

    parameter: str
    action: Literal["dropped", "kept", "protected"]
    reason: str
    value_before: float
    insensitivity_percent: float | None
    cramer_rao_percent: float | None
    mean_cost_before: float
    mean_cost_after: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class Correlation:
    """Correlation of the free parameters, in the order of the names."""

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class KnownQuantity:
    """A given quantity, with one standard deviation."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, kw_only=True, slots=True)
class DerivedQuantity:
    """A quantity that follows from parameters and known ones; ``std_identified`` is the part of the parameters."""

    value: float
    std: float
    std_identified: float
    unit: str
    words: str


@dataclass(frozen=True, kw_only=True, slots=True)
class ThrustPoint:
    """Thrust coefficient at an advance ratio, its standard deviation and interval of 95 %; was it flown, if known."""

    advance_ratio: float
    c_T: float
    std: float
    lower: float
    upper: float
    flown: bool | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class DerivedSummary:
    """Results that follow from the parameters and from given quantities.

    ``correlation`` is that of ``quantities``; ``missing`` names what else must be known for a quantity of which the
    model has the derivatives. ``thrust`` is the thrust coefficient over the advance ratio, where its slope is there.
    """

    known: Mapping[str, KnownQuantity] = field(default_factory=dict)
    quantities: Mapping[str, DerivedQuantity] = field(default_factory=dict)
    correlation: Correlation | None = None
    missing: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    thrust: tuple[ThrustPoint, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class FitEnd:
    """How the fit went.

    ``weights`` says what was minimized last: CIFER's cost, errors weighed by their measured covariance, or in time the
    errors of the outputs, or of the equations, by the covariance that they have (``likelihood``). ``trace`` is CIFER's
    cost, summed over the responses, or the sum of squares in time, after each accepted step. ``inflation`` is the
    factor on standard deviations, in the geometric mean, of all errors over random ones, or in time of residuals that
    are not white. ``model_error`` is what the structure misses in each response over frequency, relative.
    """

    weights: FitWeights
    outcome: str
    evaluations: int
    trace: tuple[float, ...]
    inflation: float
    model_error: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordFit:
    """A stretch of a record that was fitted in time: share of each output's motion that the model explains.

    ``parameters`` is what a fit to this stretch alone says, where several were fitted together, and ``missing`` why it
    says nothing of a parameter.
    """

    record: str
    start_s: float
    stop_s: float
    samples: int
    sample_rate_hz: float
    pieces: int = 1
    fit_percent: Mapping[str, float]
    parameters: Mapping[str, Derived] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, slots=True)
class Compared:
    """A parameter as the fit in the frequency domain has it.

    ``hold_s`` is the part of a delay that the response contains and a simulation with held inputs has apart.
    """

    value: float
    std: float | None = None
    hold_s: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Minimum:
    """Another local minimum of a search: its sum of squares, outputs weighed by size, and its parameters."""

    cost: float
    parameters: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class SearchMinimum:
    """A minimum of a search: its cost, its parameters, and the share of the local searches that ended there."""

    cost: float
    share: float
    parameters: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSpread:
    """A number over the runs of a search from different seeds: mean, standard deviation, least and largest."""

    mean: float
    std: float
    min: float
    max: float


@dataclass(frozen=True, kw_only=True, slots=True)
class RunTable:
    """End points of the runs: costs and parameters, and the results of each run (``draws``, ``costs``)."""

    cost: RunSpread
    parameters: Mapping[str, RunSpread]
    costs: tuple[float, ...]
    draws: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, kw_only=True, slots=True)
class SearchRuns:
    """The same search of the same data from other seeds: ``alone`` before any local search, ``polished`` after it.

    On one set of data this is the scatter of the search, and says nothing of the errors of the parameters. ``left_out``
    says why runs do not count, and how many.
    """

    runs: int
    seed: int
    left_out: Mapping[str, int]
    alone: RunTable
    polished: RunTable


@dataclass(frozen=True, kw_only=True, slots=True)
class Cluster:
    """A candidate of ``kmeans`` at one iteration: its cost over all points, its parameters, how many points it owns."""

    cost: float | None
    points: int
    parameters: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class ClusterIteration:
    """Candidates after so many evaluations, and the number of the one that owns each point of the data, from zero."""

    evaluations: int
    clusters: tuple[Cluster, ...]
    owners: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class SharedPoint:
    """A point of a measured response that the candidates share."""

    response: str
    omega_rad_s: float


@dataclass(frozen=True, kw_only=True, slots=True)
class SearchSummary:
    """A global search before the fit.

    ``name`` is the search with its options, ``objective`` what it minimized: CIFER's cost, summed over the responses,
    the squared output errors, weighed by the size of the outputs, or absolute errors of accelerations. ``alone`` is
    where the search itself ended, before any local search; ``runs`` the same from other seeds, where asked for.
    ``evaluations`` of the cost are its own, ``polishing`` those of its ``local_searches``. ``minima`` begin with the
    one that the fit went on from, then lowest first. ``trace`` is the lowest cost so far after so many evaluations. Of
    ``kmeans`` alone, ``iterations`` say how its first candidates shared the points of the data, and ``points`` which
    these are where they are those of responses.
    """

    name: str
    objective: Objective
    evaluations: int
    polishing: int
    local_searches: int
    minima: tuple[SearchMinimum, ...]
    trace: tuple[tuple[int, float], ...]
    alone: Minimum | None = None
    runs: SearchRuns | None = None
    iterations: tuple[ClusterIteration, ...] = ()
    points: tuple[SharedPoint, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Spread:
    """A parameter over the runs of a bootstrap; ``low``, ``median`` and ``high`` are percentiles 2.5, 50 and 97.5."""

    mean: float
    std: float
    relative_percent: float | None
    low: float
    median: float
    high: float


@dataclass(frozen=True, kw_only=True, slots=True)
class BootstrapSummary:
    """Refits to simulated noise: errors of the ``responses``, or noise of the ``outputs``.

    ``left_out`` says why runs do not count, and how many. ``correlation`` is that of the runs.
    """

    source: Literal["responses", "outputs"]
    runs: int
    seed: int
    left_out: Mapping[str, int]
    parameters: Mapping[str, Spread]
    correlation: Correlation


@dataclass(frozen=True, kw_only=True, slots=True)
class NoisyChannel:
    """A channel with artificial noise: its rms about the mean over the maneuvers, and the noise that was added."""

    rms: float
    noise_std: float
    unit: str


@dataclass(frozen=True, kw_only=True, slots=True)
class FailedRun:
    """A run that gave no model: its number, from one, and why."""

    run: int
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class NoiseSpread:
    """A parameter over runs with artificial noise, next to its value and stated errors without it.

    ``bias`` is the mean less ``value``, ``bias_std`` its standard deviation by chance. ``stated_std_in_runs`` is the
    rms of the random standard deviations that the runs state themselves.
    """

    value: float
    unit: str
    stated_std: float | None
    stated_std_random: float | None
    mean: float
    std: float
    bias: float
    bias_std: float
    min: float
    max: float
    runs: int
    stated_std_in_runs: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class NoiseRuns:
    """Identifications with artificial noise of ``percent`` of the rms of each sensor.

    ``runs`` of the ``asked`` ones gave a model; ``numbers`` are theirs, in the order of ``draws``. ``alone`` is what a
    search gave before any local search, ``cost`` CIFER's average cost and ``fit_percent`` that of the outputs.
    """

    percent: float
    runs: int
    asked: int
    seed: int
    stopped: bool
    failed: tuple[FailedRun, ...]
    channels: Mapping[str, NoisyChannel]
    parameters: Mapping[str, NoiseSpread]
    alone: Mapping[str, RunSpread] = field(default_factory=dict)
    cost: RunSpread | None = None
    fit_percent: Mapping[str, RunSpread] = field(default_factory=dict)
    numbers: tuple[int, ...] = ()
    draws: Mapping[str, tuple[float | None, ...]] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """How many runs there were with how much noise."""
        missing = f" of {self.asked}" if self.runs < self.asked else ""
        return f"{self.runs}{missing} runs with noise of {self.percent:g} % of the rms of each sensor"


@dataclass(frozen=True, kw_only=True, slots=True)
class EquationFit:
    """Fit of an equation of motion: ``q'`` for the derivative of a state, an output by its name.

    ``r_squared`` is the share of its left side that is explained, ``misfit`` the rms of its residual over that of its
    left side, ``press`` the squared error of predicting each of its rows by all others.
    """

    name: str
    r_squared: float
    press: float
    misfit: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Information:
    """Information criteria; ``numbers`` counts parameters, initial states, trims and the noise covariance."""

    aic: float
    bic: float
    numbers: int


@dataclass(frozen=True, kw_only=True, slots=True)
class OrderRow:
    """A black box of one order: ``unseen_percent`` is its mean score on unseen records.

    ``unseen_std`` is the standard error of that mean, ``behind_percent`` how far it lies behind the best order and
    ``behind_std`` the standard error of this difference, record by record. ``color`` is the largest autocorrelation of
    its residuals up to 20 samples. Numbers are ``null`` where there is no such model, and ``refused`` says why.
    """

    order: int
    parameters: int
    fitted_percent: float | None
    unseen_percent: float | None
    unseen_std: float | None
    behind_percent: float | None
    behind_std: float | None
    aic: float | None
    bic: float | None
    color: float | None
    refused: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class OrderChoice:
    """How the order of a black box was chosen: the smallest one within one standard error of the ``best``.

    ``held_out`` names what was left out in its turn. White residuals would have a ``color`` within ``chance``.
    """

    order: int
    best: int
    rows: tuple[OrderRow, ...]
    held_out: tuple[str, ...]
    chance: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Residuals:
    """Residuals of a fit in time.

    ``memory`` is the order of the autoregression that describes their color, ``inflation`` the factor that it puts on
    standard deviations. ``autocorrelation`` of each output is at lags of ``step_s``, from zero on; that of white
    residuals would stay within ``chance``, two standard deviations.
    """

    memory: int
    inflation: float
    step_s: float
    chance: float
    autocorrelation: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, kw_only=True, slots=True)
class RemovedFilters:
    """Filters that were taken out of an output, and their delay at low frequency."""

    filters: tuple[str, ...]
    delay_s: float

    @property
    def words(self) -> str:
        """For a person."""
        return f"{', '.join(self.filters)} ({1e3 * self.delay_s:.2f} ms)"


@dataclass(frozen=True, kw_only=True, slots=True)
class DelayBudget:
    """Delays on the way from an input to an output, in seconds: a motor lag counts as a delay of its time constant."""

    input_delay_s: float
    motor_lag_s: float
    output_delay_s: float
    total_s: float
    total_std_s: float | None
    known_filters_s: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Fit:
    """How a model was fitted, and how well it follows the data it was fitted to.

    Parameters
    ----------
    method
        What was minimized: errors of responses, or in time of outputs, predictions or equations.
    end
        How the solver ended.
    cost
        CIFER's cost, where responses were fitted.
    fit_percent
        Output to the share of its motion that the model explains, of a fit in time.
    hold
        What the inputs do between their samples, of a fit in time.
    pieces_s
        Length of the pieces into which records were cut, ``None`` for whole records.
    records
        The fit of each record on its own.
    noise
        Output to the standard deviation of its errors, in its unit.
    log_likelihood, information, residuals
        Of a fit in time: of the residuals, were they white and Gaussian; criteria of Akaike and Schwarz; their color.
    minima
        Other minima than the one that counts, best first.
    equations
        How well each equation of motion holds, where those were fitted.
    frequency_fit
        Parameters as the frequency domain has them, beside a fit in time; ``None`` where there is none.
    reduction
        How the model was reduced, step by step.
    orders
        How the order of a black box was chosen, where it was.
    noise_runs
        Runs with artificial noise.
    """

    method: MethodName
    outputs: tuple[str, ...]
    end: FitEnd
    cost: Cost | None = None
    fit_percent: Mapping[str, float] | None = None
    hold: Literal["zero", "first"] | None = None
    pieces_s: float | None = None
    records: tuple[RecordFit, ...] = ()
    noise: Mapping[str, float] | None = None
    log_likelihood: float | None = None
    information: Information | None = None
    residuals: Residuals | None = None
    minima: tuple[Minimum, ...] = ()
    search: SearchSummary | None = None
    bootstrap: BootstrapSummary | None = None
    noise_runs: NoiseRuns | None = None
    equations: tuple[EquationFit, ...] = ()
    frequency_fit: Mapping[str, Compared] | None = None
    reduction: tuple[ReductionStep, ...] = ()
    orders: OrderChoice | None = None


def finite(value: float) -> float | None:
    """A number, or ``None`` where it is not finite.

    Examples
    --------
    >>> finite(2.0), finite(float("inf"))
    (2.0, None)
    """
    return float(value) if math.isfinite(value) else None
