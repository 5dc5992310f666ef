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
        ("set simplified_master_multiplier = 120", "moves sliders and applies them to no gain"),
        (
            "#$ INCLUDE: presets/4.5/tune/defaults.txt\nset p_roll = 40",
            "line 1 of x includes presets/4.5/tune/defaults",
        ),
    ],
)
def test_what_is_damaged_or_of_another_program_is_named(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        read_gains(text, name="x")


PRESET = """#$ TITLE: A tune
#$ FIRMWARE_VERSION: 4.4
#$ FIRMWARE_VERSION: 4.5
#$ CATEGORY: TUNE
#$ INCLUDE: presets/4.5/tune/defaults.txt
set p_roll = 50
feature -GPS
#$ OPTION_GROUP BEGIN (EXCLUSIVE): Battery
    #$ OPTION BEGIN (CHECKED): 4S
        set simplified_master_multiplier = 120
        set dterm_lpf2_static_hz = 120
    #$ OPTION END
    #$ OPTION BEGIN (UNCHECKED): 6S
        #$ INCLUDE: presets/4.5/tune/nowhere.txt
        set simplified_master_multiplier = 90
    #$ OPTION END
#$ OPTION_GROUP END
"""
DEFAULTS = "#$ FIRMWARE_VERSION: 4.5\nset p_roll = 45\nset simplified_pids_mode = RP\nset dterm_lpf2_static_hz = 150\n"


def test_a_preset_counts_with_its_checked_options_and_what_it_includes() -> None:
    found = read_gains(PRESET, name="tune.txt", include={"presets/4.5/tune/defaults.txt": DEFAULTS}.__getitem__)
    assert (found.preset, found.options, found.firmware) == (True, ("4S",), "Betaflight 4.4, 4.5")
    # Later lines win, and sliders that are not applied change nothing.
    assert dict(found.values) == {"rollPID_P": 50.0, "dterm_lpf2_static_hz": 120.0}
    assert found.sliders is None


def test_applied_sliders_make_the_gains_and_lines_after_them_win() -> None:
    text = f"{PRESET}simplified_tuning apply\nset i_roll = 70\n"
    found = read_gains(text, name="tune.txt", include={"presets/4.5/tune/defaults.txt": DEFAULTS}.__getitem__)
    assert found.sliders == {"simplified_pids_mode": 1.0, "simplified_master_multiplier": 120.0}
    even = ("i_gain", "d_gain", "pi_gain", "dmax_gain", "feedforward_gain", "pitch_d_gain", "pitch_pi_gain")
    flown = dict.fromkeys((f"simplified_{name}" for name in even), 100.0)
    flown |= {
        "simplified_dterm_filter": 1.0,
        "simplified_dterm_filter_multiplier": 110.0,
        "simplified_gyro_filter": 0.0,
    }
    there, how = found.on(flown, (4, 5))
    assert how == "tune.txt: its checked options count (4S); its sliders make the gains."
    assert (there.values["rollPID_P"], there.values["rollPID_I"], there.values["rollPID_D"]) == (53.0, 70.0, 47.0)
    assert (there.values["d_min_0"], there.values["ff_weight_1"]) == (35.0, 149.0)
    assert there.values["dterm_lpf2_static_hz"] == 165.0
    assert "yawPID_P" not in there.values
    with pytest.raises(UsageError, match="simplified_pi_gain is neither in the file nor in the log"):
        found.on({}, (4, 5))


def test_presets_that_include_each_other_end() -> None:
    with pytest.raises(UsageError, match="includes too many presets"):
        read_gains(
            "#$ INCLUDE: a\nset p_roll = 4", name="x", include=lambda name: f"#$ INCLUDE: {name}\nset i_roll = 4"
        )


def test_of_profiles_without_a_selection_the_flown_one_counts() -> None:
    text = "set gyro_lpf1_static_hz = 250\nprofile 0\nset p_roll = 40\nprofile 1\nset p_roll = 50\nset d_min_roll = 20"
    found = read_gains(text, name="dump.txt")
    there, how = found.on({"rollPID_P": 50.0}, (4, 5))
    assert dict(there.values) == {"gyro_lpf1_static_hz": 250.0, "rollPID_P": 50.0, "d_min_0": 20.0}
    assert how == "dump.txt: it selects no PID profile, so profile 1 counts: it has the gains of the log."
    with pytest.raises(UsageError, match="2 PID profiles, selects none of them, and none has the gains of the log"):
        found.on({"rollPID_P": 60.0}, (4, 5))
