"""Equations of motion as regressions, in time and in a band."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.equations.regression import (
    CONSTANT,
    Domain,
    InBand,
    InTime,
    derivative_transform,
    equation_error,
    finite_transform,
    late_transform,
)
from rotorid.typing import FloatArray

RATE_HZ, DURATION_S = 200.0, 30.0
M_Q, M_PITCH, BIAS, DELAY_S = -3.0, 40.0, 0.2, 0.0137
BAND = (0.5, 20.0)
FREQUENCIES = np.array([0.7, 1.3, 2.9, 5.1, 8.3, 13.7])
PHASES = np.array([0.1, 1.7, 2.2, 4.0, 5.1, 0.6])


def command(time_s: FloatArray) -> FloatArray:
    return np.asarray(np.sin(np.outer(time_s, FREQUENCIES) + PHASES).sum(axis=1) * 0.1)


def history(noise: float = 0.0, seed: int = 0, phase: float = 0.0) -> TimeHistory:
    """A rate with damping behind a late sum of sines, exactly, with a decaying start and a constant torque."""
    time_s = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    rng = np.random.default_rng(seed)
    gain = 0.1 * M_PITCH / (1j * FREQUENCIES - M_Q) * np.exp(-1j * FREQUENCIES * DELAY_S)
    turns = np.exp(1j * (np.outer(time_s, FREQUENCIES) + PHASES + phase * FREQUENCIES))
    q = (turns @ gain).imag - BIAS / M_Q + 0.5 * np.exp(M_Q * time_s)
    values = np.stack([q + noise * rng.normal(size=time_s.size), command(time_s + phase), rng.normal(size=time_s.size)])
    channels = (Channel(name="q", unit="rad/s"), Channel(name="pitch_command", unit="1"), Channel(name="u", unit="m/s"))
    return TimeHistory(values=values, channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def test_transforms_of_a_record_that_does_not_repeat() -> None:
    # The straight line between samples errs by (omega h)^2 / 12 of the transform, which halving the step shows.
    omega = np.linspace(1.0, 20.0, 30)
    errors = []
    for rate in (100.0, 200.0):
        time_s = np.arange(0.0, 5.0 + 0.5 / rate, 1.0 / rate)
        exact = (1.0 - np.exp(-(0.4 + 1j * omega) * time_s[-1])) / (0.4 + 1j * omega)
        found = finite_transform(np.exp(-0.4 * time_s), sample_rate_hz=rate, omega_rad_s=omega)
        slope = derivative_transform(np.exp(-0.4 * time_s), sample_rate_hz=rate, omega_rad_s=omega)
        errors.append((np.abs(found - exact).max(), np.abs(slope + 0.4 * exact).max()))
    np.testing.assert_allclose(np.array(errors[0]) / np.array(errors[1]), 4.0, rtol=0.05)


def test_uneven_lines_give_what_even_ones_do() -> None:
    values = np.random.default_rng(1).normal(size=(2, 400))
    omega = np.linspace(1.0, 20.0, 7)
    even = finite_transform(values, sample_rate_hz=50.0, omega_rad_s=omega)
    uneven = finite_transform(values, sample_rate_hz=50.0, omega_rad_s=omega[[0, 1, 3, 6]])
    np.testing.assert_allclose(uneven, even[:, [0, 1, 3, 6]], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("delay_s", [0.0, 0.0021, 0.0137, 0.1, -0.0012])
def test_a_late_signal_by_any_fraction_of_a_sample(delay_s: float) -> None:
    time_s = np.arange(0.0, 20.0, 1.0 / RATE_HZ)
    first, count = 100, time_s.size - 200
    omega = np.linspace(0.5, 20.0, 40)
    how = {"first": first, "count": count, "sample_rate_hz": RATE_HZ, "omega_rad_s": omega}
    late = late_transform(command(time_s), delay_s=delay_s, **how)  # type: ignore[arg-type]
    exact = late_transform(command(time_s - delay_s), delay_s=0.0, **how)  # type: ignore[arg-type]
    # Over the moved ends the signal goes straight: (omega h)^2 / 8 of a sample's worth of it.
    assert np.abs(late - exact).max() < (20.0 / RATE_HZ) ** 2 / 8.0 * np.abs(command(time_s)).max() / RATE_HZ * 2.0


@pytest.mark.parametrize(
    ("domain", "accuracy"), [(InBand(band_rad_s=BAND), 2e-3), (InTime(smoothing_s=0.025), 2e-2)], ids=["band", "time"]
)
def test_equation_of_a_late_rate(domain: Domain, accuracy: float) -> None:
    records = [history(), history(phase=3.0)]
    found = equation_error(records, "q", ["q", "pitch_command"], domain=domain, delays_s={"pitch_command": DELAY_S})
    truth = {"q": M_Q, "pitch_command": M_PITCH, CONSTANT: BIAS}
    for name, estimate in zip(found.names, found.estimates, strict=True):
        assert estimate == pytest.approx(truth[name], rel=accuracy)
    assert found.r_squared > 0.999


def test_the_band_does_not_mind_noise_that_a_derivative_does() -> None:
    noisy = [history(noise=0.05, seed=seed, phase=seed) for seed in range(3)]
    how = {"delays_s": {"pitch_command": DELAY_S}}
    band = equation_error(noisy, "q", ["q", "pitch_command"], domain=InBand(band_rad_s=BAND), **how)  # type: ignore[arg-type]
    time = equation_error(noisy, "q", ["q", "pitch_command"], domain=InTime(smoothing_s=0.025), **how)  # type: ignore[arg-type]
    assert abs(band.estimates[1] / M_PITCH - 1.0) < 0.03
    assert band.r_squared > 0.98
    assert time.r_squared < 0.9


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: equation_error([], "q", ["q"], domain=InTime()), InsufficientDataError),
        (lambda: equation_error([history()], "q", ["w"], domain=InTime()), UsageError),
        (lambda: InBand(band_rad_s=(3.0, 1.0)), UsageError),
        (
            lambda: equation_error([history()], "q", ["q"], domain=InBand(band_rad_s=(1.0, 900.0))),
            InsufficientDataError,
        ),
        (lambda: equation_error([history()], "q", ["q"], domain=InBand(band_rad_s=(1.0, 1.1))), InsufficientDataError),
    ],
    ids=["no record", "no channel", "reversed", "above Nyquist", "too narrow"],
)
def test_wrong_use_is_refused(call: object, error: type[Exception]) -> None:
    with pytest.raises(error):
        call()  # type: ignore[operator]
