"""One-step predictions: exact, bounded for unstable vehicles, with exact sensitivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import simulate_linear
from rotorid.simulation.predictor import free_innovations, innovation_slopes, innovations, sampled_model
from rotorid.simulation.sensitivity import Slopes
from rotorid.typing import FloatArray
from rotorid.vehicles import s500

RATE_HZ = 200.0
SAMPLES = 400


def still(system: StateSpace, directions: int = 0) -> Slopes:
    shapes = (system.M, system.F, system.G, system.H0, system.H1, system.input_delays_s, system.output_delays_s)
    return Slopes(*(np.zeros((directions, *one.shape)) for one in shapes))


def flown(seed: int = 0) -> tuple[StateSpace, FloatArray, FloatArray]:
    """The lateral S500, some commands, and outputs that are no answer to them."""
    rng = np.random.default_rng(seed)
    system = s500.lateral()
    return system, 0.1 * rng.standard_normal((2, SAMPLES)), 0.1 * rng.standard_normal((5, SAMPLES))


def gain(system: StateSpace, seed: int = 1) -> FloatArray:
    """A stable predictor: of each state the share of its sensor."""
    chosen = np.zeros((4, 5))
    chosen[range(4), range(4)] = [0.2, 0.2, 0.2, 0.2]
    return chosen + 1e-3 * np.random.default_rng(seed).standard_normal((4, 5))


def test_without_gain_it_is_the_simulation() -> None:
    system, u, y = flown()
    start = np.array([0.1, -0.2, 0.3, 0.05])
    model = sampled_model(system, still(system), sample_rate_hz=RATE_HZ, hold="first")
    run = innovations(model, np.zeros((4, 5)), u[:, :100], y[:, :100], before=u[:, 0], start=start)
    simulated = simulate_linear(system, u[:, :100], sample_rate_hz=RATE_HZ, x0=start, before=u[:, 0], hold="first")
    np.testing.assert_allclose(run.values, (y[:, :100] - simulated).T, atol=1e-12)


def test_an_unstable_vehicle_is_followed_without_end() -> None:
    system, u, y = flown()
    assert system.poles().real.max() > 1.0
    model = sampled_model(system, still(system), sample_rate_hz=RATE_HZ, hold="first")
    long_u, long_y = np.tile(u, 100), np.tile(y, 100)
    run = innovations(model, gain(system), long_u, long_y, before=u[:, 0], start=np.zeros(4))
    # Of a stable recursion the last repetition is as large as the second one; open loop it would be exp(370).
    second, last = run.values[SAMPLES : 2 * SAMPLES], run.values[-SAMPLES:]
    np.testing.assert_allclose(np.abs(last).max(), np.abs(second).max(), rtol=0.1)


def test_unknowns_move_the_innovations_as_stated() -> None:
    system, u, y = flown()
    system = replace(
        system,
        G=np.hstack([system.G, np.eye(4)[:, [0]]]),
        input_delays_s=np.append(system.input_delays_s, 0.0),
    )
    model, K = sampled_model(system, still(system), sample_rate_hz=RATE_HZ, hold="first"), gain(system)
    free = free_innovations(model, K, SAMPLES, constants=1)
    start, constant, shift = np.array([0.1, 0.2, -0.3, 0.1]), 0.7, np.array([0.1, -0.1, 0.2, 0.0, 0.3])
    rest = innovations(
        model, K, np.vstack([u, np.zeros(SAMPLES)]), y, before=np.append(u[:, 0], 0.0), start=np.zeros(4)
    )
    moved = innovations(
        model,
        K,
        np.vstack([u, np.full(SAMPLES, constant)]),
        y - shift[:, None],
        before=np.append(u[:, 0], constant),
        start=start,
    )
    expected = rest.values + free @ np.concatenate([start, [constant], shift])
    np.testing.assert_allclose(moved.values, expected, atol=1e-12)


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_slopes_are_those_of_differences(hold: str) -> None:
    system, u, y = flown()
    rng = np.random.default_rng(3)
    directions, step = 3, 1e-6
    slopes = still(system, directions)._replace(
        F=rng.standard_normal((directions, 4, 4)),
        G=rng.standard_normal((directions, 4, 2)),
        H0=rng.standard_normal((directions, 5, 4)),
        H1=0.1 * rng.standard_normal((directions, 5, 4)),
        input_delays_s=1e-2 * rng.standard_normal((directions, 2)),
    )
    K, dK = gain(system), 0.1 * rng.standard_normal((directions, 4, 5))
    W, start = rng.standard_normal((5, 5)), rng.standard_normal(4)
    # A delay within a sample: at a whole one the slope of a held input jumps.
    system = replace(system, input_delays_s=np.array([0.0375 + 1e-3, 0.0121]))

    def at(move: FloatArray) -> FloatArray:
        names = ("F", "G", "H0", "H1", "input_delays_s")
        other = replace(
            system, **{n: getattr(system, n) + np.tensordot(move, getattr(slopes, n), axes=1) for n in names}
        )
        model = sampled_model(other, still(other), sample_rate_hz=RATE_HZ, hold=hold)  # type: ignore[arg-type]
        run = innovations(model, K + np.tensordot(move, dK, axes=1), u, y, before=u[:, 0], start=start)
        return run.values @ W.T

    model = sampled_model(system, slopes, sample_rate_hz=RATE_HZ, hold=hold)  # type: ignore[arg-type]
    run = innovations(model, K, u, y, before=u[:, 0], start=start)
    exact = np.concatenate(list(innovation_slopes(model, K, dK, run, u, before=u[:, 0], whitening=W)))
    for k, one in enumerate(np.eye(directions)):
        central = (at(step * one) - at(-step * one)) / (2.0 * step)
        # The error of a central difference is of the order of its step squared, and of rounding over the step.
        np.testing.assert_allclose(exact[:, :, k], central, atol=1e-6 * np.abs(central).max())


def test_late_outputs_are_refused_with_a_remedy() -> None:
    system = replace(s500.lateral(), output_delays_s=np.full(5, 0.01))
    with pytest.raises(UsageError, match="move a delay that all outputs share to the inputs"):
        sampled_model(system, still(system), sample_rate_hz=RATE_HZ, hold="first")
