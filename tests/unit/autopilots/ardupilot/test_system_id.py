"""Which ArduPilot flies what in SYSTEMID mode: the table, and what a log's version says about a plan."""

from __future__ import annotations

import pytest
from tests.docs.firmware_table import PAGE, firmware_table, refilled

from rotorid.autopilots.ardupilot.system_id import (
    ACRO,
    CHECKED,
    LOITER,
    RULES,
    SID_AXIS,
    STABILIZE,
    FlightMode,
    firmware_findings,
    rule_of,
    sid_axes,
    start_mode,
    throttle_of,
)
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape
from rotorid.io.ardupilot.system_id import ENTRIES
from rotorid.typing import Axis

ALT_HOLD = FlightMode(2, "ALT_HOLD", "AltHold")


def plan(axis: Axis = "roll", *, entry: Entry = "command", shape: Shape = "logarithmic_sweep") -> FlightPlan:
    only = PlannedInput(
        axis=axis, shape=shape, start_s=0.0, values=[0.0, 0.1], sample_rate_hz=10.0, amplitude=0.1, entry=entry
    )
    return FlightPlan(name="one", inputs=(only,))


@pytest.mark.parametrize(
    ("version", "axis", "accepted", "says"),
    [
        ((3, 6), 10, None, ""),
        ((4, 5), 1, (STABILIZE, ACRO, ALT_HOLD, LOITER), ""),
        ((4, 5), 13, (STABILIZE, ACRO, ALT_HOLD, LOITER), ""),
        ((4, 5), 14, None, ""),
        ((4, 6), 1, (STABILIZE, ACRO), "Axis requires manual throttle"),
        ((4, 7), 13, (STABILIZE, ACRO), "Axis requires manual throttle"),
        ((4, 6), 14, (LOITER,), "Axis requires switch from Loiter"),
        ((4, 7), 19, (LOITER,), "Axis requires switch from Loiter"),
        ((4, 7), 20, None, ""),
        ((4, 7), 0, None, ""),
    ],
)
def test_the_table_is_that_of_the_firmware(
    version: tuple[int, int], axis: int, accepted: tuple[FlightMode, ...] | None, says: str
) -> None:
    """As ``ModeSystemId::init`` has it, read in the source of each version."""
    rule = rule_of(axis, version)
    if accepted is None:
        assert rule is None
        return
    assert rule is not None
    assert tuple(mode for mode in (STABILIZE, ACRO, ALT_HOLD, LOITER) if rule.accepts(mode)) == accepted
    assert rule.says == says


def test_no_two_rules_answer_for_one_axis_and_version() -> None:
    for version in ((3, 9), (4, 0), (4, 4), *CHECKED, (4, 8)):
        for axis in range(21):
            answers = [
                rule
                for rule in RULES
                if axis in rule.axes and rule.since <= version and (rule.before is None or version < rule.before)
            ]
            assert len(answers) <= 1


@pytest.mark.parametrize("axis", range(1, 20))
def test_a_run_begins_where_every_version_that_has_the_axis_takes_it(axis: int) -> None:
    """In a mode that levels, and in the one in which the throttle stick means what it means in the run."""
    mode = start_mode(axis)
    assert mode == (STABILIZE if axis < 14 else LOITER)
    assert throttle_of(axis) == ("pilot" if mode == STABILIZE else "autopilot")
    for version in CHECKED:
        rule = rule_of(axis, version)
        assert rule is None or rule.accepts(mode)


def test_a_plan_enters_where_the_reader_of_logs_finds_it() -> None:
    assert {number: ENTRIES[number][0] for number in SID_AXIS.values()} == {
        number: axis for (_, axis), number in SID_AXIS.items()
    }
    assert sid_axes(plan("yaw", entry="rate_setpoint")) == (9,)
    assert sid_axes(plan(shape="multisine", entry="attitude_setpoint")) == ()
    assert sid_axes(plan(entry="stick")) == ()


@pytest.mark.parametrize(
    ("firmware", "severity", "words"),
    [
        (
            "",
            "warning",
            "The log does not say the version of its firmware; the files of this plan are for ArduCopter 4.5 to 4.7",
        ),
        ("ArduPlane V4.6.1 (abc)", "warning", "The log is of ArduPlane V4.6.1 (abc), not of ArduCopter"),
        ("ArduCopter V3.6.12 (3f5ab1d0)", "warning", "ArduCopter 3.6 has no System ID mode for this plan"),
        ("ArduCopter V4.3.8 (b85d6bca)", "warning", "Load its .param files and fly the runs one by one"),
        ("ArduCopter V4.5.7 (2a3dc4b7)", "info", "ArduCopter 4.5 flies this plan. Enter System ID from Stabilize"),
        ("ArduCopter V4.6.2 (3fc7011a)", "info", "you work the throttle"),
        ("ArduCopter V4.7.0-dev (e4b2f4c6)", "info", "ArduCopter 4.7 flies this plan"),
        ("ArduCopter V4.8.0-dev (00000000)", "warning", "ArduCopter 4.8 is newer than this plan's files"),
    ],
)
def test_the_version_of_a_log_is_compared_with_a_plan(firmware: str, severity: str, words: str) -> None:
    (finding,) = firmware_findings(plan(), firmware)
    assert (finding.kind, finding.severity) == ("plan_firmware", severity)
    assert words in finding.message


def test_a_plan_for_guided_mode_is_entered_by_its_script() -> None:
    guided = plan(shape="multisine", entry="attitude_setpoint")
    (finding,) = firmware_findings(guided, "ArduCopter V4.7.0")
    assert finding.message == "ArduCopter 4.7 flies this plan."
    (finding,) = firmware_findings(guided, "ArduCopter V3.6.12")
    assert "older than this plan's files" in finding.message
    assert ".param" not in finding.message


def test_the_docs_have_the_table_of_today() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert firmware_table() in text
    assert refilled(text) == text, "run python tests/docs/firmware_table.py"
