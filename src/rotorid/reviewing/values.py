"""The values of a review: each part is made by a module of its own and shown by pages and documents.

A number that was not measured is absent, and an :class:`Unavailable` says why, and what would measure it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from rotorid.data.base import Immutable, ShownByDocument, read_only
from rotorid.data.findings import Finding
from rotorid.data.quantities import require_figures
from rotorid.data.quantity import Quantity
from rotorid.data.record import Intervals
from rotorid.data.response import FrequencyResponse
from rotorid.flights.motor_balance import BalanceChange
from rotorid.flights.oscillations import OscillationReview
from rotorid.flights.whole_flights import Instrument
from rotorid.loops.filter_choice import FilterProposal
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import RateController
from rotorid.reviewing.missing import Unavailable
from rotorid.signal.control import Control
from rotorid.tuning.judging import LoopVerdict
from rotorid.tuning.plant import UncertainPlant
from rotorid.typing import Axis, FloatArray
from rotorid.uncertainty.differences import Verdict
from rotorid.uncertainty.next_flight import NextFlight


@dataclass(frozen=True, kw_only=True, eq=False)
class StepCurve(Immutable):
    """Answer to a step of the set-point with a pointwise 95 % band, arrays of shape ``(t,)``."""

    time_s: FloatArray
    value: FloatArray
    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        names = ("time_s", "value", "lower", "upper")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1) for name in names})


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopReview(Immutable):
    """One closed loop as it was flown.

    Parameters
    ----------
    name
        State that the loop controls: ``p q r phi theta psi u v w``.
    reference, answer
        Channels of the set-point and of the state.
    instrument
        Instrument of the estimate.
    response
        Set-point to answer.
    step
        Its answer to a unit step; ``None`` where it was not measured.
    numbers
        Figures of ``loops`` in :data:`rotorid.data.quantities.QUANTITIES`; what was not measured is left out.
    band_rad_s
        Where the response is usable.
    by_size
        The same loop at small and large sticks or throttle, named, where the flight covers it.
    """

    name: str
    reference: str
    answer: str
    instrument: Instrument
    response: FrequencyResponse
    step: StepCurve | None
    numbers: Mapping[str, Quantity]
    band_rad_s: tuple[float, float]
    by_size: Mapping[str, LoopReview] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        require_figures("loops", self.numbers)
        self._set(numbers=self.numbers, by_size=self.by_size)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace(Immutable):
    """Set-point and answer over a part of a flight as they were logged, arrays of shape ``(t,)``."""

    time_s: FloatArray
    reference: FloatArray
    answer: FloatArray

    def __post_init__(self) -> None:
        names = ("time_s", "reference", "answer")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1) for name in names})


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackingReview(Immutable):
    """How a set-point was followed in this flight, whoever made it.

    Parameters
    ----------
    name
        State that follows: ``p q r phi theta psi``.
    reference, answer
        Channels of the set-point and of the state.
    rate_hz
        Of the slower one in the log.
    numbers
        Figures of ``tracking`` in :data:`rotorid.data.quantities.QUANTITIES`; what was not measured is left out.
    trace
        The liveliest part of the flight.
    """

    name: str
    reference: str
    answer: str
    rate_hz: float
    numbers: Mapping[str, Quantity]
    trace: Trace

    def __post_init__(self) -> None:
        require_figures("tracking", self.numbers)
        self._set(numbers=self.numbers)


@dataclass(frozen=True, kw_only=True, eq=False)
class MarginReview(Immutable):
    """The broken rate loop of an axis as it was flown.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    loop
        Plant as measured times controller as logged, broken at the command.
    controller
        The rate controller from gains and filters of the log.
    numbers
        Figures of ``margins`` in :data:`rotorid.data.quantities.QUANTITIES`; what was not measured is left out.
    by_model
        Names of the numbers that come from a model of the plant and were not measured.
    ends
        Names of states between which the controller moves in flight, to the numbers there; empty for one that stays.
    settings
        What the log says of the controller, by the firmware's own names.
    throttle
        Share of the throttle at which the controller was evaluated.
    explained
        Correlation of the logged command with what the gains make of set-point and rate; ``None`` where no set-point
        is logged.
    stick_idle
        Whether the stick of the axis barely moved, so that gusts alone show the loop.
    verdict
        That on the flown gains, as ``tune --judge`` gives it; ``None`` where there are not enough data.
    plant, source
        Likely plants, and where their rate stands in the log; ``None`` where a loop was read elsewhere.
    """

    axis: Axis
    loop: FrequencyResponse
    controller: RateController
    instrument: Instrument
    numbers: Mapping[str, Quantity]
    by_model: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    ends: Mapping[str, Mapping[str, Quantity]] = field(default_factory=dict)
    settings: AxisController | None = None
    throttle: float | None = None
    explained: float | None = None
    stick_idle: bool = False
    verdict: LoopVerdict | None = None
    plant: UncertainPlant | None = None
    source: str = ""

    def __post_init__(self) -> None:
        require_figures("margins", self.numbers)
        self._set(numbers=self.numbers, ends=self.ends)


@dataclass(frozen=True, kw_only=True)
class VehicleReview(Immutable):
    """What flew: names as the log has them, empty where it does not say."""

    autopilot: str
    firmware: str
    kind: str
    frame: str
    motors: int | None = None


@dataclass(frozen=True, kw_only=True)
class FlightSummary(Immutable):
    """The flight as a whole.

    Parameters
    ----------
    flights
        In the air, on the log's own clock.
    seen_in
        Channels that show that.
    battery
        Figures of ``battery`` in :data:`rotorid.data.quantities.QUANTITIES`.
    hover_throttle, thrust_to_weight
        Usual thrust, and full thrust by a model of the motors, by the largest acceleration, or by a thrust curve.
    wind
        Figures of ``wind``: by drag and tilt, else as the autopilot estimates it.
    drag
        Figures of ``drag``, by the tilt as instrument.
    yaw
        Figures of ``yaw``: drift and trim with a centered stick, and both over the battery's voltage.
    modes
        Share of the time in the air of each flight mode, by name.
    findings
        What the reader of these numbers should know.
    """

    flights: Intervals
    seen_in: str
    battery: Mapping[str, Quantity] = field(default_factory=dict)
    hover_throttle: Quantity | None = None
    thrust_to_weight: Quantity | None = None
    wind: Mapping[str, Quantity] = field(default_factory=dict)
    drag: Mapping[str, Quantity] = field(default_factory=dict)
    yaw: Mapping[str, Quantity] = field(default_factory=dict)
    modes: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        require_figures("battery", self.battery)
        require_figures("wind", self.wind)
        require_figures("drag", self.drag)
        require_figures("yaw", self.yaw)
        self._set(battery=self.battery, wind=self.wind, drag=self.drag, yaw=self.yaw, modes=self.modes)


@dataclass(frozen=True, kw_only=True)
class LoggingReview(Immutable):
    """How it was logged: median rates by channel, gaps, and what to change (sentences that name settings).

    ``topics`` is the text of a PX4 ``logger_topics.txt`` that would log what is missing; empty where nothing is, or of
    another autopilot.
    """

    rates_hz: Mapping[str, float]
    longest_gap_s: float
    change: tuple[str, ...] = ()
    topics: str = ""

    def __post_init__(self) -> None:
        self._set(rates_hz=self.rates_hz)


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseMap(Immutable):
    """Spectral density of one channel against throttle or motor speed.

    Parameters
    ----------
    channel, stage
        What was measured, and ``before`` or ``after`` the filters.
    against
        ``throttle`` or the channel of motor speed.
    level
        Centers of the bins of ``against``, shape ``(b,)``.
    frequency_hz
        Shape ``(f,)``.
    density
        In the square of the channel's display unit per Hz ((deg/s)²/Hz, (m/s²)²/Hz), shape ``(b, f)``; not a number
        where the flight was not.
    windows
        Number of windows in each bin, shape ``(b,)``.
    average
        Over the whole flight, shape ``(f,)``.
    """

    channel: str
    stage: Literal["before", "after"]
    against: str
    level: FloatArray
    frequency_hz: FloatArray
    density: FloatArray
    windows: FloatArray
    average: FloatArray
    unit: str

    def __post_init__(self) -> None:
        self._set(
            level=read_only(self.level, np.float64, ndim=1),
            frequency_hz=read_only(self.frequency_hz, np.float64, ndim=1),
            density=read_only(self.density, np.float64, ndim=2),
            windows=read_only(self.windows, np.float64, ndim=1),
            average=read_only(self.average, np.float64, ndim=1),
        )


@dataclass(frozen=True, kw_only=True)
class NoisePeak(Immutable):
    """A peak of a noise spectrum: where, how strong over its surroundings, and what makes it.

    ``source`` is ``rotor`` (with ``harmonic`` where speeds are logged), ``frame`` or ``unknown``.
    """

    channel: str
    frequency_hz: Quantity
    height_db: float
    source: Literal["rotor", "frame", "unknown"]
    harmonic: int | None = None
    sentence: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseReview(Immutable):
    """Noise of the sensors and what of it reaches the motors.

    ``numbers`` are figures of ``noise`` in :data:`rotorid.data.quantities.QUANTITIES`, without those that were not
    measured.
    """

    maps: tuple[NoiseMap, ...] = ()
    peaks: tuple[NoisePeak, ...] = ()
    numbers: Mapping[str, Quantity] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        require_figures("noise", self.numbers)
        self._set(numbers=self.numbers)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorReview(Immutable):
    """Motors: limits, balance, headroom.

    ``numbers`` are figures of ``motors`` in :data:`rotorid.data.quantities.QUANTITIES`.
    ``means`` are the mean outputs in steady flight by motor; ``pattern`` is ``one side``, ``diagonal``, ``one motor``
    or empty, ``events`` start times of desync-like events, ``steps_checked`` whether these were sought.
    ``patterns`` are those of :func:`rotorid.flights.motor_balance.patterns_of`, ``None`` where the layout is not known.
    """

    means: Mapping[str, Quantity] = field(default_factory=dict)
    numbers: Mapping[str, Quantity] = field(default_factory=dict)
    pattern: str = ""
    events: tuple[float, ...] = ()
    steps_checked: bool = False
    findings: tuple[Finding, ...] = ()
    patterns: FloatArray | None = None

    def __post_init__(self) -> None:
        require_figures("motors", self.numbers)
        self._set(numbers=self.numbers, means=self.means)


@dataclass(frozen=True, kw_only=True)
class LeftOut(Immutable):
    """A log of a folder of earlier flights that was not used, and why."""

    log: str
    why: str


@dataclass(frozen=True, kw_only=True, eq=False)
class BaselineReview(Immutable):
    """The health of a flight beside earlier flights of the vehicle.

    Parameters
    ----------
    flights
        Names of the earlier logs, in their order.
    left_out
        Other logs of the folder.
    verdict
        ``changed`` where any figure did; ``unchanged`` where none did and one at least would have shown a change of a
        fifth; else ``undecided``.
    balance
        Of the motors; ``None`` where too few flights show it.
    figures
        Place in the review (``noise.vibration_m_s2``) to the comparison.
    sentences
        The answer, for terminal and page.
    """

    flights: tuple[str, ...]
    left_out: tuple[LeftOut, ...] = ()
    verdict: Verdict
    balance: BalanceChange | None = None
    figures: Mapping[str, NextFlight] = field(default_factory=dict)
    sentences: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(figures=self.figures)


@dataclass(frozen=True, kw_only=True, eq=False)
class Review(ShownByDocument, Immutable):
    """The results of one ordinary flight.

    ``models`` maps names of models to an ``IdentifiedModel`` or to an error that says why there is none; none was
    looked for where ``models_sought`` is false; ``unsupported`` names those that the log does not support, as
    ``inspect`` answers. ``oscillations`` are axes that swing by themselves, ``calm`` those that were checked and do
    not. ``control`` is a loss of control, a hard landing or an end in the air. ``baseline`` compares with earlier
    flights, where some were given. ``filters`` are those to fly, or that the flown ones stay; ``None`` where the log
    does not show which.
    """

    name: str
    sha256: str
    vehicle: VehicleReview
    flight: FlightSummary
    logging: LoggingReview
    loops: Mapping[str, LoopReview]
    margins: Mapping[Axis, MarginReview]
    models: Mapping[str, Any]
    noise: NoiseReview
    motors: MotorReview
    cannot_tell: tuple[Unavailable, ...]
    next_commands: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    models_sought: bool = True
    unsupported: tuple[str, ...] = ()
    oscillations: tuple[OscillationReview, ...] = ()
    calm: tuple[Axis, ...] = ()
    control: Control | None = None
    tracking: Mapping[str, TrackingReview] = field(default_factory=dict)
    baseline: BaselineReview | None = None
    filters: FilterProposal | None = None

    def __post_init__(self) -> None:
        self._set(tracking=self.tracking, loops=self.loops, margins=self.margins, models=self.models)
