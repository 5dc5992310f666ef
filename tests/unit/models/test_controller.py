"""The controller of an autopilot, from the parameters in its log."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from rotorid.errors import UsageError
from rotorid.models.autopilots.reading import rate_controller
from rotorid.models.controller import RateController
from rotorid.typing import ComplexArray

OMEGA = np.geomspace(0.5, 200.0, 40)

PX4 = {
    "MC_ROLLRATE_P": 0.15,
    "MC_ROLLRATE_I": 0.2,
    "MC_ROLLRATE_D": 0.003,
    "MC_ROLLRATE_K": 2.0,
    "MC_ROLL_P": 4.0,
    "IMU_DGYRO_CUTOFF": 20.0,
    "MC_YAWRATE_P": 0.2,
    "MC_YAW_TQ_CUTOFF": 2.0,
}
ARDUPILOT = {
    "ATC_RAT_PIT_P": 0.135,
    "ATC_RAT_PIT_I": 0.135,
    "ATC_RAT_PIT_D": 0.0036,
    "ATC_RAT_PIT_FLTT": 20.0,
    "ATC_RAT_PIT_FLTD": 20.0,
    "ATC_ANG_PIT_P": 4.5,
    "ATC_RAT_YAW_P": 0.3,
    "ATC_RAT_YAW_FLTE": 2.5,
}


def test_px4_gains_share_a_factor_that_the_angle_gain_has_not() -> None:
    assert rate_controller(PX4, "roll") == RateController(
        proportional_s=0.3,
        integral=0.4,
        derivative_s2=0.006,
        angle_1_s=4.0,
        derivative_cutoff_hz=20.0,
        late_integral=True,
    )


def test_only_the_yaw_command_of_px4_is_filtered() -> None:
    yaw, roll = rate_controller(PX4, "yaw"), rate_controller(PX4, "roll")
    assert yaw is not None
    assert roll is not None
    assert (yaw.command_cutoff_hz, roll.command_cutoff_hz) == (2.0, 0.0)


def test_ardupilot_takes_the_derivative_of_the_error() -> None:
    controller = rate_controller(ARDUPILOT, "pitch")
    assert controller is not None
    assert controller.derivative_of_error
    assert controller.target_cutoff_hz == 20.0


def test_the_old_name_of_the_error_filter_is_known_and_the_new_one_comes_first() -> None:
    old = {"ATC_RAT_YAW_P": 0.3, "ATC_RAT_YAW_FILT": 5.0}
    for parameters, cutoff_hz in ((old, 5.0), (old | {"ATC_RAT_YAW_FLTE": 2.5}, 2.5)):
        controller = rate_controller(parameters, "yaw")
        assert controller is not None
        assert controller.error_cutoff_hz == cutoff_hz


@pytest.mark.parametrize(
    "parameters",
    [{}, {"MC_ROLL_P": 4.0}, {"MC_ROLLRATE_P": 0.0}, {"MC_ROLLRATE_P": -0.1}, {"ATC_RAT_YAW_P": 0.3}],
)
def test_without_gains_there_is_no_controller(parameters: dict[str, float]) -> None:
    assert rate_controller(parameters, "roll") is None


def test_thrust_has_no_rate_controller() -> None:
    assert rate_controller(PX4 | ARDUPILOT, "thrust") is None


def test_the_response_is_that_of_the_loops_written_as_one_fraction() -> None:
    # (P + I/s)(1 + A/s) + D s w/(s + w) over the common denominator s^2 (s + w).
    p, i, d, a, w = 0.15, 0.2, 0.003, 4.0, 2.0 * np.pi * 20.0
    over = np.polymul([1.0, w], np.polymul([p, i], [1.0, a]))
    numerator = np.polyadd(over, [d * w, 0.0, 0.0, 0.0])
    _, expected = signal.freqs(numerator, np.polymul([1.0, 0.0, 0.0], [1.0, w]), OMEGA)
    controller = RateController(proportional_s=p, integral=i, derivative_s2=d, angle_1_s=a, derivative_cutoff_hz=20.0)
    np.testing.assert_allclose(controller.response(OMEGA), expected, rtol=1e-12)


def test_filters_on_error_and_command_are_in_series_and_that_of_the_target_is_in_the_angle_loop() -> None:
    plain = RateController(proportional_s=0.15, angle_1_s=4.0)
    low_pass = 1.0 / (1.0 + 1j * OMEGA / (2.0 * np.pi * 3.0))
    for name in ("error_cutoff_hz", "command_cutoff_hz"):
        filtered = RateController(proportional_s=0.15, angle_1_s=4.0, **{name: 3.0})
        np.testing.assert_allclose(filtered.response(OMEGA), low_pass * plain.response(OMEGA), rtol=1e-12)
    slow = RateController(proportional_s=0.15, angle_1_s=4.0, target_cutoff_hz=3.0)
    np.testing.assert_allclose(slow.response(OMEGA), 0.15 * (1.0 + low_pass * 4.0 / (1j * OMEGA)), rtol=1e-12)


def test_a_derivative_of_the_error_sees_the_angle_too() -> None:
    of_error = RateController(proportional_s=0.0, derivative_s2=0.01, angle_1_s=4.0, derivative_of_error=True)
    np.testing.assert_allclose(of_error.response(OMEGA), 0.01 * (1j * OMEGA + 4.0), rtol=1e-12)


STEP_S = 1.0 / 400.0
DISCRETE = RateController(
    proportional_s=0.135,
    integral=0.3,
    derivative_s2=0.0036,
    angle_1_s=4.5,
    derivative_of_error=True,
    derivative_cutoff_hz=20.0,
    error_cutoff_hz=9.0,
    target_cutoff_hz=30.0,
    command_cutoff_hz=5.0,
    step_s=STEP_S,
)


def first_order(cutoff_hz: float) -> tuple[list[float], list[float]]:
    share = STEP_S / (STEP_S + 1.0 / (2.0 * np.pi * cutoff_hz))
    return [share], [1.0, share - 1.0]


def in_row(*filters: tuple[list[float], list[float]]) -> ComplexArray:
    total = np.ones(OMEGA.size, dtype=np.complex128)
    for numerator, denominator in filters:
        total = total * signal.freqz(numerator, denominator, worN=OMEGA * STEP_S)[1]
    return total


@pytest.mark.parametrize("late_integral", [False, True])
@pytest.mark.parametrize("late_angle", [False, True])
def test_a_program_of_steps_has_the_response_of_its_sums_and_differences(late_integral: bool, late_angle: bool) -> None:
    controller = replace(DISCRETE, late_integral=late_integral, late_angle=late_angle)
    summed = in_row(([0.0, STEP_S] if late_integral else [STEP_S], [1.0, -1.0]))
    slope = in_row(([1.0 / STEP_S, -1.0 / STEP_S], [1.0]), first_order(20.0))
    of_error = in_row(first_order(9.0), first_order(5.0)) * (0.135 + 0.3 * summed + 0.0036 * slope)
    angle = in_row(first_order(30.0), ([0.0, 1.0] if late_angle else [1.0], [1.0])) * 4.5 / (1j * OMEGA)
    np.testing.assert_allclose(controller.response(OMEGA), of_error * (1.0 + angle), rtol=1e-11)
    plain = replace(controller, derivative_of_error=False)
    apart = of_error - in_row(first_order(9.0), first_order(5.0)) * 0.0036 * slope
    np.testing.assert_allclose(plain.response(OMEGA), of_error + apart * angle, rtol=1e-11)
    np.testing.assert_allclose(plain.setpoint_response(OMEGA), apart * in_row(first_order(30.0)), rtol=1e-11)


def test_small_steps_go_to_continuous_time() -> None:
    exact = replace(DISCRETE, step_s=0.0).response(OMEGA)
    coarse, fine = (np.abs(replace(DISCRETE, step_s=h).response(OMEGA) / exact - 1.0) for h in (1e-4, 5e-5))
    np.testing.assert_allclose(fine / coarse, 0.5, atol=0.02)


def test_a_filter_of_the_rate_leaves_the_angle_loop_alone() -> None:
    gyro = np.asarray(1.0 / (1.0 + 1j * OMEGA / 60.0))
    for controller in (DISCRETE, replace(DISCRETE, derivative_of_error=False)):
        rate = controller.rate_loop.response(OMEGA)
        angle = controller.response(OMEGA) - rate
        np.testing.assert_allclose(controller.response(OMEGA, gyro), rate * gyro + angle, rtol=1e-12)


def test_steps_are_those_of_the_parameters_unless_the_caller_knows_better() -> None:
    parameters = ARDUPILOT | PX4 | {"SCHED_LOOP_RATE": 400.0, "IMU_GYRO_RATEMAX": 800.0}
    own, slow = rate_controller(parameters, "pitch"), rate_controller(parameters, "roll", loop_rate_hz=250.0)
    assert own is not None
    assert slow is not None
    assert (own.step_s, own.late_integral, own.late_angle) == (1.0 / 400.0, False, True)
    assert (slow.step_s, slow.late_integral, slow.late_angle) == (1.0 / 250.0, True, False)


def test_the_rate_loop_has_no_angle() -> None:
    controller = RateController(proportional_s=0.15, angle_1_s=4.0)
    assert controller.rate_loop == RateController(proportional_s=0.15)


def test_a_controller_survives_pickling() -> None:
    controller = RateController(proportional_s=0.15, integral=0.2)
    assert pickle.loads(pickle.dumps(controller)) == controller


@pytest.mark.parametrize("wrong", [{"proportional_s": -0.1}, {"proportional_s": np.nan}, {"proportional_s": 0.0}])
def test_impossible_gains_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="gain"):
        RateController(**wrong)
