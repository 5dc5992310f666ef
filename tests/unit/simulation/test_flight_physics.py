"""Simulated vehicles in moving air, against the equations of flight that fits use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.simulation import craft
from tests.unit.simulation.test_multirotor import turned

from rotorid.errors import ModelError
from rotorid.models.flight import Airframe, felt, flight_loads, speeds_of_outputs
from rotorid.simulation import linearize
from rotorid.simulation.flight_kernels import derivative
from rotorid.simulation.flight_kernels import felt as measure
from rotorid.simulation.flight_physics import flight_values, rotors_with, with_flight
from rotorid.simulation.linearization import MOTION, trimmed
from rotorid.simulation.multirotor import STATES, Multirotor, RotorFlow, Sensors
from rotorid.simulation.multirotor_flight import Aircraft, changed
from rotorid.typing import FloatArray

DISC_M2 = 0.05
OF_SHARES = {
    "m": 1.2,
    "c_0": 0.05,
    "c_1": 0.4,
    "c_2": 12.0,
    "c_lambda": 0.45,
    "k_d": 0.12,
    "k_w": 0.004,
    "c_h": 0.03,
    "c_hw": 0.002,
    "c_ha": -0.003,
    "d_z": 0.02,
    "c_wake": 0.05,
    "T_motor": 0.04,
    "I_xx": 0.012,
    "I_yy": 0.013,
    "I_zz": 0.02,
    "kappa": 0.018,
    "J_r": 0.01,
    "m_f": 0.0005,
    "m_fx": 0.0002,
    "m_s": 0.003,
    "kappa_lambda": 0.0004,
    "k_r": 0.002,
}
FULL_RAD_S = 900.0
PER_SPEED = {"c_1": 1, "c_2": 2, "c_lambda": 1, "k_d": 1, "c_h": 1, "J_r": 1, "m_f": 1, "m_fx": 1, "m_s": 1, "k_r": 1}
OF_SPEEDS = {
    name: value / FULL_RAD_S ** PER_SPEED.get(name, 0)
    for name, value in OF_SHARES.items()
    # The curve of outputs is none of speeds.
    if name not in ("c_0", "c_1")
}
FORMS = pytest.mark.parametrize(("values", "full"), [(OF_SHARES, 1.0), (OF_SPEEDS, FULL_RAD_S)])


def _vehicle(values: dict[str, float], full: float) -> Multirotor:
    return with_flight(craft.vehicle(), values, disc_m2=DISC_M2, full=full)


def _frame(vehicle: Multirotor) -> Airframe:
    return Airframe(
        positions=vehicle.hubs_m, spins=vehicle.rotors.layout.spins, mass_kg=vehicle.mass_kg, disc_m2=DISC_M2
    )


def _rates(vehicle: Multirotor, state: FloatArray, outputs: FloatArray, wind: FloatArray) -> FloatArray:
    out = np.zeros(state.size + 3)
    derivative(state, outputs, wind, 1.0, vehicle.body(), out)
    return out


_SOON_S = 1e-8


def _shares(values: dict[str, float], outputs: FloatArray) -> FloatArray:
    """Shares of the full speed by lagged outputs."""
    return speeds_of_outputs(values, outputs)


@FORMS
def test_loads_are_those_of_the_equations_of_flight(values: dict[str, float], full: float) -> None:
    vehicle = _vehicle(values, full)
    body, frame, rng = vehicle.body(), _frame(vehicle), np.random.default_rng(5)
    momentum = vehicle.rotors.inertia_kg_m2 * full * vehicle.rotors.layout.spins
    for _ in range(200):
        state = rng.standard_normal(STATES + 4)
        state[3:6] *= 4.0
        state[6:10] /= np.linalg.norm(state[6:10])
        state[STATES:], outputs, wind = rng.uniform(0.2, 0.9, 4), rng.uniform(0.2, 0.9, 4), rng.standard_normal(3)
        out = _rates(vehicle, state, outputs, wind)
        rates, velocity = state[10:13], turned(state).T @ (state[3:6] - wind)
        shares, soon = (_shares(values, state[STATES:] + ahead * out[STATES : STATES + 4]) for ahead in (0.0, _SOON_S))
        loads = flight_loads(
            values,
            frame,
            speeds=full * shares[:, None],
            velocity=velocity[:, None],
            rates=rates[:, None],
            spin_up=full * (soon - shares)[:, None] / _SOON_S,
        )
        np.testing.assert_allclose(vehicle.mass_kg * out[-3:], loads.force[:, 0], rtol=1e-9, atol=1e-8)
        # Turning the axes of spinning rotors takes a moment that a flight's regressions leave out.
        turning = np.cross(rates, [0.0, 0.0, -momentum @ shares])
        moment = body.inertia @ out[10:13] + np.cross(rates, body.inertia @ rates) + turning
        # Spin-up is a difference here.
        np.testing.assert_allclose(moment, loads.moment[:, 0], rtol=1e-6, atol=1e-7)


@FORMS
def test_numbers_come_back(values: dict[str, float], full: float) -> None:
    found = flight_values(_vehicle(values, full), full=full)
    assert found == pytest.approx({"c_0": 0.0, "c_1": 0.0, **values}, rel=1e-12)


def test_hover_is_an_equilibrium_at_the_speed_of_the_equations() -> None:
    vehicle = replace(_vehicle(OF_SHARES, 1.0), center_of_gravity_m=(0.0, 0.0, 0.01))
    out = _rates(vehicle, vehicle.hovering(), vehicle.hover_shares.copy(), np.zeros(3))
    np.testing.assert_allclose(out[3:], [*[0.0] * (STATES + 1), 0.0, 0.0, -9.80665], atol=1e-9)


def test_the_accelerometer_is_where_the_equations_have_it() -> None:
    vehicle, rng = _vehicle(OF_SHARES, 1.0), np.random.default_rng(6)
    place = {"x_imu": 0.02, "y_imu": -0.01, "z_imu": 0.03}
    senses = Sensors(accelerometer_place_m=(0.02, -0.01, 0.03)).senses()
    state = vehicle.hovering()
    state[3:6], state[10:13] = rng.standard_normal(3), rng.standard_normal(3)
    out, lagged = _rates(vehicle, state, state[STATES:].copy(), np.zeros(3)), np.zeros(9)
    measure(state, out, 0.0, 1.0, lagged, senses)
    rates, speeds = state[10:13, None], _shares(OF_SHARES, state[STATES:])[:, None]
    loads = flight_loads(OF_SHARES, _frame(vehicle), speeds=speeds, velocity=state[3:6, None], rates=rates)
    expected = felt(loads, place, vehicle.mass_kg, rates, out[10:13, None])
    np.testing.assert_allclose(lagged[6:9], expected[:, 0], rtol=1e-9)


@pytest.mark.parametrize("airspeed_m_s", [0.0, 6.0])
def test_slopes_are_exact(airspeed_m_s: float) -> None:
    vehicle, autopilot = _vehicle(OF_SHARES, 1.0), craft.autopilot()
    wind = np.array([-airspeed_m_s, 0.0, 0.0])
    system = linearize(vehicle, autopilot, airspeed_m_s=airspeed_m_s)
    trim = trimmed(vehicle, airspeed_m_s)
    state = vehicle.hovering()
    state[6:10], state[STATES:] = trim.quaternion, trim.shares
    step, turn = 1e-5, turned(state)
    for row, name in enumerate(("u", "v", "w")):
        ends = []
        for sign in (-1.0, 1.0):
            moved = state.copy()
            moved[3:6] = sign * step * turn[:, row]
            out = _rates(vehicle, moved, trim.shares.copy(), wind)
            ends.append(np.concatenate([turn.T @ out[3:6], out[10:13]]))
        difference = (ends[1] - ends[0]) / (2.0 * step)
        np.testing.assert_allclose(system.F[:6, MOTION.index(name)], difference, rtol=1e-5, atol=1e-6)


def test_drag_is_scaled_as_a_whole() -> None:
    vehicle = _vehicle(OF_SHARES, 1.0)
    flying = Aircraft(vehicle=vehicle, autopilot=craft.autopilot())
    twice = flight_values(changed(flying, {"drag": 2.0}).vehicle)
    of_air = ("c_lambda", "k_d", "k_w", "c_h", "c_hw", "c_ha", "d_z", "c_wake", "m_f", "m_fx", "m_s", "k_r")
    assert [twice[name] for name in of_air] == pytest.approx([2.0 * OF_SHARES[name] for name in of_air])
    hovering = changed(flying, {"drag": 2.0}).vehicle.hover_shares
    np.testing.assert_allclose(hovering, vehicle.hover_shares, rtol=1e-12)


def test_rotors_that_cannot_carry_the_weight() -> None:
    vehicle = craft.vehicle()
    with pytest.raises(ModelError, match="cannot carry"):
        rotors_with({"c_2": -0.1}, _frame(vehicle), vehicle.rotors.layout)


@pytest.mark.parametrize("name", ["disc_m2", "wake_n_s2_m3"])
def test_impossible_flow(name: str) -> None:
    with pytest.raises(ModelError, match="flow of the rotors"):
        RotorFlow(**{name: -np.inf})
