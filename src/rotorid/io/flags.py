"""Flags of autopilots: kinds of vehicles as MAVLink numbers them, and flags over time as intervals."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.record import Intervals, Status, Vehicle
from rotorid.typing import AnyArray, BoolArray, FloatArray

_MULTIROTORS = (2, 3, 13, 14, 15, 29, 35)
_VTOLS = tuple(range(19, 26))

MAV_TYPES: Mapping[int, Vehicle] = MappingProxyType(
    {
        **dict.fromkeys(_MULTIROTORS, "multirotor"),
        **dict.fromkeys(_VTOLS, "VTOL"),
        1: "plane",
        4: "helicopter",
        5: "antenna tracker",
        7: "airship",
        8: "airship",
        10: "rover",
        11: "boat",
        12: "submarine",
    }
)
"""``MAV_TYPE`` of MAVLink to the kind of vehicle."""


def intervals_of(time_s: FloatArray, on: BoolArray, *, until_s: float) -> Intervals:
    """When a flag was on: each value holds until the next one is logged, the last one until the record ends.

    Parameters
    ----------
    time_s
        Stamps, shape ``(samples,)``; those that are no number or step back are put in order first.
    on
        The flag, shape ``(samples,)``.

    Examples
    --------
    >>> intervals_of(np.array([0.0, 1.0, 5.0, 9.0]), np.array([False, True, True, False]), until_s=12.0)
    ((1.0, 9.0),)
    >>> intervals_of(np.array([0.0, 7.0]), np.array([False, True]), until_s=12.0)
    ((7.0, 12.0),)
    """
    finite = np.isfinite(time_s)
    order = np.argsort(time_s[finite], kind="stable")
    time_s, on = time_s[finite][order], np.asarray(on, dtype=np.bool_)[finite][order]
    if not time_s.size:
        return ()
    edges = np.diff(np.concatenate([[False], on, [False]]).astype(np.int8))
    ends = np.append(time_s, max(until_s, float(time_s[-1])))
    pairs = zip(time_s[np.flatnonzero(edges == 1)], ends[np.flatnonzero(edges == -1)], strict=True)
    return tuple((float(start), float(stop)) for start, stop in pairs if start < stop)


def before_first(time_s: FloatArray, begin_s: float) -> Intervals:
    """From the beginning of a record to the first sample of its flags, when nothing is known of them.

    Examples
    --------
    >>> before_first(np.array([3.0, 4.0]), 1.0), before_first(np.array([1.0, 4.0]), 1.0)
    (((1.0, 3.0),), ())
    """
    first_s = float(np.min(time_s[np.isfinite(time_s)], initial=np.inf))
    return ((begin_s, first_s),) if begin_s < first_s < np.inf else ()


def shared(one: Intervals, other: Intervals) -> Intervals:
    """What two rows of intervals have in common.

    Examples
    --------
    >>> shared(((0.0, 5.0), (7.0, 9.0)), ((4.0, 8.0),))
    ((4.0, 5.0), (7.0, 8.0))
    """
    parts = ((max(a, c), min(b, d)) for a, b in one for c, d in other)
    return tuple((start, stop) for start, stop in parts if start < stop)


def stays_of(
    time_s: FloatArray, modes: AnyArray, names: Mapping[int, str], *, until_s: float
) -> tuple[tuple[str, float, float], ...]:
    """Name, start and stop of each stay in a flight mode, in order of time; one without a name has its number.

    Parameters
    ----------
    time_s, modes
        Stamps and numbers, shape ``(samples,)``; a mode holds until the next one is logged.
    names
        Number to name.
    until_s
        End of the record.

    Examples
    --------
    >>> stays_of(np.array([0.0, 4.0, 5.0]), np.array([2, 2, 9]), {2: "altitude"}, until_s=8.0)
    (('altitude', 0.0, 5.0), ('mode 9', 5.0, 8.0))
    """
    found = [
        (names.get(number, f"mode {number}"), start_s, stop_s)
        for number in np.unique(modes).tolist()
        for start_s, stop_s in intervals_of(time_s, modes == number, until_s=until_s)
    ]
    return tuple(sorted(found, key=lambda stay: stay[1]))


def vehicle_findings(status: Status) -> tuple[Finding, ...]:
    """What to say of a vehicle that is no multirotor."""
    if not status.foreign:
        return ()
    article = "an" if status.vehicle[0] in "aeiou" else "a"
    message = (
        f"The log is of {article} {status.vehicle}, as {status.named_in} says, and no multirotor: models, filters and "
        "advice for multirotors do not fit it. Its responses can be measured all the same."
    )
    return (warn("other_vehicle", status.named_in, message),)


def most_frequent(values: AnyArray) -> int:
    """The value that a field which should not change has most of the time."""
    found, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    return int(found[np.argmax(counts)]) if found.size else -1
