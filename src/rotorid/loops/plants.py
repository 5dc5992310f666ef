r"""The plant of an axis, rate by command, from a flight, with draws of its uncertainty.

One response answers for every verb. It is measured with the best instrument that a log has: a test signal at the
mixer, another rich excitation, set-points of the rates that are the sticks, the stick, at last the set-point of the
rate, which gusts move a little through the outer loops. Rich excitations are cut out and measured as everywhere
(:mod:`rotorid.flights.measure`), and so are the parts in which the stick moves where they show the
crossover; everything else is read over the whole flight (:mod:`rotorid.flights.whole_flights`).

Inside the band a plant is its measurement. Beyond it goes on as a lag with a delay that explains the measurement, with
an error that grows with the distance (:mod:`rotorid.tuning.plant`). Of a flight whose lag explains too little nothing
is said beyond the band.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rotorid.autopilots.advice import move_stick
from rotorid.autopilots.filters import KnownFilter
from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.record import FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fits.frequency.inverse import without_inverse_controller
from rotorid.fitting.delay.estimate import AIRFRAME_ORDERS, FASTEST_GROWTH_RAD_S, LONGEST_S
from rotorid.fitting.delay.fit import (
    DelayedLag,
    Limits,
    Order,
    OrderFit,
    ResponseFit,
    ResponsePoints,
    fit_order,
    simplest,
)
from rotorid.fitting.inverse_controller import inverse_controller
from rotorid.fitting.problem import ResidualErrors
from rotorid.flights.controllers import LoggedController
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import is_injection
from rotorid.flights.measure import measure
from rotorid.flights.segments import source_of
from rotorid.flights.selection import by_stick, select_maneuvers
from rotorid.flights.whole_flights import LEAST_MOTION_S, FlightData, Instrument, loop_response
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import MeasureSettings
from rotorid.signal.autopilot_filters import known_filters
from rotorid.signal.excitations import find_excitations, rich_excitations
from rotorid.spectral.derived import LARGEST_ERROR, LEAST_COHERENCE, corrected, selected
from rotorid.spectral.loops import at_points
from rotorid.tuning.plant import DRAWS, FLOOR, MeasuredRatio, UncertainPlant, uncertain_plant
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray, IntArray

_FEWEST_POINTS = 8
"""Frequencies of a plant that have to be known, and be no controller."""


class PlantUnavailableError(InsufficientDataError):
    """A flight does not show the plant of an axis."""

    def __init__(self, why: str, remedy: str = "") -> None:
        super().__init__(why, remedy=remedy)
        self.why, self.remedy = why, remedy


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredPlant(Immutable):
    """The response of the rate of an axis to its command, as flights show it.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    response
        Rate by command, shape ``(1, 1, f)``, at the frequencies that can be used.
    instrument, channel
        What moved the axis free of feedback, and its channel.
    source
        Where the rate stands in the log.
    sample_rate_hz
        Of the data.
    filters
        Known filters in front of the rate.
    idle
        Whether the stick was idle but for short maneuvers.
    gusts
        Whether there were none of these either, so that gusts alone moved the axis.
    gain_error
        Relative error of the gain at all frequencies alike.
    bend_error
        Error of the logarithm of the response that all frequencies share, shape ``(f,)``; ``None`` for none.
    """

    axis: Axis
    response: FrequencyResponse
    instrument: Instrument
    channel: str
    source: str
    sample_rate_hz: float
    filters: tuple[KnownFilter, ...] = ()
    idle: bool = False
    gusts: bool = False
    gain_error: float = 0.0
    bend_error: ComplexArray | None = None

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """From the lowest to the highest frequency that can be used."""
        return float(self.response.omega_rad_s[0]), float(self.response.omega_rad_s[-1])


def swept_plant(
    axis: Axis, records: Sequence[FlightRecord], settings: MeasureSettings | None = None
) -> MeasuredPlant | None:
    """The plant as the rich excitations of an axis show it; ``None`` where none was flown, or none is free of feedback.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    records
        Logs of one vehicle.
    settings
        How it is measured.

    Raises
    ------
    InsufficientDataError
        The excitations show too little.
    """
    settings = settings or MeasureSettings()
    if not any(rich_excitations(record, axis) for record in records) and not settings.segments:
        return None
    flights = select_maneuvers(records, (axis,), IdentifySettings(segments=settings.segments)).fitted
    return _cut_out(axis, flights, settings)


def identified_plant(axis: Axis, records: Sequence[FlightRecord]) -> MeasuredPlant | None:
    """The plant as ``identify`` measures it: by rich excitations, else over the parts in which the stick moves.

    Parameters
    ----------
    axis, records
        As for :func:`swept_plant`.

    Raises
    ------
    InsufficientDataError
        These show too little.
    """
    if any(rich_excitations(record, axis) for record in records):
        return swept_plant(axis, records)
    parts = by_stick(records, (axis,))
    return _cut_out(axis, parts, MeasureSettings()) if parts else None


def _cut_out(axis: Axis, flights: Sequence[Flight], settings: MeasureSettings) -> MeasuredPlant | None:
    """The plant over maneuvers, ``None`` where nothing in them is free of feedback."""
    command, rate = f"{axis}_command", RATE_OF[axis]
    measured = measure(flights, inputs=(command,), outputs=(rate,), settings=replace(settings, correct_filters=False))
    response = measured.response
    if response.estimate != "joint":
        return None
    trusted = measured.trusted_points(response, settings.least_coherence(joint=True))
    used, _ = without_inverse_controller(measured, trusted, settings, flights)
    source = source_of(measured.segments[0], rate)
    channel = response.instruments[0]
    return MeasuredPlant(
        axis=axis,
        response=_used(response, used[0, 0], axis, channel),
        instrument="injection" if _enters_the_mixer(flights, channel) else "excitation",
        channel=channel,
        source=source,
        sample_rate_hz=measured.segments[0].history.sample_rate_hz,
        filters=known_filters(flights[0].record, source),
    )


def plant_of_result(axis: Axis, model: IdentifiedModel, *, filters: Sequence[KnownFilter] = ()) -> MeasuredPlant | None:
    """The plant measured for an identified model; ``None`` if its result has no such response.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    model
        Of a fit to responses.
    filters
        Those that the rate of the response has passed.
    """
    command, rate, data = f"{axis}_command", RATE_OF[axis], model.data
    response = data.response
    if not response.omega_rad_s.size or rate not in response.outputs or command not in response.inputs:
        return None
    y, u = response.outputs.index(rate), response.inputs.index(command)
    used = np.asarray(data.used[y, u], dtype=bool)
    if np.count_nonzero(used) < _FEWEST_POINTS:
        return None
    channel = response.instruments[u] if len(response.instruments) == len(response.inputs) else ""
    return MeasuredPlant(
        axis=axis,
        response=random_errors_at(selected(response, outputs=[rate], inputs=[command]), np.flatnonzero(used)),
        instrument="injection" if is_injection(channel) else "excitation",
        channel=channel,
        source=model.provenance.sources.get(rate, ""),
        sample_rate_hz=response.sample_rate_hz or _USUAL_HZ,
        filters=tuple(filters),
    )


_USUAL_HZ = 250.0
"""Of data whose rate a result does not hold."""


def _enters_the_mixer(flights: Sequence[Flight], channel: str) -> bool:
    return is_injection(channel) and all(enters_the_mixer(flight.record, channel) for flight in flights)


def enters_the_mixer(record: FlightRecord, excitation: str) -> bool:
    """Whether an excitation is a share of the command: one that enters as a rate or an angle has their unit."""
    rows = (topic.row(excitation) for topic in record.topics)
    return any(
        row is not None and topic.channels[row].unit == "1" for topic, row in zip(record.topics, rows, strict=True)
    )


def _used(response: FrequencyResponse, used: BoolArray, axis: Axis, channel: str) -> FrequencyResponse:
    rows = np.flatnonzero(used)
    if rows.size < _FEWEST_POINTS:
        raise PlantUnavailableError(
            f"{channel} explains the {axis} command at fewer than {_FEWEST_POINTS} frequencies.", move_stick(axis)
        )
    return random_errors_at(response, rows)


def random_errors_at(response: FrequencyResponse, rows: IntArray) -> FrequencyResponse:
    """The response at some frequencies with its random error only; the floor adds other errors of the plant."""
    plain = replace(response, slope_changes=None, lean_errors=None, unchecked_errors=None, sensor_shapes=None)
    return at_points(plain, rows)


# Whole flights.


@dataclass(frozen=True, kw_only=True)
class WholeFlight:
    """Command, rate and instrument of an axis on one clock over a flight.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    histories
        One for each stretch without a gap; they hold the set-point of the rate and a test signal where the log does.
    instrument, channel
        As in :class:`MeasuredPlant`.
    idle
        Whether the stick was idle.
    """

    axis: Axis
    histories: tuple[TimeHistory, ...]
    instrument: Instrument
    channel: str
    idle: bool = False

    @property
    def source(self) -> str:
        """Source of the rate in the longest stretch of the log."""
        longest = max(self.histories, key=lambda history: history.duration_s)
        return next((channel.source for channel in longest.channels if channel.name == RATE_OF[self.axis]), "")


_CROSSOVERS_RAD_S = (5.0, 60.0)
"""Where loops cross: instruments are compared by their coherence there."""


def whole_flight(flight: FlightData, axis: Axis) -> WholeFlight:
    """A flight with the best instrument of an axis, without rich excitations.

    The set-point of the rate drives command and rate alike and costs no coherence; it is taken in place of the stick
    while that moves, where it goes with the command more closely.

    Raises
    ------
    PlantUnavailableError
        Nothing separates the command from gusts.
    InsufficientDataError
        A channel was not logged for long enough.
    """
    rate, command = RATE_OF[axis], f"{axis}_command"
    choices = _instruments(flight, axis)
    names = flight.record.channel_names
    wanted = dict.fromkeys([*(channel for _, channel, _ in choices), f"{rate}_setpoint", f"{axis}_excitation"])
    logged = [name for name in wanted if name in names]
    histories = flight.histories((command, rate), sampled=logged, intervals=flight.during(choices[0][0]))
    kind, channel, idle = max(choices, key=lambda item: _coherence(histories, item[1], command))
    return WholeFlight(axis=axis, histories=histories, instrument=kind, channel=channel, idle=idle)


def _instruments(flight: FlightData, axis: Axis) -> list[tuple[Instrument, str, bool]]:
    """Kind, channel and whether it is idle, of what may show the plant of an axis; at least one."""
    kind, channel = flight.instrument(axis)
    setpoint, injected = f"{RATE_OF[axis]}_setpoint", f"{axis}_excitation"
    if flight.moving_s(injected) >= LEAST_MOTION_S:
        return [("injection", injected, False)]
    driven: list[tuple[Instrument, str, bool]] = []
    if setpoint in flight.record.channel_names and kind != "direct":
        driven = [("setpoint", setpoint, False)]
    moved_s = flight.moving_s(channel, flight.during(kind)) if channel else 0.0
    if moved_s >= LEAST_MOTION_S:
        return [(kind, channel, False), *driven]
    if driven:
        # Gusts move the set-point through the outer loops: little, and with the error that this deserves.
        return [("setpoint", setpoint, True)]
    why = f"moved for only {moved_s:.0f} s" if channel else "is not logged"
    raise PlantUnavailableError(f"The {axis} stick {why}, so command and gusts cannot be separated.", move_stick(axis))


def _coherence(histories: Sequence[TimeHistory], one: str, other: str) -> float:
    """Mean coherence of two channels where loops cross."""
    x, y, omega = (*(_spectra(histories, name) for name in (one, other)), _lines(histories))
    inside = (omega >= _CROSSOVERS_RAD_S[0]) & (omega <= _CROSSOVERS_RAD_S[1])
    power = np.mean(np.abs(x) ** 2, axis=0) * np.mean(np.abs(y) ** 2, axis=0)
    shared = np.abs(np.mean(x.conj() * y, axis=0)) ** 2
    ratio = np.divide(shared, power, out=np.zeros_like(shared), where=power > 0.0)
    return float(ratio[inside].mean()) if inside.any() else 0.0


_WINDOW_S = 4.0
"""Length of the windows by which instruments are compared."""


def _lines(histories: Sequence[TimeHistory]) -> FloatArray:
    return np.asarray(2.0 * np.pi * np.fft.rfftfreq(_samples(histories), 1.0 / histories[0].sample_rate_hz))


def _samples(histories: Sequence[TimeHistory]) -> int:
    longest = max(int(history.values.shape[1]) for history in histories)
    return min(int(_WINDOW_S * histories[0].sample_rate_hz), longest)


def _spectra(histories: Sequence[TimeHistory], name: str) -> ComplexArray:
    """Spectra of a channel in windows that overlap by half, shape ``(windows, lines)``."""
    count = _samples(histories)
    taper = np.hanning(count)
    found = []
    for history in histories:
        values = history[name]
        finite = np.asarray(np.isfinite(history.values).all(axis=0))
        for start in range(0, values.size - count + 1, max(count // 2, 1)):
            part = slice(start, start + count)
            if finite[part].all():
                found.append(np.fft.rfft(taper * (values[part] - values[part].mean())))
    if not found:
        raise InsufficientDataError(
            f"no {count / histories[0].sample_rate_hz:.3g} s of {name} without missing samples",
            needed="longer stretches of a flight",
            remedy="fly longer, or log without gaps",
        )
    return np.array(found, dtype=np.complex128)


def ordinary_plant(flight: FlightData, whole: WholeFlight, controllers: Sequence[LoggedController]) -> MeasuredPlant:
    """The plant as a whole flight shows it, without points that are the inverse of a controller.

    Parameters
    ----------
    whole
        Channels of the axis, and its instrument.
    controllers
        Those that may have flown.

    Raises
    ------
    PlantUnavailableError
        Too few frequencies are left.
    InsufficientDataError
        The flight is too short.
    """
    axis = whole.axis
    response = loop_response(
        flight,
        reference=f"{axis}_command",
        answer=RATE_OF[axis],
        instrument=whole.channel,
        histories=whole.histories,
    )
    rows = np.flatnonzero(
        (response.random_error[0, 0] <= LARGEST_ERROR) & (response.coherence[0, 0] >= LEAST_COHERENCE)
    )
    if rows.size < _FEWEST_POINTS:
        raise PlantUnavailableError(
            f"The stick explains the {axis} command at fewer than {_FEWEST_POINTS} frequencies.", move_stick(axis)
        )
    inverse = inverse_controller(
        response.omega_rad_s[rows],
        response.values[0, 0, rows],
        response.coherence[0, 0, rows],
        controllers=list(controllers),
        unknown_gains=False,
    ).inverse
    if np.count_nonzero(~inverse) < _FEWEST_POINTS:
        raise PlantUnavailableError(
            f"Between {axis} command and {RATE_OF[axis]} the flight shows the controller itself: gusts moved the "
            "vehicle, not the stick.",
            move_stick(axis),
        )
    return MeasuredPlant(
        axis=axis,
        response=at_points(response, _together(rows[~inverse])),
        instrument=whole.instrument,
        channel=whole.channel,
        source=whole.source,
        sample_rate_hz=whole.histories[0].sample_rate_hz,
        filters=known_filters(flight.record, whole.source),
        idle=whole.idle,
        gusts=whole.idle and not find_excitations(flight.record, axis),
    )


_WIDEST_HOLE = 3
"""Unknown frequencies in a row that a band may bridge."""


def _together(rows: IntArray) -> IntArray:
    """The longest stretch of rows with no more than two missing in between.

    Single points far above the rest pass for coherent by chance, and lie by far more off than they say.
    """
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > _WIDEST_HOLE) + 1)
    return max(runs, key=len)


# Draws.


def drawn_plant(measured: MeasuredPlant, *, draws: int = DRAWS, seed: int = 0) -> UncertainPlant:
    """The plant with draws of its uncertainty.

    Parameters
    ----------
    measured
        As flights show it.
    draws, seed
        How many plants are drawn, and the seed of the draws.

    Raises
    ------
    InsufficientDataError
        No lag with a delay can be fitted at all.
    """
    response = measured.response
    lag = _late_lag(response, measured.sample_rate_hz, measured.filters)
    omega, values = response.omega_rad_s, response.values[0, 0]
    ratio = MeasuredRatio(
        omega_rad_s=omega,
        ratio=values / lag.response(omega),
        covariance=response.covariance[0, 0] / np.outer(values, values.conj()),
    )
    floor = GUSTS_FLOOR if measured.gusts else FLOOR
    plant = uncertain_plant(lag.response, ratio, band_rad_s=measured.band_rad_s, draws=draws, seed=seed, floor=floor)
    misfits = plant.misfits
    if measured.gain_error:
        misfits = misfits + measured.gain_error * np.random.default_rng([seed, 1]).standard_normal((draws, 1))
    if measured.bend_error is not None:
        bent = np.interp(plant.knots, np.log(omega), measured.bend_error)
        misfits = misfits + bent * np.random.default_rng([seed, 2]).standard_normal((draws, 1))
    return replace(plant, misfits=misfits, goes_on=lag.explains and not measured.idle)


GUSTS_FLOOR = 0.1
"""Error of a plant estimated from gusts alone, which contains feedback. With the floor of other plants 58 % of the
crossovers and 67 % of the phase margins of 24 such flights were in their intervals, with this 90 and 95 %.
"""

LARGEST_CHI_SQUARE = 3.0
"""Largest misfit of a lag, per degree of freedom, that may extrapolate the plant."""

_WITHOUT_SPEED_RAD_S = 3.0
"""Below it the speed of a vehicle acts, which a lag lacks."""

_ORDERS = (*AIRFRAME_ORDERS, Order(0, 3))
"""Late lags that are fitted to the plant."""

_DELAYS_S = (0.0, 0.003, 0.006, 0.01, 0.015, 0.025, 0.04)
"""Where fits of an order may start."""

_TRIED = 2
"""Starts that are followed, the best ones of a linear fit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lag:
    """A lag with a delay behind known filters, and whether it explains the measurement.

    The filters between the motion and the logged rate are known: a lag that stood in for them would say that they let
    through beyond the band what they take away.
    """

    model: DelayedLag
    theta: FloatArray
    filters: tuple[KnownFilter, ...]
    explains: bool

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        omega = np.atleast_1d(omega_rad_s)
        values = self.model.response(self.theta, omega)[0]
        for known in self.filters:
            values = values * known.response(omega)
        return np.asarray(values)


def _late_lag(plant: FrequencyResponse, sample_rate_hz: float, filters: tuple[KnownFilter, ...]) -> _Lag:
    try:
        plant = corrected(plant, {plant.outputs[0]: filters}) if filters else plant
    except UsageError:
        # A filter left too little at the end of the band to be removed; a lag replaces it.
        filters = ()
    found = _fitted(plant, sample_rate_hz, filters)
    fast = np.flatnonzero(plant.omega_rad_s >= _WITHOUT_SPEED_RAD_S)
    if found.explains or not _FEWEST_POINTS <= fast.size < plant.omega_rad_s.size:
        return found
    return _fitted(at_points(plant, fast), sample_rate_hz, filters)


def _fitted(plant: FrequencyResponse, sample_rate_hz: float, filters: tuple[KnownFilter, ...]) -> _Lag:
    points = ResponsePoints.of(plant, np.ones(plant.values.shape, dtype=bool), (0, 0))
    points = replace(points, errors=_Errors(relative=points.errors.relative, scale=points.errors.scale))
    scale = float(np.sqrt(points.omega_rad_s[0] * points.omega_rad_s[-1]))
    lags = [
        DelayedLag(order=order, scale_rad_s=scale, hold="smooth", sample_s=1.0 / sample_rate_hz)
        for order in _ORDERS
        if 2 * points.omega_rad_s.size > order.coefficients + 1
    ]
    best = simplest([_fit(ResponseFit(data=points, model=lag)) for lag in lags])
    return _Lag(
        model=next(lag for lag in lags if lag.order == best.order),
        theta=best.solution.theta,
        filters=filters,
        explains=best.misfit**2 <= LARGEST_CHI_SQUARE,
    )


def _fit(problem: ResponseFit) -> OrderFit:
    """The best fit from the delays at which a linear one is best."""
    limits = Limits(delays_s=(0.0, LONGEST_S), fastest_rad_s=FASTEST_GROWTH_RAD_S)
    starts = sorted((problem.linear(delay_s, FASTEST_GROWTH_RAD_S) for delay_s in _DELAYS_S), key=lambda item: item[1])
    fits = [fit_order(problem, limits, start=start) for start, _ in starts[:_TRIED]]
    return min(fits, key=lambda fit: fit.criterion)


class _Errors(ResidualErrors):
    """Errors that whiten by one product: a fit whitens a thousand times."""

    @cached_property
    def _inverse(self) -> FloatArray:
        return self.whitening.whitened(np.eye(self.scale.size))

    def whitened(self, values: FloatArray) -> FloatArray:
        return np.asarray(self._inverse @ values)
