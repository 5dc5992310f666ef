"""Which ArduPilot flies what in SYSTEMID mode, and from which flight mode it may be entered: one table, by version.

A plan's script, its parameter files, the flight card and the check of a log against a plan all ask this table.

References
----------
ArduPilot, ``ModeSystemId::init`` in ``ArduCopter/mode_systemid.cpp``, before and after pull request 24801 (May 2024,
first released with Copter 4.6), which asks for manual throttle and adds axes 14 to 19; unchanged in 4.7.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias

from rotorid.autopilots.ardupilot.firmware import named
from rotorid.autopilots.firmware import Version
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.flight_plan import Entry, FlightPlan
from rotorid.typing import Axis

Throttle: TypeAlias = Literal["pilot", "autopilot"]
"""Who works the throttle in the mode: the pilot's stick is the thrust, or the autopilot keeps the height."""

SYSTEM_ID_MODE = 25


class FlightMode(NamedTuple):
    """A flight mode of Copter: its number, and its name for a script and for a pilot."""

    number: int
    name: str
    words: str


STABILIZE = FlightMode(0, "STABILIZE", "Stabilize")
ACRO = FlightMode(1, "ACRO", "Acro")
LOITER = FlightMode(5, "LOITER", "Loiter")

_HOVERS = (STABILIZE, LOITER)
"""Modes from which a run begins: the vehicle levels itself there. Acro has manual throttle too, and does not."""


class EntryRule(NamedTuple):
    """From which flight modes some firmware enters SYSTEMID mode in flight.

    Parameters
    ----------
    since, before
        Copter versions with this rule: from ``since`` on, until ``before``; ``None``: still.
    axes
        Values of ``SID_AXIS``.
    accepted
        Flight modes to come from; empty: any.
    throttle
        Who works it in the mode.
    says
        The firmware's words when it refuses.
    """

    since: Version
    before: Version | None
    axes: range
    accepted: tuple[FlightMode, ...]
    throttle: Throttle
    says: str = ""

    def accepts(self, mode: FlightMode) -> bool:
        """Whether SYSTEMID mode may be entered from a mode."""
        return not self.accepted or mode in self.accepted


RULES = (
    EntryRule(since=(4, 0), before=(4, 6), axes=range(1, 14), accepted=(), throttle="pilot"),
    EntryRule(
        since=(4, 6),
        before=None,
        axes=range(1, 14),
        accepted=(STABILIZE, ACRO),
        throttle="pilot",
        says="Axis requires manual throttle",
    ),
    EntryRule(
        since=(4, 6),
        before=None,
        axes=range(14, 20),
        accepted=(LOITER,),
        throttle="autopilot",
        says="Axis requires switch from Loiter",
    ),
)
"""What each version accepts. Attitudes, rates and the mixer are axes 1 to 13, positions and velocities 14 to 19."""

CHECKED: tuple[Version, ...] = ((4, 5), (4, 6), (4, 7))
"""Copter versions that the files of a plan were made for. Its scripts call functions that older ones lack."""

SID_AXIS: Mapping[tuple[Entry, Axis], int] = MappingProxyType(
    {
        ("attitude_setpoint", "roll"): 1,
        ("attitude_setpoint", "pitch"): 2,
        ("rate_setpoint", "roll"): 7,
        ("rate_setpoint", "pitch"): 8,
        ("rate_setpoint", "yaw"): 9,
        ("command", "roll"): 10,
        ("command", "pitch"): 11,
        ("command", "yaw"): 12,
        ("command", "thrust"): 13,
    }
)
"""Where a test input enters, as ``SID_AXIS`` numbers it; 3 is a rate that the pilot's stick asks for, not an angle."""


def rule_of(axis: int, version: Version) -> EntryRule | None:
    """How a Copter version enters an axis; ``None`` where it has none such.

    Parameters
    ----------
    axis
        ``SID_AXIS``.
    version
        Of Copter, major and minor.

    Examples
    --------
    >>> rule_of(10, (4, 7)).says, rule_of(14, (4, 5)), rule_of(10, (3, 6))
    ('Axis requires manual throttle', None, None)
    """
    return next(
        (
            rule
            for rule in RULES
            if axis in rule.axes and rule.since <= version and (rule.before is None or version < rule.before)
        ),
        None,
    )


def start_mode(axis: int) -> FlightMode:
    """The flight mode in which to hover before a run: every version that the files are for enters the axis from it.

    Parameters
    ----------
    axis
        ``SID_AXIS``, 1 to 19.

    Examples
    --------
    >>> start_mode(10).words, start_mode(18).words
    ('Stabilize', 'Loiter')
    """
    rules = _rules(axis)
    return next(mode for mode in _HOVERS if all(rule.accepts(mode) for rule in rules))


def throttle_of(axis: int) -> Throttle:
    """Who works the throttle while an axis is excited.

    Examples
    --------
    >>> throttle_of(13), throttle_of(14)
    ('pilot', 'autopilot')
    """
    return _rules(axis)[-1].throttle


def _rules(axis: int) -> list[EntryRule]:
    return [rule for version in CHECKED if (rule := rule_of(axis, version)) is not None]


def sid_axes(plan: FlightPlan) -> tuple[int, ...]:
    """``SID_AXIS`` of each sweep of a plan that SYSTEMID mode can fly, in their order."""
    return tuple(
        number
        for planned in plan.inputs
        if planned.shape == "logarithmic_sweep" and (number := SID_AXIS.get((planned.entry, planned.axis))) is not None
    )


def firmware_findings(plan: FlightPlan, firmware: str) -> tuple[Finding, ...]:
    """Whether a firmware flies the ArduPilot files of a plan, and how it has to be entered.

    Parameters
    ----------
    firmware
        As a log names it, ``ArduCopter V4.6.2 (3fc7011a)``; empty where it does not.

    Returns
    -------
    tuple of Finding
        One of the kind ``plan_firmware``: a remark where the version is one of those that the files are for, else a
        warning. A version that is not known is a warning: nothing was checked.

    Examples
    --------
    >>> from rotorid.data.flight_plan import PlannedInput
    >>> sweep = PlannedInput(axis="roll", shape="logarithmic_sweep", start_s=0.0, values=[0.1], sample_rate_hz=10.0,
    ...                      amplitude=0.1)
    >>> plan = FlightPlan(name="roll", inputs=(sweep,))
    >>> [finding] = firmware_findings(plan, "ArduCopter V4.7.0-dev (e4b2f4c6)")
    >>> finding.message
    'ArduCopter 4.7 flies this plan. Enter System ID from Stabilize; you work the throttle.'
    """
    axes = sid_axes(plan)
    version = named(firmware).copter
    oldest, newest = (".".join(map(str, version)) for version in (CHECKED[0], CHECKED[-1]))
    files = f"the files of this plan are for ArduCopter {oldest} to {newest}"
    if version is None:
        came = "The log does not say the version of its firmware"
        if firmware not in ("", "ArduPilot"):
            came = f"The log is of {firmware}, not of ArduCopter"
        return (warn("plan_firmware", "firmware", f"{came}; {files}."),)
    called = f"ArduCopter {version[0]}.{version[1]}"
    numbers = {"major": float(version[0]), "minor": float(version[1])}
    if any(rule_of(axis, version) is None for axis in axes):
        remedy = "Update the firmware, or plan for the stick (--entry stick)."
        message = f"{called} has no System ID mode for this plan; {files}. {remedy}"
        return (warn("plan_firmware", "firmware", message, **numbers),)
    if version not in CHECKED:
        single = " Load its .param files and fly the runs one by one." if axes and version < CHECKED[0] else ""
        age = "older" if version < CHECKED[0] else "newer"
        message = f"{called} is {age} than this plan's files were checked with: {files}.{single}"
        return (warn("plan_firmware", "firmware", message, **numbers),)
    return (remark("plan_firmware", "firmware", f"{called} flies this plan.{_how(axes)}", **numbers),)


def _how(axes: Iterable[int]) -> str:
    """From where the mode is entered, and who works the throttle, where the plan needs the mode."""
    ways = dict.fromkeys((start_mode(axis).words, throttle_of(axis)) for axis in axes)
    hands = {"pilot": "you work the throttle", "autopilot": "the autopilot works the throttle"}
    return "".join(f" Enter System ID from {mode}; {hands[throttle]}." for mode, throttle in ways)


def entry_reason(axis: int, firmware: str = "") -> str:
    """Why SYSTEMID mode is entered from the mode in which a run begins, as the end of a sentence for the pilot.

    Parameters
    ----------
    axis
        ``SID_AXIS``.
    firmware
        As a log names it; where it is not known, the words say which versions differ.

    Examples
    --------
    >>> entry_reason(10)
    'firmware 4.6 and later refuses other modes: "Axis requires manual throttle"'
    >>> entry_reason(10, "ArduCopter V4.7.0")
    'ArduCopter 4.7 refuses other modes: "Axis requires manual throttle"'
    >>> entry_reason(10, "ArduCopter V4.5.7")
    'there your hand is on the throttle already'
    """
    strict = next(rule for rule in RULES if axis in rule.axes and rule.accepted)
    version = named(firmware).copter
    if version is not None and version < strict.since:
        return "there your hand is on the throttle already"
    major, minor = version or strict.since
    who = f"firmware {major}.{minor} and later" if version is None else f"ArduCopter {major}.{minor}"
    return f'{who} refuses other modes: "{strict.says}"'


def how_to_fly(plan: FlightPlan, firmware: str) -> str:
    """What the pilot does in SYSTEMID mode, entered as the firmware wants it for the axes of a plan."""
    axis = sid_axes(plan)[0]
    mode = start_mode(axis).words
    hands, drift = {
        "pilot": (
            "You work the throttle, near the middle in hover.",
            "Correct drift slowly and gently, let it shake, ",
        ),
        "autopilot": ("The autopilot works the throttle and ignores the sticks.", "When it is over, "),
    }[throttle_of(axis)]
    return (
        f"{hands} Each run: hover in {mode} in the middle of the room ({entry_reason(axis, firmware)}), then "
        f"switch to System ID or let the script do so. {drift}then back to {mode}."
    )
