r"""Normal values: a parameter's mean over a fleet, its spread between vehicles, and between flights of a vehicle.

Random effects. Flight :math:`j` of vehicle :math:`i` gives

.. math:: y_{ij} = x_{ij}^T \beta + b_i + w_{ij} + e_{ij}, \quad
          b_i \sim N(0, \tau^2), \; w_{ij} \sim N(0, \omega^2), \; e_{ij} \sim N(0, s_{ij}^2)

with stated errors :math:`s_{ij}`, of which :math:`\omega` takes what they leave out. The two variances are those of
largest restricted likelihood (REML); their intervals are where its profile has fallen by half a quantile of chi
squared. With :math:`D_i = \mathrm{diag}(\omega^2 + s_{ij}^2)` the covariance of a vehicle is
:math:`D_i + \tau^2 1 1^T`, whose inverse and determinant have closed forms, so that one evaluation costs a few sums.

References
----------
Harville, "Maximum likelihood approaches to variance component estimation and to related problems", 1977.
Hardy and Thompson, "A likelihood approach to meta-analysis with random effects", 1996.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize, stats

from rotorid.data.base import Immutable
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.errors import UsageError
from rotorid.typing import AnyArray, FloatArray, IntArray
from rotorid.uncertainty.differences import LINEAR, Scale

LEAST_VEHICLES, LEAST_FLIGHTS = 3, 4
"""Vehicles without which the spread between them, and flights without which no spread is known."""

_HALF_CHI2_95 = TWO_SIDED_95**2 / 2.0
_STARTS = ((0.7, 0.7), (0.1, 1.0), (1.0, 0.1))
_WIDEST = 60.0


@dataclass(frozen=True, kw_only=True)
class Population(Immutable):
    """A parameter over a fleet.

    Parameters
    ----------
    mean
        Of vehicles; its error holds the spread between them, not what errs alike in all of them.
    between, within
        Standard deviations between vehicles, and between flights of one; ``None`` where too few flew.
    low, high
        Normal range: what 95 % of further flights of further vehicles lie in, of a single vehicle those of itself;
        ``None`` where too few flew: fewer than four flights, or two vehicles.
    scale
        That of these numbers, on which spreads are normal.
    model_std
        Typical stated model error, which no number of flights shows.
    vehicles, flights
        How many there were.
    """

    mean: Quantity
    between: Quantity | None
    within: Quantity | None
    low: float | None
    high: float | None
    model_std: float
    vehicles: int
    flights: int
    scale: Scale = LINEAR


class _Likelihood:
    """Restricted likelihood of the two standard deviations, and the estimate of the rest."""

    def __init__(self, y: FloatArray, s: FloatArray, vehicle: IntArray, design: FloatArray) -> None:
        self._y, self._s2, self._vehicle, self._x = y, s**2, vehicle, design
        self._count = int(vehicle.max()) + 1

    def _sums(self, weights: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(self._vehicle, weights, minlength=self._count), dtype=np.float64)

    def solved(self, between: float, within: float) -> tuple[FloatArray, FloatArray, float]:
        """Estimate of beta, its information matrix, and minus the log of the likelihood."""
        d = within**2 + self._s2
        weight = 1.0 / d
        ones = self._sums(weight)
        columns = np.stack([*self._x.T, self._y])
        means = np.stack([self._sums(weight * column) for column in columns]) / ones
        # About the mean of each vehicle, and those means: nothing large cancels however small the errors are.
        rests = columns - means[:, self._vehicle]
        gram = (rests * weight) @ rests.T + (means * (ones / (1.0 + between**2 * ones))) @ means.T
        information, right = gram[:-1, :-1], gram[:-1, -1]
        beta = np.asarray(np.linalg.solve(information, right), dtype=np.float64)
        rest = gram[-1, -1] - right @ beta
        logs = np.log(d).sum() + np.log1p(between**2 * ones).sum() + np.linalg.slogdet(information)[1]
        return beta, information, float(0.5 * (logs + rest))

    def __call__(self, deviations: FloatArray) -> float:
        return self.solved(float(deviations[0]), float(deviations[1]))[2]


@dataclass(frozen=True, kw_only=True, eq=False)
class Effects(Immutable):
    """Fixed effects with their covariance, and both standard deviations with 95 % intervals."""

    beta: FloatArray
    covariance: FloatArray
    between: tuple[float, float, float]
    within: tuple[float, float, float]


def random_effects(
    values: AnyArray, stds: AnyArray, vehicle: AnyArray, *, design: AnyArray | None = None, intervals: bool = True
) -> Effects:
    """Fit the model of this module.

    Parameters
    ----------
    values, stds
        A parameter and its stated random error, shape ``(n,)``.
    vehicle
        Number of the vehicle of each, from zero.
    design
        Columns of fixed effects, shape ``(n, p)``; a mean by default.
    intervals
        Whether to look for those of the standard deviations; else they are as wide as all numbers.

    Returns
    -------
    Effects
        In the unit of the values.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> who = np.repeat(np.arange(30), 20)
    >>> y = 5.0 + rng.normal(0, 0.3, 30)[who] + rng.normal(0, 0.1, 600)
    >>> found = random_effects(y, np.zeros(600), who)
    >>> round(float(found.beta[0]), 2), round(found.between[0], 2), round(found.within[0], 2)
    (4.98, 0.25, 0.1)
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
    x = np.ones((y.size, 1)) if design is None else np.asarray(design, dtype=np.float64)
    who = np.unique(np.asarray(vehicle), return_inverse=True)[1]
    center = float(np.median(y))
    scale = max(float(np.std(y)), float(np.median(s)), 1e-300)
    # An error of exactly zero would let a variance vanish and the likelihood grow without end.
    floor = 1e-4
    likelihood = _Likelihood((y - center) / scale, np.maximum(s / scale, floor), who, x)
    # Nothing shows the spread between vehicles where one flew alone: any would be as likely, and widen its own range.
    widest_between = _WIDEST if who.max() > 0 else 0.0
    found: list[Any] = [
        optimize.minimize(likelihood, start, method="L-BFGS-B", bounds=[(0.0, widest_between), (0.0, _WIDEST)])
        for start in _STARTS
    ]
    best = found[int(np.argmin([float(group.fun) for group in found]))]
    tau, omega = (float(value) for value in best.x)
    beta, information, lowest = likelihood.solved(tau, omega)
    whole = (0.0, math.inf)
    of_tau = of_omega = whole
    if intervals:
        of_tau = _profile(lambda one, other: likelihood(np.array([one, other])), tau, omega, lowest)
        of_omega = _profile(lambda one, other: likelihood(np.array([other, one])), omega, tau, lowest)
    shift = np.linalg.lstsq(x, np.full(y.size, center / scale), rcond=None)[0]
    return Effects(
        beta=(beta + shift) * scale,
        covariance=np.asarray(np.linalg.inv(information) * scale**2, dtype=np.float64),
        between=(tau * scale, of_tau[0] * scale, of_tau[1] * scale),
        within=(omega * scale, of_omega[0] * scale, of_omega[1] * scale),
    )


def _profile(cost: Callable[[float, float], float], best: float, other: float, lowest: float) -> tuple[float, float]:
    """Where the profile likelihood of one standard deviation has fallen by what holds 95 %."""

    def above(one: float) -> float:
        high = max(4.0 * other, 0.5)
        least: Any = optimize.minimize_scalar(
            lambda two: cost(one, float(two)), bounds=(0.0, high), method="bounded", options={"xatol": 1e-4 * high}
        )
        return min(float(least.fun), cost(one, other)) - lowest - _HALF_CHI2_95

    low = 0.0 if best <= 0.0 or above(0.0) < 0.0 else float(optimize.brentq(above, 0.0, best, xtol=1e-4))
    high = max(2.0 * best, 0.1)
    while above(high) < 0.0 and high < _WIDEST:
        high *= 2.0
    return low, math.inf if high >= _WIDEST else float(optimize.brentq(above, best, high, xtol=1e-4))


def population(
    values: AnyArray,
    stds: AnyArray,
    vehicle: AnyArray,
    *,
    unit: str,
    model_std: float = 0.0,
    scale: Scale | None = None,
) -> Population:
    """A parameter over a fleet: mean, spreads, normal range.

    On a logarithmic scale the mean is the geometric one, spreads are shares of it, and no range passes zero.

    Parameters
    ----------
    values, stds
        Estimates and their random errors, shape ``(n,)``.
    vehicle
        Of each estimate: numbers or names.
    unit
        Of the values.
    model_std
        Typical stated model error.
    scale
        On which spreads are normal; that of the values by default.

    Raises
    ------
    UsageError
        There is no value.

    Examples
    --------
    >>> from rotorid.uncertainty.differences import LINEAR, Scale
    >>> found = population([0.01, 0.02, 0.05, 0.03], [1e-3] * 4, [0] * 4, unit="s", scale=Scale(True, 1.0))
    >>> 0.0 < found.low < 0.01
    True
    """
    scale = scale or LINEAR
    y, s = scale.values(values), scale.stds(values, stds)
    names, who = np.unique(np.asarray(vehicle), return_inverse=True)
    vehicles = len(names)
    if not y.size:
        raise UsageError("there are no values", needed="at least one flight")
    common: dict[str, Any] = {"model_std": model_std, "vehicles": vehicles, "flights": int(y.size), "scale": scale}
    if y.size < LEAST_FLIGHTS:
        # Two numbers are no spread: their stated errors stand for it, or their distance where that is more.
        std = max(float(np.std(y, ddof=1)) if y.size > 1 else 0.0, float(s.mean())) / math.sqrt(y.size)
        mean = scale.quantity(float(y.mean()), std, unit)
        return Population(mean=mean, between=None, within=None, low=None, high=None, **common)
    found = random_effects(y, s, who)
    repeated = y.size > vehicles
    known = vehicles >= LEAST_VEHICLES
    mean_std = math.sqrt(float(found.covariance[0, 0]))
    freedom = max(vehicles - 1, 1) if vehicles > 1 else max(int(y.size) - 1, 1)
    quantile = float(stats.t.ppf(0.975, freedom))
    value = float(found.beta[0])
    half = quantile * math.sqrt(found.between[0] ** 2 + found.within[0] ** 2 + mean_std**2)
    low, high = scale.interval(value, half) if known or vehicles == 1 else (None, None)
    return Population(
        mean=scale.quantity(value, mean_std, unit, half=quantile * mean_std),
        between=_deviation(found.between, unit, scale, value) if known else None,
        within=_deviation(found.within, unit, scale, value) if repeated else None,
        low=low,
        high=high,
        **common,
    )


def _deviation(found: tuple[float, float, float], unit: str, scale: Scale, level: float) -> Quantity:
    value, low, high = (scale.size(value, level) for value in found)
    low, high = min(low, value), max(high, value)
    reach = high - low if math.isfinite(high) else 2.0 * (value - low)
    return Quantity(value=value, std=reach / (2.0 * TWO_SIDED_95), lower=low, upper=high, unit=unit)
