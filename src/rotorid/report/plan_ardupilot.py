"""Files with which ArduPilot's Copter flies a plan: parameters of its SYSTEMID mode, and scripts for its Lua.

SYSTEMID mode (25) flies one waveform, a logarithmic chirp, on one axis at a time. Everything else needs a script; what
scripts can reach is the attitude set-point, in GUIDED mode. Nothing but the firmware can add to the mixer's input or to
a rate set-point in another form than that chirp.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.report.flight_facts import HOLD, FlightFacts, excited_s, flown_by_hand
from rotorid.report.plan_csv import table
from rotorid.report.plan_system_id import SYSTEM_ID_DELAY_S, SystemId, in_words, system_id
from rotorid.report.plan_text import file_stem, filled, number, number_above, one_line
from rotorid.units import STANDARD_GRAVITY_M_S2

SYSTEM_ID_MODE = 25

DEFAULT_LOG_BITMASK = 176126
"""Copter's own default."""
LOG_BITS = (0, 1)
"""Fast and medium attitude: together they make SYSTEMID mode log every loop."""
FAST_IMU_BIT = 18
"""IMU at the rate of the loop, for maneuvers outside of SYSTEMID mode, where ``SIDD`` is not written."""

ATTITUDE_RATE_HZ = 50.0
"""Rate at which the script sends attitudes."""


def ardupilot_files(
    plan: FlightPlan, facts: FlightFacts, *, recovery: bool = False, mode_switch: int | None = None
) -> dict[str, str]:
    """Files for ArduPilot: parameters for each run, parameters for afterwards, and a script where one helps.

    - A plan of logarithmic sweeps gives one ``.param`` file for each, to be flown one by one, and a Lua script that
      flies them all in one flight after each other, when the pilot holds a switch.
    - A plan of other forms that enter as attitude set-points of roll, pitch and yaw gives logging parameters, a Lua
      script for GUIDED mode and its table of attitudes. The script holds the place as slowly as
      :func:`rotorid.simulate.changes.piloted` does; the autopilot holds the height.
    - Inputs at the sticks, and doublets or multisteps beside sweeps, are left to the pilot's hand and the flight card.

    Neither ever overrides the pilot's sticks, arms or disarms: a change of the flight mode or of the switch ends the
    run.

    Parameters
    ----------
    plan
        What is to be flown.
    facts
        Its limits.
    recovery
        Whether angles enter SYSTEMID mode without feedforward.
    mode_switch
        Position of the flight-mode switch, 1 to 6, that is given to SYSTEMID mode; when it is not given the files leave
        the switch alone, and the pilot assigns the mode.

    Returns
    -------
    dict[str, str]
        File name to text. Parameters as ``NAME,VALUE``, which Mission Planner and MAVProxy load.

    Raises
    ------
    UsageError
        ArduPilot cannot fly one of the inputs.
    """
    if mode_switch is not None and mode_switch not in range(1, 7):
        raise UsageError(f"position {mode_switch} of the flight-mode switch", needed="1 to 6")
    by_hand = flown_by_hand(plan, "ArduPilot")
    sweeps = [planned for planned in plan.inputs if planned not in by_hand]
    if not sweeps:
        raise UsageError(
            "test inputs at the sticks for ArduPilot's files",
            needed="command, rate or attitude inputs: nothing here overrides the pilot's sticks",
            remedy="fly them by hand with the flight card, or plan another entry",
        )
    if all(planned.shape == "logarithmic_sweep" for planned in sweeps):
        return _chirp_files(plan, sweeps, facts, recovery=recovery, mode_switch=mode_switch)
    return _attitude_files(plan, facts)


def log_bitmask(*, fast_imu: bool) -> int:
    """``LOG_BITMASK`` of a test flight: the default, fast attitude, and the IMU at the rate of the loop.

    Examples
    --------
    >>> log_bitmask(fast_imu=False), log_bitmask(fast_imu=True)
    (176127, 438271)
    """
    bits = (*LOG_BITS, FAST_IMU_BIT) if fast_imu else LOG_BITS
    mask = DEFAULT_LOG_BITMASK
    for bit in bits:
        mask |= 1 << bit
    return mask


def plan_log_bitmask(plan: FlightPlan) -> int:
    """``LOG_BITMASK`` for a plan: with the fast IMU where something is flown outside of SYSTEMID mode."""
    return log_bitmask(fast_imu=any(planned.shape != "logarithmic_sweep" for planned in plan.inputs))


def _chirp_files(
    plan: FlightPlan, sweeps: Sequence[PlannedInput], facts: FlightFacts, *, recovery: bool, mode_switch: int | None
) -> dict[str, str]:
    runs = [(planned, system_id(planned, recovery=recovery)) for planned in sweeps]
    _require_one_by_one(sweeps)
    shared = {"LOG_BITMASK": plan_log_bitmask(plan)}
    if mode_switch is not None:
        shared[f"FLTMODE{mode_switch}"] = SYSTEM_ID_MODE
    words = {"plan": one_line(plan.name), "vehicle": one_line(facts.vehicle), "facts": facts}
    files = {}
    for index, (planned, settings) in enumerate(runs, start=1):
        files[f"ardupilot-{index}-{planned.axis}.param"] = filled(
            "ardupilot_run.param",
            **words,
            index=index,
            of=len(runs),
            planned=planned,
            settings=settings,
            mode_switch=mode_switch,
            fast_imu=bool(shared["LOG_BITMASK"] >> FAST_IMU_BIT & 1),
            lines=_lines(settings.parameters | shared),
        )
    files["ardupilot-after.param"] = filled("ardupilot_after.param", **words, default=DEFAULT_LOG_BITMASK)
    files[f"{file_stem(plan.name)}-chirps.lua"] = filled(
        "ardupilot_chirps.lua",
        **words,
        mode=SYSTEM_ID_MODE,
        runs=[(planned.axis, SYSTEM_ID_DELAY_S + settings.record_s, _settings(settings)) for planned, settings in runs],
        rests=_rests_s(sweeps, plan.trim_s),
        number=number,
    )
    return files


def _attitude_files(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    for planned in plan.inputs:
        if planned.entry != "attitude_setpoint" or planned.axis == "thrust":
            raise UsageError(
                f"a {in_words(planned.shape)} on {planned.axis} as {in_words(planned.entry)} for ArduPilot",
                needed="logarithmic sweeps, or attitude set-points of roll, pitch and yaw: scripts reach nothing else",
                remedy="plan logarithmic sweeps for SYSTEMID mode, or attitude set-points for GUIDED mode",
            )
    time_s, columns = table(plan, sample_rate_hz=ATTITUDE_RATE_HZ)
    zero = np.zeros(time_s.size)
    angles = np.degrees([columns.get(f"{axis}_attitude_setpoint", zero) for axis in ("roll", "pitch", "yaw")])
    stem = file_stem(plan.name)
    words = {"plan": one_line(plan.name), "vehicle": one_line(facts.vehicle), "facts": facts}
    rows = [f"{roll:.3f},{pitch:.3f},{yaw:.3f}" for roll, pitch, yaw in angles.T.tolist()]
    return {
        "ardupilot-log.param": filled(
            "ardupilot_log.param", **words, lines=_lines({"LOG_BITMASK": plan_log_bitmask(plan), "SCR_ENABLE": 1})
        ),
        "ardupilot-after.param": filled("ardupilot_after.param", **words, default=DEFAULT_LOG_BITMASK),
        f"{stem}-attitude.csv": "\n".join([*rows, ""]),
        f"{stem}-attitude.lua": filled(
            "ardupilot_attitude.lua",
            **words,
            table=f"{stem}-attitude.csv",
            rows=len(rows),
            rate_hz=ATTITUDE_RATE_HZ,
            largest_deg=[number_above(float(np.abs(angle).max())) for angle in angles],
            hold=HOLD,
            gravity=STANDARD_GRAVITY_M_S2,
            number=number,
        ),
    }


def _require_one_by_one(inputs: Sequence[PlannedInput]) -> None:
    for before, after in pairwise(inputs):
        if excited_s(after)[0] < excited_s(before)[1]:
            raise UsageError(
                f"sweeps on {before.axis} and {after.axis} at the same time for ArduPilot's SYSTEMID mode",
                needed="one after the other: the mode has one waveform",
                remedy="move the second one behind the first",
            )


def _rests_s(sweeps: Sequence[PlannedInput], last_s: float) -> list[float]:
    """Rest after each run as planned, without the second that the mode waits by itself."""
    edges = [excited_s(planned) for planned in sweeps]
    gaps = [after[0] - before[1] for before, after in pairwise(edges)]
    return [max(gap - SYSTEM_ID_DELAY_S, 1.0) for gap in gaps] + [last_s]


def _settings(settings: SystemId) -> list[tuple[str, str]]:
    return [(name, number(value)) for name, value in settings.parameters.items()]


def _lines(parameters: Mapping[str, float]) -> list[str]:
    return [f"{name},{number(value)}" for name, value in parameters.items()]
