"""Delays of known twins: fractions of a sample, noise, feedback, and intervals that cover."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.fitting.late_lags import INPUT, OUTPUT, RATE_HZ, late_lag

from rotorid.fitting.delay.estimate import DelayEstimate, contradicted, estimate_delay
from rotorid.fitting.delay.fit import Order

SEEDS = 200


@pytest.mark.parametrize("delay_samples", [0.3, 2.7])
def test_delay_is_found_inside_its_interval(delay_samples: float) -> None:
    found = estimate_delay([late_lag(11, delay_samples)], input=INPUT, output=OUTPUT).recommended
    assert found.std_s is not None
    assert abs(found.delay_s * RATE_HZ - delay_samples) < 4.0 * found.std_s * RATE_HZ
    assert found.std_s * RATE_HZ < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("delay_samples", [0.3, 2.7])
def test_intervals_cover(delay_samples: float) -> None:
    """As a person runs it: the order is chosen, not known."""
    inside, scores = 0, []
    for seed in range(SEEDS):
        record = late_lag(seed, delay_samples)
        found = estimate_delay([record], input=INPUT, output=OUTPUT).recommended
        assert found.interval_s is not None
        assert found.std_s is not None
        low, high = (end * RATE_HZ for end in found.interval_s)
        inside += low <= delay_samples <= high
        scores.append((found.delay_s * RATE_HZ - delay_samples) / (found.std_s * RATE_HZ))
    assert 0.91 <= inside / SEEDS <= 0.985
    # The mean of the normalized errors of 200 flights has a standard deviation of 0.07.
    assert abs(float(np.mean(scores))) < 0.3


SECOND = Order(0, 2)


def estimate(interval_s: tuple[float, float], order: Order = SECOND) -> DelayEstimate:
    return DelayEstimate(method="response", delay_s=float(np.mean(interval_s)), interval_s=interval_s, order=order)


@pytest.mark.parametrize(
    ("interval_s", "feedback", "joint", "reason"),
    [
        ((-0.035, -0.023), True, True, "cannot respond before"),
        ((-0.004, -0.001), True, False, "feedback from q, in the opposite direction"),
        ((-0.035, -0.023), False, False, "different clocks"),
        ((-0.004, -0.001), True, True, ""),
        ((-0.004, -0.001), False, False, ""),
        ((-0.010, 0.001), True, False, ""),
        ((0.003, 0.005), True, True, ""),
    ],
)
def test_an_output_that_surely_runs_ahead_shows_no_delay(
    interval_s: tuple[float, float], feedback: bool, joint: bool, reason: str
) -> None:
    why = contradicted(estimate(interval_s), ("pitch_command", "q"), feedback=feedback, joint=joint, sample_s=0.0005)
    assert reason in why
    assert bool(why) == bool(reason)


@pytest.mark.parametrize(("high_s", "refused"), [(-0.064, True), (-0.045, False)])
def test_stamps_of_two_clocks_are_a_sample_apart_at_most(high_s: float, *, refused: bool) -> None:
    """Attitudes at 20 Hz: -87 ms with an interval up to -64 ms stood as an answer."""
    channels = "theta_setpoint", "theta"
    why = contradicted(estimate((-0.111, high_s)), channels, feedback=False, joint=False, sample_s=0.05)
    assert bool(why) is refused


def test_zeros_in_the_place_of_a_delay_are_named() -> None:
    why = contradicted(
        estimate((-0.035, -0.023), Order(2, 3)), ("pitch_command", "q"), feedback=True, joint=True, sample_s=0.0005
    )
    assert "zeros of the lag (third order with 2 zeros) replace a delay" in why
