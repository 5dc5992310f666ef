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

That regression of outputs on past outputs and inputs holds what can be predicted, whatever the noise and the feedback:

.. math:: y_k = \sum_{i=1}^{p} (\Phi_i y_{k-i} + \Psi_i u_{k-i}) + D u_k + e_k

With enough lags the residual is the innovation of the outputs, in open and in closed loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.time.output_error import TimeData
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
        """Prediction errors, shape ``(y, n)``; zero for the first samples, which have no past."""
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
            f"{len(columns)} samples are too few for {columns.shape[1]} predictor coefficients",
            needed="longer records",
            remedy="use a shorter horizon",
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
        raise InsufficientDataError(f"{samples} samples are too few for {u + y} channels", needed="longer records")
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
    pasts = [stacked(np.vstack([record.outputs, record.inputs])[:, :-1], horizon) for record in records]
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
        raise InsufficientDataError(
            f"{values.shape[1]} samples are too few for a horizon of {rows}", needed="longer records"
        )
    return np.vstack([values[:, row : row + count] for row in range(rows)])


def _equations(
    records: Sequence[TimeData], states: Sequence[FloatArray], horizon: int, *, feedthrough: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    order = len(states[0])
    u = np.hstack([record.inputs[:, horizon:] for record in records])
    y = np.hstack([record.outputs[:, horizon:] for record in records])
    present = np.hstack(states)
    regressors = np.vstack([present, u]) if feedthrough else present
    found = _regression(regressors, y)
    errors = y - found @ regressors
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
    r"""Gains that bring the one-step prediction closest to the measurement; returns A and K recomputed with them.

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
    driven = [_record(record, np.vstack([record.inputs, record.outputs]), record.outputs) for record in records]
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
    from rotorid.simulation.linear_kernels import recursion

    states = recursion(np.ascontiguousarray(A), np.ascontiguousarray((gains.B @ u).T), start.copy())
    return np.asarray(C @ states.T + gains.D @ u, dtype=np.float64)


def _forced(A: FloatArray, C: FloatArray, u: FloatArray, direct: int) -> FloatArray:
    """Outputs for a unit gain from each input into each state, and onto each output, shape ``(samples * y, gains)``."""
    from rotorid.simulation.linear_kernels import recursion

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
    from rotorid.simulation.linear_kernels import recursion

    still = np.zeros((samples, len(A)))
    starts = np.eye(len(A))
    return np.column_stack(
        [(recursion(np.ascontiguousarray(A), still, start.copy()) @ C.T).ravel() for start in starts]
    )


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
        raise UsageError(f"a horizon of {horizon} samples is too short", needed=f"one long enough for {order} states")
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
        raise UsageError(f"unknown subspace method {method!r}", needed=f"one of {', '.join(get_args(Subspace))}")
    if order < 1:
        raise UsageError(f"order {order} is not possible for a state space", needed="at least one state")
    if not records:
        raise UsageError("no records were given", needed="at least one")
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
            name=record.name,
            inputs=record.inputs / u[:, None],
            outputs=record.outputs / y[:, None],
            sample_rate_hz=record.sample_rate_hz,
        )
        for record in records
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
        raise InsufficientDataError(
            f"records of {room * 4} samples are too short for order {order}", needed="longer records"
        )
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
            f"a horizon of {horizon} samples needs {rows.shape[0]} columns, but there are {rows.shape[1]}",
            needed="longer records",
            remedy="use a shorter horizon",
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
