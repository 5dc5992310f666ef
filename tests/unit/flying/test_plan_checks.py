"""A log against a plan: its firmware, and what of the plan it has."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.report.plan_sample import by_hand, chirp, step

from rotorid.data.flight_plan import FlightPlan
from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.documents.base import to_json
from rotorid.documents.design import plan_document
from rotorid.flying.plan_checks import plan_findings
from rotorid.io import read
from rotorid.typing import Axis

CARD_FLIGHT = "real_stacks/ap_x_wind_soft_card_flight.BIN.xz"
"""ArduCopter 4.7-dev: sweeps of roll and pitch from Stabilize by the script of a plan, then doublets by hand."""


CARD_BAND_HZ = 0.6 / (2.0 * math.pi), 50.0 / (2.0 * math.pi)
CARD_SIZE = {"roll": 0.0191, "pitch": 0.0391}


def card_plan(*axes: Axis, repeats: int = 1, **changes: Any) -> FlightPlan:
    """A plan as that of the card flight: a sweep of each axis, then doublets by the stick."""
    starts = [100.0 * index for index in range(len(axes) * repeats)]
    sweeps = [
        chirp(
            axis,
            start_s=start_s,
            **{"band_hz": CARD_BAND_HZ, "duration_s": 82.5, "amplitude": CARD_SIZE.get(axis, 0.02)} | changes,
        )
        for axis, start_s in zip(axes * repeats, starts, strict=True)
    ]
    doublets = [step(axis, start_s=starts[-1] + 100.0, entry="stick") for axis in axes]
    return FlightPlan(name="card", inputs=(*sweeps, *doublets))


def found(record: FlightRecord, plan: FlightPlan) -> list[tuple[str, str, str]]:
    return [(one.kind, one.severity, one.where) for one in plan_findings(record, plan)]


def named(firmware: str, form: str = "ArduPilot DataFlash") -> FlightRecord:
    """A log of nothing but its firmware's name."""
    time_s = np.arange(0.0, 1.0, 0.01)
    gyro = Topic(name="IMU", time_s=time_s, channels=(Channel(name="p", unit="rad/s"),), values=np.zeros((1, 100)))
    return FlightRecord(source=Source(name="a.bin", format=form, sha256="", firmware=firmware), topics=(gyro,))


def test_the_flight_of_a_real_card_agrees_with_its_plan(unpacked: Callable[[str], Path]) -> None:
    record = read(unpacked(CARD_FLIGHT))
    findings = plan_findings(record, card_plan("roll", "pitch"))
    assert [(one.kind, one.severity) for one in findings] == [("plan_firmware", "info")]
    assert findings[0].message == (
        "ArduCopter 4.7 flies this plan. Enter System ID from Stabilize; you work the throttle."
    )
    missing = ("plan_not_flown", "warning")
    assert found(record, card_plan("roll", "pitch", "yaw"))[1:] == [(*missing, "yaw")]
    assert found(record, card_plan("roll", "pitch", repeats=2))[1:] == [(*missing, "roll"), (*missing, "pitch")]


@pytest.mark.parametrize(
    ("changes", "words", "number"),
    [
        ({"band_hz": (CARD_BAND_HZ[0], 16.0)}, "0.6 to 50 rad/s were flown, 0.6 to 101 rad/s planned", 50.0),
        ({"duration_s": 55.0}, "it lasted 82 s, planned 55 s", 82.46),
        ({"amplitude": 0.04}, "its size is 0.0191, planned 0.04", 0.0191),
    ],
)
def test_band_length_and_size_are_compared(
    unpacked: Callable[[str], Path], changes: dict[str, Any], words: str, number: float
) -> None:
    """SYSTEMID logs the test input alone, with its size."""
    findings = plan_findings(read(unpacked(CARD_FLIGHT)), card_plan("roll", "pitch", **changes))
    (found,) = [one for one in findings if one.kind == "plan_differs" and one.where == "roll"]
    assert words in found.message
    assert any(value == pytest.approx(number, rel=1e-2) for value in found.numbers.values())


def test_an_axis_that_the_plan_has_not_is_named(unpacked: Callable[[str], Path]) -> None:
    findings = plan_findings(read(unpacked(CARD_FLIGHT)), card_plan("roll", "yaw"))
    told = {(one.kind, one.where): one.message for one in findings}
    assert told["plan_differs", "pitch"] == "The log has 1 sweep of pitch not in the plan."
    assert told["plan_not_flown", "yaw"] == "The plan has 1 sweep of yaw, the log has none."


def test_sweeps_of_an_offboard_script_are_flown_as_planned(unpacked: Callable[[str], Path]) -> None:
    """Found in set-points and not declared: their lowest frequency is found a factor of two off, their length 10 %."""
    record = read(unpacked("real_stacks/px4_sih_offboard_plan.ulg.xz"))
    sweeps = [
        chirp(axis, start_s=50.0 * place, entry="attitude_setpoint", band_hz=CARD_BAND_HZ, duration_s=40.0)
        for place, axis in enumerate(("roll", "pitch"))
    ]
    assert [one.kind for one in plan_findings(record, FlightPlan(name="script", inputs=tuple(sweeps)))] == [
        "plan_firmware"
    ]


@pytest.mark.parametrize(
    ("firmware", "severity"),
    [("ArduCopter V4.5.7", "info"), ("ArduCopter V4.6.2", "info"), ("ArduCopter V3.6.9", "warning"), ("", "warning")],
)
def test_a_log_from_before_the_flight_is_asked_for_its_firmware(firmware: str, severity: str) -> None:
    assert found(named(firmware), card_plan("roll")) == [
        ("plan_firmware", severity, "firmware"),
        ("plan_not_flown", "info", "log"),
    ]


@pytest.mark.parametrize(("firmware", "severity"), [("ArduCopter V4.6.2", "info"), ("ArduPilot", "warning")])
def test_the_firmware_of_telemetry_is_checked(firmware: str, severity: str) -> None:
    assert found(named(firmware, "MAVLink telemetry"), card_plan("roll"))[0] == ("plan_firmware", severity, "firmware")


def test_other_autopilots_are_not_checked_and_it_is_said() -> None:
    (finding, _) = plan_findings(named("PX4 1.15.4", "PX4 ULog"), card_plan("roll"))
    assert (finding.kind, finding.severity) == ("plan_firmware", "info")
    assert finding.message == "PX4 1.15.4 was not checked against the plan: only ArduCopter's versions are known."


def test_runs_by_the_stick_are_not_counted() -> None:
    (finding,) = plan_findings(named("ArduCopter V4.6.2"), FlightPlan(name="stick", inputs=(by_hand("roll"),)))
    assert finding.kind == "plan_firmware"


@pytest.mark.parametrize("verb", ["inspect", "review"])
def test_the_command_line_compares_a_log_with_a_plan(
    verb: str, unpacked: Callable[[str], Path], tmp_path: Path
) -> None:
    place = tmp_path / "plan.json"
    place.write_text(to_json(plan_document(card_plan("roll", "pitch", "yaw"))))
    options = ("--no-models", "--out", tmp_path / "out") if verb == "review" else ()
    ran = rotorid(verb, unpacked(CARD_FLIGHT), "--plan", place, "--json", *options)
    kinds = {one["kind"]: one["message"] for one in json.loads(ran.out)["findings"]}
    assert kinds["plan_firmware"].startswith("ArduCopter 4.7 flies this plan")
    assert kinds["plan_not_flown"] == "The plan has 1 sweep of yaw, the log has none."
    # Who asks sees the answer on the terminal too, be it that all is well.
    assert "ArduCopter 4.7 flies this plan" in rotorid(verb, unpacked(CARD_FLIGHT), "--plan", place, *options).out
    ran = rotorid(verb, unpacked(CARD_FLIGHT), "--plan", tmp_path / "none.json", *options)
    assert ran.code == 2


def test_gains_of_a_log_name_the_firmware_that_will_fly(unpacked: Callable[[str], Path], tmp_path: Path) -> None:
    ran = rotorid(
        "design", "log_sweep", "--vehicle", "ardupilot_quad", "--axis", "roll", "--band", "3:30", "--duration", "20",
        "--amplitude", "roll=0.03", "--gains", unpacked(CARD_FLIGHT), "--out", tmp_path, "--json",
    )  # fmt: skip
    assert ran.code == 0
    kinds = {one["kind"]: one["severity"] for one in json.loads(ran.out)["findings"]}
    assert kinds["plan_firmware"] == "info"
    assert "not_written" not in kinds
    assert "(ArduCopter 4.7 refuses other modes" in (tmp_path / "ardupilot-1-roll.param").read_text()
    card = (tmp_path / "flight-card.html").read_text()
    assert "ArduCopter 4.7 refuses other modes" in card
    # The simulated pilot keeps the height closer than a hand on the throttle does.
    assert "height, ± 2 m" in card
    assert "local CLIMB_M = 3 " in next(tmp_path.glob("*.lua")).read_text()
