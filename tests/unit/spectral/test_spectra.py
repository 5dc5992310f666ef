"""Levels and symmetries of spectral matrices."""

from __future__ import annotations

import pickle
from collections.abc import Sequence

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import UsageError
from rotorid.spectral.spectra import spectral_matrices
from rotorid.spectral.windows import HALF_SINE, HANN, Taper
from rotorid.typing import FloatArray

RATE_HZ = 100.0


def record(values: FloatArray, *, rate_hz: float = RATE_HZ, names: Sequence[str] | None = None) -> TimeHistory:
    names = names or [f"channel_{row}" for row in range(len(values))]
    channels = tuple(Channel(name=name, unit="1") for name in names)
    return TimeHistory(values=values, channels=channels, sample_rate_hz=rate_hz, start_s=0.0)


@pytest.mark.parametrize("taper", [HALF_SINE, HANN], ids=lambda taper: taper.name)
def test_white_noise_has_the_density_of_its_variance(taper: Taper) -> None:
    sigma, duration_s, window_s = 3.0, 2000.0, 2.0
    noise = sigma * np.random.default_rng(0).standard_normal((1, int(duration_s * RATE_HZ)))
    omega = np.linspace(5.0, 300.0, 150)
    (matrix,), _ = spectral_matrices([record(noise)], omega, windows_s=[window_s], taper=taper)
    mean = matrix.values[:, 0, 0].real.mean()
    # The band holds about 47 Hz * 2000 s independent values of relative variance one.
    standard_error = 1.0 / np.sqrt((omega[-1] - omega[0]) / (2.0 * np.pi) * duration_s)
    assert mean / (sigma**2 * 2.0 / RATE_HZ) == pytest.approx(1.0, abs=4.0 * standard_error)


@pytest.mark.parametrize("taper", [HALF_SINE, HANN], ids=lambda taper: taper.name)
def test_the_line_of_a_sine_holds_its_power(taper: Taper) -> None:
    amplitude, line = 2.0, 2.0 * np.pi * 5.0
    time_s = np.arange(int(60.0 * RATE_HZ)) / RATE_HZ
    sine = amplitude * np.sin(line * time_s)[None, :]
    # Integration over the whole one-sided axis on the grid of the window is exact (Parseval).
    omega = 2.0 * np.pi * np.arange(1, int(4.0 * RATE_HZ / 2)) / 4.0
    (matrix,), _ = spectral_matrices([record(sine)], omega, windows_s=[4.0], taper=taper)
    lowest = 2.0 * 2.0 * np.pi / 4.0
    power = matrix.values[:, 0, 0].real.sum() / 4.0
    assert matrix.omega_rad_s[0] == pytest.approx(lowest)
    # A half-sine's side lobes fall with the square of the distance in lines: (1 / 20**2)**2 at the missing first line.
    assert power == pytest.approx(amplitude**2 / 2.0, rel=1e-4)


def test_matrices_are_hermitian_with_real_positive_diagonals() -> None:
    values = np.random.default_rng(1).standard_normal((4, 6000))
    values[2] += np.roll(values[0], 7)
    matrices, _ = spectral_matrices([record(values)], np.geomspace(2.0, 100.0, 40), windows_s=[12.0, 6.0, 3.0])
    for matrix in matrices:
        scale = np.abs(matrix.values).max()
        assert np.abs(matrix.values - np.swapaxes(matrix.values.conj(), 1, 2)).max() <= 1e-14 * scale
        assert np.linalg.eigvalsh(matrix.values).min() >= -1e-12 * scale


def test_the_phase_of_a_delay_is_negative() -> None:
    delay = 12
    source = np.random.default_rng(2).standard_normal(20_000 + delay)
    values = np.stack([source[delay:], source[:-delay]])
    (matrix,), _ = spectral_matrices([record(values)], np.array([2.0, 5.0]), windows_s=[20.0])
    # Only the samples that enter and leave at the ends of a window differ: a share of the delay over its length.
    expected = np.exp(-1j * matrix.omega_rad_s * delay / RATE_HZ)
    response = matrix.values[:, 0, 1] / matrix.values[:, 0, 0]
    assert np.abs(response - expected).max() < 3.0 * np.pi * delay / (20.0 * RATE_HZ)


def test_a_window_counts_from_two_periods_on() -> None:
    values = np.random.default_rng(3).standard_normal((1, 6000))
    omega = np.geomspace(0.5, 50.0, 60)
    matrices, grid = spectral_matrices([record(values)], omega, windows_s=[20.0, 5.0])
    for matrix in matrices:
        assert matrix.window_s == pytest.approx(matrix.window.blocks * grid.block_s)
        assert matrix.omega_rad_s[0] >= 2.0 * 2.0 * np.pi / matrix.window_s * (1.0 - 1e-9)
        assert np.array_equal(matrix.omega_rad_s, omega[-matrix.omega_rad_s.size :])
    assert matrices[0].averages == pytest.approx(60.0 / 20.0)


def test_an_offset_changes_nothing() -> None:
    values = np.random.default_rng(4).standard_normal((2, 6000))
    omega = np.geomspace(2.0, 100.0, 20)
    (plain,), _ = spectral_matrices([record(values)], omega, windows_s=[5.0])
    (shifted,), _ = spectral_matrices([record(values - 9.81)], omega, windows_s=[5.0])
    assert np.abs(shifted.values - plain.values).max() <= 1e-12 * np.abs(plain.values).max()


def test_matrices_stay_read_only_through_a_pickle() -> None:
    values = np.random.default_rng(5).standard_normal((1, 3000))
    (matrix,), _ = spectral_matrices([record(values)], np.array([5.0, 9.0]), windows_s=[5.0])
    again = pickle.loads(pickle.dumps(matrix))
    for name in ("omega_rad_s", "values", "transforms", "starts"):
        assert np.array_equal(getattr(again, name), getattr(matrix, name))
        assert not getattr(again, name).flags.writeable


NOISE = np.random.default_rng(6).standard_normal((2, 3000))
GRID = np.array([5.0, 9.0])


@pytest.mark.parametrize(
    ("records", "omega", "windows_s", "word"),
    [
        ([record(NOISE)], np.array([5.0, 315.0]), [5.0], "Nyquist"),
        ([record(NOISE), record(NOISE, rate_hz=50.0)], GRID, [5.0], "rates"),
        ([record(NOISE), record(NOISE, names=["channel_0", "q"])], GRID, [5.0], "channels"),
        ([], GRID, [5.0], "0 records"),
        ([record(NOISE)], GRID, [], "window"),
        ([record(NOISE)], GRID, [5.0, 0.0], "window"),
        ([record(NOISE)], GRID[::-1], [5.0], "rise"),
        ([record(NOISE)], np.array([0.0, 5.0]), [5.0], "rise"),
        ([record(NOISE)], np.array([]), [5.0], "rise"),
        ([record(NOISE)], np.array([5.0, np.nan, 9.0]), [5.0], "rise"),
        ([record(NOISE)], np.ones((2, 2)), [5.0], "shape"),
        ([record(NOISE)], GRID, [np.nan], "window"),
        ([record(NOISE)], GRID, [5.0, np.inf], "window"),
    ],
    ids=[
        "nyquist",
        "rates",
        "channels",
        "no_record",
        "no_window",
        "zero_window",
        "falling",
        "zero_omega",
        "no_omega",
        "nan_omega",
        "two_rows",
        "nan_window",
        "endless_window",
    ],
)
def test_wrong_use_is_refused_in_words(
    records: list[TimeHistory], omega: FloatArray, windows_s: list[float], word: str
) -> None:
    with pytest.raises(UsageError, match=word):
        spectral_matrices(records, omega, windows_s=windows_s)


@pytest.mark.parametrize("overlap", [-0.5, 1.0, np.nan])
def test_an_overlap_that_is_none_is_refused(overlap: float) -> None:
    with pytest.raises(UsageError, match="overlap"):
        spectral_matrices([record(NOISE)], GRID, windows_s=[5.0], overlap=overlap)


def test_only_the_transforms_that_are_wanted_are_kept() -> None:
    records = [record(NOISE), record(NOISE[:, :1700])]
    (full,), _ = spectral_matrices(records, GRID, windows_s=[5.0], slopes_of=["channel_0"])
    (short,), _ = spectral_matrices(records, GRID, windows_s=[5.0], slopes_of=["channel_0"], kept=1)
    assert np.array_equal(short.transforms, full.transforms[:, :1])
    assert np.array_equal(short.values, full.values)
    assert full.transforms.shape[1] == len(full.channels) == 3
