"""Climb loops of PX4 and ArduPilot by their parameters, and ArduPilot's loop around the acceleration."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.models.autopilots.climb import THROTTLE_HZ, AccelerationLoop, acceleration_loop
from rotorid.models.autopilots.outer import outer_controller, outer_parameters

OLD = {"PSC_VELZ_P": 5.0, "PSC_POSZ_P": 1.0, "PSC_VELZ_FLTE": 5.0} | {
    "PSC_ACCZ_P": 0.5,
    "PSC_ACCZ_I": 1.0,
    "PSC_ACCZ_FLTE": 20.0,
}
NEW = {"PSC_D_VEL_P": 5.0, "PSC_D_POS_P": 1.0, "PSC_D_VEL_FLTE": 5.0} | {
    "PSC_D_ACC_P": 0.05,
    "PSC_D_ACC_I": 0.1,
    "PSC_D_ACC_FLTE": 20.0,
}
PX4 = {"MPC_Z_VEL_P_ACC": 4.0, "MPC_Z_VEL_I_ACC": 2.0, "MPC_Z_VEL_D_ACC": 0.1, "MPC_Z_P": 1.0}


def test_both_generations_of_ardupilot_are_one_controller() -> None:
    old, new = (outer_controller(parameters, "climb") for parameters in (OLD, NEW))
    assert old is not None
    assert new is not None
    assert old.controller == new.controller
    assert acceleration_loop(OLD) == acceleration_loop(NEW)
    named = [outer_parameters(found) for found in (old, new)]
    assert [{letter: one.name for letter, one in (found or {}).items()} for found in named] == [
        {"P": "PSC_VELZ_P", "A": "PSC_POSZ_P"},
        {"P": "PSC_D_VEL_P", "A": "PSC_D_POS_P"},
    ]


def test_px4_uses_its_integral_late_and_the_measured_velocity_for_d() -> None:
    found = outer_controller(PX4, "climb", loop_rate_hz=50.0)
    assert found is not None
    own = found.controller
    assert (own.late_integral, own.derivative_of_error, own.step_s, own.delay_s) == (True, False, 0.02, 0.01)
    assert (own.proportional_s, own.integral, own.derivative_s2, own.angle_1_s) == (4.0, 2.0, 0.1, 1.0)


def test_no_gains_are_no_loop() -> None:
    assert outer_controller({"MPC_XY_VEL_P_ACC": 1.8}, "climb") is None
    assert acceleration_loop({"PSC_VELZ_P": 5.0}) is None
    assert acceleration_loop({"PSC_ACCZ_P": -0.5}) is None


def stepped(loop: AccelerationLoop, gain: float, omega_rad_s: float) -> complex:
    """Velocity by a sine of the acceleration that is asked for, by the firmware's own steps around an integrator."""
    own = loop.controller
    T, count = own.step_s, int(60.0 / own.step_s)

    def share(cutoff_hz: float) -> float:
        return T / (T + 1.0 / (2.0 * np.pi * cutoff_hz))

    asked = np.sin(omega_rad_s * T * np.arange(count))
    velocity, throttle, error, integral = 0.0, 0.0, 0.0, 0.0
    found = np.zeros(count)
    for step in range(count):
        found[step] = velocity
        # The plant acts at once, so that the acceleration is measured as it is made.
        error += share(own.error_cutoff_hz) * (asked[step] - gain * throttle - error)
        integral += own.integral * error * T
        throttle += share(THROTTLE_HZ) * (own.proportional_s * error + integral - throttle)
        velocity += gain * throttle * T
    tail = slice(count // 2, None)
    wave = np.exp(-1j * omega_rad_s * T * np.arange(count))[tail]
    return complex(2j * np.mean((found[tail] - found[tail].mean()) * wave))


@pytest.mark.parametrize("periods", [20, 60, 150])
def test_the_closed_loop_is_that_of_the_firmware(periods: int) -> None:
    """Within what a step of delay, which a plant that acts at once needs, does to gain and phase; no filter before."""
    omega = 2.0 * np.pi * periods / 60.0
    loop = acceleration_loop({**NEW, "INS_ACCEL_FILTER": 0.0})
    assert loop is not None
    gain = 27.0
    at = np.array([omega])
    exact = loop.closed(gain / (1j * at), at)[0]
    ratio = stepped(loop, gain, omega) / exact
    delay_rad = omega * loop.controller.step_s
    assert abs(ratio) == pytest.approx(1.0, abs=delay_rad)
    assert abs(np.angle(ratio)) < 2.0 * delay_rad


def test_the_throttle_filter_is_a_lag_inside() -> None:
    """Without the low-pass of 2 Hz the loop around the acceleration has a crossover ten times as fast."""
    loop = acceleration_loop(NEW)
    assert loop is not None
    omega = np.array([2.0 * np.pi * THROTTLE_HZ])
    with_lag = loop.loop(27.0 / (1j * omega), omega)[0]
    assert np.degrees(np.angle(with_lag)) < -60.0
