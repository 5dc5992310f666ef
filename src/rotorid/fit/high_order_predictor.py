r"""Long regressions of outputs on past outputs and inputs: what can be predicted, whatever the noise and the feedback.

.. math:: y_k = \sum_{i=1}^{p} (\Phi_i y_{k-i} + \Psi_i u_{k-i}) + D u_k + e_k

With enough lags the residual is the innovation of the outputs, in open and in closed loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.time_data import TimeData
from rotorid.typing import FloatArray

_ROWS_PER_COEFFICIENT = 3
_EXACT = 1e-14
"""Share of the variance below which a residual is rounding."""


class Predictor(NamedTuple):
    """A long regression.

    Parameters
    ----------
    coefficients
        Of past outputs and inputs, shape ``(lags, y, y + u)``, newest first.
    direct
        Of the present inputs, shape ``(y, u)``; zero where they have no part in it.
    """

    coefficients: FloatArray
    direct: FloatArray

    @property
    def lags(self) -> int:
        return len(self.coefficients)

    def innovations(self, record: TimeData) -> FloatArray:
        """What the past did not predict, shape ``(y, n)``; zero for the first samples, which have no past."""
        past = np.vstack([record.outputs, record.inputs])
        errors = record.outputs - self.direct @ record.inputs
        errors[:, : self.lags] = 0.0
        for lag, coefficients in enumerate(self.coefficients, start=1):
            errors[:, self.lags :] -= coefficients @ past[:, self.lags - lag : record.samples - lag]
        return errors


def fit_predictor(records: Sequence[TimeData], lags: int, *, feedthrough: bool = False) -> Predictor:
    """Least squares of a long regression over several records.

    Parameters
    ----------
    records
        Inputs and outputs, without offsets.
    lags
        How many past samples count.
    feedthrough
        Whether the present inputs act on the present outputs.

    Raises
    ------
    InsufficientDataError
        There are fewer samples than coefficients.
    """
    regressors, outputs = _rows(records, lags, lags)
    u, y = len(records[0].inputs), len(records[0].outputs)
    columns = regressors if feedthrough else regressors[:, : lags * (u + y)]
    if len(columns) < columns.shape[1]:
        raise InsufficientDataError(
            f"{len(columns)} samples came for {columns.shape[1]} coefficients of a predictor",
            needed="longer records",
            remedy="take a shorter horizon",
        )
    # A record without noise holds its own future, and its columns depend on each other.
    found = np.asarray(np.linalg.lstsq(columns, outputs, rcond=_EXACT)[0].T, dtype=np.float64)
    coefficients = found[:, : lags * (u + y)].reshape(y, lags, y + u).transpose(1, 0, 2)
    return Predictor(coefficients, found[:, lags * (u + y) :] if feedthrough else np.zeros((y, u)))


def predictor_lags(records: Sequence[TimeData], *, most: int) -> int:
    r"""Number of lags with the lowest criterion of Akaike, :math:`N \log\det R + 2 p y (y + u)`.

    All numbers of lags are compared on the same samples, from one triangular factor of the longest regression.

    Parameters
    ----------
    records
        Inputs and outputs, without offsets.
    most
        Largest number of lags to consider; fewer where the records are short.

    Raises
    ------
    InsufficientDataError
        The records are too short for a single lag.

    References
    ----------
    H. Akaike, *A New Look at the Statistical Model Identification*, IEEE Transactions on Automatic Control, 1974.
    """
    u, y = len(records[0].inputs), len(records[0].outputs)
    samples = sum(record.samples for record in records)
    shortest = min(record.samples for record in records)
    most = min(most, samples // (_ROWS_PER_COEFFICIENT * (u + y)), shortest // 2)
    if most < 1:
        raise InsufficientDataError(f"{samples} samples came for {u + y} channels", needed="longer records")
    regressors, outputs = _rows(records, most, most)
    past = regressors[:, : most * (u + y)]
    factor = triangle(np.hstack([past, outputs]))[:, past.shape[1] :]
    floor = _EXACT * np.sum(outputs**2, axis=0)
    scores = []
    for lags in range(1, most + 1):
        left = factor[lags * (u + y) :]
        error = (left.T @ left + np.diag(floor)) / len(past)
        scores.append(len(past) * np.linalg.slogdet(error)[1] + 2.0 * lags * y * (u + y))
    return 1 + int(np.argmin(scores))


def triangle(columns: FloatArray) -> FloatArray:
    """Upper triangular factor of a tall matrix, which keeps all products of its columns."""
    return np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)


def _rows(records: Sequence[TimeData], lags: int, first: int) -> tuple[FloatArray, FloatArray]:
    """Regressors, newest past first and the present inputs last, and outputs, a row for each sample."""
    regressors, outputs = [], []
    for record in records:
        both = np.vstack([record.outputs, record.inputs])
        past = [both[:, first - lag : record.samples - lag] for lag in range(1, lags + 1)]
        regressors.append(np.vstack([*past, record.inputs[:, first:]]).T)
        outputs.append(record.outputs[:, first:].T)
    return np.vstack(regressors), np.vstack(outputs)
