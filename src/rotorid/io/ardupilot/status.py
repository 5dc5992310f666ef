"""What ArduPilot says of its vehicle and its flight: firmware, arming and landing events, flight mode."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.record import Intervals, Status, Vehicle
from rotorid.io.ardupilot.dataflash import Table
from rotorid.io.flags import intervals_of, shared, stays_of
from rotorid.typing import AnyArray, FloatArray

STATUS_MESSAGES = frozenset({"EV", "ARM", "MODE"})
"""Messages to read besides those of the channels."""

_ARMED, _DISARMED, _LANDED, _NOT_LANDED = 10, 11, 18, 28
_STOPPED, _INTERLOCKED = 54, 56
"""Emergency stop of the motors, and the interlock that takes their power: whatever flew, falls."""

_IN_AIR: Mapping[int, bool] = {
    _NOT_LANDED: True,
    **dict.fromkeys((_ARMED, _LANDED, _DISARMED, _STOPPED, _INTERLOCKED), False),
}
_ACRO, _GUIDED = 1, 4

_FIRMWARES: Sequence[tuple[str, Vehicle]] = (
    ("Heli", "helicopter"),
    ("Copter", "multirotor"),
    ("Plane", "plane"),
    ("Rover", "rover"),
    ("Boat", "boat"),
    (r"Sub\b", "submarine"),
    ("Blimp", "airship"),
    ("Tracker", "antenna tracker"),
)
_OWN_PARAMETERS: Mapping[str, Vehicle] = {
    **dict.fromkeys(("TECS_CLMB_MAX", "RLL2SRV_P", "GROUND_STEER_ALT"), "plane"),
    **dict.fromkeys(("ATC_STR_RAT_P", "STEER2SRV_P", "CRUISE_THROTTLE"), "rover"),
    **dict.fromkeys(("JS_GAIN_DEFAULT", "SURFACE_DEPTH"), "submarine"),
    **dict.fromkeys(("H_RSC_MODE", "H_COL_MID"), "helicopter"),
}
"""Parameters that only the firmware of one kind of vehicle has, for logs that do not introduce themselves."""

_BOAT = 2
"""``FRAME_CLASS`` of a boat in the firmware of rovers."""

_HELICOPTERS = (6, 11, 13)
"""``FRAME_CLASS`` of helicopters with one, two and four rotors."""


def status_of(
    tables: Mapping[str, Table], parameters: Mapping[str, float], firmware: str, span_s: tuple[float, float]
) -> Status:
    """What the events, the modes and the firmware of a log say.

    In the air is from "not landed" to "landed", disarming or a stop of the motors. In modes without control of height
    the autopilot says "not landed" as soon as the throttle rises: whether the vehicle moved then, is for others to see.

    Parameters
    ----------
    tables
        Messages by name; those of firmware before 3.3 carry no stamps and take that of the message before them.
    parameters
        Of the autopilot.
    firmware
        As it introduces itself.
    span_s
        First and last stamp of the record.
    """
    vehicle, named_in = _vehicle(parameters, firmware)
    events, states = _stamped(tables, "EV", "Id"), _stamped(tables, "ARM", "ArmState")
    armed, in_air = None, None
    unlogged: Intervals = ()
    if events is not None:
        unlogged = _take_offs_lost(events)
        armed = _between(events, {_ARMED: True, _NOT_LANDED: True, _DISARMED: False}, span_s)
        in_air = _between(events, _IN_AIR, span_s) if vehicle in ("", "multirotor", "helicopter") else None
    if states is not None and (events is None or not np.isin(events[1], (_ARMED, _DISARMED)).any()):
        armed = _armed(states, span_s)
    return Status(
        vehicle=vehicle,
        named_in=named_in,
        armed=armed,
        in_air=in_air,
        early=True,
        unlogged=unlogged,
        flagged_in="EV" if events is not None else "ARM" if states is not None else "",
        direct_rates=_acro(tables, parameters, span_s[1]),
        modes=_modes(tables, vehicle, span_s[1]),
        planned=_planned(tables, span_s[1]),
    )


def _vehicle(parameters: Mapping[str, float], firmware: str) -> tuple[Vehicle, str]:
    """Kind of vehicle by the name of the firmware, and by the parameters that make more of it."""
    name = re.split(r" v(?=\d)", firmware, flags=re.IGNORECASE)[0]
    found: Vehicle = next((kind for word, kind in _FIRMWARES if re.search(word, name, re.IGNORECASE)), "")
    if not found:
        found, name = next(((kind, key) for key, kind in _OWN_PARAMETERS.items() if key in parameters), ("", ""))
    if found == "plane" and parameters.get("Q_ENABLE", 0.0) > 0.0:
        return "VTOL", f"Q_ENABLE {parameters['Q_ENABLE']:g}"
    frame = int(parameters.get("FRAME_CLASS", 0.0))
    if found == "rover" and frame == _BOAT:
        return "boat", f"FRAME_CLASS {frame}"
    if found == "multirotor" and frame in _HELICOPTERS:
        return "helicopter", f"FRAME_CLASS {frame}"
    return found, name if found else ""


def _between(
    events: tuple[FloatArray, AnyArray], meaning: Mapping[int, bool], span_s: tuple[float, float]
) -> Intervals | None:
    """When a state was on that some events begin and others end; an end without a beginning began before the log.

    A log without arming and landing has no answer: it may begin and end in the air.
    """
    time_s, numbers = events
    meaningful = np.isin(numbers, list(meaning))
    time_s, on = time_s[meaningful], np.array([meaning[int(number)] for number in numbers[meaningful]], dtype=np.bool_)
    if not time_s.size:
        # What landed was armed, at a time that was not logged.
        return () if np.isin(numbers, (_ARMED, _DISARMED)).any() else None
    landed_before = not on[0] and int(numbers[meaningful][0]) in (_LANDED, _DISARMED)
    return intervals_of(
        np.concatenate([[min(span_s[0], float(time_s[0]))], time_s]),
        np.concatenate([[landed_before], on]),
        until_s=span_s[1],
    )


def _take_offs_lost(events: tuple[FloatArray, AnyArray]) -> Intervals:
    """From arming to a landing without a take-off between them: its event was lost, and when it was is unknown."""
    kept = np.isin(events[1], (_ARMED, _NOT_LANDED, _LANDED, _DISARMED))
    time_s, numbers = events[0][kept].tolist(), events[1][kept].tolist()
    pairs = zip(time_s, time_s[1:], numbers, numbers[1:], strict=False)
    return tuple((start, stop) for start, stop, *both in pairs if both == [_ARMED, _LANDED])


def _armed(states: tuple[FloatArray, AnyArray], span_s: tuple[float, float]) -> Intervals:
    """When the motors could run, as ``ARM`` shows: the first message also says how it was before."""
    time_s, on = states[0], states[1] != 0
    if not time_s.size:
        return ()
    begin_s = min(span_s[0], float(time_s[0]))
    return intervals_of(np.append(begin_s, time_s), np.append(not on[0], on), until_s=span_s[1])


def _acro(tables: Mapping[str, Table], parameters: Mapping[str, float], until_s: float) -> Intervals:
    """Where the sticks were set-points of rates: acro, when it neither levels nor holds an attitude."""
    modes = _stamped(tables, "MODE", "ModeNum") or _stamped(tables, "MODE", "Mode")
    rates_only = int(parameters.get("ACRO_OPTIONS", 0.0)) & 2 and parameters.get("ACRO_TRAINER", 2.0) == 0.0
    return intervals_of(modes[0], modes[1] == _ACRO, until_s=until_s) if modes and rates_only else ()


_MODES: Mapping[int, str] = {
    0: "stabilize",
    1: "acro",
    2: "altitude hold",
    3: "auto",
    4: "guided",
    5: "loiter",
    6: "return",
    7: "circle",
    9: "land",
    11: "drift",
    13: "sport",
    14: "flip",
    15: "autotune",
    16: "position hold",
    17: "brake",
    18: "throw",
    19: "avoid",
    20: "guided without GPS",
    21: "smart return",
    22: "flow hold",
    23: "follow",
    24: "zigzag",
    25: "system identification",
    26: "autorotate",
    27: "auto return",
    28: "turtle",
}
"""Numbers of Copter's modes; other vehicles have others."""


def _modes(tables: Mapping[str, Table], vehicle: str, until_s: float) -> tuple[tuple[str, float, float], ...]:
    modes = _stamped(tables, "MODE", "ModeNum") or _stamped(tables, "MODE", "Mode")
    named = _MODES if vehicle in ("", "multirotor", "helicopter") else {}
    return stays_of(*modes, named, until_s=until_s) if modes else ()


_SCRIPT, _BEGINS = "rotorid: ", "rotorid: plan begins"
"""How the scripts of flight plans begin their messages, and what the one that flies attitudes says at its start."""


def _planned(tables: Mapping[str, Table], until_s: float) -> Intervals:
    """When a script flew a plan of attitudes in guided mode: from its first message to its next one."""
    messages = tables.get("MSG")
    modes = _stamped(tables, "MODE", "ModeNum") or _stamped(tables, "MODE", "Mode")
    if messages is None or modes is None or messages.time_s is None or not messages.holds_text("Message"):
        return ()
    texts = messages.column("Message").tolist()
    from_script = np.array([text.startswith(_SCRIPT) for text in texts], dtype=np.bool_)
    is_begin = np.array([text.startswith(_BEGINS) for text in texts], dtype=np.bool_)
    flown = intervals_of(messages.time_s[from_script], is_begin[from_script], until_s=until_s)
    return shared(flown, intervals_of(modes[0], modes[1] == _GUIDED, until_s=until_s))


def _stamped(tables: Mapping[str, Table], name: str, column: str) -> tuple[FloatArray, AnyArray] | None:
    """Stamps and numbers of a column."""
    table = tables.get(name)
    if table is None or not table.holds_numbers(column):
        return None
    time_s = table.time_s
    if time_s is None:
        time_s = _time_before(tables, table)
    return None if time_s is None else (time_s, table.column(column))


def _time_before(tables: Mapping[str, Table], table: Table) -> FloatArray | None:
    """Stamp of the last message before each one, among those that are logged most often."""
    clocks = [other for other in tables.values() if other.clock is not None and len(other)]
    if not clocks:
        return None
    often = max(clocks, key=len)
    time_s = often.time_s
    if time_s is None:
        return None
    before = np.searchsorted(often.positions, table.positions) - 1
    stamps: FloatArray = time_s[np.maximum(before, 0)]
    return stamps
