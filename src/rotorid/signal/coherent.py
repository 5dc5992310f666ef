"""Cross-spectra of two channels and their coherent lines: what skews and consistency are measured from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import BoolArray, ComplexArray, FloatArray

LEAST_COHERENCE = 0.6
"""Lines below it are not used, after Tischler and Remple."""

_WINDOWS = 10
_LONGEST_WINDOW_S = 20.0
_SHORTEST_WINDOW = 16
_LOWEST_PERIODS = 2
_NYQUIST_SHARE = 0.8
_LEAST_LINES = 3
_CERTAIN = 1.0 - 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossSpectrum:
    r"""Spectral lines of two channels, averaged over Hann windows that overlap by half.

    .. math:: S_{ab} = \frac1K \sum_k A_k^* B_k

    Parameters
    ----------
    omega_rad_s
        Lines, one over the window length apart, shape ``(f,)``.
    first, second, cross
        Powers of the two channels and :math:`S_{ab}`, shape ``(f,)``, on a common scale.
    averages
        Independent windows, :math:`n_d = T / T_{win}`. With lines :math:`1 / T_{win}` apart this counts every piece of
        information once, although windows and lines overlap.
    window_s
        Length of the windows.
    """

    omega_rad_s: FloatArray
    first: FloatArray
    second: FloatArray
    cross: ComplexArray
    averages: float
    window_s: float

    @property
    def coherence(self) -> FloatArray:
        """Coherence of each line, shape ``(f,)``; zero where a channel has no power."""
        power = self.first * self.second
        return np.asarray(np.divide(np.abs(self.cross) ** 2, power, out=np.zeros_like(power), where=power > 0.0))

    @property
    def weight(self) -> FloatArray:
        r"""Inverse variance of the phase and of the logarithm of the gain, :math:`2 n_d \gamma^2 / (1 - \gamma^2)`."""
        coherence = np.minimum(self.coherence, _CERTAIN)
        return np.asarray(2.0 * self.averages * coherence / (1.0 - coherence))

    def only(self, kept: BoolArray) -> CrossSpectrum:
        """Some of the lines."""
        return replace(
            self,
            omega_rad_s=self.omega_rad_s[kept],
            first=self.first[kept],
            second=self.second[kept],
            cross=self.cross[kept],
        )


def cross_spectrum(
    history: TimeHistory, first: str, second: str, *, band_rad_s: tuple[float, float] | None = None
) -> CrossSpectrum:
    """Lines of two channels from ten lengths of windows, at most 20 s each, without mean and trend.

    Parameters
    ----------
    history
        Both channels on one clock.
    first, second
        Channel names.
    band_rad_s
        Cut to two periods in a window at the low end; up to 0.8 of the Nyquist frequency when it is not given.

    Raises
    ------
    UsageError
        There is no such channel, or the band is empty.
    InsufficientDataError
        Ten windows of 16 samples do not fit, or samples are not finite.
    """
    for name in (first, second):
        if name not in history.names:
            raise UsageError(f"there is no channel {name} in the data", needed=f"one of {', '.join(history.names)}")
    count = history.values.shape[1]
    length = min(count // _WINDOWS, int(_LONGEST_WINDOW_S * history.sample_rate_hz))
    pair = np.stack([history[first], history[second]])
    if length < _SHORTEST_WINDOW or not np.isfinite(pair).all():
        raise InsufficientDataError(
            f"{count} samples of {first} and {second} came",
            needed=f"at least {_WINDOWS * _SHORTEST_WINDOW} samples, all finite",
            remedy="give a longer stretch without gaps",
        )
    spacing = 2.0 * math.pi * history.sample_rate_hz / length
    nyquist = math.pi * history.sample_rate_hz
    low, high = band_rad_s or (0.0, _NYQUIST_SHARE * nyquist)
    if not 0.0 <= low < high:
        raise UsageError(f"the band {low:g}:{high:g} rad/s is empty", needed="0 <= low < high")
    first_line = max(_LOWEST_PERIODS, math.ceil(low / spacing - 1e-9))
    last_line = math.floor(min(high, nyquist) / spacing + 1e-9)
    lines = np.arange(first_line, last_line + 1)
    a, b = _windows(pair, length)[:, :, lines]
    return CrossSpectrum(
        omega_rad_s=spacing * lines,
        first=np.mean(np.abs(a) ** 2, axis=0),
        second=np.mean(np.abs(b) ** 2, axis=0),
        cross=np.mean(a.conj() * b, axis=0),
        averages=count / length,
        window_s=length / history.sample_rate_hz,
    )


def coherent_lines(lines: CrossSpectrum, where: str) -> CrossSpectrum:
    """The lines whose coherence reaches 0.6.

    Raises
    ------
    InsufficientDataError
        They are fewer than three.
    """
    kept = lines.coherence >= LEAST_COHERENCE
    if np.count_nonzero(kept) >= _LEAST_LINES:
        return lines.only(kept)
    highest = float(lines.coherence.max(initial=0.0))
    message = f"{where} is nowhere coherent enough to see a delay; the highest coherence is {highest:.2f}."
    raise InsufficientDataError(
        message,
        needed=f"a coherence of {LEAST_COHERENCE:g} on {_LEAST_LINES} lines and more",
        remedy="choose a stretch in which both channels move, or another band",
        findings=[
            Finding(
                kind="low_coherence", severity="error", where=where, message=message, numbers={"coherence": highest}
            )
        ],
    )


def _windows(values: FloatArray, length: int) -> ComplexArray:
    """Transforms of windows without mean and trend, shape ``(channels, windows, lines)``."""
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(length) + 0.5) / length)
    stretches = np.lib.stride_tricks.sliding_window_view(values, length, axis=1)[:, :: length // 2]
    ramp = np.arange(length) - 0.5 * (length - 1)
    slopes = stretches @ ramp / (ramp @ ramp)
    level = stretches - stretches.mean(axis=-1, keepdims=True) - slopes[..., None] * ramp
    return np.asarray(np.fft.rfft(level * taper, axis=-1))
