"""How much faster a state-space fit is than python-control with finite differences, on the same data in one run.

Two jobs: four states, six responses of thirty points, ten parameters; and eight states, four inputs, three outputs,
hundred points, twenty parameters. The peer builds the system with ``control.ss``, takes its
``control.frequency_response``, and leaves derivatives to ``scipy.optimize.least_squares``, on the very residuals that
are minimized here. A search from a thousand starts is timed whole for ours; the peer does the first few, and its time
is scaled up. Run ``python -m benchmarks.state_space``. Process time is compared, so that a busy machine does not
decide; small arrays suffer more from busy caches than the peer does, so ratios are lowest where others work too.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from rotorid.data import FrequencyResponse
from rotorid.fitting import FrequencyProblem, Points, fit_frequency, fit_many
from rotorid.models import LinearStructure, from_toml
from rotorid.typing import FloatArray

AVAILABLE = importlib.util.find_spec("control") is not None
SKIPPED = "state-space fits skipped: there is no python-control to compare with; pip install control"

STARTS, PEER_STARTS, REPEATS = 1000, 5, 15
STARTS_BAR = 35.0
OFF, SCATTER = 0.3, 0.5
"""Logarithmic spread of a start for one fit, and of the thousand starts, about the truth."""

NOISE = 0.02


class Job(NamedTuple):
    """A structure, its true parameters, and how many times faster ours must be."""

    name: str
    structure: LinearStructure
    truth: Mapping[str, float]
    points: int
    bar: float


def small() -> Job:
    """Pitch of a quadrotor after one command: angular rate, speeds, angle and specific forces."""
    truth = dict(
        zip(
            ("M_q", "M_u", "M_w", "X_q", "X_u", "Z_u", "Z_w", "M_pitch", "X_pitch", "Z_pitch"),
            (0.9, 10.8, 26.6, -0.0805, -0.25, 0.3558, 0.7, 149.8, -7.2, -5.7),
            strict=True,
        )
    )
    matrices = """
        name = "small"
        inputs = ["pitch_command"]
        states = ["q", "u", "w", "theta"]
        outputs = ["q", "u", "w", "theta", "ax", "az"]
        F = [["M_q", "M_u", "M_w", 0], ["X_q", "X_u", 0, -9.80665], [0, "Z_u", "Z_w", 0], [1, 0, 0, 0]]
        G = [["M_pitch"], ["X_pitch"], ["Z_pitch"], [0]]
        H0 = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, 9.80665], [0, 0, 0, 0]]
        H1 = [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
        input_delays = [0.037]
    """
    return Job("4 states, 6 responses, 10 parameters", _structure(matrices, truth), truth, 30, 40.0)


def large() -> Job:
    """Four coupled pairs of a rate and a speed, three rates measured; every state has its own damping."""
    truth = {f"d{k}": -(0.5 + 0.4 * k) for k in range(8)} | {f"k{k}": 1.0 + 0.3 * k for k in range(8)}
    truth |= {f"g{k}": 10.0 + 5.0 * k for k in range(4)}
    F = [[0.0 if i != j else f"d{i}" for j in range(8)] for i in range(8)]
    for state in range(8):
        F[state][(state + 1) % 8] = f"k{state}"
    G = [[f"g{u}" if state == 2 * u else 0.0 for u in range(4)] for state in range(8)]
    H0 = [[float(state == 2 * y) for state in range(8)] for y in range(3)]
    matrices = f"""
        name = "large"
        inputs = ["a", "b", "c", "d"]
        states = {_list(f"x{state}" for state in range(8))}
        outputs = ["p", "q", "r"]
        F = {_rows(F)}
        G = {_rows(G)}
        H0 = {_rows(H0)}
        input_delays = [0.02, 0.02, 0.02, 0.02]
    """
    return Job("8 states, 12 responses, 20 parameters", _structure(matrices, truth), truth, 100, 25.0)


def _list(items: object) -> str:
    return "[" + ", ".join(f'"{item}"' if isinstance(item, str) else f"{item}" for item in items) + "]"  # type: ignore[attr-defined]


def _rows(rows: list[list[object]] | list[list[float]]) -> str:
    return "[" + ", ".join(_list(row) for row in rows) + "]"


def _structure(matrices: str, truth: Mapping[str, float]) -> LinearStructure:
    return from_toml(matrices + "".join(f"\n[parameters.{name}]\nvalue = {value}" for name, value in truth.items()))


def problem_of(job: Job) -> FrequencyProblem:
    """Responses of the truth with 2 % of noise."""
    omega = np.geomspace(0.6, 30.0, job.points)
    exact = job.structure.response(job.truth, omega)
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape)
    data = FrequencyResponse(
        omega_rad_s=omega,
        values=exact * (1.0 + NOISE * noise),
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, NOISE),
        covariance=np.zeros((*exact.shape, omega.size)),
        inputs=job.structure.inputs,
        outputs=job.structure.outputs,
        estimate="direct",
    )
    used = np.ones(exact.shape, dtype=np.bool_)
    return FrequencyProblem(structure=job.structure, parameters=job.structure.parameters, data=data, used=used)


def starts_of(job: Job, count: int, spread: float) -> FloatArray:
    """Start values scattered about the truth, shape ``(count, p)``."""
    rng = np.random.default_rng(1)
    truth = np.array(list(job.truth.values()))
    return np.asarray(truth * np.exp(spread * rng.standard_normal((count, truth.size))))


def fit_with_control(problem: FrequencyProblem, start: FloatArray) -> float:
    """The cost that a fit with python-control and finite differences reaches."""
    import control

    names = problem.parameters.names
    points: Points = problem.points
    magnitude, phase = problem.point_scales

    def residuals(theta: FloatArray) -> FloatArray:
        system = problem.structure.matrices(dict(zip(names, theta.tolist(), strict=True)))
        A, B, C, D = system.proper()
        response = control.frequency_response(control.ss(A, B, C, D), points.omega_rad_s, squeeze=False).frdata
        delays = system.output_delays_s[:, None] + system.input_delays_s
        late = response * np.exp(-1j * delays[..., None] * points.omega_rad_s)
        error = np.log(late[points.output, points.input, points.frequency] / points.values)
        return np.concatenate([magnitude * error.real, phase * error.imag])

    return 2.0 * float(least_squares(residuals, start, x_scale="jac").cost)


def _seconds(action: Callable[[], object]) -> float:
    start = time.process_time()
    action()
    return time.process_time() - start


def run(job: Job) -> dict[str, float]:
    """Seconds of one fit and of a thousand starts, and the costs that both reach."""
    problem = problem_of(job)
    start = starts_of(job, 1, OFF)[0]
    # Built once for a problem, as in a search that fits many times.
    ours_cost = fit_frequency(problem, starts=[start]).cost
    peer_cost = fit_with_control(problem, start)
    ours = [_seconds(lambda: fit_frequency(problem, starts=[start])) for _ in range(REPEATS)]
    peer = [_seconds(lambda: fit_with_control(problem, start)) for _ in range(PEER_STARTS)]
    starts = starts_of(job, STARTS, SCATTER)
    many = _seconds(lambda: fit_many(problem, starts))
    peer_many = _seconds(lambda: [fit_with_control(problem, one) for one in starts[:PEER_STARTS]])
    return {
        "rotorid_s": float(np.median(ours)),
        "control_s": float(np.median(peer)),
        "ratio": float(np.median(peer) / np.median(ours)),
        "rotorid_cost": ours_cost,
        "control_cost": peer_cost,
        "rotorid_starts_s": many,
        "control_starts_s": peer_many * STARTS / PEER_STARTS,
        "ratio_starts": peer_many * STARTS / PEER_STARTS / many,
    }


def main() -> None:
    """Print the numbers, one per line."""
    if not AVAILABLE:
        print(SKIPPED)
        return
    for job in (small(), large()):
        print(job.name)
        for name, value in run(job).items():
            print(f"  {name:18} {value:14.5f}")


if __name__ == "__main__":
    main()
