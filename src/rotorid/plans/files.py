"""Files by which an autopilot flies a plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, kw_only=True, slots=True)
class FileUse:
    """What to do with the files of a plan before and after its flight, in sentences; empty where nothing is to do."""

    before: str = ""
    after: str = ""


def file_use(names: Sequence[str]) -> FileUse:
    """When each file of a plan is loaded, copied or run, from the names of its files.

    Examples
    --------
    >>> file_use(["px4.params", "px4_fly_plan.py", "plan.csv"]).before
    'Before the flight, note your own values of the parameters in px4.params, load it and reboot. To fly, run
    px4_fly_plan.py in the folder of plan.csv.'
    >>> file_use(["plan.csv"]).before
    ''
    """
    from rotorid.plans import ardupilot, betaflight, px4

    if px4.SCRIPT in names:
        return FileUse(
            before=f"Before the flight, note your own values of the parameters in {px4.PARAMETERS}, load it and "
            f"reboot. To fly, run {px4.SCRIPT} in the folder of plan.csv.",
            after=f"After the flight, set the parameters in {px4.PARAMETERS} back to your own values.",
        )
    if betaflight.FILE in names:
        return FileUse(
            before=f"Before the flight, save your settings (diff all), then paste {betaflight.FILE} into the CLI.",
            after="After the flight, paste your saved settings into the CLI.",
        )
    if ardupilot.AFTER in names:
        return _ardupilot_use(names)
    return FileUse()


def _ardupilot_use(names: Sequence[str]) -> FileUse:
    from rotorid.plans import ardupilot

    runs = [name for name in names if name.endswith(".param") and name not in (ardupilot.AFTER, ardupilot.LOG)]
    script = next((name for name in names if name.endswith(".lua")), "")
    after = f"After the flight, load {ardupilot.AFTER}. Remove {script} from APM/scripts if you used it."
    if not runs:
        table = next((name for name in names if name.endswith("-attitude.csv")), "")
        before = f"Before the flight, load {ardupilot.LOG}, copy {script} and {table} to APM/scripts, and reboot."
        return FileUse(before=before, after=after)
    if len(runs) == 1:
        load, what = f"Before the flight, load {runs[0]}", "it"
    else:
        load, what = f"Before each run, load its file ({', '.join(runs)})", "all runs in one flight"
    return FileUse(
        before=f"{load}, refresh the parameters and load it again. Or let a script fly {what}: load {runs[0]} the same "
        f"way, copy {script} to APM/scripts, set SCR_ENABLE to 1 and reboot.",
        after=after,
    )
