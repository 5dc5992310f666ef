r"""Outer loops of PX4 and ArduPilot: velocity with position, by the parameters of every firmware generation.

An outer loop is the controller of a velocity whose command is an acceleration, with that of the position around it:

.. math:: a = C_v (v_t - v), \qquad v_t = A (p_t - p)

It has the form of a rate loop with its angle loop, so it is a :class:`rotorid.models.controller.RateController`, with P
in 1/s, I in 1/s², D without unit and A in 1/s.

- **PX4**: P on the error, D on the measured velocity, the integral one step late; it steps with the position estimate,
  and its acceleration holds until the next step, half of which is a delay.
- **ArduPilot**: P, I and D on the filtered error, the integral at once, at the rate of the main loop.

ArduPilot renamed these parameters in 4.7, some with another unit; :func:`as_logged` brings a file of one generation to
the names of the other.

References
----------
PX4/PX4-Autopilot ``src/modules/mc_pos_control``; ArduPilot/ardupilot ``libraries/AC_AttitudeControl/AC_PosControl.cpp``
and ``libraries/AC_PID``; ardupilot_wiki ``common-param-name-changes``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from rotorid.autopilots.ardupilot.autopilot import ARDUPILOT
from rotorid.autopilots.px4.autopilot import PX4
from rotorid.errors import UsageError
from rotorid.models.autopilots.climb import CLIMB, read_climb
from rotorid.models.autopilots.settings import AxisController, Parameter, present
from rotorid.models.controller import RateController
from rotorid.models.loop_filter import LoopFilter
from rotorid.typing import LoopName

OUTER_LOOPS: tuple[LoopName, ...] = ("velocity", "climb")

POSITION_STEP_HZ = 100.0
"""Rate of PX4's position estimate where neither parameters nor log say it, ``EKF2_PREDICT_US`` of 10 000."""

_SAME_UNIT = ("P", "I", "D", "FF", "FLTE", "FLTD", "NEF", "NTF", "FLTT")
_CM, _MILLI, _TENTH = 0.01, 0.001, 0.1


def _renamed() -> dict[str, tuple[str, float]]:
    pairs = {"PSC_POSXY_P": ("PSC_NE_POS_P", 1.0), "PSC_POSZ_P": ("PSC_D_POS_P", 1.0)}
    pairs |= {"PSC_JERK_XY": ("PSC_JERK_NE", 1.0), "PSC_JERK_Z": ("PSC_JERK_D", 1.0)}
    for old, new in (("PSC_VELXY_", "PSC_NE_VEL_"), ("PSC_VELZ_", "PSC_D_VEL_")):
        pairs |= {old + letter: (new + letter, 1.0) for letter in _SAME_UNIT}
        pairs[f"{old}IMAX"] = (f"{new}IMAX", _CM)
    pairs |= {f"PSC_ACCZ_{name}": (f"PSC_D_ACC_{name}", _TENTH if name in "PIDFF" else 1.0) for name in _SAME_UNIT}
    return pairs | {f"PSC_ACCZ_{name}": (f"PSC_D_ACC_{name}", _MILLI) for name in ("IMAX", "PDMX")}


RENAMED: Mapping[str, tuple[str, float]] = MappingProxyType(_renamed())
"""ArduPilot's name before 4.7 to the one since, and the factor on its value."""

OUTER_STEMS = ("MPC_", "PSC_")
"""How the names of all parameters of outer loops begin."""

_SETTINGS = (*OUTER_STEMS, "EKF2_PREDICT_US", "ATC_INPUT_TC", "ATC_RATE_FF_ENAB")


def outer_settings(parameters: Mapping[str, float]) -> dict[str, float]:
    """The parameters of a log on which its outer loops depend.

    Examples
    --------
    >>> outer_settings({"MPC_XY_P": 0.95, "MC_ROLL_P": 6.5})
    {'MPC_XY_P': 0.95}
    """
    return {name: float(value) for name, value in parameters.items() if name.startswith(_SETTINGS)}


def as_logged(values: Mapping[str, float], logged: Mapping[str, float]) -> dict[str, float]:
    """Parameters of a file by the names and in the units of a log, which may be of another generation of ArduPilot.

    Parameters
    ----------
    values
        Of the file.
    logged
        Parameters of the log.

    Raises
    ------
    UsageError
        A gain has both names, with two values.

    Examples
    --------
    >>> as_logged({"PSC_ACCZ_P": 0.5, "ATC_ANG_RLL_P": 4.5}, {"PSC_D_ACC_P": 0.04})
    {'PSC_D_ACC_P': 0.05, 'ATC_ANG_RLL_P': 4.5}
    """
    back = {new: (old, 1.0 / factor) for old, (new, factor) in RENAMED.items()}
    found: dict[str, float] = {}
    for name, value in values.items():
        other, factor = RENAMED.get(name) or back.get(name) or (name, 1.0)
        known = name in logged or other not in logged
        own, own_value = (name, value) if known else (other, value * factor)
        if not math.isclose(found.get(own, own_value), own_value, rel_tol=1e-6):
            raise UsageError(f"{name} and {other} are one gain with two values", needed="one of them")
        found[own] = own_value
    return found


class Generation(NamedTuple):
    """The names and ranges of one outer loop in one generation of a firmware.

    Parameters
    ----------
    gains
        ``P``, ``I``, ``D`` and ``A`` (of the position) to their parameters; the firmware has the first if it has any.
    limits
        Names of further parameters of the loop that are listed and not changed.
    filters
        Names of its filters.
    """

    autopilot: str
    gains: Mapping[str, Parameter]
    limits: tuple[str, ...] = ()
    filters: tuple[str, ...] = ()


_PX4_VELOCITY = Generation(
    PX4.name,
    {
        "P": Parameter("MPC_XY_VEL_P_ACC", 1.2, 5.0),
        "I": Parameter("MPC_XY_VEL_I_ACC", 0.0, 60.0),
        "D": Parameter("MPC_XY_VEL_D_ACC", 0.1, 2.0),
        "A": Parameter("MPC_XY_P", 0.0, 2.0),
    },
    filters=("MPC_VEL_LP", "MPC_VEL_NF_FRQ", "MPC_VEL_NF_BW", "MPC_VELD_LP"),
)


def _of_ardupilot(velocity: str, position: str) -> Generation:
    return Generation(
        ARDUPILOT.name,
        {
            "P": Parameter(f"{velocity}P", 0.1, 10.0),
            "I": Parameter(f"{velocity}I", 0.1, 10.0),
            "D": Parameter(f"{velocity}D", 0.0, 1.0),
            "A": Parameter(position, 0.5, 4.0),
        },
        limits=(f"{velocity}FF", f"{velocity}IMAX"),
        filters=(f"{velocity}FLTE", f"{velocity}FLTD"),
    )


GENERATIONS: dict[LoopName, tuple[Generation, ...]] = {
    "velocity": (
        _PX4_VELOCITY,
        _of_ardupilot("PSC_NE_VEL_", "PSC_NE_POS_P"),
        _of_ardupilot("PSC_VELXY_", "PSC_POSXY_P"),
    ),
    "climb": tuple(Generation(*row) for row in CLIMB),
}
"""Every generation that has an outer loop, newest names first."""


def generation_of(parameters: Mapping[str, float], loop: LoopName) -> Generation | None:
    """The generation whose names of a loop are among some parameters."""
    known = GENERATIONS.get(loop, ())
    return next((one for one in known if one.gains["P"].name in parameters), None)


def outer_parameters(controller: AxisController) -> dict[str, Parameter] | None:
    """The parameters that hold P, I, D and A of an outer loop; ``None`` for a controller of an axis."""
    if controller.axis not in OUTER_LOOPS:
        return None
    found = generation_of(controller.gains, controller.axis)
    assert found is not None
    return {letter: parameter for letter, parameter in found.gains.items() if parameter.name in controller.gains}


def outer_letter(name: str) -> str:
    """``P``, ``I``, ``D`` or ``A`` (position) of a gain of an outer loop; empty for any other parameter.

    Examples
    --------
    >>> outer_letter("PSC_NE_VEL_P"), outer_letter("MPC_XY_P"), outer_letter("MPC_VEL_LP")
    ('P', 'A', '')
    """
    return next((letters[name] for loop in GENERATIONS if name in (letters := _letters(loop))), "")


def outer_loop_of(name: str) -> LoopName | None:
    """The outer loop whose gain a parameter is.

    Examples
    --------
    >>> outer_loop_of("MPC_XY_VEL_P_ACC"), outer_loop_of("MC_ROLL_P")
    ('velocity', None)
    """
    return next((loop for loop in GENERATIONS if name in _letters(loop)), None)


def _letters(loop: LoopName) -> dict[str, str]:
    """Names of the gains of a loop, of every generation, to their letters."""
    return {one.name: letter for known in GENERATIONS[loop] for letter, one in known.gains.items()}


def outer_names(loop: LoopName) -> tuple[str, ...]:
    """All names of the gains and filters of an outer loop, of every generation."""
    return tuple(
        name
        for known in GENERATIONS.get(loop, ())
        for name in (*(parameter.name for parameter in known.gains.values()), *known.limits, *known.filters)
    )


Reader = Callable[[Generation, Mapping[str, float], float | None], RateController]


def _read_velocity(known: Generation, parameters: Mapping[str, float], loop_rate_hz: float | None) -> RateController:
    gains = {letter: float(parameters.get(one.name, 0.0)) * one.per_si for letter, one in known.gains.items()}
    own = RateController(proportional_s=gains["P"], integral=gains["I"], derivative_s2=gains["D"], angle_1_s=gains["A"])
    filters = [float(parameters.get(name, 0.0)) for name in known.filters]
    if known.autopilot == ARDUPILOT.name:
        rate_hz = loop_rate_hz or parameters.get("SCHED_LOOP_RATE", 400.0)
        return replace(
            own,
            derivative_of_error=True,
            error_cutoff_hz=filters[0],
            derivative_cutoff_hz=filters[1],
            feedforward=float(parameters.get(known.limits[0], 0.0)),
            step_s=1.0 / rate_hz,
        )
    step_s = 1.0 / (loop_rate_hz or position_step_hz(parameters))
    return replace(own, derivative_cutoff_hz=filters[3], late_integral=True, step_s=step_s, delay_s=0.5 * step_s)


def _read_climb(known: Generation, parameters: Mapping[str, float], loop_rate_hz: float | None) -> RateController:
    names = {letter: one.name for letter, one in known.gains.items()}
    return read_climb(names, parameters, position_rate_hz=loop_rate_hz or position_step_hz(parameters))


READERS: dict[LoopName, Reader] = {"velocity": _read_velocity, "climb": _read_climb}
"""What makes a controller of the parameters of a loop."""


def position_step_hz(parameters: Mapping[str, float]) -> float:
    """Rate of the position controller of PX4, by the parameters of a log."""
    period_us = parameters.get("EKF2_PREDICT_US", 0.0)
    return 1e6 / period_us if period_us > 0.0 else POSITION_STEP_HZ


def velocity_filters(controller: AxisController) -> tuple[LoopFilter, ...]:
    """Filters on the measured velocity in front of an outer loop, which the position does not pass."""
    own = controller.filters
    found = []
    if own.get("MPC_VEL_NF_FRQ", 0.0) > 0.0 and own.get("MPC_VEL_NF_BW", 0.0) > 0.0:
        center, width = own["MPC_VEL_NF_FRQ"], own["MPC_VEL_NF_BW"]
        found.append(LoopFilter(kind="notch", frequency_hz=center, quality=center / width))
    if own.get("MPC_VEL_LP", 0.0) > 0.0:
        found.append(LoopFilter(kind="PT1", frequency_hz=own["MPC_VEL_LP"]))
    return tuple(found)


def outer_controller(
    parameters: Mapping[str, float], loop: LoopName, *, firmware: str = "", loop_rate_hz: float | None = None
) -> AxisController | None:
    """The controller of an outer loop by the parameters of a log; ``None`` where they are not there, or all zero.

    Parameters
    ----------
    parameters
        Names and values as the autopilot has them, of any generation.
    loop
        ``velocity`` or ``climb``.
    firmware
        What the log calls it.
    loop_rate_hz
        Steps of the controller per second, where the log shows them.

    Examples
    --------
    >>> old = {"PSC_VELXY_P": 2.0, "PSC_VELXY_I": 1.0, "PSC_VELXY_D": 0.5, "PSC_POSXY_P": 1.0, "PSC_VELXY_FLTE": 5.0}
    >>> found = outer_controller(old, "velocity")
    >>> found.controller.proportional_s, found.controller.angle_1_s, outer_parameters(found)["A"].name
    (2.0, 1.0, 'PSC_POSXY_P')
    """
    known = generation_of(parameters, loop)
    if known is None:
        return None
    values = [float(parameters.get(one.name, 0.0)) for one in known.gains.values()]
    if not any(values[:3]) or min(values) < 0.0:
        return None
    names = tuple(one.name for one in known.gains.values())
    return AxisController(
        autopilot=known.autopilot,
        firmware=firmware,
        axis=loop,
        controller=READERS[loop](known, parameters, loop_rate_hz),
        gains=present(parameters, (*names, *known.limits)),
        filters=present(parameters, known.filters),
    )
