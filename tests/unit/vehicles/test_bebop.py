"""The Bebop 2: the printed matrices as responses, and what they say about themselves."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.models.library import response_model
from rotorid.models.state_space import StateSpace
from rotorid.vehicles import bebop

OMEGA = np.geomspace(0.1, 30.0, 40)


def steady_gains(system: StateSpace) -> list[float]:
    return np.diag(system.H0 @ np.linalg.solve(-system.F, system.G)).tolist()


def test_parameters_belong_to_the_models() -> None:
    for name, values in {
        "response.first_order": bebop.FIRST_ORDER,
        "response.first_order_delay": bebop.FIRST_ORDER_DELAY,
    }.items():
        assert set(values) == set(response_model(name, bebop.PAIRS).parameters.names)
    yaw = response_model("response.first_order_delay", [("r_setpoint", "r")])
    assert set(bebop.YAW_RATE) == set(yaw.parameters.names)


def test_first_order_is_eq_15() -> None:
    response = bebop.first_order().response(OMEGA)
    for row, (gain, lag) in enumerate([(1.126, 0.2368), (1.1075, 0.2318), (1.2270, 0.3367)]):
        np.testing.assert_allclose(response[row, row], gain / (1.0 + 1j * OMEGA * lag), rtol=1e-12)


def test_delay_is_one_sample() -> None:
    response = bebop.first_order_delay().response(OMEGA)[2, 2]
    expected = 1.1635 / (1.0 + 1j * OMEGA * 0.2599) * np.exp(-0.05j * OMEGA)
    np.testing.assert_allclose(response, expected, rtol=1e-12)


@pytest.mark.parametrize("system", [bebop.second_order(), bebop.third_order()], ids=["second", "third"])
def test_channels_stand_apart(system: StateSpace) -> None:
    response = system.response(OMEGA)
    assert not response[~np.eye(3, dtype=bool)].any()


def test_second_order_fits_the_library_with_a_zero() -> None:
    """Two states with any B and C are a gain, a frequency, a damping and a zero: four numbers for the eight printed."""
    model = response_model("response.second_order_zero", bebop.PAIRS)
    system = bebop.second_order()
    values: dict[str, float] = {}
    for row, (_, y) in enumerate(bebop.PAIRS):
        block = slice(2 * row, 2 * row + 2)
        A, B, C = system.F[block, block], system.G[block, row], system.H0[row, block]
        omega = np.sqrt(np.linalg.det(A))
        gain = C @ np.linalg.solve(-A, B)
        values |= {
            f"K_{y}": gain,
            f"omega_{y}": omega,
            f"zeta_{y}": -np.trace(A) / (2.0 * omega),
            f"T_zero_{y}": C @ B / (gain * omega**2),
        }
    np.testing.assert_allclose(model.response(values, OMEGA), system.response(OMEGA), rtol=1e-9, atol=1e-15)


def test_higher_orders_hold_slow_dynamics_that_are_none() -> None:
    assert steady_gains(bebop.second_order()) == pytest.approx([0.863, 0.907, 0.921], abs=5e-4)
    assert steady_gains(bebop.third_order()) == pytest.approx([0.33, -13.4, 0.97], abs=0.05)
    assert steady_gains(bebop.fourth_order_pitch()) == pytest.approx([-109.0], abs=0.5)
    assert abs(bebop.third_order().poles()[0]) == pytest.approx(0.0049, abs=5e-5)


def test_published_bandwidths_follow_from_the_rise_times() -> None:
    for channel, printed in {"theta": (1.35, 0.28), "phi": (0.85, 0.08), "velocity_down": (1.12, 0.09)}.items():
        mean, spread = bebop.RISE_TIME_S[channel]
        assert (0.35 / mean, 0.35 / mean**2 * spread) == pytest.approx(printed, abs=0.0101)
