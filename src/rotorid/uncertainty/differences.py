r"""Did a number change? One rule for two results, for the logs of a vehicle, and for a whole fleet.

Two independent estimates :math:`a \pm s_a` and :math:`b \pm s_b` of one number differ by

.. math:: z = \frac{b - a}{\sqrt{s_a^2 + s_b^2}}

standard deviations, and several scatter by :math:`Q = \sum (v_i - \bar v)^2 / s_i^2`, which is distributed as
:math:`\chi^2` where nothing changed. Of a number that cannot change its sign, such as a control derivative or a delay,
the logarithm is compared: errors of such numbers are shares of them, and a ratio is what a person asks for.

A difference that chance explains is no proof that nothing changed. So each comparison also says what it would have
found, and there are three answers: *changed*; *unchanged*, where a change of :data:`NOTICEABLE_SHARE` would have been
found; else *undecided*.

Errors must be those of independent estimates: results that share a log differ by less. What two estimates have wrong in
common cancels, so that the test is then on the safe side.

References
----------
Cochran, "The combination of estimates from different experiments", Biometrics 10(1), 1954.
Benjamini and Hochberg, "Controlling the false discovery rate", 1995.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import special

from rotorid.data.quantities import figure
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.typing import AnyArray, BoolArray, FloatArray

Verdict: TypeAlias = Literal["changed", "unchanged", "undecided"]

FALSE_SHARE = 0.05
"""Share of false ones among what is called a change."""

NOTICEABLE_SHARE = 0.2
"""A change that has to be found for a number to be called unchanged."""

POWER_QUANTILE = float(special.ndtri(0.8))
"""A change that would have been found is one that is found four times out of five."""

_LEAST_SIGMAS = 2.0
"""A number that lies nearer to zero has no logarithm with a normal error, and no share."""

_SIGN_KNOWN = re.compile(
    r"L_roll|M_pitch|N_yaw|Z_thrust|X_\w*thrust|T_\w+|tau_\w+|I_\w+|m|mass|arm|kappa\w*|thrust_\w+|moment_\w+"
)


def keeps_sign(parameter: str) -> bool:
    """Whether a number cannot change its sign by what it is: control derivatives, times, inertia, thrust, noise.

    Damping and speed derivatives can, and decibels and degrees are on a scale of their own already.

    Examples
    --------
    >>> [keeps_sign(name) for name in ("L_roll", "tau_roll", "L_p", "margins.roll.gain_margin_db")]
    [True, True, False, False]
    """
    of_review = figure(parameter.rpartition(".")[2])
    return of_review.keeps_sign if of_review else _SIGN_KNOWN.fullmatch(parameter) is not None


_DAMPING = ("L_p", "M_q", "N_r", "Z_w")
"""A hovering vehicle damps its motion, so that fits bound these by zero."""


def is_clear_of_zero(parameter: str, value: float, std: float) -> bool:
    """Whether an estimate lies two deviations from zero, where its parameter cannot pass that.

    At such a bound a fit states an error that is far too small: of one flight in still air and its twin in wind the
    damping of heave is −0.02 ± 0.03 and −0.9 ± 0.2 1/s. What lies there is compared with its like alone.

    Examples
    --------
    >>> is_clear_of_zero("Z_w", -0.02, 0.03), is_clear_of_zero("Z_w", -0.9, 0.2), is_clear_of_zero("c_0", 0.0, 0.1)
    (False, True, True)
    """
    bounded = parameter in _DAMPING or keeps_sign(parameter)
    return not bounded or abs(value) >= _LEAST_SIGMAS * std


class Scale(NamedTuple):
    """The scale on which numbers of a kind are compared: their own, or the logarithm of their size.

    ``sign`` is that of all of them where they keep it, else zero.
    """

    logarithmic: bool = False
    sign: float = 0.0

    def values(self, values: AnyArray) -> FloatArray:
        """Numbers on this scale."""
        y = np.asarray(values, dtype=np.float64)
        return np.asarray(np.log(self.sign * y)) if self.logarithmic else y

    def stds(self, values: AnyArray, stds: AnyArray) -> FloatArray:
        """Standard deviations on this scale."""
        y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
        return np.asarray(s / np.abs(y)) if self.logarithmic else s

    def back(self, value: float) -> float:
        """A number of this scale in its own unit."""
        return self.sign * math.exp(min(value, 700.0)) if self.logarithmic else value

    def quantity(self, value: float, std: float, unit: str, *, half: float | None = None) -> Quantity:
        """An estimate of this scale in its own unit; ``half`` the width of its interval to one side."""
        half = TWO_SIDED_95 * std if half is None else half
        center = self.back(value)
        lower, upper = self.interval(value, half)
        return Quantity(
            value=center,
            std=std * abs(center) if self.logarithmic else std,
            lower=min(lower, center),
            upper=max(upper, center),
            unit=unit,
        )

    def interval(self, value: float, half: float) -> tuple[float, float]:
        """Both ends of what lies within ``half`` of a value, in its own unit, on its own side of zero."""
        low, high = sorted((self.back(value - half), self.back(value + half)))
        if self.sign and not self.logarithmic:
            return (max(low, 0.0), high) if self.sign > 0.0 else (low, min(high, 0.0))
        return low, high

    def size(self, deviation: float, level: float) -> float:
        """A deviation of this scale in the unit of a number, at ``level`` on this scale."""
        return deviation * abs(self.back(level)) if self.logarithmic else deviation

    def share(self, difference: float, level: float, std: float) -> float:
        """A difference of this scale as a share of the number it starts from; infinite where that may be zero."""
        if self.logarithmic:
            return math.expm1(min(difference, 700.0))
        return difference / abs(level) if abs(level) > _LEAST_SIGMAS * std else math.inf


LINEAR = Scale()


def scale_of(parameter: str, values: AnyArray, stds: AnyArray) -> Scale:
    """The scale of a parameter: logarithmic where it keeps its sign, and all of its numbers are clear of zero.

    Examples
    --------
    >>> scale_of("L_roll", [100.0, 120.0], [5.0, 5.0]).logarithmic, scale_of("L_p", [-1.0], [0.1]).logarithmic
    (True, False)
    >>> scale_of("tau_roll", [0.001, 0.006], [0.002, 0.002])
    Scale(logarithmic=False, sign=1.0)
    """
    y, s = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
    sign = float(np.sign(y[0])) if y.size else 0.0
    if not sign or not keeps_sign(parameter) or not bool((np.sign(y) == sign).all()):
        return LINEAR
    return Scale(bool((np.abs(y) >= _LEAST_SIGMAS * s).all()), sign)


def distance(parameter: str, before: tuple[float, float], after: tuple[float, float]) -> float:
    """Distance of two independent estimates in standard deviations; nan if unknown.

    That is where neither has an error, and where one of both lies at a bound of zero.

    Parameters
    ----------
    parameter
        Its name, by which the scale is chosen.
    before, after
        Value and standard deviation.

    Examples
    --------
    >>> round(distance("L_roll", (100.0, 5.0), (290.0, 14.5)), 1)
    15.1
    >>> distance("L_p", (-2.0, 0.3), (-3.0, 0.4))
    -2.0
    """
    if is_clear_of_zero(parameter, *before) != is_clear_of_zero(parameter, *after):
        return math.nan
    y, s = np.array([before[0], after[0]]), np.array([before[1], after[1]])
    scale = scale_of(parameter, y, s)
    a, b = scale.values(y)
    sigma = float(np.hypot(*scale.stds(y, s)))
    if not sigma > 0.0:
        return math.nan
    rises = scale.sign if scale.logarithmic else 1.0
    return float(rises * (b - a) / sigma)


def chance(distance: float, freedom: float = math.inf) -> float:
    """Two-sided probability of so many standard deviations, where the deviation was estimated with ``freedom``."""
    return float(2.0 * special.stdtr(freedom, -abs(distance)))


def homogeneity(values: AnyArray, stds: AnyArray) -> tuple[float, float]:
    r"""Sum of squares :math:`Q` of estimates about their weighted mean, and its probability by chance.

    Examples
    --------
    >>> Q, p = homogeneity([100.0, 106.0], [3.0, 4.0])
    >>> round(Q, 2), round(p, 3)
    (1.44, 0.23)
    """
    y, weights = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64) ** -2.0
    mean = float(np.sum(weights * y) / np.sum(weights))
    Q = float(np.sum(weights * (y - mean) ** 2))
    return Q, float(special.chdtrc(y.size - 1, Q))


def scatter_between(values: AnyArray, stds: AnyArray) -> float:
    r"""Standard deviation between estimates beyond their own errors, by DerSimonian and Laird; zero where they agree.

    .. math:: \tau^2 = \max\left(0, \frac{Q - (n - 1)}{\sum w_j - \sum w_j^2 / \sum w_j}\right), \qquad w_j = s_j^{-2}

    Examples
    --------
    >>> round(scatter_between([1.0, 3.0], [0.1, 0.1]), 2)
    1.41
    """
    weights = np.asarray(stds, dtype=np.float64) ** -2.0
    Q, _ = homogeneity(values, stds)
    spared = float(weights.sum() - (weights @ weights) / weights.sum())
    return math.sqrt(max(Q - (weights.size - 1), 0.0) / spared) if spared > 0.0 else 0.0


def discoveries(probabilities: AnyArray | Sequence[float], *, share: float = FALSE_SHARE) -> BoolArray:
    """Which of many tests are discoveries, so that no more than 5 % of them are false (Benjamini and Hochberg).

    Where nothing at all is to be found, ``share`` is the probability of any discovery.

    Examples
    --------
    >>> discoveries([0.001, 0.5, 0.02, 0.9]).tolist()
    [True, False, True, False]
    """
    p = np.asarray(probabilities, dtype=np.float64)
    order = np.argsort(p)
    allowed = share * np.arange(1, p.size + 1) / max(p.size, 1)
    below = np.flatnonzero(p[order] <= allowed)
    found = np.zeros(p.size, dtype=np.bool_)
    if below.size:
        found[order[: below[-1] + 1]] = True
    return found


def detectable(std: float, *, tests: int, freedom: float = math.inf, share: float = FALSE_SHARE) -> float:
    """The difference that would have been found four times out of five, on the scale of ``std``.

    Parameters
    ----------
    std
        Of the difference.
    tests
        How many were made: each has to be so much clearer.
    freedom
        With which ``std`` was estimated.
    share
        Of false ones among what is found.

    Examples
    --------
    >>> round(detectable(0.05, tests=1), 2), round(detectable(0.05, tests=30), 2)
    (0.14, 0.2)
    """
    tail = share / (2.0 * max(tests, 1))
    return float((POWER_QUANTILE - special.stdtrit(freedom, tail)) * std)


def verdict(*, found: bool, detectable_share: float) -> Verdict:
    """The answer of one comparison.

    Parameters
    ----------
    found
        Whether a difference is beyond chance.
    detectable_share
        The change that would have been found, as a share.

    Examples
    --------
    >>> verdict(found=False, detectable_share=0.1), verdict(found=False, detectable_share=0.6)
    ('unchanged', 'undecided')
    """
    if found:
        return "changed"
    return "unchanged" if detectable_share <= NOTICEABLE_SHARE else "undecided"


class Difference(NamedTuple):
    """Two independent estimates of one number: by how many standard deviations they differ, and what that decides.

    ``detectable_share`` is the change that would have been found.
    """

    distance: float
    verdict: Verdict
    detectable_share: float


Estimate: TypeAlias = tuple[float, float]
"""Value and standard deviation."""


def differences(pairs: Sequence[tuple[str, Estimate, Estimate]]) -> tuple[Difference, ...]:
    """Pairs of independent estimates, each with its verdict: at most 5 % of what is called changed is false.

    Parameters
    ----------
    pairs
        Name of the parameter, estimate before and after.

    Examples
    --------
    >>> tight, wide = (100.0, 5.0), (290.0, 14.5)
    >>> [one.verdict for one in differences([("L_roll", tight, wide), ("L_p", (-1.0, 0.9), (-2.9, 2.6))])]
    ['changed', 'undecided']
    """
    distances = [distance(*pair) for pair in pairs]
    found = discoveries([chance(distance) if math.isfinite(distance) else 1.0 for distance in distances])
    answers = []
    for (parameter, before, after), z, is_found in zip(pairs, distances, found, strict=True):
        if not math.isfinite(z):
            answers.append(Difference(z, "undecided", math.inf))
            continue
        y, s = np.array([before[0], after[0]]), np.array([before[1], after[1]])
        scale = scale_of(parameter, y, s)
        weights = scale.stds(y, s) ** -2.0
        level = float(scale.values(y) @ weights / weights.sum())
        reach = detectable(float(np.sqrt(np.sum(1.0 / weights))), tests=len(pairs))
        share = scale.share(reach, level, float(weights.sum() ** -0.5))
        answers.append(Difference(z, verdict(found=bool(is_found), detectable_share=share), share))
    return tuple(answers)
