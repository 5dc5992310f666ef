"""The equations of a multirotor: what must be conserved, the order of the integrator, forces against others' code."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.simulation import craft

from rotorid.errors import ModelError
from rotorid.models.physical import hover_speed, rotor_forces
from rotorid.models.rotors import RotorLayout
from rotorid.simulation.flight_kernels import derivative, glide
from rotorid.simulation.multirotor import STATES, Body, Multirotor, Rotors
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

RNG_SEED = 3
TUMBLING = np.array([3.0, -2.0, 4.0])


def turned(state: FloatArray) -> FloatArray:
    """Rotation from body to earth."""
    w, x, y, z = state[6:10]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def powerless(body: Body) -> Body:
    """The same without any force or torque but gravity; rotors still have angular momentum."""
    return body._replace(
        thrust=np.zeros(3), torque=np.zeros(3), has_air=False, has_aerodynamics=False, has_quadratic_drag=False
    )


def tumbling() -> tuple[FloatArray, Body]:
    """A body with products of inertia that tumbles while its rotors spin up."""
    inertia = np.array([[0.012, 0.001, -0.002], [0.001, 0.013, 0.0005], [-0.002, 0.0005, 0.02]])
    vehicle = craft.vehicle(inertia_kg_m2=inertia)
    state = vehicle.hovering()
    state[3:6], state[10:13] = (2.0, -1.0, -5.0), TUMBLING
    state[STATES:] = (0.1, 0.9, 0.5, 0.3)
    return state, powerless(vehicle.body())


def flown(state: FloatArray, body: Body, outputs: FloatArray, *, step_s: float, duration_s: float) -> FloatArray:
    steps = round(duration_s / step_s)
    return glide(state, np.tile(outputs, (steps, 1)), np.zeros((steps, 3)), 1.0, body, step_s)


def momentum(state: FloatArray, body: Body) -> FloatArray:
    """Angular momentum in earth axes, that of the rotors included."""
    own = body.inertia @ state[10:13] + body.spin_momentum @ state[STATES:]
    return turned(state) @ own


def energy(state: FloatArray, body: Body) -> FloatArray:
    """Kinetic and potential energy of the vehicle, without that of its rotors' spin."""
    spinning = 0.5 * state[10:13] @ body.inertia @ state[10:13]
    return np.array([0.5 * body.mass * state[3:6] @ state[3:6] + spinning - body.mass * body.gravity * state[2]])


@pytest.mark.parametrize(("kept", "rotors_turn"), [(momentum, True), (momentum, False), (energy, False)])
def test_what_must_be_conserved_is(kept: Callable[[FloatArray, Body], FloatArray], rotors_turn: bool) -> None:
    state, body = tumbling()
    outputs = np.array([0.8, 0.2, 0.4, 0.6])
    if not rotors_turn:
        body = body._replace(has_spin=False, spin_momentum=np.zeros((3, 4)))
    drifts = []
    for step_s in (0.02, 0.01, 0.005):
        states = flown(state, body, outputs, step_s=step_s, duration_s=2.0)
        values = np.stack([kept(one, body) for one in states])
        drifts.append(np.abs(values - values[0]).max() / np.abs(values[0]).max())
    slopes = np.log2(np.array(drifts[:-1]) / drifts[1:])
    # A method of order four: what it loses falls by sixteen for half the step, or faster.
    assert np.all(slopes > 3.8)
    assert drifts[-1] < 1e-6


def test_order_of_the_integrator() -> None:
    vehicle = craft.vehicle()
    state = vehicle.hovering()
    state[3:6], state[10:13] = (3.0, 1.0, -0.5), (0.8, -0.5, 0.3)
    outputs = vehicle.hover_shares + np.array([0.02, -0.01, 0.015, -0.02])
    ends = [
        flown(state, vehicle.body(), outputs, step_s=step_s, duration_s=1.6)[-1]
        for step_s in (0.016, 0.008, 0.004, 0.002)
    ]
    first, second, third = (np.linalg.norm(one - two) for one, two in itertools.pairwise(ends))
    assert np.log2(first / second) == pytest.approx(4.0, abs=0.2)
    assert np.log2(second / third) == pytest.approx(4.0, abs=0.1)


def test_the_quaternion_keeps_its_norm() -> None:
    state, body = tumbling()
    states = flown(state, body, np.full(4, 0.5), step_s=0.004, duration_s=600.0)
    # A few roundings: four squares, their sum, a root, a division.
    assert np.abs(np.linalg.norm(states[:, 6:10], axis=1) - 1.0).max() < 4 * np.finfo(float).eps


def plus() -> tuple[dict[str, float], Multirotor]:
    """The quadrotor of `rotorid.models.physical`: parameters, and the same as a vehicle; front, right, rear, left."""
    physics = {
        "m": 1.5,
        "I_xx": 0.03,
        "I_yy": 0.03,
        "I_zz": 0.055,
        "c_T": 0.1,
        "dc_T_dJ": -0.13,
        "c_H": 0.05,
        "c_P": 0.04,
    }
    physics |= {"D": 0.25, "l": 0.25, "z": 0.03, "rho": 1.225, "k_n": 100.0}
    physics["n_h"] = hover_speed(physics)
    arm, up, full = physics["l"], -physics["z"], 200.0
    layout = RotorLayout(
        name="plus",
        positions=np.array([[arm, 0.0, up], [0.0, arm, up], [-arm, 0.0, up], [0.0, -arm, up]]),
        spins=np.array([-1.0, 1.0, -1.0, 1.0]),
        arm_known=True,
    )
    flow = physics["rho"] * physics["D"] ** 3 * full
    rotors = Rotors(
        layout=layout,
        thrust=(0.0, 0.0, physics["c_T"] * flow * full * physics["D"]),
        torque=(0.0, 0.0, physics["c_P"] / (2.0 * np.pi) * flow * full * physics["D"] ** 2),
        induced_drag_n_s_m=physics["c_H"] * flow,
        inclined=True,
        inflow_n_s_m=-physics["dc_T_dJ"] * flow,
        full_speed_rad_s=2.0 * np.pi * full,
        lag_up_s=0.05,
    )
    inertia = np.diag([physics["I_xx"], physics["I_yy"], physics["I_zz"]])
    return physics, Multirotor(name="plus", mass_kg=physics["m"], inertia_kg_m2=inertia, rotors=rotors)


def test_forces_are_those_of_the_published_equations() -> None:
    physics, vehicle = plus()
    body, rng = vehicle.body(), np.random.default_rng(RNG_SEED)
    for _ in range(50):
        state = rng.standard_normal(STATES + 4)
        state[6:10] /= np.linalg.norm(state[6:10])
        state[STATES:] = rng.uniform(0.2, 0.9, 4)
        wind, out = rng.standard_normal(3), np.zeros(STATES + 4 + 3)
        derivative(state, state[STATES:], wind, 1.0, body, out)
        through_air = turned(state).T @ (state[3:6] - wind)
        force, moment = rotor_forces(physics, through_air, state[10:13], 200.0 * state[STATES:])
        spin = np.cross(state[10:13], body.inertia @ state[10:13])
        np.testing.assert_allclose(vehicle.mass_kg * out[-3:], force, rtol=0.0, atol=1e-12 * np.abs(force).max())
        np.testing.assert_allclose(body.inertia @ out[10:13] + spin, moment, rtol=0.0, atol=1e-11)
        falling = turned(state) @ out[-3:] + np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])
        np.testing.assert_allclose(out[3:6], falling, rtol=0.0, atol=1e-11)


def test_stability_derivatives_of_a_body_are_its_forces() -> None:
    matrix = np.random.default_rng(RNG_SEED).standard_normal((6, 6))
    vehicle = craft.vehicle(aerodynamics=matrix, center_of_gravity_m=(0.0, 0.0, 0.0))
    bare = replace(vehicle, aerodynamics=None)
    state = vehicle.hovering()
    state[3:6], state[10:13] = (1.0, -2.0, 0.5), (0.3, 0.2, -0.1)
    found = []
    for one in (vehicle, bare):
        out = np.zeros(STATES + 4 + 3)
        derivative(state, state[STATES:], np.zeros(3), 1.0, one.body(), out)
        found.append(np.concatenate([vehicle.mass_kg * out[-3:], vehicle.inertia_kg_m2 @ out[10:13]]))
    moving = np.concatenate([state[3:6], state[10:13]])
    np.testing.assert_allclose(found[0] - found[1], matrix @ moving, rtol=1e-11)


@pytest.mark.parametrize("rising", [True, False])
def test_lags_up_and_down(rising: bool) -> None:
    up_s, down_s, step_s = 0.03, 0.05, 0.002
    vehicle = craft.vehicle(rotors=craft.rotors(lag_up_s=up_s, lag_down_s=down_s))
    state, lag_s = vehicle.hovering(), up_s if rising else down_s
    state[STATES:] = 0.5
    target = 0.6 if rising else 0.4
    states = flown(state, vehicle.body(), np.full(4, target), step_s=step_s, duration_s=0.1)
    elapsed = step_s * np.arange(len(states))
    exact = target + (0.5 - target) * np.exp(-elapsed / lag_s)
    # Each step leaves out z^5/120 and what comes after it, half as much at most.
    bound = 0.1 * len(states) * (step_s / lag_s) ** 5 / 120.0 * 1.5
    assert np.abs(states[:, STATES:] - exact[:, None]).max() < bound


def test_rotors_without_lag_follow_at_once() -> None:
    vehicle = craft.vehicle(rotors=craft.rotors(lag_up_s=0.0))
    states = flown(vehicle.hovering(), vehicle.body(), np.full(4, 0.7), step_s=0.002, duration_s=0.01)
    np.testing.assert_array_equal(states[1:, STATES:], 0.7)


@pytest.mark.parametrize("center_m", [(0.0, 0.0, 0.0), (0.03, -0.02, 0.04)])
def test_hover_is_an_equilibrium(center_m: tuple[float, float, float]) -> None:
    vehicle = craft.vehicle(center_of_gravity_m=center_m, rotors=craft.rotors(thrust=(0.0, 0.0, 9.0)))
    out, state = np.zeros(STATES + 4 + 3), vehicle.hovering()
    derivative(state, state[STATES:], np.zeros(3), 1.0, vehicle.body(), out)
    np.testing.assert_allclose(out[: STATES + 4], 0.0, atol=1e-12)
    thrusts = np.array([vehicle.rotors.thrust_at(float(share)) for share in vehicle.hover_shares])
    # About the center of gravity the thrusts balance: rotors on its side carry more.
    np.testing.assert_allclose(vehicle.hubs_m[:, :2].T @ thrusts, 0.0, atol=1e-12)


def test_control_that_is_known_without_a_geometry() -> None:
    own = craft.vehicle(center_of_gravity_m=(0.0, 0.0, 0.0), rotors=craft.rotors(thrust=(0.0, 0.0, 9.0)))
    known = replace(own, effectiveness=own.wrench)
    state = own.hovering()
    state[STATES:] += (0.1, -0.1, 0.05, 0.02)
    found = []
    for one in (own, known):
        out = np.zeros(STATES + 4 + 3)
        derivative(state, state[STATES:], np.zeros(3), 1.0, one.body(), out)
        found.append(out)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12, atol=1e-12)


def test_a_vehicle_too_heavy_to_hover_says_so() -> None:
    with pytest.raises(ModelError, match="too heavy"):
        _ = craft.vehicle(mass_kg=20.0).hover_shares
