"""What ArduPilot makes of attitude set-points, against the lag and the limits that its law states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.simulation.shaping import InputShaping, input_shaping, shaped_plan
from rotorid.vehicles.catalog import aircraft

RATE_HZ = 400.0
USUAL = InputShaping(lag_s=0.15, acceleration_rad_s2=19.2)
TIME_S = np.arange(0.0, 20.0, 1.0 / RATE_HZ)


@pytest.mark.parametrize("omega_rad_s", [1.0, 6.0, 30.0])
def test_small_set_points_meet_a_lag_of_first_order(omega_rad_s: float) -> None:
    flown, _ = USUAL.shaped(0.01 * np.sin(omega_rad_s * TIME_S), RATE_HZ)
    settled = TIME_S > 5.0
    waves = np.stack([np.sin(omega_rad_s * TIME_S), np.cos(omega_rad_s * TIME_S)], axis=1)[settled]
    found = complex(*np.linalg.lstsq(waves, flown[settled], rcond=None)[0]) / 0.01
    # Euler's rule in ticks of 2.5 ms: half a tick late, and as much of the lag.
    assert abs(found - 1.0 / (1.0 + 1j * omega_rad_s * USUAL.lag_s)) < 0.02


def test_a_large_set_point_is_followed_within_its_acceleration_and_arrives() -> None:
    angle, rate = USUAL.shaped(np.full(400, 1.0), RATE_HZ)
    assert np.abs(np.diff(rate)).max() * RATE_HZ <= USUAL.acceleration_rad_s2 * (1.0 + 1e-9)
    assert np.allclose(np.diff(angle) * RATE_HZ, rate[:-1])
    assert angle.max() < 1.005
    assert angle[-1] == pytest.approx(1.0, abs=0.01)
    # The way up and down at the largest acceleration takes twice the square root of the angle over it.
    assert np.searchsorted(angle, 0.5) / RATE_HZ == pytest.approx((1.0 / USUAL.acceleration_rad_s2) ** 0.5, rel=0.05)


def test_a_rate_limit_holds() -> None:
    _, rate = replace(USUAL, rate_rad_s=0.5).shaped(np.full(400, 1.0), RATE_HZ)
    assert np.abs(rate).max() == pytest.approx(0.5)


def test_parameters_of_both_generations_say_the_same() -> None:
    old = input_shaping({"ATC_ACCEL_P_MAX": 90000.0, "ATC_INPUT_TC": 0.2}, "pitch")
    assert old == input_shaping({"ATC_ACC_P_MAX": 900.0, "ATC_INPUT_TC": 0.2}, "pitch")
    assert input_shaping({}, "thrust") is None


def test_only_attitudes_of_ardupilot_are_smoothed() -> None:
    step = PlannedInput(
        axis="roll",
        shape="doublet",
        start_s=1.0,
        values=np.full(250, 0.1),
        sample_rate_hz=250.0,
        amplitude=0.1,
        entry="attitude_setpoint",
    )
    plan = FlightPlan(name="step", inputs=(step, replace(step, axis="pitch", entry="rate_setpoint")))
    assert aircraft("px4_quad").autopilot.shaping == {}
    flown = {one.axis: one for one in shaped_plan(plan, aircraft("ardupilot_quad").autopilot.shaping, RATE_HZ).inputs}
    assert flown["pitch"] is plan.inputs[1]
    assert flown["roll"].values[-1] == pytest.approx(0.0, abs=1e-3)
    assert 0.09 < flown["roll"].amplitude < 0.1
