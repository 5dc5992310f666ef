"""Phases of a multisine that keep its peak low."""

from __future__ import annotations

import math

import numpy as np

from rotorid.typing import ComplexArray, FloatArray, IntArray

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
