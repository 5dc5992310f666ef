"""What is predicted of one axis, where the answer is known otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.planning.plans import LOG_HZ, STRUCTURE, TRUTH, roll_loop, sweeps

from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.excitation.plan import together
from rotorid.models.controller import RateController
from rotorid.planning.expected import FitSettings
from rotorid.planning.loop import White, axis_loop, disturbances_of, vehicle_loop
from rotorid.planning.prediction import Prediction, predict
from rotorid.vehicles import s500

PLAN = sweeps({"roll": 0.1}, 40.0, count=2)
NOISY = 0.3


def predicted(*, noise: float = NOISY, plan: FlightPlan = PLAN, choices: FitSettings | None = None) -> Prediction:
    return predict(STRUCTURE, TRUTH, roll_loop(noise), plan, choices=choices)


def test_every_free_parameter_has_its_numbers() -> None:
    found = predicted(noise=0.02)
    assert [one.name for one in found.parameters] == list(TRUTH)
    assert found["L_roll"].unit == "rad/s^2"
    assert found["L_roll"].percent == pytest.approx(100.0 * found["L_roll"].std / 80.0)
    np.testing.assert_allclose([one.std for one in found.parameters], np.sqrt(np.diag(found.covariance)))
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)
    # Of a structure that fits, no model error is seen, but for chance.
    assert found.inflation > 1.0
    assert 0.0 < found.model_error["p/roll_command"] < 0.03
    assert found.response.estimate == "joint"
    for one in found.parameters:
        # What windows leave of leakage is counted as an error, so that no parameter is off by much more than one.
        assert one.expected == pytest.approx(one.value, abs=2.0 * one.std)
        assert 0.0 < one.lowest_std < one.std_random < one.std
        assert one.std_model == pytest.approx(np.sqrt(one.std**2 - one.std_random**2))
    with pytest.raises(KeyError, match="no parameter"):
        found["L_q"]


def test_twice_the_noise_is_twice_the_error() -> None:
    """Where noise rules and the points that are used stay the same, all errors are proportional to it."""
    band = FitSettings(band_rad_s=(2.0, 20.0))
    calm, windy = (predicted(noise=level, choices=band) for level in (0.1, 0.2))
    assert np.array_equal(calm.used, windy.used)
    for one, other in zip(calm.parameters, windy.parameters, strict=True):
        # It is taken where the fit ends, and what windows leave of leakage moves that by a percent or two.
        assert other.lowest_std == pytest.approx(2.0 * one.lowest_std, rel=0.03)
        # Leakage is a part of what is stated, and does not grow.
        assert 1.0 < other.std_random / one.std_random < 2.03
        assert other.scatter == pytest.approx(2.0 * one.scatter, rel=0.1)


def test_four_flights_halve_the_error() -> None:
    one, four = (predicted(plan=sweeps({"roll": 0.1}, 40.0, count=count, rest_s=25.0)) for count in (1, 4))
    for short, long in zip(one.parameters, four.parameters, strict=True):
        # The noise on the sweeps is another in each, and the windows of four are longer.
        assert long.lowest_std == pytest.approx(0.5 * short.lowest_std, rel=0.05)
        assert long.std_random == pytest.approx(0.5 * short.std_random, rel=0.2)


def test_a_lag_that_is_not_there_is_left_out() -> None:
    truth = {**TRUTH, "T_motor": 0.0}
    loop = axis_loop(STRUCTURE, truth, None, White(std=(0.02,), sample_rate_hz=LOG_HZ), log_rate_hz=LOG_HZ)
    found = predict(STRUCTURE, truth, loop, PLAN)
    assert "T_motor" not in [one.name for one in found.parameters]
    assert next((f.kind, f.where) for f in found.findings) == ("dropped_parameter", "T_motor")


def test_a_fixed_parameter_needs_no_value_and_makes_the_others_surer() -> None:
    held = replace(STRUCTURE, parameters=STRUCTURE.parameters.fix("T_motor", 0.05))
    given = {name: value for name, value in TRUTH.items() if name != "T_motor"}
    found, free = predict(held, given, roll_loop(NOISY), PLAN), predicted()
    assert "T_motor" not in [one.name for one in found.parameters]
    assert found["tau_roll"].std_random < free["tau_roll"].std_random
    assert found["tau_roll"].lowest_std < free["tau_roll"].lowest_std


def test_a_direct_estimate_in_closed_loop_is_foretold_to_be_biased() -> None:
    controller = RateController(proportional_s=0.08, integral=0.1)
    loop = axis_loop(STRUCTURE, TRUTH, controller, White(std=(2.0,), sample_rate_hz=LOG_HZ), log_rate_hz=LOG_HZ)
    direct = FitSettings(estimate="direct", coherence=0.1, band_rad_s=(3.0, 40.0))
    found = predict(STRUCTURE, TRUTH, loop, sweeps({"roll": 0.3}, 60.0, count=4), choices=direct)
    assert found.response.estimate == "direct"
    assert "biased_parameter" in [finding.kind for finding in found.findings]
    # Where the noise rules the response is minus the inverse of the controller.
    responses = loop.at(found.response.omega_rad_s)
    to_controller = np.abs(found.response.values[0, 0] + 1.0 / controller.response(found.response.omega_rad_s))
    to_plant = np.abs(found.response.values[0, 0] - responses.plant[0, 0])
    loud = found.response.coherence[0, 0] < 0.9
    assert loud.any()
    assert np.all((to_plant > 0.01 * np.abs(responses.plant[0, 0]))[loud])
    assert np.all(np.isfinite(to_controller))


def test_a_loop_without_noise_has_an_answer_too() -> None:
    found = predicted(noise=0.0)
    assert all(0.0 < one.std_random < 0.05 * one.value or one.name == "L_p" for one in found.parameters)
    # What is left is leakage, which is the same in every flight.
    assert all(one.scatter < 1e-3 * one.std and one.lowest_std < 1e-3 * one.std for one in found.parameters)


def test_test_inputs_of_other_axes_do_not_stand_in_for_noise() -> None:
    """A yaw that moves at the same time is known to the flight, and told apart or not by what the model has."""
    roll, both = (
        together(amplitudes, start_s=0.0, band_rad_s=(2.0, 40.0), period_s=10.0, sample_rate_hz=LOG_HZ, periods=6)
        for amplitudes in ({"roll": 0.03}, {"roll": 0.03, "yaw": 0.05})
    )
    loop, truth = vehicle_loop(s500.vehicle(), log_rate_hz=LOG_HZ), {**s500.TRUTH, "T_motor": 0.0}
    choices = FitSettings(band_rad_s=(12.0, 40.0))
    alone, along = (
        predict(STRUCTURE, truth, loop, FlightPlan(name="multisine", inputs=parts), choices=choices)
        for parts in (roll, both)
    )
    # Yaw reaches p through L_r, and the halved harmonics leave less to roll.
    assert along["L_roll"].std_random > alone["L_roll"].std_random
    assert along.response.instruments == ("roll_excitation",)


def test_too_small_a_test_input_is_refused_with_its_coherence() -> None:
    with pytest.raises(InsufficientDataError, match="octave") as raised:
        predicted(plan=sweeps({"roll": 0.0005}, 40.0))
    assert [finding.kind for finding in raised.value.findings] == ["low_coherence"]


def test_a_short_flight_is_remarked_on() -> None:
    wide = FitSettings(band_rad_s=(0.5, 50.0))
    kinds = {finding.kind for finding in predicted(plan=sweeps({"roll": 0.1}, 15.0), choices=wide).findings}
    assert "record_too_short" in kinds
    assert kinds & {"uncertain_parameter", "insensitive_parameter"}


def test_values_and_names_are_asked_for() -> None:
    with pytest.raises(UsageError, match="missing values of tau_roll"):
        predict(STRUCTURE, {name: TRUTH[name] for name in ("L_roll", "L_p", "T_motor")}, roll_loop(), PLAN)
    with pytest.raises(UsageError, match="excites pitch"):
        predict(STRUCTURE, TRUTH, roll_loop(), sweeps({"pitch": 0.1}, 20.0))
    with pytest.raises(UsageError, match="unknown estimate"):
        FitSettings(estimate="both")  # type: ignore[arg-type]


def test_the_disturbances_of_one_flight_serve_the_next() -> None:
    """White noise at the output, seen through a response and used again, is the same white noise."""
    first = predicted()
    seen = disturbances_of(first.response)
    # Below, sweeps of 40 s leak more than the noise.
    fast = seen.omega_rad_s > 10.0
    np.testing.assert_allclose(seen.values[0, 0, fast].real, 2.0 * NOISY**2 / LOG_HZ, rtol=0.1)
    loop = axis_loop(STRUCTURE, TRUTH, RateController(proportional_s=0.08, integral=0.1), seen, log_rate_hz=LOG_HZ)
    for one, again in zip(first.parameters, predict(STRUCTURE, TRUTH, loop, PLAN).parameters, strict=True):
        assert again.std_random == pytest.approx(one.std_random, rel=0.15)
