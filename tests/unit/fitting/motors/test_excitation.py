"""Which axes of a flight the motors explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, excitations, slow_taps
from rotorid.vehicles.motor_flight import TRUTH, flights, levers

LEVERS = levers()


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
