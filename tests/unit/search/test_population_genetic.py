"""The genetic algorithm is the published one, operator by operator."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from tests.unit.search.problems import Valleys

from rotorid.errors import UsageError
from rotorid.search.population import Genetic, _roulette
from rotorid.typing import FloatArray


def test_fifteen_individuals_and_fifty_generations_are_750_evaluations() -> None:
    result = Genetic().run(Valleys(), budget=750, seed=0)
    assert result.evaluations == 750
    assert [entry.evaluations for entry in result.trace] == list(range(15, 751, 15))
    assert Genetic(generations=50).run(Valleys(), budget=5000, seed=0).evaluations == 750


def test_the_roulette_is_inverse_to_the_cost() -> None:
    costs = np.array([1.0, 2.0, 4.0, np.inf])
    drawn = _roulette(costs, 70_000, np.random.default_rng(0))
    expected = np.array([4.0, 2.0, 1.0, 0.0]) * 10_000
    # Counts of independent draws scatter by the square root of what is expected.
    assert np.all(np.abs(np.bincount(drawn, minlength=4) - expected) <= 5.0 * np.sqrt(expected))


@pytest.mark.parametrize("costs", [[0.0, 0.0, 3.0], [np.inf, np.inf, np.inf]])
def test_the_roulette_turns_for_costs_of_zero_and_without_any(costs: list[float]) -> None:
    drawn = _roulette(np.array(costs), 1000, np.random.default_rng(0))
    assert set(drawn.tolist()) == ({0, 1} if costs[0] == 0.0 else {0, 1, 2})


def test_crossover_exchanges_everything_behind_one_place() -> None:
    # Genes tell whose they were: each parent is one number all along.
    parents = np.repeat(np.arange(8.0)[:, None] / 8.0, 6, axis=1)
    offspring = Genetic(crossover=1.0, mutation=0.0)._offspring(parents, np.ones(8), np.random.default_rng(0))
    switches = np.count_nonzero(np.diff(offspring, axis=1), axis=1)
    assert switches.max() == 1
    assert np.array_equal(np.unique(offspring), np.intersect1d(np.unique(offspring), parents))
    same = Genetic(crossover=0.0, mutation=0.0)._offspring(parents, np.ones(8), np.random.default_rng(0))
    assert np.all(np.diff(same, axis=1) == 0.0)


def test_mutation_draws_one_gene_anew_within_its_side() -> None:
    parents = np.full((2000, 5), 0.5)
    offspring = Genetic(crossover=1.0, mutation=0.2)._offspring(parents, np.ones(2000), np.random.default_rng(0))
    moved = offspring != 0.5
    assert moved.sum(axis=1).max() == 1
    # A share of 0.2 of 2000 scatters by sqrt(2000 · 0.2 · 0.8) = 18.
    assert abs(moved.sum() - 400) <= 5 * 18
    drawn = offspring[moved]
    assert 0.0 <= drawn.min() < 0.1 < 0.9 < drawn.max() <= 1.0
    # Evenly: the mean of 400 draws scatters by 1 / sqrt(12 · 400) = 0.0144.
    assert abs(drawn.mean() - 0.5) <= 5 * 0.0144


class Heard(Valleys):
    """A cost that keeps what it was asked."""

    asked: ClassVar[list[FloatArray]] = []

    def many_costs(self, thetas: FloatArray) -> FloatArray:
        self.asked.append(thetas)
        return super().many_costs(thetas)


def test_the_best_is_never_lost() -> None:
    """Without crossover and mutation all but one individual die out; without an elite, chance says which lives."""
    Heard.asked.clear()
    for seed in range(5):
        result = Genetic(crossover=0.0, mutation=0.0).run(Heard(), budget=15 * 200, seed=seed)
        last = np.concatenate(Heard.asked)[-15:]
        assert np.array_equal(last, np.broadcast_to(result.theta, last.shape))
        Heard.asked.clear()


@pytest.mark.parametrize("wrong", [{"population": 1}, {"crossover": 1.5}, {"mutation": -0.1}])
def test_wrong_options_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        Genetic(**wrong)  # type: ignore[arg-type]
