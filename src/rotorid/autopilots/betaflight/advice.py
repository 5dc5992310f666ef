"""What to change so that the next blackbox log holds more, by what each version of Betaflight calls it.

References
----------
``src/main/cli/settings.c`` and ``src/main/blackbox/blackbox.c`` of betaflight/betaflight at 4.0, 4.2, 4.3 and 4.5.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from rotorid.autopilots.autopilot import BY_DSHOT
from rotorid.autopilots.firmware import Version, is_before

_RATIO_FROM = (4, 0)
"""From here on the logging rate is called ``blackbox_p_ratio``, and set-points are logged."""

_FIELDS_FROM = (4, 3)
"""From here on the rate is called ``blackbox_sample_rate``, and fields can be left out (``blackbox_disable_*``)."""

_UNFILTERED_FROM = (4, 5)
"""From here on ``gyroUnfilt`` is a field of its own; before, a debug mode shows it."""

_SHOWN_FROM, _SCALED_FROM = (3, 1), (3, 4)
"""From here on that mode is read, and from here on it is called ``GYRO_SCALED``; before, ``GYRO``."""

_SPEEDS_FROM = (4, 5)
"""From here on ``eRPM`` is a field."""

_FIELDS: Mapping[str, str] = MappingProxyType({"motor_": "motors", "_stick": "rc", "_command": "pids"})
"""A part of the name of a channel, and the field of the blackbox that holds it."""

_GYRO, _ACCELEROMETER = ("p", "q", "r"), ("ax", "ay", "az")
_SETPOINTS = tuple(f"{rate}_setpoint" for rate in _GYRO)
_OTHERS = re.compile("INAV|Cleanflight|EmuFlight", re.IGNORECASE)
"""Firmware with blackboxes of the same format, whose settings are not known here."""


def rate_advice(firmware: str) -> str:
    """How the next log is fast enough for loops and vibration.

    Examples
    --------
    >>> rate_advice("Betaflight 4.5.1"), rate_advice("Betaflight 4.2.0")
    ('set blackbox_sample_rate for 1 kHz or more', 'set blackbox_p_ratio for 1 kHz or more')
    """
    if _before(firmware, _RATIO_FROM):
        return "set the blackbox's logging rate to 1 kHz or more in the Configurator"
    return f"set {'blackbox_p_ratio' if _before(firmware, _FIELDS_FROM) else 'blackbox_sample_rate'} for 1 kHz or more"


def field_advice(firmware: str, channels: tuple[str, ...]) -> str:
    """How the next log holds channels that this one lacks, empty where no setting adds them; faster, where none is.

    Parameters
    ----------
    firmware
        As it introduces itself: ``Betaflight 4.3.1 (8d4f005) STM32F7X2``.
    channels
        Names of those that are missing.

    Examples
    --------
    >>> field_advice("Betaflight 4.4.0", ("p_setpoint",)), field_advice("Betaflight 3.1.5", ("p_setpoint",))
    ('set blackbox_disable_setpoint = OFF', 'fly Betaflight 4.0 or newer, which logs the set-points')
    """
    if not channels:
        return rate_advice(firmware)
    return " and ".join(dict.fromkeys(step for channel in channels if (step := _step(firmware, channel))))


def raw_gyro_advice(firmware: str) -> str:
    """How the next log holds the gyro before its filters."""
    if _OTHERS.match(firmware):
        return ""
    if _before(firmware, _SHOWN_FROM):
        return "fly Betaflight 4.0 or newer with debug_mode = GYRO_SCALED"
    if _before(firmware, _UNFILTERED_FROM):
        return f"set debug_mode = {'GYRO' if _before(firmware, _SCALED_FROM) else 'GYRO_SCALED'}"
    return "set blackbox_disable_gyrounfilt = OFF"


def speed_advice(firmware: str) -> str:
    """How the next log holds the speeds of the motors."""
    if not _OTHERS.match(firmware) and _before(firmware, _SPEEDS_FROM):
        return "fly Betaflight 4.5 or newer, which logs the motors' speeds, with dshot_bidir = ON"
    return BY_DSHOT


def gap_advice(firmware: str) -> str:
    """How the next log has no gaps."""
    if _before(firmware, _RATIO_FROM):
        return "lower the blackbox's logging rate in the Configurator, or use a faster card"
    name = "blackbox_p_ratio" if _before(firmware, _FIELDS_FROM) else "blackbox_sample_rate"
    return f"lower the logging rate ({name}), or use a faster card"


def _step(firmware: str, channel: str) -> str:
    if _OTHERS.match(firmware):
        return ""
    if channel in _SETPOINTS and _before(firmware, _RATIO_FROM):
        return "fly Betaflight 4.0 or newer, which logs the set-points"
    chosen = not _before(firmware, _FIELDS_FROM)
    if channel in _ACCELEROMETER:
        return f"set {'blackbox_disable_acc = OFF' if chosen else 'blackbox_record_acc = ON'}"
    if not chosen:
        # Older ones log all of these whatever is set.
        return ""
    if channel in _GYRO:
        return "set blackbox_disable_gyro = OFF"
    field = "setpoint" if channel in _SETPOINTS else next((_FIELDS[part] for part in _FIELDS if part in channel), "")
    return f"set blackbox_disable_{field} = OFF" if field else ""


def _before(firmware: str, version: Version) -> bool:
    """Whether firmware is known to be older; other programs branched off an old one."""
    return bool(_OTHERS.match(firmware)) or is_before(firmware, version)
