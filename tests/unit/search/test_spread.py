"""Spread of a search over its seeds: tables before and after the local search, and how often it succeeds."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from tests.unit.fitting.known_models import posed

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.fitting.problem import StartBox
from rotorid.models.library import rate_model
from rotorid.search.catalog import search
from rotorid.search.result import Progress, SearchResult
from rotorid.search.spread import Repeated, spread_over_starts, wilson
from rotorid.typing import FloatArray


def ended(theta: FloatArray, cost: float) -> Solution:
    return Solution(
        theta=theta,
        cost=cost,
        outcome=Outcome.CONVERGED,
        residual=np.array([np.sqrt(cost)]),
        jacobian=np.ones((1, theta.size)),
        evaluations=3,
        trace=(cost,),
        at_bound=(False,) * theta.size,
    )


def two_valleys(seed: int) -> SearchResult:
    """Ends near 1 with a cost of 2, or with a chance of 0.3 near 5 with one of 3; the local search takes it there."""
    rng = np.random.default_rng(seed)
    center, cost = (5.0, 3.0) if rng.random() < 0.3 else (1.0, 2.0)
    off = 0.1 * rng.standard_normal()
    return SearchResult(
        search="test",
        seed=seed,
        best=ended(np.array([center]), cost),
        theta=np.array([center + off]),
        cost=cost + off**2,
        basins=(),
        trace=(Progress(10, 100.0), Progress(50, cost + off**2)),
        evaluations=50,
        polishing=3,
        local_searches=1,
    )


RUNS = 200


def test_a_search_succeeds_as_often_as_it_finds_the_lower_valley() -> None:
    spread = spread_over_starts(two_valleys, names=["a"], units=["s"], runs=RUNS, seed=1)
    share = spread.success
    # Binomial with 0.7: four deviations.
    assert share.value == pytest.approx(0.7, abs=4.0 * np.sqrt(0.21 / RUNS))
    assert share.low < share.value < share.high
    # Without the local search a run must lie within 1 % of a cost of 2: off by less than 0.141, or 1.41 deviations.
    assert spread.success_before.value == pytest.approx(0.7 * 0.8427, abs=4.0 * np.sqrt(0.24 / RUNS))
    assert spread.after.estimate[0] == 1.0
    assert set(spread.after.draws[:, 0]) == {1.0, 5.0}
    assert spread.before.rows()[0].unit == "s"
    assert spread.evaluations.tolist() == [50] * RUNS
    assert len(set(spread.seeds)) == RUNS


def test_every_run_can_be_had_again_by_its_seed_and_workers_change_nothing() -> None:
    alone = spread_over_starts(two_valleys, names=["a"], runs=30, seed=9)
    with ThreadPoolExecutor(2) as executor:
        shared = spread_over_starts(two_valleys, names=["a"], runs=30, seed=9, executor=executor)
    np.testing.assert_array_equal(alone.before.draws, shared.before.draws)
    assert alone.seeds == shared.seeds
    assert two_valleys(alone.seeds[7]).theta[0] == alone.before.draws[7, 0]


def own_cost(seed: int) -> float:
    return two_valleys(seed).best.cost


def test_with_data_of_its_own_each_run_has_its_own_target() -> None:
    spread = spread_over_starts(two_valleys, names=["a"], runs=40, seed=2, target=own_cost)
    assert spread.success.value == 1.0
    assert spread_over_starts(two_valleys, names=["a"], runs=40, seed=2, target=1.0).success.value == 0.0
    assert spread_over_starts(two_valleys, names=["a"], runs=40, seed=2, tolerance=0.5).success.value == 1.0


def exact(seed: int) -> SearchResult:
    """Data without noise: a local search ends at rounding, more or less of it, and the search itself does not."""
    small = 1e-20 * (1 + seed % 7)
    found = two_valleys(seed)
    return SearchResult(
        search="test",
        seed=seed,
        best=ended(np.array([1.0]), small),
        theta=found.theta,
        cost=1e-3,
        basins=(),
        trace=found.trace,
        evaluations=50,
        polishing=3,
        local_searches=1,
    )


def test_rounding_is_no_failure() -> None:
    spread = spread_over_starts(exact, names=["a"], runs=20, seed=0)
    assert spread.success.value == 1.0
    assert spread.success_before.value == 0.0


def sometimes(seed: int) -> SearchResult:
    if seed % 2:
        raise InsufficientDataError("nowhere a value")
    return two_valleys(seed)


def never(seed: int) -> SearchResult:
    raise InsufficientDataError("nowhere a value")


def test_a_failed_run_is_counted_and_no_success() -> None:
    spread = spread_over_starts(sometimes, names=["a"], runs=RUNS, seed=3, tolerance=0.6)
    out = spread.after.left_out["nowhere a value."]
    assert out + len(spread.seeds) == RUNS
    assert spread.success.value == len(spread.seeds) / RUNS
    with pytest.raises(InsufficientDataError, match="nowhere a value"):
        spread_over_starts(never, names=["a"], runs=3, seed=0)


def test_wrong_use_is_refused() -> None:
    with pytest.raises(UsageError, match="tolerance"):
        spread_over_starts(two_valleys, names=["a"], runs=3, seed=0, tolerance=-0.1)
    with pytest.raises(UsageError, match="1 run;"):
        spread_over_starts(two_valleys, names=["a"], runs=1, seed=0)


def test_intervals_of_shares_stay_within_zero_and_one() -> None:
    assert wilson(0, 10).low == 0.0
    assert wilson(10, 10).high == 1.0
    none, half = wilson(0, 10), wilson(50, 100)
    assert none.high == pytest.approx(0.2775, abs=1e-4)
    assert (half.low, half.high) == pytest.approx((0.4038, 0.5962), abs=1e-4)


def test_a_search_of_the_catalog_can_be_repeated() -> None:
    """A gain, a damping and a delay without noise: the local search ends every run at the truth."""
    model = rate_model("rate.roll")
    truth = {"L_roll": 60.0, "L_p": -2.0, "T_motor": 0.05, "tau_roll": 0.012}
    parameters = model.parameters.fix("T_motor", 0.05)
    problem = posed(model, truth, np.geomspace(1.0, 20.0, 15), parameters=parameters)
    box = StartBox(
        lower=np.array([10.0, -6.0, 0.0]),
        upper=np.array([300.0, 0.0, 0.06]),
        scales=("logarithmic", "linear", "linear"),
    )
    repeated = Repeated(search("genetic"), problem.within(box), 150)
    spread = spread_over_starts(repeated, names=parameters.free, runs=6, seed=0)
    assert spread.success.value == 1.0
    np.testing.assert_allclose(spread.after.mean, [60.0, -2.0, 0.012], rtol=1e-5)
    assert np.all(spread.before.relative > spread.after.relative)
    assert np.all(spread.evaluations <= 150)
