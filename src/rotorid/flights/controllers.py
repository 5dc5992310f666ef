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

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.advice import gains_advice
from rotorid.autopilots.filters import KnownFilter, combined_response
from rotorid.autopilots.firmware import version_of
from rotorid.autopilots.registry import autopilot_of, by_gains, named
from rotorid.data.axes import RATE_OF, RATES
from rotorid.data.base import Immutable, cached_by_value
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.command_relation import CommandRelation, command_relation
from rotorid.models.autopilots.betaflight import OLDEST, is_other_program
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.autopilots.settings import AxisController, described, loop_settings
from rotorid.models.autopilots.versions import firmware_candidates
from rotorid.models.controller import Driven, RateController
from rotorid.results.summary import ControllerSettings
from rotorid.signal.autopilot_filters import controller_filters, known_filters
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

_EVERY_STEP_HZ = 200.0
"""A rate that is logged as often is logged at every step of its controller."""

_LEAST_PASSED = 0.01
"""Least gain of the filters of a channel that is used."""

_LEAST_THRUST = 0.05

_COMPARED: tuple[Axis, ...] = ("roll", "pitch")
"""Axes by which firmware is distinguished: yaw flies without a derivative."""

_LEAST_WINDOWS = 8

EXPLAINED = 0.35
"""Most of the command, as root mean square, that the controller which flew leaves unexplained. Those that flew leave
3 to 14 %, and 24 % where the rate is logged at 24 Hz; other gains leave more."""

_CLEARLY_BETTER, _DEVIATIONS = 0.8, 4.0
"""Another firmware than the likeliest is taken where it leaves at most this share of the unexplained power, and the
difference is so many standard deviations of its mean over the windows."""

_THROTTLE_STEP = 0.05

_STEMS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "roll": ("MC_ROLLRATE_", "ATC_RAT_RLL_"),
        "pitch": ("MC_PITCHRATE_", "ATC_RAT_PIT_"),
        "yaw": ("MC_YAWRATE_", "ATC_RAT_YAW_"),
    }
)
"""First letters of the names of the rate gains."""


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
    filters
        Filters in front of the rate that the controller takes.
    logged
        Filters in front of the rate in the log.
    """

    controller: RateController
    filters: tuple[KnownFilter, ...] = ()
    logged: tuple[KnownFilter, ...] = ()

    @property
    def rate_loop(self) -> LoggedController:
        """The same without its angle loop."""
        return replace(self, controller=self.controller.rate_loop)

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Command by the rate in the log, shape ``(f,)``, at frequencies above zero."""
        passed = combined_response(self.logged, omega_rad_s)
        left = np.maximum(np.abs(passed), _LEAST_PASSED) * np.exp(1j * np.angle(passed))
        return np.asarray(self.controller.response(omega_rad_s, combined_response(self.filters, omega_rad_s)) / left)


@dataclass(frozen=True, kw_only=True)
class LogControllers(Immutable):
    """The controllers of a log: gains and filters, and what a program makes of them.

    Parameters
    ----------
    origin
        Whose parameters these are, ``the parameters of flight.ulg``.
    parameters
        Of the autopilot.
    firmware
        The program that computed the controllers in flight.
    loop_rate_hz
        Its steps per second, where the log shows more than the parameters say; see
        :func:`rotorid.models.autopilots.reading.axis_controller`.
    throttle
        Usual share of the throttle, by which Betaflight moves gains and filters.
    advice
        What would show gains that are not there, as a sentence.
    """

    origin: str
    parameters: Mapping[str, float]
    firmware: LoggedFirmware
    loop_rate_hz: float | None = None
    throttle: float = 0.0
    advice: str = "give the log with the result"

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters)

    def axis(self, axis: str, *, throttle: float | None = None) -> AxisController | None:
        """The controller of an axis; ``None`` where its gains are not known.

        Parameters
        ----------
        axis
            ``roll``, ``pitch`` or ``yaw``; others have none.
        throttle
            Share of the throttle; the usual one when not given.
        """
        if axis not in RATE_OF or self.missing(axis):
            return None
        return axis_controller(
            self.parameters,
            axis,  # type: ignore[arg-type]
            firmware=self.firmware.name,
            loop_rate_hz=self.loop_rate_hz,
            throttle=self.throttle if throttle is None else throttle,
        )

    def missing(self, axis: str) -> tuple[str, ...]:
        """Gains that an autopilot always has with those that are there: unknown, and not zero."""
        for stem in _STEMS.get(axis, ()):
            have = {f"{stem}{letter}" for letter in "PID"}
            if have & self.parameters.keys():
                return tuple(sorted(have - self.parameters.keys()))
        return ()

    def unknown_gains(self, axis: str) -> tuple[str, str]:
        """Why the controller of an axis is not known, and what would help: the same words from every verb.

        Parameters
        ----------
        axis
            One of which :meth:`axis` has none.
        """
        if missing := self.missing(axis):
            why = f"The {axis} controller is unknown: {self.origin} lack {' and '.join(missing)}"
            return why, "log all parameters of the autopilot"
        if f"{axis}PID_P" in self.parameters:
            if is_other_program(self.firmware.name):
                why = f"The {axis} controller of {self.firmware.name} is not supported"
                return why, "only gains of Betaflight 4.0 or later can be judged and tuned"
            version = version_of(self.firmware.name)
            if version is None:
                why = f"The log does not name its firmware version, which the {axis} gains depend on"
                return why, "give the log as the flight controller wrote it"
            if version < OLDEST:
                why = f"The {axis} controller of {self.firmware.name}, older than version 4.0, is not supported"
                return why, "use Betaflight 4.0 or later"
        return f"The log has no known gains for the {axis} controller", self.advice

    def settings(self) -> ControllerSettings | None:
        """Gains and filters of roll, pitch and yaw, as results have them; ``None`` where none are known."""
        found = [controller for axis in RATE_OF if (controller := self.axis(axis)) is not None]
        if not found:
            return None
        moves = named(found[0].autopilot).gains_by_throttle
        return ControllerSettings(
            **described(found),
            settings=loop_settings(self.parameters),
            throttle=self.throttle if moves else None,
        )

    def with_parameters(self, parameters: Mapping[str, float]) -> LogControllers:
        """The same program with other parameters, which did not make the logged commands."""
        return replace(self, parameters=parameters)


def controllers_of_result(known: ControllerSettings) -> LogControllers:
    """The controllers of a log according to its result."""
    return LogControllers(
        origin="the result",
        parameters={**known.gains, **known.filters, **known.settings},
        firmware=LoggedFirmware(name=known.firmware, unexplained={}),
        loop_rate_hz=known.loop_rate_hz,
        throttle=known.throttle or 0.0,
    )


@cached_by_value
def controllers_of(record: FlightRecord) -> LogControllers:
    """The controllers of a log, with the firmware that flew, its loop rate and the throttle that was flown.

    This is the only place that reads the controller of a log.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> source = Source(name="flight.ulg", format="PX4 ULog", sha256="", firmware="PX4 1.11.3")
    >>> gains = {"MC_ROLLRATE_P": 0.15, "MC_ROLLRATE_I": 0.2, "MC_ROLLRATE_D": 0.003, "IMU_DGYRO_CUTOFF": 30.0}
    >>> flown = controllers_of(FlightRecord(source=source, topics=(), parameters=gains))
    >>> flown.axis("roll").controller.proportional_s, flown.origin, flown.axis("thrust")
    (0.15, 'the parameters of flight.ulg', None)
    >>> [one.kind for one in flown.axis("roll").controller.derivative_filters]
    ['Butterworth']
    """
    return LogControllers(
        origin=f"the parameters of {record.source.name}",
        parameters=record.parameters,
        firmware=flown_firmware(record),
        loop_rate_hz=_loop_rate_hz(record),
        throttle=_usual_throttle(record),
        advice=gains_advice(record),
    )


def logged_controller(record: FlightRecord, command: str, *, source: str) -> LoggedController | None:
    """The controller of a command acting on a logged rate; ``None`` if the log has no gains.

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
    found = controllers_of(record).axis(command.removesuffix("_command"))
    return None if found is None else controller_as_logged(record, found.controller, source=source)


def controller_as_logged(record: FlightRecord, controller: RateController, *, source: str) -> LoggedController:
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
    filters = controller_filters(record) if logged else ()
    return LoggedController(controller=controller, filters=filters, logged=logged)


def _usual_throttle(record: FlightRecord) -> float:
    """Median of the throttle where there is any, from zero to one; zero where it is not logged.

    Betaflight moves filters and gains by the stick, before the mixer makes room for the other axes; other autopilots
    move nothing.
    """
    stick = autopilot_of(record).gains_by_throttle
    names = ("thrust_stick", "thrust_command") if stick else ("thrust_command",)
    found = ((topic, topic.row(name)) for name in names for topic in record.topics)
    for topic, row in found:
        if row is not None:
            values = topic.values[row]
            values = values[np.isfinite(values) & (values > _LEAST_THRUST)]
            return min(float(np.median(values)), 1.0) if values.size else 0.0
    return 0.0


@dataclass(frozen=True, kw_only=True)
class LoggedFirmware:
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
        ``firmware_contradicted`` where the name in the log is a wrong one, ``controller_unchecked`` where the log does
        not show which firmware flew.
    """

    name: str
    unexplained: dict[str, float]
    findings: tuple[Finding, ...] = ()


@cached_by_value
def flown_firmware(record: FlightRecord) -> LoggedFirmware:
    """Which firmware computed the controller of a log, decided by the data.

    The candidates of :func:`rotorid.models.autopilots.versions.firmware_candidates` are compared over the flight, in
    windows of 4 s, at the frequencies where set-point and rate explain the command. The likeliest of them (the declared
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
        return LoggedFirmware(name=candidates[0], unexplained={})
    left = [found for axis in _COMPARED for found in _unexplained(record, axis, differing)]
    if sum(one.size for one in left) < _LEAST_WINDOWS * len(differing):
        return LoggedFirmware(name=candidates[0], unexplained={}, findings=_contradicted(record, candidates[0], {}))
    power = np.concatenate(left, axis=1)
    unexplained = dict(zip(differing, np.sqrt(power.mean(axis=1)).tolist(), strict=True))
    best = int(np.argmin(power.mean(axis=1)))
    gained = power[0] - power[best]
    sure = gained.mean() > _DEVIATIONS * gained.std() / np.sqrt(gained.size)
    better = sure and power[best].mean() <= _CLEARLY_BETTER * power[0].mean()
    explained = min(unexplained.values()) <= EXPLAINED
    name = differing[best] if better and explained else candidates[0]
    return LoggedFirmware(name=name, unexplained=unexplained, findings=_contradicted(record, name, unexplained))


def _differing(record: FlightRecord, candidates: Sequence[str]) -> tuple[str, ...]:
    """Candidates whose controllers of a rate differ, the first one of those that are alike."""
    found: dict[tuple[RateController, ...], str] = {}
    for name in candidates:
        each = [axis_controller(record.parameters, axis, firmware=name, throttle=0.5) for axis in _COMPARED]
        if all(controller is not None for controller in each):
            loops = tuple(
                replace(controller.controller.rate_loop, angle_filters=())
                for controller in each
                if controller is not None
            )
            found.setdefault(loops, name)
    return tuple(found.values())


def _unexplained(record: FlightRecord, axis: Axis, names: Sequence[str]) -> Iterator[FloatArray]:
    """Power that each candidate leaves unexplained over the mean power of the signal, shape ``(names, windows)``."""
    term = f"{axis}_d_term"
    logged = term in record.channel_names
    signal, setpoint = (term, None) if logged else (f"{axis}_command", f"{RATE_OF[axis]}_setpoint")
    try:
        relation = command_relation(record, axis, (signal,), setpoint=setpoint)
    except InsufficientDataError:
        return
    usable = relation.related(signal)
    if not usable.any():
        return
    measured = relation.signals[signal]
    left = []
    for name in names:
        flown = LogControllers(
            origin="",
            parameters=record.parameters,
            firmware=LoggedFirmware(name=name, unexplained={}),
            loop_rate_hz=_loop_rate_hz(record),
        )
        paths = made_by_paths(record, relation, _at_throttle(flown, axis))
        made = _with_own_gain(paths["d"], measured) if logged else sum(paths.values(), start=np.zeros_like(measured))
        left.append(np.sum(np.abs(measured - made)[:, usable] ** 2, axis=1))
    yield np.asarray(left) / np.mean(np.sum(np.abs(measured[:, usable]) ** 2, axis=1))


def _at_throttle(flown: LogControllers, axis: Axis) -> Callable[[float], RateController]:
    def controller(throttle: float) -> RateController:
        found = flown.axis(axis, throttle=throttle)
        assert found is not None  # of these parameters another throttle made one
        return found.controller

    return controller


def made_by_paths(
    record: FlightRecord,
    relation: CommandRelation,
    controller_at: Callable[[float], RateController],
    *,
    driven: Driven = "rate",
) -> dict[str, ComplexArray]:
    """Output of each path of a controller for set-point and rate, shapes ``(windows, f)``.

    Parameters
    ----------
    relation
        Set-point and rate; without a set-point, each path makes what it does of the rate.
    controller_at
        The controller at a throttle.
    driven
        What the set-point is.

    Returns
    -------
    dict
        ``p``, ``i``, ``d`` and ``f``, as far as the controller has them.
    """
    steps = np.round(relation.throttle / _THROTTLE_STEP)
    found: dict[str, ComplexArray] = {}
    for step in np.unique(steps):
        rows = steps == step
        for letter, part in _parts(controller_at(float(step) * _THROTTLE_STEP)).items():
            made = found.setdefault(letter, np.zeros_like(relation.rate))
            made[rows] = _made(record, relation, rows, part, driven)
    return found


def _parts(controller: RateController) -> dict[str, tuple[RateController, ...]]:
    """The controller with only one of its gains; feed-forward is the total minus the others."""
    back = replace(controller, feedforward=0.0, feedforward_derivative_s=0.0)
    parts = {
        "p": (replace(back, integral=0.0, derivative_s2=0.0),) if back.proportional_s else (),
        "i": (replace(back, proportional_s=0.0, derivative_s2=0.0),) if back.integral else (),
        "d": (replace(back, proportional_s=0.0, integral=0.0),) if back.derivative_s2 else (),
        "f": (controller, back) if controller != back else (),
    }
    return {letter: part for letter, part in parts.items() if part}


def _made(
    record: FlightRecord, relation: CommandRelation, rows: BoolArray, part: tuple[RateController, ...], driven: Driven
) -> ComplexArray:
    """Output of a controller minus that of the others of its part."""
    omega = relation.omega_rad_s
    made = np.zeros_like(relation.rate[rows])
    for sign, controller in zip((1.0, -1.0), part, strict=False):
        loop = controller if driven == "angle" else controller.rate_loop
        made = (
            made
            - sign * controller_as_logged(record, loop, source=relation.source).response(omega) * relation.rate[rows]
        )
        if relation.setpoint is not None:
            late = np.exp(-1j * omega * (loop.step_s if loop.late_angle else 0.0))
            ahead = loop.angle_response(omega) if driven == "angle" else loop.setpoint_response(omega) * late
            made = made + sign * ahead * relation.setpoint[rows]
    return made


def _with_own_gain(made: ComplexArray, signal: ComplexArray) -> ComplexArray:
    """Output in each window scaled by a real gain to the size of the signal: D changes in flight, its filters not."""
    size = np.maximum(np.sum(np.abs(made) ** 2, axis=1), 1e-300)
    return np.asarray(made * (np.sum((made.conj() * signal).real, axis=1) / size)[:, None])


def _contradicted(record: FlightRecord, name: str, unexplained: dict[str, float]) -> tuple[Finding, ...]:
    """The remark that the name in the log is not that of the firmware which flew."""
    declared = record.source.firmware
    if name == declared:
        if unexplained:
            return ()
        why = "The log does not show set-point, rate and command well enough to check how its firmware filters D."
        believed = f"The logged version, {declared}, was used." if declared else "The log names no version."
        return (remark("controller_unchecked", record.source.name, f"{why} {believed}"),)
    if name in unexplained and declared in unexplained:
        why = (
            f"it leaves {100.0 * unexplained[name]:.0f} % of the commands unexplained, "
            f"{declared or 'the newest version'} {100.0 * unexplained[declared]:.0f} %. There is nothing to do"
        )
    else:
        why = "the log contains topics or parameters that the named version does not have"
    called = f"The log names {declared}, but" if declared else "The log does not name its firmware;"
    message = f"{called} {name} flew and was used: {why}."
    numbers = {"unexplained": unexplained[name]} if name in unexplained else {}
    return (warn("firmware_contradicted", record.source.name, message, **numbers),)


def _loop_rate_hz(record: FlightRecord) -> float | None:
    """Rate of PX4's loop according to the log: a slow sensor limits it, whatever ``IMU_GYRO_RATEMAX`` allows.

    The parameters of ArduPilot and the header of Betaflight say it. ``sensor_combined`` is averaged for the estimator
    where the log has ``vehicle_angular_velocity``, the rate that the controller takes.
    """
    if not (named(record.source.firmware).waits_for_sensor or by_gains(record.parameters).waits_for_sensor):
        return None
    rates = {
        channel.source.partition(".")[0]: topic.sample_rate_hz
        for topic in record.topics
        for channel in topic.channels
        if channel.name in RATES
    }
    fastest = rates.get("vehicle_angular_velocity", max(rates.values(), default=0.0))
    return fastest if _EVERY_STEP_HZ <= fastest < np.inf else None
