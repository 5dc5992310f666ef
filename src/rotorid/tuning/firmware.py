"""Gains by the names, ranges and steps of each firmware.

A firmware keeps a gain as a number of 32 bits, Betaflight as an integer: a proposal is rounded to what the vehicle will
hold, and judged as that. Ranges are those of the firmwares' own parameter descriptions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.autopilots.betaflight import PER_D, PER_I, PER_P, YAW_I
from rotorid.models.autopilots.betaflight_settings import angle_name
from rotorid.models.autopilots.settings import AxisController, Version, version_of
from rotorid.tuning.loops import Gains
from rotorid.typing import Axis


class Parameter(NamedTuple):
    """A parameter of a firmware that holds a gain.

    Parameters
    ----------
    name
        As the firmware has it.
    low, high
        Range that it takes.
    per_si
        What a gain in SI is divided by to give its value.
    integer
        Whether it is a whole number.
    shared
        Whether another axis has the same one.
    """

    name: str
    low: float
    high: float
    per_si: float = 1.0
    integer: bool = False
    shared: bool = False


_PX4: Mapping[Axis, tuple[str, float, float, float]] = MappingProxyType(
    {"roll": ("ROLL", 0.5, 0.01, 12.0), "pitch": ("PITCH", 0.6, 0.01, 12.0), "yaw": ("YAW", 0.6, 0.0, 5.0)}
)
_ARDUPILOT: Mapping[Axis, str] = MappingProxyType({"roll": "RLL", "pitch": "PIT", "yaw": "YAW"})
_ARDUPILOT_RANGES = {
    False: {"P": (0.01, 0.5), "I": (0.01, 2.0), "D": (0.0, 0.05), "A": (3.0, 12.0)},
    True: {"P": (0.1, 2.5), "I": (0.01, 1.0), "D": (0.0, 0.02), "A": (3.0, 12.0)},
}
_BETAFLIGHT_250_SINCE: Version = (4, 3)
_MOST_OF_BETAFLIGHT, _MOST_OF_OLDER, _MOST_ANGLE = 250.0, 200.0, 200.0
_MOST_F, _MOST_F_OF_OLDER, _MOST_D_MIN_OF_OLDER = 1000.0, 2000.0, 100.0
_SAME = 1e-6

_LEAST_LEFT = 0.05
"""What TPA has to leave of a gain for it to be proposed."""


def parameters_of(controller: AxisController) -> dict[str, Parameter]:
    """The parameters that hold P, I, D and A of an axis, as far as its firmware has them.

    Parameters
    ----------
    controller
        As the log tells it.

    Raises
    ------
    UsageError
        Its firmware is not known.

    Examples
    --------
    >>> from rotorid.models.autopilots import axis_controller
    >>> yaw = axis_controller({"MC_YAWRATE_P": 0.2, "MC_YAWRATE_I": 0.1, "MC_YAW_P": 2.8}, "yaw")
    >>> parameters_of(yaw)["A"].name, parameters_of(yaw)["P"].high
    ('MC_YAW_P', 0.6)
    """
    axis, gains = controller.axis, controller.gains
    if controller.autopilot == "PX4":
        name, most, least, fastest = _PX4[axis]
        # K and P are one number written twice: K stays.
        factor = gains.get(f"MC_{name}RATE_K", 1.0) or 1.0
        slopes = math.inf if axis == "yaw" else 0.01
        found = {
            "P": Parameter(f"MC_{name}RATE_P", least, most, factor),
            "I": Parameter(f"MC_{name}RATE_I", 0.0, math.inf, factor),
            "D": Parameter(f"MC_{name}RATE_D", 0.0, slopes, factor),
            "A": Parameter(f"MC_{name}_P", 0.0, fastest),
        }
    elif controller.autopilot == "ArduPilot":
        name, ranges = _ARDUPILOT[axis], _ARDUPILOT_RANGES[axis == "yaw"]
        found = {letter: Parameter(f"ATC_RAT_{name}_{letter}", *ranges[letter]) for letter in "PID"}
        found["A"] = Parameter(f"ATC_ANG_{name}_P", *ranges["A"])
    elif controller.autopilot == "Betaflight":
        scales = {"P": PER_P, "I": PER_I * (YAW_I if axis == "yaw" else 1.0), "D": PER_D}
        # Gains are those at the flown throttle, where TPA had lowered what the parameters say.
        scales = {letter: scale * controller.left.get(letter, 1.0) for letter, scale in scales.items()}
        version = version_of(controller.firmware) or _BETAFLIGHT_250_SINCE
        most = _MOST_OF_BETAFLIGHT if version >= _BETAFLIGHT_250_SINCE else _MOST_OF_OLDER
        found = {
            letter: Parameter(f"{letter.lower()}_{axis}", 0.0, most, scale, integer=True)
            for letter, scale in scales.items()
        }
        found["A"] = Parameter(angle_name(version), 0.0, _MOST_ANGLE, 0.1, integer=True, shared=True)
    else:
        raise UsageError(f"gains of {controller.autopilot or 'no autopilot'} came", needed="PX4, ArduPilot, Betaflight")
    # Where D moves in flight, what its parameter is depends on the version: top of the range or its base.
    moving = ("D",) if controller.ends else ()
    # One of which TPA left nothing did nothing in this flight: there is nothing to judge it by.
    return {
        letter: one
        for letter, one in found.items()
        if one.name in gains and letter not in moving and controller.left.get(letter, 1.0) > _LEAST_LEFT
    }


def ranges_of(controller: AxisController) -> dict[str, tuple[float, float]]:
    """Least and largest gain in SI that the firmware takes."""
    return {letter: (one.low * one.per_si, one.high * one.per_si) for letter, one in parameters_of(controller).items()}


def rounded(controller: AxisController, gains: Gains) -> Gains:
    """Gains as the firmware will hold them: numbers of 32 bits, or integers.

    Parameters
    ----------
    controller
        Of the axis; what it has no parameter for stays as flown.
    gains
        In SI.
    """
    flown, wanted = Gains.of(controller.controller).as_dict(), gains.as_dict()
    held = {
        letter: _held(one, wanted[letter]) * one.per_si
        for letter, one in parameters_of(controller).items()
        if not _stays(one, wanted[letter], flown[letter])
    }
    return Gains(**{**flown, **held})


def _held(one: Parameter, gain: float) -> float:
    """The value of a parameter for a gain, as the firmware keeps it."""
    value = gain / one.per_si
    return float(round(value)) if one.integer else float(np.float32(f"{value:.4g}"))


def _stays(one: Parameter, gain: float, flown: float) -> bool:
    """Whether a gain is the flown one, which is then not rounded: nothing would have changed but its digits."""
    return math.isclose(_held(one, gain), _held(one, flown), rel_tol=_SAME, abs_tol=_SAME)


def written(controller: AxisController, gains: Gains) -> dict[str, float]:
    """Values of the firmware's parameters for some gains, by name; one that stays has the digits of the log.

    Raises
    ------
    UsageError
        A value is not finite, or outside the firmware's range; one that stays as it was flown may be.
    """
    found = {}
    flown = Gains.of(controller.controller).as_dict()
    for letter, one in parameters_of(controller).items():
        gain = gains.as_dict()[letter]
        if math.isfinite(gain) and _stays(one, gain, flown[letter]):
            found[one.name] = controller.gains[one.name]
            continue
        value = _held(one, gain) if math.isfinite(gain) else gain
        if not (math.isfinite(value) and one.low * (1.0 - _SAME) <= value <= one.high * (1.0 + _SAME)):
            raise UsageError(f"{one.name} = {value:g} came", needed=f"a finite value from {one.low:g} to {one.high:g}")
        found[one.name] = value
    return found


def _ahead(controller: AxisController) -> list[Parameter]:
    """What the command is proportional to beside P, I and D: feed-forward, and the ends of a D that moves."""
    axis = controller.axis
    if controller.autopilot == "PX4":
        return [Parameter(f"MC_{_PX4[axis][0]}RATE_FF", 0.0, math.inf)]
    if controller.autopilot == "ArduPilot":
        return [Parameter(f"ATC_RAT_{_ARDUPILOT[axis]}_{name}", 0.0, math.inf) for name in ("FF", "D_FF")]
    older = (version_of(controller.firmware) or _BETAFLIGHT_250_SINCE) < _BETAFLIGHT_250_SINCE
    most = _MOST_OF_OLDER if older else _MOST_OF_BETAFLIGHT
    return [
        Parameter(f"d_{axis}", 0.0, most, integer=True),
        Parameter(f"d_min_{axis}", 0.0, _MOST_D_MIN_OF_OLDER if older else most, integer=True),
        Parameter(f"d_max_{axis}", 0.0, most, integer=True),
        Parameter(f"f_{axis}", 0.0, _MOST_F_OF_OLDER if older else _MOST_F, integer=True),
    ]


def scaled(controller: AxisController, factor: float) -> dict[str, float]:
    """Flown values of all parameters to which the command is proportional, times a factor, by name.

    Parameters
    ----------
    controller
        As the log tells it.
    factor
        On P, I, D and feed-forward, and both ends of a D that moves; the angle gain asks for a rate, and stays.

    Raises
    ------
    UsageError
        A value leaves the firmware's range, which the flown one had kept.
    """
    known = {one.name: one for one in _ahead(controller)}
    known |= {one.name: one for letter, one in parameters_of(controller).items() if letter != "A"}
    found = {}
    for name, one in known.items():
        flown = controller.gains.get(name, 0.0)
        if flown == 0.0:
            continue
        value = _held(one, flown * factor * one.per_si)
        outside = value > max(one.high, flown) * (1.0 + _SAME) or value < min(one.low, flown) * (1.0 - _SAME)
        if outside:
            raise UsageError(f"{name} = {value:g} came", needed=f"a finite value from {one.low:g} to {one.high:g}")
        found[name] = value
    return found
