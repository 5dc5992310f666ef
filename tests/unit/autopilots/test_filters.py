"""Known filters against the recursions that autopilots run sample by sample, and against scipy."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from scipy.signal import butter, freqz

from rotorid.autopilots.filters import (
    KnownFilter,
    butterworth_low_pass,
    cascaded_low_pass,
    combined_response,
    integral_mean,
    moving_average,
    notch,
)
from rotorid.errors import UsageError
from rotorid.typing import FloatArray

RATE_HZ = 1000.0
IMPULSE = np.concatenate([[1.0], np.zeros(3999)])
OMEGA = np.geomspace(1.0, 0.95 * np.pi * RATE_HZ, 40)

Coefficients = tuple[float, float, float, float, float]


def direct_form(coefficients: Coefficients, samples: FloatArray) -> Iterator[float]:
    """The second-order section as flight code runs it, with two remembered values."""
    b0, b1, b2, a1, a2 = coefficients
    first = second = 0.0
    for sample in samples:
        newest = sample - a1 * first - a2 * second
        yield b0 * newest + b1 * first + b2 * second
        first, second = newest, first


def sine_cosine_low_pass(cutoff_hz: float) -> Coefficients:
    """The biquad as audio cookbooks, and Betaflight, write it."""
    angle = 2.0 * math.pi * cutoff_hz / RATE_HZ
    alpha = math.sin(angle) / math.sqrt(2.0)
    gain, a0 = 1.0 - math.cos(angle), 1.0 + alpha
    return 0.5 * gain / a0, gain / a0, 0.5 * gain / a0, -2.0 * math.cos(angle) / a0, (1.0 - alpha) / a0


def stages(order: int, cutoff_hz: float, samples: FloatArray) -> Iterator[float]:
    """PT1, PT2, PT3: each stage moves by a part of what is missing."""
    correction = 1.0 / math.sqrt(2.0 ** (1.0 / order) - 1.0)
    resistance = 1.0 / (2.0 * math.pi * correction * cutoff_hz)
    gain = (1.0 / RATE_HZ) / (resistance + 1.0 / RATE_HZ)
    states = [0.0] * order
    for sample in samples:
        value = float(sample)
        for index in range(order):
            states[index] += gain * (value - states[index])
            value = states[index]
        yield value


def attenuating_notch(center_hz: float, quality: float, floor: float) -> Coefficients:
    angle = 2.0 * math.pi * center_hz / RATE_HZ
    alpha = math.sin(angle) / (2.0 * quality)
    a0, middle = 1.0 + alpha, -2.0 * math.cos(angle)
    return (1.0 + alpha * floor) / a0, middle / a0, (1.0 - alpha * floor) / a0, middle / a0, (1.0 - alpha) / a0


def integrator(count: int, samples: FloatArray) -> Iterator[float]:
    """Trapezoids over the newest samples, as an integrator that is read and reset every ``count`` of them."""
    padded = np.concatenate([np.zeros(count), samples])
    for end in range(count, padded.size):
        part = padded[end - count : end + 1]
        yield float(np.sum(0.5 * (part[1:] + part[:-1])) / count)


CASES: dict[str, tuple[KnownFilter, Callable[[], Iterator[float]]]] = {
    "low-pass": (
        butterworth_low_pass(80.0, RATE_HZ),
        lambda: direct_form(sine_cosine_low_pass(80.0), IMPULSE),
    ),
    "PT1": (cascaded_low_pass(1, 90.0, RATE_HZ), lambda: stages(1, 90.0, IMPULSE)),
    "PT2": (cascaded_low_pass(2, 90.0, RATE_HZ), lambda: stages(2, 90.0, IMPULSE)),
    "PT3": (cascaded_low_pass(3, 90.0, RATE_HZ), lambda: stages(3, 90.0, IMPULSE)),
    "notch": (notch(120.0, 3.0, RATE_HZ), lambda: direct_form(attenuating_notch(120.0, 3.0, 0.0), IMPULSE)),
    "shallow notch": (
        notch(120.0, 3.0, RATE_HZ, floor=0.1),
        lambda: direct_form(attenuating_notch(120.0, 3.0, 0.1), IMPULSE),
    ),
    "integral": (integral_mean(0.004, RATE_HZ), lambda: integrator(4, IMPULSE)),
}


@pytest.mark.parametrize("name", CASES)
def test_response_is_that_of_the_recursion(name: str) -> None:
    known, recursion = CASES[name]
    answer = np.array(list(recursion()))
    transformed = np.exp(-1j * np.outer(OMEGA, np.arange(answer.size)) / RATE_HZ) @ answer
    assert known.response(OMEGA) == pytest.approx(transformed, abs=1e-11)


@pytest.mark.parametrize("name", CASES)
def test_delay_is_the_slope_of_the_phase_at_low_frequency(name: str) -> None:
    known, _ = CASES[name]
    slow = np.array([1e-3, 2e-3])
    # The phase is odd, so that what the two points leave out of the slope is of the third order.
    assert -np.angle(known.response(slow)) / slow == pytest.approx(np.full(2, known.delay_s), rel=1e-7)


@pytest.mark.parametrize("name", CASES)
def test_what_is_constant_passes(name: str) -> None:
    known, _ = CASES[name]
    assert known.response(np.zeros(1)) == pytest.approx(np.ones(1), abs=1e-12)


@pytest.mark.parametrize("cutoff_hz", [5.0, 40.0, 300.0])
def test_low_pass_is_scipys_butterworth(cutoff_hz: float) -> None:
    numerator, denominator = butter(2, cutoff_hz, fs=RATE_HZ)
    _, expected = freqz(numerator, denominator, worN=OMEGA / RATE_HZ)
    assert butterworth_low_pass(cutoff_hz, RATE_HZ).response(OMEGA) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_cascade_has_its_cutoff_where_it_says(order: int) -> None:
    # Backward differences are right to first order in the step: a hundredth of the step, a hundredth of the error.
    errors = [
        abs(cascaded_low_pass(order, 50.0, rate).response(np.array([100.0 * np.pi]))[0]) - math.sqrt(0.5)
        for rate in (1e4, 1e6)
    ]
    assert abs(errors[0]) < 0.02
    assert errors[1] == pytest.approx(errors[0] / 100.0, rel=0.05)


def test_notch_leaves_its_floor_at_the_center() -> None:
    left = notch(100.0, 2.0, RATE_HZ, floor=0.05).response(np.array([2.0 * np.pi * 100.0]))
    assert abs(left[0]) == pytest.approx(0.05, rel=1e-10)


def test_mean_of_no_whole_number_of_samples_is_that_of_the_neighbors() -> None:
    between = moving_average(0.00225, RATE_HZ).response(OMEGA)
    two, three = (moving_average(span_s, RATE_HZ).response(OMEGA) for span_s in (0.002, 0.003))
    assert between == pytest.approx(0.75 * two + 0.25 * three, abs=1e-12)


@pytest.mark.parametrize("samples", [1.0, 2.5, 7.0, 32.0])
def test_integral_lags_by_half_of_its_span(samples: float) -> None:
    span_s = samples / RATE_HZ
    assert integral_mean(span_s, RATE_HZ).delay_s == pytest.approx(0.5 * span_s, rel=1e-12)


def test_filters_in_a_row_multiply_and_their_delays_add() -> None:
    chain = [butterworth_low_pass(40.0, 500.0), notch(120.0, 3.0, RATE_HZ), integral_mean(0.004, 250.0)]
    omega = np.array([1e-3])
    total = combined_response(chain, omega)
    assert -np.angle(total)[0] / omega[0] == pytest.approx(sum(known.delay_s for known in chain), rel=1e-7)


@pytest.mark.parametrize(
    "build",
    [
        lambda: butterworth_low_pass(500.0, RATE_HZ),
        lambda: butterworth_low_pass(0.0, RATE_HZ),
        lambda: cascaded_low_pass(1, 600.0, RATE_HZ),
        lambda: notch(501.0, 2.0, RATE_HZ),
        lambda: notch(100.0, 0.0, RATE_HZ),
        lambda: integral_mean(0.0005, RATE_HZ),
        lambda: moving_average(0.0005, RATE_HZ),
        lambda: KnownFilter(name="none", numerator=(1.0,), denominator=(1.0,), rate_hz=0.0),
    ],
    ids=["low-pass at Nyquist", "no cutoff", "PT1", "notch", "quality", "integral", "mean", "rate"],
)
def test_impossible_filter_is_refused(build: Callable[[], KnownFilter]) -> None:
    with pytest.raises(UsageError, match="expected"):
        build()
