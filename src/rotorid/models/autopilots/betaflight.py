r"""Betaflight's rate controller and its angle mode, from the settings in the header of a blackbox log.

.. math:: u = \frac{1}{1000} \left[ K_P P F_P e + K_I I \int e \, dt - K_D D \, \frac{d}{dt} F_D \omega \right],
    \qquad e = \omega_{sp} - \omega

with rates in deg/s, and the command as a share of the motors' range. The derivative is that of the rate behind its own
notch and two low-passes, the first of which moves with the throttle. F, the feed-forward, is taken of the sticks alone
and stands outside of every loop.

What moves in flight: D between ``d_min`` and D (until 4.5) or D and ``d_max`` (later), so that there are two ends; D,
and P too where ``tpa_mode`` says so, fall above the breakpoint of TPA; the integral sees less of an error while the
set-point moves (iterm relax), and more in throttle transients (anti-gravity).

References
----------
``src/main/flight/pid.c``, ``pid_init.c``, ``src/main/common/filter.c`` and ``src/main/blackbox/blackbox.c`` of
betaflight/betaflight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from rotorid.autopilots.betaflight.autopilot import BETAFLIGHT
from rotorid.autopilots.firmware import Version, version_of
from rotorid.autopilots.numbers import whole
from rotorid.models.autopilots.betaflight_settings import (
    NAMED_BY_NUMBER,
    angle_name,
    command_line_name,
    header_name,
)
from rotorid.models.autopilots.settings import AxisController, present
from rotorid.models.controller import RateController
from rotorid.models.loop_filter import FilterKind, LoopFilter
from rotorid.typing import Axis

NAME = BETAFLIGHT.name
OLDEST: Version = (4, 0)
"""Older versions have other scales and another derivative."""

BASE, TOP = "D at its base", "D at its top"
"""Names of the two ends between which D moves."""

_AXES: Mapping[Axis, int] = MappingProxyType({"roll": 0, "pitch": 1, "yaw": 2})
_PER_RAD_S = 180.0 / math.pi / 1000.0
PER_P, PER_I, PER_D = 0.032029 * _PER_RAD_S, 0.244381 * _PER_RAD_S, 0.000529 * _PER_RAD_S
"""Command per rad/s, per rad and per rad/s² of one step of each setting."""

YAW_I = 2.5
"""Factor on I of yaw."""

_KINDS: Mapping[int, FilterKind] = MappingProxyType({0: "PT1", 1: "Butterworth", 2: "PT2", 3: "PT3"})
_LOW_PASSES_OF_D = (
    "dterm_lpf1_type",
    "dterm_lpf1_static_hz",
    "dterm_lpf1_dyn_hz_0",
    "dterm_lpf1_dyn_hz_1",
    "dterm_lpf1_dyn_expo",
    "dterm_lpf2_type",
    "dterm_lpf2_static_hz",
)
_OLDER_LOW_PASSES_OF_D = (
    "dterm_filter_type",
    "dterm_lowpass_hz",
    "dterm_lowpass_dyn_hz_0",
    "dterm_lowpass_dyn_hz_1",
    "dterm_filter2_type",
    "dterm_lowpass2_hz",
)
_CURVE_SINCE: Version = (4, 2)
_ANGLE_FILTER_SINCE: Version = (4, 5)
CHANGES: tuple[Version, ...] = (_CURVE_SINCE, NAMED_BY_NUMBER, _ANGLE_FILTER_SINCE)
"""Versions that compute a controller in another way than those before, from the same settings."""

_ANGLE_FILTER_HZ = 50.0
_EXPO = 5.0
_BREAKPOINT_US, _TPA_OF_BOTH = (1000.0, 2000.0), 0.0
_LARGEST = 1e6
_SLOWEST_HZ = 1.0


def is_other_program(firmware: str) -> bool:
    """Whether a blackbox log comes from a program with Betaflight's parameter names and another controller.

    Examples
    --------
    >>> is_other_program("INAV 7.1.2 (f5c7a1e) MATEKF405"), is_other_program("Betaflight 4.3.1 (8d4f005) STM32F405")
    (True, False)
    """
    return "INAV" in firmware


def read(
    parameters: Mapping[str, float],
    axis: Axis,
    *,
    firmware: str = "",
    loop_rate_hz: float | None = None,
    throttle: float = 0.0,
) -> AxisController | None:
    """The controller of an axis, or ``None`` where the settings are not Betaflight's, or of an unknown version.

    Its D is the one at the base; ``ends`` has both where D moves.

    Parameters
    ----------
    parameters, axis, firmware, loop_rate_hz
        As for :func:`rotorid.models.autopilots.reading.axis_controller`.
    throttle
        Share of the throttle that was flown, which moves TPA and the low-pass of the derivative.
    """
    version = None if is_other_program(firmware) else version_of(firmware)
    parameters = {**as_in_header(parameters), **parameters}
    if axis not in _AXES or f"{axis}PID_P" not in parameters or version is None or version < OLDEST:
        return None
    index, yaw = _AXES[axis], axis == "yaw"
    p, i, d = (float(parameters.get(f"{axis}PID_{letter}", 0.0)) for letter in "PID")
    level = 0.0 if yaw else float(parameters.get("levelPID_P", 0.0))
    base, top = _derivatives(parameters, index, d)
    if not (p or i or base or top) or not all(0.0 <= number <= _LARGEST for number in (p, i, base, top, level)):
        return None
    if yaw and parameters.get("use_integrated_yaw", 0.0) > 0.0:
        # What is integrated is the whole sum: another controller.
        return None
    of_p, of_d = _attenuation(parameters, throttle)
    rate_hz = _loop_rate_hz(parameters) if loop_rate_hz is None else loop_rate_hz
    filters = _derivative_filters(parameters, version, throttle, rate_hz)
    controller = RateController(
        proportional_s=PER_P * p * of_p,
        integral=PER_I * i * (YAW_I if yaw else 1.0),
        derivative_s2=PER_D * base * of_d,
        angle_1_s=level / 10.0,
        derivative_filters=filters,
        proportional_cutoff_hz=max(float(parameters.get("yaw_lowpass_hz", 0.0)), 0.0) if yaw else 0.0,
        angle_filters=(LoopFilter(kind="PT3", frequency_hz=_ANGLE_FILTER_HZ),)
        if level and version >= _ANGLE_FILTER_SINCE
        else (),
        step_s=1.0 / rate_hz if rate_hz > 0.0 else 0.0,
    )
    ends = {BASE: controller, TOP: replace(controller, derivative_s2=PER_D * top * of_d)} if top > base else {}
    return AxisController(
        autopilot=NAME,
        firmware=firmware,
        axis=axis,
        controller=controller,
        gains=_gains(parameters, axis, index, version),
        filters=_filters(parameters, yaw=yaw, version=version),
        ends=ends,
        left={letter: share for letter, share in (("P", of_p), ("D", of_d)) if share < 1.0},
        notes=tuple(_notes(parameters, throttle, yaw=yaw)),
    )


def as_in_header(parameters: Mapping[str, float]) -> dict[str, float]:
    """Settings by the names of the header, from those of the command line, which results keep.

    Examples
    --------
    >>> as_in_header({"p_roll": 40.0, "d_min_yaw": 0.0, "dterm_lpf1_dyn_max_hz": 150.0})
    {'rollPID_P': 40.0, 'd_min_2': 0.0, 'dterm_lpf1_dyn_hz_1': 150.0}
    """
    names = {f"{letter.lower()}_{axis}": f"{axis}PID_{letter}" for axis in _AXES for letter in "PID"}
    numbered = {"f": "ff_weight", "d_min": "d_min", "d_max": "d_max"}
    names |= {f"{word}_{axis}": f"{name}_{k}" for axis, k in _AXES.items() for word, name in numbered.items()}
    # The first is what results had once.
    names |= dict.fromkeys(("p_level", "angle_level_strength", "angle_p_gain"), "levelPID_P")
    names |= {name: header_name(name) for name in parameters if header_name(name) != name}
    return {names[name]: float(value) for name, value in parameters.items() if name in names}


def _derivatives(parameters: Mapping[str, float], index: int, d: float) -> tuple[float, float]:
    """D at its base and at its top."""
    top, least = parameters.get(f"d_max_{index}", 0.0), parameters.get(f"d_min_{index}", 0.0)
    if f"d_max_{index}" in parameters:
        return d, max(top, d)
    return (float(least), d) if 0.0 < least < d else (d, d)


def _loop_rate_hz(parameters: Mapping[str, float]) -> float:
    looptime_us, denominator = parameters.get("looptime", 0.0), parameters.get("pid_process_denom", 1.0)
    return 1e6 / (looptime_us * denominator) if looptime_us > 0.0 and denominator >= 1.0 else 0.0


def _attenuation(parameters: Mapping[str, float], throttle: float) -> tuple[float, float]:
    """What TPA leaves of P and of D."""
    low, high = _BREAKPOINT_US
    start = min(max((parameters.get("tpa_breakpoint", high) - low) / (high - low), 0.0), 1.0 - 1e-6)
    share = min(max(parameters.get("tpa_rate", 0.0) / 100.0, 0.0), 1.0)
    left = 1.0 - share * max(0.0, min(throttle, 1.0) - start) / (1.0 - start)
    # The names of the modes are P and D, and D alone.
    return (left if parameters.get("tpa_mode", 1.0) == _TPA_OF_BOTH else 1.0), left


def _derivative_filters(
    parameters: Mapping[str, float], version: Version, throttle: float, rate_hz: float
) -> tuple[LoopFilter, ...]:
    found: list[LoopFilter | None] = [_notch(parameters, rate_hz)]
    names = (("dterm_lpf1_type", "dterm_filter_type"), ("dterm_lpf2_type", "dterm_filter2_type"))
    cutoffs_hz = (
        _moving_cutoff_hz(parameters, version, throttle),
        _first(parameters, ("dterm_lpf2_static_hz", "dterm_lowpass2_hz")),
    )
    for kinds, cutoff_hz in zip(names, cutoffs_hz, strict=True):
        code = int(_first(parameters, kinds))
        if cutoff_hz >= _SLOWEST_HZ and code in _KINDS and (code < 2 or version >= NAMED_BY_NUMBER):
            found.append(LoopFilter(kind=_KINDS[code], frequency_hz=cutoff_hz))
    return tuple(loop_filter for loop_filter in found if loop_filter is not None)


def _moving_cutoff_hz(parameters: Mapping[str, float], version: Version, throttle: float) -> float:
    r"""Cutoff of the first low-pass at a throttle :math:`t`.

    .. math:: f = f_0 + (f_1 - f_0) \left(t + t (1 - t) \frac{\text{expo}}{10}\right)

    and before version 4.2 :math:`f = \max(f_0, \tfrac32 t (1 - t^2 / 3) f_1)`.
    """
    low, high = (_first(parameters, (f"dterm_lpf1_dyn_hz_{end}", f"dterm_lowpass_dyn_hz_{end}")) for end in range(2))
    if not low > 0.0:
        return _first(parameters, ("dterm_lpf1_static_hz", "dterm_lowpass_hz"))
    t = min(max(throttle, 0.0), 1.0)
    if version < _CURVE_SINCE:
        return max(low, 1.5 * t * (1.0 - t * t / 3.0) * high)
    expo = parameters.get("dterm_lpf1_dyn_expo", _EXPO)
    return low + max(high - low, 0.0) * (t + t * (1.0 - t) * expo / 10.0)


def _notch(parameters: Mapping[str, float], rate_hz: float) -> LoopFilter | None:
    center_hz, cutoff_hz = (parameters.get(f"dterm_notch_{name}", 0.0) for name in ("hz", "cutoff"))
    if rate_hz > 0.0:
        center_hz = min(center_hz, 0.5 * rate_hz)
    # Whole numbers of hertz: what is less is damage.
    if not _SLOWEST_HZ <= cutoff_hz < center_hz:
        return None
    quality = center_hz * cutoff_hz / (center_hz**2 - cutoff_hz**2)
    return LoopFilter(kind="notch", frequency_hz=center_hz, quality=quality)


def _first(parameters: Mapping[str, float], names: tuple[str, ...]) -> float:
    return float(next((parameters[name] for name in names if name in parameters), 0.0))


def _gains(parameters: Mapping[str, float], axis: Axis, index: int, version: Version) -> dict[str, float]:
    """Gains by the names of the command line, which the header does not use."""
    named = {
        f"p_{axis}": f"{axis}PID_P",
        f"i_{axis}": f"{axis}PID_I",
        f"d_{axis}": f"{axis}PID_D",
        f"f_{axis}": f"ff_weight_{index}",
        f"d_min_{axis}": f"d_min_{index}",
        f"d_max_{axis}": f"d_max_{index}",
        angle_name(version): "levelPID_P",
        "tpa_rate": "tpa_rate",
        "tpa_breakpoint": "tpa_breakpoint",
        "tpa_mode": "tpa_mode",
        "iterm_relax": "iterm_relax",
        "iterm_relax_cutoff": "iterm_relax_cutoff",
        "pidsum_limit_yaw" if axis == "yaw" else "pidsum_limit": "pidsum_limit_yaw"
        if axis == "yaw"
        else "pidsum_limit",
    }
    if axis == "yaw":
        named = {name: source for name, source in named.items() if source != "levelPID_P"}
    return {name: float(parameters[source]) for name, source in named.items() if source in parameters}


def _filters(parameters: Mapping[str, float], *, yaw: bool, version: Version) -> dict[str, float]:
    """Filters by the names of the command line."""
    own = ("dterm_notch_hz", "dterm_notch_cutoff", *(["yaw_lowpass_hz"] if yaw else []))
    names = _LOW_PASSES_OF_D if version >= NAMED_BY_NUMBER else _OLDER_LOW_PASSES_OF_D
    return {command_line_name(name): value for name, value in present(parameters, (*names, *own)).items()}


def _notes(parameters: Mapping[str, float], throttle: float, *, yaw: bool) -> list[str]:
    notes = []
    relax = whole(parameters, "iterm_relax")
    # 1 and 3: roll and pitch; 2 and 4: yaw too.
    if relax in ((2, 4) if yaw else (1, 2, 3, 4)):
        notes.append(
            "iterm_relax reduces the integral while the set-point moves: at low frequencies the flown loop has less "
            "integral action than in hover."
        )
    if min(_attenuation(parameters, throttle)) < 1.0:
        notes.append(f"TPA had lowered the gains at the flown throttle of {100.0 * throttle:.0f} %.")
    if parameters.get("anti_gravity_gain", 0.0) > 0.0:
        notes.append("anti_gravity raises the integral while the throttle moves.")
    if parameters.get("abs_control_gain", 0.0) > 0.0:
        notes.append("abs_control_gain adds a part that is not modeled.")
    return notes
