"""Rotor layouts: balance, symmetry and rank of every layout of the library, mixers, and what logs tell."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.models.autopilots.layouts import layout_of, mixer_of
from rotorid.models.rotors import (
    RotorLayout,
    ardupilot_mixer,
    layout_from_toml,
    layout_names,
    library_layout,
    named_by,
    px4_mixer,
)

KAPPA = 0.1
LOPSIDED = {"octo.v": 0.04}
"""ArduPilot's table itself leaves a pitch moment with equal thrusts."""


@pytest.mark.parametrize("name", layout_names())
def test_equal_thrusts_hover(name: str) -> None:
    layout = library_layout(name)
    force_moment = layout.effectiveness(KAPPA).sum(axis=1)
    assert force_moment[2] == pytest.approx(-layout.rotors)
    assert np.abs(force_moment[[0, 1, 3, 5]]).max() < 1e-12
    assert abs(force_moment[4]) < LOPSIDED.get(name, 1e-12)


@pytest.mark.parametrize("name", layout_names())
def test_every_layout_controls_all_four_axes(name: str) -> None:
    layout = library_layout(name)
    assert layout.uncontrollable == ()
    assert np.linalg.matrix_rank(layout.effectiveness(KAPPA)) == 4
    assert layout.arm == pytest.approx(1.0)
    assert not layout.arm_known


@pytest.mark.parametrize("name", sorted(set(layout_names()) - set(LOPSIDED)))
def test_left_is_the_mirror_of_right(name: str) -> None:
    """A mirrored vehicle has the rotors at mirrored places; those on the axis of symmetry stay where they are."""
    layout = library_layout(name)
    places = sorted(map(tuple, layout.positions.round(9) + 0.0))
    mirrored = sorted(map(tuple, (layout.positions * [1.0, -1.0, 1.0]).round(9) + 0.0))
    np.testing.assert_allclose(places, mirrored, atol=1e-9)
    assert layout.spins.sum() == 0.0


def test_signs_are_those_of_forward_right_down() -> None:
    """More thrust at the right rolls left, more in front pitches up, more on counterclockwise rotors yaws right."""
    layout = library_layout("quad.x")
    L, M, N = layout.effectiveness(KAPPA)[3:]
    front_right, rear_left, front_left, rear_right = range(4)
    assert L[front_right] < 0.0 < L[front_left]
    assert M[rear_right] < 0.0 < M[front_right]
    assert N[front_left] < 0.0 < N[rear_left]
    assert np.abs(N).max() == pytest.approx(KAPPA)


def test_the_library_holds_the_names_that_people_ask_for() -> None:
    assert {"quad.x", "quad.plus", "quad.h", "hexa.x", "hexa.plus", "octo.x", "octo.plus", "y6", "x8"} <= set(
        layout_names()
    )
    with pytest.raises(ModelError, match="did you mean quad"):
        library_layout("quadx")


def test_no_frame_of_ardupilot_is_listed_twice() -> None:
    """A second layout of the same frame would never be found."""
    found = {named_by("ardupilot", [kind, shape]) for kind in range(1, 15) for shape in range(20)}
    assert found - {None} == set(layout_names()) - {"quad.x.crazyflie"}


@pytest.mark.parametrize("name", layout_names())
def test_ardupilot_normalizes_to_one_half(name: str) -> None:
    mixer = ardupilot_mixer(library_layout(name))
    np.testing.assert_allclose(np.abs(mixer[:, :3]).max(axis=0), 0.5, rtol=1e-12)
    np.testing.assert_array_equal(mixer[:, 3], 1.0)


def test_ardupilot_y6_has_the_factors_of_its_table() -> None:
    """Its table gives roll 1 and pitch 0.5 in front, pitch 1 in the rear; an equilateral Y has those after scaling."""
    np.testing.assert_allclose(
        ardupilot_mixer(library_layout("y6.b"))[::2],
        [[-0.5, 0.25, -0.5, 1], [0, -0.5, -0.5, 1], [0.5, 0.25, -0.5, 1]],
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ["quad.x", "quad.plus", "hexa.x", "octo.x", "x8", "y6"])
def test_px4_mixer_inverts_the_effectiveness(name: str) -> None:
    """Commands one by one give one wrench each and nothing else, whatever the arm and the torque of the rotors."""
    layout = library_layout(name)
    wrench = layout.scaled(0.31).effectiveness(0.02)[[3, 4, 5, 2]] @ px4_mixer(layout)
    np.testing.assert_allclose(wrench - np.diag(np.diag(wrench)), 0.0, atol=1e-12)
    assert np.all(np.diag(wrench)[:3] > 0.0)
    assert np.diag(wrench)[3] == pytest.approx(-layout.rotors)


def test_mixers_belong_to_autopilots() -> None:
    layout = library_layout("quad.x")
    assert mixer_of(layout, "Betaflight blackbox") is None
    np.testing.assert_array_equal(mixer_of(layout, "ArduPilot DataFlash"), ardupilot_mixer(layout))
    np.testing.assert_array_equal(mixer_of(layout, "PX4 ULog"), px4_mixer(layout))


@pytest.mark.parametrize(
    ("positions", "spins", "lost"),
    [
        ([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], [1, 1, 1, 1], {"yaw"}),
        ([[1, 0, 0], [0.5, 0, 0], [-0.5, 0, 0], [-1, 0, 0]], [1, -1, -1, 1], {"roll"}),
        # Yaw and roll need the same difference: neither can be had without the other.
        ([[1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0]], [-1, -1, 1, 1], {"roll", "yaw"}),
    ],
)
def test_what_cannot_be_controlled_is_named(positions: list[list[int]], spins: list[int], lost: set[str]) -> None:
    layout = RotorLayout(name="odd", positions=np.array(positions), spins=np.array(spins))
    assert lost <= set(layout.uncontrollable)


def test_scaling_keeps_the_pattern() -> None:
    layout = library_layout("octo.h").scaled(0.4)
    assert layout.arm == pytest.approx(0.4)
    assert layout.arm_known
    np.testing.assert_allclose(layout.moment_arms, 0.4 * library_layout("octo.h").moment_arms, atol=1e-15)
    with pytest.raises(ModelError, match="arm of -1 m"):
        layout.scaled(-1.0)


def test_a_tilted_rotor_pushes_along_its_axis() -> None:
    axis = np.array([0.0, np.sin(0.3), -np.cos(0.3)])
    layout = RotorLayout(name="tilted", positions=[[0.2, 0.3, -0.1]], spins=[-1.0], axes=[2.0 * axis])
    column = layout.effectiveness(KAPPA)[:, 0]
    np.testing.assert_allclose(column[:3], axis, atol=1e-15)
    np.testing.assert_allclose(column[3:], np.cross([0.2, 0.3, -0.1], axis) + KAPPA * axis, atol=1e-15)


def test_layouts_are_values() -> None:
    layout = library_layout("quad.v")
    again = pickle.loads(pickle.dumps(layout))
    np.testing.assert_array_equal(again.positions, layout.positions)
    assert not again.positions.flags.writeable
    assert not again.thrust_axes.flags.writeable


@pytest.mark.parametrize("wrong", [{"spins": [1.0, 0.5]}, {"spins": [1.0]}, {"axes": np.zeros((2, 3))}])
def test_wrong_layouts_are_refused(wrong: dict[str, object]) -> None:
    right = {"name": "pair", "positions": np.eye(3)[:2], "spins": [1.0, -1.0]}
    with pytest.raises(ModelError, match="the layout pair"):
        RotorLayout(**(right | wrong))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = ", "no TOML"),
        ("rotors = 4", "rotors"),
        ("[[rotor]]\nposition_m = [1, 2]\nspin = 'cw'", "position_m is"),
        ("[[rotor]]\nposition_m = [1, 2, 3]\nspin = 'left'", "the spin 'left'"),
        ("[[rotor]]\nposition_m = [1, 2, 3]\nspin = 'cw'\npower = 3", "power"),
        ("[[rotor]]\nposition_m = [1, 2, nan]\nspin = 'cw'", "not a number"),
    ],
)
def test_wrong_descriptions_say_what_is_needed(text: str, said: str) -> None:
    with pytest.raises(ModelError, match=said):
        layout_from_toml(text, where="frame.toml")


def record(form: str, motors: int, **parameters: float) -> FlightRecord:
    channels = tuple(Channel(name=f"motor_{number + 1}", unit="1") for number in range(motors))
    topic = Topic(name="motors", time_s=np.arange(3.0), channels=channels, values=np.zeros((motors, 3)))
    source = Source(name="flight", format=form, sha256="")
    return FlightRecord(source=source, topics=(topic,) if motors else (), parameters=parameters)


@pytest.mark.parametrize(
    ("flight", "name"),
    [
        (record("ArduPilot DataFlash", 4, FRAME_CLASS=1, FRAME_TYPE=3), "quad.h"),
        (record("ArduPilot DataFlash", 6, FRAME_CLASS=5, FRAME_TYPE=1), "y6"),
        (record("ArduPilot DataFlash", 4, FRAME=0), "quad.plus"),
        (record("ArduPilot DataFlash", 6, FRAME=10), "y6.b"),
        (record("PX4 ULog", 0, SYS_AUTOSTART=4050), "quad.x"),
        (record("PX4 ULog", 0, SYS_AUTOSTART=12001), "x8"),
        (record("Betaflight blackbox", 4), "quad.x.betaflight"),
        (record("Betaflight blackbox", 4, yaw_motors_reversed=1), "quad.x.betaflight.reversed"),
        (record("Crazyflie uSD", 4), "quad.x.crazyflie"),
    ],
)
def test_a_log_tells_its_layout(flight: FlightRecord, name: str) -> None:
    assert layout_of(flight).name == name


@pytest.mark.parametrize(
    ("flight", "said"),
    [
        (record("ArduPilot DataFlash", 4, FRAME_CLASS=1, FRAME_TYPE=4), "FRAME_TYPE = 4 is no frame"),
        (record("ArduPilot DataFlash", 8, FRAME=1), "FRAME = 1 with 8 motors"),
        (record("ArduPilot DataFlash", 6, FRAME_CLASS=1, FRAME_TYPE=1), "the log has 6 motors"),
        (record("PX4 ULog", 4, SYS_AUTOSTART=10016), "SYS_AUTOSTART = 10016"),
        (record("PX4 ULog", 4, CA_ROTOR_COUNT=4), "in the center"),
        (record("PX4 ULog", 4, CA_ROTOR_COUNT=1e9), "no CA_ROTOR_COUNT of up to 16"),
        (record("PX4 ULog", 1, CA_ROTOR_COUNT=1, CA_ROTOR0_PX=np.nan), "in the center"),
        (record("ArduPilot DataFlash", 4, FRAME_CLASS=np.nan, FRAME_TYPE=np.inf), "FRAME = -1 with 4 motors"),
        (record("Betaflight blackbox", 6), "mixer of 6 motors"),
        (record("CSV", 4), "does not describe"),
    ],
)
def test_a_log_that_does_not_tell_says_what_to_give(flight: FlightRecord, said: str) -> None:
    with pytest.raises(InsufficientDataError, match=r"\[\[rotor\]\]") as caught:
        layout_of(flight)
    assert said in str(caught.value)


def test_rotors_of_px4_parameters() -> None:
    """A positive CA_ROTORn_KM is a counterclockwise rotor; positions are ratios."""
    parameters = {"CA_ROTOR_COUNT": 2.0, "CA_ROTOR0_PX": 0.3, "CA_ROTOR0_PY": 0.4, "CA_ROTOR1_PX": -0.15}
    parameters |= {"CA_ROTOR1_KM": -0.05, "CA_ROTOR1_AX": 1.0, "CA_ROTOR1_AZ": 0.0}
    layout = layout_of(record("PX4 ULog", 2, **parameters))
    np.testing.assert_allclose(layout.positions, [[0.6, 0.8, 0.0], [-0.3, 0.0, 0.0]], atol=1e-15)
    assert layout.spins.tolist() == [1.0, -1.0]
    np.testing.assert_array_equal(layout.thrust_axes.T, [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    assert layout.findings[0].numbers["stated_arm_m"] == pytest.approx(0.5)
