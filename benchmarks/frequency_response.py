"""How much faster all spectra of a flight are than what users and programmers write.

Two peers: one call of scipy for each pair and window length, which is what a user writes and what the bar is for; and
one transform of NumPy for each channel and window length with products of the lines that are looked at, which is what a
programmer writes who knows what he does.

Six hundred seconds, four inputs, nine outputs, five window lengths at 80 % overlap, one hundred frequencies from 0.3 to
60 rad/s. Run ``python -m benchmarks.frequency_response``. Process time is compared, so that a busy machine does not
decide; it counts all threads, and the package gives both sides one.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import signal

from rotorid.data import Channel, TimeHistory
from rotorid.spectral import HANN, spectral_matrices
from rotorid.typing import ComplexArray, FloatArray

RATES_HZ = (200.0, 1000.0)
DURATION_S = 600.0
INPUTS, OUTPUTS = 4, 9
WINDOWS_S = (5.0, 10.0, 15.0, 20.0, 40.0)
OVERLAP = 0.8
OMEGA_RAD_S = np.geomspace(0.3, 60.0, 100)
BAR, MEMORY_BAR_GIB = 100.0, 1.0
REPEATS = 7
"""Ours is a matter of a tenth of a second: the median of a few runs. scipy's takes many seconds: one run."""


def flight(rate_hz: float) -> TimeHistory:
    """Thirteen channels of noise: what is in them does not matter for the time."""
    values = np.random.default_rng(0).standard_normal((INPUTS + OUTPUTS, int(DURATION_S * rate_hz)))
    channels = tuple(Channel(name=f"channel_{row}", unit="1") for row in range(len(values)))
    return TimeHistory(values=values, channels=channels, sample_rate_hz=rate_hz, start_s=0.0)


def spectra_with_rotorid(history: TimeHistory) -> None:
    """Auto- and cross-spectra of all pairs, also among inputs and among outputs."""
    spectral_matrices([history], OMEGA_RAD_S, windows_s=WINDOWS_S, overlap=OVERLAP, taper=HANN)


def densities_with_scipy(history: TimeHistory) -> None:
    """Auto-spectra of every channel and cross-spectra of every input with every output."""
    values = history.values
    for window_s in WINDOWS_S:
        options = _options(window_s, history.sample_rate_hz)
        for samples in values:
            signal.welch(samples, **options)
        for source, answer in _pairs(values):
            signal.csd(source, answer, **options)


def spectra_with_numpy(history: TimeHistory) -> list[ComplexArray]:
    """The same spectra at the line next to each frequency, shape ``(channels, channels, f)`` for each window length.

    Every channel is cut and transformed once for a window length; all pairs are products of the same lines.
    """
    found = []
    for window_s in WINDOWS_S:
        length = round(window_s * history.sample_rate_hz)
        hop = length - round(OVERLAP * length)
        taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
        spacing = 2.0 * np.pi * history.sample_rate_hz / length
        kept = np.round(OMEGA_RAD_S / spacing).astype(np.int64)
        lines = []
        for samples in history.values:
            pieces = np.lib.stride_tricks.sliding_window_view(samples, length)[::hop]
            pieces = (pieces - pieces.mean(axis=1, keepdims=True)) * taper
            lines.append(np.fft.rfft(pieces, axis=1)[:, kept])
        stacked = np.moveaxis(np.array(lines), -1, 0)
        products = stacked.conj() @ np.swapaxes(stacked, 1, 2) / stacked.shape[2]
        found.append(np.moveaxis(products, 0, -1) / (history.sample_rate_hz * np.sum(taper**2)))
    return found


def coherences_with_scipy(history: TimeHistory) -> None:
    """Coherence of every input with every output, which a frugal user forms from the densities."""
    for window_s in WINDOWS_S:
        options = _options(window_s, history.sample_rate_hz)
        for source, answer in _pairs(history.values):
            signal.coherence(source, answer, **options)


def _options(window_s: float, rate_hz: float) -> dict[str, Any]:
    length = round(window_s * rate_hz)
    return {"fs": rate_hz, "window": "hann", "nperseg": length, "noverlap": round(OVERLAP * length)}


def _pairs(values: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    return [(source, answer) for source in values[:INPUTS] for answer in values[INPUTS:]]


def _seconds(action: Callable[[TimeHistory], object], history: TimeHistory) -> float:
    start = time.process_time()
    action(history)
    return time.process_time() - start


def _peak_gib() -> float:
    """Largest memory of this process so far, interpreter and data included."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**30 if sys.platform == "darwin" else peak / 2**20


def run(rate_hz: float) -> dict[str, float]:
    history = flight(rate_hz)
    ours = [_seconds(spectra_with_rotorid, history) for _ in range(REPEATS)]
    memory_gib = _peak_gib()
    transforms = float(np.median([_seconds(spectra_with_numpy, history) for _ in range(REPEATS)]))
    densities = _seconds(densities_with_scipy, history)
    coherences = _seconds(coherences_with_scipy, history)
    median = float(np.median(ours))
    return {
        "rate_hz": rate_hz,
        "rotorid_first_s": ours[0],
        "rotorid_s": median,
        "numpy_s": transforms,
        "scipy_s": densities + coherences,
        "scipy_densities_s": densities,
        "ratio": (densities + coherences) / median,
        "ratio_densities": densities / median,
        "ratio_numpy": transforms / median,
        "memory_gib": memory_gib,
    }


def main() -> None:
    """Print the numbers, one per line."""
    for rate_hz in RATES_HZ:
        for name, value in run(rate_hz).items():
            print(f"{name:18} {value:14.3f}")


if __name__ == "__main__":
    main()
