"""Paper 3, a real-coded genetic algorithm on motor outputs: its algorithm, its table, and what stands beside them.

The flight is simulated, since the paper's data were not published. Ranges of the search were not either: here they are
those that any small multirotor may have, a hundredfold for the thrust constant and up to two hundredfold for inertia.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rotorid.models.parameter import ParameterSet
from rotorid.search.acceleration import AccelerationProblem, hover_parameters
from rotorid.search.catalog import search
from rotorid.search.result import SearchResult
from rotorid.search.spread import spread_over_starts
from rotorid.typing import FloatArray
from rotorid.vehicles import hover_quadrotor
from rotorid.vehicles.hover_quadrotor import PUBLISHED_SPREAD, SAMPLE_RATE_HZ, TRUTH

RUNS = 100
PAPER, BUDGET = "genetic:15x50", 750
ALL_FREE = hover_parameters(m=TRUTH["m"], omega_max=TRUTH["omega_max"], T_motor=TRUTH["T_motor"])
BARS = {name: spread / mean for name, (mean, spread) in PUBLISHED_SPREAD.items()}


def posed(seed: int, parameters: ParameterSet = ALL_FREE) -> AccelerationProblem:
    """The flight with the noise of a seed; its level differs between runs, as in the paper, by up to a half."""
    rng = np.random.default_rng(seed)
    flight = hover_quadrotor.fly(rng, noise=float(rng.uniform(0.5, 1.0)))
    return AccelerationProblem(
        motors=flight.motors,
        tilt=flight.tilt,
        accelerations=flight.accelerations,
        sample_rate_hz=SAMPLE_RATE_HZ,
        layout=hover_quadrotor.layout(),
        parameters=parameters,
    )


def floor_of(problem: AccelerationProblem) -> float:
    truth = np.array([TRUTH[name] for name in problem.parameters.free])
    return float(problem.many_costs(truth[None])[0])


def run(seed: int, parameters: ParameterSet) -> SearchResult:
    return search(PAPER).run(posed(seed, parameters), budget=BUDGET, seed=seed)


def relative_spread(rows: FloatArray, names: tuple[str, ...]) -> dict[str, float]:
    spread = rows.std(axis=0, ddof=1) / rows.mean(axis=0)
    return dict(zip(names, spread.tolist(), strict=True))


def within(lower: float, upper: float) -> ParameterSet:
    """All free, in a box of shares of the truth: what a paper may know beforehand that a user does not."""
    return ParameterSet(
        replace(p, value=TRUTH[p.name], lower=lower * TRUTH[p.name], upper=upper * TRUTH[p.name])
        if p.status == "free"
        else p
        for p in ALL_FREE
    )


@pytest.mark.slow
@pytest.mark.parametrize("given", ["kappa", "I_zz"])
def test_a_hundred_runs_scatter_no_more_than_the_paper_s(given: str) -> None:
    # Yaw shows kappa / I_zz alone, so one of the two is given, as one measured on a bench is.
    parameters = ALL_FREE.fix(given, TRUTH[given])
    study = spread_over_starts(
        partial(run, parameters=parameters),
        names=parameters.free,
        runs=RUNS,
        seed=0,
        target=lambda seed: floor_of(posed(seed, parameters)),
    )
    found = relative_spread(np.asarray(study.after.draws), parameters.free)
    assert all(found[name] <= BARS[name] for name in parameters.free), found
    assert study.success.value == 1.0
    # The algorithm alone does not come there in ranges of decades: its mutations draw over whole sides.
    raw = relative_spread(np.asarray(study.before.draws), parameters.free)
    assert all(raw[name] > BARS[name] for name in parameters.free), raw


@pytest.mark.slow
def test_kappa_and_yaw_inertia_scatter_as_far_as_the_box_and_their_ratio_does_not() -> None:
    ends = [run(seed, ALL_FREE).best.theta for seed in range(30)]
    found = relative_spread(np.array(ends), ALL_FREE.free)
    assert found["kappa"] > 0.3
    assert found["I_zz"] > 0.3
    ratio = np.array(ends)[:, ALL_FREE.free.index("kappa")] / np.array(ends)[:, ALL_FREE.free.index("I_zz")]
    assert ratio.std(ddof=1) / ratio.mean() <= min(BARS["kappa"], BARS["I_zz"])
    assert all(found[name] <= BARS[name] for name in ("c_t", "I_xx", "I_yy"))


@pytest.mark.slow
def test_the_algorithm_alone_scatters_with_the_box_it_is_given() -> None:
    spreads = []
    for half in (0.9, 0.5, 0.3):
        box = within(1.0 - half, 1.0 + half).fix("kappa", TRUTH["kappa"])
        spreads.append(relative_spread(np.array([run(seed, box).theta for seed in range(RUNS)]), box.free))
    wide, _, narrow = spreads
    for name in ("c_t", "I_xx", "I_yy", "I_zz"):
        assert wide[name] > BARS[name]
        assert [one[name] for one in spreads] == sorted((one[name] for one in spreads), reverse=True)
    # In a box of 30 % about the truth the published spread is that of the algorithm.
    assert all(narrow[name] <= BARS[name] for name in ("c_t", "I_xx", "I_yy"))


@pytest.mark.parametrize("seed", range(3))
def test_the_default_search_comes_to_the_floor_without_a_local_search(seed: int) -> None:
    problem = posed(seed)
    found = search("evolution").run(problem, budget=5000, seed=seed)
    assert found.evaluations <= 5000
    assert found.cost <= 1.01 * floor_of(problem)


@pytest.mark.parametrize("seed", range(3))
def test_the_default_search_is_closer_than_the_paper_s_at_its_evaluations(seed: int) -> None:
    problem = posed(seed)
    default = search("evolution").run(problem, budget=BUDGET, seed=seed)
    paper = search(PAPER).run(problem, budget=BUDGET, seed=seed)
    assert paper.evaluations == BUDGET
    assert len(paper.trace) == 50
    assert default.evaluations <= BUDGET
    assert default.cost < paper.cost
    # Both end in the same local search, which the paper's does not have.
    assert paper.best.cost == pytest.approx(default.best.cost, rel=1e-6)
