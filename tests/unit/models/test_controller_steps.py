"""A controller step by step is, for small steps, the one of the frequency response."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.models.controller import Driven, RateController, stepped
from rotorid.typing import ComplexArray

OMEGA = np.geomspace(0.5, 60.0, 12)
CONTROLLERS = {
    "plain": RateController(proportional_s=0.15),
    "cascade": RateController(proportional_s=0.15, integral=0.2, angle_1_s=4.0),
    "PX4": RateController(
        proportional_s=0.15,
        integral=0.2,
        derivative_s2=0.003,
        angle_1_s=4.0,
        derivative_cutoff_hz=20.0,
        command_cutoff_hz=5.0,
    ),
    "ArduPilot": RateController(
        proportional_s=0.135,
        integral=0.135,
        derivative_s2=0.0036,
        angle_1_s=4.5,
        derivative_of_error=True,
        derivative_cutoff_hz=20.0,
        error_cutoff_hz=9.0,
        target_cutoff_hz=20.0,
    ),
}


def feedback(controller: RateController, step_s: float, driven: Driven) -> ComplexArray:
    """Command per rate, without its sign, of the recursion."""
    own = stepped(controller, step_s=step_s, driven=driven)
    z = np.exp(1j * OMEGA * step_s)[:, None, None]
    states = np.linalg.solve(z * np.eye(len(own.transition)) - own.transition, own.drive[:, 1:][None])
    return np.asarray(-(own.read @ states + own.direct[:, 1:])[:, 0, 0])


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_error_falls_with_the_step(name: str) -> None:
    controller = CONTROLLERS[name]
    exact = controller.response(OMEGA)
    coarse, fine = (np.abs(feedback(controller, h, "angle") / exact - 1.0) for h in (1e-4, 5e-5))
    assert coarse.max() < 60.0 * 1e-4 * 2.0
    # First order: half the step, half the error; where the error is rounding there is nothing to compare.
    some = coarse > 1e-9
    np.testing.assert_allclose(fine[some] / coarse[some], 0.5, atol=0.02)


def test_a_rate_set_point_closes_no_angle_loop() -> None:
    controller = CONTROLLERS["cascade"]
    exact = controller.rate_loop.response(OMEGA)
    np.testing.assert_allclose(feedback(controller, 1e-5, "rate"), exact, rtol=60.0 * 1e-5)


def test_a_delay_turns_the_phase() -> None:
    late = RateController(proportional_s=0.15, delay_s=0.004)
    np.testing.assert_allclose(late.response(OMEGA), 0.15 * np.exp(-0.004j * OMEGA), rtol=1e-12)
