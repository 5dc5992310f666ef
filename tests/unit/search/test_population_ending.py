"""Where a population ends, when it has settled in a wrong valley."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from tests.unit.search.problems import Valleys, anything

from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.problem import Problem, StartBox
from rotorid.models.parameter import ParameterSet
from rotorid.search import population as ending
from rotorid.search.catalog import search
from rotorid.search.result import worth_polishing
from rotorid.typing import FloatArray

SIDES = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Trap(Problem):
    """Two bowls, side by side: the wider one has most of the box and of the low costs, the steeper one the lowest."""

    name: str = "trap"
    parameters: ParameterSet = field(default_factory=lambda: anything(*(f"x{k}" for k in range(SIDES))))
    region: StartBox | None = field(
        default_factory=lambda: StartBox(lower=np.zeros(SIDES), upper=np.ones(SIDES), scales=("linear",) * SIDES)
    )
    steep: float = 1.3

    def residuals(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        slope, foot, left = (self.steep, 0.8, 0.0) if x[0] > 0.7 else (1.0, 0.4, 0.3)
        return np.append(slope * (x - foot), left), np.vstack([slope * np.eye(SIDES), np.zeros(SIDES)])

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        right = thetas[:, :1] > 0.7
        moved = np.where(right, self.steep * (thetas - 0.8), thetas - 0.4)
        return np.hstack([moved, np.where(right, 0.0, 0.3)]) ** 2

    def polish(self, start: FloatArray) -> Solution:
        return LevenbergMarquardt().minimize(self.residuals, start, np.zeros(SIDES), np.ones(SIDES))

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        return self.polish(start)


def test_a_population_that_settled_in_a_wrong_valley_may_still_find_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of all local searches begin where it looked at first."""
    found = {}
    for reserved in (0, ending.RESERVED):
        monkeypatch.setattr(ending, "RESERVED", reserved)
        runs = [search("genetic").run(Trap(), budget=450, seed=seed) for seed in range(20)]
        assert max(run.local_searches for run in runs) <= ending.POLISHED
        settled = [run for run in runs if run.theta[0] <= 0.7]
        assert len(settled) >= 10
        found[reserved] = sum(run.best.cost < 1e-9 for run in settled)
    # Some places of a settled population lie beyond the wall, so that a few succeed without.
    assert found[ending.RESERVED] > 1.5 * found[0]


def test_places_of_the_first_vectors_are_kept_whatever_was_tried_later() -> None:
    first = np.array([[0.05, 0.5], [0.95, 0.5], [0.95, 0.05]])
    # A settled population fills its valley with more places than are looked at.
    settled = np.stack(np.meshgrid(np.linspace(0.0, 0.8, 6), np.linspace(0.0, 1.0, 7)), axis=-1).reshape(-1, 2)
    shares = np.concatenate([first, settled])
    costs = np.concatenate([[9.0, 5.0, 7.0], np.linspace(0.1, 1.0, len(settled))])
    assert set(worth_polishing(shares, costs, count=4)).isdisjoint({0, 1, 2})
    kept = worth_polishing(shares, costs, count=4, early=3, reserved=2)
    assert kept[0] == 3
    assert {1, 2} <= set(kept.tolist())
    assert np.all(np.diff(costs[kept]) > 0.0)


def test_what_lies_beside_a_chosen_place_takes_no_reserved_one() -> None:
    shares = np.array([[0.2, 0.2], [0.9, 0.9], [0.22, 0.22], [0.5, 0.9], [0.9, 0.5]])
    costs = np.array([2.0, 5.0, 1.0, 3.0, 4.0])
    assert worth_polishing(shares, costs, count=3, early=2, reserved=2).tolist() == [2, 3, 1]


def test_while_all_is_early_nothing_is_reserved() -> None:
    shares = np.random.default_rng(0).random((ending.EARLY, 2))
    costs = Valleys().many_costs(5.0 * shares - 2.5)
    plain = worth_polishing(shares, costs, count=ending.POLISHED)
    reserved = worth_polishing(shares, costs, count=ending.POLISHED, early=ending.EARLY, reserved=ending.RESERVED)
    assert reserved.tolist() == plain.tolist()
