"""``physical.hover`` of any layout: derivatives against the forces of its rotors themselves, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.hover_layouts import HOVER, physical_hover, plain_mixer
from rotorid.models.library import library_model
from rotorid.models.physical import MIXER
from rotorid.models.rotors import RotorLayout, ardupilot_mixer, library_layout, px4_mixer
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2 as G


def own_layout() -> RotorLayout:
    positions = [[0.21, 0.13, 0.0], [-0.18, -0.15, 0.0], [0.21, -0.13, 0.0], [-0.18, 0.15, 0.0]]
    spins = np.array([1.0, 1.0, -1.0, -1.0])
    return RotorLayout(name="own", positions=np.array(positions), spins=spins, arm_known=True, source="measured")


LAYOUTS = {name: library_layout(name) for name in ("quad.x", "quad.h", "hexa.plus", "hexa.x", "octo.v")}
LAYOUTS["own"] = own_layout()
ACROSS_M_S = 1.0


def accelerations(
    physics: dict[str, float], layout: RotorLayout, motion: FloatArray, speeds_rev_s: FloatArray
) -> FloatArray:
    """Of all rotors: the forces at the head of `rotorid.models.physical`, rotor by rotor."""
    rho, D = physics["rho"], physics["D"]
    hubs = layout.positions / layout.arm * physics["l"]
    hubs[:, 2] = -physics["z"]
    force, moment = np.zeros(3), np.zeros(3)
    for hub, spin, n in zip(hubs, layout.spins, speeds_rev_s, strict=True):
        u, v, w = motion[:3] + np.cross(motion[3:], hub)
        speed, sideways = math.sqrt(u * u + v * v + w * w), math.hypot(u, v)
        thrust = (physics["c_T"] - physics["dc_T_dJ"] * w / (n * D)) * rho * n**2 * D**4
        drag = physics["c_H"] * rho * n * D**3 * (sideways / speed if speed else 0.0)
        one = np.array([-drag * u, -drag * v, -thrust])
        force += one
        moment += np.cross(hub, one)
        moment[2] += spin * physics["c_P"] / (2.0 * np.pi) * rho * n**2 * D**5
    return np.concatenate([force / physics["m"], moment / [physics[name] for name in ("I_xx", "I_yy", "I_zz")]])


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("rule", ["plain", "ardupilot", "px4"])
def test_derivatives_are_the_slopes_of_the_forces(name: str, rule: str) -> None:
    layout = LAYOUTS[name]
    mixer = {"plain": plain_mixer, "ardupilot": ardupilot_mixer, "px4": px4_mixer}[rule](layout)
    values = physical_hover(layout, mixer).parameters.values
    step, hover = 1e-3, values["n_h"]
    assert layout.rotors * values["c_T"] * values["rho"] * hover**2 * values["D"] ** 4 == pytest.approx(values["m"] * G)

    def at(column: int, sign: float) -> FloatArray:
        # Across, as a vehicle that leans moves: the inflow of all rotors is then inclined alike.
        across_m_s = ACROSS_M_S if column < 6 else 0.0
        point = np.array([across_m_s, across_m_s, *[0.0] * 8])
        point[column] += sign * step
        speeds = hover + values["k_n"] * mixer @ point[6:]
        return accelerations(values, layout, point[:6], speeds)

    slopes = np.stack([(at(column, 1.0) - at(column, -1.0)) / (2.0 * step) for column in range(10)], axis=1)
    rows, columns = "XYZLMN", ("u", "v", "w", "p", "q", "r", "roll", "pitch", "yaw", "thrust")
    names = "X_u Y_v X_q Y_p M_u L_v M_q L_p L_roll M_pitch N_r N_yaw Z_w Z_thrust"
    for derivative in names.split():
        axis, of = derivative.split("_")
        expected = slopes[rows.index(axis), columns.index(of)]
        assert values[derivative] == pytest.approx(expected, rel=1e-5, abs=1e-9), derivative


def test_spin_up_is_the_angular_momentum_of_the_rotors() -> None:
    layout = library_layout("hexa.x")
    mixer = px4_mixer(layout)
    values = physical_hover(layout, mixer).parameters.values
    momentum = sum(
        spin * values["J_r"] * 2.0 * np.pi * values["k_n"] * by
        for spin, by in zip(layout.spins, mixer[:, 2], strict=True)
    )
    assert values["N_spin"] == pytest.approx(momentum / values["I_zz"], rel=1e-9)


def test_a_plus_is_the_model_of_the_library() -> None:
    own, library = physical_hover(library_layout("quad.plus")).parameters, library_model(HOVER).parameters
    for name, value in library.values.items():
        assert own.values[name] == pytest.approx(value, rel=1e-12), name
    mixer = plain_mixer(library_layout("quad.plus"))
    np.testing.assert_array_equal(np.abs(MIXER).sum(axis=0), np.abs(mixer).sum(axis=0))


def test_an_arm_counts_by_its_parameter_alone() -> None:
    small, large = (physical_hover(library_layout("quad.x").scaled(arm)).parameters.values for arm in (0.1, 0.4))
    assert small == pytest.approx(large, rel=1e-9)


@pytest.mark.parametrize(
    ("layout", "words"),
    [
        (library_layout("x8"), "above one another"),
        (
            RotorLayout(
                name="tilted", positions=library_layout("quad.x").positions, spins=library_layout("quad.x").spins,
                axes=np.tile([0.2, 0.0, -1.0], (4, 1)), source="test",
            ),
            "rotors 1, 2, 3, 4 of the layout tilted are tilted",
        ),
        (
            RotorLayout(name="one way", positions=library_layout("quad.x").positions, spins=np.ones(4), source="test"),
            "and no yaw of their own",
        ),
    ],
)  # fmt: skip
def test_rotors_that_the_model_does_not_hold_for_are_refused(layout: RotorLayout, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        physical_hover(layout)


def test_a_mixer_of_other_rotors_is_refused() -> None:
    with pytest.raises(ModelError, match=r"got a mixer of shape \(6, 4\)"):
        physical_hover(library_layout("quad.x"), plain_mixer(library_layout("hexa.x")))


def test_slopes_of_thrust_are_those_at_the_mean_speed_of_its_sweep() -> None:
    layout, spread = library_layout("quad.x"), 0.12
    values = physical_hover(layout, plain_mixer(layout)).with_constants({"thrust_spread": spread}).parameters.values
    moved = values["k_n"] * spread
    assert values["n_m"] == pytest.approx(math.sqrt(values["n_h"] ** 2 - moved**2), rel=1e-4)
    # The mean square of the speeds carries the weight; the slope of a square, by the force that is in phase.
    swing = np.sqrt(2.0) * np.sin(np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False))
    speeds = values["n_m"] + moved * swing
    force = -np.array([accelerations(values, layout, np.zeros(6), np.full(4, n))[2] for n in speeds])
    assert force.mean() == pytest.approx(G, rel=1e-4)
    assert -values["Z_thrust"] * spread == pytest.approx(float(np.mean(force * swing)), rel=1e-6)
