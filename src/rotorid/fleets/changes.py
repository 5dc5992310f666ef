"""What changed: steps, odd flights and drifts in the history of one vehicle, and how sure that is.

Flights of a vehicle scatter about its value by their random errors and by a spread that all vehicles share. The spread
is taken from differences of neighboring flights, of which a step spoils one: from their median, so that neither steps
nor odd flights enter. Few flights show no spread, and then what the estimates state of their other errors stands for
it (:func:`stated_scatter`): two flights are compared as :mod:`rotorid.uncertainty.differences` compares two results.
Every test returns the probability that such a thing is seen where nothing changed, over all places where it could have
been seen; over a whole fleet :func:`rotorid.uncertainty.differences.discoveries` keeps the share of false ones small.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.typing import AnyArray, FloatArray
from rotorid.uncertainty.differences import chance

_FURTHER = 0.01
"""Probability up to which a further step, before or after one that was found, counts."""

_ENOUGH = 4
"""Flights from which on one flight is no step: it may be an odd one. Of fewer, each side may be a single one."""

_STATED_DIFFERENCES = 20.0
"""So many independent differences of neighbors weigh as much as what the estimates state of their errors."""

_NORMAL_MEDIAN = float(stats.norm.ppf(0.75))

_MEDIAN_EFFICIENCY = 0.3
"""Share of the differences that count as independent for their median."""

_LEAST_FREEDOM = 2.0
"""Degrees of freedom from which on a spread is known that nothing was stated of."""


@dataclass(frozen=True, kw_only=True)
class Change(Immutable):
    """A step of a parameter of one vehicle.

    Parameters
    ----------
    at_flight
        Number of the first flight after it, from 1.
    before, after
        Means on both sides.
    probability
        That such a step is seen where there is none.
    """

    at_flight: int
    before: Quantity
    after: Quantity
    probability: float

    @property
    def ratio(self) -> float:
        """After over before; nan about zero."""
        return self.after.value / self.before.value if self.before.value else math.nan


@dataclass(frozen=True, kw_only=True)
class OddFlight(Immutable):
    """A flight unlike those before and after it."""

    flight: int
    value: Quantity
    expected: float
    probability: float


@dataclass(frozen=True, kw_only=True)
class Drift(Immutable):
    """A slow change over the flights of one vehicle; ``slope`` is per flight."""

    slope: Quantity
    probability: float


class Spread(NamedTuple):
    """Standard deviation within vehicles, and how many degrees of freedom it was estimated with."""

    within: float
    freedom: float


def within_by_neighbors(
    series: Sequence[tuple[AnyArray, AnyArray]],
) -> Spread:
    """Spread between flights of one vehicle, from the differences of neighbors.

    Parameters
    ----------
    series
        Values and stated errors of each vehicle, in the order of its flights.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> many = [(5 * k + rng.normal(0, 0.2, 40), np.full(40, 0.05)) for k in range(50)]
    >>> round(within_by_neighbors(many).within, 1)
    0.2
    """
    steps, stated = [], []
    for values, stds in series:
        y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
        steps.append(np.diff(y))
        stated.append(s[1:] ** 2 + s[:-1] ** 2)
    difference = np.abs(np.concatenate(steps)) if steps else np.zeros(0)
    variance = np.concatenate(stated) if stated else np.zeros(0)
    freedom = max(_MEDIAN_EFFICIENCY * difference.size, 1.0)
    if not difference.size:
        return Spread(0.0, freedom)

    def too_wide(within: float) -> float:
        return float(np.median(difference / np.sqrt(2.0 * within**2 + variance + 1e-300))) - _NORMAL_MEDIAN

    if too_wide(0.0) <= 0.0:
        return Spread(0.0, freedom)
    return Spread(float(optimize.brentq(too_wide, 0.0, float(difference.max()) * 10.0)), freedom)


class Scatter(NamedTuple):
    """Scatter of the flights of one vehicle, and where it is known from.

    Parameters
    ----------
    spread
        Between flights of one vehicle, as far as the flights show it.
    stds
        Of each flight, shape ``(n,)``: its random error, and as much of its stated model error as stands for a
        spread that is not known well.
    known
        Whether a difference can be judged at all.
    """

    spread: Spread
    stds: tuple[FloatArray, ...]
    known: bool


def shown_scatter(series: Sequence[tuple[AnyArray, AnyArray]]) -> Scatter:
    """The scatter that flights show, of numbers that follow wind, battery and pilot.

    What a single flight states of them says nothing of the next, so that nothing is known until enough flew.

    Parameters
    ----------
    series
        Values and random errors of each vehicle, in the order of its flights.
    """
    shown = within_by_neighbors(series)
    stds = tuple(np.asarray(s, dtype=np.float64) for _, s in series)
    return Scatter(shown, stds, known=shown.freedom >= _LEAST_FREEDOM)


def stated_scatter(series: Sequence[tuple[AnyArray, AnyArray, AnyArray]]) -> Scatter:
    r"""The scatter of flights from what their estimates state and from what the flights show, each by its weight.

    .. math:: s_k^2 = r_k^2 + \frac{\nu_0 m_k^2 + \nu\, \omega^2}{\nu_0 + \nu}

    with random errors :math:`r`, stated model errors :math:`m`, the spread :math:`\omega` of
    :func:`within_by_neighbors` and its degrees of freedom :math:`\nu` (:math:`\nu_0 = 20`); a spread beyond what is
    stated counts in full. A model error that all flights share scatters nothing, so that few flights are judged on the
    safe side.

    Parameters
    ----------
    series
        Values, random errors and model errors of each vehicle, in the order of its flights.

    Examples
    --------
    >>> two = stated_scatter([([100.0, 290.0], [3.0, 3.0], [4.0, 4.0])])
    >>> two.stds[0].tolist(), two.spread.freedom
    ([5.0, 5.0], inf)
    """
    pairs = [(np.asarray(y, dtype=np.float64), np.asarray(r, dtype=np.float64)) for y, r, _ in series]
    models = [np.asarray(m, dtype=np.float64) for _, _, m in series]
    # Of few vehicles one difference each is what is asked about, and shows no scatter.
    asked = 2 if len(pairs) < _ENOUGH else 1
    freedom = _MEDIAN_EFFICIENCY * sum(max(y.size - asked, 0) for y, _ in pairs)
    weight = freedom / (freedom + _STATED_DIFFERENCES)
    within = within_by_neighbors(pairs).within if freedom else 0.0
    within2 = weight * within**2
    if freedom >= _LEAST_FREEDOM:
        within2 = max(within2, within**2 - (1.0 - weight) * float(np.median(np.concatenate(models) ** 2)))
    stds = tuple(np.sqrt(r**2 + (1.0 - weight) * m**2) for (_, r), m in zip(pairs, models, strict=True))
    return Scatter(Spread(math.sqrt(within2), freedom + _STATED_DIFFERENCES if freedom else math.inf), stds, known=True)


def _weights(stds: FloatArray, spread: Spread) -> FloatArray:
    variance = stds**2 + spread.within**2
    return np.asarray(1.0 / np.maximum(variance, 1e-300))


def _fewest(flights: int) -> int:
    """Flights on each side of a step at least."""
    return 1 if flights < _ENOUGH else 2


def places_of_steps(flights: int) -> int:
    """Places at which so many flights may show a step.

    Examples
    --------
    >>> [places_of_steps(count) for count in (1, 2, 3, 4, 10)]
    [0, 1, 2, 1, 7]
    """
    return max(flights - 2 * _fewest(flights) + 1, 0)


class _Split(NamedTuple):
    at: int
    distance: float
    probability: float


def _best_split(y: FloatArray, weight: FloatArray, spread: Spread, fewest: int) -> _Split | None:
    """The place where the means of both sides differ most, and how often chance alone does so at any place."""
    if y.size < 2 * fewest:
        return None
    sums, weights = np.cumsum(weight * y), np.cumsum(weight)
    places = np.arange(fewest, y.size - fewest + 1)
    w1, w2 = weights[places - 1], weights[-1] - weights[places - 1]
    m1, m2 = sums[places - 1] / w1, (sums[-1] - sums[places - 1]) / w2
    distance = (m2 - m1) / np.sqrt(1.0 / w1 + 1.0 / w2)
    best = int(np.argmax(np.abs(distance)))
    probability = min(1.0, places.size * chance(float(distance[best]), spread.freedom))
    return _Split(int(places[best]), float(distance[best]), probability)


def least_step(stds: AnyArray, spread: Spread) -> float:
    """Smallest standard deviation of a step, which is that in the middle of the flights; nan of a single one.

    Parameters
    ----------
    stds, spread
        As for :func:`first_step`.
    """
    weight = _weights(np.asarray(stds, dtype=np.float64), spread)
    if weight.size < 2:
        return math.nan
    fewest = _fewest(weight.size)
    weights = np.cumsum(weight)
    before = weights[fewest - 1 : weight.size - fewest]
    return float(np.sqrt(1.0 / before + 1.0 / (weights[-1] - before)).min())


def first_step(values: AnyArray, stds: AnyArray, spread: Spread) -> float:
    """Probability that the clearest step of a series is chance; 1 where too few flew.

    Parameters
    ----------
    values, stds
        A parameter of one vehicle in the order of its flights, shape ``(n,)``.
    spread
        Between flights of one vehicle.
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
    split = _best_split(y, _weights(s, spread), spread, _fewest(y.size))
    return 1.0 if split is None else split.probability


def steps(values: AnyArray, stds: AnyArray, spread: Spread, *, unit: str) -> tuple[Change, ...]:
    """All steps of a series with one accepted step: the others by splitting each side again.

    Parameters
    ----------
    values, stds, spread
        As for :func:`first_step`.

    Examples
    --------
    >>> rng = np.random.default_rng(2)
    >>> y = np.r_[np.full(10, 5.0), np.full(6, 4.5)] + rng.normal(0, 0.05, 16)
    >>> [one.at_flight for one in steps(y, np.full(16, 0.05), Spread(0.0, 100.0), unit="1")]
    [11]
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
    weight = _weights(s, spread)
    places: dict[int, float] = {}

    def split(start: int, stop: int, allowed: float) -> None:
        found = _best_split(y[start:stop], weight[start:stop], spread, _fewest(y.size))
        if found is None or found.probability > allowed:
            return
        places[start + found.at] = found.probability
        split(start, start + found.at, _FURTHER)
        split(start + found.at, stop, _FURTHER)

    split(0, y.size, 1.0)
    ends = [0, *sorted(places), y.size]
    means = [_mean(y[a:b], weight[a:b], unit) for a, b in itertools.pairwise(ends)]
    return tuple(
        Change(at_flight=place + 1, before=means[k], after=means[k + 1], probability=places[place])
        for k, place in enumerate(sorted(places))
    )


def _mean(y: FloatArray, weight: FloatArray, unit: str) -> Quantity:
    total = float(weight.sum())
    return Quantity.normal(float(weight @ y) / total, math.sqrt(1.0 / total), unit)


def odd_flights(values: AnyArray, stds: AnyArray, spread: Spread) -> FloatArray:
    """For each flight the probability that it lies so far from both its sides by chance, shape ``(n,)``.

    A flight is odd that lies on the same side of the two before it and of the two after it; of four or more, the first
    one and the last have one side. The first flight after a step agrees with those after it.

    Parameters
    ----------
    values, stds, spread
        As for :func:`first_step`.
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
    weight = _weights(s, spread)
    found = np.ones(y.size)
    # Of three flights only the middle one has two sides; an end that differs is a step.
    for k in range(y.size) if y.size >= _ENOUGH else range(1, y.size - 1):
        sides = []
        for part in (slice(max(k - 2, 0), k), slice(k + 1, k + 3)):
            if y[part].size:
                mean = float(weight[part] @ y[part] / weight[part].sum())
                sides.append((y[k] - mean) / math.sqrt(1.0 / weight[k] + 1.0 / float(weight[part].sum())))
        same = all(side > 0 for side in sides) or all(side < 0 for side in sides)
        if same:
            found[k] = min(1.0, y.size * chance(min(sides, key=abs), spread.freedom))
    return found


def drift(values: AnyArray, stds: AnyArray, spread: Spread, *, unit: str) -> Drift | None:
    """Slope over the flights, by weighted least squares; ``None`` of fewer than five.

    Parameters
    ----------
    values, stds, spread, unit
        As for :func:`steps`.

    Examples
    --------
    >>> found = drift(10.0 - 0.1 * np.arange(20), np.full(20, 0.05), Spread(0.0, 100.0), unit="1")
    >>> round(found.slope.value, 3)
    -0.1
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
    if y.size < 5:
        return None
    weight = _weights(s, spread)
    flight = np.arange(y.size, dtype=np.float64)
    center = float(weight @ flight / weight.sum())
    spanned = float(weight @ (flight - center) ** 2)
    slope, std = float(weight @ ((flight - center) * y)) / spanned, math.sqrt(1.0 / spanned)
    return Drift(slope=Quantity.normal(slope, std, unit), probability=chance(slope / std, spread.freedom))
