"""Files with which PX4 flies a plan: a MAVLink script that injects it, its table, and logging parameters.

What MAVLink lets a program add to on a flying PX4: attitude set-points of roll, pitch and yaw, and collective thrust,
in Offboard mode; and the sticks, in a simulation. Nothing can add to the torque set-points that the mixer receives:
that takes a module inside of the firmware. Rate set-points replace PX4's loop of attitude instead of adding to what it
asks for, so that the script would have to hold level over the link, another loop than the one that was simulated: they
are refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.autopilots.px4.advice import log_profile, profile_words
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.plans.csv import FILE, filled, number, number_above, one_line, plan_csv
from rotorid.plans.facts import HOLD, FlightFacts, column_name, how_to_stop
from rotorid.units import STANDARD_GRAVITY_M_S2

SCRIPT = "px4_fly_plan.py"
PARAMETERS = "px4.params"
_INTEGER, _REAL = 6, 9
"""Types of parameters, as QGroundControl's files number them."""

_LEAST_SAMPLES = 10.0
"""Set-points in a period of the highest frequency that are sent at least."""

_SEND_RATE_HZ = 100.0
"""A message takes some 50 bytes: this rate passes through USB, Wi-Fi and a companion's port, and not through a
telemetry radio."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Parameter:
    name: str
    value: float
    kind: int
    why: str


_PARAMETERS = (
    _Parameter(name="SDLOG_MODE", value=0, kind=_INTEGER, why="log from arming to disarming"),
    _Parameter(
        name="COM_RC_OVERRIDE", value=3, kind=_INTEGER, why="moving the sticks also ends Offboard (Position mode)"
    ),
    _Parameter(name="COM_OF_LOSS_T", value=0.5, kind=_REAL, why="Offboard ends 0.5 s after the script stops"),
    _Parameter(name="COM_OBL_RC_ACT", value=0, kind=_INTEGER, why="then: Position mode"),
)


def _parameters(firmware: str) -> tuple[_Parameter, ...]:
    """All of them, with the logging that a firmware has."""
    profile = _Parameter(
        name="SDLOG_PROFILE",
        value=log_profile(firmware),
        kind=_INTEGER,
        why=f"log at full rate: {profile_words(firmware)}",
    )
    return (profile, *_PARAMETERS)


def px4_files(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    """Files for PX4: the script, the table it reads, and parameters as QGroundControl loads them.

    The script arms nothing. It streams level set-points until the pilot switches to Offboard, adds the plan to what
    holds place and height as slowly as :func:`rotorid.simulation.multirotor_flight.piloted` does, and stops for good
    when the flight mode changes, a limit is passed, or the link is silent. Sticks are injected in a simulation
    only: while MAVLink is the source of the sticks PX4 ignores the switches of a transmitter, the kill switch too.

    Parameters
    ----------
    plan
        What is to be flown: attitude set-points or sticks, one kind in a plan, and thrust commands beside the
        set-points.
    facts
        Its limits.

    Returns
    -------
    dict[str, str]
        File name to text.

    Raises
    ------
    UsageError
        MAVLink cannot carry one of the inputs, or a period of the highest frequency has fewer than ten messages.
    """
    places = {column_name(planned): planned for planned in plan.inputs}
    kind = _kind(places)
    _require_rate(plan)
    words = {"plan": one_line(plan.name), "vehicle": one_line(facts.vehicle), "stop": how_to_stop(plan, "PX4")}
    columns = {name: f"{name} [{planned.unit}]" for name, planned in places.items()}
    return {
        **plan_csv(plan),
        SCRIPT: filled(
            "px4_fly_plan.py.txt",
            **words,
            kind=kind,
            table=FILE,
            columns={planned.axis: columns[name] for name, planned in places.items()},
            largest={planned.axis: number_above(1.01 * _largest(plan, name)) for name, planned in places.items()},
            rate=number(_SEND_RATE_HZ),
            facts=facts,
            hold=HOLD,
            gravity=STANDARD_GRAVITY_M_S2,
            number=number,
        ),
        PARAMETERS: filled("px4.params", **words, parameters=_parameters(facts.firmware), number=number),
    }


def _kind(places: Mapping[str, PlannedInput]) -> str:
    """The one way in which all inputs of the plan are carried."""
    kinds = set()
    for planned in places.values():
        if planned.axis == "thrust" and planned.entry == "command":
            continue
        if planned.entry == "rate_setpoint" and planned.axis != "thrust":
            raise UsageError(
                f"PX4 cannot fly a planned rate set-point of {planned.axis}: Offboard with rates lets the vehicle "
                "drift",
                needed="attitude set-points",
                remedy="plan attitude set-points; the resulting rate set-points are logged",
            )
        if planned.entry == "command" or (planned.axis == "thrust" and planned.entry != "stick"):
            raise UsageError(
                f"MAVLink cannot send {planned.entry.replace('_', ' ')} of {planned.axis} to PX4",
                needed="attitude set-points or sticks of roll, pitch and yaw, or commands or sticks of thrust",
                remedy="plan another entry; the resulting torque set-points are logged",
            )
        kinds.add(planned.entry)
    with_thrust_command = "thrust_excitation" in places
    if len(kinds) > 1 or (with_thrust_command and "stick" in kinds):
        raise UsageError(
            f"one PX4 plan cannot mix {', '.join(sorted(kinds)).replace('_', ' ')}",
            needed="one kind of entry",
            remedy="split the plan",
        )
    return next(iter(kinds), "attitude_setpoint")


def _require_rate(plan: FlightPlan) -> None:
    highest = max((planned.band_rad_s[1] for planned in plan.inputs if planned.band_rad_s), default=0.0)
    if _LEAST_SAMPLES * highest / (2.0 * math.pi) > _SEND_RATE_HZ:
        raise UsageError(
            f"{_SEND_RATE_HZ:g} messages a second for test inputs up to {round(highest, 1):g} rad/s",
            needed=f"at least {_LEAST_SAMPLES * highest / (2.0 * math.pi):.0f} a second: ten for a period",
            remedy="lower the highest frequency",
        )


def _largest(plan: FlightPlan, name: str) -> float:
    """Largest sum of the inputs of one place: what the script refuses to exceed."""
    return sum(float(abs(planned.values).max()) for planned in plan.inputs if column_name(planned) == name)
