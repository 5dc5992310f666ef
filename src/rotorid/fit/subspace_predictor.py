"""States from the coefficients of a long regression, which feedback does not bias."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.high_order_predictor import fit_predictor, triangle
from rotorid.fit.time_data import TimeData
from rotorid.typing import FloatArray


class PredictedStates(NamedTuple):
    """A, C and K in the basis of the predicted states, shapes ``(x, x)``, ``(y, x)``, ``(x, y)``; singular values."""

    A: FloatArray
    C: FloatArray
    K: FloatArray
    singular_values: FloatArray


def predicted_states(records: Sequence[TimeData], order: int, horizon: int, *, feedthrough: bool) -> PredictedStates:
    r"""The states that the past predicts, and the equations that they obey.

    With :math:`\tilde A = A - K C` the coefficients of the regression are :math:`C \tilde A^{i-1} [K, B]`; shifted
    below each other they are the observability matrix times the map from the past to the state, whose range a singular
    value decomposition finds. Regression of outputs on states, and of next states on states, inputs and innovations,
    gives the matrices.

    Parameters
    ----------
    records
        Inputs and outputs of size one, without offsets.
    order
        Number of states.
    horizon
        Samples of past and future.
    feedthrough
        Whether the present inputs act on the present outputs.

    References
    ----------
    A. Chiuso, *The role of vector autoregressive modeling in predictor-based subspace identification*, Automatica 43,
    2007.
    """
    predictor = fit_predictor(records, horizon, feedthrough=feedthrough)
    oldest_first = np.concatenate(predictor.coefficients[::-1], axis=1)
    y, wide = oldest_first.shape
    channels = wide // horizon
    shifted = np.zeros((horizon * y, wide))
    for ahead in range(horizon):
        shifted[ahead * y : (ahead + 1) * y, ahead * channels :] = oldest_first[:, : wide - ahead * channels]
    pasts = [stacked(np.vstack([one.outputs, one.inputs])[:, :-1], horizon) for one in records]
    lower = triangle(np.hstack(pasts).T).T
    vectors, values, _ = np.linalg.svd(shifted @ lower, full_matrices=False)
    root = np.sqrt(np.maximum(values[:order], 1e-300))
    states = [(vectors[:, :order] / root).T @ shifted @ past for past in pasts]
    A, C, K = _equations(records, states, horizon, feedthrough=feedthrough)
    return PredictedStates(A, C, K, values)


def stacked(values: FloatArray, rows: int) -> FloatArray:
    """Samples below those before them: block Hankel matrix, shape ``(rows * channels, samples - rows + 1)``.

    Raises
    ------
    InsufficientDataError
        There are fewer samples than rows.
    """
    count = values.shape[1] - rows + 1
    if count < 1:
        raise InsufficientDataError(f"{values.shape[1]} samples came for a horizon of {rows}", needed="longer records")
    return np.vstack([values[:, row : row + count] for row in range(rows)])


def _equations(
    records: Sequence[TimeData], states: Sequence[FloatArray], horizon: int, *, feedthrough: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    order = len(states[0])
    u = np.hstack([one.inputs[:, horizon:] for one in records])
    y = np.hstack([one.outputs[:, horizon:] for one in records])
    present = np.hstack(states)
    seen = np.vstack([present, u]) if feedthrough else present
    found = _regression(seen, y)
    errors = y - found @ seen
    # The last state of a record has no next one.
    last = np.cumsum([part.shape[1] for part in states]) - 1
    kept = np.setdiff1d(np.arange(present.shape[1]), last)
    following = np.hstack([part[:, 1:] for part in states])
    driving = np.vstack([present, u, errors])[:, kept]
    step = _regression(driving, following)
    return step[:, :order], found[:, :order], step[:, order + len(u) :]


def _regression(regressors: FloatArray, values: FloatArray) -> FloatArray:
    # Without noise there are no innovations, and what goes with them is left at zero.
    return np.asarray(np.linalg.lstsq(regressors.T, values.T, rcond=1e-12)[0].T, dtype=np.float64)
