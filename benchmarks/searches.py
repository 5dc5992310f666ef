"""How often each global search finds the lowest minimum, against evaluations and time, on easy and hard problems.

Twenty seeds of every problem of :mod:`benchmarks.search_problems`, each with its own noise; the seed of the data is
that of the search. A search succeeds if its cost is within 1 % of the lowest that any search of the study, or a local
search from the truth, found with these data. Evaluations are costs plus residuals with Jacobians, each counted once,
local searches at the end included; what a residual with its Jacobian takes, in costs, is measured for each problem.
Time is process time on one core. ``own starts`` are what the package does by itself:
:func:`rotorid.fitting.frequency.fit.fit_frequency`, the starts of an output-error fit, and the middle of the ranges for
accelerations.

Run ``python -m benchmarks.searches``: tables only, some ten minutes. ``--runs FILE`` keeps every run as JSON, and takes
them from there if the file is there already; ``--pictures FOLDER`` draws.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.search_problems import PROBLEMS, Posed
from rotorid.errors import UsageError
from rotorid.search import Progress, Share, search, searches, wilson

SEEDS = 20
BUDGETS = (30, 100, 300, 1000)
MOST = {"swing": 300}
"""Simulations take a millisecond each."""
MOST_FROM_STARTS = {"accelerations": 300}
"""Its local search is a formula that every start leads to one minimum by."""

FROM_STARTS = ("central", "random", "sobol")
"""A smaller budget ends these earlier and changes nothing else: one run tells of all budgets."""
POPULATIONS = ("cma", "evolution", "genetic")
OWN = "own starts"
CLOSE = 1.01


class Run(NamedTuple):
    """One search with one budget on the data of one seed.

    Parameters
    ----------
    problem, search, seed, budget
        What was done; own starts have a budget of zero.
    before, cost
        Lowest costs before and after local searches.
    spent
        Costs and residuals with Jacobians.
    seconds
        Process time.
    """

    problem: str
    search: str
    seed: int
    budget: int
    before: float
    cost: float
    spent: int
    seconds: float


class Point(NamedTuple):
    """All seeds of a search at a budget: medians, and the shares that succeeded before and after local searches."""

    budget: int
    spent: float
    seconds: float
    before: Share
    after: Share

    @property
    def milliseconds(self) -> float:
        """Median process time."""
        return 1e3 * self.seconds


class Floor(NamedTuple):
    """Of one seed: cost at the truth, at the end of a local search from there, and the lowest of the study."""

    truth: float
    from_truth: float
    lowest: float


def runs_of(problem: str, seed: int) -> Iterator[Run]:
    """Every search on the data of one seed."""
    posed = PROBLEMS[problem].pose(seed)
    began = time.process_time()
    cost, spent = posed.own()
    yield Run(problem, OWN, seed, 0, cost, cost, spent, time.process_time() - began)
    truth = float(posed.problem.many_costs(posed.truth[None])[0])
    yield Run(problem, "truth", seed, 0, truth, posed.problem.polish(posed.truth).cost, 0, 0.0)
    budgets = [budget for budget in BUDGETS if budget <= MOST.get(problem, BUDGETS[-1])]
    for name in searches():
        if name in POPULATIONS:
            yield from _each(problem, posed, name, seed, budgets)
            continue
        affordable = [budget for budget in budgets if budget <= MOST_FROM_STARTS.get(problem, budget)]
        if name in FROM_STARTS:
            yield from _nested(problem, posed, name, seed, affordable)
        else:
            yield from _each(problem, posed, name, seed, affordable)


def _each(problem: str, posed: Posed, name: str, seed: int, budgets: Sequence[int]) -> Iterator[Run]:
    for budget in budgets:
        began = time.process_time()
        found = search(name).run(posed.problem, budget=budget, seed=seed)
        seconds, spent = time.process_time() - began, found.evaluations + found.polishing
        yield Run(problem, name, seed, budget, found.cost, found.best.cost, spent, seconds)


def _nested(problem: str, posed: Posed, name: str, seed: int, budgets: Sequence[int]) -> Iterator[Run]:
    heard: list[tuple[Progress, float]] = []
    began = time.process_time()

    def progress(entry: Progress) -> None:
        heard.append((entry, time.process_time() - began))

    search(name).run(posed.problem, budget=budgets[-1], seed=seed, progress=progress)
    for budget in budgets:
        ended = next((one for one in heard if one[0].evaluations >= budget), heard[-1])
        (spent, best), seconds = ended
        # Its local searches are the search: there is nothing before them.
        yield Run(problem, name, seed, budget, best, best, spent, seconds)


def study(problems: Iterable[str], seeds: int = SEEDS) -> list[Run]:
    """Everything; progress goes to the terminal."""
    runs: list[Run] = []
    for problem in problems:
        began = time.process_time()
        # The first call of everything compiles and imports.
        for name in searches():
            search(name).run(PROBLEMS[problem].pose(0).problem, budget=30, seed=0)
        for seed in range(seeds):
            runs += runs_of(problem, seed)
        print(f"# {problem}: {time.process_time() - began:.0f} s", flush=True)
    return runs


def floors(runs: Sequence[Run], problem: str) -> dict[int, Floor]:
    """By seed."""
    of_problem = [run for run in runs if run.problem == problem]
    truths = {run.seed: run for run in of_problem if run.search == "truth"}
    lowest = {seed: min(run.cost for run in of_problem if run.seed == seed) for seed in truths}
    return {seed: Floor(run.before, run.cost, lowest[seed]) for seed, run in truths.items()}


def points(runs: Sequence[Run], problem: str, name: str) -> list[Point]:
    """A search on a problem, by budgets."""
    lowest = {seed: floor.lowest for seed, floor in floors(runs, problem).items()}
    mine = [run for run in runs if run.problem == problem and run.search == name]
    found = []
    for budget in sorted({run.budget for run in mine}):
        some = [run for run in mine if run.budget == budget]
        limits = [CLOSE * lowest[run.seed] for run in some]
        before = sum(run.before <= limit for run, limit in zip(some, limits, strict=True))
        after = sum(run.cost <= limit for run, limit in zip(some, limits, strict=True))
        spent = float(np.median([run.spent for run in some]))
        seconds = float(np.median([run.seconds for run in some]))
        found.append(Point(budget, spent, seconds, wilson(before, len(some)), wilson(after, len(some))))
    return found


def jacobian_in_costs(problem: str) -> tuple[float, float]:
    """Microseconds of one cost of fifteen at once, and how many of these a residual with its Jacobian takes."""
    posed = PROBLEMS[problem].pose(0)
    thetas = posed.problem.search_box.at(np.random.default_rng(0).random((15, posed.truth.size)))
    posed.problem.many_costs(thetas)
    began = time.process_time()
    repeats = 10
    for _ in range(repeats):
        posed.problem.many_costs(thetas)
    cost_s = (time.process_time() - began) / (repeats * len(thetas))
    began = time.process_time()
    residuals = sum(posed.problem.polish(theta).evaluations for theta in thetas)
    return 1e6 * cost_s, (time.process_time() - began) / residuals / cost_s


def table(runs: Sequence[Run], problem: str) -> Iterator[str]:
    """Of one problem: success after local searches, and before them, at what was spent."""
    all_floors = floors(runs, problem).values()
    elsewhere = sum(floor.from_truth > CLOSE * floor.lowest for floor in all_floors)
    cost_us, ratio = jacobian_in_costs(problem)
    yield f"{problem}: {PROBLEMS[problem].title}; {len(all_floors)} seeds"
    yield f"  a cost takes {cost_us:.0f} µs, a residual with its Jacobian {ratio:.1f} times that"
    yield f"  lowest minimum outside the basin of the truth: {elsewhere} seeds"
    for name in (OWN, *searches()):
        cells = [
            f"{one.after.value:4.2f} ({one.before.value:4.2f}) {one.spent:5.0f} {one.milliseconds:6.0f} ms"
            for one in points(runs, problem, name)
        ]
        yield f"  {name:10} " + " | ".join(cells)


def loaded(file: Path) -> list[Run]:
    """Runs that were kept."""
    return [Run(*row) for row in json.loads(file.read_text(encoding="utf-8"))]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="Success of global searches against evaluations and time.")
    parser.add_argument("problems", nargs="*", metavar="PROBLEM", help=f"of {', '.join(PROBLEMS)}; all by default")
    parser.add_argument("--runs", type=Path, help="keep the runs here, or take them from here")
    parser.add_argument("--pictures", type=Path, help="draw into this folder")
    given = parser.parse_args()
    problems: list[str] = given.problems or list(PROBLEMS)
    if unknown := [name for name in problems if name not in PROBLEMS]:
        raise UsageError(f"problems {', '.join(unknown)} came", needed=f"of {', '.join(PROBLEMS)}")
    kept = given.runs is not None and given.runs.is_file()
    runs = loaded(given.runs) if kept else study(problems)
    if given.runs is not None and not kept:
        given.runs.write_text(json.dumps(runs), encoding="utf-8")
    print("success after local searches (before them), costs and residuals, time; by budgets", BUDGETS)
    for problem in problems:
        print("\n".join(table(runs, problem)), flush=True)
    if given.pictures is not None:
        from benchmarks.search_pictures import draw

        draw(runs, problems, given.pictures)


if __name__ == "__main__":
    main()
