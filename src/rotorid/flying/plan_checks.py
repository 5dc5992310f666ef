"""A log against a plan: whether its firmware flies the plan's files, and whether what was planned was flown.

Each sweep, multisine and random binary signal of the plan is compared with the one that the log has in its place: axis,
band, length, and size where the log holds the test input alone.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.display import counted
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.data.record import AXES, FlightRecord, Kind, Maneuver
from rotorid.data.trust import RICH_KINDS
from rotorid.errors import UsageError
from rotorid.signal.excitations import find_excitations
from rotorid.typing import Axis

_HIGHEST, _LOWEST = 1.3, 2.5
"""Factors within which the ends of a band agree: the upper one decides what a model sees, and the lower one is found
from few periods, a factor of two off in a flight that was flown as planned."""

_LENGTH = 1.4
"""Factor within which lengths agree: fades, and the first slow period, belong to a found interval or not."""

_SIZE = 1.25
"""Factor within which the sizes of a logged test input agree."""


def plan_findings(record: FlightRecord, plan: FlightPlan) -> tuple[Finding, ...]:
    """Checks of a plan against a log, before or after its flight.

    Parameters
    ----------
    record
        A log of the vehicle.

    Returns
    -------
    tuple of Finding
        ``plan_firmware``: whether the firmware flies the plan's files, which differs between versions of ArduCopter;
        of other autopilots it is a remark that nothing was checked. ``plan_not_flown``: what the log does not have of
        the plan, a remark where it has nothing of it, as a log from before the flight. ``plan_differs``: a test input
        that was flown with another band, length or size, or on an axis that the plan does not have.
    """
    return (*_of_firmware(record, plan), *_compare_with_plan(record, plan))


def _of_firmware(record: FlightRecord, plan: FlightPlan) -> tuple[Finding, ...]:
    source = record.source
    found = autopilot_of(record).plan_findings(plan, source.firmware)
    if found is not None:
        return found
    called = source.firmware or f"The firmware of this {source.format} log"
    sentence = f"{called} was not checked against the plan: only ArduCopter's versions are known."
    return (remark("plan_firmware", "firmware", sentence),)


def _compare_with_plan(record: FlightRecord, plan: FlightPlan) -> tuple[Finding, ...]:
    """Pairs of rich inputs, of the plan and of the log. Doublets are left out: those of a pilot have many names."""
    planned: dict[tuple[Axis, Kind], list[PlannedInput]] = defaultdict(list)
    for planned_input in plan.inputs:
        if planned_input.entry != "stick" and planned_input.maneuver.kind in RICH_KINDS:
            planned[planned_input.axis, planned_input.maneuver.kind].append(planned_input)
    found: dict[tuple[Axis, Kind], list[Maneuver]] = defaultdict(list)
    for axis in AXES:
        for maneuver in find_excitations(record, axis):  # type: ignore[arg-type]
            if maneuver.kind in RICH_KINDS:
                found[maneuver.axis, maneuver.kind].append(maneuver)
    total = sum(map(len, planned.values()))
    missing = {what: len(wanted) for what, wanted in planned.items() if len(found[what]) < len(wanted)}
    others = Counter({what: len(flown) for what, flown in found.items() if flown and what not in planned})
    if missing and not any(found[what] for what in planned) and not others:
        return (remark("plan_not_flown", "log", "The log has none of the plan's test inputs.", planned=total),)
    return (
        *(_not_flown(axis, kind, count, len(found[axis, kind])) for (axis, kind), count in missing.items()),
        *(_not_planned(axis, kind, count) for (axis, kind), count in others.items() if planned),
        *(
            finding
            for what, wanted in planned.items()
            for asked, flown in zip(wanted, found[what], strict=False)
            if (finding := _compared(record, asked, flown)) is not None
        ),
    )


def _not_flown(axis: Axis, kind: Kind, planned: int, found: int) -> Finding:
    message = f"The plan has {_counted(planned, kind)} of {axis}, the log has {found or 'none'}."
    return warn("plan_not_flown", axis, message, planned=planned, found=found)


def _not_planned(axis: Axis, kind: Kind, found: int) -> Finding:
    message = f"The log has {_counted(found, kind)} of {axis} not in the plan."
    return warn("plan_differs", axis, message, found=found)


def _counted(count: int, kind: Kind) -> str:
    return counted(count, kind.replace("_", " "))


def _compared(record: FlightRecord, asked: PlannedInput, flown: Maneuver) -> Finding | None:
    """How a test input was flown differently from the plan; ``None`` where it was not."""
    parts = [*_band(asked, flown), *_length(asked, flown), *_size(record, asked, flown)]
    if not parts:
        return None
    words = "; ".join(text for text, _ in parts)
    numbers: Mapping[str, float] = {name: value for _, values in parts for name, value in values.items()}
    message = f"The {flown.kind.replace('_', ' ')} of {asked.axis} at {flown.start_s:.1f} s: {words}."
    return warn("plan_differs", asked.axis, message, **numbers)


_Part = tuple[str, dict[str, float]]


def _band(asked: PlannedInput, flown: Maneuver) -> Iterator[_Part]:
    """Of sweeps, whose periods show it; of other inputs a log shows the lines and levels that gusts leave."""
    if flown.kind != "sweep":
        return
    if asked.band_rad_s is None or flown.band_rad_s is None:
        return
    low, high = (one / other for one, other in zip(flown.band_rad_s, asked.band_rad_s, strict=True))
    if _differ(high, _HIGHEST) or _differ(low, _LOWEST):
        words = f"{flown.band_text} were flown, {asked.maneuver.band_text} planned"
        yield words, {"planned_to_rad_s": asked.band_rad_s[1], "flown_to_rad_s": flown.band_rad_s[1]}


def _length(asked: PlannedInput, flown: Maneuver) -> Iterator[_Part]:
    begin, end = _moving(asked)
    planned_s = (end - begin) / asked.sample_rate_hz
    if _differ(flown.duration_s / planned_s, _LENGTH):
        words = f"it lasted {flown.duration_s:.0f} s, planned {planned_s:.0f} s"
        yield words, {"planned_s": planned_s, "flown_s": flown.duration_s}


def _size(record: FlightRecord, asked: PlannedInput, flown: Maneuver) -> Iterator[_Part]:
    """Only of the test input itself: what a loop makes of it has another size."""
    if flown.signal != asked.signal or flown.signal not in record:
        return
    track = record[flown.signal]
    inside = track.values[(track.time_s >= flown.start_s) & (track.time_s <= flown.stop_s)]
    inside = inside[np.isfinite(inside)]
    if inside.size < 2:
        return
    planned, size = float(np.abs(asked.values).max()), float(np.abs(inside - np.median(inside)).max())
    if _differ(size / planned, _SIZE):
        words = f"its size is {size:.3g} {asked.unit}, planned {planned:.3g} {asked.unit}".replace(" 1,", ",")
        yield words.removesuffix(" 1"), {"planned_size": planned, "flown_size": size}


def _moving(asked: PlannedInput) -> tuple[int, int]:
    """First and last sample that is not zero."""
    moving: Sequence[int] = np.flatnonzero(asked.values).tolist()
    if not moving:
        raise UsageError(f"the test input of {asked.axis} is zero throughout", needed="samples that excite the axis")
    return moving[0], moving[-1] + 1


def _differ(ratio: float, factor: float) -> bool:
    return not ratio > 0.0 or abs(math.log(ratio)) > math.log(factor)
