"""Bootstrap of fits to responses: what it draws, what it fits, and that it agrees with bounds where these must hold."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.frequency.fit import fit_frequency, refine
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.models.library import rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.typing import FloatArray
from rotorid.uncertainty.bootstrapping import bootstrap, judge_spread
from rotorid.uncertainty.cramer_rao import bounds
from rotorid.uncertainty.resampling import SpreadTable, generator, resample, resample_records

OMEGA = np.geomspace(1.5, 50.0, 40)
STRUCTURE = rate_model("rate.roll")
TRUTH = {"L_roll": 60.0, "L_p": -3.0, "T_motor": 0.05, "tau_roll": 0.012}
RUNS = 500


def response(*, level: float = 0.02, seed: int = 0) -> FrequencyResponse:
    """A roll rate whose neighboring points share errors."""
    exact = STRUCTURE.response(TRUTH, OMEGA)
    distance = np.subtract.outer(np.arange(OMEGA.size), np.arange(OMEGA.size))
    relative = 2.0 * level**2 * (2.0 / 3.0) ** np.abs(distance) * np.exp(0.4j * distance)
    rng = np.random.default_rng(seed)
    white = (rng.standard_normal(OMEGA.size) + 1j * rng.standard_normal(OMEGA.size)) / np.sqrt(2.0)
    curve = exact[0, 0]
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=exact * (1.0 + np.linalg.cholesky(relative) @ white),
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, level),
        covariance=(curve[:, None] * relative * curve.conj())[None, None],
        inputs=STRUCTURE.inputs,
        outputs=STRUCTURE.outputs,
        estimate="direct",
    )


def posed(data: FrequencyResponse, parameters: ParameterSet = STRUCTURE.parameters) -> FrequencyProblem:
    used = np.ones(data.values.shape, dtype=np.bool_)
    return FrequencyProblem(structure=STRUCTURE, parameters=parameters, data=data, used=used)


def solved(problem: FrequencyProblem) -> Solution:
    truth = np.array([TRUTH[name] for name in problem.parameters.free])
    return fit_frequency(problem, starts=[np.clip(1.1 * truth, *problem.box)])


@pytest.mark.parametrize("weights", ["cifer", "covariance"])
def test_small_errors_give_the_stated_bounds(weights: Literal["cifer", "covariance"]) -> None:
    """Errors so small that the model is straight over them: only the number of runs makes a difference."""
    problem = posed(response(level=0.005))
    solution = solved(problem) if weights == "cifer" else refine(problem, solved(problem))
    table = bootstrap(problem, solution, runs=RUNS, seed=3, weights=weights)
    stated = bounds(problem, solution, weights=weights)
    # Four deviations of a standard deviation, and of a mean, from so many normal runs.
    np.testing.assert_allclose(table.std, stated.std, rtol=4.0 / np.sqrt(2.0 * RUNS))
    assert np.all(np.abs(table.bias) <= 4.0 * stated.std / np.sqrt(RUNS))
    scaled = table.covariance / np.outer(stated.std, stated.std)
    np.testing.assert_allclose(scaled, stated.correlation, atol=4.0 * np.sqrt(2.0 / RUNS))
    assert judge_spread(table, stated.std) == ()
    assert table.runs == RUNS
    assert table.units == tuple(problem.parameters[name].unit for name in problem.parameters.free)


def test_a_run_is_the_fit_to_the_model_with_that_error() -> None:
    problem = posed(response(level=0.1))
    solution = solved(problem)
    table = bootstrap(problem, solution, runs=5, seed=8)
    limits = bounds(problem, solution)
    assert limits.model_error is not None
    stated = limits.std
    root = np.concatenate([np.linalg.cholesky(problem.errors.covariance), limits.model_error.root], axis=1)
    model = STRUCTURE.response(problem.parameters.unpack(solution.theta).values, OMEGA)
    for run, theta in enumerate(table.draws):
        error = root @ generator(8, run).standard_normal(root.shape[1]) / problem.errors.scale
        drawn = model * np.exp(error[: OMEGA.size] + 1j * error[OMEGA.size :])
        again = posed(replace(problem.data, values=drawn))
        alone = LevenbergMarquardt().minimize(again.residuals, solution.theta, *again.box)
        # A run stops within a hundredth of a standard deviation.
        assert np.all(np.abs(theta - alone.theta) <= 0.01 * stated)


def test_the_seed_decides_and_not_the_workers() -> None:
    problem = posed(response())
    solution = solved(problem)
    told: list[tuple[int, int]] = []
    alone = bootstrap(problem, solution, runs=300, seed=1, progress=lambda done, of: told.append((done, of)))
    with ThreadPoolExecutor(2) as executor:
        shared = bootstrap(problem, solution, runs=300, seed=1, executor=executor)
    np.testing.assert_array_equal(alone.draws, shared.draws)
    longer = bootstrap(problem, solution, runs=375, seed=1)
    np.testing.assert_array_equal(longer.draws[:250], alone.draws[:250])
    assert not np.array_equal(bootstrap(problem, solution, runs=300, seed=2).draws, alone.draws)
    assert [of for _, of in told] == [300] * len(told)
    assert told[-1] == (300, 300)
    assert len(told) > 1


def test_a_bound_holds_in_every_run_and_the_disagreement_is_said() -> None:
    """The lag may not be shorter than it is: half of the runs end on the bound, and the straight line knows nothing."""
    limited = ParameterSet(
        replace(one, lower=TRUTH["T_motor"]) if one.name == "T_motor" else one
        for one in STRUCTURE.parameters.with_values(TRUTH)
    )
    problem = posed(replace(response(), values=STRUCTURE.response(TRUTH, OMEGA)), limited)
    solution = solved(problem)
    table = bootstrap(problem, solution, runs=RUNS, seed=0)
    place = table.names.index("T_motor")
    lag = table.draws[:, place]
    assert lag.min() == TRUTH["T_motor"]
    share = np.mean(lag == TRUTH["T_motor"])
    assert share == pytest.approx(0.5, abs=4.0 * np.sqrt(0.25 / RUNS) + 0.02)
    findings = judge_spread(table, bounds(problem, solution).std)
    assert "T_motor" in [one.where for one in findings if one.kind == "bootstrap_disagrees"]
    (said,) = [one for one in findings if one.where == "T_motor"]
    assert said.numbers["std"] < said.numbers["stated_std"]
    assert said.numbers["percentile_2_5"] == TRUTH["T_motor"]


def mean_of_ten(rng: np.random.Generator) -> FloatArray:
    if rng.random() < 0.2:
        raise InsufficientDataError("the wind was too strong")
    return np.array([rng.standard_normal(10).mean()])


def test_runs_without_an_answer_are_counted_with_their_reason() -> None:
    table = resample(mean_of_ten, names=["mean"], estimate=np.zeros(1), runs=200, seed=5)
    assert dict(table.left_out) == {"the wind was too strong.": 200 - len(table.draws)}
    assert table.runs == 200
    # Binomial: 40 runs of 200, give or take 4 times 5.7.
    assert 17 <= table.left_out["the wind was too strong."] <= 63
    (finding,) = judge_spread(table, np.array([np.sqrt(0.1)]))
    assert finding.kind == "bootstrap_incomplete"
    assert "too strong" in finding.message


def never(rng: np.random.Generator) -> FloatArray:
    raise InsufficientDataError("no answer")


def test_a_study_without_answers_or_runs_is_refused() -> None:
    with pytest.raises(InsufficientDataError, match=r"0 of 20 runs converged \(20 times: no answer"):
        resample(never, names=["a"], estimate=np.zeros(1), runs=20, seed=0)
    with pytest.raises(UsageError, match="1 run;"):
        resample(mean_of_ten, names=["a"], estimate=np.zeros(1), runs=1, seed=0)
    with pytest.raises(UsageError, match="2 names"):
        SpreadTable(names=("a", "b"), estimate=np.zeros(1), draws=np.zeros((3, 1)), seed=0)


def test_records_drawn_anew_have_the_spread_of_a_mean() -> None:
    """Six records: the variance of their mean without a bias, as a sum over records has it."""
    values = np.random.default_rng(2).standard_normal(6)
    table = resample_records(
        lambda drawn: np.array([values[drawn].mean()]),
        6,
        names=["mean"],
        estimate=values.mean()[None],
        runs=4000,
        seed=1,
    )
    expected = values.std(ddof=1) / np.sqrt(6)
    assert table.std[0] == pytest.approx(expected, abs=4.0 * table.std_error[0])


@pytest.mark.parametrize("count", [1, 4])
def test_too_few_records_are_refused_with_what_to_do(count: int) -> None:
    with pytest.raises(UsageError, match=r"cut records into pieces"):
        resample_records(lambda _: np.zeros(1), count, names=["a"], estimate=np.zeros(1), runs=10, seed=0)


def test_a_table_keeps_its_numbers() -> None:
    draws = np.random.default_rng(1).standard_normal((400, 2)) * [1.0, 0.1] + [10.0, 0.0]
    table = SpreadTable(names=("a", "b"), units=("1/s", "s"), estimate=np.array([10.0, 0.0]), draws=draws, seed=4)
    row = table.rows()[0]
    assert (row.name, row.unit, row.estimate) == ("a", "1/s", 10.0)
    assert row.relative_percent == pytest.approx(100.0 * table.std[0] / abs(table.mean[0]))
    assert row.low < row.median < row.high
    # A standard deviation of normal runs is known to one in the root of twice their number; kurtosis itself scatters.
    np.testing.assert_allclose(table.std_error / table.std, 1.0 / np.sqrt(2.0 * 400), rtol=0.25)
    centered = SpreadTable(names=("a",), estimate=np.zeros(1), draws=np.array([[-1.0], [1.0]]), seed=0)
    assert centered.relative[0] == np.inf
    again = pickle.loads(pickle.dumps(table))
    np.testing.assert_array_equal(again.draws, table.draws)
    assert not again.draws.flags.writeable


def drawn(runs: int, seed: int, parameters: int) -> SpreadTable:
    draws = np.random.default_rng([runs, seed]).standard_normal((runs, parameters))
    names = tuple(f"p{number}" for number in range(parameters))
    return SpreadTable(names=names, estimate=np.zeros(parameters), draws=draws, seed=seed)


@pytest.mark.parametrize("runs", [2, 5, 10, 30, 100])
def test_few_runs_seldom_contradict_bounds_that_hold(runs: int) -> None:
    parameters, tables = 100, 60
    found = [judge_spread(drawn(runs, seed, parameters), np.ones(parameters)) for seed in range(tables)]
    # Beyond three standard errors lies 0.27 % of a mean, and of a standard deviation: four deviations of their number.
    expected = 2 * 0.0027 * parameters * tables
    assert sum(map(len, found)) <= expected + 4.0 * np.sqrt(expected)


@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_a_spread_of_twice_or_half_shows_and_the_narrower_is_never_advised(stated: float) -> None:
    parameters, tables = 100, 10
    found = [one for seed in range(tables) for one in judge_spread(drawn(30, seed, parameters), np.full(100, stated))]
    # A ratio of two against 3 / sqrt(2 * 29) = 0.39 of the larger: it takes less than 0.11 of it to hide, once in ten.
    assert len(found) > 0.7 * parameters * tables
    for one in found:
        assert ("Use the interval" in one.message) == (one.numbers["std"] > one.numbers["stated_std"])


def test_a_stated_deviation_without_limit_is_no_contradiction() -> None:
    assert judge_spread(drawn(30, 0, 2), np.array([np.inf, 1.0])) == ()
