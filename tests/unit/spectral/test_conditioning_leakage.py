"""What windows add to responses, predicted and taken out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.conditioning import (
    Derivatives,
    condition,
    conditioned_response,
    derivatives,
    line_variance,
    output_spectra,
    without_leakage,
)
from rotorid.spectral.estimate import Leakage, frequency_response
from rotorid.spectral.spectra import slope_name, spectral_matrices
from rotorid.spectral.windows import HALF_SINE, HANN, Taper
from rotorid.typing import ComplexArray, FloatArray

RATE_HZ = 100.0
GAIN, DAMPING = 20.0, 1.0
"""A rate plant that remembers for a second."""

OMEGA = np.geomspace(2.0, 30.0, 40)
POLE = np.exp(-DAMPING / RATE_HZ)
STEP = GAIN / DAMPING * (1.0 - POLE)


def plant(omega_rad_s: FloatArray) -> ComplexArray:
    """The zero-order-hold equivalent, exact at the samples."""
    return STEP / (np.exp(1j * omega_rad_s / RATE_HZ) - POLE)


def history(u: FloatArray, *, noise: float = 0.0, seed: int = 0) -> TimeHistory:
    y = signal.lfilter([0.0, STEP], [1.0, -POLE], u) + noise * np.random.default_rng(seed).standard_normal(u.size)
    channels = (Channel(name="roll_command", unit="1"), Channel(name="p", unit="rad/s"))
    return TimeHistory(values=np.stack([u, y]), channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def sweep(duration_s: float = 60.0) -> FloatArray:
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    return np.asarray(signal.chirp(time_s, 0.2, duration_s, 5.0, method="logarithmic"))


def response(record: TimeHistory, *, leakage: Leakage, taper: Taper = HANN) -> FrequencyResponse:
    return frequency_response(
        [record],
        inputs=["roll_command"],
        outputs=["p"],
        omega_rad_s=OMEGA,
        windows_s=[10.0, 5.0],
        taper=taper,
        leakage=leakage,
    )


@pytest.mark.parametrize("taper", [HALF_SINE, HANN], ids=lambda taper: taper.name)
def test_slope_of_a_taper_is_its_derivative(taper: Taper) -> None:
    count = 20_000
    expected = np.gradient(taper.samples(count), 1.0 / count)
    assert np.abs(taper.slope.samples(count) - expected)[1:-1].max() < 1e-6
    assert taper.slope.mean_square == pytest.approx(np.mean(taper.slope.samples(count) ** 2), rel=1e-9)
    assert line_variance(taper, 2.0) == pytest.approx(
        np.mean(expected**2) / np.mean(taper.samples(count) ** 2) / 4, 1e-3
    )


def test_derivatives_of_a_known_response() -> None:
    response = np.exp(-0.03j * OMEGA) * plant(OMEGA)
    fine = np.linspace(1.5, 32.0, 200_001)
    exact = np.exp(-0.03j * fine) * plant(fine)
    first = np.gradient(exact, fine)
    second = np.gradient(first, fine)
    found = derivatives(OMEGA, response[None], np.full((1, OMEGA.size), 1e-4), line_rad_s=0.1)
    for derivative, truth in ((found.first, first), (found.second, second)):
        expected = np.interp(OMEGA, fine, truth.real) + 1j * np.interp(OMEGA, fine, truth.imag)
        # What a parabola over six intervals of 7 % misses of the delay's exponential.
        assert np.abs(derivative[0] / expected - 1.0)[3:-3].max() < 0.02


def test_derivatives_of_noise_are_shrunk() -> None:
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((1, OMEGA.size)) + 1j * rng.standard_normal((1, OMEGA.size))
    believed, doubted = (
        derivatives(OMEGA, noise, np.full((1, OMEGA.size), error), line_rad_s=0.1).first for error in (1e-3, 10.0)
    )
    assert np.median(np.abs(doubted / believed)) < 0.2


def test_two_points_have_no_derivative_and_do_no_harm() -> None:
    found = derivatives(OMEGA[:2], plant(OMEGA[:2])[None], np.full((1, 2), 0.01), line_rad_s=0.1)
    assert np.all(found.first == 0.0)


def test_densities_without_leakage_are_those_of_the_corrected_transforms() -> None:
    (matrix,), _ = spectral_matrices([history(sweep())], OMEGA, windows_s=[8.0], slopes_of=["roll_command"])
    exact = Derivatives(first=np.full((1, OMEGA.size), 0.3 + 0.2j), second=np.full((1, OMEGA.size), 0.1 - 0.4j))
    assert matrix.channels[2] == slope_name("roll_command")
    u, y, slope = matrix.transforms.transpose(1, 0, 2)
    variance = line_variance(HANN, matrix.window_s)
    corrected = y - 1j * exact.first[0] * slope - 0.5 * variance * exact.second[0] * u
    found = without_leakage(matrix, output=1, inputs=[0], derivatives=exact, taper=HANN)
    assert np.allclose(found.auto, np.mean(np.abs(corrected) ** 2, axis=0), rtol=1e-10)
    assert np.allclose(found.cross[:, 0], np.mean(u.conj() * corrected, axis=0), rtol=1e-10)


@pytest.mark.parametrize("taper", [HALF_SINE, HANN], ids=lambda taper: taper.name)
def test_exact_derivatives_explain_most_of_what_looks_like_noise(taper: Taper) -> None:
    record = history(np.random.default_rng(1).standard_normal(20_000))
    (matrix,), _ = spectral_matrices([record], OMEGA, windows_s=[8.0], taper=taper, slopes_of=["roll_command"])
    fine = np.stack([plant(OMEGA * (1.0 + step)) for step in (-1e-4, 0.0, 1e-4)])
    spacing = 1e-4 * OMEGA
    exact = Derivatives(
        first=(fine[2:] - fine[:1]) / (2.0 * spacing), second=(fine[2:] - 2.0 * fine[1:2] + fine[:1]) / spacing**2
    )
    separated = conditioned_response(matrix, instruments=[0], inputs=[0])
    plain = condition(separated, output_spectra(matrix, 1)).noise
    corrected = without_leakage(matrix, output=1, inputs=[0], derivatives=exact, taper=taper)
    # There is no noise at all: everything that remains is of higher order in memory over window, one in eight here.
    assert np.median(condition(separated, corrected).noise / plain) < 0.25


def test_a_record_that_ends_while_it_is_excited_is_not_biased() -> None:
    record = history(sweep(), noise=1e-3)
    # What the last windows hold: from 5 s before the end of the sweep on.
    late = OMEGA > 26.0
    errors = {
        leakage: np.abs(response(record, leakage=leakage).values[0, 0] / plant(OMEGA) - 1.0)[late]
        for leakage in ("ignored", "corrected")
    }
    assert np.median(errors["ignored"]) > 0.01
    assert np.median(errors["corrected"]) < 0.25 * np.median(errors["ignored"])


def test_stated_errors_shrink_to_the_noise_that_is_there() -> None:
    rng = np.random.default_rng(2)
    stated, found = {}, {}
    for leakage in ("ignored", "corrected"):
        results = [
            response(history(rng.standard_normal(12_000), noise=0.1, seed=seed), leakage=leakage) for seed in range(12)
        ]
        stated[leakage] = np.mean([result.random_error[0, 0] for result in results])
        found[leakage] = np.sqrt(
            np.mean([np.abs(result.values[0, 0] / plant(OMEGA) - 1.0) ** 2 / 2.0 for result in results])
        )
    assert stated["corrected"] < 0.8 * stated["ignored"]
    assert found["corrected"] == pytest.approx(stated["corrected"], rel=0.25)
    assert found["corrected"] < found["ignored"]


def test_noise_does_not_explain_itself() -> None:
    # Windows of 20 s give a noisy response structure far finer than the line of windows of 2 s. Taken for real, its
    # curvature would be a thousand times the truth to the short ones.
    u = sweep(60.0)
    y = np.random.default_rng(3).standard_normal(u.size)
    channels = (Channel(name="roll_command", unit="1"), Channel(name="p", unit="rad/s"))
    record = TimeHistory(values=np.stack([u, y]), channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)
    response = frequency_response(
        [record],
        inputs=["roll_command"],
        outputs=["p"],
        omega_rad_s=np.geomspace(12.0, 28.0, 100),
        windows_s=[20.0, 11.0, 6.5, 3.7, 2.0],
    )
    assert np.median(response.coherence) < 0.2
    assert np.mean(response.random_error < 0.3) < 0.1
