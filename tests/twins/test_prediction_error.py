"""Prediction error on flights of an unstable vehicle under its controller: no bias, and intervals that hold."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

from rotorid.fitting.time.output_error import TimeData, TimeProblem, fit_output_error
from rotorid.fitting.time.prediction_error import InnovationsProblem, fit_prediction_error, fit_with_noise
from rotorid.models.library import rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import discretize
from rotorid.typing import FloatArray

TRUTH = {"L_p": 2.0, "L_roll": 40.0, "tau_roll": 0.023}
RATE_HZ, DURATION_S = 100.0, 60.0
GUST, GUST_CORRELATION_S, NOISE = 4.0, 0.3, 0.05
GAIN = 0.25


def vehicle() -> tuple[LinearStructure, ParameterSet]:
    """A roll rate that doubles in a third of a second, without the lag of motors."""
    whole = rate_model("rate.roll")
    structure = whole.condensed(whole.parameters.drop("T_motor"))
    # The library's rate is a stable one.
    freed = (replace(p, upper=10.0) if p.name == "L_p" else p for p in structure.parameters)
    parameters = ParameterSet(freed)
    return replace(structure, parameters=parameters), parameters


def flown(seed: int) -> TimeData:
    """A flight under a proportional controller, which answers what the noisy gyro shows, with a random binary signal.

    The command is held from sample to sample. Gust and vehicle are one exact step in between.
    """
    rng = np.random.default_rng(seed)
    samples, h = round(RATE_HZ * DURATION_S), 1.0 / RATE_HZ
    A = np.array([[TRUTH["L_p"], 1.0], [0.0, -1.0 / GUST_CORRELATION_S]])
    step = discretize(
        A,
        np.array([[TRUTH["L_roll"]], [0.0]]),
        delays_s=np.array([TRUTH["tau_roll"]]),
        step_s=h,
        hold="zero",
    )
    taps, lag = step.taps[:, 0], int(step.lags[0])
    density = np.diag([0.0, 2.0 * GUST**2 / GUST_CORRELATION_S])
    block = expm(np.block([[-A, density], [np.zeros((2, 2)), A.T]]) * h)
    root = np.linalg.cholesky(block[2:, 2:].T @ block[:2, 2:] + 1e-18 * np.eye(2))
    signal = 0.1 * np.repeat(rng.choice([-1.0, 1.0], samples // 10), 10)
    jolts, noise = rng.standard_normal((samples, 2)) @ root.T, NOISE * rng.standard_normal(samples)
    state, u, y = np.array([0.0, GUST * rng.standard_normal()]), np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        y[k] = state[0] + noise[k]
        u[k] = signal[k] - GAIN * y[k]
        late = [u[k - lag - 1 + tap] if k - lag - 1 + tap >= 0 else 0.0 for tap in range(2)]
        state = step.transition @ state + taps[0] * late[0] + taps[1] * late[1] + jolts[k]
    return TimeData(name=f"seed {seed}", inputs=u[None], outputs=y[None], sample_rate_hz=RATE_HZ, before=np.zeros(1))


class Errors(NamedTuple):
    """Errors of one fit, and its standard deviations, in the order of the truth."""

    error: FloatArray
    std: FloatArray


def by_prediction_error(record: TimeData) -> Errors:
    structure, parameters = vehicle()
    start = parameters.with_values({"L_p": 1.0, "L_roll": 30.0, "tau_roll": 0.02})
    problem = InnovationsProblem(structure=structure, parameters=start, records=(record,), hold="zero")
    found = fit_prediction_error(problem)
    values = found.parameters.values
    return Errors(
        np.array([values[name] - TRUTH[name] for name in TRUTH]), np.array([found.std[name] for name in TRUTH])
    )


def by_output_error(record: TimeData) -> Errors:
    structure, parameters = vehicle()
    problem = TimeProblem(
        structure=structure,
        parameters=parameters.with_values(TRUTH),
        records=record.pieces(1.0),
        hold="zero",
    )
    found = fit_output_error(problem)
    J = found.solution.jacobian
    std = dict(zip(problem.parameters.free, np.sqrt(np.diag(np.linalg.inv(J.T @ J))), strict=True))
    values = found.parameters.values
    return Errors(np.array([values[name] - TRUTH[name] for name in TRUTH]), np.array([std[name] for name in TRUTH]))


@pytest.mark.parametrize("seed", range(2))
def test_an_unstable_vehicle_is_found_under_feedback(seed: int) -> None:
    found = by_prediction_error(flown(seed))
    # Three parameters of two flights: the largest of six normal numbers exceeds 4 in one of 2 600 cases.
    assert (np.abs(found.error) < 4.0 * found.std).all()
    assert found.std[1] < 0.02 * TRUTH["L_roll"]


def test_output_error_is_biased_where_prediction_error_is_not() -> None:
    # The controller answers the gusts, and output error takes the answer for the cause.
    record = flown(2)
    predicted, simulated = by_prediction_error(record), by_output_error(record)
    assert (np.abs(predicted.error) < 4.0 * predicted.std).all()
    assert (np.abs(simulated.error) > 4.0 * predicted.std).any()
    assert np.abs(simulated.error / simulated.std).max() > 10.0


def alone_by_the_noise_of_all(seeds: range) -> FloatArray:
    """Errors of each flight over its standard deviations, shape ``(flights, 3)``."""
    structure, parameters = vehicle()
    start = parameters.with_values({"L_p": 1.0, "L_roll": 30.0, "tau_roll": 0.02})
    flights = tuple(flown(seed) for seed in seeds)
    together = InnovationsProblem(structure=structure, parameters=start, records=flights, hold="zero")
    theta = fit_prediction_error(together).solution.theta
    scaled = []
    for flight in flights:
        found = fit_with_noise(replace(together, records=(flight,)), theta)
        assert found.solution.theta[len(TRUTH) :].tolist() == theta[len(TRUTH) :].tolist()
        scaled.append([(found.parameters.values[name] - TRUTH[name]) / found.std[name] for name in TRUTH])
    return np.array(scaled)


def test_flights_alone_find_the_truth_by_the_noise_of_all() -> None:
    assert (np.abs(alone_by_the_noise_of_all(range(20, 23))) < 4.0).all()


@pytest.mark.slow
def test_intervals_of_flights_alone_cover_the_truth() -> None:
    scaled = np.concatenate([alone_by_the_noise_of_all(range(seed, seed + 4)) for seed in range(1000, 1200, 4)])
    covered = np.mean(np.abs(scaled) < 1.96, axis=0)
    print(dict(zip(TRUTH, np.stack([covered, scaled.mean(axis=0), scaled.std(axis=0)], axis=1).tolist(), strict=True)))
    # 200 flights: 0.95 within three standard deviations of its own.
    assert (covered >= 0.9).all(), covered
    assert (covered <= 0.995).all(), covered


@pytest.mark.slow
def test_intervals_of_95_percent_cover_the_truth() -> None:
    found = [by_prediction_error(flown(seed)) for seed in range(100, 500)]
    scaled = np.array([one.error / one.std for one in found])
    covered = np.mean(np.abs(scaled) < 1.96, axis=0)
    print(dict(zip(TRUTH, np.stack([covered, scaled.mean(axis=0), scaled.std(axis=0)], axis=1).tolist(), strict=True)))
    assert (covered >= 0.91).all(), covered
    assert (covered <= 0.985).all(), covered


def test_a_wrong_start_of_the_noise_changes_nothing() -> None:
    structure, parameters = vehicle()
    start = parameters.with_values({"L_p": 1.0, "L_roll": 30.0, "tau_roll": 0.02})
    problem = InnovationsProblem(structure=structure, parameters=start, records=(flown(7),), hold="zero")
    noise = problem.noise_model
    right = fit_prediction_error(problem)
    for factor in (0.01, 100.0):
        wrong = noise.theta(correlation_s=factor, gusts=factor, jolts=factor)
        other = fit_prediction_error(problem, starts=[problem.theta(wrong)])
        moved = (other.parameters.pack() - right.parameters.pack()) / np.array(list(right.std.values()))
        assert np.abs(moved).max() < 0.1


def test_innovations_are_white_only_with_gusts_that_have_color() -> None:
    structure, parameters = vehicle()
    start = parameters.with_values({"L_p": 1.0, "L_roll": 30.0, "tau_roll": 0.02})
    problem = InnovationsProblem(structure=structure, parameters=start, records=(flown(3),), hold="zero")
    colored, white = (fit_prediction_error(one) for one in (problem, problem.without_gusts()))
    assert colored.whiteness["p"].outside < 0.15
    assert white.whiteness["p"].outside > 2.0 * colored.whiteness["p"].outside
    assert replace(problem, noise=None).noise_model.gusts
