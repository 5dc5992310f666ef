r"""One more flight compared with earlier flights of the vehicle: whether a number lies within what these show of it.

Earlier flights :math:`y_j \pm s_j` scatter by more than they state, by :math:`\tau` between flights
(:func:`rotorid.uncertainty.differences.scatter_between`), and the next flight lies, where nothing changed, at

.. math:: \bar y \pm t_{n-1} \sqrt{\tau^2 + s^2 + s_{\bar y}^2}

so that few earlier flights decide little. Numbers that keep their sign are compared by their logarithms
(:func:`rotorid.uncertainty.differences.scale_of`). It assumes flights of one spread: wind, load and battery that the
earlier flights had not seen look like a change.

References
----------
DerSimonian and Laird, "Meta-analysis in clinical trials", 1986.
Higgins, Thompson and Spiegelhalter, "A re-evaluation of random-effects meta-analysis", 2009 (prediction intervals).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.typing import FloatArray
from rotorid.uncertainty.differences import (
    Scale,
    Verdict,
    chance,
    detectable,
    discoveries,
    scale_of,
    scatter_between,
    verdict,
)

FEWEST = 3
"""Earlier flights without which the scatter between flights is not known."""


@dataclass(frozen=True, kw_only=True)
class NextFlight(Immutable):
    """A number of one flight compared with those of earlier ones.

    Parameters
    ----------
    now
        Of the flight.
    expected
        Where it lies in 95 of 100 flights if nothing changed; ``None`` of too few earlier flights.
    flights
        Earlier flights that have the number.
    share
        Relative change; not a number about zero.
    probability
        That it lies so far off by chance; 1 of too few earlier flights.
    verdict
        ``changed``, ``unchanged`` or ``undecided``, over all numbers together.
    detectable
        Relative change that would have been found; infinite where none would.
    """

    now: Quantity
    expected: Quantity | None = None
    flights: int
    share: float = math.nan
    probability: float = 1.0
    verdict: Verdict = "undecided"
    detectable: float = math.inf


def random_effects_mean(values: FloatArray, stds: FloatArray) -> tuple[float, float, float]:
    """Mean with its error, and standard deviation between flights, by DerSimonian and Laird.

    Examples
    --------
    >>> mean, std, between = random_effects_mean(np.array([1.0, 3.0]), np.array([0.1, 0.1]))
    >>> mean, round(between, 2)
    (2.0, 1.41)
    """
    known = np.maximum(stds, 1e-12 * max(float(np.abs(values).max()), 1e-60))
    between = scatter_between(values, known)
    weight = 1.0 / (between**2 + known**2)
    return float(weight @ values / weight.sum()), float(weight.sum() ** -0.5), between


def next_flights(
    numbers: Mapping[str, tuple[Sequence[Quantity], Quantity]], *, false_alarms: float
) -> dict[str, NextFlight]:
    """Each number of a flight compared with those of earlier flights, with its verdict.

    Parameters
    ----------
    numbers
        Name to the estimates of earlier flights and that of the flight.
    false_alarms
        Probability that any number at all of a flight in which nothing changed is called changed.

    Examples
    --------
    >>> before = [Quantity.normal(value, 0.01, "s") for value in (1.0, 1.03, 0.98, 1.01, 0.99)]
    >>> now = Quantity.normal(2.0, 0.01, "s")
    >>> found = next_flights({"motors.output_delay_s": (before, now)}, false_alarms=0.01)
    >>> found["motors.output_delay_s"].verdict
    'changed'
    """
    found = {name: _compared(name, [*earlier], now) for name, (earlier, now) in numbers.items()}
    names = [name for name, one in found.items() if one[0].expected is not None]
    chosen = discoveries([found[name][0].probability for name in names], share=false_alarms)
    judged = dict(zip(names, chosen.tolist(), strict=True))
    answers = {}
    for name, (one, std, level, scale) in found.items():
        if one.expected is None:
            answers[name] = one
            continue
        reach = detectable(std, tests=len(names), freedom=one.flights - 1.0, share=false_alarms)
        share = scale.share(reach, level, std)
        answers[name] = NextFlight(
            now=one.now,
            expected=one.expected,
            flights=one.flights,
            share=one.share,
            probability=one.probability,
            verdict=verdict(found=judged[name], detectable_share=share),
            detectable=share,
        )
    return answers


def _compared(name: str, earlier: list[Quantity], now: Quantity) -> tuple[NextFlight, float, float, Scale]:
    """A comparison without its verdict, the deviation of the difference, the level, and the scale of both."""
    if len(earlier) < FEWEST:
        return NextFlight(now=now, flights=len(earlier)), math.inf, 0.0, Scale()
    y, s = (np.array([getattr(one, what) for one in (*earlier, now)]) for what in ("value", "std"))
    scale = scale_of(name, y, s)
    values, stds = scale.values(y), scale.stds(y, s)
    mean, mean_std, between = random_effects_mean(values[:-1], stds[:-1])
    std = math.sqrt(between**2 + mean_std**2 + float(stds[-1]) ** 2)
    if not (std > 0.0 and math.isfinite(std)):
        return NextFlight(now=now, flights=len(earlier)), math.inf, 0.0, scale
    freedom = len(earlier) - 1.0
    expected = scale.quantity(mean, std, now.unit, half=float(special.stdtrit(freedom, 0.975)) * std)
    share = now.value / expected.value - 1.0 if abs(mean) > 2.0 * std or scale.logarithmic else math.nan
    one = NextFlight(
        now=now,
        expected=expected,
        flights=len(earlier),
        share=share,
        probability=chance((float(values[-1]) - mean) / std, freedom),
    )
    return one, std, mean, scale
