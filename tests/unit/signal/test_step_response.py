"""Steps: rise time, delay and bandwidth of systems whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.library import response_model
from rotorid.signal.step_response import StepResponse, rise_time_bandwidth, step_responses
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray

PAIR = ("phi_setpoint", "phi")
LN9 = math.log(9.0)


def flown(asked: FloatArray, rate_hz: float, *, noise: float = 0.0, seed: int = 0, **values: float) -> TimeHistory:
    order = "second_order" if "omega_phi" in values else "first_order_delay"
    system = response_model(f"response.{order}", [PAIR]).matrices(values)
    answer = simulate_linear(system, asked[None], sample_rate_hz=rate_hz)[0]
    answer = answer + noise * np.random.default_rng(seed).standard_normal(answer.size)
    return TimeHistory(
        values=np.stack([asked, answer]),
        channels=tuple(Channel(name=name, unit="rad") for name in PAIR),
        sample_rate_hz=rate_hz,
        start_s=10.0,
    )


def steps_of(history: TimeHistory) -> tuple[StepResponse, ...]:
    return step_responses(history, command=PAIR[0], response=PAIR[1])


def square(rate_hz: float, *, size: float = 0.1) -> FloatArray:
    """Up after 4 s, down after 8 s, 12 s long: twenty time constants of 0.2 s each."""
    time_s = np.arange(0.0, 12.0, 1.0 / rate_hz)
    return np.where((time_s >= 4.0) & (time_s < 8.0), size, 0.0)


@pytest.mark.parametrize("size", [0.1, -0.1])
def test_a_lag_behind_a_delay(size: float) -> None:
    history = flown(square(200.0, size=size), 200.0, K_phi=0.9, T_phi=0.2, tau_phi=0.05)
    up, down = steps_of(history)
    # Straight lines between samples h = 5 ms apart miss the exponential by h^2 / (8 T) in time, 0.016 ms.
    assert up.rise_s == pytest.approx(0.2 * LN9, abs=1e-4)
    assert up.delay_s == pytest.approx(0.05 + 0.2 * math.log(1.0 / 0.9), abs=1e-4)
    assert up.half_s == pytest.approx(0.05 + 0.2 * math.log(2.0), abs=1e-4)
    assert (up.start_s, down.start_s) == pytest.approx((14.0, 18.0))
    assert up.gain == pytest.approx(0.9, rel=1e-3)
    assert down.step == -up.step
    assert down.rise_s == pytest.approx(up.rise_s, rel=1e-3)
    assert up.settled


def test_delay_does_not_change_the_rise_time() -> None:
    first, second = (steps_of(flown(square(20.0), 20.0, K_phi=1.0, T_phi=0.2, tau_phi=tau)) for tau in (0.05, 0.15))
    assert second[0].rise_s == pytest.approx(first[0].rise_s, rel=1e-5)
    assert second[0].delay_s - first[0].delay_s == pytest.approx(0.1, rel=1e-5)


def test_slow_samples_are_interpolated() -> None:
    # A chord over a sample h of a curve misses it by h^2 / 8 times the curvature, in time by that over the slope:
    # h^2 / (8 T) at each end, whatever the level is.
    (step, _) = steps_of(flown(square(20.0), 20.0, K_phi=1.0, T_phi=0.2, tau_phi=0.0))
    assert step.rise_s == pytest.approx(0.2 * LN9, abs=2.0 * 0.05**2 / (8.0 * 0.2) * 1.5)


@pytest.mark.parametrize("zeta", [0.4, 0.7, 1.0, 3.0])
def test_bandwidth_of_second_order_is_within_a_tenth(zeta: float) -> None:
    asked = np.repeat([0.0, 1.0], [200, 4000])
    (step,) = steps_of(flown(asked, 200.0, K_phi=1.0, omega_phi=5.0, zeta_phi=zeta))
    square_of = 1.0 - 2.0 * zeta**2
    half_power_hz = 5.0 * math.sqrt(square_of + math.sqrt(square_of**2 + 1.0)) / (2.0 * math.pi)
    assert rise_time_bandwidth([step]).bandwidth_hz == pytest.approx(half_power_hz, rel=0.1)


def test_overshoot() -> None:
    asked = np.repeat([0.0, 1.0], [200, 2000])
    (step,) = steps_of(flown(asked, 200.0, K_phi=1.0, omega_phi=5.0, zeta_phi=0.4))
    assert step.overshoot == pytest.approx(math.exp(-math.pi * 0.4 / math.sqrt(1.0 - 0.16)), abs=1e-3)


def test_spread_of_rise_times_is_the_stated_one() -> None:
    noise = 0.002
    found = [
        steps_of(flown(square(50.0), 50.0, noise=noise, seed=seed, K_phi=1.0, T_phi=0.2, tau_phi=0.05))[0]
        for seed in range(200)
    ]
    spread = float(np.std([step.rise_s for step in found], ddof=1))
    stated = float(np.median([step.rise_noise_s for step in found]))
    # A level is first passed where noise helps it, and slopes are read from noisy samples: the size, not the number.
    assert 0.5 < spread / stated < 2.0


def test_an_answer_that_creeps_is_not_settled() -> None:
    (step,) = steps_of(flown(np.repeat([0.0, 1.0], [40, 20]), 20.0, K_phi=1.0, T_phi=1.0, tau_phi=0.0))
    assert step.creep > 0.1
    assert not step.settled


def test_bandwidth_and_its_spread_by_hand() -> None:
    rise = np.array([0.301, 0.300, 0.200, 0.300, 0.200])
    found = rise_time_bandwidth(
        [
            StepResponse(
                start_s=0.0, step=1.0, change=1.0, delay_s=0.0, half_s=0.1, rise_s=one, rise_noise_s=0.01, creep=0.0,
                overshoot=0.0,
            )
            for one in rise
        ]
    )  # fmt: skip
    # Tables III and IV of the paper: 0.260 ± 0.055 s and 1.35 ± 0.28 Hz.
    assert (found.rise_s, found.rise_std_s) == pytest.approx((0.260, 0.055), abs=5e-4)
    assert (found.bandwidth_hz, found.bandwidth_std_hz) == pytest.approx((1.35, 0.28), abs=6e-3)
    assert found.steps == 5


def test_one_step_has_the_spread_of_its_noise() -> None:
    (step, _) = steps_of(flown(square(50.0), 50.0, noise=0.001, K_phi=1.0, T_phi=0.2, tau_phi=0.0))
    assert rise_time_bandwidth([step]).rise_std_s == step.rise_noise_s > 0.0


def test_a_constant_command_has_no_step() -> None:
    assert steps_of(flown(np.zeros(100), 20.0, K_phi=1.0, T_phi=0.2, tau_phi=0.0)) == ()
    with pytest.raises(InsufficientDataError, match="no step"):
        rise_time_bandwidth([])


def test_what_cannot_be_read_is_said() -> None:
    with pytest.raises(InsufficientDataError, match="followed by 3 samples"):
        steps_of(flown(np.repeat([0.0, 1.0], [40, 3]), 20.0, K_phi=1.0, T_phi=0.2, tau_phi=0.0))
    with pytest.raises(InsufficientDataError, match="does not leave"):
        steps_of(flown(square(20.0), 20.0, noise=0.1, K_phi=0.0, T_phi=0.2, tau_phi=0.0))
    history = flown(square(20.0), 20.0, K_phi=1.0, T_phi=0.2, tau_phi=0.0)
    with pytest.raises(UsageError, match="no channel 'theta'"):
        step_responses(history, command="theta", response="phi")
