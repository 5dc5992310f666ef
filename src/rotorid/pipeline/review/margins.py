r"""Margins of the rate loops without a sweep: the plant as the flight shows it, times the controller of the log.

.. math:: L = \hat P C, \qquad \hat P = \frac{S_{z\omega}}{S_{zu}}

with command :math:`u`, rate :math:`\omega` and an instrument :math:`z` that gusts do not move: the stick, or the
set-point of the rate, which drives command and rate alike. The plain response of the rate to the command would be a
mixture of the plant and of :math:`-1/C`. The controller is that of the parameters in the log
(:mod:`rotorid.models.autopilots`), and it has to explain the logged command, or nothing is said.

What the band of the measurement shows is read off locally (:mod:`rotorid.spectral.margins`). A gain margin often lies
beyond it: then a lag with a delay, fitted to the plant, tells it, with an interval that is wider than the fit's own by
a factor that was found on flights with known truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import LOWEST_RATE_HZ, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.delay.estimate import AIRFRAME_ORDERS, FASTEST_GROWTH_RAD_S, LONGEST_S
from rotorid.fitting.delay.fit import (
    LateLag,
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
from rotorid.io.advice import logging_advice
from rotorid.models.autopilots.betaflight import TOP
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import RateController
from rotorid.pipeline.preparation.controller_check import (
    ControllerMatch,
    match_controller,
    window_frequencies,
    window_spectra,
)
from rotorid.pipeline.preparation.controllers import LoggedController, acting_on, logged_axis, usual_throttle
from rotorid.pipeline.review.flown import LEAST_MOTION_S, Flown, loop_response
from rotorid.pipeline.review.values import Instrument, MarginReview, Untold
from rotorid.signal.autopilot_filters import known_filters
from rotorid.signal.excitations import rich_excitations
from rotorid.signal.filters import KnownFilter
from rotorid.spectral.derived import LARGEST_ERROR, LEAST_COHERENCE, Estimated, LogCurve, corrected, log_curve
from rotorid.spectral.loops import at_points, sensitivity, series
from rotorid.spectral.margins import LoopMargins, disturbance_rejection, loop_margins
from rotorid.spectral.windows import trusted_to_rad_s
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

NUMBERS = (
    "crossover_rad_s",
    "phase_margin_deg",
    "delay_margin_s",
    "gain_margin_db",
    "sensitivity_peak",
    "disturbance_rejection_rad_s",
)
"""What is told of a broken loop, as far as the flight shows it."""

PEAK_WIDER, MODEL_WIDER = 1.5, 1.6
"""Factors of the intervals of what is read off the sensitivity, and of what a model tells: on flights with known truth
their own held it in 83 to 87 % and in 80 %."""

_FEWEST_POINTS = 8
"""Frequencies of the plant that have to be known, and be no controller, before margins are told."""

LARGEST_CHI_SQUARE = 3.0
"""For each degree of freedom; a model that misses the plant by more says nothing of what lies beyond."""

_MOVE = "Move the stick of this axis for 30 s: quick pairs to both sides of 5 to 10 degrees, one every second."
_FASTER = "Log commands and rates faster, and move the stick more quickly."


def margins(flight: Flown) -> tuple[dict[Axis, MarginReview], tuple[Untold, ...]]:
    """Margins of the rate loops of a flight, each with the error that it deserves.

    Parameters
    ----------
    flight
        A record with its flights.

    Returns
    -------
    dict of MarginReview
        By axis; an axis of which nothing can be told is absent.
    tuple of Untold
        What cannot be told, and why.
    """
    found: dict[Axis, MarginReview] = {}
    untold: list[Untold] = []
    for axis in RATE_OF:
        try:
            found[axis], missing = _margins(flight, axis)
            untold += missing
        except _CannotError as reason:
            untold.append(Untold(what=f"margins.{axis}", why=reason.why, remedy=reason.remedy))
        except InsufficientDataError as error:
            untold.append(Untold(what=f"margins.{axis}", why=_sentence(error), remedy=error.remedy or _MOVE))
    return found, tuple(untold)


class _CannotError(Exception):
    """The margins of an axis cannot be told."""

    def __init__(self, why: str, remedy: str) -> None:
        super().__init__(why)
        self.why, self.remedy = why, remedy


def _sentence(error: InsufficientDataError) -> str:
    text = str(error.came)
    return f"{text[:1].upper()}{text[1:]}." if text else str(error)


def _require_logged(flight: Flown, axis: Axis) -> None:
    """Refuse a log without command or rate of an axis, or with these too slow."""
    rate, command = RATE_OF[axis], f"{axis}_command"
    names = flight.record.channel_names
    missing = [name for name in (command, rate) if name not in names]
    if missing:
        raise _CannotError(
            f"The log holds no {' and no '.join(missing)}.", "Log the controllers' outputs and the body rates."
        )
    slowest_hz = min(flight.rate_hz(command), flight.rate_hz(rate))
    if slowest_hz < LOWEST_RATE_HZ:
        raise _CannotError(
            f"Command and rate of {axis} are logged at {slowest_hz:.0f} Hz; {LOWEST_RATE_HZ:.0f} Hz is the least.",
            logging_advice(flight.record, slowest_hz),
        )


def _logged_settings(flight: Flown, axis: Axis, *, source: str, throttle: float | None) -> AxisController:
    settings = logged_axis(flight.record, f"{axis}_command", source=source, throttle=throttle)
    if settings is None:
        raise _CannotError(
            f"The log holds no gains of the {axis} controller that are known.",
            "Log the parameters (PX4, ArduPilot), or use a Betaflight of 4.0 or later.",
        )
    return settings


def _margins(flight: Flown, axis: Axis) -> tuple[MarginReview, list[Untold]]:
    _require_logged(flight, axis)
    rate, command = RATE_OF[axis], f"{axis}_command"
    ways = _ways(flight, axis)
    histories = _histories(flight, axis, ways)
    throttle, source = usual_throttle(flight.record), _source(histories, rate)
    settings = _logged_settings(flight, axis, source=source, throttle=throttle)
    way = max(ways, key=lambda one: _coherence(histories, one.channel, command)) if len(ways) > 1 else ways[0]
    seen = match_controller(flight.record, axis, settings, histories, intervals=flight.during(way.kind))
    if seen is not None and not seen.made:
        raise _CannotError(*seen.refusal(axis))
    plant = _plant(flight, axis, way, histories)
    flown = _nearest(settings, seen)
    acting = {name: acting_on(flight.record, one.rate_loop, source=source) for name, one in flown.items()}
    plant = _without_trap(plant, list(acting.values()), axis)
    filters = known_filters(flight.record, source)
    model = None if way.rests else _late_lag(plant, histories[0].sample_rate_hz, filters)
    each = {name: _numbers(plant, controller, model, rests=way.rests) for name, controller in acting.items()}
    main, *_ = each
    told = each[main]
    moved = _as_flown(flown[main], seen)
    if moved is not None:
        told = _widened(told, _numbers(plant, acting_on(flight.record, moved.rate_loop, source=source), None))
    if not told.numbers:
        raise _CannotError(told.reasons["crossover_rad_s"], _FASTER)
    review = MarginReview(
        axis=axis,
        loop=told.loop,
        controller=flown[main],
        instrument=way.kind,
        numbers=told.numbers,
        by_model=told.by_model,
        findings=tuple(_remarks(flight, axis, settings, seen, main)),
        ends={name: one.numbers for name, one in each.items()} if len(each) > 1 else {},
        settings=settings,
        throttle=throttle,
        explained=seen.correlation if seen is not None else None,
    )
    untold = [
        Untold(what=f"margins.{axis}.{name}", why=told.reasons[name], remedy=_MOVE if way.rests else _FASTER)
        for name in NUMBERS
        if name not in told.numbers
    ]
    return review, untold


# What tells the plant.


class _Way(NamedTuple):
    """An instrument: of which kind, its channel, and whether the stick rested."""

    kind: Instrument
    channel: str
    rests: bool = False


_BAND_RAD_S = (5.0, 60.0)
"""Where loops cross: instruments are compared by their coherence there."""

_ATTITUDES = ("phi_setpoint", "theta_setpoint", "psi_setpoint")


def _ways(flight: Flown, axis: Axis) -> list[_Way]:
    """What may tell the plant of an axis, at least one."""
    kind, channel = flight.instrument(axis)
    setpoint = f"{RATE_OF[axis]}_setpoint"
    if flight.moving_s(f"{axis}_excitation") >= LEAST_MOTION_S:
        # A sweep that was added to the command after all: nothing tells the plant better.
        return [_Way("stick", f"{axis}_excitation")]
    driven = [_Way("setpoint", setpoint)] if setpoint in flight.record.channel_names else []
    moved_s = flight.moving_s(channel, flight.during(kind)) if channel else 0.0
    if moved_s >= LEAST_MOTION_S:
        return [_Way(kind, channel), *(way for way in driven if kind != "direct")]
    if swept := _swept_attitude(flight, axis):
        return [_Way("stick", swept)]
    if driven and kind != "direct":
        # Gusts move the set-point through the outer loops: little, and with the error that this deserves.
        return [driven[0]._replace(rests=True)]
    why = f"moved for {moved_s:.0f} s only" if channel else "is not logged"
    raise _CannotError(f"The {axis} stick {why}, and nothing else tells command and gusts apart.", _MOVE)


def _swept_attitude(flight: Flown, axis: Axis) -> str:
    """The set-point of the attitude, where a program excited it while the stick rested; empty where none did."""
    signals = {one.signal for one in rich_excitations(flight.record, axis)}
    swept = [name for name in _ATTITUDES if name in signals and flight.moving_s(name) >= LEAST_MOTION_S]
    return swept[0] if swept else ""


def _histories(flight: Flown, axis: Axis, ways: Sequence[_Way]) -> tuple[TimeHistory, ...]:
    """Command, rate and what else is needed on one clock."""
    rate, command = RATE_OF[axis], f"{axis}_command"
    names = flight.record.channel_names
    wanted = dict.fromkeys([*(way.channel for way in ways), f"{rate}_setpoint", f"{axis}_excitation"])
    held = [name for name in wanted if name in names]
    return flight.histories((command, rate), held=held, intervals=flight.during(ways[0].kind))


def _coherence(histories: Sequence[TimeHistory], one: str, other: str) -> float:
    """Mean coherence of two channels where loops cross."""
    x, y, omega = (*(window_spectra(histories, name) for name in (one, other)), window_frequencies(histories))
    inside = (omega >= _BAND_RAD_S[0]) & (omega <= _BAND_RAD_S[1])
    power = np.mean(np.abs(x) ** 2, axis=0) * np.mean(np.abs(y) ** 2, axis=0)
    shared = np.abs(np.mean(x.conj() * y, axis=0)) ** 2
    ratio = np.divide(shared, power, out=np.zeros_like(shared), where=power > 0.0)
    return float(ratio[inside].mean()) if inside.any() else 0.0


def _plant(flight: Flown, axis: Axis, way: _Way, histories: Sequence[TimeHistory]) -> FrequencyResponse:
    plant = loop_response(
        flight, reference=f"{axis}_command", answer=RATE_OF[axis], instrument=way.channel, histories=histories
    )
    bands = [m.band_rad_s for m in rich_excitations(flight.record, axis) if m.signal == way.channel and m.band_rad_s]
    if not way.channel.endswith("_excitation") or not bands:
        return plant
    # Beyond the end of a sweep leakage and feedback are coherent too.
    low, top = min(band[0] for band in bands), trusted_to_rad_s(max(band[1] for band in bands), plant.windows_s)
    inside = np.flatnonzero((plant.omega_rad_s >= low) & (plant.omega_rad_s <= top))
    return at_points(plant, inside) if inside.size else plant


def _without_trap(plant: FrequencyResponse, controllers: Sequence[LoggedController], axis: Axis) -> FrequencyResponse:
    """The plant without points that are the inverse of the controller."""
    used = (plant.random_error[0, 0] <= LARGEST_ERROR) & (plant.coherence[0, 0] >= LEAST_COHERENCE)
    rows = np.flatnonzero(used)
    if rows.size < _FEWEST_POINTS:
        raise _CannotError(
            f"The motion of the stick explains the {axis} command at fewer than {_FEWEST_POINTS} frequencies.", _MOVE
        )
    verdict = inverse_controller(
        plant.omega_rad_s[rows],
        plant.values[0, 0, rows],
        plant.coherence[0, 0, rows],
        controllers=controllers,
        unknown_gains=False,
    )
    if not verdict.inverse.any():
        return plant
    kept = np.setdiff1d(np.arange(plant.omega_rad_s.size), rows[verdict.inverse])
    if np.count_nonzero(~verdict.inverse) < _FEWEST_POINTS:
        raise _CannotError(
            f"What the flight shows between {axis} command and {RATE_OF[axis]} is the controller itself: gusts moved "
            "the vehicle, and the stick did not.",
            _MOVE,
        )
    return at_points(plant, kept)


def _nearest(settings: AxisController, seen: ControllerMatch | None) -> dict[str, RateController]:
    """The controllers at the ends between which it moves, that nearest to what flew first."""
    if not settings.ends:
        return {"": settings.controller}
    ends = dict(settings.ends)
    own = seen.terms.get("d") if seen is not None else None
    if own is None:
        return ends
    top = ends[TOP].derivative_s2
    order = sorted(ends, key=lambda name: abs(ends[name].derivative_s2 - own.slope * top))
    return {name: ends[name] for name in order}


def _as_flown(controller: RateController, seen: ControllerMatch | None) -> RateController | None:
    """The controller with the integral that the flight shows of it; ``None`` where it shows none."""
    if seen is None or "i" not in seen.terms or not controller.proportional_s:
        return None
    return replace(controller, integral=controller.integral * min(max(seen.terms["i"].slope, 0.0), 1.0))


# What the loop says.


class _Told(NamedTuple):
    """Numbers of a loop, which of them a model tells, and why others are not there."""

    loop: FrequencyResponse
    numbers: dict[str, Quantity]
    by_model: tuple[str, ...]
    reasons: dict[str, str]


_DB = 20.0 / math.log(10.0)

_MAY_BE_ONE = 0.5
"""Logarithm of a gain that is beyond all doubt another than one."""


def _numbers(
    plant: FrequencyResponse, controller: LoggedController, model: _Model | None, *, rests: bool = False
) -> _Told:
    loop = series(plant, controller.response(plant.omega_rad_s))
    found, rejection = loop_margins(loop), disturbance_rejection(sensitivity(loop))
    numbers: dict[str, Quantity] = {}
    if found.gain_crossovers:
        numbers |= _crossing(loop, found)
    if found.gain_margin_up is not None and not rests:
        gain = found.gain_margin_up
        numbers["gain_margin_db"] = Quantity.normal(_DB * math.log(gain.value), _DB * gain.std / gain.value, "dB")
    if rejection.peak is not None and not rests:
        peak = rejection.peak
        numbers["sensitivity_peak"] = Quantity.normal(peak.value, PEAK_WIDER * peak.std, "1")
    if rejection.bandwidth_rad_s is not None:
        wide = rejection.bandwidth_rad_s
        numbers["disturbance_rejection_rad_s"] = Quantity.normal(wide.value, PEAK_WIDER * wide.std, "rad/s")
    beyond = {} if model is None else model.numbers(controller)
    by_model = tuple(name for name in beyond if name not in numbers)
    numbers |= {name: beyond[name] for name in by_model}
    return _Told(loop, numbers, by_model, _reasons(loop, found, numbers, model, rests=rests))


def _crossing(loop: FrequencyResponse, found: LoopMargins) -> dict[str, Quantity]:
    r"""Crossover, phase and delay margin, with an interval over all frequencies at which the gain may be one.

    The delta method assumes that the gain falls through one. Where it lies along one, the crossover may be anywhere
    along it, and what can be said is the range of the margin there.
    """
    curve = log_curve(loop)
    last = found.gain_crossovers[-1]
    phase, delay = found.phase_margin_rad, found.delay_margin_s
    assert phase is not None
    assert delay is not None
    omega, margins, stds = _at_one(curve)
    crossover = _spanned(last.omega_rad_s, omega, np.zeros_like(omega), "rad/s")
    margin = _spanned(phase, margins, stds, "deg", scale=180.0 / math.pi)
    late = _spanned(delay, np.maximum(margins, 0.0) / np.maximum(omega, 1e-9), stds / np.maximum(omega, 1e-9), "s")
    return {"crossover_rad_s": crossover, "phase_margin_deg": margin, "delay_margin_s": late}


def _at_one(curve: LogCurve) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies at which the gain may be one, phase margin there and its standard deviation."""
    found = []
    for band in curve.bands:
        x, logarithms = curve.grid(band)
        close = np.abs(logarithms.real) < _MAY_BE_ONE
        if not close.any():
            continue
        _, rows = curve.near(x[close])
        weights = rows[:, 0]
        # Magnitude and phase of a relative error that is as likely in either have the same deviation.
        std = np.sqrt(np.maximum(0.5 * np.einsum("mi,ij,mj->m", weights, curve.covariance, weights).real, 0.0))
        phase = logarithms.imag[close] + math.pi
        margin = phase - 2.0 * math.pi * np.round(phase / (2.0 * math.pi))
        may = np.abs(logarithms.real[close]) <= TWO_SIDED_95 * std
        found.append(np.stack([np.exp(x[close]), margin, std])[:, may])
    omega, margin, std = np.concatenate(found, axis=1) if found else np.zeros((3, 0))
    return omega, margin, std


def _spanned(one: Estimated, values: FloatArray, stds: FloatArray, unit: str, *, scale: float = 1.0) -> Quantity:
    """An estimate whose interval holds others too."""
    low, high = one.interval
    if values.size:
        low = min(low, float((values - TWO_SIDED_95 * stds).min()))
        high = max(high, float((values + TWO_SIDED_95 * stds).max()))
    std = max(one.std, (high - low) / (2.0 * TWO_SIDED_95))
    return Quantity(value=scale * one.value, std=scale * std, lower=scale * low, upper=scale * high, unit=unit)


def _reasons(
    loop: FrequencyResponse, found: LoopMargins, numbers: Mapping[str, Quantity], model: _Model | None, *, rests: bool
) -> dict[str, str]:
    curve = log_curve(loop)
    seen = curve.seen if curve.bands else "no band"
    cannot = f"The loop is seen in {seen}"
    reasons = dict.fromkeys(
        ("crossover_rad_s", "phase_margin_deg", "delay_margin_s"), f"{cannot}, and its gain does not pass one there."
    )
    bound = found.bounds.get("gain_margin_up")
    least = f"; it is at least {_DB * math.log(bound.value):.1f} dB" if bound is not None else ""
    refused = " No model of the plant explains the flight well enough to go on from there." if model is None else ""
    reasons["gain_margin_db"] = f"{cannot}, and its phase does not pass −180° there{least}.{refused}"
    reasons["sensitivity_peak"] = f"{cannot}, and the sensitivity has no peak there.{refused}"
    reasons["disturbance_rejection_rad_s"] = f"{cannot}, and the sensitivity does not rise through −3 dB there."
    if rests:
        reasons["gain_margin_db"] = reasons["sensitivity_peak"] = "The stick rested: gusts alone do not show it."
    return {name: why for name, why in reasons.items() if name not in numbers}


def _widened(told: _Told, other: _Told) -> _Told:
    r"""Numbers whose intervals reach to those of a controller that flew for a part of the time.

    What lies between both is as likely everywhere, :math:`\sigma^2 = \Delta^2 / 3`.
    """
    numbers = {}
    for name, one in told.numbers.items():
        numbers[name] = one
        if name in other.numbers and name not in told.by_model:
            moved = other.numbers[name].value - one.value
            more = math.hypot(1.0, moved / math.sqrt(3.0) / one.std) if one.std > 0.0 else 1.0
            numbers[name] = replace(
                one,
                std=one.std * more,
                lower=one.value - more * (one.value - one.lower),
                upper=one.value + more * (one.upper - one.value),
            )
    return told._replace(numbers=numbers)


# What a model says beyond.

_ORDERS = (*AIRFRAME_ORDERS, Order(0, 3))
"""Late lags that are fitted to the plant."""

_WIDEST_HOLE = 3
"""Unknown frequencies in a row that the fitted band may bridge."""

_DELAYS_S = (0.0, 0.003, 0.006, 0.01, 0.015, 0.025, 0.04)
"""Where fits of an order may start."""

_TRIED = 2
"""Starts that are followed, the best ones of a linear fit."""

_DRAWS, _SEED = 200, 20
_GRID_POINTS = 500

_BEYOND_RATIO = 6.0
"""How far beyond the band a model is followed, over the end of the band."""

_MOST_OF_RATE = 0.45
"""And over the rate of the controller, which does nothing above half of it."""

_LEAST_SHARE = 0.9
"""Share of the draws that must have a number for it to be told."""

_NEAR = 1.5
"""A crossover, and what belongs to it, is told by a model up to so far beyond the band."""

_FAR = ("gain_margin_db", "sensitivity_peak")
"""What is told further out too, with the interval that the draws give it."""

_UNITS: Mapping[str, str] = {
    "crossover_rad_s": "rad/s",
    "phase_margin_deg": "deg",
    "delay_margin_s": "s",
    "gain_margin_db": "dB",
    "sensitivity_peak": "1",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Model(Immutable):
    """A late lag fitted to the plant, with draws of its coefficients, shape ``(draws, p)``.

    The filters between the motion and the logged rate are known: a lag that stood in for them would say that they let
    through beyond the band what they take away.
    """

    lag: LateLag
    theta: FloatArray
    draws: FloatArray
    band_rad_s: tuple[float, float]
    filters: tuple[KnownFilter, ...] = ()

    def numbers(self, controller: LoggedController) -> dict[str, Quantity]:
        """What the model says of the loop, as far as it has it; of a crossover only near the band."""
        top = _BEYOND_RATIO * self.band_rad_s[1]
        if controller.controller.step_s > 0.0:
            top = min(top, _MOST_OF_RATE * 2.0 * math.pi / controller.controller.step_s)
        omega = np.geomspace(max(self.band_rad_s[0], 1.0), top, _GRID_POINTS)
        C = controller.response(omega)
        for known in self.filters:
            C = C * known.response(omega)
        best, *drawn = [_read(omega, self.lag.response(theta, omega)[0] * C) for theta in (self.theta, *self.draws)]
        return {
            name: quantity
            for name, unit in _UNITS.items()
            if name in best
            and (name in _FAR or best.get("crossover_rad_s", math.inf) <= _NEAR * self.band_rad_s[1])
            and (quantity := _drawn(best[name], [one[name] for one in drawn if name in one], unit)) is not None
        }


def _drawn(value: float, draws: Sequence[float], unit: str) -> Quantity | None:
    """A number with its draws, or ``None`` where too many of them have none."""
    if len(draws) < _LEAST_SHARE * _DRAWS or not math.isfinite(value):
        return None
    low, high = np.percentile(draws, (2.5, 97.5))
    below, above = max(value - float(low), 0.0), max(float(high) - value, 0.0)
    return Quantity(
        value=value,
        std=MODEL_WIDER * float(high - low) / (2.0 * TWO_SIDED_95),
        lower=value - MODEL_WIDER * below,
        upper=value + MODEL_WIDER * above,
        unit=unit,
    )


def _read(omega_rad_s: FloatArray, loop: ComplexArray) -> dict[str, float]:
    """Margins of exact values on a close grid, as far as they are there."""
    found = {"sensitivity_peak": float(1.0 / np.abs(1.0 + loop).min())}
    falls = np.flatnonzero((np.abs(loop[:-1]) > 1.0) & (np.abs(loop[1:]) <= 1.0))
    for k in falls[-1:]:
        share = math.log(abs(loop[k])) / math.log(abs(loop[k]) / abs(loop[k + 1]))
        omega = float(omega_rad_s[k] * (omega_rad_s[k + 1] / omega_rad_s[k]) ** share)
        margin = float(np.angle(-loop[k]) + share * np.angle(loop[k + 1] / loop[k]))
        # Below -180 degrees at its last crossover a loop is unstable, and its other numbers are no margins.
        if margin <= 0.0:
            return {"crossover_rad_s": omega}
        found |= {
            "crossover_rad_s": omega,
            "phase_margin_deg": math.degrees(margin),
            "delay_margin_s": margin / omega,
        }
    passes = (loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (loop.real[:-1] < 0.0)
    for k in np.flatnonzero(passes):
        share = loop.imag[k] / (loop.imag[k] - loop.imag[k + 1])
        size = (1.0 - share) * math.log(abs(loop[k])) + share * math.log(abs(loop[k + 1]))
        if size <= 0.0:
            found["gain_margin_db"] = float(-_DB * size)
            break
    return found


def _late_lag(plant: FrequencyResponse, sample_rate_hz: float, filters: tuple[KnownFilter, ...] = ()) -> _Model | None:
    """A lag with a delay that explains the plant without its known filters, or ``None`` where none does."""
    try:
        plant = corrected(plant, {plant.outputs[0]: filters}) if filters else plant
    except UsageError:
        # A filter left too little at the end of the band to be taken off; then a lag has to stand in for it.
        filters = ()
    used = (plant.random_error <= LARGEST_ERROR) & (plant.coherence >= LEAST_COHERENCE)
    used[0, 0] &= _together(used[0, 0])
    if np.count_nonzero(used) < _FEWEST_POINTS:
        return None
    points = ResponsePoints.of(plant, used, (0, 0))
    points = replace(points, errors=_Errors(covariance=points.errors.covariance, scale=points.errors.scale))
    scale = float(np.sqrt(points.omega_rad_s[0] * points.omega_rad_s[-1]))
    lags = [
        LateLag(order=order, scale_rad_s=scale, hold="smooth", sample_s=1.0 / sample_rate_hz)
        for order in _ORDERS
        if 2 * points.omega_rad_s.size > order.coefficients + 1
    ]
    try:
        fits = [_fit(ResponseFit(data=points, model=lag)) for lag in lags]
    except InsufficientDataError:
        return None
    best = simplest(fits)
    if best.misfit**2 > LARGEST_CHI_SQUARE:
        return None
    return _Model(
        lag=next(lag for lag in lags if lag.order == best.order),
        theta=best.solution.theta,
        draws=_draws(best),
        band_rad_s=(float(points.omega_rad_s[0]), float(points.omega_rad_s[-1])),
        filters=filters,
    )


def _together(used: BoolArray) -> BoolArray:
    """The longest stretch of points with no more than two missing in between.

    Single points far above the rest pass for coherent by chance, and lie by far more off than they say.
    """
    rows = np.flatnonzero(used)
    kept = np.zeros_like(used)
    if rows.size:
        runs = np.split(rows, np.flatnonzero(np.diff(rows) > _WIDEST_HOLE) + 1)
        kept[max(runs, key=len)] = True
    return kept


def _fit(problem: ResponseFit) -> OrderFit:
    """The best fit from the delays at which a linear one is best."""
    limits = Limits(delays_s=(0.0, LONGEST_S), fastest_rad_s=FASTEST_GROWTH_RAD_S)
    starts = sorted((problem.linear(delay_s, FASTEST_GROWTH_RAD_S) for delay_s in _DELAYS_S), key=lambda one: one[1])
    fits = [fit_order(problem, limits, start=start) for start, _ in starts[:_TRIED]]
    return min(fits, key=lambda one: one.criterion)


class _Errors(ResidualErrors):
    """Errors that whiten by one product: a fit whitens a thousand times."""

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.asarray(np.linalg.inv(self.root))

    def whitened(self, values: FloatArray) -> FloatArray:
        return np.asarray(self._inverse @ values)


def _draws(fit: OrderFit) -> FloatArray:
    """Coefficients as the curvature of the cost spreads them, shape ``(draws, p)``; no delay below zero."""
    jacobian = fit.solution.jacobian
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    _, singular, rows = np.linalg.svd(jacobian / size, full_matrices=False)
    spread = np.divide(1.0, singular, out=np.zeros_like(singular), where=singular > 1e-8 * singular.max())
    normal = np.random.default_rng(_SEED).standard_normal((_DRAWS, singular.size))
    drawn = fit.solution.theta + max(1.0, fit.misfit) * (normal * spread) @ rows / size
    drawn[:, -1] = np.maximum(drawn[:, -1], 0.0)
    return np.asarray(drawn)


# What is worth a remark.

_LEAST_FACTOR, _SLEWED_SHARE = 0.99, 0.01
"""Factor of ArduPilot's slew limiter below which it had lowered the gains, and share of the flight from which that is
said."""

_MOVED = 0.2
"""How far the logged I term may fall short of what its gain makes before that is said."""


def _remarks(
    flight: Flown, axis: Axis, settings: AxisController, seen: ControllerMatch | None, main: str
) -> list[Finding]:
    found = []
    factors = [values for _, values in flight.samples(f"{axis}_slew_factor")]
    if factors:
        values = np.concatenate(factors)
        lowered = float(np.mean(values < _LEAST_FACTOR)) if values.size else 0.0
        if lowered > _SLEWED_SHARE:
            found.append(
                warn(
                    "moving_gains",
                    axis,
                    f"The slew limiter had lowered P and D of {axis} during {100.0 * lowered:.0f} % of the flight, to "
                    f"{float(values.min()):.2f} times at least: the margins are those of the full gains.",
                    share=lowered,
                    least=float(values.min()),
                )
            )
    if main:
        own, base = None if seen is None else seen.terms.get("d"), settings.controller.derivative_s2
        top = settings.ends[TOP].derivative_s2
        flew = f", and flew at {own.slope * top / base:.2f} times its base" if own is not None and base > 0.0 else ""
        found.append(
            remark(
                "moving_gains",
                axis,
                f"D of {axis} moves between two values in flight{flew}: the margins are those with {main}, and the "
                "other end stands beside them.",
            )
        )
    if seen is not None and "i" in seen.terms and seen.terms["i"].slope < 1.0 - _MOVED:
        left = max(seen.terms["i"].slope, 0.0)
        found.append(
            remark(
                "moving_gains",
                axis,
                f"The integral of {axis} was {100.0 * left:.0f} % of what its gain makes: the controller takes it back "
                "while the set-point moves, and hover has more of it.",
                share=left,
            )
        )
    return found


def _source(histories: Sequence[TimeHistory], channel: str) -> str:
    """Where a channel stands in the log, as the longest stretch has it."""
    longest = max(histories, key=lambda history: history.duration_s)
    return next((one.source for one in longest.channels if one.name == channel), "")
