"""Which parameters of each firmware hold the gains of an axis, with their ranges and steps.

Ranges are those of the firmwares' own parameter descriptions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from rotorid.autopilots.firmware import Version, version_of
from rotorid.errors import UsageError
from rotorid.models.autopilots import ardupilot, betaflight, px4
from rotorid.models.autopilots.betaflight import PER_D, PER_I, PER_P, YAW_I
from rotorid.models.autopilots.betaflight_settings import angle_name
from rotorid.models.autopilots.outer import outer_letter, outer_parameters
from rotorid.models.autopilots.settings import AxisController, Parameter
from rotorid.typing import LoopName

_PX4: Mapping[LoopName, tuple[str, float, float, float]] = MappingProxyType(
    {"roll": ("ROLL", 0.5, 0.01, 12.0), "pitch": ("PITCH", 0.6, 0.01, 12.0), "yaw": ("YAW", 0.6, 0.0, 5.0)}
)


def _px4(controller: AxisController) -> dict[str, Parameter]:
    name, most, least, fastest = _PX4[controller.axis]
    # K and P are one number written twice: K stays.
    factor = controller.gains.get(f"MC_{name}RATE_K", 1.0) or 1.0
    slopes = math.inf if controller.axis == "yaw" else 0.01
    return {
        "P": Parameter(f"MC_{name}RATE_P", least, most, factor),
        "I": Parameter(f"MC_{name}RATE_I", 0.0, math.inf, factor),
        "D": Parameter(f"MC_{name}RATE_D", 0.0, slopes, factor),
        "A": Parameter(f"MC_{name}_P", 0.0, fastest),
    }


def _px4_ahead(controller: AxisController) -> list[Parameter]:
    return [Parameter(f"MC_{_PX4[controller.axis][0]}RATE_FF", 0.0, math.inf)]


_ARDUPILOT: Mapping[LoopName, str] = MappingProxyType({"roll": "RLL", "pitch": "PIT", "yaw": "YAW"})
_ARDUPILOT_RANGES = {
    False: {"P": (0.01, 0.5), "I": (0.01, 2.0), "D": (0.0, 0.05), "A": (3.0, 12.0)},
    True: {"P": (0.1, 2.5), "I": (0.01, 1.0), "D": (0.0, 0.02), "A": (3.0, 12.0)},
}


def _ardupilot(controller: AxisController) -> dict[str, Parameter]:
    name, ranges = _ARDUPILOT[controller.axis], _ARDUPILOT_RANGES[controller.axis == "yaw"]
    found = {letter: Parameter(f"ATC_RAT_{name}_{letter}", *ranges[letter]) for letter in "PID"}
    return {**found, "A": Parameter(f"ATC_ANG_{name}_P", *ranges["A"])}


def _ardupilot_ahead(controller: AxisController) -> list[Parameter]:
    return [Parameter(f"ATC_RAT_{_ARDUPILOT[controller.axis]}_{name}", 0.0, math.inf) for name in ("FF", "D_FF")]


_BETAFLIGHT_250_SINCE: Version = (4, 3)
_MOST_OF_BETAFLIGHT, _MOST_OF_OLDER, _MOST_ANGLE = 250.0, 200.0, 200.0
_MOST_F, _MOST_F_OF_OLDER, _MOST_D_MIN_OF_OLDER = 1000.0, 2000.0, 100.0


def _betaflight(controller: AxisController) -> dict[str, Parameter]:
    axis = controller.axis
    scales = {"P": PER_P, "I": PER_I * (YAW_I if axis == "yaw" else 1.0), "D": PER_D}
    # Gains are those at the flown throttle, where TPA had lowered what the parameters say.
    scales = {letter: scale * controller.left.get(letter, 1.0) for letter, scale in scales.items()}
    version = version_of(controller.firmware) or _BETAFLIGHT_250_SINCE
    most = _MOST_OF_BETAFLIGHT if version >= _BETAFLIGHT_250_SINCE else _MOST_OF_OLDER
    found = {
        letter: Parameter(f"{letter.lower()}_{axis}", 0.0, most, scale, integer=True)
        for letter, scale in scales.items()
    }
    return {**found, "A": Parameter(angle_name(version), 0.0, _MOST_ANGLE, 0.1, integer=True, shared=True)}


def _betaflight_ahead(controller: AxisController) -> list[Parameter]:
    axis = controller.axis
    older = (version_of(controller.firmware) or _BETAFLIGHT_250_SINCE) < _BETAFLIGHT_250_SINCE
    most = _MOST_OF_OLDER if older else _MOST_OF_BETAFLIGHT
    return [
        Parameter(f"d_{axis}", 0.0, most, integer=True),
        Parameter(f"d_min_{axis}", 0.0, _MOST_D_MIN_OF_OLDER if older else most, integer=True),
        Parameter(f"d_max_{axis}", 0.0, most, integer=True),
        Parameter(f"f_{axis}", 0.0, _MOST_F_OF_OLDER if older else _MOST_F, integer=True),
    ]


class _Names(NamedTuple):
    """What holds P, I, D and A of a firmware, and what else its command is proportional to."""

    gains: Callable[[AxisController], dict[str, Parameter]]
    ahead: Callable[[AxisController], list[Parameter]]


_NAMES: Mapping[str, _Names] = MappingProxyType(
    {
        px4.NAME: _Names(_px4, _px4_ahead),
        ardupilot.NAME: _Names(_ardupilot, _ardupilot_ahead),
        betaflight.NAME: _Names(_betaflight, _betaflight_ahead),
    }
)

_LETTERS = re.compile(
    r"(?:MC_(?:ROLL|PITCH|YAW)RATE_|ATC_RAT_(?:RLL|PIT|YAW)_)(?P<rate>[PID])|(?P<low>[pid])_(?:roll|pitch|yaw)"
    r"|MC_(?:ROLL|PITCH|YAW)_P|ATC_ANG_(?:RLL|PIT|YAW)_P|angle_p_gain|angle_level_strength"
)

_LEAST_LEFT = 0.05
"""What TPA has to leave of a gain for it to be proposed."""


def letter_of(name: str) -> str:
    """``P``, ``I``, ``D`` or ``A`` (angle, position) of the gain in a firmware's parameter; empty for any other.

    Examples
    --------
    >>> letter_of("MC_ROLLRATE_P"), letter_of("d_pitch"), letter_of("ATC_ANG_YAW_P"), letter_of("IMU_GYRO_CUTOFF")
    ('P', 'D', 'A', '')
    """
    if letter := outer_letter(name):
        return letter
    found = _LETTERS.fullmatch(name)
    return "" if found is None else (found["rate"] or found["low"] or "A").upper()


def parameters_of(controller: AxisController) -> dict[str, Parameter]:
    """The parameters that hold P, I, D and A of an axis, as far as its firmware has them.

    Parameters
    ----------
    controller
        As logged.

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
    if (outer := outer_parameters(controller)) is not None:
        return outer
    names = _NAMES.get(controller.autopilot)
    if names is None:
        raise UsageError(f"got gains of {controller.autopilot or 'no autopilot'}", needed=", ".join(_NAMES))
    gains, found = controller.gains, names.gains(controller)
    # Where D moves in flight, what its parameter is depends on the version: top of the range or its base.
    moving = ("D",) if controller.ends else ()
    # One of which TPA left nothing did nothing in this flight: there is nothing to judge it by.
    return {
        letter: parameter
        for letter, parameter in found.items()
        if parameter.name in gains and letter not in moving and controller.left.get(letter, 1.0) > _LEAST_LEFT
    }


def ahead_of(controller: AxisController) -> list[Parameter]:
    """What the command is proportional to beside P, I and D: feed-forward, and the ends of a D that moves."""
    return [] if outer_parameters(controller) is not None else _NAMES[controller.autopilot].ahead(controller)
