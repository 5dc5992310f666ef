"""What Betaflight and INAV say of their flights: arming and flight mode, in the slow frames of a blackbox log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from rotorid.data.record import Intervals, Status
from rotorid.io.betaflight.blackbox import Flight
from rotorid.io.flags import before_first, intervals_of, stays_of

_FLAGS, _FAILSAFE = "flightModeFlags", "failsafePhase"
_ARM, _ANGLE, _HORIZON = 1, 2, 4
"""Boxes of ``flightModeFlags`` that stand at the same bit in every version since 3.0."""

_SELF_LEVELED: Mapping[tuple[int, int], Mapping[int, str]] = MappingProxyType(
    {
        (2025, 12): {1 << 10: "GPS rescue", 1 << 9: "position hold", 1 << 4: "altitude hold"},
        (4, 0): {1 << 7: "GPS rescue"},
    }
)
"""Boxes with which the autopilot levels although neither angle nor horizon mode is set, by the first version."""

_INAV_BOXES: Mapping[int, str] = MappingProxyType(
    {1 << 18: "failsafe", 1 << 8: "return", 1 << 19: "mission", 1 << 9: "position hold", 1 << 4: "heading hold"}
)
"""The same of INAV since 2.0, which numbers arming, angle and horizon as Betaflight does; heading hold yaws by itself.
"""
_INAV_SINCE = "activeFlightModeFlags"
"""With this field ``flightModeFlags`` are the boxes; before, they were modes of other numbers."""


def status_of(flights: Sequence[Flight]) -> Status:
    """When the flights of a log were armed, and when the sticks were set-points of rates.

    There is no landed flag. Without angle and horizon mode the set-points of the body rates come straight from the
    sticks, unless the failsafe, a GPS rescue or a hold of altitude or position flies. Of INAV before 2.0, whose modes
    have other numbers, nothing is said.

    Parameters
    ----------
    flights
        Those that can be read.
    """
    flights_with_flags = [flight for flight in flights if _FLAGS in flight.slow_fields and _has_boxes(flight)]
    if not flights_with_flags:
        return Status()
    return Status(
        vehicle="multirotor" if all(_is_multirotor(flight) for flight in flights_with_flags) else "",
        named_in="motors" if all(_is_multirotor(flight) for flight in flights_with_flags) else "",
        armed=_sorted(_intervals(flight, direct=False) for flight in flights_with_flags)
        if len(flights_with_flags) == len(flights)
        else None,
        unlogged=_sorted(before_first(flight.slow_time_s, float(flight.time_s[0])) for flight in flights_with_flags),
        flagged_in=_FLAGS,
        direct_rates=_sorted(_intervals(flight, direct=True) for flight in flights_with_flags),
        modes=tuple(
            sorted((stay for flight in flights_with_flags for stay in _modes(flight)), key=lambda stay: stay[1])
        ),
    )


def _has_boxes(flight: Flight) -> bool:
    """Whether the flags are those of boxes whose numbers are known."""
    revision = flight.header.values.get("Firmware revision", "")
    return revision.startswith("Betaflight") or (
        flight.header.firmware[0] == "INAV" and _INAV_SINCE in flight.slow_fields
    )


def _is_multirotor(flight: Flight) -> bool:
    return "motor[2]" in flight.fields


def _intervals(flight: Flight, *, direct: bool) -> Intervals:
    flags = flight.slow_field(_FLAGS)
    on = (flags & _ARM) > 0
    if direct:
        on = (flags & sum(_leveling(flight))) == 0
        if _FAILSAFE in flight.slow_fields:
            on = on & (flight.slow_field(_FAILSAFE) == 0)
    return intervals_of(flight.slow_time_s, on, until_s=float(flight.time_s[-1]))


def _leveling(flight: Flight) -> dict[int, str]:
    """Boxes with which the set-points of the rates are not the sticks'; the first that is set names the mode."""
    name, version = flight.header.firmware
    if name == "INAV":
        return {**_INAV_BOXES, _ANGLE: "angle", _HORIZON: "horizon"}
    newest = next((boxes for since, boxes in _SELF_LEVELED.items() if version >= since), {})
    return {**newest, _ANGLE: "angle", _HORIZON: "horizon"}


def _modes(flight: Flight) -> tuple[tuple[str, float, float], ...]:
    boxes = _leveling(flight)
    levels = flight.slow_field(_FLAGS) & sum(boxes)
    words = {int(level): next((word for box, word in boxes.items() if level & box), "acro") for level in set(levels)}
    return stays_of(flight.slow_time_s, levels, words, until_s=float(flight.time_s[-1]))


def _sorted(each: Iterable[Intervals]) -> Intervals:
    return tuple(sorted(interval for intervals in each for interval in intervals))
