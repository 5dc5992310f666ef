"""What to change so that the next ArduPilot log holds more: only what this firmware has, and is not set already."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType

from rotorid.autopilots.ardupilot.firmware import RATE_FROM, Firmware, named
from rotorid.autopilots.ardupilot.system_id import RULES, SID_AXIS, start_mode
from rotorid.autopilots.autopilot import BY_DSHOT
from rotorid.autopilots.numbers import whole
from rotorid.data.display import listed
from rotorid.data.findings import Finding, Severity, remark, warn
from rotorid.data.record import LOWEST_RATE_HZ, Topic
from rotorid.typing import Axis

_LOOP_BY_LOOP = 0.75
"""Below this part of the loop's rate at most every second sample was logged."""

_BITS: Mapping[int, str] = MappingProxyType({0: "fast attitude", 1: "medium attitude", 18: "fast IMU"})
"""Bits of ``LOG_BITMASK`` that a log for identification has, and their names in the documentation. Bit 0 logs ``RATE``
in every loop, bit 18 ``IMU``; with bits 0 and 1 SYSTEMID mode logs its own messages in every loop."""

_MESSAGE_BITS: Mapping[str, int] = MappingProxyType({"RATE": 0, "IMU": 18})
_EVERY_LOOP = (0, 1)

_LIMITS = ((1, "LOG_FILE_RATEMAX"), (2, "LOG_MAV_RATEMAX"), (4, "LOG_BLK_RATEMAX"))
"""Bit of ``LOG_BACKEND_TYPE``, and the parameter that limits how often that backend writes each message."""

_AT_LIMIT = 1.2

_BATCHES = MappingProxyType({"INS_LOG_BAT_MASK": 1, "INS_LOG_BAT_OPT": 4})
_OUTPUTS_BIT = 10
_SLOW_OUTPUTS = "ten times a second whatever LOG_BITMASK says"

_ESC_FROM = (3, 6)
"""The first copter firmware that logs what motor controllers send."""

_SERVO = re.compile(r"SERVO\d+_FUNCTION")


def missing_rate(firmware: Firmware, parameters: Mapping[str, float]) -> Finding:
    """Why a log has no ``RATE`` message, and what can be done about it."""
    reason = "the log has no RATE messages, so that the mixer's inputs are not known"
    if firmware.before(RATE_FROM):
        remedy = f"{firmware.text} has no such message; firmware 3.4 and newer logs it"
    elif _mask(parameters) & 1:
        remedy = "bit 0 (fast attitude) of LOG_BITMASK is set already: the log is cut, or the storage was too slow"
    else:
        remedy = _set_mask(parameters, (0,))
    return warn("missing_channel", "RATE", f"{reason}; {remedy}")


def decimation_findings(
    topics: Sequence[Topic], tops_rad_s: Sequence[float], parameters: Mapping[str, float]
) -> Iterator[Finding]:
    """Rates of a SYSTEMID log that hold every n-th sample of the loop, without a filter in front.

    Vibration above half the rate of the log then appears as slower motion, in the band of the response or outside. The
    remark is a warning where the sweeps themselves come within a factor of two of that limit: there the response's own
    content is folded.

    Parameters
    ----------
    tops_rad_s
        Highest frequency that each SYSTEMID run reached, zero where it is not known; empty: nothing was swept.
    parameters
        The autopilot's.
    """
    loop_hz = parameters.get("SCHED_LOOP_RATE", 0.0)
    reached_hz = max(tops_rad_s, default=0.0) / (2.0 * math.pi)
    if not tops_rad_s:
        return
    remedy = f"; {_set_mask(parameters, _EVERY_LOOP)}" if _unset(parameters, _EVERY_LOOP) else ""
    for topic in topics:
        rate_hz = topic.sample_rate_hz
        named = topic.name == "RATE" or topic.name.startswith("SIDD")
        if not named or not 0.0 < rate_hz < _LOOP_BY_LOOP * loop_hz:
            continue
        yield (warn if 2.0 * reached_hz > 0.5 * rate_hz else remark)(
            "decimated",
            topic.name,
            f"{topic.name} was logged at {rate_hz:.0f} Hz out of a loop of {loop_hz:.0f} Hz, one sample in "
            f"{loop_hz / rate_hz:.0f} without a filter in front: what the vehicle does above "
            f"{0.5 * rate_hz:.0f} Hz, vibration above all, folds into the response{remedy}",
            rate_hz=rate_hz,
            loop_hz=loop_hz,
            nyquist_hz=0.5 * rate_hz,
            sweep_top_hz=reached_hz,
        )


def slow_topics(topics: Sequence[Topic], parameters: Mapping[str, float], firmware: Firmware) -> Iterator[Finding]:
    """Topics too slow for what they are needed for, with the parameter to change."""
    rates = message_rates_hz(topics)
    for name in _MESSAGE_BITS:
        if rates.get(name, LOWEST_RATE_HZ) < LOWEST_RATE_HZ:
            yield _too_slow(name, rates[name], "warning", logging_advice(parameters, firmware.text, rates[name], rates))
    if rates.get("RCOU", LOWEST_RATE_HZ) < LOWEST_RATE_HZ:
        usable = rates.get("RATE", 0.0) >= LOWEST_RATE_HZ
        remedy = _limit(rates["RCOU"], parameters)
        if not remedy:
            old = firmware.before(RATE_FROM)
            mixer = "this firmware logs no mixer inputs" if old else "use the mixer's inputs in RATE"
            remedy = f"ArduPilot writes it {_SLOW_OUTPUTS}: {mixer}"
        yield _too_slow("RCOU", rates["RCOU"], "info" if usable else "warning", remedy)


def message_rates_hz(topics: Sequence[Topic]) -> dict[str, float]:
    """How often each message was logged."""
    return {topic.name: topic.sample_rate_hz for topic in topics if topic.time_s.size > 1}


def logging_advice(
    parameters: Mapping[str, float], firmware: str, rate_hz: float, rates_hz: Mapping[str, float] = MappingProxyType({})
) -> str:
    """How the next log gets commands and rates fast enough, by what this one has: one answer for all of them.

    Parameters
    ----------
    parameters
        The autopilot's.
    firmware
        As it introduces itself.
    rate_hz
        Rate of the slowest channel that is needed; zero where it is not logged.
    rates_hz
        Of the messages in the log, see :func:`message_rates_hz`.

    Examples
    --------
    >>> logging_advice({"LOG_BITMASK": 176126.0}, "ArduCopter V4.6.2", 10.0)
    'set LOG_BITMASK = 438271 (it is 176126; bits 0 fast attitude, 18 fast IMU are missing)'
    """
    known = named(firmware)
    if known.before(RATE_FROM):
        return f"fly firmware 3.4 or newer: {firmware} logs neither the mixer's inputs nor rates at the loop's rate"
    if limit := _limit(rate_hz, parameters):
        return limit
    # Of a storage that loses what it is asked for already, more is not asked.
    starved = _mask(parameters) & 1 and 0.0 < rates_hz.get("RATE", 0.0) < LOWEST_RATE_HZ
    if starved or not _unset(parameters, _MESSAGE_BITS.values()):
        logged = "fast attitude" if starved else "fast attitude and fast IMU"
        return f"LOG_BITMASK logs {logged} already: the autopilot's loop or its storage is too slow"
    return _set_mask(parameters, _MESSAGE_BITS.values())


def raw_gyro_advice(parameters: Mapping[str, float], firmware: str) -> str:
    """How the next log holds the gyro before and behind its filters."""
    if parameters and not any(name in parameters for name in _BATCHES):
        return f"{firmware or 'this firmware'} logs no gyro before its filters"
    missing = [f"{name} = {value}" for name, value in _BATCHES.items() if not whole(parameters, name) & value]
    if not missing:
        return "INS_LOG_BAT_MASK and INS_LOG_BAT_OPT ask for it already: the storage was too slow for its batches"
    return f"set {' and '.join(missing)} (batches before and behind the filters)"


def sensor_advice(
    parameters: Mapping[str, float], firmware: str, rate_hz: float, rates_hz: Mapping[str, float] = MappingProxyType({})
) -> str:
    """How the next log holds the sensors fast enough for vibration."""
    advice = logging_advice(parameters, firmware, rate_hz, rates_hz)
    if parameters and parameters.get("INS_LOG_BAT_MASK") != 0.0:
        return advice
    return f"set INS_LOG_BAT_MASK = 1, or {advice}" if advice.startswith("set ") else "set INS_LOG_BAT_MASK = 1"


def motor_advice(parameters: Mapping[str, float]) -> str:
    """How the next log holds the motors."""
    logged = _mask(parameters) >> _OUTPUTS_BIT & 1
    steps = [] if logged else [f"log RCOU (bit {_OUTPUTS_BIT} of LOG_BITMASK)"]
    assigned = any(33.0 <= value <= 40.0 for name, value in parameters.items() if _SERVO.fullmatch(name))
    if not assigned and (not parameters or "SERVO1_FUNCTION" in parameters):
        steps.append("set SERVOn_FUNCTION of the motors")
    return " and ".join(steps)


def slow_motor_advice(rates_hz: Mapping[str, float]) -> str:
    """Why the motors are slow although ``RATE``, whose commands a mixer turns into motors, is fast; else empty."""
    fast = rates_hz.get("RATE", 0.0) >= LOWEST_RATE_HZ
    return f"ArduPilot writes RCOU {_SLOW_OUTPUTS}" if fast else ""


def speed_advice(firmware: str) -> str:
    """How the next log holds the speeds of the motors."""
    if named(firmware).before(_ESC_FROM):
        return f"fly firmware 4.0 or newer: {firmware} logs no motor speeds"
    return BY_DSHOT


def wind_advice(parameters: Mapping[str, float]) -> str:
    """How the estimator finds the wind without a sensor for it; empty where it cannot, or does already."""
    if parameters and parameters.get("EK3_DRAG_BCOEF_X") != 0.0:
        return ""
    return "set EK3_DRAG_BCOEF_X and _Y, with which EKF3 estimates it"


def flies_system_id(parameters: Mapping[str, float], firmware: str) -> bool:
    """Whether this firmware has SYSTEMID mode: not before 4.0, nor where boards without room are built without it."""
    return not named(firmware).before(RULES[0].since) and (not parameters or "SID_AXIS" in parameters)


def flying_advice(parameters: Mapping[str, float], firmware: str, *axes: Axis) -> str:
    """How to fly excitations of axes: added to the mixer's inputs by a firmware that has such a mode."""
    if not flies_system_id(parameters, firmware):
        return f"sweep the {listed(axes)} stick, slow to fast, for a minute or more"
    numbers = [SID_AXIS["command", axis] for axis in axes]
    mode = start_mode(numbers[0]).words
    return f"fly SYSTEMID mode with SID_AXIS {listed([str(number) for number in numbers])}, entered from {mode}"


def _mask(parameters: Mapping[str, float]) -> int:
    return whole(parameters, "LOG_BITMASK")


def _limit(rate_hz: float, parameters: Mapping[str, float]) -> str:
    """The parameter that holds a message down to this rate, if there is one."""
    backend = whole(parameters, "LOG_BACKEND_TYPE")
    for bit, name in _LIMITS:
        limit_hz = parameters.get(name, 0.0)
        if backend & bit and 0.0 < rate_hz <= _AT_LIMIT * limit_hz:
            return f"{name} = {limit_hz:g} limits every message to {limit_hz:g} Hz: set it to 0, which is no limit"
    return ""


def _unset(parameters: Mapping[str, float], bits: Iterable[int]) -> list[int]:
    return [bit for bit in bits if not _mask(parameters) >> bit & 1]


def _set_mask(parameters: Mapping[str, float], needed: Iterable[int]) -> str:
    """The value of ``LOG_BITMASK`` with all that an identification needs: the same whatever of it is missing."""
    mask = _mask(parameters)
    wanted = mask | sum(1 << bit for bit in _BITS)
    missing = ", ".join(f"{bit} {_BITS[bit]}" for bit in _unset(parameters, needed))
    many = "," in missing
    lacking = f"bit{'s' if many else ''} {missing} {'are' if many else 'is'} missing"
    if not mask:
        return f"set bits {', '.join(f'{bit} ({meaning})' for bit, meaning in _BITS.items())} of LOG_BITMASK"
    return f"set LOG_BITMASK = {wanted} (it is {mask}; {lacking})"


def _too_slow(name: str, rate_hz: float, severity: Severity, remedy: str) -> Finding:
    return Finding(
        kind="rate_too_low",
        severity=severity,
        where=name,
        message=f"{name} was logged at {rate_hz:.1f} Hz, too slow for motor-level work, which needs at least "
        f"{LOWEST_RATE_HZ:.0f} Hz; {remedy}",
        numbers={"rate_hz": rate_hz, "needed_hz": LOWEST_RATE_HZ},
    )
