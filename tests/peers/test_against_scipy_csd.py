"""Our densities against ``scipy.signal`` on equal settings: the same windows, taper, overlap and frequencies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rotorid.data.record import Channel, TimeHistory
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.spectra import SpectralMatrix, spectral_matrices
from rotorid.spectral.windows import HALF_SINE, HANN, Taper
from rotorid.typing import FloatArray

RATE_HZ = 100.0
WINDOW_S = 8.0


def _record(samples: int) -> TimeHistory:
    rng = np.random.default_rng(0)
    values = rng.standard_normal((3, samples))
    values[2] += signal.lfilter([0.3, 0.2], [1.0, -0.7], values[0]) + 4.0
    channels = tuple(Channel(name=name, unit="1") for name in ("u", "w", "y"))
    return TimeHistory(values=values, channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def _settings(matrix: SpectralMatrix, taper: Taper, block: int) -> dict[str, object]:
    length = matrix.window.blocks * block
    return {
        "fs": RATE_HZ,
        "window": taper.samples(length),
        "nperseg": length,
        "noverlap": length - matrix.window.hop * block,
        "detrend": False,
        "scaling": "density",
    }


@pytest.mark.parametrize("taper", [HALF_SINE, HANN], ids=lambda taper: taper.name)
@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.8])
# A whole number of blocks for each overlap: scipy uses every sample, we leave an incomplete last block out.
@pytest.mark.parametrize("samples", [800, 16_000])
def test_every_density_agrees_to_rounding(taper: Taper, overlap: float, samples: int) -> None:
    history = _record(samples)
    lines = 2.0 * np.pi / WINDOW_S * np.arange(2, 380)
    (matrix,), grid = spectral_matrices([history], lines, windows_s=[WINDOW_S], overlap=overlap, taper=taper)
    assert samples % grid.samples_per_block == 0
    settings = _settings(matrix, taper, grid.samples_per_block)
    centered: FloatArray = history.values - history.values.mean(axis=1, keepdims=True)
    bound = 1e-12 * np.abs(matrix.values).max()
    for a in range(3):
        for b in range(3):
            _, density = signal.csd(centered[a], centered[b], **settings)
            assert np.abs(matrix.values[:, a, b] - density[2:380]).max() <= bound
        _, density = signal.welch(centered[a], **settings)
        assert np.abs(matrix.values[:, a, a] - density[2:380]).max() <= bound


def test_a_response_of_one_window_length_is_the_ratio_of_scipy_densities() -> None:
    history = _record(16_000)
    lines = 2.0 * np.pi / WINDOW_S * np.arange(2, 300)
    response = frequency_response(
        [history],
        inputs=["u"],
        outputs=["y"],
        omega_rad_s=lines,
        windows_s=[WINDOW_S],
        taper=HALF_SINE,
        leakage="ignored",
    )
    (matrix,), grid = spectral_matrices([history], lines, windows_s=[WINDOW_S], taper=HALF_SINE)
    settings = _settings(matrix, HALF_SINE, grid.samples_per_block)
    u, _, y = history.values - history.values.mean(axis=1, keepdims=True)
    ratio = signal.csd(u, y, **settings)[1] / signal.welch(u, **settings)[1]
    assert np.abs(response.values[0, 0] - ratio[2:300]).max() <= 1e-11 * np.abs(ratio).max()
