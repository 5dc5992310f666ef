"""How accurate black boxes of four states are, ours and those of peers, on the same noisy flights.

Two inputs, two outputs, four states, 60 s at 50 Hz, white noise of a tenth of each output, twenty seeds; errors of
the frequency response over 0.5 to 20 rad/s, root mean square over all pairs, frequencies and seeds. Peers are compared
where they are installed (``pip install nfoursid sippy_unipi``). Run ``python -m benchmarks.accuracy``.
"""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from rotorid.fit.black_box import fit_black_box
from rotorid.fit.black_box_starts import StartPlan
from rotorid.fit.subspace import fit_subspace
from rotorid.fit.time_data import TimeData
from rotorid.models.state_space import StateSpace
from rotorid.simulate.linear import simulate_linear
from rotorid.typing import ComplexArray, FloatArray

SEEDS, SAMPLES, RATE_HZ, NOISE = 20, 3000, 50.0, 0.1
OMEGA_RAD_S = np.geomspace(0.5, 20.0, 40)
BAR_DB, BAR_DEG = 0.1, 0.5
TRUTH = StateSpace(
    M=np.eye(4),
    F=np.array([[0.0, 1.0, 0.0, 0.0], [-9.0, -2.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [2.0, 0.0, -36.0, -5.0]]),
    G=np.array([[0.0, 0.5], [9.0, 0.0], [0.0, 0.0], [3.0, 36.0]]),
    H0=np.array([[1.0, 0.0, 0.2, 0.0], [0.0, 0.1, 1.0, 0.0]]),
    H1=np.zeros((2, 4)),
    input_delays_s=np.zeros(2),
    output_delays_s=np.zeros(2),
)


class Errors(NamedTuple):
    """Root mean square errors of a response."""

    magnitude_db: float
    phase_deg: float


def flight(seed: int) -> TimeData:
    """Random binary inputs, and outputs with white noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], size=(2, SAMPLES // 8)), 8, axis=1)
    y = simulate_linear(TRUTH, u, sample_rate_hz=RATE_HZ)
    noise = NOISE * y.std(axis=1, keepdims=True) * rng.standard_normal(y.shape)
    return TimeData(name=f"flight {seed}", inputs=u, outputs=y + noise, sample_rate_hz=RATE_HZ)


def black_box(record: TimeData) -> ComplexArray:
    plan = StartPlan(methods=("cva", "predictor"), drawn=0)
    found = fit_black_box([record], 4, inputs=["a", "b"], outputs=["y", "z"], unknowns=("initial_state",), plan=plan)
    return found.structure.response(found.parameters.values, OMEGA_RAD_S)


def subspace(record: TimeData) -> ComplexArray:
    model = fit_subspace([record], 4)
    return _sampled(model.A, model.B, model.C)


def nfoursid(record: TimeData) -> ComplexArray:
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    columns = {f"u{k}": row for k, row in enumerate(record.inputs)} | {f"y{k}": r for k, r in enumerate(record.outputs)}
    peer = NFourSID(pd.DataFrame(columns), output_columns=["y0", "y1"], input_columns=["u0", "u1"], num_block_rows=20)
    peer.subspace_identification()
    system, _ = peer.system_identification(rank=4)
    return _sampled(system.a, system.b, system.c, system.d)


def sippy(record: TimeData) -> ComplexArray:
    from sippy_unipi import system_identification

    model = system_identification(
        record.outputs, record.inputs, "CVA", SS_fixed_order=4, SS_f=20, SS_p=20, tsample=1.0 / RATE_HZ
    )
    return _sampled(model.A, model.B, model.C, model.D)


def _sampled(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray | None = None) -> ComplexArray:
    z = np.exp(1j * OMEGA_RAD_S / RATE_HZ)
    solved = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (z.size, *B.shape)))
    return np.moveaxis(C @ solved + (0.0 if D is None else D), 0, -1)


def _held_truth() -> ComplexArray:
    """The truth as samples show it: models of samples are compared with that."""
    block = expm(np.block([[TRUTH.F, TRUTH.G], [np.zeros((2, 6))]]) / RATE_HZ)
    return _sampled(block[:4, :4], block[:4, 4:], TRUTH.H0)


def errors(method: Callable[[TimeData], ComplexArray], truth: ComplexArray, seeds: int) -> Errors:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the peers' own
        ratios = [method(flight(seed)) / truth for seed in range(seeds)]
    return Errors(
        float(np.sqrt(np.mean((20.0 * np.log10(np.abs(ratios))) ** 2))),
        float(np.sqrt(np.mean(np.degrees(np.angle(ratios)) ** 2))),
    )


def rows(seeds: int = SEEDS) -> Iterator[tuple[str, Errors]]:
    yield "rotorid, black box", errors(black_box, TRUTH.response(OMEGA_RAD_S), seeds)
    yield "rotorid, subspace alone", errors(subspace, _held_truth(), seeds)
    for name, module, method in (("nfoursid", "nfoursid", nfoursid), ("SIPPY CVA", "sippy_unipi", sippy)):
        if importlib.util.find_spec(module) is not None:
            yield name, errors(method, _held_truth(), seeds)


def main() -> None:
    """Print the table."""
    print(f"{'four states, two inputs, two outputs':40} {'[dB]':>8} {'[deg]':>8}")
    for name, found in rows():
        print(f"{name:40} {found.magnitude_db:8.3f} {found.phase_deg:8.2f}", flush=True)
    print(f"{'bar of ours':40} {BAR_DB:8.3f} {BAR_DEG:8.2f}")


if __name__ == "__main__":
    main()
