r"""Wind over the ground: a steady part and Dryden turbulence that it carries past the vehicle.

A hovering vehicle does not fly through the turbulence, the wind blows it past. With the speed :math:`V` of the wind
relative to the vehicle, along it, across it and vertically,

.. math::

    H_u(s) = \sigma_u \sqrt{2 T} \frac{1}{1 + T s}, \qquad
    H_{v,w}(s) = \sigma_{v,w} \sqrt{T} \frac{1 + \sqrt 3 \, T s}{(1 + T s)^2}, \qquad T = \frac{L}{V}

driven by white noise of unit power density (two-sided per rad/s over 2π). They are made discrete exactly: samples have
the autocorrelation of the continuous process at any rate.

References
----------
MIL-F-8785C and MIL-HDBK-1797, Dryden form; scale lengths at low altitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.simulation.hover_flight import gauss_markov
from rotorid.typing import FloatArray

_FEET_PER_METER = 1.0 / 0.3048
_SLOWEST_M_S = 1.0
_SMALL = 1e-3


@dataclass(frozen=True, kw_only=True)
class Wind(Immutable):
    """Wind in earth axes.

    Parameters
    ----------
    north_m_s, east_m_s
        Where the air moves, steadily.
    turbulence_m_s
        Standard deviation along the wind and across it.
    vertical_share
        That of the vertical gusts as a share of it; over open ground one half to one.
    height_m
        Above the ground, which sets the scale lengths: vertical the height itself, horizontal by MIL-F-8785C.

    Examples
    --------
    >>> Wind(north_m_s=5.0, turbulence_m_s=1.0, height_m=10.0).lengths_m
    (67.4, 10.0)
    """

    north_m_s: float = 0.0
    east_m_s: float = 0.0
    turbulence_m_s: float = 0.0
    vertical_share: float = 0.6
    height_m: float = 10.0

    def __post_init__(self) -> None:
        numbers = (self.north_m_s, self.east_m_s, self.turbulence_m_s, self.vertical_share, self.height_m)
        if not np.isfinite(numbers).all():
            raise UsageError("the wind is not a finite number", needed="finite speeds, gusts and height")
        if min(numbers[2:4]) < 0.0:
            raise UsageError(
                f"turbulence is {self.turbulence_m_s:g} m/s, and {self.vertical_share:g} times that vertically",
                needed="zero or more",
            )
        if self.height_m < 1.0:
            raise UsageError(f"the height above ground is {self.height_m:g} m", needed="1 m or more")

    @property
    def speed_m_s(self) -> float:
        """Steady speed."""
        return math.hypot(self.north_m_s, self.east_m_s)

    @property
    def carried_m_s(self) -> float:
        """Speed at which turbulence is carried past a vehicle that hovers."""
        return max(self.speed_m_s, _SLOWEST_M_S)

    @property
    def lengths_m(self) -> tuple[float, float]:
        """Scale lengths along and across the wind, and vertically; up to 300 m the law for low altitude."""
        feet = min(self.height_m, 300.0) * _FEET_PER_METER
        return round(feet / (0.177 + 0.000823 * feet) ** 1.2 / _FEET_PER_METER, 1), float(min(self.height_m, 300.0))


CALM = Wind()


def blown(wind: Wind, samples: int, *, sample_rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """Velocity of the air to north, east and down, shape ``(samples, 3)``.

    In wind of less than 1 m/s, the turbulence is carried past at 1 m/s, for it drifts on its own.

    Parameters
    ----------
    wind
        Steady part, intensities, height.
    samples, sample_rate_hz
        How many, how often.
    rng
        Of the turbulence. Numbers are drawn in calm air too, so that a flight is the same but for the wind.

    Examples
    --------
    >>> air = blown(Wind(north_m_s=4.0), 3, sample_rate_hz=100.0, rng=np.random.default_rng(0))
    >>> air.tolist()
    [[4.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, 0.0]]
    """
    across_m, vertical_m = wind.lengths_m
    carried = wind.carried_m_s
    along = gauss_markov(
        samples,
        intensity=wind.turbulence_m_s,
        correlation_s=across_m / carried,
        sample_rate_hz=sample_rate_hz,
        rng=rng,
    )
    across = transverse(
        samples,
        intensity=wind.turbulence_m_s,
        correlation_s=across_m / carried,
        sample_rate_hz=sample_rate_hz,
        rng=rng,
    )
    vertical = transverse(
        samples,
        intensity=wind.vertical_share * wind.turbulence_m_s,
        correlation_s=vertical_m / carried,
        sample_rate_hz=sample_rate_hz,
        rng=rng,
    )
    heading = math.atan2(wind.east_m_s, wind.north_m_s)
    cosine, sine = math.cos(heading), math.sin(heading)
    north = wind.north_m_s + cosine * along - sine * across
    east = wind.east_m_s + sine * along + cosine * across
    return np.column_stack([north, east, vertical])


def transverse(
    samples: int, *, intensity: float, correlation_s: float, sample_rate_hz: float, rng: np.random.Generator
) -> FloatArray:
    r"""Dryden's transverse gust, stationary from its first sample.

    .. math:: R(t) = \sigma^2 \left(1 - \frac{|t|}{2 T}\right) e^{-|t|/T}

    Parameters
    ----------
    samples
        Number of samples.
    intensity
        Standard deviation.
    correlation_s
        T, scale length over the speed of the air.
    sample_rate_hz
        Rate of the samples; the recursion is exact at any rate.
    rng
        ``2 samples`` numbers are drawn from it.

    Examples
    --------
    >>> gust = transverse(9, intensity=0.5, correlation_s=2.0, sample_rate_hz=100.0, rng=np.random.default_rng(0))
    >>> gust.shape
    (9,)
    """
    from scipy.signal import lfilter

    h = 1.0 / (correlation_s * sample_rate_hz)
    drawn = rng.standard_normal((samples, 2))
    if intensity == 0.0:
        return np.zeros(samples)
    # Two equal poles as a chain: x1' = -x1 + n, x2' = -x2 + x1, time in units of T; the gust is a mix of the two.
    decay = math.exp(-h)
    noise = drawn @ _chain_root(h).T
    noise[0] = np.linalg.cholesky(np.array([[0.5, 0.25], [0.25, 0.25]])) @ drawn[0]
    first = lfilter([1.0], [1.0, -decay], noise[:, 0])
    drive = noise[:, 1].copy()
    drive[1:] += h * decay * first[:-1]
    second = lfilter([1.0], [1.0, -decay], drive)
    return np.asarray(intensity * (math.sqrt(3.0) * first + (1.0 - math.sqrt(3.0)) * second))


def _chain_root(h: float) -> FloatArray:
    """Root of the covariance that the chain gains in a step of h, lower triangular."""
    if h < _SMALL:
        # The exact terms cancel; these are the first ones of their series.
        return np.array([[math.sqrt(h), 0.0], [0.5 * h**1.5, math.sqrt(h**3 / 12.0)]])
    fading = math.exp(-2.0 * h)
    first = -0.5 * math.expm1(-2.0 * h)
    both = 0.25 * (1.0 - fading * (1.0 + 2.0 * h))
    second = 0.25 * (1.0 - fading * (1.0 + 2.0 * h + 2.0 * h * h))
    slope = both / math.sqrt(first)
    return np.array([[math.sqrt(first), 0.0], [slope, math.sqrt(second - slope**2)]])
