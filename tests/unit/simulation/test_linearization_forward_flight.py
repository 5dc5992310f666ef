"""The linear model of level flight, against differences of the nonlinear vehicle in a wind from the front."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid import vehicles
from rotorid.errors import ModelError
from rotorid.simulation import STATES, Aircraft, Multirotor, linearize, trimmed
from rotorid.simulation.flight_kernels import derivative
from rotorid.simulation.linearization import MOTION
from rotorid.typing import FloatArray

DRAG = np.diag([-0.25, -0.35, -0.2, -0.01, -0.012, -0.008])
DRAG[4, 0] = 0.02


def _aircraft(*, inclined: bool = False) -> Aircraft:
    own = vehicles.aircraft("px4_quad")
    rotors = replace(own.vehicle.rotors, induced_drag_n_s_m=0.06, inflow_n_s_m=0.5, inclined=inclined)
    vehicle = replace(own.vehicle, rotors=rotors, aerodynamics=DRAG, quadratic_drag_n_s2_m2=(0.03, 0.04, 0.05))
    return replace(own, vehicle=vehicle)


def _turn(phi: float, theta: float, psi: float) -> FloatArray:
    """Body to earth, by three turns."""
    (cf, ct, cp), (sf, st, sp) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    roll = np.array([[1, 0, 0], [0, cf, -sf], [0, sf, cf]])
    pitch = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
    yaw = np.array([[cp, -sp, 0], [sp, cp, 0], [0, 0, 1]])
    return np.asarray(yaw @ pitch @ roll)


def _rates(vehicle: Multirotor, motion: FloatArray, shares: FloatArray, wind: FloatArray) -> FloatArray:
    """Rates of u v w p q r phi theta psi from the compiled equations, at velocities relative to the air."""
    velocity, rates, (phi, theta, psi) = motion[:3], motion[3:6], motion[6:]
    turn = _turn(phi, theta, psi)
    half = 0.5 * np.array([phi, theta, psi])
    (cf, ct, cp), (sf, st, sp) = np.cos(half), np.sin(half)
    attitude = [
        cf * ct * cp + sf * st * sp,
        sf * ct * cp - cf * st * sp,
        cf * st * cp + sf * ct * sp,
        cf * ct * sp - sf * st * cp,
    ]
    state = np.concatenate([np.zeros(3), turn @ velocity + wind, attitude, rates, shares])
    out = np.zeros(STATES + shares.size + 3)
    derivative(state, shares.copy(), wind, 1.0, vehicle.body(), out)
    p, q, r = rates
    swing = q * np.sin(phi) + r * np.cos(phi)
    angles = [p + swing * np.tan(theta), q * np.cos(phi) - r * np.sin(phi), swing / np.cos(theta)]
    return np.concatenate([turn.T @ out[3:6] - np.cross(rates, velocity), out[10:13], angles])


@pytest.mark.parametrize("inclined", [False, True])
@pytest.mark.parametrize("airspeed_m_s", [-4.0, 4.0, 8.0])
def test_slopes_are_those_of_central_differences_in_a_head_wind(airspeed_m_s: float, inclined: bool) -> None:
    flown = _aircraft(inclined=inclined)
    trim = trimmed(flown.vehicle, airspeed_m_s)
    wind = np.array([-airspeed_m_s, 0.0, 0.0])
    at = np.concatenate([trim.velocity_m_s, np.zeros(3), trim.angles_rad])
    np.testing.assert_allclose(_rates(flown.vehicle, at, trim.shares, wind), 0.0, atol=1e-9)
    assert np.sign(trim.angles_rad[1]) == -np.sign(airspeed_m_s)
    step = 1e-5
    differences = np.stack(
        [
            _rates(flown.vehicle, at + step * row, trim.shares, wind)
            - _rates(flown.vehicle, at - step * row, trim.shares, wind)
            for row in np.eye(len(MOTION))
        ],
        axis=1,
    ) / (2.0 * step)
    system = linearize(flown.vehicle, flown.autopilot, airspeed_m_s=airspeed_m_s)
    found = system.F[: len(MOTION), : len(MOTION)]
    np.testing.assert_allclose(found, differences, rtol=1e-6, atol=1e-6)
    # The rotors' columns too.
    by_speed = np.stack(
        [
            _rates(flown.vehicle, at, trim.shares + step * row, wind)
            - _rates(flown.vehicle, at, trim.shares - step * row, wind)
            for row in np.eye(trim.shares.size)
        ],
        axis=1,
    ) / (2.0 * step)
    if not flown.vehicle.body().has_spin:
        np.testing.assert_allclose(system.F[: len(MOTION), len(MOTION) :], by_speed, rtol=1e-6, atol=1e-6)
    else:
        np.testing.assert_allclose(system.F[:3, len(MOTION) :], by_speed[:3], rtol=1e-6, atol=1e-6)


def test_quadratic_drag_grows_with_speed() -> None:
    flown = _aircraft()
    damping = [linearize(flown.vehicle, flown.autopilot, airspeed_m_s=speed).F[0, 0] for speed in (0.0, 4.0, 8.0)]
    assert damping[0] > damping[1] > damping[2]


def test_no_speed_is_hover() -> None:
    flown = _aircraft()
    hover, near = (linearize(flown.vehicle, flown.autopilot, airspeed_m_s=speed) for speed in (0.0, 1e-6))
    np.testing.assert_allclose(near.F, hover.F, atol=1e-4)
    np.testing.assert_allclose(near.G, hover.G, atol=1e-4)


@pytest.mark.parametrize("airspeed_m_s", [200.0, float("nan")])
def test_a_speed_that_cannot_be_flown(airspeed_m_s: float) -> None:
    with pytest.raises(ModelError, match="cannot fly level"):
        trimmed(_aircraft().vehicle, airspeed_m_s)
