"""Aerodynamics that a flight showed, in every target: drag and lift at speed beside the identified ones."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.exports.motion import STEP_S, imported, named, own
from tests.unit.exports.vehicles import sih
from tests.unit.flying.flights import LIMITS, OF_OUTPUTS, flight

from rotorid.exports import Exported, ExportSettings
from rotorid.exports.mujoco import FLU
from rotorid.exports.rotor_air import air_numbers, rotor_air
from rotorid.exports.round_trip import AIR, accelerations_of, fastest_m_s
from rotorid.exports.target import Compared
from rotorid.exports.targets import target_named
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.simulation.multirotor import Multirotor
from rotorid.verification.scores import theil_inequality

FULL = {
    **OF_OUTPUTS,
    "k_w": 0.004,
    "c_h": 0.03,
    "c_hw": 0.002,
    "c_ha": -0.003,
    "c_wake": 0.02,
    "d_z": 0.02,
    "m_fx": 0.0002,
    "m_s": 0.002,
    "kappa_lambda": 4e-4,
    "k_r": 0.002,
}
TARGETS = ("px4-sih", "ardupilot", "gazebo", "mujoco", "rotorpy", "urdf", "fmu", "crazyflow", "aerial-gym")
DRAG, LIFT = (f"{name} at {LIMITS.edge_m_s[1]:g} m/s" for name in ("drag", "lift gained"))


def flew(values: dict[str, float] | None = None) -> JoinedVehicle:
    return joined_vehicle([flight(values or OF_OUTPUTS)])


def body_of(vehicle: JoinedVehicle) -> Multirotor:
    assert vehicle.multirotor is not None
    return vehicle.multirotor


def made(target: str, vehicle: JoinedVehicle) -> Exported:
    from importlib import import_module

    export = import_module(f"rotorid.exports.{target_named(target).module}").export
    found: Exported = export(vehicle, ExportSettings())
    return found


def rows(exported: Exported) -> dict[str, Compared]:
    return {row.name: row for row in exported.compared}


@pytest.mark.parametrize("target", TARGETS)
def test_drag_at_speed_is_the_identified_one(target: str) -> None:
    found = rows(made(target, flew()))
    assert abs(found["X_u"].difference_percent) < 0.1
    assert abs(found[DRAG].difference_percent) < 0.2
    assert found[DRAG].identified == pytest.approx(10.0 * -found["X_u"].identified)
    x_u = flew().numbers["X_u"]
    assert found[DRAG].identified_std == pytest.approx((x_u.std or 0.0) / -x_u.value * found[DRAG].identified)
    assert found[LIFT].identified > 0.5
    assert found[LIFT].held == {"mujoco": "exact", "rotorpy": "approximated"}.get(target, "not")


@pytest.mark.parametrize(
    ("target", "kept"),
    [
        ("gazebo", {"m_s"}),
        ("rotorpy", {"c_lambda", "c_h", "m_f", "d_z"}),
        *(
            (name, set())
            for name in ("px4-sih", "ardupilot", "urdf", "fmu", "rl-tools", "crazyflow", "pyflyt", "flightmare")
        ),
        ("aerial-gym", {"d_z"}),
    ],
)
def test_what_a_target_lacks_is_named(target: str, kept: set[str]) -> None:
    (sentence,) = (words for words in made(target, flew(FULL)).left_out if words.startswith("Away from hover"))
    assert {name for name in AIR if re.search(rf"\b{name}\b", sentence)} == set(AIR) - kept
    assert not [words for words in made("mujoco", flew(FULL)).left_out if words.startswith("Away from hover")]
    assert not [words for words in made(target, sih()).left_out if words.startswith("Away from hover")]


@pytest.mark.parametrize("target", ["json", "matlab", "control", "fmu"])
def test_a_state_space_is_one_of_hover(target: str) -> None:
    assert [words for words in made(target, flew()).left_out if "linear about hover" in words]


def test_a_square_of_speed_meets_the_drag_of_the_fastest_that_flew() -> None:
    found = rows(made("pyflyt", flew()))
    assert abs(found[DRAG].difference_percent) < 0.2
    assert (found[DRAG].held, found["X_u"].held, found[LIFT].held) == ("approximated", "not", "not")


def test_lift_at_speed() -> None:
    assert abs(rows(made("mujoco", flew(FULL)))[LIFT].difference_percent) < 1e-6
    lift = rows(made("rotorpy", flew()))[LIFT]
    # A square over all speeds, where the true gain bends.
    assert 0.7 < lift.exported / lift.identified < 1.4


@pytest.mark.parametrize("target", TARGETS)
def test_nothing_is_invented(target: str) -> None:
    found = rows(made(target, sih()))
    assert not [name for name in found if " m/s" in name]
    assert fastest_m_s(sih()) is None


def test_rotors_in_a_loop_do_what_those_of_the_vehicle_do() -> None:
    vehicle = flew(FULL)
    body, rng = body_of(vehicle), np.random.default_rng(3)
    for _ in range(20):
        x, velocity = rng.uniform(0.3, 0.8, 4), 4.0 * rng.standard_normal(3)
        added = rotor_air(air_numbers(body), x, FLU @ velocity, np.zeros(3))
        difference = accelerations_of(body, x, velocity) - accelerations_of(body, x, np.zeros(3))
        np.testing.assert_allclose(FLU @ added[:3] / body.mass_kg, difference[:3], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(np.linalg.solve(body.inertia_kg_m2, FLU @ added[3:]), difference[3:], atol=1e-8)


def test_mujoco_flies_as_rotorid_does_with_all_of_it(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    # Nearly a line, as the tangent of MuJoCo's motors.
    vehicle = flew({**FULL, "c_0": 0.1, "c_1": 12.0, "c_2": 1.0, "c_lambda": 0.3})
    body = body_of(vehicle)
    outputs = np.tile(body.hover_shares, (800, 1))
    outputs[:60] += 0.01 * np.sign(body.hubs_m[:, 0])
    loop: Any = imported(made("mujoco", vehicle), tmp_path, "vehicle_fly.py")
    model, data = loop.load()
    found = np.empty((len(outputs), 6))
    for k, row in enumerate(outputs):
        loop.step(model, data, row)
        found[k] = [*data.qvel[3:6], *data.qvel[:3]]
    theirs, mine = named(found[:, :3] @ FLU, found[:, 3:] @ FLU), own(body, outputs)
    assert model.opt.timestep == STEP_S
    assert np.abs(mine["north"]).max() > 0.5
    for name in ("q", "north", "down"):
        assert theil_inequality(mine[name], theirs[name]) < 0.02, name


def test_mujoco_brakes_at_speed_as_it_was_identified(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    vehicle, speed = flew(), 8.0
    body = body_of(vehicle)
    loop: Any = imported(made("mujoco", vehicle), tmp_path, "vehicle_fly.py")
    model, data = loop.load()
    data.qvel[0] = speed
    for _ in range(20):
        loop.step(model, data, body.hover_shares)
    seconds = 20 * STEP_S
    drag_m_s2, lift_m_s2 = (speed - data.qvel[0]) / seconds, data.qvel[2] / seconds
    identified = accelerations_of(body, body.hover_shares, np.array([speed, 0.0, 0.0]))
    still = accelerations_of(body, body.hover_shares, np.zeros(3))
    # It pitches up a little on the way.
    assert drag_m_s2 == pytest.approx(still[0] - identified[0], rel=0.03)
    assert drag_m_s2 == pytest.approx(-speed * vehicle.numbers["X_u"].value, rel=0.03)
    assert lift_m_s2 == pytest.approx(still[2] - identified[2], rel=0.03)
    assert lift_m_s2 > 0.4


def test_files_hold_the_numbers_of_the_rotors() -> None:
    vehicle = flew(FULL)
    body = body_of(vehicle)
    (text,) = (str(text) for text in made("rotorpy", vehicle).files.values())
    held = {name: float(value) for name, value in re.findall(r'"(\w+)": ([-0-9.e]+),', text)}
    speed = 1000.0
    assert held["k_d"] == pytest.approx(OF_OUTPUTS["k_d"] / speed, rel=1e-3)
    assert held["c_Dz"] == pytest.approx(FULL["d_z"])
    assert held["k_h"] > 0.0
    sdf = str(made("gazebo", vehicle).files["vehicle/model.sdf"])
    drags = {float(value) for value in re.findall(r"<rotorDragCoefficient>([^<]+)<", sdf)}
    rolling = [float(value) for value in re.findall(r"<rollingMomentCoefficient>([^<]+)<", sdf)]
    assert len(drags) == 1
    per_rad_s = float(body.hover_shares[0]) * OF_OUTPUTS["k_d"]
    hover_rad_s = per_rad_s / drags.pop()
    spins = body.rotors.layout.spins
    np.testing.assert_allclose(rolling, -spins * FULL["m_s"] * float(body.hover_shares[0]) / hover_rad_s, rtol=1e-6)
    assert "<rollingMomentCoefficient>0<" in str(made("gazebo", flew()).files["vehicle/model.sdf"])
