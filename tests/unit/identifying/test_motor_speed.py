"""``motor.speed``: lags, curve, voltage and factors of motors come back from logs that were made with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins.motor_speeds import Motors, record_of

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.supports import supported_models, supports
from rotorid.models.motor_speed import Operation, motor_speed_model
from rotorid.results.model import IdentifiedModel

TWIN = Motors()


@pytest.fixture(scope="module")
def log() -> FlightRecord:
    return record_of(TWIN, rate_hz=200.0, duration_s=12.0, seed=1)


@pytest.fixture(scope="module")
def model(log: FlightRecord) -> IdentifiedModel:
    return rotorid.identify([log], "motor.speed", hold="zero")


def test_lags_up_and_down_come_back_within_their_intervals(model: IdentifiedModel) -> None:
    for name, truth in (("T_motor_up", TWIN.lag_up_s), ("T_motor_down", TWIN.lag_down_s)):
        estimate = model[name]
        assert estimate.std is not None
        assert abs(estimate.value - truth) < 3.0 * estimate.std
        assert estimate.std < 0.05 * truth


def test_curve_and_factors_come_back(model: IdentifiedModel) -> None:
    assert model.nonlinear is not None
    values = {name: estimate.value for name, estimate in model.parameters.items()}
    about = np.array([-0.2, 0.0, 0.2])
    truth = TWIN.speed + TWIN.slope * about + TWIN.curve * about**2
    reference = model.nonlinear.constants["u_0"]
    off = 0.5 + about - reference
    found = values["Omega_0"] + values["Omega_1"] * off + values["Omega_2"] * off**2
    assert found == pytest.approx(truth, rel=0.01)
    assert values["f_2"] == pytest.approx(TWIN.factors[1], abs=0.003)
    assert "n_V" not in values


def test_a_part_of_the_log_that_was_not_fitted_verifies_the_model(model: IdentifiedModel) -> None:
    (check,) = model.verifications.maneuvers
    assert check.maneuver.start_s > 7.0
    assert all(score.nrmse_fit_percent > 90.0 for score in check.scores.values())


def test_a_sagging_battery_shows_the_influence_of_the_voltage() -> None:
    log = record_of(Motors(sag=0.25, factors=(1.0,)), rate_hz=100.0, duration_s=12.0, seed=2)
    exponent = rotorid.identify([log], "motor.speed")["n_V"]
    assert exponent.std is not None
    assert abs(exponent.value - 1.0) < 3.0 * exponent.std
    assert exponent.std < 0.1


def test_the_log_supports_the_model_and_identify_of_all_takes_it(log: FlightRecord) -> None:
    assert supports(log)["motor.speed"].by == "motor speeds"
    assert "motor.speed" in supported_models([log])


def test_speeds_that_are_too_slow_say_so() -> None:
    slow = record_of(TWIN, rate_hz=10.0, duration_s=60.0, seed=3)
    assert supports(slow)["motor.speed"].lacks == "rate_too_low"
    with pytest.raises(InsufficientDataError, match="10 Hz only"):
        rotorid.identify([slow], "motor.speed")


def test_a_log_without_speeds_does_not_speak_of_the_model() -> None:
    log = record_of(TWIN, rate_hz=100.0, duration_s=12.0, seed=4)
    (topic,) = log.topics
    kept = tuple(channel for channel in topic.channels if "speed" not in channel.name)
    rows = [topic.channels.index(channel) for channel in kept]
    bare = replace(log, topics=(replace(topic, channels=kept, values=topic.values[rows]),))
    assert "motor.speed" not in supports(bare)
    with pytest.raises(InsufficientDataError, match="no speeds of the motors"):
        rotorid.identify([bare], "motor.speed")


def test_the_equations_slow_down_with_the_lag_of_their_direction() -> None:
    model = motor_speed_model(1, Operation(output=0.5, speed=1000.0, slope=1000.0))
    values = {**model.parameters.values, **model.constants, "T_motor_up": 0.02, "T_motor_down": 0.05}
    (rate,) = model.equations
    rising = rate.evaluate({**values, "motor_1": 0.6, "Omega_of_1": 1000.0})
    falling = rate.evaluate({**values, "motor_1": 0.4, "Omega_of_1": 1000.0})
    assert rising == pytest.approx(100.0 / 0.02)
    assert falling == pytest.approx(-100.0 / 0.05)


def test_a_log_without_noise_leaves_the_model_error_of_clocks_and_sensors() -> None:
    exact = Motors(noise=0.0, factors=(1.0,), lag_down_s=0.03)
    found = rotorid.identify([record_of(exact, rate_hz=100.0, duration_s=10.0, seed=5)], "motor.speed", hold="zero")
    for name in ("T_motor_up", "T_motor_down"):
        estimate = found[name]
        assert estimate.std is not None
        assert estimate.std_model is not None
        assert estimate.std_model >= 0.15 * 0.01
        assert estimate.std < 0.1 * 0.03
        assert abs(estimate.value - 0.03) < 2.0 * estimate.std
    assert all(estimate.std_model for estimate in found.parameters.values() if estimate.status == "free")
    assert found["Omega_0"].std == pytest.approx(0.005 * found["Omega_0"].value, rel=0.2)
