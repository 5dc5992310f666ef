"""How much faster global searches are than those of peers, on the same cost in one run, and how far both come.

The cost is the sum of absolute errors of four accelerations over 6 000 samples, five parameters, of a flight around
hover whose truth is known. First the genetic algorithm of the literature, 100 individuals and 50 generations, with
roulette, single-point crossover, uniform mutation and an elite, against pygad and DEAP with the same operators: a
fitness of one individual in NumPy, the equations as they are printed. One gene is mutated of every offspring, as in
ours. pygad and DEAP run again with one offspring in five mutated, of which many are then copies of their parents: pygad
remembers their fitness and computes only half of them, DEAP is given them all. Ratios are those of whole runs, and
beside them stands the ratio for each evaluation. Then the default search at 5 000 evaluations against the evolution
strategy of pymoo, which is given whole populations at once, with all that can be computed beforehand.

The floor is the cost at the truth. All search the same box with the same scales, and motors are settled beforehand for
all. Our cost sorts the samples of each acceleration once, after which a sum of absolute errors is looked up by its
gain; the sorting is part of the first run, which does not count, as are the sums that the peers' costs prepare. Our
searches are timed with the local searches that end them, and their best is the one before these. Peers that are not
installed are left out. Run ``python -m benchmarks.genetic``. Process time is compared, so that a busy machine does not
decide.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import random
import time
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rotorid.search import AccelerationProblem, Genetic, SearchResult, hover_parameters, search
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles import hover_quadrotor

POPULATION, GENERATIONS = 100, 50
BUDGET = POPULATION * GENERATIONS
CROSSOVER, MUTATION, RARE = Genetic().crossover, Genetic().mutation, 0.2
REPEATS = 5

GENETIC_BAR, EVOLUTION_BAR = 10.0, 5.0
FLOOR_BAR = 1.01
"""The default search may lie one percent above the cost at the truth."""

MATCHES = (
    ("genetic", "pygad", GENETIC_BAR),
    ("genetic", "pygad, rare", GENETIC_BAR),
    ("genetic", "deap", GENETIC_BAR),
    ("genetic", "deap, rare", GENETIC_BAR),
    ("evolution", "pymoo", EVOLUTION_BAR),
)
"""Ours, the peer, and how many times faster ours must be."""

PEERS = ("pygad", "deap", "pymoo")
MISSING = tuple(name for name in PEERS if importlib.util.find_spec(name) is None)
SKIPPED = f"searches against {', '.join(MISSING)} skipped: not installed; pip install {' '.join(MISSING)}"


class Found(NamedTuple):
    """The best cost of a search, the process time it took, and how often it computed the cost."""

    best: float
    seconds: float
    evaluations: int = BUDGET


def problem() -> AccelerationProblem:
    """Accelerations of the flight, with the constants of its motors and its inertias in ranges of decades."""
    flight = hover_quadrotor.fly(np.random.default_rng(0))
    truth = hover_quadrotor.TRUTH
    return AccelerationProblem(
        motors=flight.motors,
        tilt=flight.tilt,
        accelerations=flight.accelerations,
        sample_rate_hz=hover_quadrotor.SAMPLE_RATE_HZ,
        layout=hover_quadrotor.layout(),
        parameters=hover_parameters(m=truth["m"], omega_max=truth["omega_max"], T_motor=truth["T_motor"]),
    )


class NumpyCost:
    """The cost as a user of a peer would write it."""

    def __init__(self, posed: AccelerationProblem) -> None:
        truth = hover_quadrotor.TRUTH
        self.box, self.evaluations = posed.search_box, 0
        kept = np.exp(-1.0 / (truth["T_motor"] * posed.sample_rate_hz))
        speed = np.empty_like(posed.motors)
        speed[:, 0] = posed.motors[:, 0]
        for k in range(speed.shape[1] - 1):
            speed[:, k + 1] = kept * speed[:, k] + (1.0 - kept) * posed.motors[:, k]
        self.squared_speed, self.tilt, self.mass = truth["omega_max"] ** 2 * speed, posed.tilt, truth["m"]
        self.measured = posed.accelerations
        moved = self.measured - self.measured.mean(axis=1, keepdims=True)
        self.size = np.abs(moved).sum(axis=1)
        gravity = np.array([[STANDARD_GRAVITY_M_S2], [0.0], [0.0], [0.0]])
        self.with_gravity, self.units = self.measured + gravity, self.moments(self.squared_speed, 1.0)
        self.units[0] *= self.tilt / self.mass

    @staticmethod
    def moments(F: FloatArray, kappa: float) -> FloatArray:
        """Thrust and moments of the four thrusts."""
        F1, F2, F3, F4 = F
        arm = hover_quadrotor.ARM_M
        return np.stack([F1 + F2 + F3 + F4, arm * (F4 - F2), arm * (F1 - F3), kappa * (F1 - F2 + F3 - F4)])

    def one(self, share: FloatArray) -> float:
        """Of one individual, shape ``(5,)``, in the unit cube: the equations one after the other."""
        self.evaluations += 1
        c_t, kappa, I_xx, I_yy, I_zz = self.box.at(np.asarray(share))
        U1, U2, U3, U4 = self.moments(c_t * self.squared_speed, kappa)
        z_ddot = U1 / self.mass * self.tilt - STANDARD_GRAVITY_M_S2
        model = np.stack([z_ddot, U2 / I_xx, U3 / I_yy, U4 / I_zz])
        return float(np.mean(np.abs(self.measured - model).sum(axis=1) / self.size))

    def many(self, shares: FloatArray) -> FloatArray:
        """Of a population, shape ``(b, 5)``: each acceleration has a gain."""
        self.evaluations += len(shares)
        c_t, kappa, I_xx, I_yy, I_zz = self.box.at(shares).T
        gains = np.stack([c_t, c_t / I_xx, c_t / I_yy, c_t * kappa / I_zz], axis=1)
        errors = np.abs(self.with_gravity - gains[:, :, None] * self.units).sum(axis=2)
        return np.asarray(np.mean(errors / self.size, axis=1))


def with_pygad(cost: NumpyCost, seed: int, mutation: float = MUTATION) -> float:
    """Best cost of pygad."""
    import pygad

    def fitness(_: object, solution: FloatArray, __: int) -> float:
        return 1.0 / cost.one(solution)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = pygad.GA(
            num_generations=GENERATIONS - 1,
            num_parents_mating=POPULATION,
            fitness_func=fitness,
            sol_per_pop=POPULATION,
            num_genes=5,
            init_range_low=0.0,
            init_range_high=1.0,
            gene_space={"low": 0.0, "high": 1.0},
            parent_selection_type="rws",
            crossover_type="single_point",
            crossover_probability=CROSSOVER,
            mutation_type="random",
            **_mutated(mutation),
            mutation_by_replacement=True,
            random_mutation_min_val=0.0,
            random_mutation_max_val=1.0,
            keep_elitism=1,
            random_seed=seed,
            suppress_warnings=True,
        )
        run.run()
        return 1.0 / float(run.best_solution()[1])


def _mutated(mutation: float) -> dict[str, float]:
    """One gene of every offspring, or each gene with a fifth of the probability: pygad knows nothing between."""
    return {"mutation_num_genes": 1} if mutation == 1.0 else {"mutation_probability": mutation / 5.0}


def with_deap(cost: NumpyCost, seed: int, mutation: float = MUTATION) -> float:
    """Best cost of DEAP."""
    from deap import base, creator, tools

    random.seed(seed)
    if not hasattr(creator, "Inverse"):
        creator.create("Inverse", base.Fitness, weights=(1.0,))
        creator.create("Chromosome", list, fitness=creator.Inverse)

    def chromosome() -> Any:
        return creator.Chromosome(random.random() for _ in range(5))

    def evaluate(individuals: list[Any]) -> None:
        for one in individuals:
            one.fitness.values = (1.0 / cost.one(np.array(one)),)

    people = [chromosome() for _ in range(POPULATION)]
    evaluate(people)
    for _ in range(GENERATIONS - 1):
        elite = tools.selBest(people, 1)[0]
        offspring = [creator.Chromosome(one) for one in tools.selRoulette(people, POPULATION)]
        for first, second in zip(offspring[::2], offspring[1::2], strict=True):
            if random.random() < CROSSOVER:
                tools.cxOnePoint(first, second)
        for one in offspring:
            if random.random() < mutation:
                one[random.randrange(5)] = random.random()
        evaluate(offspring)
        offspring[offspring.index(tools.selWorst(offspring, 1)[0])] = elite
        people = offspring
    return 1.0 / float(tools.selBest(people, 1)[0].fitness.values[0])


def with_pymoo(cost: NumpyCost, seed: int) -> float:
    """Best cost of pymoo's CMA-ES, with restarts as it has them."""
    from pymoo.algorithms.soo.nonconvex.cmaes import CMAES
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    class Posed(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=5, n_obj=1, xl=np.zeros(5), xu=np.ones(5))

        def _evaluate(self, x: FloatArray, out: dict[str, Any], *_: object, **__: object) -> None:
            out["F"] = cost.many(x)[:, None]

    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        strategy = CMAES(x0=np.full(5, 0.5), sigma=0.3, restarts=9, maxfevals=BUDGET)
        found = minimize(Posed(), strategy, ("n_evals", BUDGET), seed=seed, verbose=False)
    return float(found.F[0])


def ours(posed: AccelerationProblem, name: str, seed: int) -> SearchResult:
    """The search of that name at the budget."""
    return search(name).run(posed, budget=BUDGET, seed=seed)


def measured(action: Callable[[int], float], repeats: int) -> Found:
    """Medians over seeds, after one run that does not count: compilation and imports."""
    action(repeats)
    runs = []
    for seed in range(repeats):
        start = time.process_time()
        best = action(seed)
        runs.append(Found(best, time.process_time() - start))
    return Found(float(np.median([one.best for one in runs])), float(np.median([one.seconds for one in runs])))


def run() -> dict[str, Found]:
    """What each search found, and the floor with no time."""
    posed = problem()
    cost = NumpyCost(posed)
    truth = np.array([hover_quadrotor.TRUTH[name] for name in posed.parameters.free])
    peers: Mapping[str, Callable[[NumpyCost, int], float]] = {
        "pygad": with_pygad,
        "pygad, rare": partial(with_pygad, mutation=RARE),
        "deap": with_deap,
        "deap, rare": partial(with_deap, mutation=RARE),
        "pymoo": with_pymoo,
    }
    found = {
        "floor": Found(float(posed.many_costs(truth[None])[0]), 0.0),
        "genetic": measured(lambda seed: ours(posed, f"genetic:{POPULATION}x{GENERATIONS}", seed).cost, REPEATS),
        "evolution": measured(lambda seed: ours(posed, "evolution", seed).cost, REPEATS),
    }
    for name, peer in peers.items():
        if name.partition(",")[0] not in MISSING:
            cost.evaluations = 0
            one = measured(partial(peer, cost), REPEATS)
            found[name] = one._replace(evaluations=cost.evaluations // (REPEATS + 1))
    return found


def main() -> None:
    """Print best costs over the floor and times, then ratios beside their bars."""
    found = run()
    floor = found["floor"].best
    print(f"cost at the truth {floor:.5f}")
    for name, one in found.items():
        if name != "floor":
            print(
                f"  {name:11} {one.best:.5f}, {100.0 * (one.best / floor - 1.0):+7.2f} % of it, {one.seconds:8.3f} s,"
                f" {one.evaluations} evaluations"
            )
    for mine, peer, bar in MATCHES:
        if peer in found:
            ratio = found[peer].seconds / found[mine].seconds
            each = ratio * found[mine].evaluations / found[peer].evaluations
            verdict = "met" if ratio >= bar else "MISSED"
            print(f"  {mine} {ratio:.1f} x {peer}, {each:.1f} x for each evaluation, bar {bar:.0f}: {verdict}")
    verdict = "met" if found["evolution"].best <= FLOOR_BAR * floor else "MISSED"
    print(f"  evolution {found['evolution'].best / floor:.5f} of the floor, bar {FLOOR_BAR}: {verdict}")
    if MISSING:
        print(SKIPPED)


if __name__ == "__main__":
    main()
