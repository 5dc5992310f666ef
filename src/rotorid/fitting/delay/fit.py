r"""A late lag: a delay in series with a lag of low order, to separate delays from what only looks like one.

.. math:: G(s) = \frac{b_0 + b_1 x + \dots + b_m x^m}{(x + d)\,(x^2 + c_1 x + c_0)} \, e^{-\tau s},
    \qquad x = s / \omega_0

with the first factor, the second, or both. Factors with positive coefficients are just the stable ones, which makes
stability a matter of bounds: an unstable pole near a zero on its other side turns the phase like a delay.

An input that is held between its samples reaches the vehicle as

.. math:: G_h(\omega) = \sum_k H(\omega + k \omega_s) \, G(j\omega + j k \omega_s), \qquad
    H(\omega) = \frac{1 - e^{-j\omega T}}{j\omega T}

with all its images, of which the three nearest on either side count.

The search goes over a grid of delays first, because phases wrap, then over all parameters at once, then along the
profile of the cost for an interval. To a frequency response :math:`H` the residuals are

.. math:: r = \ln \frac{H(\omega)}{G(j\omega)}

with real part the error of the magnitude and imaginary part that of the phase, whose slope is the delay, weighed by
the covariance of the response between its points; records are fitted in :mod:`rotorid.fitting.delay.record`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, Protocol, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.fitting.frequency.problem import residual_errors
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.problem import ResidualErrors
from rotorid.typing import BoolArray, ComplexArray, FloatArray

InputHold: TypeAlias = Literal["held", "smooth"]
"""How an input goes on between its samples: constant until the next one, or as a band-limited signal does."""

_IMAGES = 3


class Order(NamedTuple):
    """Numbers of zeros and poles of a lag.

    Parameters
    ----------
    zeros, poles
        Fewer zeros than poles.
    """

    zeros: int
    poles: int

    @property
    def words(self) -> str:
        """The order in words.

        Examples
        --------
        >>> Order(0, 1).words, Order(1, 2).words
        ('first order', 'second order with zero')
        """
        ordinal = {1: "first", 2: "second", 3: "third", 4: "fourth"}.get(self.poles, f"{self.poles}th")
        zeros = {0: "", 1: " with zero"}.get(self.zeros, f" with {self.zeros} zeros")
        return f"{ordinal} order{zeros}"

    @property
    def coefficients(self) -> int:
        """Coefficients, without the delay."""
        return self.zeros + 1 + self.poles


@dataclass(frozen=True, kw_only=True)
class DelayedLag:
    """The model of one response: an order, a frequency that scales its coefficients, and the hold of the input.

    Parameters
    ----------
    order
        Zeros and poles.
    scale_rad_s
        The frequency that counts as one.
    hold
        How the input goes on between its samples.
    sample_s
        Sample interval; the hold needs it.
    """

    order: Order
    scale_rad_s: float
    hold: InputHold
    sample_s: float

    def response(self, theta: FloatArray, omega_rad_s: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Response and its exact derivatives.

        Parameters
        ----------
        theta
            Coefficients of the numerator, lowest power first; then of the factors, that of first order first, ``d``,
            ``c_1``, ``c_0``; then the delay in seconds. Shape ``(p,)``.
        omega_rad_s
            Shape ``(f,)``.

        Returns
        -------
        numpy.ndarray
            Shape ``(f,)``.
        numpy.ndarray
            Derivatives, shape ``(p, f)``.
        """
        if self.hold == "smooth":
            return self._plain(theta, omega_rad_s)
        turn = 2.0 * np.pi / self.sample_s
        images = omega_rad_s + turn * np.arange(-_IMAGES, _IMAGES + 1)[:, None]
        values, slopes = self._plain(theta, images.ravel())
        hold_response = hold_spectrum(images, self.sample_s)
        total = (hold_response * values.reshape(images.shape)).sum(axis=0)
        return total, (hold_response * slopes.reshape(-1, *images.shape)).sum(axis=1)

    def _plain(self, theta: FloatArray, omega_rad_s: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        m, x = self.order.zeros + 1, np.asarray(1j * omega_rad_s / self.scale_rad_s, dtype=np.complex128)
        powers = x ** np.arange(m)[:, None]
        below, moves = self._denominator(theta[m:-1], x)
        late = np.exp(-1j * omega_rad_s * theta[-1])
        values = theta[:m] @ powers / below * late
        slopes = [powers / below * late, -values / below * moves, (-1j * omega_rad_s * values)[None]]
        return values, np.concatenate(slopes)

    def _denominator(self, factors: FloatArray, x: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Product of the factors, and its derivatives to their coefficients."""
        ones = np.ones_like(x)
        single = self.order.poles % 2
        first = x + factors[0] if single else ones
        if self.order.poles == 1:
            return first, ones[None]
        second = x**2 + factors[single] * x + factors[single + 1]
        moves = [first * x, first]
        return first * second, np.stack([second, *moves] if single else moves)

    def poles_rad_s(self, theta: FloatArray) -> ComplexArray:
        """Poles in rad/s, shape ``(n,)``."""
        factors, single = theta[self.order.zeros + 1 : -1], self.order.poles % 2
        poles = [-factors[0]] if single else []
        if self.order.poles > 1:
            half, product = -0.5 * factors[single], factors[single + 1]
            root = np.sqrt(complex(half**2 - product))
            poles += [half + root, half - root]
        return np.asarray(poles, dtype=np.complex128) * self.scale_rad_s

    def factors(self, poles_rad_s: ComplexArray, fastest_rad_s: float) -> FloatArray:
        """Coefficients of the factors that have given poles, shape ``(n,)``.

        Parameters
        ----------
        poles_rad_s
            Shape ``(n,)``, complex ones in pairs.
        fastest_rad_s
            Poles that grow faster than this are mirrored to the stable side.
        """
        x = np.where(poles_rad_s.real > fastest_rad_s, -poles_rad_s.conj(), poles_rad_s) / self.scale_rad_s
        x = x[np.argsort(np.abs(x.imag), kind="stable")]
        single = self.order.poles % 2
        found = [-x[0].real] if single else []
        if self.order.poles > 1:
            found += [-(x[single] + x[single + 1]).real, (x[single] * x[single + 1]).real]
        return np.asarray(found, dtype=np.float64)

    def box(self, fastest_rad_s: float, delays_s: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters, each shape ``(p,)``, that keep poles from growing faster."""
        limit = fastest_rad_s / self.scale_rad_s
        single = [-limit] if self.order.poles % 2 else []
        double = [-2.0 * limit, -(limit**2)] if self.order.poles > 1 else []
        lower = np.array([*[-np.inf] * (self.order.zeros + 1), *single, *double, delays_s[0]])
        upper = np.full(lower.size, np.inf)
        upper[-1] = delays_s[1]
        return lower, upper


def hold_spectrum(omega_rad_s: FloatArray, sample_s: float) -> ComplexArray:
    r"""Effect of a sample-and-hold on the spectrum, :math:`(1 - e^{-j\omega T}) / (j\omega T)`; same shape."""
    half = 0.5 * omega_rad_s * sample_s
    return np.asarray(np.sinc(half / np.pi) * np.exp(-1j * half), dtype=np.complex128)


_GRID = 31
_VALLEYS = 3
_POLISHED = 2
_SCOUT, _POLISH = LevenbergMarquardt(iterations=60, tolerance=1e-6), LevenbergMarquardt(iterations=60, tolerance=1e-9)
_CHI_SQUARED_95 = 3.841
_PROFILE_STEPS = 12
_PROFILE_ACCURACY = 0.02
_NEGLIGIBLE, NO_EVIDENCE = 0.02, 6.0
"""Least relative reduction of the misfit for another parameter; the criterion must also show strong evidence (Kass and
Raftery, *Bayes Factors*, 1995).
"""


class DelayProblem(Protocol):
    """Data for the fit of a delayed lag: records or a frequency response."""

    @property
    def model(self) -> DelayedLag: ...

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations, ``(n,)``, and derivatives, ``(n, p)``."""

    def linear(self, delay_s: float, fastest_rad_s: float) -> tuple[FloatArray, float]:
        """Parameters at a given delay without a start, and their cost."""

    def thinned(self) -> DelayProblem:
        """The same with fewer points, for the search."""


@dataclass(frozen=True, kw_only=True)
class Limits(Immutable):
    """Where a delay is looked for.

    Parameters
    ----------
    delays_s
        Least and largest delay.
    fastest_rad_s
        How fast the fastest unstable pole may grow; zero where the response is known to be stable.
    """

    delays_s: tuple[float, float]
    fastest_rad_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderFit(Immutable):
    """A late lag of one order, fitted.

    Parameters
    ----------
    order
        Zeros and poles.
    count
        Real numbers that were fitted.
    solution
        Where the search ended; the delay is the last parameter.
    criterion
        Cost plus the logarithm of the number of data for each parameter; the least is best.
    poles_rad_s
        Shape ``(n,)``.
    """

    order: Order
    count: int
    solution: Solution
    criterion: float
    poles_rad_s: ComplexArray

    @property
    def delay_s(self) -> float:
        return float(self.solution.theta[-1])

    @property
    def std_s(self) -> float:
        """Standard deviation of the delay from the curvature of the cost, all other parameters free."""
        jacobian = self.solution.jacobian
        # The share of the delay's column that no other parameter can take over.
        others = np.linalg.qr(jacobian[:, :-1] / _lengths(jacobian[:, :-1]))[0]
        own = jacobian[:, -1] - others @ (others.T @ jacobian[:, -1])
        length = float(np.linalg.norm(own))
        return self.misfit / length if length > 0.0 else np.inf

    @property
    def misfit(self) -> float:
        """Standard deviation of the residuals in units of what was expected of them."""
        free = max(self.count - self.solution.theta.size, 1)
        return float(np.sqrt(self.solution.cost / free))


def fit_order(problem: DelayProblem, limits: Limits, *, start: FloatArray | None = None) -> OrderFit:
    """Fit one order: from a start, or from the valleys of the cost on a grid of delays.

    Raises
    ------
    InsufficientDataError
        No delay gives a finite cost.
    """
    lower, upper = problem.model.box(limits.fastest_rad_s, limits.delays_s)
    starts = [start] if start is not None else _starts(problem, limits, lower, upper)
    ends = [_POLISH.minimize(problem.residuals, start, lower, upper) for start in starts]
    ends = [end for end in ends if np.isfinite(end.cost)]
    if not ends:
        raise InsufficientDataError(
            f"no delay from {1e3 * limits.delays_s[0]:.4g} to {1e3 * limits.delays_s[1]:.4g} ms fits a model of "
            f"{problem.model.order.words}",
            needed="an input that moves the output",
        )
    best = min(ends, key=lambda end: end.cost)
    return OrderFit(
        order=problem.model.order,
        count=problem.count,
        solution=best,
        criterion=best.cost + (problem.model.order.coefficients + 1) * float(np.log(problem.count)),
        poles_rad_s=problem.model.poles_rad_s(best.theta),
    )


def _starts(problem: DelayProblem, limits: Limits, lower: FloatArray, upper: FloatArray) -> list[FloatArray]:
    """The best places that a search on some of the points finds, best first."""
    thin = problem.thinned()
    found = [thin.linear(float(delay_s), limits.fastest_rad_s) for delay_s in np.linspace(*limits.delays_s, _GRID)]
    cost = np.array([value for _, value in found])
    padded = np.concatenate([[np.inf], cost, [np.inf]])
    valleys = np.flatnonzero((cost <= padded[:-2]) & (cost <= padded[2:]) & np.isfinite(cost))
    lowest = valleys[np.argsort(cost[valleys])][:_VALLEYS]
    scouts = [_SCOUT.minimize(thin.residuals, found[index][0], lower, upper) for index in lowest]
    return [solution.theta for solution in sorted(scouts, key=lambda solution: solution.cost)[:_POLISHED]]


def simplest(fits: Sequence[OrderFit]) -> OrderFit:
    """The fit with the fewest parameters whose criterion is no worse than the best by more than what is negligible."""
    best = min(fits, key=lambda fit: fit.criterion)
    limit = best.criterion + max(_NEGLIGIBLE * best.solution.cost, NO_EVIDENCE)
    good = [fit for fit in fits if fit.criterion <= limit]
    return min(good, key=lambda fit: (fit.order.coefficients, fit.criterion))


def interval_s(problem: DelayProblem, fit: OrderFit, limits: Limits) -> tuple[float, float]:
    r"""Interval of 95 % for the delay by the profile of the cost.

    The delays whose least cost over all other parameters exceeds the minimum by no more than :math:`3.84\,s^2`, with
    the variance :math:`s^2` of the residuals. It ends at a limit where the profile stays below.
    """
    low, high = (_crossing(problem, fit, limits, side) for side in (-1.0, 1.0))
    return low, high


def _crossing(problem: DelayProblem, fit: OrderFit, limits: Limits, side: float) -> float:
    lower, upper = problem.model.box(limits.fastest_rad_s, limits.delays_s)
    allowed = _CHI_SQUARED_95 * fit.misfit**2
    end = limits.delays_s[1] if side > 0.0 else limits.delays_s[0]
    reach = abs(end - fit.delay_s)

    def excess(distance: float, start: FloatArray) -> tuple[float, FloatArray]:
        theta = start.copy()
        theta[-1] = fit.delay_s + side * distance
        bounds = lower.copy(), upper.copy()
        bounds[0][-1] = bounds[1][-1] = theta[-1]
        minimum = _SCOUT.minimize(problem.residuals, theta, *bounds)
        return minimum.cost - fit.solution.cost, minimum.theta

    # The square root of the excess grows in proportion to the distance where the cost is a parabola.
    inner, theta = 0.0, np.array(fit.solution.theta)
    trial, outer = min(TWO_SIDED_95 * fit.std_s, reach), reach
    for _ in range(_PROFILE_STEPS):
        value, found = excess(trial, theta)
        ratio = float(np.sqrt(max(value, 0.0) / allowed))
        if abs(ratio - 1.0) <= _PROFILE_ACCURACY:
            break
        if ratio < 1.0:
            if trial >= reach:
                return end
            inner, theta = trial, found
        else:
            outer = trial
        guess = trial / ratio if ratio > 0.0 else 2.0 * trial
        trial = guess if inner < guess < outer else (min(2.0 * trial, reach) if outer == reach else (inner + outer) / 2)
    return fit.delay_s + side * trial


def _lengths(columns: FloatArray) -> FloatArray:
    length = np.sqrt(np.sum(columns**2, axis=0))
    return np.where(length > 0.0, length, 1.0)


_ROUNDS = 6
_RANK = 1e-11


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponsePoints(Immutable):
    """The usable points of one response.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    values
        Shape ``(f,)``.
    errors
        What is known of their errors.
    """

    omega_rad_s: FloatArray
    values: ComplexArray
    errors: ResidualErrors

    @classmethod
    def of(cls, response: FrequencyResponse, used: BoolArray, pair: tuple[int, int]) -> ResponsePoints:
        """Points of the response ``pair`` that are ``used``, shape ``(y, u, f)``."""
        chosen = np.zeros_like(used)
        chosen[pair] = used[pair]
        ones = np.ones(int(chosen.sum()))
        return cls(
            omega_rad_s=response.omega_rad_s[chosen[pair]],
            values=response.values[pair][chosen[pair]],
            errors=residual_errors(response, chosen, (ones, ones)),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseFit:
    """Residuals of a late lag on a frequency response."""

    data: ResponsePoints
    model: DelayedLag

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""
        return 2 * self.data.omega_rad_s.size

    def thinned(self) -> ResponseFit:
        """The fit itself: its points are few."""
        return self

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations and their derivatives, shapes ``(n,)`` and ``(n, p)``."""
        values, slopes = self.model.response(theta, self.data.omega_rad_s)
        safe = np.where(values == 0.0, np.finfo(np.float64).tiny, values)
        error = np.log(self.data.values / safe)
        relative = -slopes / safe
        raw = np.concatenate([error.real, error.imag])
        jacobian = np.concatenate([relative.real, relative.imag], axis=1).T
        return self.data.errors.whitened(raw), self.data.errors.whitened(jacobian)

    @cached_property
    def _weight(self) -> FloatArray:
        size = self.data.omega_rad_s.size
        variance = np.diag(self.data.errors.covariance)[:size] + self.data.errors.own[:size]
        return np.asarray(1.0 / (np.abs(self.data.values) * np.sqrt(variance)))

    def linear(self, delay_s: float, fastest_rad_s: float) -> tuple[FloatArray, float]:
        """Parameters at a given delay without a start, and their cost; as on records, see there."""
        order, omega = self.model.order, self.data.omega_rad_s
        powers = (1j * omega / self.model.scale_rad_s) ** np.arange(order.poles + 1)[:, None]
        late, scale = np.exp(-1j * omega * delay_s), self._weight
        if self.model.hold == "held":
            late = late * hold_spectrum(omega, self.model.sample_s)
        found = np.zeros(order.coefficients)
        for _ in range(_ROUNDS):
            columns = [*(powers[: order.zeros + 1] * late), *(-powers[:-1] * self.data.values)]
            matrix = np.stack([real(scale * column) for column in columns], axis=1)
            length = np.sqrt(np.sum(matrix**2, axis=0))
            right = real(scale * powers[-1] * self.data.values)
            found = np.linalg.lstsq(matrix / length, right, rcond=_RANK)[0] / length
            below = np.abs(np.append(found[order.zeros + 1 :], 1.0) @ powers)
            scale = self._weight / np.maximum(below, 1e-9 * below.max())
        theta = np.zeros(order.coefficients + 1)
        roots = np.roots(np.append(found[order.zeros + 1 :], 1.0)[::-1])
        poles = np.asarray(roots, dtype=np.complex128) * self.model.scale_rad_s
        theta[order.zeros + 1 : -1] = self.model.factors(poles, fastest_rad_s)
        theta[-1] = delay_s
        error = self._weight * np.abs(self.data.values - self._numerator(theta))
        return theta, float(2.0 * error @ error)

    def _numerator(self, theta: FloatArray) -> ComplexArray:
        """Fit the numerator with everything else in place, into ``theta``; the response."""
        above = self.model.order.zeros + 1
        _, slopes = self.model.response(theta, self.data.omega_rad_s)
        columns = slopes[:above]
        matrix = np.stack([real(self._weight * column) for column in columns], axis=1)
        theta[:above] = np.linalg.lstsq(matrix, real(self._weight * self.data.values), rcond=_RANK)[0]
        return np.asarray(theta[:above] @ columns, dtype=np.complex128)


def real(values: ComplexArray) -> FloatArray:
    """All real parts, then all imaginary ones."""
    return np.concatenate([values.real, values.imag])
