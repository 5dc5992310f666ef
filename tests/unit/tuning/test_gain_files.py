"""Files of gains are read as the tools of each firmware write them; what is damaged or ambiguous is named."""

from __future__ import annotations

import pytest

from rotorid.errors import UsageError
from rotorid.tuning.files import parameter_files
from rotorid.tuning.gain_files import read_gains

DUMP = """# Betaflight / STM32F7X2 (S7X2) 4.4.3 Nov 17 2023 / 10:58:20 (738127e7e) MSP API: 1.45
# master
set gyro_lpf1_type = PT1
set gyro_lpf1_static_hz = 250
set osd_units = METRIC
profile 0
set p_roll = 45
set d_roll = 40
set iterm_relax = RP
set tpa_curve_type = CLASSIC
profile 1
set p_roll = 30
set d_roll = 20
# restore original profile selection
profile 0
rateprofile 0
set roll_rc_rate = 7
rateprofile 1
set roll_rc_rate = 9
"""


@pytest.mark.parametrize(
    ("autopilot", "values"),
    [
        ("PX4", {"MC_ROLLRATE_P": 0.15, "IMU_DGYRO_CUTOFF": 40.0}),
        ("ArduPilot", {"ATC_RAT_RLL_P": 0.117, "INS_HNTCH_FREQ": 80.0}),
    ],
)
def test_what_is_written_is_read(autopilot: str, values: dict[str, float]) -> None:
    for name, text in parameter_files(autopilot, values, role="proposed").items():
        found = read_gains(text, name=name)
        assert found.autopilot == autopilot
        assert found.values == pytest.approx(values)


def test_betaflight_is_read_by_the_names_of_its_header() -> None:
    (text,) = parameter_files(
        "Betaflight",
        {"p_roll": 50.0, "d_roll": 30.0, "dterm_lpf1_type": 0.0},
        role="proposed",
        firmware="Betaflight 4.4.3",
    ).values()
    found = read_gains(text, name="proposed.cli.txt")
    assert dict(found.values) == {
        "rollPID_P": 50.0,
        "rollPID_D": 30.0,
        "dterm_lpf1_type": 0.0,
    }


def test_of_several_profiles_the_selected_one_counts() -> None:
    found = read_gains(DUMP, name="dump.txt")
    assert (found.firmware, found.defaults_first) == ("Betaflight 4.4", False)
    assert dict(found.values) == {
        "gyro_lpf1_type": 0.0,
        "gyro_lpf1_static_hz": 250.0,
        "rollPID_P": 45.0,
        "rollPID_D": 40.0,
        "iterm_relax": 1.0,
    }
    assert found.written["rollPID_P"] == "p_roll"


def test_telemetry_tools_and_lines_by_hand() -> None:
    planner = read_gains("#NOTE: 1\nATC_RAT_RLL_P,0.117 @READONLY\nATC_RAT_RLL_D 0.0006\n", name="x.param")
    assert dict(planner.values) == {"ATC_RAT_RLL_P": 0.117, "ATC_RAT_RLL_D": 0.0006}
    by_hand = read_gains("roll: P=0.12, I=0.2 D=0.003 A=6\nyaw P = 0.3", name="line.txt")
    assert dict(by_hand.by_hand) == {"roll": {"P": 0.12, "I": 0.2, "D": 0.003, "A": 6.0}, "yaw": {"P": 0.3}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "contains no gains"),
        ("\0\1\2", "contains no gains"),
        ("MC_ROLLRATE_P,0.1\nMC_ROLLRA", "line 2 of x cannot be read"),
        ("MC_ROLLRATE_P nan", "MC_ROLLRATE_P in line 1 of x is nan"),
        ("MC_ROLLRATE_P 0.1.2", "expected a number"),
        ("P=inf D=0.1", "P in line 1 of x is inf"),
        ("MC_ROLLRATE_P,0.1\nMC_ROLLRATE_P,0.2", "and an earlier line 0.1"),
        ("MC_ROLLRATE_P,0.1\nATC_RAT_RLL_P,0.1", "mixes gains of PX4 and ArduPilot"),
        ("MC_ROLLRATE_P,0.1\nroll: P=0.1", "mixes parameters and lines"),
        ("RATE_RLL_P,0.15\nSTB_RLL_P,4.5", "ArduPilot before 3.4"),
        ("WPNAV_SPEED,500", "no gains of a multicopter"),
        ("# INAV / MATEKF405 7.1.2\nset p_roll = 40", "from INAV"),
        ("# Betaflight / OMNIBUS (OBF4) 3.5.7 Mar\nset p_roll = 40", "Betaflight 3.5, whose gains have other units"),
        ("set p_roll = forty", "p_roll in line 1 of x is 'forty'"),
        ("set p_roll 40\nset d_roll = 30", "line 1 of x cannot be read"),
        ("profile 0\nset p_roll = 40\nprofile 1\nset p_roll = 50", "2 PID profiles and selects none"),
    ],
)
def test_what_is_damaged_or_of_another_program_is_named(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        read_gains(text, name="x")
