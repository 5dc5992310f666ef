"""Multisines: sums of harmonics of one period, orthogonal between axes, with phases that keep the peak low.

Axes that take different harmonics of one period are orthogonal over it, so that one flight shows the answers to each.
Phases decide how high the sum rises: Schroeder's are good for many harmonics, and a search from them is better for any.
How well an input uses the room of its amplitude says the relative peak factor, and what it puts into a band the share
of its energy there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.typing import ComplexArray, FloatArray, IntArray

_FINENESS = 128
# Samples may miss the peak of a sum of harmonics by no more than this (Ehlich and Zeller, Mathematische Zeitschrift
# 86, 1964).
_MISSED = 1.0 / math.cos(math.pi / _FINENESS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Multisine(Immutable):
    r"""A sum of harmonics of one period.

    .. math:: x(t) = \sum_k a_k \cos(2 \pi k t / T + \phi_k)

    Over a whole period two of them without a common harmonic are orthogonal, whatever their phases and however they are
    shifted: the inputs of several axes can be flown together and separated. That is true for inputs flown from
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
                f"invalid harmonics {_listed(harmonics)} of {self.period_s:g} s",
                needed="rising harmonics from 1 up, and a positive period",
            )
        if amplitudes.shape != harmonics.shape or phases.shape != harmonics.shape or not (amplitudes > 0.0).all():
            raise UsageError(
                f"{amplitudes.size} amplitudes and {phases.size} phases do not fit {harmonics.size} harmonics",
                needed="one of each per harmonic, with positive amplitudes",
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
            How many, at least one. The first contains the transient of the vehicle; the others its steady response, and
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
                f"invalid multisine: {periods:g} periods with frequencies up to {self.omega_rad_s[-1]:g} rad/s at "
                f"{sample_rate_hz:g} Hz",
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

    Its phases come from :func:`flat_phases`. Then the signal is shifted in time to the
    upward zero crossing with the gentlest slope, :math:`\phi_k \to \phi_k + 2 \pi k t_0 / T`, which changes neither
    peak nor orthogonality.

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
            f"invalid harmonics {_listed(harmonics)} for a multisine",
            needed=f"rising harmonics from {LOWEST_HARMONIC} up",
            remedy="lengthen the period or raise the lowest frequency",
        )
    if shares.shape != harmonics.shape or not (shares > 0.0).all() or not np.isfinite(shares).all() or amplitude == 0.0:
        raise UsageError(
            f"{shares.size} powers with the amplitude {amplitude:g} do not fit {harmonics.size} harmonics",
            needed="a positive power for each harmonic, and an amplitude other than zero",
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


LOWEST_HARMONIC = 2
"""Least cycles of the lowest frequency in a period: one cycle cannot be separated from a drift."""


def interleaved(axes: int, *, band_rad_s: tuple[float, float], period_s: float) -> tuple[IntArray, ...]:
    r"""Harmonics of several axes by turns: one takes :math:`k, k + m, \ldots`, the next those one higher.

    All m axes have the same spacing m / T. Peaks are higher than those of :func:`halved`: where the first harmonic
    is neither a multiple nor an odd half of the spacing, fractions of a period repeat one envelope at other phases. Of
    hundreds of optimizations none came below a relative peak factor of 1.08 with fifty such harmonics, 1.09 with
    thirteen, 1.13 with seven.

    Parameters
    ----------
    axes
        How many.
    band_rad_s
        Lowest and highest frequency of all of them together; the lowest harmonic is at least two.
    period_s
        Length of a period.

    Returns
    -------
    tuple
        Harmonics per axis, shape ``(k,)`` each.

    Raises
    ------
    UsageError
        An axis would have no harmonic.

    References
    ----------
    Morelli, *Multiple Input Design for Real-Time Parameter Estimation in the Frequency Domain*, 13th IFAC Symposium on
    System Identification, 2003.

    Examples
    --------
    >>> [lines.tolist() for lines in interleaved(3, band_rad_s=(0.6, 3.0), period_s=20.0)]
    [[2, 5, 8], [3, 6, 9], [4, 7]]
    """
    every = harmonics_in(band_rad_s, period_s=period_s)
    return _shared(tuple(every[axis::axes] for axis in range(axes)), band_rad_s, period_s)


def halved(axes: int, *, band_rad_s: tuple[float, float], period_s: float) -> tuple[IntArray, ...]:
    """Harmonics of several axes by halving: odd ones, twice the odd ones, four times them; the last takes the rest.

    All of an axis are multiples, or odd multiples, of one frequency. Such a comb reaches a relative peak factor near 1
    with as few as five harmonics. For it the axes pay with unequal spacings: 2/T, then 4/T twice for three axes, and
    2/T, 4/T and 8/T twice for four. Put the most important axis first.

    Parameters
    ----------
    axes
        How many.
    band_rad_s
        Lowest and highest frequency of all of them together; the lowest harmonic is at least two.
    period_s
        Length of a period.

    Returns
    -------
    tuple
        Harmonics per axis, shape ``(k,)`` each.

    Raises
    ------
    UsageError
        An axis would have no harmonic.

    Examples
    --------
    >>> [lines.tolist() for lines in halved(3, band_rad_s=(0.6, 5.1), period_s=20.0)]
    [[3, 5, 7, 9, 11, 13, 15], [2, 6, 10, 14], [4, 8, 12, 16]]
    """
    every = harmonics_in(band_rad_s, period_s=period_s)
    odd = tuple(every[every % 2 ** (axis + 1) == 2**axis] for axis in range(axes - 1))
    return _shared((*odd, every[every % 2 ** (axes - 1) == 0]), band_rad_s, period_s)


def harmonics_in(band_rad_s: tuple[float, float], *, period_s: float) -> IntArray:
    """Multiples of ``1 / period_s`` inside a band, edges included, from two up; shape ``(k,)``.

    Parameters
    ----------
    band_rad_s
        Lowest and highest frequency.
    period_s
        Period of the multisine.

    Examples
    --------
    >>> harmonics_in((0.1, 2.0), period_s=20.0).tolist()
    [2, 3, 4, 5, 6]
    """
    low, high = (edge * period_s / (2.0 * math.pi) for edge in band_rad_s)
    # An edge that is a harmonic but for rounding counts.
    lowest = max(LOWEST_HARMONIC, math.ceil(low * (1.0 - 1e-9)))
    return np.arange(lowest, math.floor(high * (1.0 + 1e-9)) + 1, dtype=np.int64)


def power_law(harmonics: IntArray, exponent: float) -> FloatArray:
    r"""Powers :math:`p_k = k^{n}`, one at the highest harmonic; shape ``(k,)``.

    With :math:`n = 0` all are equal, with :math:`n = -1` every octave has the same power.

    Parameters
    ----------
    harmonics
        Numbers :math:`k`, shape ``(k,)``.
    exponent
        The power :math:`n`.

    Examples
    --------
    >>> power_law(np.array([2, 4, 8]), -1.0).tolist()
    [4.0, 2.0, 1.0]
    """
    powers: FloatArray = (np.asarray(harmonics, dtype=np.float64) / float(np.max(harmonics))) ** exponent
    return powers


def _shared(parts: tuple[IntArray, ...], band_rad_s: tuple[float, float], period_s: float) -> tuple[IntArray, ...]:
    if not parts or min(part.size for part in parts) == 0:
        raise UsageError(
            f"too few harmonics of {period_s:g} s between {band_rad_s[0]:g} and {band_rad_s[1]:g} rad/s for "
            f"{len(parts)} axes",
            needed="a harmonic for each axis",
            remedy="lengthen the period or widen the band",
        )
    return parts


_LADDER = ((4, 8), (16, 16), (64, 16), (256, 32), (1024, 32))
"""Exponents of the norm, rising, each with the samples per shortest cycle that its peaks need."""

_STEPS = 60
_SWAPS = 300
_CLIP = (0.7, 0.99)
_MOST_STARTS, _LEAST_STARTS, _DRAWN = 96, 4, 20_000
_KEPT = 3


def schroeder_phases(powers: FloatArray) -> FloatArray:
    r"""Phases with which the harmonics come one after the other, as in a chirp.

    .. math:: \phi_k = - 2 \pi \sum_{i < k} (k - i) \, p_i, \qquad \sum_i p_i = 1

    Parameters
    ----------
    powers
        Power of each harmonic, in the order of frequency, equally spaced; shape ``(k,)``, any unit.

    References
    ----------
    Schroeder, *Synthesis of Low-Peak-Factor Signals and Binary Sequences with Low Autocorrelation*, IEEE Transactions
    on Information Theory 16, 1970.

    Examples
    --------
    >>> (schroeder_phases(np.ones(4)) / (2.0 * np.pi)).tolist()
    [-0.0, -0.25, -0.75, -1.5]
    """
    passed = np.cumsum(powers / np.sum(powers))
    phases: FloatArray = -2.0 * math.pi * np.concatenate([[0.0], np.cumsum(passed)[:-1]])
    return phases


def flat_phases(harmonics: IntArray, amplitudes: FloatArray, *, seed: int = 0) -> FloatArray:
    r"""Phases that make the largest value of a multisine small.

    .. math:: \min_\phi \; \Big\| \sum_k a_k \cos(2 \pi k t / T + \phi_k) \Big\|_p, \qquad p = 4, 16, \ldots, 1024

    Each norm begins where the one before ended; the last is within a fraction of a percent of the peak. Gradients are
    analytic. Descent begins from the phases of Schroeder and from the best of some random ones, which were clipped and
    brought back to their amplitudes by turns. The minima are local and many: with few harmonics random starts win, with
    hundreds those of Schroeder.

    Parameters
    ----------
    harmonics
        Multiples of the base frequency, positive, rising, shape ``(k,)``.
    amplitudes
        Amplitude of each, positive, shape ``(k,)``.
    seed
        Of the random starts: the same seed gives the same phases.

    Returns
    -------
    FloatArray
        In radians, shape ``(k,)``.

    References
    ----------
    Guillaume, Schoukens, Pintelon and Kollar, *Crest-Factor Minimization Using Nonlinear Chebyshev Approximation
    Methods*, IEEE Transactions on Instrumentation and Measurement 40, 1991. Van der Ouderaa, Schoukens and Renneboog,
    *Peak Factor Minimization Using a Time-Frequency Domain Swapping Algorithm*, the same, 37, 1988.

    Examples
    --------
    >>> harmonics, amplitudes = np.arange(2, 42, 2), np.ones(20)
    >>> plain, flat = schroeder_phases(amplitudes**2), flat_phases(harmonics, amplitudes)
    >>> [round(float(abs(over_period(harmonics, amplitudes, one, samples=5000)).max() / 20**0.5), 1)
    ...  for one in (plain, flat)]
    [1.2, 1.0]
    """
    # A common factor repeats the signal within its period and changes no peak.
    base = harmonics // np.gcd.reduce(harmonics)
    chirp = schroeder_phases(amplitudes**2)
    starts = np.stack([chirp, *_swapped(base, amplitudes, np.random.default_rng(seed))])
    samples = _samples(base, 2 * _LADDER[-1][1])
    ends = [_descended(base, amplitudes, start) for start in starts]
    peaks = [np.abs(over_period(base, amplitudes, end, samples=samples)).max() for end in ends]
    return ends[int(np.argmin(peaks))]


def over_period(harmonics: IntArray, amplitudes: FloatArray, phases_rad: FloatArray, *, samples: int) -> FloatArray:
    """One period of a sum of cosines, ``samples`` equal steps long; more than twice the highest harmonic.

    Leading axes of the phases are those of the result.

    Examples
    --------
    >>> over_period(np.array([1]), np.array([2.0]), np.array([0.0]), samples=4).round(12).tolist()
    [2.0, 0.0, -2.0, 0.0]
    """
    lines: ComplexArray = np.zeros((*phases_rad.shape[:-1], samples // 2 + 1), dtype=np.complex128)
    lines[..., harmonics] = 0.5 * samples * amplitudes * np.exp(1j * phases_rad)
    return np.fft.irfft(lines, samples)


def _swapped(harmonics: IntArray, amplitudes: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The best of many random phases after clipping in time and restoring the amplitudes in frequency by turns."""
    count = min(_MOST_STARTS, _DRAWN // harmonics.size**2)
    # The effort of a start grows with the harmonics and its chance falls: with more than fifty hardly one ever won.
    if count < _LEAST_STARTS:
        return np.empty((0, harmonics.size))
    phases = rng.uniform(0.0, 2.0 * math.pi, (count, harmonics.size))
    samples = _samples(harmonics, _LADDER[0][1])
    for share in np.linspace(*_CLIP, _SWAPS):
        values = over_period(harmonics, amplitudes, phases, samples=samples)
        level = share * np.abs(values).max(axis=-1, keepdims=True)
        phases = np.angle(np.fft.rfft(np.clip(values, -level, level))[:, harmonics])
    peaks = np.abs(over_period(harmonics, amplitudes, phases, samples=samples)).max(axis=-1)
    return phases[np.argsort(peaks, kind="stable")[:_KEPT]]


def _descended(harmonics: IntArray, amplitudes: FloatArray, phases: FloatArray) -> FloatArray:
    from scipy.optimize import minimize

    for exponent, fineness in _LADDER:
        arguments = (harmonics, amplitudes, exponent, _samples(harmonics, fineness))
        phases = minimize(
            _log_norm, phases, args=arguments, jac=True, method="L-BFGS-B", options={"maxiter": _STEPS, "maxcor": 20}
        ).x
    return phases


def _log_norm(
    phases: FloatArray, harmonics: IntArray, amplitudes: FloatArray, exponent: int, samples: int
) -> tuple[float, FloatArray]:
    r"""Logarithm of the p-norm of one period, and its gradient.

    With :math:`w = |x|^{p-2} x / \overline{|x|^p}` the gradient is
    :math:`-a_k \overline{w \sin(2 \pi k t / T + \phi_k)} = -a_k \, \mathrm{Im}(e^{j \phi_k} W_k^*)`, W the transform
    of w.
    """
    values = over_period(harmonics, amplitudes, phases, samples=samples)
    peak = np.abs(values).max()
    # Over the peak, so that high powers neither overflow nor vanish altogether.
    unit = values / peak
    slope = np.abs(unit) ** (exponent - 2) * unit
    mean = np.mean(slope * unit)
    lines = np.fft.rfft(slope / (mean * peak * samples))[harmonics]
    gradient = -amplitudes * np.imag(np.exp(1j * phases) * np.conj(lines))
    return float(np.log(peak) + np.log(mean) / exponent), gradient


def _samples(harmonics: IntArray, fineness: int) -> int:
    from scipy.fft import next_fast_len

    # Twice a fast length is even, as the inverse of a real transform wants it.
    return 2 * int(next_fast_len(fineness * int(harmonics[-1]) // 2, real=True))


_PADDING = 4


def energy_share(values: FloatArray, band_rad_s: tuple[float, float], *, sample_rate_hz: float) -> float:
    r"""Share of the energy of a test input that lies inside a band.

    .. math:: \int_{\omega_{min}}^{\omega_{max}} |X|^2 \, d\omega \; \Big/ \int_0^{\pi f_s} |X|^2 \, d\omega

    with the Fourier transform X of the samples, zero before and after them. Energy is counted up to half the sample
    rate; what a hold adds above is not in the samples. The edges of the band are resolved to a quarter of one over the
    length.

    Parameters
    ----------
    values
        Shape ``(samples,)``.
    band_rad_s
        Lowest and highest frequency, edges included.
    sample_rate_hz
        Rate of the samples.

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    UsageError
        The samples are all zero, or the band does not rise.

    Examples
    --------
    Fifty cycles of 1 Hz are not quite a line:

    >>> sine = np.sin(2.0 * np.pi * np.arange(0.0, 50.0, 0.01))
    >>> round(energy_share(sine, (6.0, 6.6), sample_rate_hz=100.0), 2)
    0.96
    """
    low, high = band_rad_s
    if not low < high or not np.any(values):
        raise UsageError(
            f"{values.size} samples up to {np.abs(values).max(initial=0.0):g} with the band {low:g} to {high:g} rad/s",
            needed="samples that are not all zero, and a rising band",
        )
    # Zeros behind the samples resolve the edges of the band; they change no energy.
    length = _PADDING * values.size
    energy = np.abs(np.fft.rfft(values, length)) ** 2
    # One-sided: every line but zero and the highest stands for two.
    energy[0] *= 0.5
    energy[-1] *= 0.5
    omega = 2.0 * math.pi * np.fft.rfftfreq(length, 1.0 / sample_rate_hz)
    return float(energy[(omega >= low) & (omega <= high)].sum() / energy.sum())


def relative_peak_factor(values: FloatArray) -> float:
    r"""Span of a signal over that of a sine of the same power.

    .. math:: \mathrm{RPF} = \frac{\max x - \min x}{2 \sqrt{2} \; x_{rms}}

    One for a sine, :math:`1/\sqrt 2` for two levels, which is the least; noise has about 2.5. What is limited in flight
    is the peak and what is learned grows with the power, so small is good.

    Parameters
    ----------
    values
        Shape ``(samples,)``, over whole periods, sampled finely enough to hold the peaks; not all zero.

    References
    ----------
    Morelli, *Multiple Input Design for Real-Time Parameter Estimation in the Frequency Domain*, 13th IFAC Symposium on
    System Identification, 2003.

    Examples
    --------
    >>> round(relative_peak_factor(np.sin(2.0 * np.pi * np.arange(1000) / 1000)), 6)
    1.0
    """
    rms = math.sqrt(float(np.mean(np.square(values))))
    if rms == 0.0:
        raise UsageError(f"all {values.size} samples are zero", needed="a signal")
    return float(np.ptp(values)) / (2.0 * math.sqrt(2.0) * rms)
