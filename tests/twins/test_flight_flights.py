"""Twins of fast flights: their logs are those of the equations and of their true numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.twins.flight_flights import AIR, FULL_RAD_S, RATE_HZ, Case, FlightTwin, Motors, twin

from rotorid.models.flight import FLIGHT_PARAMETERS, felt, flight_loads, speeds_of_outputs

ACCELEROMETER_M_S2 = 0.1


def _residual(flown: FlightTwin, full: float) -> np.ndarray:
    """Specific force as logged, without that of the true numbers in the true motion."""
    truth = flown.flight.truth
    turn = Rotation.from_euler("ZYX", np.stack([truth[name] for name in ("psi", "theta", "phi")]).T)
    air = [truth[f"velocity_{axis}"] - truth[f"wind_{axis}"] for axis in ("north", "east", "down")]
    rates = np.stack([truth[name] for name in "pqr"])
    outputs = np.stack([truth[f"motor_speed_{number}"] for number in range(1, 5)])
    speeds = full * outputs if full != 1.0 else speeds_of_outputs(flown.truth, outputs)
    loads = flight_loads(
        flown.truth, flown.frame, speeds=speeds, velocity=turn.inv().apply(np.stack(air).T).T, rates=rates
    )
    expected = felt(loads, flown.truth, flown.frame.mass_kg, rates, np.gradient(rates, 1.0 / RATE_HZ, axis=1))
    logged = np.stack([flown.flight.columns[name] for name in ("ax", "ay", "az")])
    return np.asarray(logged - expected)[:, 2:-2]


@pytest.mark.parametrize("vehicle", AIR)
@pytest.mark.parametrize("motors", ["speeds", "outputs"])
def test_logs_are_those_of_the_true_numbers(vehicle: str, motors: Motors) -> None:
    case = Case(vehicle, "climbs", motors, wind=(3.0, -2.0, 0.3), terms="full", seed=1, duration_s=18.0)
    flown = twin(case)
    assert set(flown.truth) <= set(FLIGHT_PARAMETERS)
    left = _residual(flown, FULL_RAD_S[vehicle] if motors == "speeds" else 1.0)
    # A filter of the autopilot is between them, and differences of rates: noise, and nothing that goes with the flight.
    assert np.all(np.abs(left.mean(axis=1)) < 0.01)
    assert np.all(left.std(axis=1) < 1.1 * ACCELEROMETER_M_S2)
    expected = "motor_speed_1" if motors == "speeds" else "motor_1"
    assert expected in flown.record.channel_names
    assert flown.motors.velocity.shape == flown.motors.rates.shape


def test_missions_reach_their_speeds() -> None:
    fastest = {}
    for name in ("eights", "slow"):
        truth = twin(Case("x500", name)).flight.truth
        fastest[name] = float(np.hypot(truth["velocity_north"], truth["velocity_east"]).max())
    assert fastest["eights"] > 10.0
    assert fastest["slow"] < 2.5
