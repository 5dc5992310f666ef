"""Runs on workers: the same answers as without, partial answers where they end early, one thread each."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError
from rotorid.io.pool import cores, pool
from rotorid.uncertainty.resampling import LeftOut, each_run


@dataclass(frozen=True)
class Sum:
    """A sum over shared numbers and drawn ones."""

    numbers: tuple[float, ...]

    def __call__(self, rng: np.random.Generator) -> tuple[float, str | None]:
        return float(sum(self.numbers) + rng.standard_normal()), os.environ.get("OPENBLAS_NUM_THREADS")


def test_workers_give_what_one_process_gives_with_one_thread_each() -> None:
    work = Sum(tuple(np.arange(1000.0)))
    before = os.environ.get("OPENBLAS_NUM_THREADS")
    with pool(2) as workers:
        shared = each_run(workers.shared(work), runs=4, seed=3, executor=workers.executor)
    alone = each_run(work, runs=4, seed=3)
    assert [run[0] for run in shared if not isinstance(run, LeftOut)] == [
        run[0] for run in alone if not isinstance(run, LeftOut)
    ]
    assert {run[1] for run in shared} == {"1"}
    assert os.environ.get("OPENBLAS_NUM_THREADS") == before
    assert cores() >= 1


def test_without_workers_runs_follow_one_another_here() -> None:
    with pool(None) as workers:
        assert workers.executor is None
        work = Sum((1.0,))
        assert workers.shared(work) is work


class Ends:
    """A work that ends in some run by an error."""

    def __init__(self, error: BaseException, run: int) -> None:
        self.error, self.run, self.count = error, run, 0

    def __call__(self, rng: np.random.Generator) -> float:
        self.count += 1
        if self.count == self.run:
            raise self.error
        return float(rng.standard_normal())


def test_a_run_that_fails_is_named_and_the_others_stay() -> None:
    done = each_run(Ends(InsufficientDataError("no sweep"), 3), runs=5, seed=0)
    assert [isinstance(run, LeftOut) for run in done] == [False, False, True, False, False]
    assert done[2] == LeftOut("no sweep.")


def test_an_interrupt_keeps_what_is_done() -> None:
    done = each_run(Ends(KeyboardInterrupt(), 4), runs=6, seed=0)
    assert [isinstance(run, LeftOut) for run in done] == [False] * 3 + [True] * 3
    assert all(isinstance(run, LeftOut) and run.stopped for run in done[3:])
    whole = each_run(Ends(KeyboardInterrupt(), 0), runs=6, seed=0)
    assert done[:3] == whole[:3]


def test_an_interrupt_before_two_answers_ends_the_work() -> None:
    with pytest.raises(KeyboardInterrupt):
        each_run(Ends(KeyboardInterrupt(), 2), runs=6, seed=0)
