"""What a prediction may adjust because no model can know it: reference shifts, the initial state, steady biases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.typing import BoolArray, FloatArray
from rotorid.verify.bounded import BoundedResponses

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
    biases
        Constant in each state equation, shape ``(x,)``; 0 where the data do not show it, and for an equation without
        dynamics.
    """

    response: FloatArray
    shifts: FloatArray
    biases: FloatArray

    def __post_init__(self) -> None:
        self._set(
            response=read_only(self.response, np.float64, ndim=2),
            shifts=read_only(self.shifts, np.float64, ndim=1),
            biases=read_only(self.biases, np.float64, ndim=1),
        )


def adjust(
    responses: BoundedResponses,
    residual: FloatArray,
    *,
    weights: FloatArray,
    filtered: Callable[[FloatArray], FloatArray],
) -> Adjustment:
    r"""Explain what the forced response leaves over by shifts, initial states and biases, by weighted least squares.

    .. math:: y - y_{model}(u) \approx c + \Phi(t) x_0 + \sum_i b_i \Psi_i(t)

    Often some look alike: of a damped rate a steady torque ends in a steady rate, as a shifted sensor shows it,
    and without damping a steady force is a shifted accelerometer. Then the first of shifts, initial states and biases
    takes the whole effect and the later ones are zero, so the coefficients are a description and no measurement of the
    sensor or the wind. The response is the same whichever takes it. A bias of its own is seen where its equation leads
    into an integration, as a steady force on an undamped velocity does. What a high-pass filter removes is not
    estimated: a tiny remainder of a ramp would otherwise explain anything, with an enormous coefficient.

    Parameters
    ----------
    responses
        The model's response to each unknown.
    residual
        Filtered measurement minus filtered forced response, shape ``(y, samples)``.
    weights
        One over the size of each output, shape ``(y,)``, so that outputs of different units count alike.
    filtered
        The filter that measurement and forced response have passed, for arrays ``(..., samples)``.
    """
    outputs, samples = residual.shape
    shifts = np.kron(np.eye(outputs), np.ones(samples)).reshape(outputs, outputs, samples)
    whole = np.concatenate([shifts, responses.free, responses.biased])
    columns = filtered(whole)
    weighted = (columns * weights[:, None]).reshape(len(whole), -1)
    seen = told_apart(weighted, np.linalg.norm((whole * weights[:, None]).reshape(len(whole), -1), axis=1))
    coefficients = np.zeros(len(whole))
    if seen.any():
        scale = np.linalg.norm(weighted[seen], axis=1)
        target = (residual * weights[:, None]).ravel()
        coefficients[seen] = np.linalg.lstsq((weighted[seen] / scale[:, None]).T, target, rcond=None)[0] / scale
    return Adjustment(
        response=np.tensordot(coefficients, columns, axes=1),
        shifts=coefficients[:outputs],
        biases=coefficients[outputs + len(responses.free) :],
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
