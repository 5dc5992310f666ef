r"""How much of the information of a record is used, and whether what is stated is the error: linear twins of papers.

Flights of published models under feedback, in gusts, with noisy sensors (:mod:`tests.twins.twin_flights`), where the
Cramér–Rao bound is exact: the one-step predictor of the Kalman filter that knows gusts, noise and trim has

.. math:: F_{ij} = \sum_k \partial_i e_k^T S^{-1} \partial_j e_k
          + \tfrac{N}{2} \mathrm{tr}(S^{-1} \partial_i S \, S^{-1} \partial_j S)

with innovations :math:`e` of covariance :math:`S`. No unbiased estimate from this log scatters less. Who knows what:

- the *bound* knows the structure, gusts, noise and trim, and the whole log;
- *rotorid* knows the structure; responses with the injected sweep as instrument, weights by their covariance;
- *output error, white residuals* knows the structure, starts at the true values, and takes residuals for white noise;
- *Welch, one window* knows the structure and starts at the true values: direct responses of windows of 10 s, a log
  cost weighted by coherence.

Efficiency is the variance of the bound over the mean squared error, the median over the parameters; stated over error
the root of the mean stated variance over the root mean squared error, their median. Run ``python -m
benchmarks.sharpness [FLIGHTS]``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import lfilter
from tests.twins.twin_flights import (
    BAND,
    HUMMINGBIRD_PITCH,
    HUMMINGBIRD_VERTICAL,
    HUMMINGBIRD_YAW,
    PITCH,
    REST_S,
    STEP_HZ,
    VERTICAL,
    YAW,
    Twin,
    plan,
    problem_of,
    record_of,
    refined,
)

from benchmarks.direct_response import direct_response, fit_direct
from rotorid.data import FlightRecord, Maneuver
from rotorid.fitting import FrequencyProblem, TimeData, TimeProblem, fit_output_error
from rotorid.models import StateSpace
from rotorid.simulation import LinearLoop, discretize, fly_linear
from rotorid.typing import Axis, FloatArray
from rotorid.uncertainty import colored_covariance

FLIGHTS = 20
WINDOW_S, LEAST_COHERENCE = 10.0, 0.6
STEP = 1e-4
THIN = 5
"""Of the samples of a controller at 1 kHz, output error has one in five, 200 Hz: the vehicle is slow beside it."""
BOUND, OURS, WHITE, WELCH = "bound", "rotorid", "output error, white residuals", "Welch, one window"


class Input(NamedTuple):
    """Test inputs at 1 kHz, shape ``(u, steps)``, and where the sweeps are."""

    values: FloatArray
    maneuvers: tuple[Maneuver, ...]


class Job(NamedTuple):
    """A twin, the loop that flies it, its sweeps, and whether its motion can be simulated without the loop."""

    name: str
    twin: Twin
    loop: LinearLoop
    fly: Callable[[np.random.Generator], Input]
    stable: bool


def sweeps(axis: Axis, amplitude: float, band: tuple[float, float], rng: np.random.Generator) -> Input:
    """Two sweeps of an axis, as in :mod:`tests.twins.twin_flights`."""
    parts = plan({axis: amplitude}, rng, band)
    excitation = np.zeros((1, round((parts[-1].maneuver.stop_s + REST_S) * STEP_HZ)))
    for part in parts:
        first = round(part.maneuver.start_s * STEP_HZ)
        excitation[0, first : first + part.values.size] += part.values
    return Input(excitation, tuple(part.maneuver for part in parts))


JOBS = (
    Job("Hummingbird yaw", YAW, HUMMINGBIRD_YAW, partial(sweeps, "yaw", 10.0, (BAND[0], 75.0)), True),
    Job("Hummingbird heave", VERTICAL, HUMMINGBIRD_VERTICAL, partial(sweeps, "thrust", 10.0, (0.3, BAND[1])), True),
    Job(
        "Hummingbird pitch, unstable",
        replace(PITCH, outputs=("q",)),
        HUMMINGBIRD_PITCH,
        partial(sweeps, "pitch", 3.0, BAND),
        False,
    ),
)


class Estimate(NamedTuple):
    """What a method says of one flight: values, and where it states any their deviations, in all and random alone."""

    values: FloatArray
    std: FloatArray | None = None
    random_std: FloatArray | None = None


class Used(NamedTuple):
    """How well a method does on the flights of a job, medians over the parameters.

    Parameters
    ----------
    error_over_bound
        Root mean squared error over the deviation of the bound.
    efficiency
        Variance of the bound over mean squared error.
    stated_over_error
        Stated deviation over root mean squared error, where any is stated.
    random_over_error
        The same for the random part.
    held
        Share of intervals of 95 % that contain the truth.
    """

    error_over_bound: float
    efficiency: float
    stated_over_error: float | None
    random_over_error: float | None
    held: float | None


def flight_of(job: Job, seed: int) -> tuple[FlightRecord, TimeData]:
    """A log at the rate of the controller, where nothing happens between samples, and its channels of the twin."""
    rng = np.random.default_rng(1000 + seed)
    given = job.fly(rng)
    flight = fly_linear(job.loop, given.values, sample_rate_hz=STEP_HZ, maneuvers=given.maneuvers, rng=rng)
    data = TimeData(
        name=job.name,
        inputs=np.stack([flight.columns[name] for name in job.twin.inputs]),
        outputs=np.stack([flight.columns[name] for name in job.twin.outputs]),
        sample_rate_hz=STEP_HZ,
    )
    return record_of(flight.columns, STEP_HZ, given.maneuvers), data


def thinned(data: TimeData, maneuver: Maneuver) -> TimeData:
    """A maneuver at a fifth of the rate."""
    first, last = (round(time_s * STEP_HZ) for time_s in (maneuver.start_s, maneuver.stop_s))
    return TimeData(
        name=data.name,
        inputs=data.inputs[:, first:last:THIN],
        outputs=data.outputs[:, first:last:THIN],
        sample_rate_hz=data.sample_rate_hz / THIN,
    )


class Predictor(NamedTuple):
    """Innovations of a record, shape ``(n, y)``, and their covariance."""

    values: FloatArray
    covariance: FloatArray


def predicted(system: StateSpace, loop: LinearLoop, rows: list[int], data: TimeData) -> Predictor:
    """The Kalman filter of a vehicle in the gusts and with the noise that flew, at rest before the first sample."""
    A, B, C, D = system.proper()
    gusts, order, inputs = len(loop.gust_std), A.shape[0], B.shape[1] - len(loop.gust_std)
    decay_1_s = 1.0 / loop.gust_correlation_s
    # Gusts are states that forget with their correlation time, driven by white noise.
    A = np.block([[A, B[:, inputs:]], [np.zeros((gusts, order)), -decay_1_s * np.eye(gusts)]])
    B = np.vstack([B[:, :inputs], np.zeros((gusts, inputs))])
    C, D = np.hstack([C, D[:, inputs:]]), D[:, :inputs]
    step_s = 1.0 / data.sample_rate_hz
    step = discretize(A, B, delays_s=system.input_delays_s[:inputs], step_s=step_s, hold="first")
    driven = np.zeros_like(A)
    driven[order:, order:] = np.diag(2.0 * decay_1_s * np.array(loop.gust_std) ** 2)
    Q, R = _sampled_noise(A, driven, step_s), np.diag(np.array(loop.noise_std)[rows] ** 2)
    # A loop without gusts leaves nothing to filter; what is added is below any noise.
    Q = Q + 1e-14 * np.eye(len(Q))
    P = solve_discrete_are(step.transition.T, C.T, Q, R)
    S = C @ P @ C.T + R
    gain = step.transition @ P @ C.T @ np.linalg.inv(S)
    past = np.zeros(inputs)
    shown = data.outputs.T - step.delayed(data.inputs, past).T @ D.T
    driven_by = step.forcing(data.inputs, past) + shown @ gain.T
    states = recursion(step.transition - gain @ C, driven_by)
    return Predictor(shown - states @ C.T, S)


def recursion(transition: FloatArray, forcing: FloatArray) -> FloatArray:
    """States from zero on, :math:`x_{k+1} = A x_k + f_k`, mode by mode, shape ``(n, x)``."""
    poles, modes = np.linalg.eig(transition)
    driven = np.linalg.solve(modes, forcing.T.astype(complex))
    moved = [lfilter([0.0, 1.0], [1.0, -pole], row) for pole, row in zip(poles, driven, strict=True)]
    return np.asarray((modes @ np.array(moved)).real.T)


def _sampled_noise(A: FloatArray, power: FloatArray, step_s: float) -> FloatArray:
    """Covariance that white noise of a power adds in a step (Van Loan)."""
    size = len(A)
    block = expm(step_s * np.block([[-A, power], [np.zeros_like(A), A.T]]))
    found = block[size:, size:].T @ block[:size, size:]
    return np.asarray(0.5 * (found + found.T))


def bound_of(job: Job, problem: FrequencyProblem, data: TimeData) -> tuple[FloatArray, float]:
    """Covariance of the Cramér–Rao bound, shape ``(p, p)``, and the variance of whitened innovations at the truth.

    The latter is one if this is the noise that flew.
    """
    names = problem.parameters.free
    truth = {name: job.twin.truth[name] for name in names}
    rows = [job.loop.outputs.index(name) for name in job.twin.outputs]

    def at(values: Mapping[str, float]) -> Predictor:
        parameters = problem.parameters.with_values(values)
        system = with_gusts(problem.structure.matrices(parameters.values), job.loop)
        return predicted(system, job.loop, rows, data)

    middle = at(truth)
    white = np.linalg.inv(middle.covariance)
    slopes, moved = [], []
    for name in names:
        step = STEP * abs(truth[name])
        high, low = at(truth | {name: truth[name] + step}), at(truth | {name: truth[name] - step})
        slopes.append((high.values - low.values) / (2.0 * step))
        moved.append(white @ (high.covariance - low.covariance) / (2.0 * step))
    whitened = [one @ white for one in slopes]
    fisher = np.array([[np.sum(one * other) for other in slopes] for one in whitened])
    fisher += 0.5 * data.samples * np.array([[np.trace(one @ other) for other in moved] for one in moved])
    size = np.sqrt(np.diag(fisher))
    covariance = np.linalg.inv(fisher / np.outer(size, size)) / np.outer(size, size)
    return covariance, float(np.mean(np.sum(middle.values @ white * middle.values, axis=1)) / len(rows))


def with_gusts(system: StateSpace, loop: LinearLoop) -> StateSpace:
    """The gusts that flew as further inputs; motor states, which come last, they do not reach."""
    pushed = np.zeros((system.F.shape[0], len(loop.gust_std)))
    pushed[: loop.gust_input.shape[0]] = loop.gust_input
    return replace(
        system,
        G=np.hstack([system.G, pushed]),
        input_delays_s=np.append(system.input_delays_s, np.zeros(len(loop.gust_std))),
    )


def ours(problem: FrequencyProblem) -> Estimate:
    """The fit by the covariance of all errors, with random and model error."""
    values, stated = refined(problem)
    return Estimate(values, stated.std, stated.random_std)


def white_residuals(job: Job, problem: FrequencyProblem, records: list[TimeData]) -> Estimate:
    """Output error of the sweeps from the true values, and the covariance that white residuals would have."""
    parameters = problem.parameters.with_values({name: job.twin.truth[name] for name in problem.parameters.free})
    structure = problem.structure.condensed(parameters)
    posed = TimeProblem(
        structure=structure,
        parameters=structure.parameters,
        records=tuple(records),
        unknowns=("initial_state", "output_shift", "state_bias"),
        hold="first",
    )
    found = fit_output_error(posed, starts=[structure.parameters.pack()])
    parts = replace(posed, noise=found.noise).parts(found.solution.theta)
    std = np.sqrt(np.diag(colored_covariance(parts).white))
    return Estimate(found.solution.theta, std, std)


def welch(job: Job, problem: FrequencyProblem, data: TimeData) -> Estimate:
    """Direct responses of one window length, a log cost by coherence, from the true values; nothing is stated."""
    omega = problem.data.omega_rad_s
    measured = direct_response(data, omega, (WINDOW_S,))
    # Commands go linearly between samples here: what is held is the response of the straight lines, which is exact.
    hold = np.ones(omega.size, dtype=complex)
    parameters = problem.parameters.with_values({name: job.twin.truth[name] for name in problem.parameters.free})
    structure = replace(problem.structure, parameters=parameters)
    return Estimate(fit_direct(structure, measured, omega, hold, LEAST_COHERENCE))


def methods(
    job: Job, problem: FrequencyProblem, data: TimeData, maneuvers: tuple[Maneuver, ...]
) -> dict[str, Estimate]:
    """Every method on one flight."""
    found = {OURS: ours(problem)}
    if job.stable:
        found[WHITE] = white_residuals(job, problem, [thinned(data, maneuver) for maneuver in maneuvers])
    if len(job.twin.inputs) == len(job.twin.outputs) == 1:
        found[WELCH] = welch(job, problem, data)
    return found


def used(estimates: list[Estimate], bound: FloatArray, truth: FloatArray) -> Used:
    """Measures of a method over flights; ``bound`` is the mean covariance of the bound."""
    errors = np.array([estimate.values - truth for estimate in estimates])
    mean_square = np.mean(errors**2, axis=0)
    efficiency = np.diag(bound) / mean_square

    def over_error(stds: list[FloatArray | None]) -> float | None:
        stated = np.array([std for std in stds if std is not None])
        return float(np.median(np.sqrt(np.mean(stated**2, axis=0) / mean_square))) if stated.size else None

    holds = [np.abs(one.values - truth) <= 1.96 * one.std for one in estimates if one.std is not None]
    return Used(
        error_over_bound=float(np.median(efficiency**-0.5)),
        efficiency=float(np.median(efficiency)),
        stated_over_error=over_error([one.std for one in estimates]),
        random_over_error=over_error([one.random_std for one in estimates]),
        held=float(np.mean(holds)) if holds else None,
    )


def run(job: Job, flights: int = FLIGHTS) -> tuple[dict[str, Used], float]:
    """Methods of a job and what they reach, and the variance of whitened innovations at the truth."""
    found: dict[str, list[Estimate]] = {}
    bound, white = [], []
    truth = np.zeros(0)
    for seed in range(flights):
        record, data = flight_of(job, seed)
        problem = problem_of(job.twin, record)
        estimates = methods(job, problem, data, record.declared)
        covariance, whitened = bound_of(job, problem, data)
        truth = np.array([job.twin.truth[name] for name in problem.parameters.free])
        bound.append(covariance)
        white.append(whitened)
        for name, estimate in estimates.items():
            found.setdefault(name, []).append(estimate)
    mean = np.mean(bound, axis=0)
    return {name: used(estimates, mean, truth) for name, estimates in found.items()}, float(np.mean(white))


def rows(flights: int = FLIGHTS) -> Iterator[str]:
    """The table."""
    yield "| twin | method | error / bound | efficiency | stated / error | random alone | contain the truth |"
    yield "|---|---|---|---|---|---|---|"
    for job in JOBS:
        results, white = run(job, flights)
        print(f"{job.name}: variance of whitened innovations {white:.3f}", file=sys.stderr)
        for name, one in results.items():
            stated, random = ("–" if n is None else f"{n:.2f}" for n in (one.stated_over_error, one.random_over_error))
            contain = "–" if one.held is None else f"{100.0 * one.held:.0f} %"
            yield (
                f"| {job.name} | {name} | {one.error_over_bound:.2f} | {100.0 * one.efficiency:.0f} % | {stated} "
                f"| {random} | {contain} |"
            )


if __name__ == "__main__":
    for line in rows(int(sys.argv[1]) if len(sys.argv) > 1 else FLIGHTS):
        print(line, flush=True)
