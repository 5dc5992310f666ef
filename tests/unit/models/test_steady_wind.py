"""Hover that leans against a steady wind: the model against the forces themselves, and calm air untouched."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rotorid.errors import ModelError
from rotorid.models.library import library_model, rate_model
from rotorid.models.steady_wind import in_steady_wind, lean_of, leans
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

THETA_0, PHI_0 = 0.15, -0.1
ATTITUDE = Rotation.from_euler("ZYX", [0.4, THETA_0, PHI_0])
G = np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])
GRAVITY = ATTITUDE.inv().apply(G)
"""In body axes at trim."""

CASES = ((-0.3, -0.3), (-0.3, 0.0), (-0.25, -0.6))
"""Damping across the rotors and along them: of a body, of rotors in their plane, and of rotors with inflow."""


def flown(damping: FloatArray, turned: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
    """Derivative of the speed, and accelerometers less the steady drag, at small angles about the trim."""
    air = np.array([-GRAVITY[0] / damping[0], -GRAVITY[1] / damping[1], 0.0])
    air[2] = -(GRAVITY[:2] @ air[:2]) / GRAVITY[2]  # the wind is level
    wind = ATTITUDE.apply(-air)
    thrust = -GRAVITY[2] - damping[2] * air[2]
    attitude = ATTITUDE * Rotation.from_rotvec(turned)
    force = damping * attitude.inv().apply(-wind) + np.array([0.0, 0.0, thrust])
    down = ATTITUDE.apply([0.0, 0.0, 1.0])
    drag = STANDARD_GRAVITY_M_S2 * np.array([down[0], down[1], 0.0]) / down[2]
    return force + attitude.inv().apply(G), force - np.array([1.0, 1.0, share]) * attitude.inv().apply(drag)


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize(("across", "along"), CASES)
def test_the_slopes_by_angles_are_those_of_the_forces(across: float, along: float, share: float) -> None:
    damping = np.array([across, across, along])
    step = 1e-5
    slopes = [
        np.subtract(flown(damping, step * axis, share), flown(damping, -step * axis, share)) / (2.0 * step)
        for axis in np.eye(3)
    ]
    structure = in_steady_wind(library_model("hover.full"), -GRAVITY[0], -GRAVITY[1], heave_share=share)
    values = structure.parameters.values | {"X_u": across, "Y_v": across, "Z_w": along, "X_q": 0.0, "Y_p": 0.0}
    system = structure.matrices(values)
    F = np.linalg.solve(system.M, system.F)
    C = system.H0 + system.H1 @ F
    speeds = [structure.states.index(name) for name in ("u", "v", "w")]
    sensors = [structure.outputs.index(name) for name in ("ax", "ay", "az")]
    for angle, (by_force, by_sensor) in zip(("phi", "theta", "psi"), slopes, strict=True):
        column = structure.states.index(angle)
        # One over a damping is bounded, which costs a percent of the airspeed here.
        np.testing.assert_allclose(F[speeds, column], by_force, atol=0.03)
        np.testing.assert_allclose(C[sensors, column], by_sensor, atol=0.03)


def test_without_the_trim_heave_would_be_wrong_by_the_lean() -> None:
    damping = np.array([-0.3, -0.3, -0.3])
    up, down = (flown(damping, np.array([0.0, sign * 1e-5, 0.0]), 1.0)[0][2] for sign in (1.0, -1.0))
    assert abs(up - down) / 2e-5 < 1e-3
    calm = library_model("hover.longitudinal").with_constants({"theta0": THETA_0, "phi0": PHI_0})
    F = calm.matrices(calm.parameters.values).F
    assert F[calm.states.index("w"), calm.states.index("theta")] < -1.4


@pytest.mark.parametrize("name", ["hover.lateral", "hover.longitudinal", "hover.full", "axis.roll", "axis.pitch"])
def test_calm_air_changes_nothing(name: str) -> None:
    calm = library_model(name)
    assert leans(calm)
    assert in_steady_wind(calm, 0.0, 0.0) is calm
    again = in_steady_wind(in_steady_wind(calm, 1.2, -0.7, heave_share=1.0), 0.0, 0.0)
    assert again.constants["g"] == pytest.approx(calm.constants["g"], rel=1e-12)
    omega = np.geomspace(0.5, 50.0, 20)
    before, after = (one.response(one.parameters.values, omega) for one in (calm, again))
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9)


def test_gravity_along_the_thrust_and_the_lean_come_back() -> None:
    lean = math.acos(GRAVITY[2] / STANDARD_GRAVITY_M_S2)
    windy = in_steady_wind(library_model("hover.lateral"), -GRAVITY[0], -GRAVITY[1])
    assert windy.constants["g"] == pytest.approx(STANDARD_GRAVITY_M_S2 / math.cos(lean), rel=1e-12)
    assert lean_of(windy.constants) == pytest.approx(lean, rel=1e-12)
    other = in_steady_wind(windy, 0.5, 0.0)
    assert lean_of(other.constants) == pytest.approx(math.asin(0.5 / STANDARD_GRAVITY_M_S2), rel=1e-12)


def test_the_wind_turns_a_vehicle_by_the_derivatives_of_speed() -> None:
    windy = in_steady_wind(library_model("hover.lateral"), 1.0, 0.0)
    values = windy.parameters.values | {"L_v": -6.0, "Y_v": -0.25}
    F = windy.matrices(values).F
    airspeed = 1.0 / -0.25
    assert F[windy.states.index("p"), windy.states.index("psi")] == pytest.approx(6.0 * airspeed, rel=0.01)


def test_a_drag_beyond_gravity_is_refused() -> None:
    with pytest.raises(ModelError, match="steady drag of 11"):
        in_steady_wind(library_model("hover.lateral"), 11.0, 0.0)


def test_a_model_without_gravity_does_not_lean() -> None:
    assert not leans(rate_model("rate.vertical"))
