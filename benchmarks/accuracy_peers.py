"""Peers that identify sampled models from records, each over a grid of its settings.

Peers are compared where they are installed. Every model answers with its frequency response at the samples, shape
``(y, u, f)``.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rotorid.fitting import TimeData
from rotorid.typing import ComplexArray, FloatArray

Setting = tuple[int, ...]
Responses = list[list[ComplexArray | None]]
"""Of every record under every setting; ``None`` where a peer failed."""

INSTALL = "pip install control nfoursid sippy_unipi sympy casadi, and Octave with its control package"
OCTAVE_TIMEOUT_S = 120.0
_OCTAVE = """
pkg load control; warning("off", "all"); load("{given}");
for r = 1:size(u, 3)
  for k = 1:rows(settings)
    n = settings(k, 1); s = settings(k, 2); d = settings(k, 3);
    data = iddata(y(d+1:end, :, r), u(1:end-d, :, r), step);
    H = nan(columns(y), columns(u), numel(omega));
    try
      {model}
      H = freqresp(model, omega)(:, 1:columns(u), :);
    catch
    end
    found(:, :, :, r, k) = H;
  end
end
save("-v7", "{answer}", "found");
"""


class Peer(NamedTuple):
    """A method of a peer: what tunes it, and its responses over records and settings."""

    name: str
    settings: tuple[Setting, ...]
    responses: Callable[[Sequence[TimeData], Sequence[Setting], FloatArray], Responses]


def peers(*, outputs: int, delays: Sequence[int], orders: Sequence[int]) -> Iterator[Peer]:
    """Those that are installed.

    Parameters
    ----------
    outputs
        How many outputs the records have; some know one only.
    delays
        Whole samples by which inputs may be moved before they are given to a peer, which knows no delay.
    orders
        Of state spaces.
    """
    long_orders = (2, 3, 4, 6, 8, 10, 12, 16, 20)
    tuned = tuple(product(orders, (15, 30, 45), delays))
    arx = tuple(product(long_orders, (0,), delays))
    yield Peer("ARX by least squares", arx, _one_by_one(_arx))
    if _is_here("control"):
        yield Peer("python-control, ERA", tuple(product(orders, (40, 80, 120), delays)), _one_by_one(_era))
    if _is_here("nfoursid"):
        yield Peer("nfoursid", tuned, _one_by_one(_nfoursid))
    if _is_here("sippy_unipi") and _is_here("sympy"):
        for method in ("N4SID", "MOESP", "CVA"):
            yield Peer(f"SIPPY {method}", tuned, _one_by_one(_sippy_subspace(method)))
        if outputs == 1:
            # Its search takes a second: only the orders that came closest in a wider scan.
            closest = ((3, 0, delays[-1]),)
            yield Peer("SIPPY ARMAX", closest, _one_by_one(_sippy_polynomials("ARMAX")))
            if _is_here("casadi"):
                yield Peer("SIPPY output error", closest, _one_by_one(_sippy_polynomials("OE")))
    if has_octave():
        yield Peer("Octave n4sid", tuned, _octave("model = n4sid(data, n, 's', s);"))
        yield Peer("Octave arx", arx, _octave("model = arx(data, n);"))


def missing() -> list[str]:
    """Peers that are not installed."""
    absent = [module for module in ("control", "nfoursid", "sippy_unipi", "sympy", "casadi") if not _is_here(module)]
    return absent if has_octave() else [*absent, "octave with its control package"]


def _is_here(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def _one_by_one(
    model: Callable[[FloatArray, FloatArray, Setting, float, FloatArray], ComplexArray],
) -> Callable[[Sequence[TimeData], Sequence[Setting], FloatArray], Responses]:
    """A model of inputs and outputs, whose inputs are moved by the last number of a setting."""

    def one(record: TimeData, setting: Setting, omega: FloatArray) -> ComplexArray | None:
        late, step_s = setting[-1], 1.0 / record.sample_rate_hz
        u, y = record.inputs[:, : record.samples - late], record.outputs[:, late:]
        try:
            return np.asarray(model(u, y, setting, step_s, omega) * np.exp(-1j * omega * late * step_s))
        except (ValueError, ArithmeticError, TypeError, IndexError, RuntimeError, np.linalg.LinAlgError):
            return None

    def every(records: Sequence[TimeData], settings: Sequence[Setting], omega: FloatArray) -> Responses:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # the peers' own
            return [[one(record, setting, omega) for setting in settings] for record in records]

    return every


def sampled(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, *, step_s: float, omega: FloatArray
) -> ComplexArray:
    """Response of a sampled state space."""
    z = np.exp(1j * omega * step_s)
    solved = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (z.size, *B.shape)))
    return np.moveaxis(C @ solved + D, 0, -1)


def _arx(u: FloatArray, y: FloatArray, setting: Setting, step_s: float, omega: FloatArray) -> ComplexArray:
    """All outputs on the past of all outputs and inputs."""
    order, samples = setting[0], u.shape[1]
    past = [row[:, order - lag : samples - lag] for row in (y, u) for lag in range(1, order + 1)]
    found = np.linalg.lstsq(np.vstack(past).T, y[:, order:].T, rcond=None)[0].T
    late = np.exp(-1j * omega * step_s)[:, None] ** np.arange(1, order + 1)
    own, given = np.split(found, [order * len(y)], axis=1)
    denominator = np.eye(len(y)) - np.einsum("yla,fl->fya", own.reshape(len(y), order, -1), late)
    numerator = np.einsum("yla,fl->fya", given.reshape(len(y), order, -1), late)
    return np.moveaxis(np.linalg.solve(denominator, numerator), 0, -1)


def _era(u: FloatArray, y: FloatArray, setting: Setting, step_s: float, omega: FloatArray) -> ComplexArray:
    import control

    markov = control.markov(y, u, setting[1])
    model, _ = control.era(markov, setting[0], m=setting[1] // 2 - 1, n=setting[1] // 2 - 1)
    return sampled(model.A, model.B, model.C, model.D, step_s=step_s, omega=omega)


def _nfoursid(u: FloatArray, y: FloatArray, setting: Setting, step_s: float, omega: FloatArray) -> ComplexArray:
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    inputs, outputs = ([f"{kind}{k}" for k in range(len(rows))] for kind, rows in (("u", u), ("y", y)))
    table = pd.DataFrame(np.vstack([u, y]).T, columns=[*inputs, *outputs])
    peer = NFourSID(table, output_columns=outputs, input_columns=inputs, num_block_rows=setting[1])
    peer.subspace_identification()
    model, _ = peer.system_identification(rank=setting[0])
    return sampled(model.a, model.b, model.c, model.d, step_s=step_s, omega=omega)


def _sippy_subspace(method: str) -> Callable[..., ComplexArray]:
    def model(u: FloatArray, y: FloatArray, setting: Setting, step_s: float, omega: FloatArray) -> ComplexArray:
        from sippy_unipi import system_identification

        order, horizon, _ = setting
        found = system_identification(
            y, u, method, SS_fixed_order=order, SS_f=horizon, SS_p=horizon, SS_D_required=False, tsample=step_s
        )
        return sampled(found.A, found.B, found.C, found.D, step_s=step_s, omega=omega)

    return model


def _sippy_polynomials(method: str) -> Callable[..., ComplexArray]:
    def model(u: FloatArray, y: FloatArray, setting: Setting, step_s: float, omega: FloatArray) -> ComplexArray:
        from sippy_unipi import system_identification

        poles = setting[0]
        # A held second order with a fraction of a sample of delay has one zero more than poles less one.
        orders = {"ARMAX_orders": [poles, 3, poles, 0], "OE_orders": [3, poles, 0]}
        found = system_identification(y, u, method, tsample=step_s, **orders)
        return np.asarray(found.G(np.exp(1j * omega * step_s))).reshape(1, 1, -1)

    return model


@cache
def has_octave() -> bool:
    """Whether Octave is here with its control package."""
    if not shutil.which("octave"):
        return False
    command = ["octave", "--no-gui", "--quiet", "--norc", "--eval", "pkg load control"]
    return subprocess.run(command, check=False, capture_output=True, timeout=OCTAVE_TIMEOUT_S).returncode == 0


def _octave(model: str) -> Callable[[Sequence[TimeData], Sequence[Setting], FloatArray], Responses]:
    """One process for all records and settings."""

    def every(records: Sequence[TimeData], settings: Sequence[Setting], omega: FloatArray) -> Responses:
        from scipy.io import loadmat, savemat

        step_s = 1.0 / records[0].sample_rate_hz
        with tempfile.TemporaryDirectory() as folder:
            given, answer = Path(folder, "given.mat"), Path(folder, "answer.mat")
            arrays = {
                "u": np.stack([record.inputs.T for record in records], axis=2),
                "y": np.stack([record.outputs.T for record in records], axis=2),
            }
            savemat(given, arrays | {"settings": np.array(settings, dtype=float), "omega": omega, "step": step_s})
            script = _OCTAVE.format(given=given, answer=answer, model=model)
            command = ["octave", "--no-gui", "--quiet", "--norc", "--eval", script]
            subprocess.run(command, check=False, capture_output=True, timeout=OCTAVE_TIMEOUT_S)
            shape = (records[0].outputs.shape[0], records[0].inputs.shape[0], omega.size, len(records), len(settings))
            found = loadmat(answer)["found"].reshape(shape)
        late = np.exp(-1j * omega[:, None] * step_s * np.array([setting[-1] for setting in settings]))
        found = found * late[:, None, :]
        return [[found[..., r, k] for k in range(len(settings))] for r in range(len(records))]

    return every
