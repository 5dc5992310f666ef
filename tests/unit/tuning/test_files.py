"""Gains in the names, ranges and steps of each firmware, and files that parse back to the same numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.tuning.gain_files import parsed

from rotorid.errors import UsageError
from rotorid.models.autopilots import AxisController, axis_controller
from rotorid.tuning import Gains, parameter_files, parameters_of, ranges_of, rounded, scaled, written
from rotorid.tuning.files import Role
from rotorid.typing import Axis

PX4 = {"MC_ROLLRATE_K": 1.5, "MC_ROLLRATE_P": 0.1, "MC_ROLLRATE_I": 0.2, "MC_ROLLRATE_D": 0.002, "MC_ROLL_P": 6.5}
ARDUPILOT = {"ATC_RAT_YAW_P": 0.18, "ATC_RAT_YAW_I": 0.018, "ATC_RAT_YAW_D": 0.0, "ATC_ANG_YAW_P": 4.5}
BETAFLIGHT = {"rollPID_P": 45.0, "rollPID_I": 80.0, "rollPID_D": 30.0, "levelPID_P": 50.0, "looptime": 125.0}


def controllers() -> dict[str, AxisController]:
    found = {
        "px4": axis_controller(PX4, "roll", firmware="PX4 1.15.0"),
        "ardupilot": axis_controller(ARDUPILOT, "yaw", firmware="ArduCopter V4.6.0"),
        "betaflight": axis_controller(BETAFLIGHT, "roll", firmware="Betaflight 4.5.1"),
    }
    return {name: one for name, one in found.items() if one is not None}


@pytest.mark.parametrize("name", ["px4", "ardupilot", "betaflight"])
def test_flown_gains_are_what_the_log_holds(name: str) -> None:
    one = controllers()[name]
    values = written(one, Gains.of(one.controller))
    assert values == pytest.approx({key: one.gains[key] for key in values}, rel=1e-4)


@pytest.mark.parametrize("name", ["px4", "ardupilot", "betaflight"])
def test_files_parse_back_to_the_same_numbers(name: str) -> None:
    one = controllers()[name]
    gains = rounded(one, Gains(P=0.31234567, I=0.71234567, D=0.0, A=5.1234567))
    values = written(one, gains)
    for text in parameter_files(one.autopilot, values, role="proposed", firmware=one.firmware).values():
        read = parsed(text)
        assert {key: np.float32(value) for key, value in read.items()} == {
            key: np.float32(value) for key, value in values.items()
        }


def test_the_factor_of_px4_stays() -> None:
    one = controllers()["px4"]
    assert parameters_of(one)["P"].per_si == 1.5
    assert written(one, Gains(P=0.3, I=0.3, D=0.003, A=6.5))["MC_ROLLRATE_P"] == pytest.approx(0.2)
    assert ranges_of(one)["P"] == pytest.approx((0.015, 0.75))


def test_betaflight_has_whole_numbers_and_its_sliders_off() -> None:
    one = controllers()["betaflight"]
    gains = rounded(one, Gains(P=0.1, I=1.0, D=8e-4, A=5.0))
    values = written(one, gains)
    assert all(value == round(value) for value in values.values())
    (text,) = parameter_files("Betaflight", values, role="proposed", firmware="Betaflight 4.5.1").values()
    lines = text.splitlines()
    assert lines.index("set simplified_pids_mode = OFF") < lines.index("set p_roll = 54")
    # A batch that is still open refuses to save what was refused in part.
    assert lines[-2:] == ["save", "batch end"]
    with pytest.raises(UsageError, match=r"Betaflight 4\.0"):
        parameter_files("Betaflight", values, role="proposed", firmware="")


@pytest.mark.parametrize("P", [np.nan, np.inf, 3.0, -0.1])
def test_no_gain_leaves_that_no_firmware_takes(P: float) -> None:
    one = controllers()["px4"]
    with pytest.raises(UsageError, match="MC_ROLLRATE_P"):
        written(one, Gains(P=P, I=0.2, D=0.002, A=6.5))
    with pytest.raises(UsageError, match="finite gains"):
        parameter_files("PX4", {"MC_ROLLRATE_P": np.nan}, role="proposed")


def test_a_derivative_that_moves_in_flight_stays() -> None:
    header = {**BETAFLIGHT, "d_max_0": 40.0}
    one = axis_controller(header, "roll", firmware="Betaflight 4.6.0")
    assert one is not None
    assert one.ends
    assert "D" not in parameters_of(one)
    assert one.controller.derivative_s2 == rounded(one, Gains(P=0.1, I=1.0, D=8e-4, A=5.0)).D


def test_a_flown_gain_beyond_its_range_may_be_written_back() -> None:
    one = axis_controller({**ARDUPILOT, "ATC_RAT_YAW_P": 0.05}, "yaw", firmware="ArduCopter V4.6.0")
    assert one is not None
    flown = Gains.of(one.controller)
    assert written(one, flown)["ATC_RAT_YAW_P"] == pytest.approx(0.05)
    with pytest.raises(UsageError, match=r"from 0\.1 to 2\.5"):
        written(one, Gains(P=0.07, I=flown.I, D=flown.D, A=flown.A))


def test_a_gain_that_stays_has_the_digits_of_the_log() -> None:
    """A file changes no gain by rounding it."""
    held = {"MC_ROLLRATE_I": 0.2345678, "MC_ROLLRATE_D": 0.00234567}
    one = axis_controller({**PX4, **held}, "roll", firmware="PX4 1.15.0")
    assert one is not None
    flown = Gains.of(one.controller)
    proposed = rounded(one, replace(flown, P=1.3 * flown.P))
    assert (proposed.I, proposed.D, proposed.A) == (flown.I, flown.D, flown.A)
    values = written(one, proposed)
    assert {name: values[name] for name in held} == held
    assert values["MC_ROLLRATE_P"] != one.gains["MC_ROLLRATE_P"]


@pytest.mark.parametrize(("mode", "of_p"), [(0.0, 0.8), (1.0, 1.0)])
def test_what_tpa_took_is_given_back(mode: float, of_p: float) -> None:
    """The controller holds what was left of P and D at the flown throttle; parameters hold the whole."""
    tpa = {"tpa_rate": 40.0, "tpa_breakpoint": 1500.0, "tpa_mode": mode}
    whole = axis_controller(BETAFLIGHT, "roll", firmware="Betaflight 4.5.1")
    one = axis_controller({**BETAFLIGHT, **tpa}, "roll", firmware="Betaflight 4.5.1", throttle=0.75)
    assert whole is not None
    assert one is not None
    flown, before = Gains.of(one.controller), Gains.of(whole.controller)
    assert pytest.approx((of_p * before.P, 0.8 * before.D)) == (flown.P, flown.D)
    same = {"p_roll": 45.0, "i_roll": 80.0, "d_roll": 30.0}
    assert {name: written(one, flown)[name] for name in same} == same
    double = rounded(one, Gains(P=2.0 * flown.P, I=flown.I, D=2.0 * flown.D, A=flown.A))
    assert written(one, double) == {**written(one, flown), "p_roll": 90.0, "d_roll": 60.0}
    assert ranges_of(one)["D"][1] == pytest.approx(0.8 * ranges_of(whole)["D"][1])


def test_a_gain_of_which_tpa_left_nothing_stays() -> None:
    tpa = {"tpa_rate": 100.0, "tpa_breakpoint": 1500.0, "tpa_mode": 1.0}
    one = axis_controller({**BETAFLIGHT, **tpa}, "roll", firmware="Betaflight 4.5.1", throttle=1.0)
    assert one is not None
    assert "D" not in parameters_of(one)
    assert "d_roll" not in written(one, Gains.of(one.controller))


@pytest.mark.parametrize(
    ("version", "angle", "most"),
    [
        ("4.2.11", "angle_level_strength", 200.0),
        ("4.4.2", "angle_level_strength", 250.0),
        ("4.5.1", "angle_p_gain", 250.0),
    ],
)
def test_names_and_ranges_are_those_of_the_version(version: str, angle: str, most: float) -> None:
    """There is no ``p_level`` at the command line."""
    one = axis_controller(BETAFLIGHT, "roll", firmware=f"Betaflight {version}")
    assert one is not None
    found = parameters_of(one)
    assert (found["A"].name, found["A"].high, found["P"].high) == (angle, 200.0, most)
    assert written(one, Gains.of(one.controller))[angle] == 50.0
    again = axis_controller({**one.gains, "looptime": 125.0}, "roll", firmware=f"Betaflight {version}")
    assert again is not None
    assert again.controller.angle_1_s == 5.0


@pytest.mark.parametrize("role", ["proposed", "rollback"])
def test_a_rollback_says_that_sliders_stay_off(role: Role) -> None:
    (text,) = parameter_files("Betaflight", {"p_roll": 45.0}, role=role, firmware="Betaflight 4.5.1").values()
    assert ("sliders (simplified_...) stay off" in text) == (role == "rollback")
    (old,) = parameter_files("Betaflight", {"p_roll": 45.0}, role=role, firmware="Betaflight 4.2.11").values()
    assert "sliders" not in old


@pytest.mark.parametrize(
    ("version", "name", "value", "line"),
    [
        ("4.4.2", "dterm_lpf1_type", 3.0, "set dterm_lpf1_type = PT3"),
        ("4.4.2", "gyro_lpf2_type", 0.0, "set gyro_lpf2_type = PT1"),
        ("4.2.11", "dterm_lowpass_type", 1.0, "set dterm_lowpass_type = BIQUAD"),
    ],
)
def test_types_of_filters_are_words(version: str, name: str, value: float, line: str) -> None:
    (text,) = parameter_files("Betaflight", {name: value}, role="proposed", firmware=f"Betaflight {version}").values()
    assert line in text.splitlines()


def test_a_type_that_a_version_does_not_have_is_refused() -> None:
    with pytest.raises(UsageError, match=r"0 \(PT1\), 1 \(BIQUAD\)"):
        parameter_files("Betaflight", {"dterm_lowpass_type": 2.0}, role="proposed", firmware="Betaflight 4.2.11")


SCALED = [
    ("px4", {"MC_ROLLRATE_FF": 0.02}, "roll", "PX4 1.15.0"),
    (
        "ardupilot",
        {"ATC_RAT_YAW_FF": 0.01, "ATC_RAT_YAW_D_FF": 0.001, "ATC_RAT_YAW_P": 0.3, "ATC_RAT_YAW_I": 0.1},
        "yaw",
        "ArduCopter V4.6.0",
    ),
    ("betaflight", {"d_min_0": 20.0, "ff_weight_0": 120.0}, "roll", "Betaflight 4.4.2"),
    ("betaflight", {"d_max_0": 40.0}, "roll", "Betaflight 2025.12.0"),
]


@pytest.mark.parametrize(("name", "more", "axis", "firmware"), SCALED)
def test_all_that_the_command_is_proportional_to_is_scaled(
    name: str, more: dict[str, float], axis: Axis, firmware: str
) -> None:
    """Feed-forward, and both ends of a D that moves; the angle gain stays."""
    base = {"px4": PX4, "ardupilot": ARDUPILOT, "betaflight": BETAFLIGHT}[name]
    before = axis_controller({**base, **more}, axis, firmware=firmware)
    assert before is not None
    values = scaled(before, 0.5)
    header = {**before.gains, **values, "looptime": 125.0}
    after = axis_controller(header, axis, firmware=firmware)
    assert after is not None
    one, other = before.controller, after.controller
    assert other.angle_1_s == one.angle_1_s
    for field in ("proportional_s", "integral", "derivative_s2", "feedforward", "feedforward_derivative_s"):
        assert getattr(other, field) == pytest.approx(0.5 * getattr(one, field), rel=0.03)
    for end in before.ends:
        assert after.ends[end].derivative_s2 == pytest.approx(0.5 * before.ends[end].derivative_s2, rel=0.03)
    if "ff_weight_0" in more:
        assert values["f_roll"] == 60.0


def test_what_leaves_its_range_is_not_scaled() -> None:
    one = controllers()["ardupilot"]
    with pytest.raises(UsageError, match="ATC_RAT_YAW_P"):
        scaled(one, 0.3)
    # Such as stand below their range already may go up to it.
    low = axis_controller({**ARDUPILOT, "ATC_RAT_YAW_P": 0.05}, "yaw", firmware="ArduCopter V4.6.0")
    assert low is not None
    assert scaled(low, 1.5)["ATC_RAT_YAW_P"] == pytest.approx(0.075)


def test_nothing_else_is_known() -> None:
    with pytest.raises(UsageError, match="expected PX4, ArduPilot or Betaflight"):
        parameter_files("Crazyflie", {"p": 1.0}, role="proposed")
