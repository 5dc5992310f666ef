"""Twins of the bootstrap: flights of a known model, and how often intervals drawn from one flight hold the truth."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.time.output_error import OutputErrorFit, TimeData, TimeProblem, fit_output_error
from rotorid.models.library import rate_model, response_model
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import BoolArray, FloatArray
from rotorid.uncertainty.bootstrapping import bootstrap, bootstrap_records
from rotorid.uncertainty.resampling import SpreadTable, resample_records

OMEGA = np.geomspace(1.5, 50.0, 40)
RATE = rate_model("rate.roll")
RATE_TRUTH = {"L_roll": 60.0, "L_p": -3.0, "T_motor": 0.05, "tau_roll": 0.012}
LEVEL = 0.03

YAW = response_model("response.first_order", [("r_setpoint", "r")])
YAW_RATE_HZ = 25.0
MEMORY = 0.7


def rate_problem(seed: int) -> FrequencyProblem:
    """Measured responses of a roll rate; neighbors share two thirds of their error."""
    exact = RATE.response(RATE_TRUTH, OMEGA)
    distance = np.subtract.outer(np.arange(OMEGA.size), np.arange(OMEGA.size))
    relative = 2.0 * LEVEL**2 * (2.0 / 3.0) ** np.abs(distance) * np.exp(0.4j * distance)
    rng = np.random.default_rng(seed)
    white = (rng.standard_normal(OMEGA.size) + 1j * rng.standard_normal(OMEGA.size)) / np.sqrt(2.0)
    curve = exact[0, 0]
    data = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=exact * (1.0 + np.linalg.cholesky(relative) @ white),
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, LEVEL),
        covariance=(curve[:, None] * relative * curve.conj())[None, None],
        inputs=RATE.inputs,
        outputs=RATE.outputs,
        estimate="direct",
    )
    used = np.ones(exact.shape, dtype=np.bool_)
    return FrequencyProblem(structure=RATE, parameters=RATE.parameters, data=data, used=used)


def rate_table(seed: int, runs: int) -> SpreadTable:
    problem = rate_problem(seed)
    solution = fit_frequency(problem, starts=[np.array([50.0, -2.0, 0.04, 0.02])])
    return bootstrap(problem, solution, runs=runs, seed=seed)


def yaw_fit(seed: int, *, samples: int = 500) -> OutputErrorFit:
    """A yaw rate under random binary commands and colored noise of a third of its size."""
    rng = np.random.default_rng(seed)
    system = YAW.matrices(YAW.parameters.values)
    u = np.sign(np.repeat(rng.standard_normal((1, -(-samples // 10))), 10, axis=1))[:, :samples]
    y = simulate_linear(system, u, sample_rate_hz=YAW_RATE_HZ, x0=np.zeros(1), before=u[:, 0])
    color = lfilter([np.sqrt(1.0 - MEMORY**2)], [1.0, -MEMORY], rng.standard_normal(samples + 200))[200:]
    record = TimeData(name="twin", inputs=u, outputs=y + 0.3 * y.std() * color, sample_rate_hz=YAW_RATE_HZ)
    problem = TimeProblem(structure=YAW, parameters=YAW.parameters, records=(record,))
    return fit_output_error(problem, starts=[YAW.parameters.pack()])


def covered(tables: Iterable[SpreadTable], truth: FloatArray) -> FloatArray:
    """Share of the intervals from the percentiles that hold the truth, for each parameter."""
    inside: list[BoolArray] = []
    for table in tables:
        low, _, high = table.percentiles
        inside.append((low <= truth) & (truth <= high))
    return np.mean(inside, axis=0)


def test_the_truth_lies_within_the_spread() -> None:
    tables = [rate_table(seed, 200) for seed in range(6)]
    truth = np.array([RATE_TRUTH[name] for name in tables[0].names])
    off = [table.estimate - truth for table in tables]
    distance = sum(float(e @ np.linalg.solve(table.covariance, e)) for e, table in zip(off, tables, strict=True))
    low, high = stats.chi2.ppf([0.0005, 0.9995], 6 * truth.size)  # type: ignore[misc]
    assert low < distance < high


@pytest.mark.slow
def test_intervals_of_responses_hold_the_truth_as_often_as_they_say() -> None:
    flights = 300
    truth = np.array([RATE_TRUTH[name] for name in rate_problem(0).parameters.free])
    share = covered((rate_table(seed, 200) for seed in range(flights)), truth)
    print(share)
    # Four binomial deviations below; above, the inflation, which is never below one, adds some cover.
    assert np.all(share >= 0.95 - 4.0 * np.sqrt(0.0475 / flights))
    assert np.all(share <= 0.995)


@pytest.mark.slow
def test_intervals_in_time_hold_the_truth_under_colored_noise() -> None:
    flights, truth = 150, YAW.parameters.pack()

    def table(seed: int) -> SpreadTable:
        found = yaw_fit(seed)
        return bootstrap(found.problem, found.solution, runs=100, seed=seed)

    share = covered((table(seed) for seed in range(flights)), truth)
    print(share)
    assert np.all(share >= 0.95 - 3.0 * np.sqrt(0.0475 / flights))
    assert np.all(share <= 0.995)


@pytest.mark.slow
def test_few_records_give_intervals_that_are_too_short() -> None:
    """Eight records of a normal mean: 91 % in place of 95 %, as is said where they are drawn."""
    studies, hits = 400, 0
    for study in range(studies):
        values = np.random.default_rng(study).standard_normal(8)
        table = resample_records(
            lambda drawn, values=values: np.array([values[drawn].mean()]),  # type: ignore[misc]
            8,
            names=["mean"],
            estimate=values.mean()[None],
            runs=200,
            seed=study,
        )
        low, _, high = table.percentiles[:, 0]
        hits += low <= 0.0 <= high
    assert hits / studies == pytest.approx(0.91, abs=4.0 * np.sqrt(0.91 * 0.09 / studies))


@pytest.mark.slow
def test_workers_in_other_processes_draw_the_same() -> None:
    problem, found = rate_problem(0), yaw_fit(0)
    pieces = found.problem.records[0].pieces(4.0)
    cut = fit_output_error(TimeProblem(structure=YAW, parameters=YAW.parameters, records=pieces))
    solution = fit_frequency(problem, starts=[np.array([50.0, -2.0, 0.04, 0.02])])
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        shared = (
            bootstrap(problem, solution, runs=300, seed=1, executor=executor),
            bootstrap(found.problem, found.solution, runs=12, seed=1, executor=executor),
            bootstrap_records(cut.problem, cut.solution, runs=12, seed=1, executor=executor),
        )
    alone = (
        bootstrap(problem, solution, runs=300, seed=1),
        bootstrap(found.problem, found.solution, runs=12, seed=1),
        bootstrap_records(cut.problem, cut.solution, runs=12, seed=1),
    )
    for one, other in zip(shared, alone, strict=True):
        np.testing.assert_array_equal(one.draws, other.draws)
