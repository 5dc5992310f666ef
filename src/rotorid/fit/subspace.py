r"""Subspace identification: a state space of an order from records, without a search and without start values.

.. math:: x_{k+1} = A x_k + B u_k + K e_k, \qquad y_k = C x_k + D u_k + e_k

Three published ways to the range of the observability matrix, all with one singular value decomposition:

- ``moesp``: future outputs, future inputs projected out, on past outputs and inputs (Verhaegen, *Identification of the
  deterministic part of MIMO state space models*, Automatica, 1994; PO-MOESP);
- ``cva``: the same, weighted by what remains unpredicted, so that singular values are canonical correlations (Larimore,
  *Canonical variate analysis in identification, filtering and adaptive control*, 1990);
- ``predictor``: from the coefficients of a long regression (Chiuso, *The role of vector autoregressive modeling in
  predictor-based subspace identification*, Automatica, 2007; PBSID-opt). The first two are biased under feedback,
  because the future inputs that they project out know the noise; this one is not.

The first two take B, D and the initial states from the simulated output, the third from the predicted one; all are
linear in them. None of the three minimizes anything that has to do with the model's use: they are starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fit.high_order_predictor import predictor_lags, triangle
from rotorid.fit.state_space_gains import innovation_gain, predicted_gains, simulated_gains, stable
from rotorid.fit.subspace_predictor import predicted_states, stacked
from rotorid.fit.time_data import TimeData
from rotorid.typing import FloatArray

Subspace: TypeAlias = Literal["moesp", "cva", "predictor"]

_MOST_LAGS = 40
_RELATIVE_FLOOR = 1e-7


@dataclass(frozen=True, kw_only=True, eq=False)
class SubspaceModel(Immutable):
    """A discrete state space, with the order's evidence.

    Parameters
    ----------
    A, B, C, D, K
        Shapes ``(x, x)``, ``(x, u)``, ``(y, x)``, ``(y, u)``, ``(x, y)``.
    initial_states
        Of each record, shape ``(records, x)``.
    singular_values
        All of them, largest first: those of the state stand out.
    horizon
        Samples of past and future that were used.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray
    initial_states: FloatArray
    singular_values: FloatArray
    horizon: int

    def __post_init__(self) -> None:
        names = ("A", "B", "C", "D", "K", "initial_states")
        arrays = {name: read_only(getattr(self, name), np.float64, ndim=2) for name in names}
        self._set(**arrays, singular_values=read_only(self.singular_values, np.float64, ndim=1))


def fit_subspace(
    records: Sequence[TimeData],
    order: int,
    *,
    method: Subspace = "cva",
    horizon: int | None = None,
    feedthrough: bool = False,
) -> SubspaceModel:
    """A state space of an order from records that share their sample rate.

    Parameters
    ----------
    records
        Inputs and outputs as differences from a trim; offsets would become slow modes.
    order
        Number of states.
    method
        ``cva`` or ``moesp`` for records without feedback, ``predictor`` where a controller was at work.
    horizon
        Samples of past and future; by default twice the number of lags that Akaike's criterion takes for a long
        regression, within what the order needs and the records allow (Bauer, *Asymptotic properties of subspace
        estimators*, Automatica, 2005).
    feedthrough
        Whether inputs act on outputs within the same sample.

    Raises
    ------
    UsageError
        The records do not go together, or the method or the order does not exist.
    InsufficientDataError
        The records are too short for this order.

    Examples
    --------
    >>> u = np.random.default_rng(0).standard_normal((1, 200))
    >>> y = np.zeros((1, 200))
    >>> for k in range(199):
    ...     y[0, k + 1] = 0.8 * y[0, k] + 0.5 * u[0, k]
    >>> record = TimeData(name="lag", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> model = fit_subspace([record], 1)
    >>> round(float(model.A[0, 0]), 9), round(float((model.C @ model.B)[0, 0]), 9)
    (0.8, 0.5)
    """
    _check(records, order, method)
    scaled, sizes_u, sizes_y = _scaled(records)
    horizon = _horizon(scaled, order) if horizon is None else horizon
    outputs, direct = len(sizes_y), len(sizes_u) if feedthrough else 0
    if (horizon - 1) * outputs < order:
        raise UsageError(f"a horizon of {horizon} samples came", needed=f"one that shows {order} states")
    if method == "predictor":
        found = predicted_states(scaled, order, horizon, feedthrough=feedthrough)
        A, C, values = found.A, found.C, found.singular_values
        A, K, gains = predicted_gains(A, C, found.K, scaled, direct=direct)
    else:
        observed, values = _observed(scaled, horizon, weighted=method == "cva")
        A, C = _shift_invariant(observed[:, :order], outputs)
        gains = simulated_gains(A, C, scaled, direct=direct)
        K = innovation_gain(A, C, gains, scaled, lags=horizon)
    return SubspaceModel(
        A=A,
        B=gains.B / sizes_u,
        C=sizes_y[:, None] * C,
        D=sizes_y[:, None] * gains.D / sizes_u,
        K=K / sizes_y,
        initial_states=gains.initial_states,
        singular_values=values,
        horizon=horizon,
    )


def _check(records: Sequence[TimeData], order: int, method: str) -> None:
    if method not in get_args(Subspace):
        raise UsageError(f"the subspace method {method!r} came", needed=f"one of {', '.join(get_args(Subspace))}")
    if order < 1:
        raise UsageError(f"a state space of order {order} was asked for", needed="at least one state")
    if not records:
        raise UsageError("no record came", needed="at least one")
    shapes = {(len(record.inputs), len(record.outputs), record.sample_rate_hz) for record in records}
    if len(shapes) > 1:
        raise UsageError("the records have different channels or rates", needed="one rate and the same channels")


def _scaled(records: Sequence[TimeData]) -> tuple[list[TimeData], FloatArray, FloatArray]:
    """Records with channels of size one, and the sizes."""
    sizes = []
    for name in ("inputs", "outputs"):
        size = np.sqrt(np.mean(np.hstack([getattr(record, name) for record in records]) ** 2, axis=1))
        sizes.append(np.where(size > 0.0, size, 1.0))
    u, y = sizes
    scaled = [
        TimeData(
            name=one.name,
            inputs=one.inputs / u[:, None],
            outputs=one.outputs / y[:, None],
            sample_rate_hz=one.sample_rate_hz,
        )
        for one in records
    ]
    return scaled, u, y


def _horizon(records: Sequence[TimeData], order: int) -> int:
    u, y = len(records[0].inputs), len(records[0].outputs)
    needed = -(-order // y) + 1
    lags = max(2 * predictor_lags(records, most=_MOST_LAGS // 2), needed + 1)
    # The stacked past and future must have more columns than rows, and some to spare against the noise.
    room = min(record.samples for record in records) // 4
    allowed = min(room, sum(record.samples for record in records) // (6 * (u + y)))
    if allowed < needed:
        raise InsufficientDataError(f"records of {room * 4} samples came for order {order}", needed="longer records")
    return min(lags, allowed)


def _observed(records: Sequence[TimeData], horizon: int, *, weighted: bool) -> tuple[FloatArray, FloatArray]:
    """Observability matrix by projection on the past, future inputs taken out, shape ``(horizon * y, ...)``."""
    future_u = np.hstack([stacked(record.inputs[:, horizon:], horizon) for record in records])
    future_y = np.hstack([stacked(record.outputs[:, horizon:], horizon) for record in records])
    past = np.hstack(
        [
            stacked(np.vstack([record.outputs, record.inputs])[:, : record.samples - horizon], horizon)
            for record in records
        ]
    )
    rows = np.vstack([future_u, past, future_y])
    if rows.shape[1] < rows.shape[0]:
        raise InsufficientDataError(
            f"a horizon of {horizon} samples needs {rows.shape[0]} columns and there are {rows.shape[1]}",
            needed="longer records",
            remedy="take a shorter horizon",
        )
    L = triangle(rows.T).T
    start, stop = len(future_u), len(future_u) + len(past)
    predicted, left = L[stop:, start:stop], L[stop:, stop:]
    if not weighted:
        vectors, values, _ = np.linalg.svd(predicted, full_matrices=False)
        return vectors * np.sqrt(values), values
    basis, size, _ = np.linalg.svd(np.hstack([predicted, left]), full_matrices=False)
    size = np.maximum(size, _RELATIVE_FLOOR * size[0])
    vectors, values, _ = np.linalg.svd((basis.T @ predicted) / size[:, None], full_matrices=False)
    return basis @ (size[:, None] * vectors * np.sqrt(values)), values


def _shift_invariant(observed: FloatArray, outputs: int) -> tuple[FloatArray, FloatArray]:
    """A and C: the observability matrix without its first block is the one without its last, times A.

    Without feedback a record comes from a stable system, and modes that grow are mirrored into it.
    """
    A = np.linalg.lstsq(observed[:-outputs], observed[outputs:], rcond=None)[0]
    return stable(np.asarray(A, dtype=np.float64)), observed[:outputs].copy()
