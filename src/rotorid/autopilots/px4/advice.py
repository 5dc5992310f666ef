"""What to change so that the next PX4 log holds more: only what this firmware has, and is not set already."""

from __future__ import annotations

from collections.abc import Mapping

from rotorid.autopilots.firmware import is_before, version_of
from rotorid.autopilots.numbers import whole

_MASK_FROM = (1, 8)
"""From here on ``SDLOG_PROFILE`` is a mask of bits; before, it chose one of three lists."""
_RAW_GYRO_FROM = (1, 12)
_MOTORS_FROM = (1, 13)
_SYSTEM_IDENTIFICATION = 2
"""The list of older firmware that holds rates and commands fastest."""

_PROFILE_BITS = 0b11001
_BITS_TEXT = "bits 0 default set, 3 system identification, 4 high rate"
_RAW_GYRO_BIT = 8
_TOPIC_LIST = "etc/logging/logger_topics.txt on the SD card"
_NAME_IT = f"name the topic in {_TOPIC_LIST} before the next flight"


def log_profile(firmware: str, profile: int = 0) -> int:
    """``SDLOG_PROFILE`` of a test flight: one of three lists before 1.8, then a mask of bits, added to those held.

    Examples
    --------
    >>> log_profile("PX4 v1.6.5"), log_profile("PX4 1.15.0"), log_profile("", 131)
    (2, 25, 155)
    """
    return _SYSTEM_IDENTIFICATION if is_before(firmware, _MASK_FROM) else profile | _PROFILE_BITS


def profile_words(firmware: str) -> str:
    """What that value of ``SDLOG_PROFILE`` means."""
    return "system identification" if is_before(firmware, _MASK_FROM) else _BITS_TEXT


def logging_advice(parameters: Mapping[str, float], firmware: str) -> str:
    """What makes this firmware log commands and rates faster; what does not say its version is taken for today's.

    Parameters
    ----------
    parameters
        The autopilot's.
    firmware
        As it introduces itself: ``PX4 1.15.0``.

    Examples
    --------
    >>> logging_advice({"SDLOG_PROFILE": 0.0}, "PX4 1.6.5")
    'set SDLOG_PROFILE = 2 (system identification, it is 0) before the next flight'
    """
    profile = parameters.get("SDLOG_PROFILE")
    if _without_profile(parameters):
        return f"this firmware has no SDLOG_PROFILE: {_NAME_IT}"
    bits = whole(parameters, "SDLOG_PROFILE")
    wanted = log_profile(firmware, bits)
    if wanted == bits:
        return f"SDLOG_PROFILE = {bits} already logs what helps: {_NAME_IT}"
    now = "" if profile is None else f", it is {bits}"
    return f"set SDLOG_PROFILE = {wanted} ({profile_words(firmware)}{now}) before the next flight"


def raw_gyro_advice(parameters: Mapping[str, float], firmware: str) -> str:
    """How the next log holds the gyro before its filters."""
    if is_before(firmware, _RAW_GYRO_FROM) or _without_profile(parameters):
        return f"fly firmware 1.12 or newer: {_named(firmware)} logs no gyro before its filters"
    profile = whole(parameters, "SDLOG_PROFILE")
    if profile >> _RAW_GYRO_BIT & 1:
        return "bit 8 of SDLOG_PROFILE (raw IMU at its own rate) is already set, but not every sensor provides it"
    return "set bit 8 of SDLOG_PROFILE (raw IMU at its own rate)"


def motor_advice(parameters: Mapping[str, float], firmware: str) -> str:
    """How the next log holds the motors."""
    old = is_before(firmware, _MOTORS_FROM) or _without_profile(parameters)
    topic = "actuator_outputs" if old else "actuator_motors"
    return f"name {topic} in {_TOPIC_LIST}"


def gap_advice(parameters: Mapping[str, float]) -> str:
    """How the next log has no gaps."""
    where = _TOPIC_LIST if _without_profile(parameters) else "SDLOG_PROFILE"
    return f"use a faster SD card or fewer topics ({where})"


def wind_advice(parameters: Mapping[str, float]) -> str:
    """How the estimator finds the wind without a sensor for it; empty where it cannot, or does already."""
    if parameters.get("EKF2_DRAG_CTRL") == 0.0 or not parameters:
        return "set EKF2_DRAG_CTRL = 1 and its coefficients, with which EKF2 estimates it"
    if "EKF2_BCOEF_X" in parameters and not whole(parameters, "EKF2_AID_MASK", 32) & 32:
        return "set bit 5 of EKF2_AID_MASK (drag), EKF2_BCOEF_X and _Y, with which EKF2 estimates it"
    return ""


def _without_profile(parameters: Mapping[str, float]) -> bool:
    """Whether parameters are those of a firmware before 1.6: a log without any may be of today."""
    return bool(parameters) and "SDLOG_PROFILE" not in parameters


def _named(firmware: str) -> str:
    return firmware if version_of(firmware) else "this firmware"
