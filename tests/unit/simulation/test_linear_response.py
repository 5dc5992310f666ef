"""Time responses against brute force, against formulas, and against the frequency response of the same model."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from rotorid.errors import UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import simulate_linear

Hold = Literal["zero", "first"]
HOLDS: tuple[Hold, ...] = ("zero", "first")
ALGEBRAIC = 1e-12


def first_order(rate: float, *, delay_s: float = 0.0, late_s: float = 0.0) -> StateSpace:
    one = np.ones((1, 1))
    return StateSpace(
        M=one,
        F=rate * one,
        G=one,
        H0=one,
        H1=0.0 * one,
        input_delays_s=np.array([delay_s]),
        output_delays_s=np.array([late_s]),
    )


def random_system(rng: np.random.Generator, *, states: int, inputs: int, outputs: int) -> StateSpace:
    return StateSpace(
        M=np.eye(states) + 0.2 * rng.standard_normal((states, states)),
        F=2.0 * rng.standard_normal((states, states)),
        G=rng.standard_normal((states, inputs)),
        H0=rng.standard_normal((outputs, states)),
        H1=rng.standard_normal((outputs, states)),
        input_delays_s=rng.uniform(0.0, 0.35, inputs),
        output_delays_s=np.zeros(outputs),
    )


def held(u: np.ndarray, position: float, before: float, hold: Hold) -> tuple[float, float]:
    """Value just after ``position`` (in samples) and slope per sample of a held input."""
    index = math.floor(position + 1e-9)
    here, there = (before if k < 0 else float(u[min(k, u.size - 1)]) for k in (index, index + 1))
    return (here, 0.0) if hold == "zero" else (here + (there - here) * (position - index), there - here)


def brute_force(system: StateSpace, u: np.ndarray, rate: float, x0: np.ndarray, before: np.ndarray, hold: Hold) -> Any:
    """One augmented matrix exponential between every two instants at which anything switches."""
    A, B, C, D = system.proper()
    inputs, samples = u.shape
    order = A.shape[0]
    delays = system.input_delays_s * rate
    switches = {float(k) for k in range(samples)} | {k + d % 1.0 for k in range(samples) for d in delays}
    times = np.unique(np.round([t for t in switches if t <= samples - 1], 12))
    x, y = x0.copy(), np.empty((C.shape[0], samples))
    for start, stop in zip(times, np.append(times[1:], times[-1]), strict=True):
        pairs = [held(u[i], start - delays[i], before[i], hold) for i in range(inputs)]
        value, slope = np.array(pairs).T
        if abs(start - round(start)) < 1e-9:
            y[:, round(start)] = C @ x + D @ value
        # State, a one, and a clock that starts at zero.
        augmented = np.zeros((order + 2, order + 2))
        augmented[:order, :order], augmented[:order, order], augmented[:order, order + 1] = A, B @ value, B @ slope
        augmented[order + 1, order] = rate
        x = (expm(augmented * (stop - start) / rate) @ np.concatenate([x, [1.0, 0.0]]))[:order]
    return y


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_brute_force(hold: Hold, seed: int) -> None:
    rng = np.random.default_rng(seed)
    system = random_system(rng, states=4, inputs=3, outputs=2)
    u, x0, before = rng.standard_normal((3, 30)), rng.standard_normal(4), rng.standard_normal(3)
    y = simulate_linear(system, u, sample_rate_hz=20.0, x0=x0, before=before, hold=hold)
    expected = brute_force(system, u, 20.0, x0, before, hold)
    # Rounding grows with the response itself.
    np.testing.assert_allclose(y, expected, rtol=0.0, atol=ALGEBRAIC * max(1.0, np.abs(expected).max()) * 10.0)


@settings(max_examples=40, deadline=None)
@given(rate=st.floats(-8.0, 3.0).filter(lambda r: abs(r) > 1e-3), delay=st.floats(0.0, 0.5))
def test_step_of_a_delayed_first_order_system(rate: float, delay: float) -> None:
    y = simulate_linear(first_order(rate, delay_s=delay), np.ones((1, 60)), sample_rate_hz=50.0)[0]
    since = np.maximum(np.arange(60) / 50.0 - delay, 0.0)
    np.testing.assert_allclose(y, np.expm1(rate * since) / rate, rtol=1e-11, atol=1e-10)


@settings(max_examples=40, deadline=None)
@given(delay=st.floats(0.001, 0.5), rate=st.floats(-8.0, 3.0).filter(lambda r: abs(r) > 1e-3))
def test_first_order_hold_is_exact_for_a_ramp(delay: float, rate: float) -> None:
    time_s = np.arange(60) / 50.0
    y = simulate_linear(first_order(rate, delay_s=delay), time_s[None], sample_rate_hz=50.0, hold="first")[0]
    since = np.maximum(time_s - delay, 0.0)
    # rtol: the formula cancels to second order for slow systems.
    expected = np.where(np.abs(rate * since) < 1e-2, _ramp_series(rate, since), _ramp(rate, since))
    np.testing.assert_allclose(y, expected, rtol=1e-9, atol=1e-10)


def _ramp(rate: float, t: np.ndarray) -> np.ndarray:
    return (np.expm1(rate * t) - rate * t) / rate**2


def _ramp_series(rate: float, t: np.ndarray) -> np.ndarray:
    return sum(rate ** (n - 2) * t**n / math.factorial(n) for n in range(2, 8))


@settings(max_examples=30, deadline=None)
@given(delay=st.floats(0.0, 0.3), whole=st.integers(0, 10), seed=st.integers(0, 9))
def test_whole_samples_of_delay_only_shift(delay: float, whole: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    system = random_system(rng, states=2, inputs=1, outputs=1)
    system = replace(system, input_delays_s=np.array([delay]))
    later = replace(system, input_delays_s=np.array([delay + whole / 40.0]))
    u = rng.standard_normal((1, 50))
    early = simulate_linear(system, u, sample_rate_hz=40.0)[0]
    late = simulate_linear(later, u, sample_rate_hz=40.0)[0]
    # A fraction within rounding of a whole sample counts as whole, which moves a switch by up to 1e-9 of a sample.
    np.testing.assert_allclose(late[whole:], early[: 50 - whole], rtol=0.0, atol=1e-8 * max(1.0, np.abs(early).max()))


def test_late_output_is_a_late_system() -> None:
    u = np.random.default_rng(1).standard_normal((1, 40))
    late = simulate_linear(first_order(-2.0, delay_s=0.01, late_s=0.0234), u, sample_rate_hz=50.0)
    other = simulate_linear(first_order(-2.0, delay_s=0.0334), u, sample_rate_hz=50.0)
    np.testing.assert_allclose(late, other, atol=ALGEBRAIC)


def test_outputs_with_different_delays_are_each_their_own() -> None:
    rng = np.random.default_rng(2)
    system = random_system(rng, states=3, inputs=2, outputs=3)
    u, x0 = rng.standard_normal((2, 40)), rng.standard_normal(3)
    delays = np.array([0.0, 0.013, 0.0])
    y = simulate_linear(replace(system, output_delays_s=delays), u, sample_rate_hz=50.0, x0=x0)
    prompt = simulate_linear(system, u, sample_rate_hz=50.0, x0=x0)
    shifted = replace(system, input_delays_s=system.input_delays_s + 0.013)
    np.testing.assert_allclose(y[[0, 2]], prompt[[0, 2]], rtol=ALGEBRAIC)
    np.testing.assert_allclose(y[1], simulate_linear(shifted, u, sample_rate_hz=50.0, x0=x0)[1], rtol=ALGEBRAIC)


def test_bias_acts_like_an_input_that_was_always_there() -> None:
    rng = np.random.default_rng(3)
    system = random_system(rng, states=3, inputs=1, outputs=2)
    bias = rng.standard_normal(3)
    y = simulate_linear(system, np.zeros((1, 30)), sample_rate_hz=20.0, bias=bias)
    A, _, C, _ = system.proper()
    force = np.linalg.solve(system.M, bias)
    time_s = np.arange(30) / 20.0
    states = np.stack([np.linalg.solve(A, (expm(A * t) - np.eye(3)) @ force) for t in time_s], axis=1)
    expected = C @ states + (system.H1 @ force)[:, None]
    np.testing.assert_allclose(y, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


def test_algebraic_state_follows_at_once_and_its_start_is_not_used() -> None:
    # A motor without lag: 0 = u - x2, x1' = -x1 + x2. The same as a first-order system with the input itself.
    system = StateSpace(
        M=np.diag([1.0, 0.0]),
        F=np.array([[-1.0, 1.0], [0.0, -1.0]]),
        G=np.array([[0.0], [1.0]]),
        H0=np.eye(2),
        H1=np.zeros((2, 2)),
        input_delays_s=np.array([0.03]),
        output_delays_s=np.zeros(2),
    )
    u = np.random.default_rng(4).standard_normal((1, 30))
    y = simulate_linear(system, u, sample_rate_hz=100.0, x0=np.array([0.7, 99.0]))
    plain = simulate_linear(first_order(-1.0, delay_s=0.03), u, sample_rate_hz=100.0, x0=np.array([0.7]))
    np.testing.assert_allclose(y[0], plain[0], atol=ALGEBRAIC)
    np.testing.assert_allclose(y[1], np.concatenate([np.zeros(3), u[0, :-3]]), atol=ALGEBRAIC)


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.05, 0.2287])
def test_the_rest_of_a_record_with_all_that_was_before_is_the_rest_of_its_response(hold: Hold, delay_s: float) -> None:
    """What is still on its way through a delay arrives as it was sent."""
    system, u = first_order(-3.0, delay_s=delay_s), np.random.default_rng(4).standard_normal((1, 60))
    options = {"sample_rate_hz": 50.0, "hold": hold}
    whole = simulate_linear(system, u, **options)
    rest = simulate_linear(system, u[:, 25:], x0=whole[:, 25], before=u[:, :25], **options)
    assert np.abs(rest - whole[:, 25:]).max() < 1e-12
    # Of fewer the oldest stood before them.
    standing = np.hstack([np.full((1, 20), u[0, 20]), u[:, 20:]])
    few = simulate_linear(system, u[:, 25:], before=u[:, 20:25], **options)
    assert np.array_equal(few, simulate_linear(system, u[:, 25:], before=standing[:, :25], **options))


@pytest.mark.parametrize("hold", HOLDS)
def test_steady_sine_is_the_frequency_response(hold: Hold) -> None:
    rate, omega = 2000.0, 7.0
    system = replace(first_order(-6.0, delay_s=0.0377, late_s=0.0111), H1=np.array([[0.3]]))
    time_s = np.arange(8000) / rate
    y = simulate_linear(system, np.sin(omega * time_s)[None], sample_rate_hz=rate, hold=hold)[0]
    response = system.response(np.array([omega]))[0, 0, 0]
    expected = (response * np.exp(1j * omega * time_s)).imag
    # A sine held for a step is late by up to one step, a sine of chords is off by (omega h)^2 / 8; the gains to the
    # output, of the direct path and of the lag, add up to less than one. The start decays with exp(-6 t).
    bound = omega / rate if hold == "zero" else (omega / rate) ** 2 / 8.0
    settled = time_s > 3.0
    assert np.abs(y - expected)[settled].max() < bound + math.exp(-6.0 * 2.9)


def test_direct_output_shows_the_value_just_after_the_jump() -> None:
    system = replace(first_order(0.0, delay_s=0.02), H0=np.zeros((1, 1)), H1=np.ones((1, 1)))
    u = np.array([[1.0, 2.0, 3.0, 4.0, 5.0]])
    np.testing.assert_allclose(simulate_linear(system, u, sample_rate_hz=100.0)[0], [0.0, 0.0, 1.0, 2.0, 3.0])
    between = replace(system, input_delays_s=np.array([0.015]))
    np.testing.assert_allclose(simulate_linear(between, u, sample_rate_hz=100.0)[0], [0.0, 0.0, 1.0, 2.0, 3.0])
    line = simulate_linear(between, u, sample_rate_hz=100.0, hold="first")[0]
    np.testing.assert_allclose(line, [0.0, 0.5, 1.5, 2.5, 3.5], atol=ALGEBRAIC)


@pytest.mark.parametrize(
    ("system", "u", "more"),
    [
        (first_order(-1.0), np.ones((2, 5)), {}),
        (first_order(-1.0), np.ones(5), {}),
        (first_order(-1.0), np.ones((1, 0)), {}),
        (first_order(-1.0), np.ones((1, 5)), {"x0": np.zeros(2)}),
        (first_order(-1.0), np.ones((1, 5)), {"bias": np.zeros(2)}),
        (first_order(-1.0), np.ones((1, 5)), {"before": np.zeros(3)}),
        (first_order(-1.0, delay_s=-0.1), np.ones((1, 5)), {}),
    ],
)
def test_wrong_shapes_and_negative_delays_are_refused(system: StateSpace, u: np.ndarray, more: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        simulate_linear(system, u, sample_rate_hz=10.0, **more)


def test_long_records_are_fast_enough_to_fit_with() -> None:
    system = random_system(np.random.default_rng(6), states=4, inputs=2, outputs=6)
    system = replace(system, F=system.F - 8.0 * system.M)
    y = simulate_linear(system, np.ones((2, 100_000)), sample_rate_hz=200.0)
    steady = system.response(np.array([0.0])).real.sum(axis=1)[:, 0]
    np.testing.assert_allclose(y[:, -1], steady, rtol=1e-9)
