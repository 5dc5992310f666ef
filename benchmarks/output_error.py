"""How much faster an output-error fit is than ``scipy.signal.lsim`` with finite differences, on the same data.

Eight states, four inputs, three outputs, twenty parameters, 12 000 samples. The peer simulates with ``lsim`` and a held
input and leaves derivatives to finite differences; ours gives the residual with its exact Jacobian. Both then fit from
one start to the same records; the peer with ``scipy.optimize.least_squares``. Process time is compared. Run
``python -m benchmarks.output_error``.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lsim

from benchmarks.state_space import Job
from rotorid.fitting import LevenbergMarquardt, TimeData, TimeProblem
from rotorid.models import Parameter, ParameterSet, structure_from_equations
from rotorid.simulation import simulate_linear
from rotorid.typing import FloatArray

SAMPLES, RATE_HZ, NOISE, OFF = 12_000, 200.0, 0.02, 0.1
REPEATS, PEER_REPEATS = 25, 5
JACOBIAN_BAR, FIT_BAR = 40.0, 20.0


def job() -> Job:
    """Four damped oscillators in a ring, each driven by one input; three of their rates are measured."""
    truth = {f"d{k}": 0.6 + 0.2 * k for k in range(8)} | {f"w{k}": 2.0 + 1.5 * k for k in range(4)}
    truth |= {f"c{k}": 0.3 + 0.1 * k for k in range(4)} | {f"g{k}": 10.0 + 5.0 * k for k in range(4)}
    equations = []
    for k in range(4):
        equations.append(f"x{k}' = -d{2 * k}*x{k} - w{k}*z{k} + c{k}*x{(k + 1) % 4} + g{k}*u{k}")
        equations.append(f"z{k}' = w{k}*x{k} - d{2 * k + 1}*z{k}")
    structure = structure_from_equations(
        name="ring",
        inputs=[f"u{k}" for k in range(4)],
        states=[f"{state}{k}" for k in range(4) for state in "xz"],
        equations=equations,
        outputs=["x0", "x1", "x2"],
        parameters=ParameterSet(Parameter(name=name, value=value, unit="1") for name, value in truth.items()),
    )
    return Job("8 states, 20 parameters, 12 000 samples", structure, truth, SAMPLES, JACOBIAN_BAR)


def problem_of(job: Job) -> TimeProblem:
    """Outputs of the truth under random binary inputs, with 2 % of noise, from rest."""
    structure = job.structure
    rng = np.random.default_rng(0)
    u = np.sign(np.repeat(rng.standard_normal((len(structure.inputs), SAMPLES // 40)), 40, axis=1))
    y = simulate_linear(structure.matrices(job.truth), u, sample_rate_hz=RATE_HZ)
    y = y + NOISE * y.std(axis=1, keepdims=True) * rng.standard_normal(y.shape)
    data = TimeData(name="flight", inputs=u, outputs=y, sample_rate_hz=RATE_HZ, before=np.zeros(len(u)))
    return TimeProblem(structure=structure, parameters=structure.parameters, records=(data,), unknowns=())


def residuals_of_lsim(problem: TimeProblem) -> Callable[[FloatArray], FloatArray]:
    """The same whitened residual, simulated by the peer."""
    record, structure = problem.records[0], problem.structure
    time_s = np.arange(record.samples) / record.sample_rate_hz

    def residuals(theta: FloatArray) -> FloatArray:
        system = structure.matrices(problem.parameters.unpack(theta).values).proper()
        _, y, _ = lsim(system, record.inputs.T, time_s, interp=False)
        return np.asarray(((record.outputs.T - y) @ problem.whitening.T).ravel())

    return residuals


def finite_differences(residuals: Callable[[FloatArray], FloatArray], theta: FloatArray) -> FloatArray:
    """Residual and Jacobian by forward differences, as ``least_squares`` takes them."""
    base = residuals(theta)
    steps = np.sqrt(np.finfo(np.float64).eps) * np.maximum(1.0, np.abs(theta))
    moves = np.diag(steps)
    return np.stack([(residuals(theta + move) - base) / step for move, step in zip(moves, steps, strict=True)], axis=1)


def run(job: Job) -> dict[str, float]:
    """Median process times of a Jacobian, and of a whole fit, of ours and of the peer."""
    problem = problem_of(job)
    truth = np.array([job.truth[name] for name in problem.parameters.free])
    start = truth * np.exp(OFF * np.random.default_rng(1).standard_normal(truth.size))
    solver, peer = LevenbergMarquardt(tolerance=1e-9), residuals_of_lsim(problem)
    problem.residuals(start)
    ours = _median(lambda: problem.residuals(start))
    theirs = _median(lambda: finite_differences(peer, start), repeats=PEER_REPEATS)
    exact = problem.residuals(start)[1]
    numeric = finite_differences(peer, start)
    ends: dict[str, float] = {}

    def fit_ours() -> None:
        ends["ours"] = solver.minimize(problem.residuals, start, *problem.box).cost

    def fit_theirs() -> None:
        found = least_squares(peer, start, method="lm", x_scale="jac", ftol=1e-9, xtol=1e-9, gtol=1e-9)
        ends["lsim"] = 2.0 * float(found.cost)

    ours_fit, theirs_fit = _median(fit_ours, repeats=PEER_REPEATS), _median(fit_theirs, repeats=1)
    return {
        "rotorid_s": ours,
        "lsim_s": theirs,
        "rotorid_fit_s": ours_fit,
        "lsim_fit_s": theirs_fit,
        "jacobian_difference": float(np.abs(exact - numeric).max() / np.abs(numeric).max()),
        "cost_ratio": ends["lsim"] / ends["ours"],
    }


def _median(job: Callable[[], object], repeats: int = REPEATS) -> float:
    times = []
    for _ in range(repeats):
        began = time.process_time()
        job()
        times.append(time.process_time() - began)
    return float(np.median(times))


if __name__ == "__main__":
    result = run(job())
    print(f"residual and Jacobian {result['rotorid_s']:.4f} s, lsim {result['lsim_s']:.3f} s", end=": ")
    print(f"{result['lsim_s'] / result['rotorid_s']:.0f} | {JACOBIAN_BAR:.0f}")
    print(f"whole fit {result['rotorid_fit_s']:.3f} s, lsim {result['lsim_fit_s']:.2f} s", end=": ")
    print(f"{result['lsim_fit_s'] / result['rotorid_fit_s']:.0f} | {FIT_BAR:.0f}")
    print(f"largest difference of Jacobians {result['jacobian_difference']:.1e}")
    print(f"cost of lsim over ours {result['cost_ratio']:.6f}")
