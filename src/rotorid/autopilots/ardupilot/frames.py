"""Frames by ArduPilot's numbers."""

from __future__ import annotations

from collections.abc import Mapping

from rotorid.autopilots.numbers import whole
from rotorid.data.record import FlightRecord

_CLASSES: Mapping[int, str] = {
    1: "quad",
    2: "hexa",
    3: "octa",
    4: "octa quad",
    5: "Y6",
    7: "tri",
    12: "dodeca hexa",
    14: "deca",
}
_TYPES: Mapping[int, str] = {
    0: "plus",
    1: "X",
    2: "V",
    3: "H",
    4: "V tail",
    5: "A tail",
    12: "X (Betaflight)",
    13: "X (DJI)",
    14: "X (clockwise)",
    18: "X (Betaflight, reversed)",
}


def frame_of_class(record: FlightRecord) -> tuple[str, str] | None:
    """Name of the frame, and in brackets what the log says instead of one; ``None`` where it says nothing of it."""
    number = whole(record.parameters, "FRAME_CLASS", -1)
    if number < 0:
        return None
    name, kind = _CLASSES.get(number, ""), whole(record.parameters, "FRAME_TYPE", 1)
    return (f"{name} {_TYPES.get(kind, f'type {kind}')}".strip(), "") if name else ("", f" (FRAME_CLASS {number})")


def frame_of(record: FlightRecord) -> tuple[str, str] | None:
    """As :func:`frame_of_class`; before 3.5 the type alone is a parameter."""
    found = frame_of_class(record)
    if found is None and "FRAME" in record.parameters:
        return _TYPES.get(whole(record.parameters, "FRAME", -1), ""), ""
    return found
