"""The K-means search of the literature on the rig it was published for, against plain multi-start and the default.

Noise: roll (three unknowns) and attitude (seven), angles with noise of 1 to 20 % of their size, twelve flights each;
every search begins anywhere in a box of two decades.

Harder: the same rig where its model has more to find. Delays of which nothing is known but that they are below 3 s; a
pivot above the center of gravity, with a gain of its own for every response (eighteen unknowns); arms that bend in two
lightly damped modes. Twenty seeds each.

A search has succeeded when its cost is within 1 % of the lowest that any search found, the local search from the truth
among them. Evaluations are costs and residuals with Jacobians, and those of the local searches that end it count. Run
``python -m benchmarks.kmeans``; it takes minutes. Process time is given.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data import FlightRecord
from rotorid.fitting import FrequencyProblem, Scale, StartBox, fit_frequency, search_box, without_structural_zeros
from rotorid.flights import Flight
from rotorid.flights.measure import measure
from rotorid.models import LinearStructure, ParameterSet, StateSpace, from_toml, library_model
from rotorid.search import Progress, search
from rotorid.settings import IdentifySettings
from rotorid.typing import FloatArray
from rotorid.vehicles import rig

SEARCHES = ("kmeans:3", "kmeans:4", "kmeans:5", "sobol", "evolution")
NOISES = (0.01, 0.05, 0.10, 0.20)
FLIGHTS, SEEDS = 12, 20
SHARE_STARTS = 100
WINDOWS_S = (71.0, 60.0, 40.0)
FOUND = 1.01
DECADE = 10.0

ROLL, PITCH = ("motor_3", "motor_4"), ("motor_1", "motor_2")
ANGLES = ("phi", "theta", "psi")

PENDULOUS = """
name = "rig.pendulous"
inputs = ["motor_1", "motor_2", "motor_3", "motor_4"]
states = ["phi", "theta", "psi", "p", "q", "r"]
equations = [
    "phi' = p",
    "theta' = q",
    "psi' = r",
    "p' = -S_x*phi - D_x*p + G_3*motor_3 - G_4*motor_4",
    "q' = -S_y*theta - D_y*q + G_1*motor_1 - G_2*motor_2",
    "r' = -S_z*psi - D_z*r - N_1*motor_1 - N_2*motor_2 + N_3*motor_3 + N_4*motor_4",
]
outputs = ["phi", "theta", "psi", "p", "q", "r"]
delays = { motor_1 = "tau_1", motor_2 = "tau_2", motor_3 = "tau_3", motor_4 = "tau_4" }
"""
"""Stiffness S and friction D on each axis; a cable stands for that of yaw."""

FLEXIBLE = """
name = "rig.flexible"
inputs = ["motor_1", "motor_2", "motor_3", "motor_4"]
states = ["rigid", "theta", "psi", "p", "q", "r", "x_1", "v_1", "x_2", "v_2"]
equations = [
    "rigid' = p",
    "theta' = q",
    "psi' = r",
    "p' = G*motor_3 - G*motor_4",
    "q' = G*motor_1 - G*motor_2",
    "r' = -N*motor_1 - N*motor_2 + N*motor_3 + N*motor_4",
    "x_1' = v_1",
    "v_1' = -w_1*w_1*x_1 - 2*z_1*w_1*v_1 + c_1*motor_3 - c_1*motor_4",
    "x_2' = v_2",
    "v_2' = -w_2*w_2*x_2 - 2*z_2*w_2*v_2 + c_2*motor_3 - c_2*motor_4",
]
outputs = ["phi = rigid + x_1 + x_2", "theta", "psi", "p", "q", "r"]
delays = { motor_1 = "tau_3", motor_2 = "tau_4", motor_3 = "tau_3", motor_4 = "tau_4" }
"""
"""Rates are measured at the hub, which does not bend, and angles at an arm, which does."""

_GAIN = rig.TRUTH["L"] * rig.TRUTH["K_f"] / rig.TRUTH["J_x"]
_TORQUE = rig.ATTITUDE["K_t"] / rig.ATTITUDE["J_z"]
_DELAYS = {f"tau_{k}": rig.ATTITUDE[f"tau_{k}"] for k in range(1, 5)}
PENDULOUS_TRUTH = (
    {f"G_{k}": _GAIN for k in range(1, 5)}
    | {f"N_{k}": _TORQUE for k in range(1, 5)}
    | {"S_x": 6.0, "S_y": 7.8, "S_z": 3.0, "D_x": 0.1, "D_y": 0.1, "D_z": 0.1}
    | _DELAYS
)
FLEXIBLE_TRUTH = {
    "G": _GAIN,
    "N": _TORQUE,
    "w_1": 4.0,
    "z_1": 0.02,
    "c_1": 0.1,
    "w_2": 8.0,
    "z_2": 0.02,
    "c_2": 0.2,
    "tau_3": rig.TRUTH["tau_3"],
    "tau_4": rig.TRUTH["tau_4"],
}
_RANGES = {"S": (0.1, 50.0), "D": (0.01, 5.0), "tau": (0.01, 1.0), "w": (1.0, 12.0)}


class Case(NamedTuple):
    """What is searched, the truth of its free parameters, and how much may be spent."""

    name: str
    problem: FrequencyProblem
    truth: FloatArray
    budget: int


class Score(NamedTuple):
    """Share of runs that found the lowest minimum, after how many evaluations, how many in all, and the time."""

    found: float
    after: float
    evaluations: float
    seconds: float


class Run(NamedTuple):
    """One search: its trace, ended by what its local searches found, and the time it took."""

    trace: tuple[Progress, ...]
    seconds: float

    def score(self, target: float) -> Score:
        """Of this run alone; one that found nothing has spent all."""
        spent = self.trace[-1].evaluations
        after = next((one.evaluations for one in self.trace if one.best <= target), spent)
        return Score(float(self.trace[-1].best <= target), after, spent, self.seconds)


def posed(
    structure: LinearStructure,
    records: Sequence[FlightRecord],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    fix: Mapping[str, float],
) -> FrequencyProblem:
    """Fit a model of the rig to the composite-window responses of its flights."""
    settings = IdentifySettings(
        outputs=tuple(outputs), windows_s=WINDOWS_S, instruments=tuple(f"{name}_excitation" for name in inputs)
    )
    part = structure.select(outputs=outputs, inputs=inputs)
    flown = [Flight(record, maneuver) for record in records for maneuver in record.declared]
    measured = measure(flown, inputs=part.inputs, outputs=part.outputs, settings=settings)
    parameters = part.parameters
    for name, value in fix.items():
        parameters = parameters.fix(name, value)
    used = measured.trusted_points(measured.response, settings.least_coherence(joint=True))
    problem = FrequencyProblem(structure=part, parameters=parameters, data=measured.response, used=used)
    return without_structural_zeros(problem)[0]


def roll(seed: int, noise: float) -> Case:
    """Roll alone: thrust over inertia and two delays."""
    record = rig.fly(ROLL, np.random.default_rng(seed), noise=noise)
    problem = posed(library_model("rig.roll"), [record], inputs=ROLL, outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]})
    return _case("roll", problem, search_box(problem.parameters, wider=DECADE), rig.TRUTH, budget=120)


def attitude(seed: int, noise: float) -> Case:
    """All of the attitude from two flights: three gains and four delays."""
    problem = posed(
        library_model("rig.attitude"),
        _two_flights(seed, noise),
        inputs=rig.MOTORS,
        outputs=ANGLES,
        fix={name: rig.ATTITUDE[name] for name in ("K_f", "K_t")},
    )
    return _case("attitude", problem, search_box(problem.parameters, wider=DECADE), rig.ATTITUDE, budget=160)


def late() -> Case:
    """Roll with delays anywhere below 3 s, which turn the phase of the fastest points up to five times."""
    problem = roll(1, 0.01).problem
    free = problem.parameters
    longer = [replace(free[n], upper=5.0) if n.startswith("tau") else free[n] for n in free.names]
    box = StartBox(
        lower=np.array([0.01, 0.001, 0.001]),
        upper=np.array([1.0, 3.0, 3.0]),
        scales=("logarithmic", "linear", "linear"),
    )
    return _case("late roll", problem.with_parameters(ParameterSet(longer)), box, rig.TRUTH, budget=120)


def pendulous() -> Case:
    """Attitude of a rig whose pivot lies above its center of gravity."""
    structure = _structure(PENDULOUS, PENDULOUS_TRUTH)
    flights = _two_flights(0, 0.05, structure.matrices(PENDULOUS_TRUTH))
    problem = posed(structure, flights, inputs=rig.MOTORS, outputs=ANGLES, fix={})
    return _case("pendulous attitude", problem, _box(problem, PENDULOUS_TRUTH), PENDULOUS_TRUTH, budget=240)


def flexible(budget: int) -> Case:
    """Roll of a rig with arms that bend."""
    structure = _structure(FLEXIBLE, FLEXIBLE_TRUTH)
    record = rig.fly(ROLL, np.random.default_rng(3), system=structure.matrices(FLEXIBLE_TRUTH))
    problem = posed(structure, [record], inputs=ROLL, outputs=("phi",), fix={"N": _TORQUE})
    return _case("flexible roll", problem, _box(problem, FLEXIBLE_TRUTH), FLEXIBLE_TRUTH, budget=budget)


def scores(case: Case, names: Sequence[str] = SEARCHES, *, seeds: Sequence[int]) -> dict[str, Score]:
    """Every search from these seeds, and ``fit``, from the package's own start values, once."""
    runs = {name: [searched(case, name, seed) for seed in seeds] for name in names} | {"fit": [fitted(case)]}
    ends = [run.trace[-1].best for each in runs.values() for run in each]
    target = FOUND * min(case.problem.polish(case.truth).cost, *ends)
    return {name: mean_score([run.score(target) for run in each]) for name, each in runs.items()}


def mean_score(each: Sequence[Score]) -> Score:
    """Means over runs."""
    return Score(*np.mean(each, axis=0).tolist())


def searched(case: Case, name: str, seed: int) -> Run:
    """The search of that name."""
    began = time.process_time()
    found = search(name).run(case.problem, budget=case.budget, seed=seed)
    end = Progress(found.evaluations + found.polishing, found.best.cost)
    return Run((*found.trace, end), time.process_time() - began)


def fitted(case: Case) -> Run:
    """From the package's own start values; the costs of those that were looked through are not counted."""
    began = time.process_time()
    found = fit_frequency(case.problem)
    return Run((Progress(found.evaluations, found.cost),), time.process_time() - began)


def share(case: Case) -> float:
    """Share of the box from which a local search ends in the lowest minimum."""
    starts = search(f"sobol:{SHARE_STARTS}").run(case.problem, budget=10**6, seed=0)
    lowest = min(case.problem.polish(case.truth).cost, starts.best.cost)
    at_lowest = sum(one.share for one in starts.basins if one.cost <= FOUND * lowest)
    return float(at_lowest)


def ratio_and_delays(case: Case) -> tuple[float, FloatArray, float]:
    """Error of the first gain in percent and of the delays in milliseconds, and the average cost of a response."""
    problem = case.problem
    theta = fit_frequency(problem).theta
    names = problem.parameters.free
    late_ms = [1e3 * (theta[k] - case.truth[k]) for k, name in enumerate(names) if name.startswith("tau")]
    # Thrust is held where inertia is free and the other way round: the ratio of the two is what was found.
    power = 1.0 if names[0] == "K_f" else -1.0
    off = 100.0 * ((theta[0] / case.truth[0]) ** power - 1.0)
    mean_cost = float(np.mean(problem.costs(theta)[problem.used.any(axis=-1)]))
    return float(off), np.array(late_ms), mean_cost


def noise_study(pose: Callable[[int, float], Case], *, flights: int = FLIGHTS) -> list[str]:
    """A block of lines for every noise: what is found, then what each search took."""
    lines = []
    for noise in NOISES:
        cases = [pose(seed, noise) for seed in range(flights)]
        off, late_ms, cost = (np.array(column) for column in zip(*map(ratio_and_delays, cases), strict=True))
        lines.append(
            f"{cases[0].name}, noise {100 * noise:2.0f} %: L K_f/J {off.mean():+5.2f} ± {off.std(ddof=1):.2f} %,"
            f" delays {late_ms.mean():+5.1f} ± {late_ms.std(axis=0, ddof=1).mean():.1f} ms,"
            f" average cost {cost.mean():.1f}"
        )
        each = [scores(case, seeds=[seed]) for seed, case in enumerate(cases)]
        lines += [_line(name, mean_score([one[name] for one in each])) for name in each[0]]
    return lines


def _line(name: str, score: Score) -> str:
    return (
        f"    {name:10s} found {100 * score.found:3.0f} %, after {score.after:4.0f} evaluations,"
        f" {score.evaluations:4.0f} in all, {1e3 * score.seconds:6.1f} ms"
    )


def _case(name: str, problem: FrequencyProblem, box: StartBox, truth: Mapping[str, float], *, budget: int) -> Case:
    at_truth = np.array([truth[one] for one in problem.parameters.free])
    return Case(name, problem.within(box), at_truth, budget)


def _two_flights(seed: int, noise: float, system: StateSpace | None = None) -> list[FlightRecord]:
    return [
        rig.fly(pair, np.random.default_rng((seed, k)), noise=noise, system=system)
        for k, pair in enumerate((PITCH, ROLL))
    ]


def _structure(text: str, truth: Mapping[str, float]) -> LinearStructure:
    """The structure with a parameter for every true value, which start in the middle of their ranges."""
    tables = [
        f"[parameters.{name}]\nvalue = {np.sqrt(np.prod(_range(name, value)))}\n"
        f'unit = "{"s" if name.startswith("tau") else "1"}"\nlower = 0.0\n'
        for name, value in truth.items()
    ]
    return from_toml(text + "".join(tables))


def _range(name: str, true: float) -> tuple[float, float]:
    return _RANGES.get(name.partition("_")[0], (true / DECADE, true * DECADE))


def _box(problem: FrequencyProblem, truth: Mapping[str, float]) -> StartBox:
    sides = np.array([_range(name, truth[name]) for name in problem.parameters.free])
    scales: tuple[Scale, ...] = tuple("logarithmic" for _ in sides)
    return StartBox(lower=sides[:, 0], upper=sides[:, 1], scales=scales)


def main() -> None:
    """Print the study of noise, then what each search makes of the harder rigs."""
    for pose in (roll, attitude):
        print("\n".join(noise_study(pose)), flush=True)
    for case in (late(), pendulous(), flexible(400), flexible(800)):
        print(
            f"{case.name}, {case.truth.size} unknowns, budget {case.budget}:"
            f" {100 * share(case):.0f} % of local searches end in the lowest minimum"
        )
        for name, score in scores(case, seeds=range(SEEDS)).items():
            print(_line(name, score), flush=True)


if __name__ == "__main__":
    main()
