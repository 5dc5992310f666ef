"""Sliders of Betaflight make the gains that its presets contain, to the last step of each."""

from __future__ import annotations

import pytest

from rotorid.errors import UsageError
from rotorid.models.autopilots.betaflight_sliders import sliders_applied

EVEN = {
    **dict.fromkeys(
        (
            *("simplified_master_multiplier", "simplified_i_gain", "simplified_d_gain", "simplified_pi_gain"),
            *("simplified_d_max_gain", "simplified_feedforward_gain", "simplified_pitch_d_gain"),
            *("simplified_pitch_pi_gain", "simplified_dterm_filter_multiplier", "simplified_gyro_filter_multiplier"),
        ),
        100.0,
    ),
    "simplified_pids_mode": 2.0,
    "simplified_dterm_filter": 0.0,
    "simplified_gyro_filter": 0.0,
}


@pytest.mark.parametrize(
    ("moved", "gains"),
    [
        (
            {},
            {
                "p_roll": 45,
                "i_roll": 80,
                "d_roll": 40,
                "d_min_roll": 30,
                "d_pitch": 46,
                "d_min_pitch": 34,
                "f_yaw": 120,
            },
        ),
        # Published presets hold what the firmware had made of their sliders: 80 times 1.2 is 95 and not 96.
        (
            {"master_multiplier": 120, "pi_gain": 125, "feedforward_gain": 130},
            {"p_pitch": 70, "i_pitch": 125, "d_pitch": 55, "f_pitch": 194, "p_roll": 67, "i_roll": 119, "d_roll": 47}
            | {"f_roll": 187, "p_yaw": 67, "i_yaw": 119, "f_yaw": 187, "d_min_roll": 35, "d_min_pitch": 40},
        ),
        (
            {"master_multiplier": 120, "feedforward_gain": 130, "pitch_pi_gain": 95},
            {"p_pitch": 53, "i_pitch": 95, "d_pitch": 55, "f_pitch": 185, "p_roll": 53, "i_roll": 95, "d_roll": 47}
            | {"f_roll": 187, "p_yaw": 53, "i_yaw": 95, "f_yaw": 187, "d_min_roll": 35, "d_min_pitch": 40},
        ),
        (
            {"master_multiplier": 125, "pi_gain": 85, "feedforward_gain": 0, "pitch_pi_gain": 110},
            {"p_pitch": 54, "i_pitch": 98, "d_pitch": 57, "f_pitch": 0, "p_roll": 47, "i_roll": 85, "d_roll": 50}
            | {"f_roll": 0, "p_yaw": 47, "i_yaw": 85, "f_yaw": 0, "d_min_roll": 37, "d_min_pitch": 42},
        ),
        (
            {"pi_gain": 110, "feedforward_gain": 130, "pitch_pi_gain": 90},
            {"p_pitch": 46, "i_pitch": 83, "f_pitch": 146, "p_roll": 49, "i_roll": 88, "f_roll": 156}
            | {"p_yaw": 49, "i_yaw": 88, "f_yaw": 156},
        ),
    ],
)
def test_presets_hold_what_their_sliders_make(moved: dict[str, float], gains: dict[str, float]) -> None:
    found = sliders_applied({**EVEN, **{f"simplified_{name}": value for name, value in moved.items()}}, {}, (4, 5))
    assert {name: found[name] for name in gains} == gains


def test_the_base_and_the_top_of_d_change_their_names() -> None:
    found = sliders_applied(
        {**EVEN, "simplified_d_max_gain": 0.0, "simplified_master_multiplier": 120.0}, {}, (2025, 12)
    )
    assert (found["d_roll"], found["d_max_roll"]) == (35.0, 35.0)
    even = sliders_applied(EVEN, {}, (2025, 12))
    assert (even["d_roll"], even["d_max_roll"], even["d_pitch"], even["d_max_pitch"]) == (30.0, 40.0, 34.0, 46.0)


def test_a_mode_moves_its_axes_and_cutoffs_that_are_off_stay_off() -> None:
    sliders = {**EVEN, "simplified_pids_mode": 1.0, "simplified_dterm_filter": 1.0}
    sliders["simplified_dterm_filter_multiplier"] = 115.0
    found = sliders_applied(sliders, {"dterm_lpf1_dyn_min_hz": 75.0, "dterm_lpf2_static_hz": 0.0}, (4, 4))
    assert "p_yaw" not in found
    assert {name: value for name, value in found.items() if name.startswith("dterm")} == {
        "dterm_lpf1_dyn_min_hz": 86.0,
        "dterm_lpf1_dyn_max_hz": 172.0,
    }
    assert not sliders_applied({**sliders, "simplified_pids_mode": 0.0, "simplified_dterm_filter": 0.0}, {}, (4, 4))


def test_what_is_not_known_is_not_guessed() -> None:
    with pytest.raises(UsageError, match="simplified_pids_mode is neither in the file nor in the log"):
        sliders_applied({}, {}, (4, 5))
    with pytest.raises(UsageError, match=r"Betaflight 4.2 has no sliders on board"):
        sliders_applied(EVEN, {}, (4, 2))
