"""Files by which an autopilot flies a plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rotorid.data.flight_plan import FlightPlan
from rotorid.plans.facts import FlightFacts


def plan_files(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    """Name to text, by the autopilot of the facts; none for one that flies no files.

    Raises
    ------
    UsageError
        The autopilot cannot fly the plan.
    """
    from rotorid.plans.ardupilot import ardupilot_files
    from rotorid.plans.betaflight import betaflight_files
    from rotorid.plans.px4 import px4_files

    files: Mapping[str, Callable[[FlightPlan, FlightFacts], Mapping[str, str]]]
    files = {"ArduPilot": ardupilot_files, "PX4": px4_files, "Betaflight": betaflight_files}
    return dict(files[facts.autopilot](plan, facts)) if facts.autopilot in files else {}
