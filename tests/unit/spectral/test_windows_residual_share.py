"""What is left of a disturbance in the residuals: the trace written out, and white noise many times over."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.spectral.conditioning import ConditionedResponse, condition, conditioned_response, output_spectra
from rotorid.spectral.errors import residual_share
from rotorid.spectral.kernel import BlockGrid
from rotorid.spectral.spectra import SpectralMatrix, spectral_matrices
from rotorid.spectral.windows import HALF_SINE, HANN, Taper
from rotorid.typing import ComplexArray, FloatArray

RATE_HZ = 10.0
OMEGA = np.array([2.0, 5.0, 9.0, 15.0])
NOISES = 300


class Case(NamedTuple):
    """Seconds of each record, of the window, and how many inputs."""

    records_s: tuple[float, ...]
    window_s: float
    inputs: int = 1
    overlap: float = 0.8
    taper: Taper = HANN


CASES = {
    "many short windows": Case((120.0,), 8.0),
    "five long windows": Case((120.0,), 72.0),
    "two records": Case((60.0, 45.0), 30.0),
    "two inputs": Case((120.0,), 40.0, inputs=2),
    "half-sines": Case((120.0,), 60.0, taper=HALF_SINE),
    "no overlap": Case((120.0,), 24.0, overlap=0.0),
}


def flown(case: Case) -> tuple[SpectralMatrix, BlockGrid, ConditionedResponse]:
    """Inputs first, then channels of white noise with a variance of one."""
    rng = np.random.default_rng(7)
    rows = case.inputs + NOISES
    channels = tuple(Channel(name=f"channel_{row}", unit="1") for row in range(rows))
    records = [
        TimeHistory(
            values=rng.standard_normal((rows, round(RATE_HZ * length))),
            channels=channels,
            sample_rate_hz=RATE_HZ,
            start_s=0.0,
        )
        for length in case.records_s
    ]
    (matrix,), grid = spectral_matrices(
        records, OMEGA, windows_s=[case.window_s], overlap=case.overlap, taper=case.taper, kept=case.inputs
    )
    inputs = range(case.inputs)
    return matrix, grid, conditioned_response(matrix, instruments=inputs, inputs=inputs)


def dense(matrix: SpectralMatrix, grid: BlockGrid, taper: Taper) -> ComplexArray:
    """What the residuals of white noise have as covariance over the windows, ``(f, k, k)``, over their number."""
    count = matrix.window.blocks * grid.samples_per_block
    first = (matrix.starts * grid.samples_per_block).astype(int)
    tapers = np.zeros((first.size, first.max() + count))
    for row, start in zip(tapers, first, strict=True):
        row[start : start + count] = taper.samples(count)
    alike = tapers @ tapers.T / np.sum(taper.samples(count) ** 2)
    turn = np.exp(-1j * matrix.omega_rad_s * first[:, None] / grid.sample_rate_hz)
    left = []
    for point in range(matrix.omega_rad_s.size):
        seen = matrix.transforms[:, :, point] * turn[:, point, None]
        rest = np.eye(first.size) - seen @ np.linalg.pinv(seen)
        left.append(rest @ alike @ rest / first.size)
    return np.array(left)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_share_is_the_trace_and_what_white_noise_leaves(case: Case) -> None:
    matrix, grid, separated = flown(case)
    share = residual_share(separated, case.taper)
    left = dense(matrix, grid, case.taper)
    trace = np.einsum("fkk->f", left).real
    # Correlations of tapers are sums in both, over other numbers of samples: of the order (pi / n)**2 apart.
    samples = matrix.window.blocks * grid.samples_per_block
    np.testing.assert_allclose(share, trace, rtol=0.0, atol=(np.pi / samples) ** 2 + 1e-6)
    noise: FloatArray = np.array(
        [condition(separated, output_spectra(matrix, case.inputs + k)).noise for k in range(NOISES)]
    )
    found = noise.mean(axis=0) / (2.0 / RATE_HZ)
    # The variance of a quadratic form in complex normal numbers is the trace of the square of its matrix. Five standard
    # deviations of the mean, and what records lose with their means far below these frequencies.
    spread = np.sqrt(np.einsum("fkl,flk->f", left, left).real / NOISES)
    assert np.all(np.abs(found - trace) <= 5.0 * spread + 1e-3)


def test_of_a_few_overlapping_windows_most_is_lost_and_of_many_next_to_nothing() -> None:
    _, _, few = flown(CASES["five long windows"])
    _, _, many = flown(CASES["many short windows"])
    assert residual_share(few, HANN).max() < 0.8
    assert residual_share(many, HANN).min() > 0.9


def test_as_many_inputs_as_windows_leave_nothing_and_the_share_stays_above_zero() -> None:
    _, _, separated = flown(Case((60.0,), 60.0, inputs=1))
    np.testing.assert_array_equal(residual_share(separated, HANN), 0.05)
