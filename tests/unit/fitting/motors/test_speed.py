"""Motors between the samples, against differential equations solved by brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rotorid.fitting.motors.speed import MotorSpeed, measured_speed, motor_speed
from rotorid.typing import FloatArray

STEP_S = 0.01
OUTPUTS = np.random.default_rng(1).uniform(0.2, 0.8, (2, 12))

LAGS_S = (0.003, 0.04, 0.5)
DELAYS_S = (0.0, 0.0037, 0.01, 0.0263)


def brute_force(outputs: FloatArray, lag_s: float, delay_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Level at each sample and integrals of it and its square, piece by piece between switching instants."""
    samples = outputs.size
    state, levels, first, second = np.array([outputs[0]]), [outputs[0]], [], []
    for k in range(samples - 1):
        start, stop = k * STEP_S, (k + 1) * STEP_S
        switches = [delay_s + j * STEP_S for j in range(samples)]
        edges = [start, *(at for at in switches if start + 1e-12 < at < stop - 1e-12), stop]
        sums = np.zeros(2)
        for begin, end in itertools.pairwise(edges):
            index = int(np.floor((0.5 * (begin + end) - delay_s) / STEP_S))
            held = outputs[max(index, 0)]

            def motor(_: float, y: FloatArray, held: float = held) -> list[float]:
                return [(held - y[0]) / lag_s, y[0], y[0] ** 2]

            solved = solve_ivp(motor, (begin, end), [state[0], 0.0, 0.0], rtol=1e-11, atol=1e-13, method="DOP853")
            state, sums = solved.y[:1, -1], sums + solved.y[1:, -1]
        levels.append(float(state[0]))
        first.append(float(sums[0]))
        second.append(float(sums[1]))
    return np.array(levels), np.array(first), np.array(second)


def parts(found: MotorSpeed) -> tuple[FloatArray, FloatArray, FloatArray]:
    return found.level, found.first, found.second


@pytest.mark.parametrize("lag_s", LAGS_S)
@pytest.mark.parametrize("delay_s", DELAYS_S)
def test_levels_and_integrals_are_exact(lag_s: float, delay_s: float) -> None:
    found = motor_speed(OUTPUTS, lag_s=lag_s, delay_s=delay_s, step_s=STEP_S)
    for motor, outputs in enumerate(OUTPUTS):
        level, first, second = brute_force(outputs, lag_s, delay_s)
        np.testing.assert_allclose(found.level[motor], level, rtol=1e-9)
        np.testing.assert_allclose(found.first[motor], first, rtol=1e-9)
        np.testing.assert_allclose(found.second[motor], second, rtol=1e-9)


@pytest.mark.parametrize("lag_s", LAGS_S)
@pytest.mark.parametrize("delay_s", [0.0, 0.0099999, 0.01, 0.0100001, 0.0203, -0.004])
def test_derivatives_by_lag_and_delay_are_exact(lag_s: float, delay_s: float) -> None:
    small = 1e-7
    here = motor_speed(OUTPUTS, lag_s=lag_s, delay_s=delay_s, step_s=STEP_S, moved=True)
    above = motor_speed(OUTPUTS, lag_s=lag_s + small, delay_s=delay_s, step_s=STEP_S)
    below = motor_speed(OUTPUTS, lag_s=lag_s - small, delay_s=delay_s, step_s=STEP_S)
    later = motor_speed(OUTPUTS, lag_s=lag_s, delay_s=delay_s + small, step_s=STEP_S)
    for exact, high, low in zip(parts(here.moved["lag"]), parts(above), parts(below), strict=True):
        np.testing.assert_allclose(exact, (high - low) / (2.0 * small), atol=1e-5)
    # Levels have kinks in the delay where a switch meets a sample: from there on the derivative is that to the right.
    curved = small / lag_s**2
    for exact, high, low in zip(parts(here.moved["delay"]), parts(later), parts(here), strict=True):
        np.testing.assert_allclose(exact, (high - low) / small, atol=2.0 * curved)


def test_values_are_the_same_with_and_without_derivatives() -> None:
    plain = motor_speed(OUTPUTS, lag_s=0.04, delay_s=0.0263, step_s=STEP_S)
    moved = motor_speed(OUTPUTS, lag_s=0.04, delay_s=0.0263, step_s=STEP_S, moved=True)
    assert (dict(plain.moved), set(moved.moved)) == ({}, {"lag", "delay"})
    for one, other in zip(parts(plain), parts(moved), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("delay_s", [0.0, 0.0041, 0.01, 0.0263, -0.004])
def test_derivatives_of_measured_speeds_are_exact(delay_s: float) -> None:
    small = 1e-7
    here = measured_speed(OUTPUTS, delay_s=delay_s, step_s=STEP_S, moved=True)
    later = measured_speed(OUTPUTS, delay_s=delay_s + small, step_s=STEP_S)
    for exact, high, low in zip(parts(here.moved["delay"]), parts(later), parts(here), strict=True):
        np.testing.assert_allclose(exact, (high - low) / small, atol=2e-4)


def test_a_delay_across_a_sample_changes_nothing_abruptly() -> None:
    before = motor_speed(OUTPUTS, lag_s=0.04, delay_s=STEP_S - 1e-9, step_s=STEP_S)
    after = motor_speed(OUTPUTS, lag_s=0.04, delay_s=STEP_S + 1e-9, step_s=STEP_S)
    for one, other in zip(parts(before), parts(after), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)


def test_whole_delays_shift_the_samples() -> None:
    late = motor_speed(OUTPUTS, lag_s=0.04, delay_s=3.0 * STEP_S, step_s=STEP_S)
    here = motor_speed(OUTPUTS, lag_s=0.04, delay_s=0.0, step_s=STEP_S)
    np.testing.assert_allclose(late.level[:, 3:], here.level[:, :-3], atol=1e-14)
    np.testing.assert_allclose(late.level[:, :4], np.repeat(OUTPUTS[:, :1], 4, axis=1), atol=1e-14)


def test_without_lag_the_motors_turn_as_told() -> None:
    found = motor_speed(OUTPUTS, lag_s=1e-9, delay_s=0.0, step_s=STEP_S)
    np.testing.assert_allclose(found.first, STEP_S * OUTPUTS[:, :-1], rtol=1e-6)
    np.testing.assert_allclose(found.second, STEP_S * OUTPUTS[:, :-1] ** 2, rtol=1e-6)
