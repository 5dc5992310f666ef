r"""Finite Fourier transforms of sampled records over a band, and those of their derivatives without differentiating.

.. math:: \tilde x(\omega) = \int_0^T x(t) \, e^{-j\omega t} dt, \qquad
    \tilde{\dot x}(\omega) = j\omega \, \tilde x(\omega) + x(T) \, e^{-j\omega T} - x(0)

The terms of the ends are exact for records that do not repeat. Between samples a record goes straight (E. A. Morelli,
*High Accuracy Evaluation of the Finite Fourier Transform Using Sampled Data*, NASA TM-110340, 1997, goes on a cubic;
what the straight line loses, :math:`\mathrm{sinc}^2(\omega h / 2)`, all channels lose alike).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from rotorid.typing import ComplexArray, FloatArray

if TYPE_CHECKING:
    from scipy.signal import CZT

_REMEMBERED = 16
"""Sizes of records and bands whose chirps are kept: making them costs ten times as much as using them."""


def finite_transform(values: FloatArray, *, sample_rate_hz: float, omega_rad_s: FloatArray) -> ComplexArray:
    """Transform of samples over their own duration, time counted from the first of them.

    Parameters
    ----------
    values
        Shape ``(..., n)``.
    sample_rate_hz
        Their rate.
    omega_rad_s
        Shape ``(f,)``, above zero.

    Returns
    -------
    numpy.ndarray
        Shape ``(..., f)``, unit of the values times seconds.

    Examples
    --------
    >>> time_s = np.arange(0.0, 5.0005, 0.001)
    >>> omega = np.array([2.0, 7.0])
    >>> exact = (1.0 - np.exp(-(1.0 + 1j * omega) * 5.0)) / (1.0 + 1j * omega)
    >>> found = finite_transform(np.exp(-time_s), sample_rate_hz=1000.0, omega_rad_s=omega)
    >>> bool(np.abs(found / exact - 1.0).max() < 1e-5)
    True
    """
    omega = np.asarray(omega_rad_s, dtype=np.float64)
    step, count = 1.0 / sample_rate_hz, values.shape[-1]
    if _evenly_spaced(omega):
        turn, begin = np.exp(-1j * (omega[1] - omega[0]) * step), np.exp(1j * omega[0] * step)
        total = _chirp(count, omega.size, complex(turn), complex(begin))(values)
    else:
        total = values @ np.exp(-1j * step * np.outer(np.arange(count), omega))
    s = 1j * omega
    end = np.exp(-s * (count - 1) * step)
    # A sample inside stands for a whole hat, one at an end for half of it.
    hat = step * np.sinc(0.5 * omega * step / np.pi) ** 2
    half = 1.0 / s - (1.0 - np.exp(-s * step)) / (s**2 * step)
    first, last = values[..., :1], values[..., -1:]
    return np.asarray(hat * (total - first - last * end) + first * half + last * half.conj() * end)


def derivative_transform(values: FloatArray, *, sample_rate_hz: float, omega_rad_s: FloatArray) -> ComplexArray:
    """Transform of the derivative of samples; arguments and shape as for :func:`finite_transform`."""
    omega = np.asarray(omega_rad_s, dtype=np.float64)
    whole = finite_transform(values, sample_rate_hz=sample_rate_hz, omega_rad_s=omega)
    end = np.exp(-1j * omega * (values.shape[-1] - 1) / sample_rate_hz)
    return np.asarray(1j * omega * whole + values[..., -1:] * end - values[..., :1])


def late_transform(
    values: FloatArray, *, first: int, count: int, delay_s: float, sample_rate_hz: float, omega_rad_s: FloatArray
) -> ComplexArray:
    r"""Transform of a signal that comes late by any fraction of a sample, over a window inside its record.

    .. math:: \int_0^T x(t - \tau) \, e^{-j\omega t} dt = e^{-j\omega\tau}
        \int_{-\tau}^{T - \tau} x(t) \, e^{-j\omega t} dt

    Whole samples move the window; what is left of the delay, half a sample at most, turns the phase exactly and moves
    the ends of the window, over which the record goes straight.

    Parameters
    ----------
    values
        The whole record, shape ``(n,)``.
    first, count
        Window: its first sample and the number of samples in it. It must hold when moved by the delay.
    delay_s
        Above zero for a late signal.
    sample_rate_hz, omega_rad_s
        As for :func:`finite_transform`.
    """
    whole = round(delay_s * sample_rate_hz)
    rest_s = delay_s - whole / sample_rate_hz
    begin, omega = first - whole, np.asarray(omega_rad_s, dtype=np.float64)
    inside = finite_transform(values[begin : begin + count], sample_rate_hz=sample_rate_hz, omega_rad_s=omega)
    stamps = (np.arange(values.size) - begin) / sample_rate_hz
    duration_s = (count - 1) / sample_rate_hz
    ends = np.interp([-0.5 * rest_s, duration_s - 0.5 * rest_s], stamps, values)
    moved = rest_s * np.sinc(0.5 * omega * rest_s / np.pi)
    edge = ends[0] * np.exp(0.5j * omega * rest_s) - ends[1] * np.exp(-1j * omega * (duration_s - 0.5 * rest_s))
    return np.asarray((inside + moved * edge) * np.exp(-1j * omega * rest_s))


@lru_cache(maxsize=_REMEMBERED)
def _chirp(count: int, lines: int, turn: complex, begin: complex) -> CZT:
    """What a chirp transform needs that does not depend on the values; nothing changes it afterwards."""
    from scipy.signal import CZT

    return CZT(count, lines, turn, begin)


def _evenly_spaced(omega: FloatArray) -> bool:
    return omega.size > 2 and bool(np.allclose(np.diff(omega), omega[1] - omega[0], rtol=1e-9, atol=0.0))
