"""Bootstrap of fits in time: new noise at the outputs, whole records."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rotorid.errors import UsageError
from rotorid.fitting.motors.fit import fit_motors
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.problem import Problem
from rotorid.fitting.time.nonlinear import NonlinearProblem, fit_nonlinear
from rotorid.fitting.time.output_error import OutputErrorFit, TimeData, TimeProblem, fit_output_error
from rotorid.fitting.time.prediction_error import InnovationsProblem, fit_prediction_error
from rotorid.models.library import nonlinear_model, response_model
from rotorid.models.motors import motor_parameters
from rotorid.simulation.linear import simulate_linear
from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear
from rotorid.uncertainty.bootstrapping import bootstrap, bootstrap_records
from rotorid.uncertainty.colored import (
    ColoredNoise,
    Process,
    autoregression,
    colored_covariance,
)
from rotorid.uncertainty.cramer_rao import bounds
from rotorid.vehicles.motor_flight import TRUTH, Air, flights, levers

STRUCTURE = response_model("response.first_order", [("r_setpoint", "r")])
RATE_HZ = 25.0


def flown(records: int, samples: int, *, noise: float, memory: float = 0.0, seed: int = 0) -> OutputErrorFit:
    """A yaw rate under random binary commands, with white or colored noise."""
    rng = np.random.default_rng(seed)
    truth = STRUCTURE.parameters
    system = STRUCTURE.matrices(truth.values)
    found = []
    for record in range(records):
        u = np.sign(np.repeat(rng.standard_normal((1, -(-samples // 10))), 10, axis=1))[:, :samples]
        y = simulate_linear(system, u, sample_rate_hz=RATE_HZ, x0=np.zeros(1), before=u[:, 0])
        color = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.standard_normal(samples + 200))[200:]
        outputs = y + noise * color
        found.append(TimeData(name=f"flight {record}", inputs=u, outputs=outputs, sample_rate_hz=RATE_HZ))
    problem = TimeProblem(structure=STRUCTURE, parameters=truth, records=tuple(found))
    return fit_output_error(problem, starts=[truth.pack()])


@pytest.mark.parametrize("memory", [0.0, 0.7])
def test_small_noise_gives_the_stated_errors(memory: float) -> None:
    fit, runs = flown(1, 1000, noise=0.02, memory=memory), 200
    table = bootstrap(fit.problem, fit.solution, runs=runs, seed=1)
    stated = np.sqrt(colored_covariance(fit.problem.parts(fit.solution.theta)).corrected.diagonal())
    # Four deviations of a standard deviation of so many runs; a fit of four numbers takes four of a thousand residuals.
    np.testing.assert_allclose(table.std, stated, rtol=4.0 / np.sqrt(2.0 * runs) + 0.01)
    assert np.all(np.abs(table.bias) <= 4.0 * stated / np.sqrt(runs))
    assert table.names == fit.parameters.free


def test_a_run_is_the_fit_to_the_prediction_with_that_noise() -> None:
    fit = flown(2, 300, noise=0.1)
    noise = ColoredNoise.of(fit.problem.parts(fit.solution.theta))
    table = bootstrap(fit.problem, fit.solution, runs=3, seed=6, noise=noise)
    for run, theta in enumerate(table.draws):
        rng = np.random.default_rng(np.random.SeedSequence(6).spawn(3)[run])
        records = [
            replace(one.record, outputs=one.predicted + np.sqrt(fit.noise) @ errors.T)
            for one, errors in zip(fit.problem.predicted(fit.solution.theta), noise.draw(rng), strict=True)
        ]
        again = fit_output_error(replace(fit.problem, records=tuple(records)), starts=[fit.solution.theta])
        # With one output its variance is no weight, so that the fit from the beginning ends in the same place.
        np.testing.assert_allclose(theta, again.solution.theta, atol=0.01 * table.std.max())


def test_the_seed_decides_and_not_the_workers() -> None:
    fit = flown(5, 100, noise=0.1)
    with ThreadPoolExecutor(2) as executor:
        for verb in (bootstrap, bootstrap_records):
            alone = verb(fit.problem, fit.solution, runs=20, seed=1)
            shared = verb(fit.problem, fit.solution, runs=20, seed=1, executor=executor)
            np.testing.assert_array_equal(alone.draws, shared.draws)
            np.testing.assert_array_equal(verb(fit.problem, fit.solution, runs=9, seed=1).draws, alone.draws[:9])


def test_a_drawn_process_has_its_covariance_from_the_first_sample_on() -> None:
    process = Process(np.array([[[0.7, 0.2], [0.0, 0.5]]]), np.array([[1.0, 0.3], [0.3, 0.5]]))
    A, stationary = process.coefficients[0], np.zeros((2, 2))
    for _ in range(100):
        stationary = A @ stationary @ A.T + process.noise
    source = ColoredNoise((process, process), (50, 30))
    draws = [source.draw(np.random.default_rng(seed)) for seed in range(4000)]
    assert [one.shape for one in draws[0]] == [(50, 2), (30, 2)]
    first, last = np.array([one[0][0] for one in draws]), np.array([one[0][-1] for one in draws])
    # Products of normal numbers scatter by at most the root of two times their variances.
    tolerance = 4.0 * np.sqrt(2.0 / 4000) * stationary.max()
    np.testing.assert_allclose(first.T @ first / 4000, stationary, atol=tolerance)
    np.testing.assert_allclose(last.T @ last / 4000, stationary, atol=tolerance)
    assert abs(np.mean(first * last)) < tolerance
    np.testing.assert_allclose(autoregression([one[0] for one in draws]).coefficients[0], A, atol=0.02)


def test_records_drawn_anew_agree_where_they_are_alike() -> None:
    """Of fifteen records the bootstrap knows a standard deviation to one in the root of twice their number."""
    fit = flown(15, 120, noise=0.1)
    table = bootstrap_records(fit.problem, fit.solution, runs=60, seed=4)
    stated = np.sqrt(colored_covariance(fit.problem.parts(fit.solution.theta)).white.diagonal())
    ratio = table.std / stated
    assert np.all(np.abs(np.log(ratio)) < 4.0 * np.sqrt(0.5 / 15 + 0.5 / 60))


def test_a_record_drawn_twice_counts_twice() -> None:
    fit = flown(5, 60, noise=0.3)
    table = bootstrap_records(fit.problem, fit.solution, runs=4, seed=4)
    for run, theta in enumerate(table.draws):
        rng = np.random.default_rng(np.random.SeedSequence(4).spawn(4)[run])
        records = tuple(fit.problem.records[one] for one in rng.integers(0, 5, 4))
        again = fit_output_error(replace(fit.problem, records=records), starts=[fit.solution.theta])
        np.testing.assert_allclose(theta, again.solution.theta, atol=0.01 * table.std.max())


def test_one_record_cannot_be_drawn_from() -> None:
    fit = flown(1, 100, noise=0.1)
    with pytest.raises(UsageError, match="1 record to draw from; expected 5 or more"):
        bootstrap_records(fit.problem, fit.solution, runs=10, seed=0)


def test_parameters_of_a_nonlinear_model_have_a_spread_too() -> None:
    model, scheme = nonlinear_model("drag.linear"), Scheme(hold="first")
    rng, truth = np.random.default_rng(0), model.parameters.with_values({"k_Dx": 0.3, "k_Dy": 0.45})
    corners = 0.35 * rng.choice([-1.0, 1.0], (2, 16))
    tilts = [np.interp(np.arange(300), 20 * np.arange(16), row) for row in corners]
    u = np.stack([*tilts, np.zeros(300), np.zeros(300)])
    y = simulate_nonlinear(model, truth.values, u, sample_rate_hz=20.0, before=u[:, 0], scheme=scheme)
    noisy = y + 0.02 * rng.standard_normal(y.shape)
    record = TimeData(name="twin", inputs=u, outputs=noisy, sample_rate_hz=20.0)
    fit = fit_nonlinear(NonlinearProblem(structure=model, parameters=truth, records=(record,), scheme=scheme))
    runs = 60
    table = bootstrap(fit.problem, fit.solution, runs=runs, seed=0)
    assert table.names == truth.free
    stated = np.sqrt(fit.covariance.diagonal())[: len(truth.free)]
    np.testing.assert_allclose(table.std, stated, rtol=4.0 / np.sqrt(2.0 * runs))


def test_motors_scatter_as_their_bounds_say() -> None:
    """Equations with regressors as flown, and errors drawn anew by the color that each has."""
    record = flights(1, seed=7, duration_s=8.0, air=Air(gyro=1e-4, gust=0.01, accelerometer=0.01))[0]
    parameters = motor_parameters(known={"m": TRUTH["m"]})
    fit = fit_motors(MotorProblem(records=(record,), levers=levers(), parameters=parameters))
    stated = bounds(fit.problem, fit.solution)
    assert stated.names == fit.moving
    table = bootstrap(fit.problem, fit.solution, runs=100, seed=3)
    assert table.names == fit.problem.parameters.free
    rows = [table.names.index(name) for name in stated.names]
    np.testing.assert_allclose(table.std[rows], stated.std, rtol=0.25)
    assert np.all(np.abs(table.bias[rows]) <= 0.5 * stated.std)


def test_a_problem_that_cannot_be_drawn_anew_says_so() -> None:
    fit = flown(1, 300, noise=0.1)
    problem = InnovationsProblem(structure=STRUCTURE, parameters=fit.parameters, records=fit.problem.records)
    with pytest.raises(UsageError, match=f"{STRUCTURE.name} cannot simulate new data"):
        bootstrap(problem, fit_prediction_error(problem).solution, runs=2, seed=0)


@pytest.mark.parametrize("method", ["output_error", "prediction_error"])
def test_bounds_of_any_problem_are_those_of_its_residuals(method: str) -> None:
    fit = flown(1, 500, noise=0.05, memory=0.5)
    problem: Problem = fit.problem
    solution = fit.solution
    if method == "prediction_error":
        problem = InnovationsProblem(structure=STRUCTURE, parameters=fit.parameters, records=fit.problem.records)
        solution = fit_prediction_error(problem).solution
    stated = bounds(problem, solution)
    assert stated.names == STRUCTURE.parameters.free
    # A noise on its bound has no effect any more, and none on what is known of the model.
    inside = ~np.array(solution.at_bound)
    parts = [part._replace(slopes=part.slopes[:, :, inside]) for part in problem.parts(solution.theta)]
    colored, count = colored_covariance(parts), len(stated.names)
    np.testing.assert_array_equal(stated.covariance, colored.corrected[:count, :count])
    assert stated.ar_order == colored.ar_order
