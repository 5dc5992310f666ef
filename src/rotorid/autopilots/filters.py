r"""Filters that an autopilot ran, as frequency responses.

A filter that ran at its own rate :math:`f_s` on samples is

.. math:: H(\omega) = \frac{\sum_k b_k z^{-k}}{\sum_k a_k z^{-k}}, \qquad z = e^{j \omega / f_s}

and shows at low frequency the delay

.. math:: \tau_0 = \frac{1}{f_s} \left( \frac{\sum k b_k}{\sum b_k} - \frac{\sum k a_k}{\sum a_k} \right)

References
----------
Oppenheim and Schafer, *Discrete-Time Signal Processing*, chapter 7 (bilinear transformation with prewarping).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import ComplexArray, FloatArray

_WHOLE = 1e-9
_MOST_SAMPLES = 100_000
_SLOWEST = 1e-5


@dataclass(frozen=True, kw_only=True, slots=True)
class KnownFilter:
    r"""A linear digital filter.

    Parameters
    ----------
    name
        What it is, for a person.
    numerator, denominator
        Coefficients of :math:`z^0, z^{-1}, \dots`
    rate_hz
        Samples per second that it worked on.

    Examples
    --------
    >>> mean_of_two = KnownFilter(name="mean of two", numerator=(0.5, 0.5), denominator=(1.0,), rate_hz=100.0)
    >>> mean_of_two.delay_s
    0.005
    """

    name: str
    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    rate_hz: float

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz < math.inf:
            raise UsageError(f"{self.name} has a rate of {self.rate_hz:g} Hz", needed="a positive rate")

    @property
    def delay_s(self) -> float:
        """Delay at low frequency."""
        return (_center(self.numerator) - _center(self.denominator)) / self.rate_hz

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Complex response, shape ``(f,)``, at frequencies of shape ``(f,)``.

        Above half of ``rate_hz`` it repeats itself, while the data hold aliases.
        """
        backward = np.exp(-1j * omega_rad_s / self.rate_hz)
        over, under = (np.polynomial.polynomial.polyval(backward, c) for c in (self.numerator, self.denominator))
        return np.asarray(over / under, dtype=np.complex128)


def _center(coefficients: Sequence[float]) -> float:
    return sum(index * value for index, value in enumerate(coefficients)) / sum(coefficients)


def combined_response(filters: Sequence[KnownFilter], omega_rad_s: FloatArray) -> ComplexArray:
    """Response of filters in a row, shape ``(f,)``; one where there is no filter.

    Parameters
    ----------
    filters
        In any order: linear filters commute.
    omega_rad_s
        Frequencies, shape ``(f,)``.

    Examples
    --------
    >>> combined_response([], np.array([1.0, 10.0]))
    array([1.+0.j, 1.+0.j])
    """
    total = np.ones(np.shape(omega_rad_s), dtype=np.complex128)
    for known in filters:
        total = total * known.response(omega_rad_s)
    return total


def butterworth_low_pass(cutoff_hz: float, rate_hz: float) -> KnownFilter:
    r"""Second-order Butterworth low-pass by the bilinear transformation, exact at the cutoff.

    .. math:: H(s) = \frac{1}{s^2 + \sqrt 2 s + 1}, \qquad s = \frac{1}{\Omega} \frac{1 - z^{-1}}{1 + z^{-1}}, \qquad
        \Omega = \tan \frac{\pi f_c}{f_s}

    This is ``LowPassFilter2p`` of PX4 and ArduPilot, and the biquad low-pass of Betaflight: theirs is written with
    :math:`\sin` and :math:`\cos` of the full angle and is the same filter.

    Parameters
    ----------
    cutoff_hz
        Frequency at which 0.707 is left.
    rate_hz
        Rate of the filter.

    Raises
    ------
    UsageError
        The cutoff does not lie between a hundred-thousandth and half of the rate.

    Examples
    --------
    >>> [round(1e3 * butterworth_low_pass(40.0, rate_hz).delay_s, 2) for rate_hz in (250.0, 8000.0)]
    [5.14, 5.63]
    """
    _require_in_band(cutoff_hz, rate_hz)
    warped = math.tan(math.pi * cutoff_hz / rate_hz)
    square, middle = warped * warped, math.sqrt(2.0) * warped
    return KnownFilter(
        name=f"second-order low-pass at {cutoff_hz:.4g} Hz",
        numerator=(square, 2.0 * square, square),
        denominator=(1.0 + middle + square, 2.0 * (square - 1.0), 1.0 - middle + square),
        rate_hz=rate_hz,
    )


def cascaded_low_pass(order: int, cutoff_hz: float, rate_hz: float) -> KnownFilter:
    r"""Equal first-order low-passes in a row: PT1, PT2 and PT3 of Betaflight.

    .. math:: H = \left( \frac{k}{1 - (1 - k) z^{-1}} \right)^n, \qquad
        k = \frac{\Delta t}{\Delta t + RC}, \qquad RC = \frac{\sqrt{2^{1/n} - 1}}{2 \pi f_c}

    so that the cutoff of the row, not of its stages, is :math:`f_c` (for a fast loop; the stages are backward
    differences and not prewarped).

    Parameters
    ----------
    order
        Number of stages.
    cutoff_hz
        Frequency at which about 0.707 is left.
    rate_hz
        Rate of the filter.

    Raises
    ------
    UsageError
        The cutoff does not lie between a hundred-thousandth and half of the rate.

    Examples
    --------
    >>> round(1e3 * cascaded_low_pass(1, 100.0, 8000.0).delay_s, 3)
    1.592
    """
    _require_in_band(cutoff_hz, rate_hz)
    time_constant_s = math.sqrt(2.0 ** (1.0 / order) - 1.0) / (2.0 * math.pi * cutoff_hz)
    gain = 1.0 / (1.0 + time_constant_s * rate_hz)
    denominator = np.polynomial.polynomial.polypow([1.0, gain - 1.0], order)
    return KnownFilter(
        name=f"PT{order} low-pass at {cutoff_hz:.4g} Hz",
        numerator=(gain**order,),
        denominator=tuple(float(value) for value in denominator),
        rate_hz=rate_hz,
    )


def notch(center_hz: float, quality: float, rate_hz: float, *, floor: float = 0.0) -> KnownFilter:
    r"""Second-order notch.

    .. math:: H = \frac{(1 + \alpha d) - 2 \cos\omega_0 z^{-1} + (1 - \alpha d) z^{-2}}
        {(1 + \alpha) - 2 \cos\omega_0 z^{-1} + (1 - \alpha) z^{-2}}, \qquad
        \alpha = \frac{\sin \omega_0}{2 Q}, \qquad \omega_0 = \frac{2 \pi f_0}{f_s}

    Parameters
    ----------
    center_hz
        Frequency of the notch.
    quality
        :math:`Q`, center over bandwidth. How each autopilot makes it of its parameters is said where they are read.
    rate_hz
        Rate of the filter.
    floor
        :math:`d`, what is left of the amplitude at the center: zero for Betaflight and PX4.

    Raises
    ------
    UsageError
        The center does not lie between a hundred-thousandth and half of the rate, or the quality is not positive.

    Examples
    --------
    >>> deep = notch(100.0, 2.0, 1000.0)
    >>> abs(deep.response(np.array([0.0, 2.0 * np.pi * 100.0]))).round(12)
    array([1., 0.])
    """
    _require_in_band(center_hz, rate_hz)
    if not quality > 0.0:
        raise UsageError(f"got a notch of quality {quality:g}", needed="a positive quality")
    angle = 2.0 * math.pi * center_hz / rate_hz
    damping, cosine = math.sin(angle) / (2.0 * quality), math.cos(angle)
    return KnownFilter(
        name=f"notch at {center_hz:.4g} Hz",
        numerator=(1.0 + damping * floor, -2.0 * cosine, 1.0 - damping * floor),
        denominator=(1.0 + damping, -2.0 * cosine, 1.0 - damping),
        rate_hz=rate_hz,
    )


def moving_average(span_s: float, rate_hz: float) -> KnownFilter:
    """Mean of the newest samples that fall into a span.

    Where the span is no whole number of samples, the mean of the two nearest whole numbers, as often as each occurs.

    Parameters
    ----------
    span_s
        Length.
    rate_hz
        Rate of the samples.

    Raises
    ------
    UsageError
        Less than one sample falls into the span, or more than 100 000 do.

    Examples
    --------
    >>> round(1e3 * moving_average(0.0025, 1000.0).delay_s, 6)
    0.75
    """
    taps = _taps(span_s, rate_hz, lambda count: np.full(count, 1.0 / count))
    return _mean(f"mean of the samples of {1e3 * span_s:.3g} ms", taps, rate_hz)


def integral_mean(span_s: float, rate_hz: float) -> KnownFilter:
    r"""Integral over a span by trapezoids, divided by the span: angles and velocities that estimators are fed with.

    .. math:: H = \frac{1}{2n} \sum_{k=0}^{n-1} \left( z^{-k} + z^{-k-1} \right), \qquad n = f_s \, \text{span}

    Its delay is half of the span whatever the rate. A span of no whole number of samples is taken as in
    :func:`moving_average`.

    Parameters
    ----------
    span_s
        Length.
    rate_hz
        Rate of the samples.

    Raises
    ------
    UsageError
        Less than one sample falls into the span, or more than 100 000 do.

    Examples
    --------
    >>> round(1e3 * integral_mean(0.0025, 1000.0).delay_s, 6)
    1.25
    """
    taps = _taps(span_s, rate_hz, lambda count: np.convolve(np.full(count, 1.0 / count), [0.5, 0.5]))
    return _mean(f"integral over {1e3 * span_s:.3g} ms", taps, rate_hz)


def _taps(span_s: float, rate_hz: float, of_count: Callable[[int], FloatArray]) -> FloatArray:
    samples = span_s * rate_hz
    if not 1.0 - _WHOLE <= samples <= _MOST_SAMPLES:
        raise UsageError(f"got a mean over {samples:.3g} samples", needed=f"a span of 1 to {_MOST_SAMPLES} samples")
    count = math.floor(samples + _WHOLE)
    share = samples - count
    shorter = of_count(count)
    if share < _WHOLE:
        return shorter
    longer = of_count(count + 1)
    return np.pad((1.0 - share) * shorter, (0, longer.size - shorter.size)) + share * longer


def _mean(name: str, taps: FloatArray, rate_hz: float) -> KnownFilter:
    return KnownFilter(name=name, numerator=tuple(float(tap) for tap in taps), denominator=(1.0,), rate_hz=rate_hz)


def _require_in_band(frequency_hz: float, rate_hz: float) -> None:
    # Far below, the coefficients cancel to the last digit: no autopilot's single precision would run such a filter.
    low_hz, high_hz = _SLOWEST * rate_hz, 0.5 * rate_hz
    if not low_hz < frequency_hz < high_hz:
        raise UsageError(
            f"got a filter at {frequency_hz:.4g} Hz",
            needed=f"between {low_hz:.4g} and {high_hz:.4g} Hz, half of its rate",
        )
