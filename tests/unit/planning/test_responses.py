"""Responses to set-points before the flight: known truth, what is expected of it, and what flights then state."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import UsageError
from rotorid.excitation.plan import sequence, uncorrelated_binaries
from rotorid.fitting.time.output_error import TimeData, TimeProblem, fit_output_error
from rotorid.flying.designs import design
from rotorid.flying.settings import DesignSettings, plan_settings
from rotorid.models.library import response_model
from rotorid.planning.aircraft import aircraft_loop
from rotorid.planning.loop import LoopModel
from rotorid.planning.prediction import Prediction
from rotorid.planning.responses import SETPOINTS, predict_responses, setpoint_loop, setpoint_of, with_known
from rotorid.simulation.linear import simulate_linear
from rotorid.uncertainty.cramer_rao import bounds_of_parts
from rotorid.vehicles import VEHICLES, aircraft

TRUE: Mapping[str, float] = {
    "K_phi": 0.93,
    "omega_phi": 9.0,
    "zeta_phi": 0.70,
    "tau_phi": 0.07,
    "K_velocity_down": 0.95,
    "omega_velocity_down": 8.0,
    "zeta_velocity_down": 0.70,
    "tau_velocity_down": 0.06,
}
PAIRS = (("phi_setpoint", "phi"), ("velocity_down_setpoint", "velocity_down"))
SECOND = response_model("response.second_order_delay", PAIRS)


@cache
def plan(duration_s: float = 40.0, seed: int = 0) -> FlightPlan:
    inputs = uncorrelated_binaries(
        {"roll": 0.1, "thrust": 0.5},
        start_s=0.0,
        band_rad_s=(1.5, 8.5),
        duration_s=duration_s,
        sample_rate_hz=400.0,
        clock_hz=20.0,
        entries={"roll": "attitude_setpoint", "thrust": "stick"},
        seed=seed,
    )
    return sequence("binaries", [inputs])


@cache
def known_loop() -> LoopModel:
    outside = setpoint_loop(aircraft_loop(aircraft("bebop"), log_rate_hz=20.0), SECOND.inputs, sampled=True)
    return with_known(outside, SECOND, TRUE)


@cache
def predicted() -> Prediction:
    return predict_responses(SECOND, TRUE, known_loop(), plan())


def test_a_loop_of_the_structure_is_expected_to_show_its_values() -> None:
    """Up to what a loop at 400 Hz, for which values of a turn stand for its middle, makes of held steps: 1.25 ms."""
    for parameter in predicted().parameters:
        late = 1.3e-3 if parameter.name.startswith("tau") else 0.0
        assert parameter.expected == pytest.approx(TRUE[parameter.name], rel=2e-3, abs=late), parameter.name


def test_no_estimate_is_stated_better_than_its_bound_and_none_is_inflated() -> None:
    found = predicted()
    for parameter in found.parameters:
        assert 0.8 * parameter.lowest_std < parameter.scatter < 1.3 * parameter.std, parameter.name
    assert found.inflation == pytest.approx(1.0, abs=0.2)
    assert not found.findings


@pytest.mark.slow
def test_flights_of_the_plan_scatter_and_state_as_predicted() -> None:
    """Over 24 flights a scatter is known to 14 %, and normalized errors cover 95 % within some 6 %."""
    system, flown = SECOND.matrices(TRUE), plan()
    time_s = np.arange(round(flown.duration_s * 20.0)) / 20.0
    signs = [SETPOINTS[name].sign for name, _ in PAIRS]
    asked = np.stack([sign * one.at(time_s + 0.025) for sign, one in zip(signs, flown.inputs, strict=True)])
    clean = simulate_linear(system, asked, sample_rate_hz=20.0)
    noise_std = np.array([[0.001], [0.02]])
    ends, stated = [], []
    for seed in range(24):
        noise = noise_std * np.random.default_rng(seed).standard_normal(clean.shape)
        record = TimeData(name="twin", inputs=asked, outputs=clean + noise, sample_rate_hz=20.0, before=np.zeros(2))
        problem = TimeProblem(
            structure=SECOND,
            parameters=SECOND.parameters.with_values(TRUE),
            records=(record,),
            hold="zero",
            unknowns=("initial_state", "output_shift"),
        )
        fit = fit_output_error(problem, starts=[problem.parameters.pack()])
        ends.append(fit.solution.theta)
        stated.append(bounds_of_parts(fit.problem.parts(fit.solution.theta), fit.parameters.free).std)
    foretold = np.array([one.std for one in predicted().parameters])
    scatter = np.array([one.scatter for one in predicted().parameters])
    np.testing.assert_allclose(np.mean(stated, axis=0) / foretold, 1.0, atol=0.25)
    np.testing.assert_allclose(np.std(ends, axis=0, ddof=1) / scatter, 1.0, atol=0.45)
    truth = np.array([TRUE[name] for name in SECOND.parameters.free])
    covered = np.abs(np.array(ends) - truth) < 1.96 * np.array(stated)
    assert np.mean(covered) > 0.88


@pytest.mark.slow
def test_longer_flights_know_more() -> None:
    longer = predict_responses(SECOND, TRUE, known_loop(), plan(160.0))
    ratios = [long.std / short.std for long, short in zip(longer.parameters, predicted().parameters, strict=True)]
    np.testing.assert_allclose(ratios, 0.5, atol=0.15)


def test_the_bebop_answers_its_set_points_with_the_slope_of_its_loops() -> None:
    outside = setpoint_loop(aircraft_loop(aircraft("bebop"), log_rate_hz=20.0), ["theta_setpoint"])
    slow = outside.plant.response(np.array([0.05]))
    assert abs(slow[outside.outputs.index("theta"), 0]) == pytest.approx(1.0, abs=0.02)
    assert abs(slow[outside.outputs.index("phi"), 0]) < 1e-6


def test_set_points_have_an_axis_and_a_place() -> None:
    for name, one in SETPOINTS.items():
        assert setpoint_of(one.axis, one.entry) == name


def test_what_is_no_set_point_is_refused() -> None:
    loop = aircraft_loop(aircraft("bebop"), log_rate_hz=20.0)
    with pytest.raises(UsageError, match="'roll_command' is not a set-point; expected inputs of"):
        setpoint_loop(loop, ["roll_command"])
    other, outside = response_model("response.first_order", [("theta_setpoint", "theta")]), known_loop()
    with pytest.raises(UsageError, match="uses theta_setpoint, but"):
        predict_responses(other, {}, outside, plan())


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"inputs": ("p_setpoint",), "outputs": ("p",), "axes": ("roll",)}, "which bebop does not take"),
        ({"inputs": ("theta_setpoint",), "outputs": ("theta",), "axes": ("roll",)}, "which the plan does not move"),
        ({"models": ("rate.roll",)}, "roll_command, which bebop does not take"),
        ({"axes": ("yaw",)}, "yaw cannot be excited"),
        ({"entry": "command"}, "at the command cannot be excited"),
    ],
)
def test_inputs_that_the_vehicle_does_not_have_end_in_a_sentence(wishes: Mapping[str, object], words: str) -> None:
    bebop, given = VEHICLES["bebop"], dict(wishes)
    channels = {name: given.pop(name) for name in ("inputs", "outputs") if name in given}
    models = given.pop("models", ("response.first_order_delay",))
    with pytest.raises(UsageError, match=words):
        design(
            DesignSettings(
                vehicle=bebop,
                kinds=("random_binary",),
                plan=plan_settings(bebop, inputs=channels.get("inputs", ()), models=models, **given),  # type: ignore[arg-type]
                models=models,  # type: ignore[arg-type]
                **channels,  # type: ignore[arg-type]
            )
        )
