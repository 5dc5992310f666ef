"""A mode narrower than the spectral lines that look at it: what the correction of leakage wins, and what it leaves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.estimate import Leakage, frequency_response
from rotorid.typing import ComplexArray, FloatArray

RATE_HZ = 100.0
SAMPLES = 7000
MODE_RAD_S, DAMPING = 8.0, 0.05
"""Its half-power width of 0.8 rad/s stands against a line of 0.45 rad/s for the longest window."""

NOISE = 0.1
FLIGHTS = 12
WINDOWS_S = (14.0, 9.0, 6.0, 4.0, 2.5)
OMEGA = np.geomspace(1.0, 50.0, 100)
PEAK = np.abs(np.log(OMEGA / MODE_RAD_S)) < 0.1
FAR = np.abs(np.log(OMEGA / MODE_RAD_S)) > 0.5

NUMERATOR, DENOMINATOR, _ = signal.cont2discrete(
    ([MODE_RAD_S**2], [1.0, 2.0 * DAMPING * MODE_RAD_S, MODE_RAD_S**2]),  # type: ignore[list-item]
    1.0 / RATE_HZ,  # type: ignore[list-item]
)


def plant(omega_rad_s: FloatArray) -> ComplexArray:
    """The zero-order-hold equivalent, exact at the samples."""
    return np.asarray(signal.freqz(NUMERATOR.ravel(), DENOMINATOR, worN=omega_rad_s / RATE_HZ)[1])


def fly(seed: int) -> TimeHistory:
    """A random binary excitation, rest before and after, and noise of a tenth of the answer over all frequencies."""
    rng = np.random.default_rng(seed)
    u = np.sign(signal.lfilter([0.1], [1.0, -0.9], rng.standard_normal(SAMPLES)))
    u[:500] = u[-500:] = 0.0
    y = signal.lfilter(NUMERATOR.ravel(), DENOMINATOR, u)
    noise = signal.lfilter([0.25], [1.0, -0.97], rng.standard_normal(SAMPLES))
    values = np.stack([u, y + NOISE * y.std() * noise / noise.std()])
    channels = (Channel(name="pitch_command", unit="1"), Channel(name="theta", unit="rad"))
    return TimeHistory(values=values, channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def study(leakage: Leakage) -> list[FrequencyResponse]:
    return [
        frequency_response(
            [fly(seed)],
            inputs=["pitch_command"],
            outputs=["theta"],
            omega_rad_s=OMEGA,
            windows_s=WINDOWS_S,
            leakage=leakage,
        )
        for seed in range(FLIGHTS)
    ]


def error(results: list[FrequencyResponse]) -> ComplexArray:
    """Relative errors, shape ``(flights, f)``."""
    return np.stack([result.values[0, 0] / plant(result.omega_rad_s) - 1.0 for result in results])


def spread(results: list[FrequencyResponse]) -> FloatArray:
    """Actual over stated errors at each frequency."""
    stated = np.stack([result.random_error[0, 0] for result in results])
    size = np.stack([np.abs(result.values[0, 0] / plant(result.omega_rad_s)) for result in results])
    return np.asarray(np.sqrt(np.mean(np.abs(error(results)) ** 2 / (2.0 * (stated * size) ** 2), axis=0)))


@pytest.fixture(scope="module")
def corrected() -> list[FrequencyResponse]:
    return study("corrected")


@pytest.fixture(scope="module")
def left_at_the_peak(corrected: list[FrequencyResponse]) -> float:
    """Share of the bias at the peak that the correction leaves."""
    at_peak = np.isin(corrected[0].omega_rad_s, OMEGA[PEAK])
    left, whole = (np.abs(error(results).mean(axis=0))[at_peak].max() for results in (corrected, study("ignored")))
    return float(left / whole)


@pytest.mark.xfail(strict=True, raises=AssertionError, reason="80.2 % is left: the windows are wider than the peak")
def test_the_correction_takes_a_fifth_of_the_bias_at_the_peak_away(left_at_the_peak: float) -> None:
    assert left_at_the_peak < 0.8


def test_the_correction_takes_nearly_a_fifth_of_the_bias_at_the_peak_away(left_at_the_peak: float) -> None:
    assert left_at_the_peak < 0.82


def test_far_from_the_mode_errors_are_as_stated(corrected: list[FrequencyResponse]) -> None:
    far = np.isin(corrected[0].omega_rad_s, OMEGA[FAR])
    # Twelve flights with some ten independent frequencies each tell a mean square within a few tenths.
    assert np.sqrt(np.mean(spread(corrected)[far] ** 2)) == pytest.approx(1.0, abs=0.2)


@pytest.fixture(scope="module")
def spread_at_the_peak(corrected: list[FrequencyResponse]) -> float:
    at_peak = np.isin(corrected[0].omega_rad_s, OMEGA[PEAK])
    return float(spread(corrected)[at_peak].max())


@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="10.4: stated errors know noise only, not the smear of a narrow peak that is left",
)
def test_at_the_peak_errors_are_as_stated(spread_at_the_peak: float) -> None:
    assert spread_at_the_peak < 2.0


def test_at_the_peak_errors_are_not_further_off_than_is_said(spread_at_the_peak: float) -> None:
    assert spread_at_the_peak < 11.0
