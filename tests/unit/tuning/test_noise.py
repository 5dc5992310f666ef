"""Noise of the command over the whole spectrum of the gyro: the form in P and D is the integral."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter, welch

from rotorid.models.controller import RateController
from rotorid.tuning.loops import ControllerParts, Gains, frequency_grid
from rotorid.tuning.noise import RateNoise, density_behind

GAINS = Gains(P=0.12, I=0.2, D=0.003, A=6.0)
CONTROLLER = RateController(
    proportional_s=0.15, derivative_s2=0.002, derivative_cutoff_hz=40.0, step_s=1.0 / 1000.0, angle_1_s=6.0
)


def spectrum() -> RateNoise:
    omega = np.linspace(np.pi, 2.0 * np.pi * 400.0, 800)
    line = np.exp(-(((omega - 2.0 * np.pi * 180.0) / 40.0) ** 2))
    return RateNoise(omega_rad_s=omega, density=np.where(omega > 190.0, 1e-6 + 1e-4 * line, 0.0))


def parts(noise: RateNoise | None) -> ControllerParts:
    omega = frequency_grid(CONTROLLER)
    ones = np.ones(omega.size, dtype=np.complex128)
    return ControllerParts(controller=CONTROLLER, omega_rad_s=omega, filters=ones, logged=ones, gyro_noise=noise)


def test_noise_is_the_integral_over_the_whole_spectrum() -> None:
    noise = spectrum()
    response = replace(GAINS.on(CONTROLLER), integral=0.0, angle_1_s=0.0).response(noise.omega_rad_s)
    step = noise.omega_rad_s[1] - noise.omega_rad_s[0]
    expected = np.sqrt(np.sum(noise.density * np.abs(response) ** 2) * step)
    assert parts(noise).noise(GAINS) == pytest.approx(expected)


def test_a_line_of_the_rotors_counts_though_it_is_above_the_loop() -> None:
    found = parts(spectrum())
    assert found.omega_rad_s[-1] < 2.0 * np.pi * 180.0
    quiet = replace(found, controller=replace(CONTROLLER, derivative_cutoff_hz=10.0))
    assert quiet.noise(GAINS) < 0.8 * found.noise(GAINS)
    assert found.shows_noise
    assert not parts(None).shows_noise


def test_a_filter_that_is_left_out_gives_its_noise_back() -> None:
    noise = spectrum()
    response = 1.0 / (1.0 + 1j * noise.omega_rad_s / 300.0)
    passed = replace(noise, density=noise.density * np.abs(response) ** 2)
    np.testing.assert_allclose(passed.without(response).density, noise.density)


def test_a_filter_that_left_only_digits_is_taken_off_by_the_noise_beside() -> None:
    """White noise behind a digital low-pass of 120 Hz, logged in steps of 0.1 degrees per second."""
    rate_hz, level, step = 1000.0, 0.0468, math.radians(0.1)
    noise = level * np.random.default_rng(1).standard_normal(60_000)
    b, a = butter(2, 120.0, fs=rate_hz)
    logged = step * np.round(lfilter(b, a, noise) / step)
    hz, density = welch(logged, fs=rate_hz, nperseg=500)
    passed = freqz(b, a, worN=hz, fs=rate_hz)[1]
    above = hz >= 20.0
    found = density_behind(density, passed, np.ones_like(passed))[above]
    assert found.max() < 1.4 * 2.0 * level**2 / rate_hz
    assert found.sum() * (hz[1] - hz[0]) == pytest.approx(level**2 * above.mean(), rel=0.1)
    # Filters that leave less are applied as they are.
    closed = density_behind(density, passed, 0.5 * passed)
    np.testing.assert_allclose(closed, 0.25 * density)
