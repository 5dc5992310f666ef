"""Motors of a PX4 log whose firmware logs no demands of theirs: the outputs of its drivers, in the drivers' units.

Before 1.13 a mixer file puts motor *n* on output *n*, and the log says only how many there are: by the kind of the
vehicle. From then on parameters give each output its function. What an output is worth depends on its driver: pulses
between two limits, DShot, CAN, or a share in simulators.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.numbers import whole
from rotorid.autopilots.thrust import expo_thrust
from rotorid.data.findings import Finding, remark
from rotorid.data.record import STANDARD_UNITS, Channel, Topic, Unread
from rotorid.io.flags import most_frequent
from rotorid.typing import AnyArray, FloatArray

TOPICS = ("actuator_outputs", "actuator_outputs:1")
"""Instances, of two drivers where a board has a processor for outputs of its own."""

_OUTPUTS = 16
OUTPUT_FIELDS: Mapping[str, Sequence[str]] = MappingProxyType(
    {topic: ("noutputs", *(f"output[{index}]" for index in range(_OUTPUTS))) for topic in TOPICS}
)

_BANKS = ("MAIN", "AUX")
_FIRST_MOTOR, _MOST_MOTORS = 101, 12
_BY_TYPE: Mapping[int, int] = MappingProxyType({2: 4, 13: 6, 14: 8, 15: 3, 29: 12, 35: 10})
"""Kind of vehicle as MAVLink numbers it, to its motors."""
_BY_START: Mapping[int, int] = MappingProxyType(
    {**dict.fromkeys((4, 5, 10), 4), **dict.fromkeys((6, 7, 11), 6), **dict.fromkeys((8, 9, 12), 8), 14: 3}
)
"""Thousands of ``SYS_AUTOSTART`` to motors."""

_LONGEST_PULSE_US = 2500.0
_USUAL_PULSES_US = (1000.0, 2000.0)
_DSHOT_TOP, _DSHOT_IDLE = 1999.0, 0.055
_CAN_TOP = 8191.0
_DSHOT_TIMERS = range(-5, -1)
"""``PWM_MAIN_TIMn`` of DShot, at its four rates."""
_SHARE = 1.01


@dataclass(frozen=True, kw_only=True, slots=True)
class _Scale:
    """Outputs of no and of full thrust, and what says so; empty where that was assumed."""

    low: float
    high: float
    said_by: str


def motor_outputs(
    arrays: Mapping[str, AnyArray], parameters: Mapping[str, float]
) -> tuple[tuple[Topic, ...], tuple[Finding, ...], tuple[Unread, ...]]:
    r"""Motors as demands of thrust from 0 to 1, what was assumed for them, and outputs that could not be read.

    An output over its range is :math:`x`, at most 0 where the driver holds a motor still. The firmware undoes the curve
    of its motors before it (``THR_MDL_FAC``, :math:`f`), so that the demand, as newer firmware logs it, is
    :math:`(1 - f) x + f x^2`.

    Parameters
    ----------
    arrays
        ``topic/field`` to samples as logged; a second instance of a topic is ``topic:1``.
    parameters
        The autopilot's.
    """
    present = [topic for topic in TOPICS if f"{topic}/timestamp" in arrays]
    unread: list[Unread] = []
    for topic in present:
        motors = _motors(arrays, parameters)
        why = "which of its outputs are motors is not known"
        if motors:
            outputs = {motor: arrays.get(f"{topic}/output[{index}]") for motor, (_, index) in motors.items()}
            values = {motor: value.astype(np.float64) for motor, value in outputs.items() if value is not None}
            if len(values) == len(motors) and all(_is_used(value) for value in values.values()):
                scale = _scale(parameters, motors, values)
                return (_topic(topic, arrays, parameters, motors, values, scale),), tuple(_remarks(scale)), ()
            why = "no output of a motor ever had a value"
        unread.append(Unread(name=topic, channels=("motor_",), why=why, rate_hz=rate_hz_of(arrays, topic)))
    return (), (), tuple(unread)


def rate_hz_of(arrays: Mapping[str, AnyArray], topic: str) -> float:
    """Mean rate of a topic; zero for less than two samples."""
    stamps = arrays[f"{topic}/timestamp"].astype(np.float64) * 1e-6
    span_s = float(np.ptp(stamps)) if stamps.size > 1 else 0.0
    return (stamps.size - 1) / span_s if span_s > 0.0 else 0.0


def _is_used(values: FloatArray) -> bool:
    return bool(np.any(np.isfinite(values) & (values != 0.0)))


def _motors(arrays: Mapping[str, AnyArray], parameters: Mapping[str, float]) -> dict[int, tuple[str, int]]:
    """Number of each motor, from 1, to its bank and output; empty where the log does not say it."""
    for bank in _BANKS:
        functions = {index: whole(parameters, f"PWM_{bank}_FUNC{index + 1}") for index in range(_OUTPUTS)}
        assigned = {
            number - _FIRST_MOTOR + 1: (bank, index)
            for index, number in functions.items()
            if _FIRST_MOTOR <= number < _FIRST_MOTOR + _MOST_MOTORS
        }
        if assigned:
            return dict(sorted(assigned.items()))
    return {number: (_BANKS[0], number - 1) for number in range(1, _count(arrays, parameters) + 1)}


def _count(arrays: Mapping[str, AnyArray], parameters: Mapping[str, float]) -> int:
    states = arrays.get("vehicle_status/system_type", np.empty(0))
    kind = most_frequent(states) if states.size else whole(parameters, "MAV_TYPE", -1)
    start = whole(parameters, "SYS_AUTOSTART") // 1000
    return whole(parameters, "CA_ROTOR_COUNT") or _BY_TYPE.get(kind, 0) or (_BY_START.get(start, 0) if kind < 1 else 0)


def _scale(
    parameters: Mapping[str, float], motors: Mapping[int, tuple[str, int]], values: Mapping[int, FloatArray]
) -> dict[int, _Scale]:
    """The range of each motor's output."""
    finite = np.concatenate([value[np.isfinite(value)] for value in values.values()])
    lowest, highest = float(finite.min()), float(finite.max())
    if highest <= _SHARE and lowest >= -_SHARE:
        both = lowest < 0.0
        return dict.fromkeys(motors, _Scale(low=-1.0 if both else 0.0, high=1.0, said_by="its values"))
    if _dshot(parameters):
        idle = parameters.get("DSHOT_MIN", _DSHOT_IDLE) * _DSHOT_TOP
        return dict.fromkeys(motors, _Scale(low=idle, high=_DSHOT_TOP, said_by="DSHOT_MIN"))
    if highest > _LONGEST_PULSE_US:
        return dict.fromkeys(motors, _Scale(low=0.0, high=_CAN_TOP, said_by="the protocol of CAN"))
    return {motor: _pulses(parameters, bank, index + 1) for motor, (bank, index) in motors.items()}


def _dshot(parameters: Mapping[str, float]) -> bool:
    timers = (whole(parameters, f"PWM_{bank}_TIM{timer}") for bank in _BANKS for timer in range(8))
    return whole(parameters, "DSHOT_CONFIG") > 0 or any(timer in _DSHOT_TIMERS for timer in timers)


def _pulses(parameters: Mapping[str, float], bank: str, number: int) -> _Scale:
    """Limits of an output: its own, those of its bank, those of all; -1 in its own stands for the others."""
    limits, names = list(_USUAL_PULSES_US), []
    for place, end in enumerate(("MIN", "MAX")):
        all_of = [f"PWM_{end}"] if bank == _BANKS[0] else []
        for name in (f"PWM_{bank}_{end}{number}", f"PWM_{bank}_{end}", *all_of):
            if parameters.get(name, 0.0) > 0.0:
                limits[place] = parameters[name]
                names.append(name)
                break
    low, high = limits
    if len(names) < 2 or low >= high:
        return _Scale(low=_USUAL_PULSES_US[0], high=_USUAL_PULSES_US[1], said_by="")
    return _Scale(low=low, high=high, said_by=" and ".join(names))


def _topic(
    topic: str,
    arrays: Mapping[str, AnyArray],
    parameters: Mapping[str, float],
    motors: Mapping[int, tuple[str, int]],
    values: Mapping[int, FloatArray],
    scale: Mapping[int, _Scale],
) -> Topic:
    shares = [
        np.maximum((values[motor] - scale[motor].low) / (scale[motor].high - scale[motor].low), 0.0) for motor in motors
    ]
    demands = expo_thrust(np.stack(shares), parameters.get("THR_MDL_FAC", 0.0))
    kept = np.isfinite(demands).all(axis=0)
    time_s = arrays[f"{topic}/timestamp"].astype(np.float64) * 1e-6
    name = topic.partition(":")[0]
    channels = tuple(
        Channel(name=f"motor_{motor}", unit=STANDARD_UNITS[f"motor_{motor}"], source=f"{name}.output[{index}]")
        for motor, (_, index) in motors.items()
    )
    return Topic(name=name, time_s=time_s[kept], channels=channels, values=demands[:, kept])


def _remarks(scale: Mapping[int, _Scale]) -> Iterator[Finding]:
    assumed = [motor for motor, of in scale.items() if not of.said_by]
    if assumed:
        low, high = _USUAL_PULSES_US
        yield remark(
            "assumed_curve",
            "actuator_outputs",
            f"The log has no PWM limits of {'all' if len(assumed) < len(scale) else 'the'} motors; {low:.0f} to "
            f"{high:.0f} µs were assumed, so that idle and full output may be off.",
            low_us=low,
            high_us=high,
        )
