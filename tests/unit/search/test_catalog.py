"""The catalogue of searches: a new one is one line in LINES, and has to keep what every search promises."""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import cache
from multiprocessing import get_context
from threading import Lock
from typing import NamedTuple

import numpy as np
import pytest
from tests.unit.search.problems import LOWEST, PROBLEMS, Valleys

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.search.catalog import search, searches
from rotorid.search.result import Progress, SearchResult
from rotorid.typing import FloatArray


class Line(NamedTuple):
    """A search with its options, a budget, and the problems whose lowest minimum it finds with it."""

    text: str
    budget: int
    finds: tuple[str, ...] = ("valleys", "late", "swinging")


LINES = [
    Line("central", 600),
    Line("cma", 600),
    Line("cma:20", 600),
    Line("evolution", 600),
    Line("evolution:20", 600),
    Line("genetic", 600),
    Line("genetic:20x30", 600),
    Line("kmeans", 600),
    Line("kmeans:5:1", 600),
    Line("random", 600),
    Line("sobol", 600),
    Line("sobol:16", 600),
]
EACH = pytest.mark.parametrize("line", LINES, ids=[line.text for line in LINES])
ON_EACH = pytest.mark.parametrize("name", PROBLEMS)
LONGEST_LOCAL_SEARCH = 201


def budget(line: Line, name: str) -> int:
    """Simulations take longer, and the oscillator is the easiest problem."""
    return line.budget // 4 if name == "swinging" else line.budget


@cache
def found(line: Line, name: str, seed: int = 1) -> SearchResult:
    return search(line.text).run(PROBLEMS[name], budget=budget(line, name), seed=seed)


def same(one: SearchResult, other: SearchResult) -> bool:
    """Whether two results agree to the last bit."""
    return (
        one.best.cost == other.best.cost
        and np.array_equal(one.best.theta, other.best.theta)
        and one.cost == other.cost
        and np.array_equal(one.theta, other.theta)
        and one.trace == other.trace
        and [(b.cost, b.theta.tolist(), b.share) for b in one.basins]
        == [(b.cost, b.theta.tolist(), b.share) for b in other.basins]
        and (one.evaluations, one.polishing, one.local_searches)
        == (other.evaluations, other.polishing, other.local_searches)
    )


def test_every_search_has_a_line() -> None:
    assert {line.text.partition(":")[0] for line in LINES} == set(searches())


@EACH
@ON_EACH
def test_the_lowest_minimum_is_found(line: Line, name: str) -> None:
    result = found(line, name)
    if name in line.finds:
        # By its cost: damping and motor lag of the rate model may change places without any effect.
        assert result.best.cost == pytest.approx(LOWEST[name].cost, rel=1e-6)
    else:
        assert result.best.cost > LOWEST[name].cost * (1.0 + 1e-6), "it finds this one too: say so in its line"


@EACH
@ON_EACH
def test_it_ends_in_a_minimum(line: Line, name: str) -> None:
    best = found(line, name).best
    assert best.outcome is Outcome.CONVERGED
    gradient, slopes = best.jacobian.T @ best.residual, np.linalg.norm(best.jacobian, axis=0)
    # The cosine between residual and each slope; the last step of the solver gains less than 1e-10 of the cost.
    assert np.all(np.abs(gradient) <= 2e-5 * slopes * np.sqrt(1e-6 + best.cost))


@EACH
@ON_EACH
def test_what_it_tells_agrees(line: Line, name: str) -> None:
    problem, result = PROBLEMS[name], found(line, name)
    assert result.search == line.text.partition(":")[0]
    assert float(problem.many_costs(result.theta[None])[0]) == pytest.approx(result.cost, rel=1e-9)
    assert float(problem.many_costs(result.best.theta[None])[0]) == pytest.approx(result.best.cost, rel=1e-6)
    assert result.best.cost <= result.cost * (1.0 + 1e-12)
    assert sum(basin.share for basin in result.basins) == pytest.approx(1.0)
    assert [basin.cost for basin in result.basins[1:]] == sorted(basin.cost for basin in result.basins[1:])
    assert result.basins[0].cost == result.best.cost <= min(b.cost for b in result.basins) * (1 + 1e-6) + 1e-6
    places = [basin.theta for basin in result.basins]
    assert all(not np.allclose(a, b, rtol=1e-5) for k, a in enumerate(places) for b in places[:k])
    assert len(places) <= result.local_searches


@EACH
@ON_EACH
def test_the_trace_falls_within_the_budget(line: Line, name: str) -> None:
    result = found(line, name)
    evaluations, best = np.array(result.trace).T
    assert np.all(np.diff(evaluations) > 0.0)
    assert np.all(np.diff(best) <= 0.0)
    assert result.evaluations <= budget(line, name)
    # What is made of local searches spends the budget on them, and finishes the last.
    assert evaluations[-1] <= budget(line, name) + LONGEST_LOCAL_SEARCH


@EACH
def test_the_seed_decides(line: Line) -> None:
    first = found(line, "late")
    assert same(first, search(line.text).run(PROBLEMS["late"], budget=line.budget, seed=1))
    other = found(line, "late", seed=2)
    assert np.array_equal(first.theta, other.theta) is (line.text == "central")


@pytest.fixture(scope="module")
def processes() -> Iterator[Executor]:
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(abs, range(4)))
        yield pool


@pytest.fixture(scope="module")
def threads() -> Iterator[Executor]:
    with ThreadPoolExecutor(3) as pool:
        yield pool


@EACH
@pytest.mark.parametrize("workers", [pytest.param("processes", marks=pytest.mark.slow), "threads"])
def test_any_number_of_workers_gives_the_same_answer(line: Line, workers: str, request: pytest.FixtureRequest) -> None:
    pool: Executor = request.getfixturevalue(workers)
    shared = search(line.text).run(PROBLEMS["late"], budget=line.budget, seed=1, executor=pool)
    assert same(shared, found(line, "late"))


@EACH
def test_progress_is_the_trace(line: Line) -> None:
    heard: list[Progress] = []
    result = search(line.text).run(Valleys(), budget=200, seed=0, progress=heard.append)
    assert tuple(heard) == result.trace
    assert len(heard) > 0


@EACH
def test_results_and_searches_pickle(line: Line) -> None:
    result = found(line, "swinging")
    again = pickle.loads(pickle.dumps(result))
    assert same(result, again)
    assert not again.theta.flags.writeable
    assert not again.basins[0].theta.flags.writeable
    method = search(line.text)
    assert pickle.loads(pickle.dumps(method)) == method


class Nowhere(Valleys):
    """A cost without a value anywhere."""

    def residuals(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual, jacobian = super().residuals(x)
        return np.nan * residual, jacobian


@EACH
def test_a_cost_without_any_value_is_said(line: Line) -> None:
    with pytest.raises(InsufficientDataError, match="nothing here"):
        search(line.text).run(Nowhere(name="nothing here"), budget=100, seed=0)


@EACH
def test_no_budget_is_refused(line: Line) -> None:
    with pytest.raises(UsageError, match="budget of 0 evaluations"):
        search(line.text).run(Valleys(), budget=0, seed=0)


@pytest.mark.parametrize("name", [line.text for line in LINES if ":" not in line.text])
def test_other_minima_are_kept(name: str) -> None:
    """Of the four valleys every search keeps more than the one it takes."""
    result = search(name).run(Valleys(), budget=600, seed=0)
    signs = {tuple(np.sign(basin.theta)) for basin in result.basins}
    assert len(signs) >= 2
    assert [minimum.cost for minimum in result.best.others] == [basin.cost for basin in result.basins[1:]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("genetics", "did you mean genetic"),
        ("evolutoin", "did you mean evolution"),
        ("sobol:many", "sobol:64"),
        ("sobol:0", "sobol:64"),
        ("random:-3", "random:64"),
        ("central:3", "no options"),
        ("genetic:15x", "genetic:15x50"),
        ("genetic:1x5", "two or more"),
        ("kmeans:3:", "kmeans:5:100"),
        ("evolution:2", "5 or more"),
        ("cma:2", "four or more"),
        ("", "central, cma, evolution"),
    ],
)
def test_wrong_searches_are_refused(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        search(text)


class Counted(Valleys):
    """A cost that takes its time, as a simulation does, and counts how many local searches run at once."""

    def __init__(self) -> None:
        super().__init__()
        self.running, self.most = 0, 0
        self.lock = Lock()

    def polish(self, start: FloatArray) -> Solution:
        with self.lock:
            self.running += 1
            self.most = max(self.most, self.running)
        time.sleep(0.01)
        solution = super().polish(start)
        with self.lock:
            self.running -= 1
        return solution


def test_workers_share_local_searches(threads: Executor) -> None:
    def at_once(executor: Executor | None) -> int:
        counted = Counted()
        search("sobol:24").run(counted, budget=10_000, seed=0, executor=executor)
        return counted.most

    assert at_once(None) == 1
    assert at_once(threads) > 1
