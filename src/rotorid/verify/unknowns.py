"""What a prediction may adjust because no model can know it: reference shifts, the initial state, a steady bias."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.models.state_space import StateSpace
from rotorid.simulate.linear import simulate_linear
from rotorid.typing import BoolArray, FloatArray

LEAST_REMAINDER = 1e-3
"""Share of a column that must survive the filter, and the columns before it, for the column to be estimated."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjustment(Immutable):
    """What was added to the response of a model, and with which coefficients.

    Parameters
    ----------
    response
        Shape ``(y, samples)``, filtered like the measurement.
    shifts
        Constant offset of each output, shape ``(y,)``; 0 where the data do not show it.
    bias
        Constant input to the first dynamic state equation; 0 where the data do not show it.
    """

    response: FloatArray
    shifts: FloatArray
    bias: float

    def __post_init__(self) -> None:
        self._set(
            response=read_only(self.response, np.float64, ndim=2), shifts=read_only(self.shifts, np.float64, ndim=1)
        )


def adjust(
    system: StateSpace,
    residual: FloatArray,
    *,
    sample_rate_hz: float,
    band_pass: Callable[[FloatArray], FloatArray],
) -> Adjustment:
    r"""Explain what the forced response leaves over by shifts, initial states and a bias, by least squares.

    .. math:: y - y_{model}(u) \approx c + \Phi(t) x_0 + \Psi(t) b

    Often two of these look alike: of a damped rate a steady torque ends in a steady rate, as a shifted sensor shows it,
    and without damping a steady force is a shifted accelerometer. Then the first of shifts, initial states and bias
    takes the whole effect and the later ones are zero, so the coefficients are a description and no measurement of the
    sensor or the wind. The response is the same whichever takes it. What a high-pass filter removes is not estimated:
    a tiny remainder of a ramp would otherwise explain anything, with an enormous coefficient.

    Parameters
    ----------
    system
        The identified system.
    residual
        Filtered measurement minus filtered forced response, shape ``(y, samples)``.
    sample_rate_hz
        Rate of the residual.
    band_pass
        The filter that measurement and forced response have passed, for arrays of shape ``(y, samples)``.
    """
    outputs, samples = residual.shape
    shifts = np.kron(np.eye(outputs), np.ones(samples)).reshape(outputs, outputs, samples)
    whole = np.concatenate([shifts, _free_responses(system, samples, sample_rate_hz)])
    filtered = np.stack([band_pass(column) for column in whole]).reshape(len(whole), -1)
    seen = told_apart(filtered, np.linalg.norm(whole.reshape(len(whole), -1), axis=1))
    coefficients = np.zeros(len(whole))
    if seen.any():
        scale = np.linalg.norm(filtered[seen], axis=1)
        coefficients[seen] = np.linalg.lstsq((filtered[seen] / scale[:, None]).T, residual.ravel())[0] / scale
    return Adjustment(
        response=(coefficients @ filtered).reshape(residual.shape),
        shifts=coefficients[:outputs],
        bias=float(coefficients[-1]),
    )


def told_apart(columns: FloatArray, whole: FloatArray) -> BoolArray:
    """Columns that a filter leaves and that differ from those kept before them, shape ``(k,)``.

    Parameters
    ----------
    columns
        Filtered columns, shape ``(k, n)``; the first ones go before the last ones.
    whole
        Norms before the filter, shape ``(k,)``.

    Examples
    --------
    >>> told_apart(np.array([[1.0, 1.0], [2.0, 2.0], [1e-6, 0.0], [0.0, 1.0]]), np.array([1.0, 3.0, 1.0, 1.0]))
    array([ True, False, False,  True])
    """
    kept = np.zeros(len(columns), dtype=bool)
    basis = np.zeros((0, columns.shape[1]))
    for index, column in enumerate(columns):
        size = float(np.linalg.norm(column))
        rest = column - basis.T @ (basis @ column)
        # Once more, because the first projection leaves a rounding error along the basis.
        rest = rest - basis.T @ (basis @ rest)
        remainder = float(np.linalg.norm(rest))
        if size > LEAST_REMAINDER * whole[index] and remainder > LEAST_REMAINDER * size:
            kept[index] = True
            basis = np.vstack([basis, rest / remainder])
    return kept


def _free_responses(system: StateSpace, samples: int, rate_hz: float) -> FloatArray:
    """Responses ``(k, y, n)`` to each initial state, and last to a constant bias of the first dynamic state."""
    quiet = np.zeros((system.G.shape[1], samples))
    states = np.eye(system.F.shape[0])
    dynamic = np.flatnonzero(np.abs(system.M).sum(axis=1) > 0.0)
    free = [simulate_linear(system, quiet, sample_rate_hz=rate_hz, x0=states[state]) for state in dynamic]
    return np.stack([*free, simulate_linear(system, quiet, sample_rate_hz=rate_hz, bias=states[dynamic[0]])])
