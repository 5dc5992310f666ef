r"""Rate controllers of the logs as they act on a logged rate: gains, steps, and the filters on either side.

Gains are the parameters of the log. What a program makes of them depends on its version, and the version in a log is
evidence only: builds without tags, and forks, state a wrong one. So each firmware that may have flown makes the command
again, from the logged set-point :math:`r` and rate :math:`y`,

.. math:: \hat u = C_r e^{-s T_r} r - C_{log} y

or, where a blackbox has it, the logged term of the derivative from the rate. The one that leaves least of the logged
signal unexplained is taken (:func:`flown_firmware`). :math:`T_r` is one step for ArduPilot, whose rate loop takes the
set-point of the step before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import remembered
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import STANDARD_UNITS, FlightRecord, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.autopilots.versions import firmware_candidates
from rotorid.models.controller import RateController
from rotorid.signal.airborne import airborne
from rotorid.signal.autopilot_filters import controller_filters, known_filters
from rotorid.signal.clock import resample
from rotorid.signal.filters import KnownFilter, combined_response
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

_EVERY_STEP_HZ = 200.0
"""A rate that is logged as often is logged at every step of its controller."""

_LEAST_PASSED = 0.01
"""Of a channel that its filters leave less of, nothing can be said."""

_LEAST_THRUST = 0.05

_COMPARED: tuple[Axis, ...] = ("roll", "pitch")
"""Axes by which firmware is told apart: yaw flies without a derivative."""

_WINDOW_S, _LEAST_WINDOWS, _LEAST_FREQUENCIES = 2.0, 8, 8
_LONGEST_S = 300.0
"""Of a longer flight the middle is compared."""

_LOWEST_RAD_S, _NYQUIST_SHARE = 3.0, 0.8
"""Below the one the angle loop moves the set-point, beyond the other a log folds the command."""

_RELATED = 0.8
"""Share of the command that set-point and rate explain together, whatever the controller, at a frequency that counts:
elsewhere the log is too slow, or something else made the command."""

EXPLAINED = 0.35
"""Most of the command, as root mean square, that the controller which flew leaves unexplained. Those that flew leave
3 to 15 %, and 28 % where the rate is logged at 24 Hz; other gains leave more."""

_CLEARLY_BETTER, _DEVIATIONS = 0.8, 4.0
"""Another firmware than the likeliest is taken where it leaves at most this share of the unexplained power, and the
difference is so many standard deviations of its mean over the windows."""

_THROTTLE_STEP = 0.05


@dataclass(frozen=True, kw_only=True)
class LoggedController:
    r"""A rate controller by the rate in the log.

    .. math:: C_{log} = \frac{C_y F_\omega + C_r F_t A / s}{F_{log}}

    The rate controller sees the rate behind filters :math:`F_\omega`, the angle loop sees the motion itself, and the
    log what is left of it behind :math:`F_{log}`.

    Parameters
    ----------
    controller
        Gains and steps.
    seen
        Filters in front of the rate that the controller takes.
    logged
        Filters in front of the rate in the log.
    """

    controller: RateController
    seen: tuple[KnownFilter, ...] = ()
    logged: tuple[KnownFilter, ...] = ()

    @property
    def rate_loop(self) -> LoggedController:
        """The same without its angle loop."""
        return replace(self, controller=self.controller.rate_loop)

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Command by the rate in the log, shape ``(f,)``, at frequencies above zero."""
        passed = combined_response(self.logged, omega_rad_s)
        left = np.maximum(np.abs(passed), _LEAST_PASSED) * np.exp(1j * np.angle(passed))
        return np.asarray(self.controller.response(omega_rad_s, combined_response(self.seen, omega_rad_s)) / left)


def logged_controller(record: FlightRecord, command: str, *, source: str) -> LoggedController | None:
    """The controller of a command as it acts on a logged rate; ``None`` where the log holds no gains.

    Parameters
    ----------
    record
        With the parameters of the autopilot.
    command
        Such as ``roll_command``.
    source
        Where the logged rate stands in the log. Of one whose filters are not known it is taken that the controller
        sees it as it is.
    """
    found = logged_axis(record, command, source=source)
    return None if found is None else acting_on(record, found.controller, source=source)


def logged_axis(
    record: FlightRecord, command: str, *, source: str, throttle: float | None = None, firmware: str | None = None
) -> AxisController | None:
    """The controller of a command by the parameters of a log; ``None`` where it holds no gains.

    The firmware is the one whose controller made the logged commands, see :func:`flown_firmware`.

    Parameters
    ----------
    record, command, source
        As for :func:`logged_controller`.
    throttle
        Share of the throttle that was flown, on which controllers of Betaflight depend; the usual one of the log when
        not given.
    firmware
        Which firmware computes it, of a record whose parameters are not those that were flown; the one that flew the
        log when not given.
    """
    return axis_controller(
        record.parameters,
        command.removesuffix("_command"),  # type: ignore[arg-type]
        firmware=flown_firmware(record).name if firmware is None else firmware,
        loop_rate_hz=_loop_rate_hz(record, source),
        throttle=usual_throttle(record) if throttle is None else throttle,
    )


def acting_on(record: FlightRecord, controller: RateController, *, source: str) -> LoggedController:
    """A controller as it acts on a logged rate.

    Parameters
    ----------
    record, source
        As for :func:`logged_controller`.
    controller
        Gains and steps.
    """
    logged = known_filters(record, source)
    # A mean over a loop is no filter of the controller; an unknown source is taken for the controller's own.
    seen = controller_filters(record) if logged else ()
    return LoggedController(controller=controller, seen=seen, logged=logged)


def usual_throttle(record: FlightRecord) -> float:
    """Median of the throttle where there is any, from zero to one; zero where it is not logged.

    Betaflight moves filters and gains by the stick, before the mixer makes room for the other axes; other autopilots
    move nothing.

    Parameters
    ----------
    record
        The log.
    """
    stick = record.source.format.startswith("Betaflight")
    names = ("thrust_stick", "thrust_command") if stick else ("thrust_command",)
    found = ((topic, topic.row(name)) for name in names for topic in record.topics)
    for topic, row in found:
        if row is not None:
            values = topic.values[row]
            values = values[np.isfinite(values) & (values > _LEAST_THRUST)]
            return min(float(np.median(values)), 1.0) if values.size else 0.0
    return 0.0


@dataclass(frozen=True, kw_only=True)
class FlownFirmware:
    """The firmware whose controller flew a log.

    Parameters
    ----------
    name
        As :func:`rotorid.models.autopilots.reading.axis_controller` takes it: the name in the log, unless what the log
        holds contradicts it.
    unexplained
        Candidate to the share of the logged commands that its controller leaves unexplained, as root mean square; empty
        where candidates compute the controller alike, or the log cannot decide.
    findings
        ``firmware_contradicted`` where the name in the log is a wrong one, ``controller_unexplained`` where no
        candidate made the commands, and ``controller_unchecked`` where that could not be checked.
    """

    name: str
    unexplained: dict[str, float]
    findings: tuple[Finding, ...] = ()


@remembered
def flown_firmware(record: FlightRecord) -> FlownFirmware:
    """Which firmware computed the controller of a log, decided by the data.

    The candidates of :func:`rotorid.models.autopilots.versions.firmware_candidates` are compared over the flight, in
    windows of 2 s, at the frequencies where set-point and rate explain the command. The likeliest of them (the declared
    one, unless the log holds what its version does not have) stays, unless another one leaves clearly less unexplained.

    Parameters
    ----------
    record
        The log, with the parameters that flew.
    """
    names = {channel.source.partition("[")[0] for topic in record.topics for channel in topic.channels}
    candidates = firmware_candidates(record.parameters, firmware=record.source.firmware, names=sorted(names))
    differing = _differing(record, candidates)
    if len(differing) < 2 or differing[0] != candidates[0]:
        return FlownFirmware(name=candidates[0], unexplained={})
    left = [found for axis in _COMPARED for found in _unexplained(record, axis, differing)]
    if sum(one.size for one in left) < _LEAST_WINDOWS * len(differing):
        return FlownFirmware(name=candidates[0], unexplained={}, findings=_contradicted(record, candidates[0], {}))
    power = np.concatenate(left, axis=1)
    unexplained = dict(zip(differing, np.sqrt(power.mean(axis=1)).tolist(), strict=True))
    best = int(np.argmin(power.mean(axis=1)))
    gained = power[0] - power[best]
    sure = gained.mean() > _DEVIATIONS * gained.std() / np.sqrt(gained.size)
    better = sure and power[best].mean() <= _CLEARLY_BETTER * power[0].mean()
    explained = min(unexplained.values()) <= EXPLAINED
    name = differing[best] if better and explained else candidates[0]
    findings = () if explained else (_nothing_explains(record, unexplained),)
    return FlownFirmware(
        name=name, unexplained=unexplained, findings=(*_contradicted(record, name, unexplained), *findings)
    )


def _differing(record: FlightRecord, candidates: Sequence[str]) -> tuple[str, ...]:
    """Candidates whose controllers of a rate differ, the first one of those that are alike."""
    found: dict[tuple[RateController, ...], str] = {}
    for name in candidates:
        each = [axis_controller(record.parameters, axis, firmware=name, throttle=0.5) for axis in _COMPARED]
        if all(one is not None for one in each):
            loops = tuple(replace(one.controller.rate_loop, angle_filters=()) for one in each if one is not None)
            found.setdefault(loops, name)
    return tuple(found.values())


class _Relation(NamedTuple):
    """A logged signal of a controller and what goes into it, windows transformed: shapes ``(windows, f)``.

    ``setpoint`` is missing where the signal is the term of the derivative, whose gain moves in flight.
    """

    omega_rad_s: FloatArray
    signal: ComplexArray
    rate: ComplexArray
    setpoint: ComplexArray | None
    throttle: FloatArray
    source: str

    @property
    def usable(self) -> BoolArray:
        """Frequencies at which what goes in explains the signal, by some linear relation."""
        inside = [self.rate] if self.setpoint is None else [self.rate, self.setpoint]
        stacked = np.stack(inside, axis=-1).transpose(1, 0, 2)
        fitted = stacked @ (np.linalg.pinv(stacked) @ self.signal.T[..., None])
        left = np.sum(np.abs(self.signal.T - fitted[..., 0]) ** 2, axis=1)
        size = np.sum(np.abs(self.signal) ** 2, axis=0)
        return np.asarray(left < (1.0 - _RELATED) * size)


def _unexplained(record: FlightRecord, axis: Axis, names: Sequence[str]) -> Iterator[FloatArray]:
    """Power that each candidate leaves unexplained over the mean power of the signal, shape ``(names, windows)``."""
    for one in _relations(record, axis):
        usable = one.usable
        if np.count_nonzero(usable) < _LEAST_FREQUENCIES:
            continue
        signal = one.signal[:, usable]
        left = [np.sum(np.abs(signal - _made(record, axis, name, one)[:, usable]) ** 2, axis=1) for name in names]
        yield np.asarray(left) / np.mean(np.sum(np.abs(signal) ** 2, axis=1))


def _relations(record: FlightRecord, axis: Axis) -> Iterator[_Relation]:
    rate, command, term = RATE_OF[axis], f"{axis}_command", f"{axis}_d_term"
    names = (term, rate) if term in record.channel_names else (command, rate, f"{rate}_setpoint")
    further = [name for name in ("thrust_stick", f"{axis}_excitation") if name in record.channel_names]
    if not set(names) <= set(record.channel_names):
        return
    try:
        start_s, stop_s = airborne(record).longest
        spare_s = max(stop_s - start_s - _LONGEST_S, 0.0)
        flown = resample(
            record, channels=(*names, *further), start_s=start_s + 0.5 * spare_s, stop_s=stop_s - 0.5 * spare_s
        )
    except InsufficientDataError:
        return
    yield from (_relation(history, names) for history in flown.histories if history.duration_s > 2.0 * _WINDOW_S)


def _relation(history: TimeHistory, names: Sequence[str]) -> _Relation:
    rate_hz = history.sample_rate_hz
    length = round(_WINDOW_S * rate_hz)
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(length, 1.0 / rate_hz), dtype=np.float64)
    inside = (omega > _LOWEST_RAD_S) & (omega < _NYQUIST_SHARE * np.pi * rate_hz)
    signal = history[names[0]]
    excitation = f"{names[0].removesuffix('_command')}_excitation"
    if excitation in history.names:
        channel = history.channels[history.names.index(excitation)]
        # In another unit it enters in front of the controller, and the set-point holds it.
        if channel.unit == STANDARD_UNITS[names[0]]:
            signal = signal - np.nan_to_num(history[excitation])
    throttle = history["thrust_stick"] if "thrust_stick" in history.names else np.zeros(signal.size)
    return _Relation(
        omega_rad_s=omega[inside],
        signal=_spectra(signal, length)[:, inside],
        rate=_spectra(history[names[1]], length)[:, inside],
        setpoint=_spectra(history[names[2]], length)[:, inside] if len(names) > 2 else None,
        throttle=_cut(throttle, length).mean(axis=1),
        source=history.channels[1].source,
    )


def _cut(values: FloatArray, length: int) -> FloatArray:
    """Windows that overlap by half, shape ``(windows, length)``."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2])


def _spectra(values: FloatArray, length: int) -> ComplexArray:
    windows = _cut(values, length)
    windows = windows - windows.mean(axis=1, keepdims=True)
    return np.asarray(np.fft.rfft(windows * np.hanning(length + 2)[1:-1], axis=1))


def _made(record: FlightRecord, axis: Axis, name: str, one: _Relation) -> ComplexArray:
    """What the controller of a firmware makes of what went in, shape ``(windows, f)``."""
    steps = np.round(one.throttle / _THROTTLE_STEP)
    made = np.empty_like(one.rate)
    for step in np.unique(steps):
        rows = steps == step
        flown = axis_controller(
            record.parameters,
            axis,
            firmware=name,
            loop_rate_hz=_loop_rate_hz(record, one.source),
            throttle=float(step) * _THROTTLE_STEP,
        )
        assert flown is not None  # of these parameters another throttle made one
        loop = flown.controller.rate_loop
        if one.setpoint is None:
            made[rows] = _with_own_gain(-loop.derivative_response(one.omega_rad_s) * one.rate[rows], one.signal[rows])
        else:
            late = np.exp(-1j * one.omega_rad_s * (loop.step_s if flown.controller.late_angle else 0.0))
            of_rate = acting_on(record, loop, source=one.source).response(one.omega_rad_s) * one.rate[rows]
            made[rows] = loop.setpoint_response(one.omega_rad_s) * late * one.setpoint[rows] - of_rate
    return made


def _with_own_gain(made: ComplexArray, signal: ComplexArray) -> ComplexArray:
    """What was made of each window, by a real gain as large as the signal: D moves in flight, its filters do not."""
    size = np.maximum(np.sum(np.abs(made) ** 2, axis=1), 1e-300)
    return np.asarray(made * (np.sum((made.conj() * signal).real, axis=1) / size)[:, None])


def _contradicted(record: FlightRecord, name: str, unexplained: dict[str, float]) -> tuple[Finding, ...]:
    """The remark that the name in the log is not that of the firmware which flew."""
    declared = record.source.firmware
    if name == declared:
        if unexplained:
            return ()
        why = "The log does not show set-point, rate and command well enough to check how its firmware filters D."
        believed = f"The version that it names, {declared}, was believed." if declared else "It names no version."
        return (remark("controller_unchecked", record.source.name, f"{why} {believed}"),)
    if name in unexplained and declared in unexplained:
        why = (
            f"its controller leaves {100.0 * unexplained[name]:.0f} % of the logged commands unexplained, that of "
            f"{declared or 'the newest version'} {100.0 * unexplained[declared]:.0f} %"
        )
    else:
        why = "the log holds topics or parameters that the version which it names does not have"
    called = f"The log calls its firmware {declared}, but" if declared else "The log does not name its firmware;"
    message = f"{called} {name} flew: {why}. Its controller was taken."
    numbers = {"unexplained": unexplained[name]} if name in unexplained else {}
    return (warn("firmware_contradicted", record.source.name, message, **numbers),)


def _nothing_explains(record: FlightRecord, unexplained: dict[str, float]) -> Finding:
    each = ", ".join(
        f"{100.0 * share:.0f} % with that of {name or 'the newest version'}" for name, share in unexplained.items()
    )
    message = (
        f"No known controller makes the logged roll and pitch commands of set-point and rate: {each} stay unexplained. "
        "Gains changed in flight, motors were at their limits, or the controller has parts that are not modeled."
    )
    return warn("controller_unexplained", record.source.name, message, unexplained=min(unexplained.values()))


def _loop_rate_hz(record: FlightRecord, source: str) -> float | None:
    """Rate of the loop where the log shows it; the parameters say it otherwise."""
    if "SCHED_LOOP_RATE" in record.parameters:
        return None
    rates = [
        topic.sample_rate_hz for topic in record.topics if any(channel.source == source for channel in topic.channels)
    ]
    fastest = max(rates, default=0.0)
    return fastest if _EVERY_STEP_HZ <= fastest < np.inf else None
