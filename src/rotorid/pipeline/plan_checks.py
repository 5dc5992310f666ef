"""A log against a plan: whether its firmware flies the plan's files, and whether what was planned was flown."""

from __future__ import annotations

from collections import Counter

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.flight_plan import FlightPlan
from rotorid.data.record import FlightRecord
from rotorid.data.trust import RICH_KINDS
from rotorid.io.ardupilot.system_id import firmware_findings
from rotorid.signal.excitations import find_excitations


def plan_findings(record: FlightRecord, plan: FlightPlan) -> tuple[Finding, ...]:
    """What a log says about a plan, before its flight or after it.

    Parameters
    ----------
    record
        A log of the vehicle.
    plan
        What is to be flown, or was.

    Returns
    -------
    tuple of Finding
        ``plan_firmware``: whether the firmware flies the plan's files, which differs between versions of ArduCopter;
        of other autopilots it is a remark that nothing was checked. ``plan_not_flown``: what the log does not have of
        the plan, a remark where it has nothing of it, as a log from before the flight.
    """
    return (*_of_firmware(record, plan), *_not_flown(record, plan))


def _of_firmware(record: FlightRecord, plan: FlightPlan) -> tuple[Finding, ...]:
    source = record.source
    if source.format.startswith("ArduPilot"):
        return firmware_findings(plan, source.firmware)
    called = source.firmware or f"The firmware of this {source.format} log"
    said = f"{called} was not checked against the plan: only ArduCopter's versions are known."
    return (remark("plan_firmware", "firmware", said),)


def _not_flown(record: FlightRecord, plan: FlightPlan) -> tuple[Finding, ...]:
    """Rich inputs of the plan that the log lacks. Doublets verify, and a hand's are found under many names."""
    planned = Counter(
        (one.axis, one.maneuver.kind) for one in plan.inputs if one.entry != "stick" and one.maneuver.kind in RICH_KINDS
    )
    axes = dict.fromkeys(axis for axis, _ in planned)
    found = Counter((axis, maneuver.kind) for axis in axes for maneuver in find_excitations(record, axis))
    missing = {what: count for what, count in planned.items() if found[what] < count}
    if missing and not any(found[what] for what in planned):
        return (
            remark("plan_not_flown", "log", "The log has none of the plan's test inputs.", planned=planned.total()),
        )
    return tuple(
        warn(
            "plan_not_flown",
            axis,
            f"The plan has {count} {kind.replace('_', ' ')}{'s' if count > 1 else ''} of {axis}, "
            f"the log has {found[axis, kind] or 'none'}.",
            planned=count,
            found=found[axis, kind],
        )
        for (axis, kind), count in missing.items()
    )
