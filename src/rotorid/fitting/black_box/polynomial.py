r"""Discrete polynomial models with one output, rational in the shift.

.. math:: y_k = \sum_j \frac{B_j(q)}{F(q)} u_{j,k}, \qquad F = 1 + f_1 q^{-1} + \dots, \quad
    B_j = (b_{j,0} + b_{j,1} q^{-1} + \dots) q^{-n_j}

With the error at the output, :math:`+ e_k`, they are fitted by Levenberg and Marquardt with the exact gradient, which
filters give:

.. math:: \frac{\partial \hat y}{\partial b_{j,i}} = \frac{q^{-n_j - i}}{F} u_j, \qquad
    \frac{\partial \hat y}{\partial f_i} = - \frac{q^{-i}}{F} \hat y

ARX models, :math:`A(q) y_k = \sum_j B_j(q) u_{j,k} + e_k`, take linear least squares, and are here for comparison:
their noise passes through the poles of the system, and where it does not, the poles are biased towards those of the
noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.display import counted
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.time.output_error import TimeData
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True)
class PolynomialOrders:
    """Orders of a polynomial model.

    Parameters
    ----------
    denominator
        Coefficients after the leading one.
    numerators
        Coefficients for each input.
    delays
        Samples by which each input acts late; one for each input.
    """

    denominator: int
    numerators: tuple[int, ...]
    delays: tuple[int, ...]

    def __post_init__(self) -> None:
        if self.denominator < 0 or min(self.numerators, default=0) < 1 or min(self.delays, default=0) < 0:
            raise UsageError(f"invalid orders {self}", needed="at least one coefficient for each input")
        if len(self.numerators) != len(self.delays):
            raise UsageError(f"{counted(len(self.numerators), 'numerator')} but {counted(len(self.delays), 'delay')}")

    @property
    def coefficients(self) -> int:
        return self.denominator + sum(self.numerators)

    @property
    def first(self) -> int:
        """The first sample whose whole past is known."""
        ages = [delay + count - 1 for delay, count in zip(self.delays, self.numerators, strict=True)]
        return max(self.denominator, *ages)

    def check(self, records: Sequence[TimeData]) -> None:
        """Refuse records that do not suit.

        Raises
        ------
        UsageError
            They have other inputs than the orders, or more than one output.
        InsufficientDataError
            They are too short.
        """
        if not records:
            raise UsageError("no records were given", needed="at least one")
        for record in records:
            if (len(record.inputs), len(record.outputs)) != (len(self.numerators), 1):
                raise UsageError(
                    f"{record.name} has {len(record.inputs)} inputs and {len(record.outputs)} outputs",
                    needed=f"{len(self.numerators)} inputs and one output",
                )
        usable = sum(max(record.samples - self.first, 0) for record in records)
        if usable <= self.coefficients:
            raise InsufficientDataError(f"{usable} usable samples are too few", needed=f"more than {self.coefficients}")


@dataclass(frozen=True, kw_only=True, eq=False)
class PolynomialModel(Immutable):
    """A polynomial model and how well its coefficients are known.

    Parameters
    ----------
    denominator
        With its leading one, shape ``(n + 1,)``.
    numerators
        For each input, beginning with the zeros of its delay.
    covariance
        Of the coefficients that were estimated, denominator first; empty where they were given.
    noise_variance
        Of the equation error (ARX) or the output error.
    """

    denominator: FloatArray
    numerators: tuple[FloatArray, ...]
    covariance: FloatArray
    noise_variance: float = 0.0

    def __post_init__(self) -> None:
        self._set(
            denominator=read_only(self.denominator, np.float64, ndim=1),
            numerators=tuple(read_only(numerator, np.float64, ndim=1) for numerator in self.numerators),
            covariance=read_only(self.covariance, np.float64, ndim=2),
        )
        if self.denominator.size == 0 or self.denominator[0] != 1.0:
            raise UsageError("the denominator does not start with 1", needed="1, f1, f2, ...")

    @classmethod
    def given(cls, denominator: Sequence[float], numerators: Sequence[Sequence[float]]) -> PolynomialModel:
        """A model with coefficients from elsewhere, delays as leading zeros."""
        arrays = tuple(np.asarray(numerator, dtype=np.float64) for numerator in numerators)
        none = np.zeros((0, 0))
        return cls(denominator=np.asarray(denominator, dtype=np.float64), numerators=arrays, covariance=none)

    @classmethod
    def of(
        cls, coefficients: FloatArray, orders: PolynomialOrders, covariance: FloatArray, noise_variance: float
    ) -> PolynomialModel:
        """A model from its coefficients, denominator first."""
        ends = np.cumsum([orders.denominator, *orders.numerators])
        parts = np.split(coefficients, ends[:-1])
        return cls(
            denominator=np.concatenate([[1.0], parts[0]]),
            numerators=tuple(np.concatenate([np.zeros(n), b]) for n, b in zip(orders.delays, parts[1:], strict=True)),
            covariance=covariance,
            noise_variance=noise_variance,
        )

    def simulate(self, inputs: FloatArray) -> FloatArray:
        """The output from zero initial state, without noise, shape ``(n,)``, for inputs ``(u, n)``.

        Examples
        --------
        >>> PolynomialModel.given([1.0, -0.5], [[0.0, 1.0]]).simulate(np.ones((1, 4)))
        array([0.  , 1.  , 1.5 , 1.75])
        """
        from scipy.signal import lfilter

        if len(inputs) != len(self.numerators):
            raise UsageError(counted(len(inputs), "input"), needed=f"{len(self.numerators)}")
        driven = sum(
            (lfilter(b, [1.0], u) for b, u in zip(self.numerators, inputs, strict=True)), np.zeros(inputs.shape[1])
        )
        return np.asarray(lfilter([1.0], self.denominator, driven), dtype=np.float64)

    @property
    def stable(self) -> bool:
        return bool(np.all(np.abs(np.roots(self.denominator)) < 1.0))


def fit_arx(records: Sequence[TimeData], orders: PolynomialOrders, *, offset: bool = False) -> PolynomialModel:
    r"""Least squares of the equation error over several records, each from its first sample with a whole past.

    The covariance is :math:`\sigma^2 (\Phi^T \Phi)^{-1}`, right where the equation error is white.

    Parameters
    ----------
    records
        One output; inputs and output as differences from a trim.
    orders
        Coefficients and delays.
    offset
        Whether each record has a constant of its own, which is estimated beside the coefficients.

    Raises
    ------
    UsageError
        The records have other inputs than the orders, or more than one output.
    InsufficientDataError
        They hold fewer samples than there are coefficients.

    References
    ----------
    L. Ljung, *System Identification: Theory for the User*, second edition, section 7.3.

    Examples
    --------
    >>> u = np.random.default_rng(0).standard_normal((1, 100))
    >>> y = PolynomialModel.given([1.0, -0.8], [[0.0, 0.5]]).simulate(u)[None]
    >>> record = TimeData(name="lag", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> fit_arx([record], PolynomialOrders(denominator=1, numerators=(1,), delays=(1,))).denominator.round(9).tolist()
    [1.0, -0.8]
    """
    orders.check(records)
    blocks = [(regressors(record, orders), record.outputs[0, orders.first :]) for record in records]
    if offset:
        blocks = [(columns - columns.mean(axis=0), values - values.mean()) for columns, values in blocks]
    phi, y = np.vstack([columns for columns, _ in blocks]), np.concatenate([values for _, values in blocks])
    size = np.linalg.norm(phi, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    found, _, _, _ = np.linalg.lstsq(phi / size, y, rcond=None)
    coefficients = np.asarray(found / size, dtype=np.float64)
    error = y - phi @ coefficients
    variance = float(error @ error) / (y.size - orders.coefficients - offset * len(records))
    covariance = variance * np.linalg.pinv((phi / size).T @ (phi / size)) / np.outer(size, size)
    return PolynomialModel.of(coefficients, orders, np.asarray(covariance, dtype=np.float64), variance)


def regressors(record: TimeData, orders: PolynomialOrders, past: FloatArray | None = None) -> FloatArray:
    """Factors of each coefficient, shape ``(samples - first, coefficients)``, denominator first.

    Parameters
    ----------
    record
        Inputs and output.
    orders
        Coefficients and delays.
    past
        What stands for the past outputs, shape ``(n,)``, the measured ones by default; instruments stand there.
    """
    first, samples = orders.first, record.samples
    y = record.outputs[0] if past is None else past
    columns = [-y[first - lag : samples - lag] for lag in range(1, orders.denominator + 1)]
    for u, count, delay in zip(record.inputs, orders.numerators, orders.delays, strict=True):
        columns += [u[first - delay - lag : samples - delay - lag] for lag in range(count)]
    return np.column_stack(columns)


_ROUNDS = 20
_AT_REST = 1e-8


def fit_polynomial_output_error(
    records: Sequence[TimeData],
    orders: PolynomialOrders,
    *,
    offset: bool = False,
    solver: LevenbergMarquardt | None = None,
) -> PolynomialModel:
    """Minimize the error of the simulation from zero initial state over several records.

    The starts are an ARX model, instrumental variables made from it, and the iterations of Steiglitz and McBride; the
    best end counts. The covariance is right where the output error is white; the values are unbiased where it does not
    depend on the inputs.

    Parameters
    ----------
    records
        One output; inputs and output as differences from a trim.
    orders
        Coefficients and delays.
    offset
        Whether the output of each record has a constant of its own, which is estimated beside the coefficients: then
        the variance of the error is minimized, and not its mean square.
    solver
        Local solver.

    Raises
    ------
    UsageError
        The records have other inputs than the orders, or more than one output.
    InsufficientDataError
        They hold fewer samples than there are coefficients, or no start is stable.

    References
    ----------
    L. Ljung, *System Identification: Theory for the User*, second edition, sections 7.6 and 10.2.
    K. Steiglitz and L. McBride, *A technique for the identification of linear systems*, IEEE Transactions on Automatic
    Control, 1965.

    Examples
    --------
    >>> u = np.random.default_rng(0).standard_normal((1, 200))
    >>> y = PolynomialModel.given([1.0, -0.8], [[0.0, 0.5]]).simulate(u)[None]
    >>> record = TimeData(name="lag", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> orders = PolynomialOrders(denominator=1, numerators=(1,), delays=(1,))
    >>> fit_polynomial_output_error([record], orders).denominator.round(9).tolist()
    [1.0, -0.8]
    """
    orders.check(records)
    solver = solver or LevenbergMarquardt()
    far = np.full(orders.coefficients, np.inf)

    def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _residuals(theta, records, orders, offset=offset)

    ends = [solver.minimize(residuals, start, -far, far) for start in _starts(records, orders, offset=offset)]
    best = min(ends, key=lambda end: end.cost, default=None)
    if best is None or not np.isfinite(best.cost):
        raise InsufficientDataError(
            "no starting point of the output-error model is stable", remedy="use lower orders or another delay"
        )
    variance = best.cost / (best.residual.size - orders.coefficients - offset * len(records))
    covariance = variance * np.linalg.pinv(best.jacobian.T @ best.jacobian, hermitian=True)
    return PolynomialModel.of(best.theta, orders, np.asarray(covariance, dtype=np.float64), variance)


def _residuals(
    theta: FloatArray, records: Sequence[TimeData], orders: PolynomialOrders, *, offset: bool
) -> tuple[FloatArray, FloatArray]:
    """Measured minus simulated, shape ``(samples,)``, and its Jacobian; not a number where the model is unstable."""
    model = _model(theta, orders)
    samples = sum(record.samples for record in records)
    if not model.stable:
        return np.full(samples, np.nan), np.full((samples, theta.size), np.nan)
    parts = [_slopes(model, record, orders) for record in records]
    errors = [record.outputs[0] - y for record, (y, _) in zip(records, parts, strict=True)]
    slopes = [columns for _, columns in parts]
    if offset:
        # The best constant of a record takes the mean away, and so does its share in every derivative.
        errors = [error - error.mean() for error in errors]
        slopes = [columns - columns.mean(axis=0) for columns in slopes]
    return np.concatenate(errors), -np.vstack(slopes)


def _slopes(model: PolynomialModel, record: TimeData, orders: PolynomialOrders) -> tuple[FloatArray, FloatArray]:
    """The simulated output ``(n,)`` and its derivatives ``(n, coefficients)``."""
    from scipy.signal import lfilter

    y = model.simulate(record.inputs)
    moved = -lfilter([1.0], model.denominator, y)
    columns = [_late(moved, lag) for lag in range(1, orders.denominator + 1)]
    for u, count, delay in zip(record.inputs, orders.numerators, orders.delays, strict=True):
        filtered = lfilter([1.0], model.denominator, u)
        columns += [_late(filtered, delay + lag) for lag in range(count)]
    return y, np.column_stack(columns)


def _late(values: FloatArray, samples: int) -> FloatArray:
    return np.concatenate([np.zeros(samples), values[: values.size - samples]])


def _model(theta: FloatArray, orders: PolynomialOrders) -> PolynomialModel:
    return PolynomialModel.of(theta, orders, np.zeros((0, 0)), 0.0)


def _coefficients(model: PolynomialModel, orders: PolynomialOrders) -> FloatArray:
    numerators = [b[delay:] for b, delay in zip(model.numerators, orders.delays, strict=True)]
    return np.concatenate([model.denominator[1:], *numerators])


def _starts(records: Sequence[TimeData], orders: PolynomialOrders, *, offset: bool) -> list[FloatArray]:
    """Coefficients of stable models, ARX first."""
    if offset:
        records = [_centered(record) for record in records]
    regression = _inside(fit_arx(records, orders))
    found = [regression, _inside(_instrumented(records, orders, regression)), _filtered(records, orders, regression)]
    return [_coefficients(model, orders) for model in found]


def _centered(record: TimeData) -> TimeData:
    inputs, outputs = (values - values.mean(axis=1, keepdims=True) for values in (record.inputs, record.outputs))
    return TimeData(name=record.name, inputs=inputs, outputs=outputs, sample_rate_hz=record.sample_rate_hz)


def _inside(model: PolynomialModel) -> PolynomialModel:
    """The same model with poles outside the unit circle mirrored into it."""
    if model.stable:
        return model
    poles = np.roots(model.denominator)
    poles = np.where(np.abs(poles) > 1.0, 1.0 / np.conj(poles), poles)
    return replace(model, denominator=np.asarray(np.poly(poles).real, dtype=np.float64))


def _instrumented(
    records: Sequence[TimeData], orders: PolynomialOrders, regression: PolynomialModel
) -> PolynomialModel:
    """Instrumental variables: past outputs replaced by simulated ones, which do not know the noise."""
    products = np.zeros((orders.coefficients, orders.coefficients))
    right = np.zeros(orders.coefficients)
    for record in records:
        instruments = regressors(record, orders, regression.simulate(record.inputs))
        products += instruments.T @ regressors(record, orders)
        right += instruments.T @ record.outputs[0, orders.first :]
    return _model(np.asarray(np.linalg.lstsq(products, right, rcond=None)[0], dtype=np.float64), orders)


def _filtered(records: Sequence[TimeData], orders: PolynomialOrders, start: PolynomialModel) -> PolynomialModel:
    """ARX models of records filtered by the previous denominator, until it converges; the best of them."""
    from scipy.signal import lfilter

    model, best = start, start
    lowest = _error(start, records)
    for _ in range(_ROUNDS):
        passed = [
            TimeData(
                name=record.name,
                inputs=lfilter([1.0], model.denominator, record.inputs, axis=1),
                outputs=lfilter([1.0], model.denominator, record.outputs, axis=1),
                sample_rate_hz=record.sample_rate_hz,
            )
            for record in records
        ]
        following = _inside(fit_arx(passed, orders))
        moved = np.abs(following.denominator - model.denominator).max()
        model, error = following, _error(following, records)
        if error < lowest:
            best, lowest = model, error
        if moved < _AT_REST:
            break
    return best


def _error(model: PolynomialModel, records: Sequence[TimeData]) -> float:
    return float(sum(np.sum((record.outputs[0] - model.simulate(record.inputs)) ** 2) for record in records))
