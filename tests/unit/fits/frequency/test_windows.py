"""Windows on an angle that never forgets: what they add is none of the vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.fits.frequency.windows import _left_over, _Transform, _Washout
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import simulate_linear

RATE_HZ = 100.0


def system(F: list[list[float]], *, delay_s: float = 0.03) -> StateSpace:
    """Two states, of which the first is measured and the second is pushed."""
    return StateSpace(
        M=np.eye(2),
        F=np.array(F),
        G=np.array([[0.0], [1.0]]),
        H0=np.array([[1.0, 0.0]]),
        H1=np.zeros((1, 2)),
        input_delays_s=np.array([delay_s]),
        output_delays_s=np.zeros(1),
    )


INTEGRATORS = system([[0.0, 1.0], [0.0, 0.0]])
UNSTABLE = system([[0.0, 1.0], [9.0, 0.0]])


def record(u: np.ndarray, y: np.ndarray) -> TimeHistory:
    return TimeHistory(
        values=np.stack([u, y]),
        channels=(Channel(name="roll_command", unit="1"), Channel(name="phi", unit="rad")),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )


def left(model: StateSpace, u: np.ndarray, y: np.ndarray, corner_rad_s: float = 0.5) -> np.ndarray:
    washout = _Washout.of(model, corner_rad_s=corner_rad_s)
    return _left_over(record(u, y), model, washout, ["roll_command"], ["phi"])["phi"]


def smooth_input(seed: int, samples: int = 6000) -> np.ndarray:
    """Some sines far below half of the sample rate, which fade in and out."""
    rng, time_s = np.random.default_rng(seed), np.arange(samples) / RATE_HZ
    waves = sum(np.sin(omega * time_s + rng.uniform(0.0, 6.0)) for omega in rng.uniform(0.5, 6.0, 8))
    return np.asarray(waves * np.sin(np.pi * time_s / time_s[-1]) ** 2)


@pytest.mark.parametrize("trim", [0.0, 0.4])
def test_the_right_model_leaves_nothing_of_an_angle_on_two_integrators(trim: float) -> None:
    """Nor of its initial state, a steady torque and a shifted sensor."""
    u = smooth_input(0)
    y = simulate_linear(INTEGRATORS, u[None], sample_rate_hz=RATE_HZ, hold="first", x0=np.array([0.3, -0.1]))[0]
    whole = np.std(y)
    assert np.std(left(INTEGRATORS, u + trim, y + 0.2)[100:-100]) < 2e-3 * min(whole, 0.3)


def test_a_delay_is_neither_held_nor_moved() -> None:
    """A delay that is off by half a sample is seen: inputs are joined without a hold."""
    u = smooth_input(1)
    y = simulate_linear(INTEGRATORS, u[None], sample_rate_hz=RATE_HZ, hold="first")[0]
    right = np.std(left(INTEGRATORS, u, y))
    late = np.std(left(system([[0.0, 1.0], [0.0, 0.0]], delay_s=0.035), u, y))
    assert late > 5.0 * right


def test_a_growing_motion_comes_to_rest_at_the_end() -> None:
    """A vehicle that a controller held is followed through e-folds of e^180 without one."""
    u = smooth_input(2)
    transform = _Transform.of(UNSTABLE, u.size, RATE_HZ)
    y = transform.back(UNSTABLE.response(-1j * transform.s)[0, 0] * transform.forward(u))
    assert np.abs(y).max() < 10.0 * np.abs(u).max() / 9.0
    # The equation holds: the second derivative less nine times the angle is the late input.
    late = np.interp(np.arange(u.size) / RATE_HZ - 0.03, np.arange(u.size) / RATE_HZ, u)
    bent = np.gradient(np.gradient(y, 1.0 / RATE_HZ), 1.0 / RATE_HZ)
    assert np.std((bent - 9.0 * y - late)[200:-200]) < 0.01 * np.std(u)
    assert np.std(left(UNSTABLE, u, y)) < 1e-3 * np.std(y)


def test_a_washout_takes_slow_poles_alone() -> None:
    washout = _Washout.of(UNSTABLE, corner_rad_s=0.5)
    assert washout.response(np.array([2.0j]))[0] == 1.0
    s = np.array([2.0j])
    both = _Washout.of(INTEGRATORS, corner_rad_s=0.5).response(s)
    np.testing.assert_allclose(both, (s / (s + 0.5)) ** 2, rtol=1e-12)
