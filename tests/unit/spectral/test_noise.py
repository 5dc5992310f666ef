"""Noise spectra of signals whose density, lines and delays are known."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.spectral.noise import (
    by_level,
    lines,
    measured_delay,
    nearest_harmonic,
    peaks,
    short_spectra,
    stretches,
    unexplained,
)
from rotorid.typing import FloatArray

RATE_HZ = 1000.0


def clock(duration_s: float) -> FloatArray:
    return np.arange(round(duration_s * RATE_HZ)) / RATE_HZ


def test_white_noise_has_its_density() -> None:
    """The average over 20 seeds is the density to 1 %."""
    rng, density, mean = np.random.default_rng(1), 0.02, []
    for _ in range(20):
        values = rng.normal(scale=np.sqrt(density * RATE_HZ / 2.0), size=6000)
        spectra = short_spectra(clock(6.0), values)
        assert spectra is not None
        mean.append(spectra.density.mean(axis=0)[5:-5].mean())
    assert np.mean(mean) == pytest.approx(density, rel=0.01)


def test_the_sum_of_a_density_is_the_mean_square() -> None:
    time_s = clock(5.0)
    spectra = short_spectra(time_s, 3.0 * np.sin(2.0 * np.pi * 123.4 * time_s))
    assert spectra is not None
    assert spectra.density.sum(axis=1).mean() * spectra.bin_hz == pytest.approx(4.5, rel=0.01)


def test_windows_stay_within_batches() -> None:
    time_s = np.concatenate([start + np.arange(512) / 1979.0 for start in (0.0, 1.0, 2.5)])
    spectra = short_spectra(time_s, np.sin(2.0 * np.pi * 300.0 * time_s))

    assert [part.stop - part.start for part in stretches(time_s)] == [512] * 3
    assert spectra is not None
    assert spectra.time_s.size == 3
    assert spectra.bin_hz == pytest.approx(1979.0 / 512)
    assert all(abs(peaks(spectra.frequency_hz, row)[0].frequency_hz - 300.0) < 0.3 for row in spectra.density)


def flight_with_lines(seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Throttle up and down, a rotor at 80 + 200·throttle Hz with its second harmonic, a frame at 170 Hz, and noise."""
    rng, time_s = np.random.default_rng(seed), clock(60.0)
    throttle = 0.5 + 0.3 * np.sin(2.0 * np.pi * time_s / 20.0)
    turn = 2.0 * np.pi * np.cumsum(80.0 + 200.0 * throttle) / RATE_HZ
    values = np.sin(turn) + 0.6 * np.sin(2.0 * turn) + np.sin(2.0 * np.pi * 170.0 * time_s + 0.3)
    return time_s, throttle, values + rng.normal(scale=1.0, size=time_s.size)


def test_a_rotor_moves_with_the_throttle_and_the_frame_stays() -> None:
    time_s, throttle, values = flight_with_lines(2)
    spectra = short_spectra(time_s, values)
    assert spectra is not None
    level = np.interp(spectra.time_s, time_s, throttle)
    found = by_level(spectra, level, edges=np.linspace(0.0, 1.0, 26))

    assert found.level[0] == pytest.approx(0.22)
    assert found.level[-1] == pytest.approx(0.78)
    seen = lines(found, spectra.frequency_hz, above_hz=30.0)
    rotors = sorted((line for line in seen if line.maker == "rotor"), key=lambda line: -line.level.size)[:2]
    frame = next(line for line in seen if line.maker == "frame")
    assert sorted(line.slope_hz for line in rotors) == pytest.approx([200.0, 400.0], rel=0.12)
    assert np.median(frame.frequency_hz) == pytest.approx(170.0, abs=1.0)


def test_harmonics_of_the_nearest_rotor() -> None:
    rotors = np.array([[100.0, 110.0, 120.0], [104.0, 115.0, 126.0]])
    found = nearest_harmonic(np.array([104.5, 229.0, 361.0]), rotors)

    assert found.order.tolist() == [1, 2, 3]
    np.testing.assert_allclose(found.distance_hz, [0.5, 1.0, 1.0])


def test_delay_of_a_filter_is_told_inside_its_error() -> None:
    rng, errors = np.random.default_rng(3), []
    for _ in range(20):
        before = rng.normal(size=20_000)
        after = np.concatenate([np.zeros(4), before[:-4]]) + 0.3 * rng.normal(size=before.size)
        delay = measured_delay(clock(20.0), before, after, band_hz=(5.0, 80.0))
        assert delay is not None
        errors.append((delay.delay_s - 0.004) / delay.std_s)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.45)


def test_what_the_set_point_explains_is_no_noise() -> None:
    rng, time_s = np.random.default_rng(4), clock(40.0)
    asked, noise = rng.normal(size=time_s.size), rng.normal(scale=0.5, size=time_s.size)
    bands = unexplained(time_s, 2.0 * asked + noise, asked, bands_hz=[(100.0, 300.0)])

    assert bands is not None
    (found,) = bands
    assert found.rms == pytest.approx(0.5 * np.sqrt(200.0 / 500.0), rel=0.05)
    assert abs(found.rms - 0.5 * np.sqrt(0.4)) < 4.0 * found.std
