"""What PX4 says of its vehicle and its flight: kind of vehicle, arming, landing detector, flight mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.numbers import whole
from rotorid.data.record import Intervals, Status, Vehicle
from rotorid.io.flags import MAV_TYPES, before_first, intervals_of, most_frequent, shared, stays_of
from rotorid.typing import AnyArray, FloatArray

STATUS_FIELDS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "vehicle_land_detected": ("landed",),
        "vehicle_status": (*("arming_state", "nav_state", "vehicle_type", "is_rotary_wing", "is_vtol", "system_type"),),
        "actuator_armed": ("armed",),
    }
)
"""Topics and fields to read besides those of the channels."""

_ARMED, _ACRO = 2, 10

_ARMED_FIELDS = (("vehicle_status/arming_state", _ARMED), ("actuator_armed/armed", 1))
"""What says whether it was armed, and the value that does; the first that was logged counts."""

_VEHICLE_TYPES: Mapping[int, Vehicle] = MappingProxyType({1: "multirotor", 2: "plane", 3: "rover", 4: "airship"})
_AIRFRAMES: Mapping[int, Vehicle] = MappingProxyType(
    {
        **dict.fromkeys((0, 7, 8), "multirotor"),
        1: "plane",
        **dict.fromkeys((2, 3, 4), "VTOL"),
        **dict.fromkeys((5, 6), "rover"),
        **dict.fromkeys((10, 11, 12), "helicopter"),
    }
)
"""``CA_AIRFRAME``: the geometry that control allocation works with."""

_STARTS: Sequence[tuple[range, Vehicle]] = (
    (range(2000, 4000), "plane"),
    (range(4000, 13000), "multirotor"),
    (range(13000, 14000), "VTOL"),
    (range(14000, 15000), "multirotor"),
    (range(15000, 17000), "helicopter"),
    (range(17000, 18000), "plane"),
    (range(24000, 25000), "multirotor"),
    (range(50000, 60000), "rover"),
    (range(60000, 62000), "submarine"),
)
"""``SYS_AUTOSTART``: numbers of airframes by their ranges; those of simulators say nothing."""

_REGULAR_S = 2.0
"""The landing detector is logged once a second: what it says first, holds at the beginning of the record too."""


def status_of(arrays: Mapping[str, AnyArray], parameters: Mapping[str, float], span_s: tuple[float, float]) -> Status:
    """What the flags and parameters of a log say.

    In the air is armed and not landed, as the landing detector holds it. Logs without that detector (before 2018) only
    say when the vehicle was armed. Before a flag was first logged it is unknown, unless that is within 2 s.

    Parameters
    ----------
    arrays
        ``topic/field`` to samples as logged, with ``topic/timestamp`` in microseconds.
    parameters
        Of the autopilot.
    span_s
        First and last stamp of the record.
    """
    vehicle, named_in = _vehicle(arrays, parameters)
    armed, armed_in = _armed(arrays, span_s)
    landed = _field_samples(arrays, "vehicle_land_detected/landed")
    in_air = None
    if landed is not None:
        in_air = intervals_of(_from_begin(landed[0], span_s[0]), landed[1] == 0, until_s=span_s[1])
        in_air = in_air if armed is None else shared(in_air, armed)
    named = [name for name in ("vehicle_land_detected" if in_air is not None else "", armed_in) if name]
    return Status(
        vehicle=vehicle,
        named_in=named_in,
        armed=armed,
        in_air=in_air,
        unlogged=_unlogged(arrays, span_s[0]),
        flagged_in=" and ".join(named),
        direct_rates=_acro(arrays, span_s[1]),
        modes=_modes(arrays, span_s[1]),
    )


def _field_samples(arrays: Mapping[str, AnyArray], field: str) -> tuple[FloatArray, AnyArray] | None:
    """Stamps in seconds and values of a field, where it is there."""
    topic = field.partition("/")[0]
    values, stamps = arrays.get(field), arrays.get(f"{topic}/timestamp")
    if values is None or stamps is None or not values.size:
        return None
    return stamps.astype(np.float64) * 1e-6, values


def _from_begin(time_s: FloatArray, begin_s: float) -> FloatArray:
    """Stamps of a flag: what was said within the first second or so, was so when the record began."""
    return np.append(min(begin_s, time_s[0]), time_s[1:]) if time_s[0] < begin_s + _REGULAR_S else time_s


def _armed(arrays: Mapping[str, AnyArray], span_s: tuple[float, float]) -> tuple[Intervals | None, str]:
    for field, value in _ARMED_FIELDS:
        samples = _field_samples(arrays, field)
        if samples is not None:
            time_s = _from_begin(samples[0], span_s[0])
            return intervals_of(time_s, samples[1] == value, until_s=span_s[1]), field.partition("/")[0]
    return None, ""


def _unlogged(arrays: Mapping[str, AnyArray], begin_s: float) -> Intervals:
    """When the record had begun and one of the flags was not logged yet: it is unknown, not off."""
    armed = next((field for field, _ in _ARMED_FIELDS if _field_samples(arrays, field)), "")
    fields = ("vehicle_land_detected/landed", armed)
    firsts = [before_first(samples[0], begin_s) for field in fields if (samples := _field_samples(arrays, field))]
    late = [part for parts in firsts for part in parts if part[1] - part[0] > _REGULAR_S]
    return (max(late, key=lambda part: part[1]),) if late else ()


def _acro(arrays: Mapping[str, AnyArray], until_s: float) -> Intervals:
    """Where the sticks were set-points of rates."""
    samples = _field_samples(arrays, "vehicle_status/nav_state")
    return () if samples is None else intervals_of(samples[0], samples[1] == _ACRO, until_s=until_s)


_MODES: Mapping[int, str] = MappingProxyType(
    {
        0: "manual",
        1: "altitude",
        2: "position",
        3: "mission",
        4: "hold",
        5: "return",
        6: "position slow",
        10: "acro",
        12: "descend",
        13: "termination",
        14: "offboard",
        15: "stabilized",
        17: "takeoff",
        18: "land",
        19: "follow target",
        20: "precision land",
        21: "orbit",
    }
)
"""``nav_state`` as PX4 calls it."""


def _modes(arrays: Mapping[str, AnyArray], until_s: float) -> tuple[tuple[str, float, float], ...]:
    samples = _field_samples(arrays, "vehicle_status/nav_state")
    return () if samples is None else stays_of(*samples, _MODES, until_s=until_s)


def _vehicle(arrays: Mapping[str, AnyArray], parameters: Mapping[str, float]) -> tuple[Vehicle, str]:
    """Kind of vehicle and what says so, the surest first."""
    states = {
        name: most_frequent(arrays[f"vehicle_status/{name}"])
        for name in ("is_vtol", "system_type", "vehicle_type", "is_rotary_wing")
        if arrays.get(f"vehicle_status/{name}", np.empty(0)).size
    }
    if states.get("is_vtol", 0) > 0:
        return "VTOL", "vehicle_status.is_vtol"
    for name, kinds in (("system_type", MAV_TYPES), ("vehicle_type", _VEHICLE_TYPES)):
        if kind := kinds.get(states.get(name, -1), ""):
            return kind, f"vehicle_status.{name} {states[name]}"
    if states.get("is_rotary_wing", 0) > 0:
        return "multirotor", "vehicle_status.is_rotary_wing"
    for name, kinds in (("MAV_TYPE", MAV_TYPES), ("CA_AIRFRAME", _AIRFRAMES)):
        if kind := kinds.get(whole(parameters, name, -1), ""):
            return kind, f"{name} {parameters[name]:g}"
    number = whole(parameters, "SYS_AUTOSTART")
    found: Vehicle = next((kind for numbers, kind in _STARTS if number in numbers), "")
    return found, f"SYS_AUTOSTART {number}" if found else ""
