"""Which axes of a flight the motors explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, band_words, excitations, slow_taps
from rotorid.fitting.motors.fit import fit_motors
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.motors.speed import motor_speed
from rotorid.models.motors import motor_parameters
from rotorid.vehicles.motor_flight import TRUTH, flights, levers

LEVERS = levers()
THRUST_N, INERTIA_KG_M2 = 5.0, 0.015


@pytest.fixture(scope="module")
def flown() -> MotorRecord:
    return flights(1, seed=5, duration_s=10.0)[0]


def test_a_flight_of_all_axes_excites_all(flown: MotorRecord) -> None:
    (found,) = excitations([flown], LEVERS)
    assert all(one.correlation > 0.9 for one in found.values())


def test_the_best_lag_is_that_of_motor_and_delay(flown: MotorRecord) -> None:
    (found,) = excitations([flown], LEVERS)
    together = TRUTH["T_motor"] + TRUTH["tau_gyro"]
    # One of the tried lags, which lie a factor of two apart.
    assert 0.5 * together <= found["p"].lag_s <= 2.0 * together


def test_a_controller_alone_excites_nothing() -> None:
    (found,) = excitations(flights(1, seed=6, duration_s=10.0, size=0.0), LEVERS)
    assert all(one.correlation < LEAST_CORRELATION for one in found.values())


def test_the_order_of_the_motors_does_not_matter(flown: MotorRecord) -> None:
    order = [3, 1, 0, 2]
    turned = replace(flown, outputs=flown.outputs[order])
    (one,), (other,) = excitations([flown], LEVERS), excitations([turned], LEVERS[:, order])
    for axis in one:
        assert other[axis].correlation == pytest.approx(one[axis].correlation, abs=1e-12)


def test_motors_that_stand_still_excite_nothing(flown: MotorRecord) -> None:
    still = replace(flown, outputs=np.full(flown.outputs.shape, 0.5))
    (found,) = excitations([still], LEVERS)
    assert {one.correlation for one in found.values()} == {0.0}


@pytest.mark.parametrize("sample_rate_hz", [20.0, 100.0, 1000.0])
def test_slow_motion_passes_and_fast_motion_does_not(sample_rate_hz: float) -> None:
    taps = slow_taps(sample_rate_hz)
    gain = np.abs(np.exp(-2j * np.pi * np.outer([0.0, 5.0, 9.5], np.arange(taps.size)) / sample_rate_hz) @ taps)
    np.testing.assert_allclose(gain[:2], [1.0, np.sqrt(0.5)], atol=0.03)
    assert gain[2] < 0.35


def test_slow_records_pass_as_they_are() -> None:
    np.testing.assert_array_equal(slow_taps(10.0), [1.0])


def agile(*, air: float, seed: int = 4, duration_s: float = 20.0, rate_hz: float = 200.0) -> MotorRecord:
    """Torques of roll up to 20 Hz under moments of the air below 2 Hz, that many times as large; 0.015 kg m²."""
    rng, samples = np.random.default_rng(seed), round(duration_s * rate_hz)
    torque = np.asarray(sosfiltfilt(butter(2, 20.0, fs=rate_hz, output="sos"), rng.normal(size=samples)))
    moments = np.asarray(sosfiltfilt(butter(2, 2.0, fs=rate_hz, output="sos"), rng.normal(size=samples)))
    moments *= air * torque.std() / moments.std()
    outputs = 0.5 + 0.02 * np.sign(LEVERS[0])[:, None] * torque / torque.std()
    level = motor_speed(outputs, lag_s=0.03, delay_s=0.0, step_s=1.0 / rate_hz).level.real
    made = LEVERS[0] @ (THRUST_N * level)
    pushed = (made + moments * made.std() / torque.std()) / INERTIA_KG_M2
    roll = np.concatenate([[0.0], np.cumsum(0.5 * (pushed[1:] + pushed[:-1]))]) / rate_hz
    still = 1e-3 * rng.normal(size=(2, samples))
    return MotorRecord(
        name="agile",
        sample_rate_hz=rate_hz,
        outputs=outputs,
        rates=np.stack([roll + 1e-3 * rng.normal(size=samples), *still]),
        az=-9.80665 + 0.05 * rng.normal(size=samples),
    )


def test_octaves_show_the_motors_of_an_agile_flight() -> None:
    (calm,), (rough,) = (excitations([agile(air=air)], LEVERS) for air in (0.0, 4.0))
    assert (calm["p"].counts, calm["p"].band_hz) == (True, (0.0, 5.0))
    assert rough["p"].counts
    assert rough["p"].band_hz[0] >= 3.0
    assert rough["p"].band_hz[1] >= 12.0
    assert band_words([rough], "p") == f"from {rough['p'].band_hz[0]:g} to {rough['p'].band_hz[1]:g} Hz"
    assert not any(rough[axis].counts for axis in ("az", "q", "r"))


def test_inertia_comes_from_the_octaves_that_the_motors_explain() -> None:
    parameters = motor_parameters(curve="linear", known={"m": 1.0, "c_1": THRUST_N}, axes=("p",), heave_damping=False)
    problem = MotorProblem(records=(agile(air=4.0),), levers=LEVERS, parameters=parameters, axes=("p",))
    found = fit_motors(problem).parameters
    assert found["I_xx"].value == pytest.approx(INERTIA_KG_M2, rel=0.05)
    assert found["T_motor"].value == pytest.approx(0.03, abs=0.004)


def test_an_axis_that_slow_motion_shows_is_not_read_in_octaves_of_other_records() -> None:
    calm, rough = excitations([agile(air=0.0), agile(air=4.0)], LEVERS)
    assert (calm["p"].counts, calm["p"].band_hz) == (True, (0.0, 5.0))
    assert (rough["p"].counts, rough["p"].band_hz) == (False, (0.0, 5.0))


@pytest.mark.parametrize("spin_up", [False, True])
def test_a_record_shorter_than_the_filter_shows_nothing(spin_up: bool) -> None:
    rng = np.random.default_rng(3)
    record = MotorRecord(
        name="short",
        sample_rate_hz=400.0,
        outputs=0.5 + 0.1 * rng.standard_normal((4, 60)),
        rates=rng.standard_normal((3, 60)),
        az=-9.81 + rng.standard_normal(60),
    )
    (found,) = excitations([record], levers(), spin_up=spin_up)
    assert all(excitation.correlation == 0.0 for excitation in found.values())
