"""Controllers of real flights: one for all readers, gains that flew made the commands, and others did not."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from tests.unit.flights.controller_readers import readings, verdicts

import rotorid
from rotorid.data.axes import RATE_OF
from rotorid.data.record import FlightRecord
from rotorid.flights.controller_check import ControllerVerdict, check_controller
from rotorid.flights.controllers import controllers_of

# Roll, pitch, yaw. Where none was checked the log is too slow, or holds no flight.
FLIGHTS: Mapping[str, tuple[ControllerVerdict, ControllerVerdict, ControllerVerdict]] = {
    "px4_sitl/roll.ulg": ("made", "made", "made"),
    "px4_sitl/verify.ulg.xz": ("made", "made", "made"),
    "px4/sample_old_1MB.ulg": ("made", "made", "made"),
    "real_stacks/px4_sih_offboard_plan.ulg.xz": ("made", "made", "made"),
    "everyday/px4_115_s500.ulg.xz": ("not checked", "not checked", "made"),
    "ardupilot_sitl/x_wind_rollpitch.BIN.xz": ("made", "made", "made"),
    "ardupilot_sitl/x_wind_yawthrust.BIN.xz": ("made", "made", "made"),
    "ardupilot/erle_brain3.BIN": ("made", "made", "made"),
    "ardupilot/beast_0036.BIN": ("not checked", "not checked", "not checked"),
    # Without the bumps of the touch-down, P of pitch is 1.12 ± 0.09 times its value: too rough to be checked.
    "real_stacks/ap_x_wind_limit_cycle.BIN.xz": ("made", "not checked", "made"),
    "real_stacks/ap_x_wind_ordinary_hard.BIN.xz": ("not checked", "not checked", "not checked"),
    "real_stacks/ap_x_wind_soft_tuned_card_flight.BIN.xz": ("made", "made", "made"),
    "everyday/betaflight_431_freestyle.bbl.xz": ("made", "made", "made"),
}
UNKNOWN = ("betaflight/smooth_tune.BBL", "crazyflie/log10", "everyday/arducopter_321_1.BIN.xz")
_GAIN = re.compile(r"MC_(ROLL|PITCH|YAW)RATE_[PID]|ATC_RAT_(RLL|PIT|YAW)_[PID]|(roll|pitch|yaw)PID_[PID]|d_min_\d")


Read = Callable[[str], FlightRecord]


@pytest.fixture(scope="module")
def read(unpacked: Callable[[str], Path]) -> Read:
    """Each log read once: it is checked with its own gains and with three sets of others."""
    return cache(lambda name: rotorid.read(unpacked(name)))


def scaled(record: FlightRecord, factor: float) -> FlightRecord:
    """The log with other rate gains among its parameters, flown by the same firmware."""
    parameters = {name: value * factor if _GAIN.fullmatch(name) else value for name, value in record.parameters.items()}
    source = replace(record.source, firmware=controllers_of(record).firmware.name)
    return replace(record, parameters=parameters, source=source)


@pytest.mark.parametrize("name", FLIGHTS)
def test_all_readers_agree_and_gains_that_flew_made_the_commands(name: str, read: Read) -> None:
    record = read(name)
    for axis, expected in zip(RATE_OF, FLIGHTS[name], strict=True):
        found = readings(record, axis)
        assert found["tune"] is not None
        assert len(set(found.values())) == 1, (axis, found)
        assert check_controller(record, axis).verdict == expected, check_controller(record, axis)
        assert set(verdicts(record, axis).values()) == {expected}


@pytest.mark.parametrize("name", [name for name in FLIGHTS if set(FLIGHTS[name]) != {"not checked"}])
@pytest.mark.parametrize("factor", [1.2, 0.8, 2.0])
def test_other_gains_never_made_the_commands(name: str, factor: float, read: Read) -> None:
    record = read(name)
    other = scaled(record, factor)
    for axis, expected in zip(RATE_OF, FLIGHTS[name], strict=True):
        verdict = check_controller(other, axis).verdict
        # Of 11 s at 48 Hz, and of yaw at 47 Hz, 20 % are not beyond doubt.
        short = factor < 2.0 and name in ("px4/sample_old_1MB.ulg", "everyday/px4_115_s500.ulg.xz")
        assert verdict == "not made" or (verdict == "not checked" and (short or expected == "not checked")), axis


@pytest.mark.parametrize("name", UNKNOWN)
def test_an_unknown_controller_is_none_for_all(name: str, read: Read) -> None:
    record = read(name)
    for axis in RATE_OF:
        assert set(readings(record, axis).values()) == {None}
        assert check_controller(record, axis).verdict == "not checked"


def test_betaflight_is_checked_where_its_set_point_is_logged(read: Read) -> None:
    record = read("everyday/betaflight_431_freestyle.bbl.xz")
    check = check_controller(record, "roll")
    assert "p_setpoint" in record.channel_names
    assert check.setpoint == "p_setpoint"
    assert check.terms["p"].slope == pytest.approx(1.0, abs=0.01)
    # Its log has every fourth step.
    roll = controllers_of(record).axis("roll")
    assert roll is not None
    assert roll.loop_rate_hz == pytest.approx(4000.0)


def test_px4_before_1_12_filters_its_derivative_twice_everywhere(read: Read) -> None:
    record = read("px4/sample_log_small.ulg")
    for found in readings(record, "roll").values():
        assert found is not None
        assert [filter_.kind for filter_ in found.derivative_filters] == ["Butterworth"]
        assert found.derivative_cutoff_hz == 0.0


def test_a_gyro_in_front_of_its_filter_makes_no_other_gains(shared_data: Path) -> None:
    """A real PX4 of 2017: its controller took the rate some 13 ms later, and its integral was held back."""
    record = rotorid.read(shared_data / "px4/zmr250")
    found = {axis: check_controller(record, axis) for axis in RATE_OF}
    assert [check.verdict for check in found.values()] == ["made", "not checked", "made"]
    assert found["roll"].paths["i"].slope < 0.6
