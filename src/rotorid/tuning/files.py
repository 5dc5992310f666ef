"""Files with gains for an autopilot, and files to go back to the flown ones: text only, nothing is sent.

PX4 takes QGroundControl's ``.params`` and lines for its shell, ArduPilot the ``.param`` of Mission Planner and of
MAVProxy, Betaflight lines of its command line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, TypeAlias

import numpy as np

from rotorid.autopilots.firmware import Version, version_of
from rotorid.errors import UsageError
from rotorid.models.autopilots.betaflight_settings import is_type, types_of

Role: TypeAlias = Literal["proposed", "thrust", "rollback", "filters", "filters_rollback"]

_REAL32, _INT32 = 9, 6

_WHOLE = ("IMU_GYRO_RATEMAX", "IMU_GYRO_DNF_EN", "IMU_GYRO_DNF_HMC", "IMU_GYRO_FFT_EN")
"""Parameters of PX4 that are whole numbers, among those that a loop has."""

_HIDDEN = ("INS_HNTCH_", "INS_HNTC2_")
_LOAD_TWICE = "# load it, restart the autopilot, load it again: a notch has its parameters only after it is enabled"
"""ArduPilot hides parameters of what is off."""

_OLDEST_NAMES, _NEWEST_NAMES = (4, 0), (2025, 12)
"""Versions of Betaflight whose settings are known: since 2025 they are named by year and month."""


def parameter_files(
    autopilot: str, values: Mapping[str, float], *, role: Role, firmware: str = "", profile: int | None = None
) -> dict[str, str]:
    """Files with some parameters, name to text.

    Parameters
    ----------
    autopilot
        ``PX4``, ``ArduPilot`` or ``Betaflight``.
    values
        Parameters of the firmware by name.
    role
        ``proposed`` for new gains, ``thrust`` for another curve of thrust, ``rollback`` for what was flown; ``filters``
        and ``filters_rollback`` for filters alone.
    firmware
        As the log names it; Betaflight's settings have names by version.
    profile
        Of Betaflight, counted from zero; without it the file is for the selected profile, as its comment notes.

    Raises
    ------
    UsageError
        A value is not finite, the autopilot is not known, or the version of a Betaflight is not.

    Examples
    --------
    >>> sorted(parameter_files("ArduPilot", {"ATC_RAT_RLL_P": 0.135}, role="rollback"))
    ['rollback.param']
    """
    if wrong := [name for name, value in values.items() if not math.isfinite(value)]:
        raise UsageError(f"{wrong[0]} = {values[wrong[0]]} is not finite", needed="finite gains")
    if autopilot == "PX4":
        return {f"{role}.params": _qgroundcontrol(values, role), f"{role}.txt": _shell(values)}
    if autopilot == "ArduPilot":
        return {f"{role}.param": _mission_planner(values, role)}
    if autopilot == "Betaflight":
        return {f"{role}.cli.txt": _betaflight(values, role, firmware, profile)}
    raise UsageError(
        f"no file of gains for {autopilot or 'an unknown autopilot'}", needed="PX4, ArduPilot or Betaflight"
    )


_WORDS: Mapping[Role, str] = {
    "proposed": "gains proposed by rotorid",
    "thrust": "thrust linearization, with the flown gains adapted to it: fly it alone",
    "rollback": "flown values, to go back",
    "filters": "filters proposed by rotorid, for the flown gains",
    "filters_rollback": "flown filters, to go back",
}


def _qgroundcontrol(values: Mapping[str, float], role: Role) -> str:
    lines = ["# Onboard parameters for Vehicle 1", "#", f"# {_WORDS[role]}", "#"]
    lines.append("# Vehicle-Id Component-Id Name Value Type")
    for name, value in values.items():
        text = f"{round(value)}\t{_INT32}" if name in _WHOLE else f"{np.float32(value):.18f}\t{_REAL32}"
        lines.append(f"1\t1\t{name}\t{text}")
    return "\n".join(lines) + "\n"


def _shell(values: Mapping[str, float]) -> str:
    return "".join(f"param set {name} {float(np.float32(value)):.9g}\n" for name, value in values.items())


def _mission_planner(values: Mapping[str, float], role: Role) -> str:
    hidden = any(name.startswith(_HIDDEN) and name.endswith("_ENABLE") and value for name, value in values.items())
    lines = [f"# {_WORDS[role]}", *([_LOAD_TWICE] if hidden else [])]
    lines += [f"{name},{float(np.float32(value)):.9g}" for name, value in values.items()]
    return "\n".join(lines) + "\n"


def _betaflight(values: Mapping[str, float], role: Role, firmware: str, profile: int | None) -> str:
    version = version_of(firmware)
    if version is None or not _OLDEST_NAMES <= version <= _NEWEST_NAMES:
        raise UsageError(
            f"the settings of {firmware or 'this Betaflight'} are not known",
            needed="Betaflight 4.0 to 2025.12",
        )
    if broken := [name for name, value in values.items() if value != round(value)]:
        raise UsageError(
            f"{broken[0]} = {values[broken[0]]:g} is not a whole number", needed="whole numbers for Betaflight"
        )
    # Sliders would recompute the gains when the settings are saved.
    sliders = ["set simplified_pids_mode = OFF"] if version >= (4, 3) else []
    if version >= (4, 3):
        sliders += [f"set simplified_{kind}_filter = OFF" for kind in ("dterm", "gyro") if _has(values, kind)]
    selected = "# first select the PID profile and rate profile that were flown" if profile is None else ""
    lines = [f"# {_WORDS[role]}", selected or f"# profile {profile}"]
    if role.endswith("rollback") and sliders:
        lines += ["# the sliders (simplified_...) stay off: if on, they would recompute the gains"]
    lines += ["batch start", *([] if profile is None else [f"profile {profile}"]), *sliders]
    lines += [f"set {name} = {_format_value(name, value, version)}" for name, value in values.items()]
    # An open batch with an error in it refuses to save, as it does in Betaflight's own files.
    return "\n".join([*lines, "save", "batch end"]) + "\n"


def _format_value(name: str, value: float, version: Version) -> str:
    """A value for the command line, where types of low-passes are words."""
    if not is_type(name):
        return str(int(value))
    words = types_of(version)
    if not 0 <= value < len(words):
        known = ", ".join(f"{k} ({word})" for k, word in enumerate(words))
        raise UsageError(f"{name} = {value:g} is not a filter type", needed=f"one of {known}")
    return words[int(value)]


def _has(values: Mapping[str, float], kind: str) -> bool:
    return any(name.startswith(f"{kind}_") for name in values)
