"""Multisines: sums of harmonics of one period, orthogonal between axes, with phases that keep the peak low."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.excitation.harmonics import LOWEST_HARMONIC
from rotorid.excitation.phases import flat_phases, over_period
from rotorid.excitation.spectrum import relative_peak_factor
from rotorid.typing import FloatArray, IntArray

_FINENESS = 128
# Samples may miss the peak of a sum of harmonics by no more than this (Ehlich and Zeller, Mathematische Zeitschrift
# 86, 1964).
_MISSED = 1.0 / math.cos(math.pi / _FINENESS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Multisine(Immutable):
    r"""A sum of harmonics of one period.

    .. math:: x(t) = \sum_k a_k \cos(2 \pi k t / T + \phi_k)

    Over a whole period two of them without a common harmonic are orthogonal, whatever their phases and however they are
    shifted: the inputs of several axes can be flown at the same time and told apart. That holds for what is flown from
    the second period on; in the first the vehicle still answers the start.

    Parameters
    ----------
    harmonics
        Multiples k of the base frequency, rising, from 1 up; shape ``(k,)``.
    amplitudes
        Of each, positive, in the unit of what is excited; shape ``(k,)``.
    phases_rad
        Of each, shape ``(k,)``.
    period_s
        T.

    Examples
    --------
    >>> sine = Multisine(harmonics=[2], amplitudes=[0.1], phases_rad=[0.0], period_s=4.0)
    >>> sine.at(np.array([0.0, 1.0, 5.0])).round(12).tolist(), round(sine.relative_peak_factor, 3)
    ([0.1, -0.1, -0.1], 1.0)
    """

    harmonics: IntArray
    amplitudes: FloatArray
    phases_rad: FloatArray
    period_s: float

    def __post_init__(self) -> None:
        harmonics = read_only(self.harmonics, np.int64, ndim=1)
        amplitudes = read_only(self.amplitudes, np.float64, ndim=1)
        phases = read_only(self.phases_rad, np.float64, ndim=1)
        if not harmonics.size or harmonics[0] < 1 or (np.diff(harmonics) < 1).any() or not self.period_s > 0.0:
            raise UsageError(
                f"the harmonics {_listed(harmonics)} of {self.period_s:g} s came",
                needed="at least one, rising, from 1 up, of a positive period",
            )
        if amplitudes.shape != harmonics.shape or phases.shape != harmonics.shape or not (amplitudes > 0.0).all():
            raise UsageError(
                f"{amplitudes.size} amplitudes and {phases.size} phases came for {harmonics.size} harmonics",
                needed="one of each, the amplitudes positive",
            )
        self._set(harmonics=harmonics, amplitudes=amplitudes, phases_rad=phases)

    @property
    def omega_rad_s(self) -> FloatArray:
        """Frequencies of the harmonics, shape ``(k,)``."""
        return np.asarray(self.harmonics * (2.0 * math.pi / self.period_s), dtype=np.float64)

    @property
    def rms(self) -> float:
        """Root mean square over a period."""
        return math.sqrt(0.5 * float(np.sum(self.amplitudes**2)))

    @property
    def peak(self) -> float:
        """A bound of the largest absolute value, at most 0.03 % above it."""
        return _MISSED * float(np.abs(self._finely()).max())

    @property
    def relative_peak_factor(self) -> float:
        """Over a period, on a grid that misses at most 0.03 %; see :func:`rotorid.excitation.relative_peak_factor`."""
        return relative_peak_factor(self._finely())

    def at(self, time_s: FloatArray) -> FloatArray:
        """Values at any instants, the signal going on forever; shape of ``time_s``."""
        turns = np.asarray(time_s, dtype=np.float64) / self.period_s
        values = np.zeros_like(turns)
        # One harmonic after the other: all at once would take harmonics times samples of memory.
        for harmonic, amplitude, phase in zip(self.harmonics, self.amplitudes, self.phases_rad, strict=True):
            values += amplitude * np.cos(2.0 * math.pi * np.mod(harmonic * turns, 1.0) + phase)
        return values

    def sampled(self, sample_rate_hz: float, *, periods: int = 1) -> FloatArray:
        """Some periods as samples, a zero behind the last, so that the signal ends where it began.

        Orthogonality is exact in the samples too where a period is a whole number of them, and otherwise off by the
        share of one sample in a period.

        Parameters
        ----------
        sample_rate_hz
            More than twice the highest frequency in Hz; 25 times is good practice.
        periods
            How many, at least one. The first holds the transient of the vehicle; the others tell its steady answer, and
            their differences the noise.

        Returns
        -------
        FloatArray
            Shape ``(periods * period_s * sample_rate_hz + 1,)``.

        Raises
        ------
        UsageError
            The rate is too low, or there is no period.
        """
        if periods < 1 or not sample_rate_hz * self.period_s > 2 * int(self.harmonics[-1]):
            raise UsageError(
                f"{periods:g} periods with frequencies up to {self.omega_rad_s[-1]:g} rad/s at {sample_rate_hz:g} Hz",
                needed="at least one period, and more than two samples in the shortest cycle",
                remedy="raise the sample rate or lower the band",
            )
        exact = self.period_s * sample_rate_hz
        count = round(exact)
        if math.isclose(exact, count, rel_tol=1e-9):
            values = np.tile(self.at(np.arange(count) * self.period_s / count), periods)
        else:
            values = self.at(np.arange(math.ceil(periods * exact)) / sample_rate_hz)
        return np.append(values, 0.0)

    def _finely(self) -> FloatArray:
        base = self.harmonics // np.gcd.reduce(self.harmonics)
        return over_period(base, self.amplitudes, self.phases_rad, samples=_FINENESS * int(base[-1]))


def multisine(
    harmonics: IntArray, *, amplitude: float, period_s: float, powers: FloatArray | None = None, seed: int = 0
) -> Multisine:
    r"""A multisine of given harmonics with a low peak, which starts and ends at zero.

    Its phases come from :func:`rotorid.excitation.phases.flat_phases`. Then the signal is shifted in time to the upward
    zero crossing with the gentlest slope, :math:`\phi_k \to \phi_k + 2 \pi k t_0 / T`, which changes neither peak nor
    orthogonality.

    Parameters
    ----------
    harmonics
        Multiples of ``1 / period_s``, rising, from 2 up; shape ``(k,)``. See
        :func:`rotorid.excitation.halved` and :func:`rotorid.excitation.interleaved`.
    amplitude
        Largest absolute value, never exceeded and reached within 0.03 %; negative begins downwards.
    period_s
        Length of a period.
    powers
        Power of each harmonic in any unit, shape ``(k,)``; equal ones by default. Put it where the vehicle answers
        little or the wind is strong.
    seed
        The same seed gives the same signal.

    Raises
    ------
    UsageError
        Harmonics do not rise from two up, or a power is not positive.

    References
    ----------
    Morelli, *Multiple Input Design for Real-Time Parameter Estimation in the Frequency Domain*, 13th IFAC Symposium on
    System Identification, 2003; Morelli and Klein, *Aircraft System Identification*, 2nd edition, 2016, chapter 9.

    Examples
    --------
    >>> roll = multisine(np.arange(3, 41, 2), amplitude=0.1, period_s=20.0)
    >>> bool(roll.relative_peak_factor < 1.02), bool(abs(roll.sampled(50.0)).max() <= 0.1)
    (True, True)
    """
    harmonics = np.asarray(harmonics, dtype=np.int64)
    shares = np.ones(harmonics.shape) if powers is None else np.asarray(powers, dtype=np.float64)
    if not harmonics.size or harmonics[0] < LOWEST_HARMONIC or (np.diff(harmonics) < 1).any():
        raise UsageError(
            f"a multisine of the harmonics {_listed(harmonics)} was asked for",
            needed=f"at least one, rising, from {LOWEST_HARMONIC} up",
            remedy="lengthen the period or raise the lowest frequency",
        )
    if shares.shape != harmonics.shape or not (shares > 0.0).all() or not np.isfinite(shares).all() or amplitude == 0.0:
        raise UsageError(
            f"{shares.size} powers and the amplitude {amplitude:g} came for {harmonics.size} harmonics",
            needed="a positive power for each, and an amplitude that is not zero",
        )
    shape = np.sqrt(shares / shares.sum())
    phases = flat_phases(harmonics, shape, seed=seed)
    unit = Multisine(harmonics=harmonics, amplitudes=shape, phases_rad=phases, period_s=1.0)
    phases = phases + 2.0 * math.pi * np.mod(harmonics * _gentle_start(unit), 1.0)
    if amplitude < 0.0:
        phases = phases + math.pi
    return Multisine(
        harmonics=harmonics,
        amplitudes=abs(amplitude) / unit.peak * shape,
        phases_rad=np.mod(phases, 2.0 * math.pi),
        period_s=period_s,
    )


def _gentle_start(signal: Multisine) -> float:
    """When a signal of period one passes zero upwards most gently."""
    from scipy.optimize import brentq

    values = signal._finely()
    common = int(np.gcd.reduce(signal.harmonics))
    after = np.roll(values, -1)
    (crossings,) = np.nonzero((values <= 0.0) & (after > 0.0))
    slopes = after[crossings] - values[crossings]
    first = int(crossings[np.argmin(slopes)])
    step = 1.0 / (common * values.size)
    low, high = first * step, (first + 1) * step

    def value(turn: float) -> float:
        return float(signal.at(np.array([turn]))[0])

    # Rounding may put a sample that is zero on the other side; then it is the crossing.
    if value(low) * value(high) > 0.0:
        return min((low, high), key=lambda turn: abs(value(turn)))
    return float(brentq(value, low, high, xtol=1e-16, rtol=8.9e-16))


def _listed(harmonics: IntArray) -> str:
    shown = ", ".join(map(str, harmonics[:5].tolist()))
    return f"{shown}, ..." if harmonics.size > 5 else shown or "none"
