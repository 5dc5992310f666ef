r"""Linear regression as the field does it, and equations of motion as regressions, in time or over a band.

Columns are scaled and decomposed by QR, and the covariance knows colored residuals:

.. math:: y = X \theta + v, \qquad \hat\theta = (X^T X)^{-1} X^T y, \qquad
    \mathrm{PRESS} = \sum_i \left( \frac{v_i}{1 - h_{ii}} \right)^2

with the diagonal :math:`h_{ii}` of the hat matrix :math:`X (X^T X)^{-1} X^T`, the row lengths of Q. PRESS is the
squared error of predicting each sample by all others; it rises with every regressor that explains only noise.

Stepwise regression takes the terms that a model needs from many candidates, one after the other.

Over a band, finite Fourier transforms stand for the records, and for their derivatives without differentiating:

.. math:: \tilde x(\omega) = \int_0^T x(t) \, e^{-j\omega t} dt, \qquad
    \tilde{\dot x}(\omega) = j\omega \, \tilde x(\omega) + x(T) \, e^{-j\omega T} - x(0)

The terms of the ends are exact for records that do not repeat. Between samples a record goes straight (E. A. Morelli,
*High Accuracy Evaluation of the Finite Fourier Transform Using Sampled Data*, NASA TM-110340, 1997, goes on a cubic;
what the straight line loses, :math:`\mathrm{sinc}^2(\omega h / 2)`, all channels lose alike).

Each equation of motion is then a linear regression, in time or over the band:

.. math:: \dot x = \sum_k \theta_k \, r_k(t - \tau_k) \qquad \text{or} \qquad
    \tilde{\dot x}(\omega) = \sum_k \theta_k \, \tilde r_k(\omega) \, e^{-j\omega\tau_k}

In the band nothing is differentiated, noise outside of the band does not count, and a delay of any fraction of a sample
is a turn of the phase. In time, the derivative comes from a measured acceleration or from local parabolas. Either way
noise in the regressors pulls their estimates toward zero, by its share of their power: these are values to start from,
and quick answers to which terms matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import ComplexArray, FloatArray

if TYPE_CHECKING:
    from scipy.signal import CZT


CONSTANT = "constant"
"""Name of the regressor that is one everywhere."""

_DEPENDENT = 1e-10
_LONGEST_LAG_SHARE = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression(Immutable):
    """A regression with all numbers of a report.

    Parameters
    ----------
    names
        Regressors, one for each estimate.
    estimates
        Shape ``(p,)``, units of the target over those of the regressor.
    covariance
        Of the estimates for white residuals, shape ``(p, p)``.
    colored_covariance
        The same with the autocorrelation that the residuals have; ``covariance`` where nothing is known of their order.
    residual
        Target minus fit, shape ``(n,)``.
    r_squared
        Share of the target that is explained: of its variation about its mean where there is a constant, of its mean
        square otherwise.
    press
        Sum of squared errors of predicting each sample by all others.
    """

    names: tuple[str, ...]
    estimates: FloatArray
    covariance: FloatArray
    colored_covariance: FloatArray
    residual: FloatArray
    r_squared: float
    press: float

    def __post_init__(self) -> None:
        self._set(
            names=tuple(self.names),
            estimates=read_only(self.estimates, np.float64, ndim=1),
            covariance=read_only(self.covariance, np.float64, ndim=2),
            colored_covariance=read_only(self.colored_covariance, np.float64, ndim=2),
            residual=read_only(self.residual, np.float64, ndim=1),
        )

    @property
    def std(self) -> FloatArray:
        """Standard errors for colored residuals, shape ``(p,)``."""
        return np.asarray(np.sqrt(np.diag(self.colored_covariance)))

    @property
    def t_values(self) -> FloatArray:
        """Estimates in standard errors for white residuals, shape ``(p,)``; their squares are the partial F values."""
        spread = np.sqrt(np.diag(self.covariance))
        ratio = np.divide(self.estimates, spread, out=np.full(spread.size, np.inf), where=spread > 0.0)
        return np.asarray(ratio, dtype=np.float64)

    @property
    def partial_f(self) -> FloatArray:
        r"""Cost of leaving out each regressor, in units of the residual variance, shape ``(p,)``.

        :math:`F_j = (SSE_{-j} - SSE) / s^2 = t_j^2`.
        """
        return np.asarray(self.t_values**2)

    @property
    def residual_variance(self) -> float:
        """Unbiased variance of the residuals."""
        return float(self.residual @ self.residual / (self.residual.size - self.estimates.size))


def regress(
    regressors: FloatArray,
    target: FloatArray,
    names: Sequence[str],
    *,
    constant: bool = True,
    ordered: bool = True,
) -> Regression:
    """Least squares of a target on regressors.

    Assumes that the regressors are known exactly: noise in them pulls their estimates toward zero, by its share of
    their variance. Residuals may be colored.

    Parameters
    ----------
    regressors
        Shape ``(n, p)``.
    target
        Shape ``(n,)``.
    names
        One for each column.
    constant
        Add a regressor that is one everywhere, named ``constant``, as the last.
    ordered
        Whether rows follow each other in time, so that neighboring residuals may be alike.

    Raises
    ------
    UsageError
        Shapes do not match, or a number is not finite.
    InsufficientDataError
        There are no more samples than regressors, or a regressor is a combination of others.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, chapter 5.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1.0, 1.0, 50)
    >>> found = regress(np.stack([x, x**2], axis=1), 3.0 * x - 0.5, ["x", "x^2"])
    >>> found.estimates.round(6).tolist(), round(found.r_squared, 6)
    ([3.0, -0.0, -0.5], 1.0)
    """
    X, y, labels = _checked(regressors, target, names, constant)
    n, p = X.shape
    length = np.sqrt(np.sum(X**2, axis=0))
    if np.any(length == 0.0):
        raise _dependent(labels[int(np.argmin(length))])
    Q, R = np.linalg.qr(X / length)
    weak = np.abs(R.diagonal()) < _DEPENDENT
    if weak.any():
        raise _dependent(labels[int(np.argmax(weak))])
    inverse = np.linalg.inv(R) / length[:, None]
    estimates = inverse @ (Q.T @ y)
    residual = y - X @ estimates
    spread = inverse @ inverse.T
    variance = float(residual @ residual) / (n - p)
    centered = y - y.mean() if CONSTANT in labels else y
    total = float(centered @ centered)
    leverage = np.minimum(np.sum(Q**2, axis=1), 1.0 - 1e-12)
    return Regression(
        names=labels,
        estimates=estimates,
        covariance=variance * spread,
        colored_covariance=colored_covariance(X, residual, spread) if ordered else variance * spread,
        residual=residual,
        r_squared=1.0 - float(residual @ residual) / total if total > 0.0 else 0.0,
        press=float(np.sum((residual / (1.0 - leverage)) ** 2)),
    )


def colored_covariance(regressors: FloatArray, residual: FloatArray, inverse: FloatArray) -> FloatArray:
    r"""Covariance of least-squares estimates with residuals that resemble their neighbors.

    .. math:: \mathrm{Cov} = (X^T X)^{-1} \Big[ \sum_i x_i \sum_j \hat R_{vv}(i - j) \, x_j^T \Big] (X^T X)^{-1}

    Lags reach to a fifth of the record; the autocorrelation is tapered to zero there, so that the sum stays positive.

    Parameters
    ----------
    regressors
        X, shape ``(n, p)``, rows in order of time.
    residual
        Shape ``(n,)``.
    inverse
        :math:`(X^T X)^{-1}`, shape ``(p, p)``.

    Returns
    -------
    numpy.ndarray
        Shape ``(p, p)``.

    References
    ----------
    E. A. Morelli and V. Klein, *Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data*, Journal of
    Guidance, Control, and Dynamics, 1997.
    """
    n, p = regressors.shape
    lags = max(1, int(_LONGEST_LAG_SHARE * n))
    size = 2 * n
    power = np.abs(np.fft.rfft(residual, size)) ** 2
    correlation = np.fft.irfft(power, size)[:lags] / (n - p) * (1.0 - np.arange(lags) / lags)
    # The sum over j is a convolution, and a product of transforms.
    kernel = np.zeros(size)
    kernel[:lags] = correlation
    kernel[size - lags + 1 :] = correlation[:0:-1]
    spectrum = np.fft.rfft(kernel)[:, None]
    smoothed = np.fft.irfft(spectrum * np.fft.rfft(regressors, size, axis=0), size, axis=0)[:n]
    middle = regressors.T @ smoothed
    return np.asarray(inverse @ (0.5 * (middle + middle.T)) @ inverse)


def _checked(
    regressors: FloatArray, target: FloatArray, names: Sequence[str], constant: bool
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    X, y = np.asarray(regressors, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if X.ndim != 2 or y.shape != (X.shape[0],) or X.shape[1] != len(names):
        raise UsageError(
            f"regressors of shape {X.shape}, {len(names)} names and a target of shape {y.shape} do not match",
            needed="shapes (n, p), p and (n,)",
        )
    if not (np.isfinite(X).all() and np.isfinite(y).all()):
        raise UsageError("some samples are not finite", needed="finite samples", remedy="cut the data there")
    labels = tuple(names)
    if constant:
        X, labels = np.column_stack([X, np.ones(len(X))]), (*labels, CONSTANT)
    if len(set(labels)) < len(labels):
        raise UsageError(f"duplicate regressors among {', '.join(labels)}", needed="each name once")
    if X.shape[0] <= X.shape[1]:
        raise InsufficientDataError(f"{X.shape[0]} samples are too few", needed=f"more than {X.shape[1]}")
    return X, y, labels


def _dependent(name: str) -> InsufficientDataError:
    return InsufficientDataError(
        f"the regressor {name} is zero or a combination of the others",
        needed="regressors that the data can separate",
        remedy="leave it out, or excite the axes independently",
    )


Action: TypeAlias = Literal["start", "enter", "remove"]

F_TO_ENTER = 4.0
"""Partial F that a candidate must reach: two standard errors of white residuals."""

F_TO_REMOVE = 4.0
"""Partial F below which a term is taken out again; equal to that of entering at most, or steps would go in circles."""

_MOST_STEPS_PER_CANDIDATE = 4


@dataclass(frozen=True, kw_only=True)
class RegressionStep(Immutable):
    """One step of the search and what it left.

    Parameters
    ----------
    action, name
        What was done to which term.
    partial_f
        Partial F of that term: on entering in the model with it, on removal in the model before.
    names
        Terms of the model after the step.
    r_squared, press
        Of that model.
    """

    action: Action
    name: str
    partial_f: float
    names: tuple[str, ...]
    r_squared: float
    press: float


@dataclass(frozen=True, kw_only=True, eq=False)
class StepwiseRegression(Immutable):
    """The model that was chosen, and the way there.

    Parameters
    ----------
    regression
        The model of least PRESS on the way.
    steps
        All steps in order.
    chosen
        Index of the step after which that model stood.
    """

    regression: Regression
    steps: tuple[RegressionStep, ...]
    chosen: int


def stepwise(
    regressors: FloatArray,
    target: FloatArray,
    names: Sequence[str],
    *,
    keep: Sequence[str] = (),
    constant: bool = True,
    ordered: bool = True,
    f_to_enter: float = F_TO_ENTER,
    f_to_remove: float = F_TO_REMOVE,
) -> StepwiseRegression:
    r"""Enter and remove terms by their partial F; the model of least PRESS is the answer.

    In each step the candidate enters that correlates best with what is left, if its partial F reaches the limit; then
    every term whose partial F has fallen below the limit leaves, the weakest first. Models that stand after that count.

    .. math:: F_j = (SSE_{-j} - SSE_{+j}) / s_{+j}^2

    F values take residuals as white. Colored residuals make them too large, and noise in regressors lets terms enter
    that stand for others; PRESS guards against the first and not against the second.

    Parameters
    ----------
    regressors, target, names
        Candidates, shape ``(n, p)``, what they are to explain, shape ``(n,)``, and their names.
    keep
        Candidates that stand from the start and never leave.
    constant, ordered
        As in :func:`rotorid.fitting.equations.regression.regress`.
    f_to_enter, f_to_remove
        Limits of the partial F.

    Raises
    ------
    UsageError
        A name is unknown, or the limit of entering lies below that of removal.
    InsufficientDataError
        No term reaches the limit and nothing stands from the start.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, section 5.4.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> x = rng.normal(size=(200, 4))
    >>> found = stepwise(x, 2.0 * x[:, 2] - x[:, 0] + 0.1 * rng.normal(size=200), ["a", "b", "c", "d"])
    >>> [(step.action, step.name) for step in found.steps[: found.chosen + 1]]
    [('start', ''), ('enter', 'c'), ('enter', 'a')]
    """
    if f_to_enter < f_to_remove:
        raise UsageError(f"F to enter ({f_to_enter:g}) is below F to remove ({f_to_remove:g})")
    columns = {name: np.asarray(regressors, dtype=np.float64)[:, index] for index, name in enumerate(names)}
    if unknown := [name for name in keep if name not in columns]:
        raise UsageError(f"unknown candidate {unknown[0]}", needed=f"some of {', '.join(names)}")
    search = _Search(columns, np.asarray(target, dtype=np.float64), constant, ordered)
    terms = tuple(keep)
    met = [search.fit(terms)] if terms or constant else []
    steps = [_step("start", "", np.nan, terms, met[0])] if met else []
    settled = list(range(len(met)))
    for _ in range(_MOST_STEPS_PER_CANDIDATE * len(columns)):
        entering = search.best_entry(terms, met[-1] if met else None)
        if entering is None or entering[1] < f_to_enter:
            break
        name, strength, model = entering
        terms = (*terms, name)
        met.append(model)
        steps.append(_step("enter", name, strength, terms, model))
        while (weakest := _weakest(met[-1], keep)) is not None and weakest[1] < f_to_remove:
            terms = tuple(term for term in terms if term != weakest[0])
            met.append(search.fit(terms))
            steps.append(_step("remove", *weakest, terms, met[-1]))
        settled.append(len(met) - 1)
    if not met:
        raise InsufficientDataError(
            f"none of {', '.join(names)} reaches a partial F of {f_to_enter:g}",
            needed="a candidate that explains the target",
            remedy="lower the limit, or offer other candidates",
        )
    chosen = min(settled, key=lambda index: met[index].press)
    return StepwiseRegression(regression=met[chosen], steps=tuple(steps), chosen=chosen)


@dataclass(frozen=True)
class _Search:
    columns: dict[str, FloatArray]
    target: FloatArray
    constant: bool
    ordered: bool

    def fit(self, terms: tuple[str, ...]) -> Regression:
        matrix = np.stack([self.columns[name] for name in terms], axis=1) if terms else np.empty((self.target.size, 0))
        return regress(matrix, self.target, terms, constant=self.constant, ordered=self.ordered)

    def best_entry(self, terms: tuple[str, ...], present: Regression | None) -> tuple[str, float, Regression] | None:
        """The candidate that correlates best with what is left, its partial F, and the model with it."""
        left = self.target if present is None else present.residual
        others = {name: self._remainder(name, terms) for name in self.columns if name not in terms}
        usable = {name: column for name, column in others.items() if column is not None}
        if not usable or self.target.size <= len(terms) + 1 + self.constant:
            return None
        name = max(usable, key=lambda name: abs(float(usable[name] @ left)))
        model = self.fit((*terms, name))
        return name, float(model.partial_f[model.names.index(name)]), model

    def _remainder(self, name: str, terms: tuple[str, ...]) -> FloatArray | None:
        """Component of a candidate orthogonal to the terms, with unit length; ``None`` if there is none."""
        basis = [self.columns[term] for term in terms] + ([np.ones(self.target.size)] if self.constant else [])
        column, length = self.columns[name], float(np.linalg.norm(self.columns[name]))
        if basis:
            Q = np.linalg.qr(np.stack(basis, axis=1))[0]
            column = column - Q @ (Q.T @ column)
        rest = float(np.linalg.norm(column))
        return column / rest if rest > _SAME * length else None


_SAME = 1e-8


def _weakest(model: Regression, keep: Sequence[str]) -> tuple[str, float] | None:
    strengths = dict(zip(model.names, model.partial_f.tolist(), strict=True))
    free = [name for name in model.names if name not in keep and name != CONSTANT]
    if len(free) < 2:
        return None
    name = min(free, key=lambda name: strengths[name])
    return name, strengths[name]


def _step(action: Action, name: str, strength: float, terms: tuple[str, ...], model: Regression) -> RegressionStep:
    return RegressionStep(
        action=action,
        name=name,
        partial_f=strength,
        names=terms,
        r_squared=model.r_squared,
        press=model.press,
    )


_CACHED = 16
"""Sizes of records and bands whose chirps are kept: making them costs ten times as much as using them."""


def finite_transform(values: FloatArray, *, sample_rate_hz: float, omega_rad_s: FloatArray) -> ComplexArray:
    """Transform of samples over their own duration, time counted from the first of them.

    Parameters
    ----------
    values
        Shape ``(..., n)``.
    sample_rate_hz
        Their rate.
    omega_rad_s
        Shape ``(f,)``, above zero.

    Returns
    -------
    numpy.ndarray
        Shape ``(..., f)``, unit of the values times seconds.

    Examples
    --------
    >>> time_s = np.arange(0.0, 5.0005, 0.001)
    >>> omega = np.array([2.0, 7.0])
    >>> exact = (1.0 - np.exp(-(1.0 + 1j * omega) * 5.0)) / (1.0 + 1j * omega)
    >>> found = finite_transform(np.exp(-time_s), sample_rate_hz=1000.0, omega_rad_s=omega)
    >>> bool(np.abs(found / exact - 1.0).max() < 1e-5)
    True
    """
    omega = np.asarray(omega_rad_s, dtype=np.float64)
    step, count = 1.0 / sample_rate_hz, values.shape[-1]
    if _evenly_spaced(omega):
        turn, begin = np.exp(-1j * (omega[1] - omega[0]) * step), np.exp(1j * omega[0] * step)
        total = _chirp(count, omega.size, complex(turn), complex(begin))(values)
    else:
        total = values @ np.exp(-1j * step * np.outer(np.arange(count), omega))
    s = 1j * omega
    end = np.exp(-s * (count - 1) * step)
    # An inner sample has the weight of a whole hat function, an end sample half of it.
    hat = step * np.sinc(0.5 * omega * step / np.pi) ** 2
    half = 1.0 / s - (1.0 - np.exp(-s * step)) / (s**2 * step)
    first, last = values[..., :1], values[..., -1:]
    return np.asarray(hat * (total - first - last * end) + first * half + last * half.conj() * end)


def derivative_transform(values: FloatArray, *, sample_rate_hz: float, omega_rad_s: FloatArray) -> ComplexArray:
    """Transform of the derivative of samples; arguments and shape as for :func:`finite_transform`."""
    omega = np.asarray(omega_rad_s, dtype=np.float64)
    whole = finite_transform(values, sample_rate_hz=sample_rate_hz, omega_rad_s=omega)
    end = np.exp(-1j * omega * (values.shape[-1] - 1) / sample_rate_hz)
    return np.asarray(1j * omega * whole + values[..., -1:] * end - values[..., :1])


def late_transform(
    values: FloatArray, *, first: int, count: int, delay_s: float, sample_rate_hz: float, omega_rad_s: FloatArray
) -> ComplexArray:
    r"""Transform of a signal that comes late by any fraction of a sample, over a window inside its record.

    .. math:: \int_0^T x(t - \tau) \, e^{-j\omega t} dt = e^{-j\omega\tau}
        \int_{-\tau}^{T - \tau} x(t) \, e^{-j\omega t} dt

    Whole samples move the window; what is left of the delay, half a sample at most, turns the phase exactly and moves
    the ends of the window, over which the record goes straight.

    Parameters
    ----------
    values
        The whole record, shape ``(n,)``.
    first, count
        Window: its first sample and the number of samples in it. It must hold when moved by the delay.
    delay_s
        Above zero for a late signal.
    sample_rate_hz, omega_rad_s
        As for :func:`finite_transform`.
    """
    whole = round(delay_s * sample_rate_hz)
    rest_s = delay_s - whole / sample_rate_hz
    begin, omega = first - whole, np.asarray(omega_rad_s, dtype=np.float64)
    inside = finite_transform(values[begin : begin + count], sample_rate_hz=sample_rate_hz, omega_rad_s=omega)
    stamps = (np.arange(values.size) - begin) / sample_rate_hz
    duration_s = (count - 1) / sample_rate_hz
    ends = np.interp([-0.5 * rest_s, duration_s - 0.5 * rest_s], stamps, values)
    moved = rest_s * np.sinc(0.5 * omega * rest_s / np.pi)
    edge = ends[0] * np.exp(0.5j * omega * rest_s) - ends[1] * np.exp(-1j * omega * (duration_s - 0.5 * rest_s))
    return np.asarray((inside + moved * edge) * np.exp(-1j * omega * rest_s))


@lru_cache(maxsize=_CACHED)
def _chirp(count: int, lines: int, turn: complex, begin: complex) -> CZT:
    """Constants of a chirp transform that do not depend on the values; read-only."""
    from scipy.signal import CZT

    return CZT(count, lines, turn, begin)


def _evenly_spaced(omega: FloatArray) -> bool:
    return omega.size > 2 and bool(np.allclose(np.diff(omega), omega[1] - omega[0], rtol=1e-9, atol=0.0))


_LINES = 200
_SMOOTHING_S = 0.05


class Domain(Protocol):
    """Where an equation is compared: rows of numbers for a channel, its derivative, and a constant."""

    @property
    def ordered(self) -> bool:
        """Whether rows follow each other in time."""

    def level(self, history: TimeHistory, name: str, delay_s: float) -> FloatArray:
        """The channel, late by a delay, shape ``(n,)``."""

    def slope(self, history: TimeHistory, name: str) -> FloatArray:
        """Its derivative, shape ``(n,)``."""

    def constant_term(self, history: TimeHistory) -> FloatArray:
        """A constant, shape ``(n,)``."""


@dataclass(frozen=True, kw_only=True)
class InTime(Immutable):
    """Sample by sample.

    Parameters
    ----------
    smoothing_s
        Width of the local parabolas that give derivatives.
    longest_delay_s
        Samples left out at the start of each record, so that late regressors are known.
    """

    smoothing_s: float = _SMOOTHING_S
    longest_delay_s: float = 0.3
    ordered: bool = field(default=True, init=False)

    def level(self, history: TimeHistory, name: str, delay_s: float) -> FloatArray:
        """Samples, between them by straight lines."""
        index = np.arange(history.values.shape[1])
        late = np.interp(index - delay_s * history.sample_rate_hz, index, history[name])
        return np.asarray(late[self._kept(history)], dtype=np.float64)

    def slope(self, history: TimeHistory, name: str) -> FloatArray:
        """Slopes of parabolas through the samples around each."""
        from scipy.signal import savgol_filter

        width = 2 * max(1, round(0.5 * self.smoothing_s * history.sample_rate_hz)) + 1
        step_s = 1.0 / history.sample_rate_hz
        slopes = savgol_filter(history[name], max(width, 5), 2, deriv=1, delta=step_s)
        return np.asarray(slopes[self._kept(history)], dtype=np.float64)

    def constant_term(self, history: TimeHistory) -> FloatArray:
        """Ones."""
        return np.ones(history.values.shape[1])[self._kept(history)]

    def _kept(self, history: TimeHistory) -> slice:
        return slice(int(np.ceil(self.longest_delay_s * history.sample_rate_hz)), None)


@dataclass(frozen=True, kw_only=True)
class InBand(Immutable):
    """Finite Fourier transforms over a band, real parts and then imaginary ones.

    Parameters
    ----------
    longest_delay_s
        Start of each record that is left out, so that late regressors are known.
    """

    band_rad_s: tuple[float, float]
    longest_delay_s: float = 0.3
    ordered: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.band_rad_s[0] < self.band_rad_s[1] < np.inf:
            raise UsageError(f"the band {self.band_rad_s[0]:g}:{self.band_rad_s[1]:g} is empty", needed="0 < LO < HI")

    def level(self, history: TimeHistory, name: str, delay_s: float) -> FloatArray:
        """Transform of the channel, late by any fraction of a sample."""
        first, count = self._window(history)
        return _parts(
            late_transform(
                history[name],
                first=first,
                count=count,
                delay_s=delay_s,
                sample_rate_hz=history.sample_rate_hz,
                omega_rad_s=self._lines(history),
            )
        )

    def slope(self, history: TimeHistory, name: str) -> FloatArray:
        """Transform of the derivative, from that of the channel and its ends."""
        first, count = self._window(history)
        return _parts(
            derivative_transform(
                history[name][first : first + count],
                sample_rate_hz=history.sample_rate_hz,
                omega_rad_s=self._lines(history),
            )
        )

    def constant_term(self, history: TimeHistory) -> FloatArray:
        """Transform of a constant over the window."""
        _, count = self._window(history)
        return _parts(
            finite_transform(np.ones(count), sample_rate_hz=history.sample_rate_hz, omega_rad_s=self._lines(history))
        )

    def _window(self, history: TimeHistory) -> tuple[int, int]:
        first = int(np.ceil(self.longest_delay_s * history.sample_rate_hz)) + 1
        return first, history.values.shape[1] - first

    def _lines(self, history: TimeHistory) -> FloatArray:
        """Frequencies no closer than the record resolves."""
        low, high = self.band_rad_s
        duration_s = self._window(history)[1] / history.sample_rate_hz
        resolved = int((high - low) * duration_s / (2.0 * np.pi))
        if resolved < 2 or high > np.pi * history.sample_rate_hz:
            raise InsufficientDataError(
                f"{duration_s:.3g} s at {history.sample_rate_hz:.4g} Hz are too short or slow for {low:g} to "
                f"{high:g} rad/s",
                needed="a band below the Nyquist frequency and above the resolution of the record",
                remedy="choose another band or a longer record",
            )
        return np.linspace(low, high, min(resolved + 1, _LINES))


def equation_error(
    histories: Sequence[TimeHistory],
    target: str,
    regressors: Sequence[str],
    *,
    domain: Domain,
    measured: bool = False,
    delays_s: Mapping[str, float] | None = None,
    constant: bool = True,
) -> Regression:
    """Regression of one equation of motion on several records together.

    Parameters
    ----------
    histories
        Records.
    target
        State whose derivative stands on the left; with ``measured`` the channel itself, such as ``q_dot`` or ``ax``.
    regressors
        Channels on the right.
    domain
        :class:`InTime` or :class:`InBand`.
    measured
        Whether the target is the left side itself and not to be differentiated.
    delays_s
        Delay of a regressor; zero for those not named. Fractions of a sample are exact in the band.
    constant
        Add a constant, one for all records.

    Raises
    ------
    InsufficientDataError
        Regressors cannot be separated, or the records are too short.
    UsageError
        A channel is not in a record, or a delay is longer than the domain allows.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, chapters 5 and 7.
    """
    matrix, left, names = _equation(histories, target, regressors, domain, measured, delays_s or {}, constant)
    return regress(matrix, left, names, constant=False, ordered=domain.ordered and len(histories) == 1)


def _equation(
    histories: Sequence[TimeHistory],
    target: str,
    regressors: Sequence[str],
    domain: Domain,
    measured: bool,
    delays_s: Mapping[str, float],
    constant: bool,
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Rows of all records below each other: right sides ``(n, p)``, left side ``(n,)``, names."""
    if not histories:
        raise InsufficientDataError("no records were given", needed="at least one")
    for name in (target, *regressors, *delays_s):
        if any(name not in history.names for history in histories):
            raise UsageError(f"unknown channel {name}", needed=f"some of {', '.join(histories[0].names)}")
    blocks, lefts = [], []
    for history in histories:
        columns = [domain.level(history, name, delays_s.get(name, 0.0)) for name in regressors]
        blocks.append(np.stack([*columns, *([domain.constant_term(history)] if constant else [])], axis=1))
        lefts.append(domain.level(history, target, 0.0) if measured else domain.slope(history, target))
    return np.concatenate(blocks), np.concatenate(lefts), (*regressors, *([CONSTANT] if constant else []))


def _parts(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])
