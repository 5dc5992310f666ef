"""Whether the intervals of ``motor.speed`` contain the truth: 44 simulated records, 50 to 1000 Hz."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from tests.twins.motor_speeds import Motors, record_of

import rotorid
from rotorid.fits.motors.errors import SENSOR_SHARE

RATES_HZ = (50.0, 100.0, 200.0, 500.0, 1000.0)
RECORDS = 44
LEAST = 0.88
"""Least share of 44 intervals of 95 % for one parameter; 39 of 44 are two standard deviations below 95 %."""

LEAST_OF_ALL = 0.93

MOST_SURE, LEAST_SURE = 1.1, 0.2
"""Root mean square of errors over stated deviations: beyond, intervals are too narrow, or say less than is known."""


def motors(seed: int) -> Motors:
    """Motors of one record: lags, curve, noise and scales of sensors, gusts, every second battery sags."""
    rng = np.random.default_rng(seed)
    return Motors(
        lag_up_s=rng.uniform(0.02, 0.06),
        lag_down_s=rng.uniform(0.03, 0.09),
        curve=rng.uniform(-1000.0, 500.0),
        noise=rng.uniform(2.0, 15.0),
        gusts=rng.uniform(0.0, 20.0),
        sag=(0.0, 0.15)[seed % 2],
        exponent=float(rng.choice([0.0, 1.0])),
        scales=tuple((1.0 + SENSOR_SHARE * rng.normal(size=2)).tolist()),
    )


@pytest.mark.slow
def test_intervals_of_all_parameters_contain_the_truth() -> None:
    held, counted, squares = Counter[str](), Counter[str](), Counter[str]()
    for seed in range(RECORDS):
        own = motors(seed)
        wander_s = np.random.default_rng(1000 + seed).uniform(0.04, 0.3)
        rate_hz = RATES_HZ[seed % len(RATES_HZ)]
        log = record_of(own, rate_hz=rate_hz, duration_s=25.0, seed=seed, wander_s=wander_s)
        model = rotorid.identify([log], "motor.speed")
        assert model.nonlinear is not None
        constants = model.nonlinear.constants
        about = constants["u_0"] - 0.5
        # The curve is that at the voltage of the fitted part, and the twin's at the mean of the record.
        volts = constants.get("V_0", 16.0 * (1.0 - 0.5 * own.sag)) / (16.0 * (1.0 - 0.5 * own.sag))
        scale = volts**own.exponent
        truth = {
            "T_motor_up": own.lag_up_s,
            "T_motor_down": own.lag_down_s,
            "Omega_0": scale * (own.speed + own.slope * about + own.curve * about**2),
            "Omega_1": scale * (own.slope + 2.0 * own.curve * about),
            "Omega_2": scale * own.curve,
            "f_2": own.factors[1],
            "n_V": own.exponent,
        }
        for name, value in truth.items():
            estimate = model.parameters.get(name)
            if estimate is not None and estimate.std:
                counted[name] += 1
                squares[name] += ((estimate.value - value) / estimate.std) ** 2
                held[name] += abs(estimate.value - value) < 1.96 * estimate.std
    rms = {name: float(np.sqrt(squares[name] / counted[name])) for name in counted}
    print({name: round(value, 2) for name, value in rms.items()})
    print({name: f"{held[name]} of {counted[name]}" for name in counted})
    assert counted["T_motor_up"] == RECORDS
    assert all(held[name] >= LEAST * counted[name] for name in counted)
    assert held.total() >= LEAST_OF_ALL * counted.total()
    assert all(LEAST_SURE < value < MOST_SURE for value in rms.values())
