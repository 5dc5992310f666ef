"""What enters the outputs of a state space linearly once A and C are known: B, D, K and the initial states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rotorid.fit.high_order_predictor import fit_predictor
from rotorid.fit.time_data import TimeData
from rotorid.typing import FloatArray

_MARGIN = 1e-9
_ROUNDING = 1e-9
"""Of the outputs: smaller innovations are no noise."""


class Gains(NamedTuple):
    """B ``(x, u)``, D ``(y, u)`` and the initial states of each record ``(records, x)``."""

    B: FloatArray
    D: FloatArray
    initial_states: FloatArray


def simulated_gains(A: FloatArray, C: FloatArray, records: Sequence[TimeData], *, direct: int = 0) -> Gains:
    r"""Gains that bring the simulated output closest to the measured one.

    .. math:: \hat y_k = C A^k x_0 + \sum_{i<k} C A^{k-1-i} B u_i + D u_k

    Parameters
    ----------
    A, C
        Shapes ``(x, x)`` and ``(y, x)``; A must not grow over a record, see :func:`stable`.
    records
        Inputs and outputs.
    direct
        How many of the inputs, from the first on, act within the same sample; D is zero for the others.
    """
    order, (u, y) = len(A), (len(records[0].inputs), len(C))
    gains = order * u + y * direct
    columns, outputs = [], []
    for number, record in enumerate(records):
        begins = np.zeros((record.samples * y, len(records) * order))
        begins[:, number * order : (number + 1) * order] = _free(A, C, record.samples)
        columns.append(np.hstack([_forced(A, C, record.inputs, direct), begins]))
        outputs.append(record.outputs.T.ravel())
    matrix = np.vstack(columns)
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    found = np.linalg.lstsq(matrix / size, np.concatenate(outputs), rcond=1e-13)[0] / size
    B = found[: order * u].reshape(u, order).T
    D = np.hstack([found[order * u : gains].reshape(direct, y).T, np.zeros((y, u - direct))])
    return Gains(B, D, found[gains:].reshape(len(records), order))


def predicted_gains(
    A: FloatArray, C: FloatArray, K: FloatArray, records: Sequence[TimeData], *, direct: int = 0
) -> tuple[FloatArray, FloatArray, Gains]:
    r"""Gains that bring the prediction one sample ahead closest to the measurement; gives A and K anew with them.

    .. math:: \hat x_{k+1} = (A - K C) \hat x_k + (B - K D) u_k + K y_k

    The predictor decays where the system itself may grow, and what it is driven by does not know the error to come:
    its gains are unbiased under feedback.

    Parameters
    ----------
    A, C, K
        Shapes ``(x, x)``, ``(y, x)``, ``(x, y)``; of A and K only the predictor :math:`A - K C` is kept.
    records
        Inputs and outputs.
    direct
        As for :func:`simulated_gains`.
    """
    u = len(records[0].inputs)
    predictor = stable(A - K @ C)
    driven = [_record(one, np.vstack([one.inputs, one.outputs]), one.outputs) for one in records]
    both = simulated_gains(predictor, C, driven, direct=direct)
    B, K, D = both.B[:, :u], both.B[:, u:], both.D[:, :u]
    return predictor + K @ C, K, Gains(B + K @ D, D, both.initial_states)


def innovation_gain(
    A: FloatArray, C: FloatArray, gains: Gains, records: Sequence[TimeData], *, lags: int
) -> FloatArray:
    """K of the noise that a simulation leaves, driven by the innovations of a long regression, shape ``(x, y)``.

    Zero where there is no noise.

    Parameters
    ----------
    A, C, gains
        The system that was simulated.
    records
        Inputs and outputs.
    lags
        Of the regression.
    """
    feedthrough = bool(np.any(gains.D))
    predictor = fit_predictor(records, lags, feedthrough=feedthrough)
    noises, size = [], 0.0
    for record, start in zip(records, gains.initial_states, strict=True):
        errors = predictor.innovations(record)[:, lags:]
        noise = (record.outputs - _simulated(A, C, gains, record.inputs, start))[:, lags:] - errors
        noises.append(_record(record, errors, noise))
        size = max(size, float(np.abs(errors).max() / np.abs(record.outputs).max()))
    return simulated_gains(A, C, noises).B if size > _ROUNDING else np.zeros((len(A), len(C)))


def stable(A: FloatArray) -> FloatArray:
    """The same matrix with eigenvalues outside the unit circle mirrored into it."""
    values, vectors = np.linalg.eig(A)
    if np.abs(values).max(initial=0.0) <= 1.0 + _MARGIN:
        return A
    inside = np.where(np.abs(values) > 1.0, 1.0 / np.conj(values), values)
    return np.asarray((vectors * inside @ np.linalg.inv(vectors)).real, dtype=np.float64)


def _record(of: TimeData, inputs: FloatArray, outputs: FloatArray) -> TimeData:
    return TimeData(name=of.name, inputs=inputs, outputs=outputs, sample_rate_hz=of.sample_rate_hz)


def _simulated(A: FloatArray, C: FloatArray, gains: Gains, u: FloatArray, start: FloatArray) -> FloatArray:
    from rotorid.simulate.kernels import recursion

    states = recursion(np.ascontiguousarray(A), np.ascontiguousarray((gains.B @ u).T), start.copy())
    return np.asarray(C @ states.T + gains.D @ u, dtype=np.float64)


def _forced(A: FloatArray, C: FloatArray, u: FloatArray, direct: int) -> FloatArray:
    """Outputs for a unit gain from each input into each state, and onto each output, shape ``(samples * y, gains)``."""
    from rotorid.simulate.kernels import recursion

    order, samples, rest = len(A), u.shape[1], np.zeros(len(A))
    columns = []
    for values in u:
        for state in range(order):
            forcing = np.zeros((samples, order))
            forcing[:, state] = values
            columns.append((recursion(np.ascontiguousarray(A), forcing, rest) @ C.T).ravel())
    columns += [np.outer(values, row).ravel() for values in u[:direct] for row in np.eye(len(C))]
    return np.column_stack(columns)


def _free(A: FloatArray, C: FloatArray, samples: int) -> FloatArray:
    """Outputs for each unit initial state, shape ``(samples * y, x)``."""
    from rotorid.simulate.kernels import recursion

    still = np.zeros((samples, len(A)))
    starts = np.eye(len(A))
    return np.column_stack(
        [(recursion(np.ascontiguousarray(A), still, start.copy()) @ C.T).ravel() for start in starts]
    )
