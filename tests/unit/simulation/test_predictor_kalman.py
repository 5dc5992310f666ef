"""Starts of a simulation: filter and least squares agree where they must, and state the errors that they have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.stats import chi2

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import discretize, simulate_linear
from rotorid.simulation.predictor import StateEstimate, kalman_start, least_squares_start
from rotorid.typing import FloatArray
from rotorid.vehicles import bebop

RATE_HZ = 20.0
NOISE = np.array([0.004, 0.004, 0.02])
VEHICLE = bebop.second_order()
LATE = replace(VEHICLE, input_delays_s=np.array([0.013, 0.05, 0.12]))
STATES = len(VEHICLE.F)


def commands(samples: int, rng: np.random.Generator) -> FloatArray:
    levels = np.array([0.1, 0.1, 0.5])[:, None]
    return levels * np.where(np.cumsum(rng.uniform(size=(3, samples)) < 0.15, axis=1) % 2, 1.0, -1.0)


def unknown(size: float = 1e4) -> StateEstimate:
    return StateEstimate(state=np.zeros(STATES), covariance=size * np.eye(STATES))


@pytest.mark.parametrize("system", [VEHICLE, LATE], ids=["no delay", "fractional delays"])
def test_the_true_state_comes_back(system: StateSpace) -> None:
    rng = np.random.default_rng(0)
    x0, u = rng.standard_normal(STATES), commands(60, rng)
    before = np.array([0.1, -0.1, 0.5])
    y = simulate_linear(system, u, sample_rate_hz=RATE_HZ, x0=x0, before=before)
    found = least_squares_start(system, u, y, sample_rate_hz=RATE_HZ, output_std=NOISE, before=before)
    np.testing.assert_allclose(found.state, x0, atol=1e-9)
    later = kalman_start(
        system, u[:, :40], y[:, :40], sample_rate_hz=RATE_HZ, output_std=NOISE, before=before,
        disturbance=np.zeros((STATES, STATES)), prior=unknown(1e6),
    )  # fmt: skip
    step = discretize(system.F, system.G, delays_s=system.input_delays_s, step_s=1.0 / RATE_HZ, hold="zero")
    for forcing in step.forcing(u, before)[:40]:
        x0 = step.transition @ x0 + forcing
    # What is left of the prior after 40 samples is of the size of the noise over that of the prior.
    np.testing.assert_allclose(later.state, x0, atol=1e-6)


def test_without_disturbance_the_filter_is_least_squares_carried_on() -> None:
    """Recursive and batch least squares are one estimate: state and covariance at the end of the stretch."""
    rng = np.random.default_rng(1)
    u = commands(30, rng)
    y = simulate_linear(LATE, u, sample_rate_hz=RATE_HZ, x0=rng.standard_normal(STATES))
    y = y + NOISE[:, None] * rng.standard_normal(y.shape)
    batch = least_squares_start(LATE, u, y, sample_rate_hz=RATE_HZ, output_std=NOISE)
    prior = unknown(1e4)
    recursive = kalman_start(
        LATE, u, y, sample_rate_hz=RATE_HZ, output_std=NOISE, disturbance=np.zeros((STATES, STATES)), prior=prior
    )
    # A prior joins the batch as so many more equations; then both are exact.
    information = np.linalg.inv(batch.covariance) + np.linalg.inv(prior.covariance)
    joined = np.linalg.solve(information, np.linalg.solve(batch.covariance, batch.state))
    step = discretize(VEHICLE.F, VEHICLE.G, delays_s=LATE.input_delays_s, step_s=1.0 / RATE_HZ, hold="zero")
    state = joined
    for forcing in step.forcing(u, np.zeros(3)):
        state = step.transition @ state + forcing
    carried = np.linalg.matrix_power(step.transition, u.shape[1])
    np.testing.assert_allclose(recursive.state, state, atol=1e-8)
    np.testing.assert_allclose(
        recursive.covariance, carried @ np.linalg.inv(information) @ carried.T, rtol=1e-5, atol=1e-14
    )


def test_the_covariance_settles_at_the_riccati_equation() -> None:
    W = 0.01 * np.eye(STATES)
    found = kalman_start(
        VEHICLE, np.zeros((3, 200)), np.zeros((3, 200)), sample_rate_hz=RATE_HZ, output_std=NOISE, disturbance=W,
        prior=unknown(),
    )  # fmt: skip
    Phi = expm(VEHICLE.F / RATE_HZ)
    fine = np.linspace(0.0, 1.0 / RATE_HZ, 401)
    Q = np.trapezoid([expm(VEHICLE.F * s) @ W @ expm(VEHICLE.F * s).T for s in fine], fine, axis=0)
    settled = solve_discrete_are(Phi.T, VEHICLE.H0.T, Q, np.diag(NOISE**2))
    # The trapezoidal rule is right to (h |A|)^2 / 6, 1e-6 here.
    np.testing.assert_allclose(found.covariance, settled, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("method", ["filter", "least squares"])
def test_errors_are_as_large_as_stated(method: str) -> None:
    W = np.diag([0.02, 0.02, 0.02, 0.02, 0.1, 0.1])
    step = discretize(VEHICLE.F, VEHICLE.G, delays_s=np.zeros(3), step_s=1.0 / RATE_HZ, hold="zero")
    sums = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u, x = commands(25, rng), rng.standard_normal(STATES)
        first, moved = x, np.linalg.cholesky(_accumulated(W))
        y = np.empty((3, 25))
        for k, forcing in enumerate(step.forcing(u, np.zeros(3))):
            y[:, k] = VEHICLE.H0 @ x + NOISE * rng.standard_normal(3)
            x = step.transition @ x + forcing
            if method == "filter":
                x = x + moved @ rng.standard_normal(STATES)
        if method == "filter":
            found = kalman_start(
                VEHICLE, u, y, sample_rate_hz=RATE_HZ, output_std=NOISE, disturbance=W, prior=unknown(1.0)
            )
            error = found.state - x
        else:
            found = least_squares_start(VEHICLE, u, y, sample_rate_hz=RATE_HZ, output_std=NOISE)
            error = found.state - first
        sums.append(error @ np.linalg.solve(found.covariance, error))
    least, most = chi2.interval(0.999, 60 * STATES)
    assert least < sum(sums) < most


def _accumulated(W: FloatArray) -> FloatArray:
    fine = np.linspace(0.0, 1.0 / RATE_HZ, 401)
    return np.asarray(np.trapezoid([expm(VEHICLE.F * s) @ W @ expm(VEHICLE.F * s).T for s in fine], fine, axis=0))


def test_euler_moves_the_poles_that_the_exact_step_keeps() -> None:
    """Why the step is exact: at 20 Hz the other one takes a seventh of the damping of pitch away."""
    A = VEHICLE.F[2:4, 2:4]
    exact = np.log(np.linalg.eigvals(expm(A / RATE_HZ))) * RATE_HZ
    euler = np.log(np.linalg.eigvals(np.eye(2) + A / RATE_HZ)) * RATE_HZ
    np.testing.assert_allclose(np.sort(exact.real), np.sort(np.linalg.eigvals(A).real), rtol=1e-12)
    damping = [float(-poles[0].real / abs(poles[0])) for poles in (exact, euler)]
    assert abs(damping[1] / damping[0] - 1.0) > 0.1


def test_states_that_no_output_shows_are_counted() -> None:
    blind = replace(VEHICLE, H0=np.vstack([VEHICLE.H0[:2], np.zeros(STATES)]))
    with pytest.raises(InsufficientDataError, match="only 4 of 6 states"):
        least_squares_start(blind, np.zeros((3, 40)), np.zeros((3, 40)), sample_rate_hz=RATE_HZ, output_std=NOISE)


def test_wrong_use_is_said() -> None:
    u, y = np.zeros((3, 10)), np.zeros((3, 10))
    with pytest.raises(UsageError, match="outputs have shapes"):
        least_squares_start(VEHICLE, u, y[:2], sample_rate_hz=RATE_HZ, output_std=NOISE)
    with pytest.raises(UsageError, match="not positive"):
        least_squares_start(VEHICLE, u, y, sample_rate_hz=RATE_HZ, output_std=0.0 * NOISE)
    late = replace(VEHICLE, output_delays_s=np.array([0.0, 0.0, 0.01]))
    with pytest.raises(UsageError, match="different delays"):
        least_squares_start(late, u, y, sample_rate_hz=RATE_HZ, output_std=NOISE)
    with pytest.raises(UsageError, match="disturbance has shape"):
        kalman_start(VEHICLE, u, y, sample_rate_hz=RATE_HZ, output_std=NOISE, disturbance=np.zeros(6), prior=unknown())
