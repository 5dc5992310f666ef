"""A known vehicle seen through a known filter: taken off again, the filter leaves the vehicle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from rotorid.autopilots.filters import butterworth_low_pass
from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.derived import corrected, differentiated, ratio, selected
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import ComplexArray, FloatArray

RATE_HZ = 250.0
CUTOFF_HZ = 40.0
POLE, GAIN = 0.98, 0.3
OMEGA = np.geomspace(4.0, 60.0, 12)
WINDOWS_S = (12.0, 6.0)


def truth(omega_rad_s: FloatArray) -> ComplexArray:
    """A lag with one sample of delay."""
    backward = np.exp(-1j * omega_rad_s / RATE_HZ)
    return np.asarray(GAIN * backward / (1.0 - POLE * backward))


@pytest.fixture(scope="module")
def response() -> FrequencyResponse:
    """Command to the rate and to the filtered rate, which scipy's Butterworth made; without noise."""
    command = np.random.default_rng(5).standard_normal(60 * int(RATE_HZ))
    rate = lfilter([0.0, GAIN], [1.0, -POLE], command)
    filtered = lfilter(*butter(2, CUTOFF_HZ, fs=RATE_HZ), rate)
    channels = tuple(Channel(name=name, unit="1") for name in ("roll_command", "p", "p_filtered"))
    record = TimeHistory(
        values=np.stack([command, rate, filtered]), channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0
    )
    return frequency_response(
        [record], inputs=["roll_command"], outputs=["p", "p_filtered"], omega_rad_s=OMEGA, windows_s=WINDOWS_S
    )


def test_corrected_response_is_that_of_the_unfiltered_channel(response: FrequencyResponse) -> None:
    known = butterworth_low_pass(CUTOFF_HZ, RATE_HZ)
    fixed = corrected(response, {"p_filtered": [known]}).values
    # A channel that is late by a delay loses that part of the window at one end and gains it at the other.
    mismatch = np.pi * known.delay_s / min(WINDOWS_S)
    assert np.max(np.abs(fixed[1, 0] / fixed[0, 0] - 1.0)) < mismatch
    assert np.max(np.abs(response.values[1, 0] / response.values[0, 0] - 1.0)) > 20.0 * mismatch


def test_ratio_of_the_two_is_the_filter(response: FrequencyResponse) -> None:
    known = butterworth_low_pass(CUTOFF_HZ, RATE_HZ)
    quotient = ratio(selected(response, outputs=["p_filtered"]), selected(response, outputs=["p"]))
    expected = known.response(quotient.omega_rad_s)
    assert np.max(np.abs(quotient.values[0, 0] / expected - 1.0)) < np.pi * known.delay_s / min(WINDOWS_S)


def test_derivative_of_the_corrected_response_is_that_of_the_vehicle(response: FrequencyResponse) -> None:
    fixed = corrected(response, {"p_filtered": [butterworth_low_pass(CUTOFF_HZ, RATE_HZ)]})
    rate = differentiated(selected(fixed, outputs=["p_filtered"]), "p_filtered")
    expected = 1j * rate.omega_rad_s * truth(rate.omega_rad_s)
    error = np.abs(rate.values[0, 0] / expected - 1.0)
    # The estimate has its own error, which the response says, in two parts; and the mismatch of the windows.
    mismatch = np.pi * butterworth_low_pass(CUTOFF_HZ, RATE_HZ).delay_s / min(WINDOWS_S)
    assert np.all(error < 3.0 * np.sqrt(2.0) * rate.random_error[0, 0] + mismatch)
