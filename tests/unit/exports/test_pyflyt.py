"""PyFlyt's folder: each field, its equations in flight, and PyFlyt itself where that is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.unit.exports.flown import flown
from tests.unit.exports.motion import STEP_S, doublet, inequality, named, own
from tests.unit.exports.vehicles import SIH, asymmetric, second, sih

from rotorid.errors import ModelError, UsageError
from rotorid.exports import Exported, ExportSettings, draw_files
from rotorid.exports.pyflyt import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.simulation.multirotor import Multirotor
from rotorid.typing import FloatArray

AIRLESS = dict.fromkeys(("X_u", "Y_v", "Z_w", "M_u", "L_v", "L_p", "M_q", "N_r"), 0.0)
DIAGONAL = dict.fromkeys(("I_xy", "I_xz", "I_yz"), 0.0)
FLIP = np.array([1.0, -1.0, -1.0])
HZ = 240

VEHICLES = [
    second(**AIRLESS, T_motor=0.04),
    joined_vehicle([], given=SIH | AIRLESS, layout=library_layout("quad.x")),
    asymmetric(**AIRLESS, **DIAGONAL, delay=0.0),
]


def files_of(exported: Exported) -> tuple[dict[str, Any], list[np.ndarray], ElementTree.Element]:
    """The YAML, the places of the links after the first, and the URDF."""
    yaml: Any = pytest.importorskip("yaml", reason="PyYAML is not installed")
    parameters = yaml.safe_load(exported.files["vehicle/vehicle.yaml"])
    robot = ElementTree.fromstring(exported.files["vehicle/vehicle.urdf"])
    places = [link.find("inertial/origin") for link in robot.findall("link")[1:]]
    return (
        parameters,
        [np.array((place.get("xyz") or "").split(), float) for place in places if place is not None],
        robot,
    )


def simulated(exported: Exported, outputs: FloatArray) -> dict[str, FloatArray]:
    """``quadx.py``, ``motors.py`` and ``boring_bodies.py`` in steps of theirs, near level."""
    parameters, places, robot = files_of(exported)
    motor, drag, rotors = (parameters[key] for key in ("motor_params", "drag_params", "outputs"))
    base = robot.find("link/inertial/inertia")
    mass = robot.find("link/inertial/mass")
    assert base is not None
    assert mass is not None
    inertia = np.array([float(base.get(key) or "") for key in ("ixx", "iyy", "izz")])
    full_rpm = np.sqrt(motor["total_thrust"] / (4 * motor["thrust_coef"]))
    torque = motor["torque_coef"] * np.array([-1.0, -1.0, 1.0, 1.0])

    def accelerations(y: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        v, w = FLIP * v, FLIP * w
        thrust = np.stack([np.zeros(4), np.zeros(4), motor["thrust_coef"] * (full_rpm * y) ** 2], axis=1)
        moment = np.cross(places[:4], thrust).sum(axis=0)
        moment[2] += (torque * (full_rpm * y) ** 2).sum()
        area = drag["drag_coef_xyz"] * drag["drag_area_xyz"]
        force = thrust.sum(axis=0) - np.sign(v) * 0.5 * 1.225 * area * v**2
        moment = moment - np.sign(w) * drag["drag_coef_pqr"] * w**2 - np.cross(w, inertia * w)
        return np.concatenate([FLIP * force / float(mass.get("value") or ""), FLIP * moment / inertia])

    throttles = (outputs[:, rotors["order"]] + rotors["shift"]) / (1 + rotors["shift"])
    return flown(accelerations, throttles, lambda y, u: y + (u - y) / HZ / motor["tau"], 1 / HZ)


def both(body: Multirotor, axis: int) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Outputs in steps of PyFlyt, and what we make of them at the ends of these."""
    fine = doublet(body, axis)
    count = int(len(fine) * STEP_S * HZ)
    coarse = fine[(np.arange(count) / HZ / STEP_S).astype(int)]
    held = coarse[np.minimum((np.arange(len(fine)) * STEP_S * HZ).astype(int), count - 1)]
    times = STEP_S * np.arange(1, len(fine) + 1)
    ours = own(body, held)
    return coarse, {name: np.interp(np.arange(1, count + 1) / HZ, times, values) for name, values in ours.items()}


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_its_equations_fly_as_ours_do(vehicle: JoinedVehicle) -> None:
    body = vehicle.multirotor
    assert body is not None
    exported = export(vehicle, ExportSettings())
    for axis in range(3):
        outputs, ours = both(body, axis)
        found = inequality(ours, simulated(exported, outputs), curved=True)
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_pyflyt_flies_as_ours_does(vehicle: JoinedVehicle, tmp_path: Path, monkeypatch: Any) -> None:
    pytest.importorskip("PyFlyt", reason="PyFlyt is not installed")
    body = vehicle.multirotor
    assert body is not None
    exported = export(vehicle, ExportSettings())
    exported.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    for axis in range(3):
        outputs, ours = both(body, axis)
        found = inequality(ours, flown_in_pyflyt(exported.start, outputs), curved=True)
        assert max(found.values()) < 0.02, found


def flown_in_pyflyt(start: str, outputs: FloatArray) -> dict[str, FloatArray]:
    """By the lines that start it, in its own steps of physics, from spinning rotors."""
    scope: dict[str, Any] = {}
    exec(start.replace("model_dir=", "control_hz=240, model_dir=").rpartition("world.set_setpoint")[0], scope)
    world = scope["world"]
    world.drones[0].motors.throttle[:] = scope["throttles"](outputs[0])
    kept = np.empty((len(outputs), 6))
    for k, row in enumerate(outputs):
        world.set_setpoint(0, scope["throttles"](row))
        world.drones[0].pwm = scope["throttles"](row)
        world.step()
        velocity, _ = world.getBaseVelocity(world.drones[0].Id)
        kept[k] = [*(FLIP * world.state(0)[0]), *(FLIP * velocity)]
    world.disconnect()
    return named(kept[:, :3], kept[:, 3:])


def test_each_field_is_the_number_of_the_vehicle() -> None:
    parameters, places, robot = files_of(export(sih(), ExportSettings()))
    motor, drag, rotors = (parameters[key] for key in ("motor_params", "drag_params", "outputs"))
    layout = library_layout("quad.x").scaled(SIH["arm"])
    for place, index in zip(places, rotors["order"], strict=False):
        np.testing.assert_allclose(place, layout.positions[index] * FLIP, atol=1e-9)
    np.testing.assert_allclose(np.sign(places[:4])[:, :2], [[1, -1], [-1, 1], [1, 1], [-1, -1]])
    assert len(places) == 5
    assert not places[4].any()
    assert layout.spins[rotors["order"]].tolist() in ([1, 1, -1, -1], [-1, -1, 1, 1])
    assert motor["torque_coef"] / motor["thrust_coef"] == pytest.approx(0.02)
    assert motor["noise_ratio"] == 0.0
    # The pole of their steps is that of the lag.
    assert 1 - 1 / HZ / motor["tau"] == pytest.approx(np.exp(-1 / HZ / 0.048))
    hover = (9.80665 / 20 + rotors["shift"]) / (1 + rotors["shift"])
    assert motor["total_thrust"] * hover**2 == pytest.approx(9.80665)
    # At 5 m/s it decelerates by 5 m/s^2.
    assert 0.5 * 1.225 * drag["drag_coef_xyz"] * drag["drag_area_xyz"] * 25 == pytest.approx(5.0)
    assert set(parameters["control_params"]) == {"ang_vel", "ang_pos", "lin_vel", "lin_pos", "z_pos", "z_vel"}
    assert all(isinstance(value, float) for block in (motor, drag) for value in block.values())
    inertia = robot.find("link/inertial/inertia")
    assert inertia is not None
    assert [inertia.get(key) for key in ("ixx", "iyy", "izz")] == ["0.025", "0.025", "0.03"]


def test_what_is_lost_is_said() -> None:
    exported = export(asymmetric(), ExportSettings())
    rows = {row.name: row for row in exported.compared}
    lost = {name for name, row in rows.items() if row.held == "not"}
    assert lost == {*AIRLESS, "delay"}
    assert rows["drag at 5 m/s (X_u)"].exported == pytest.approx(1.75)
    for words in (
        "right at 5 m/s",
        "no damping of rates",
        "of PyFlyt's cf2x",
        "Products of inertia are left out",
        "6 ms are lost",
    ):
        assert any(words in sentence for sentence in exported.left_out)


def test_what_is_missing_is_asked_for() -> None:
    known = {name: value for name, value in SIH.items() if name != "T_motor"}
    with pytest.raises(UsageError, match="--set T_motor="):
        export(joined_vehicle([], given=known, layout=library_layout("quad.x")), ExportSettings())
    with pytest.raises(ModelError, match="stand or turn otherwise"):
        export(joined_vehicle([], given=SIH, layout=library_layout("quad.plus")), ExportSettings())


def test_drawn_vehicles_are_folders_of_one() -> None:
    vehicles = [export(second(T_motor=0.04, m=mass), ExportSettings()) for mass in (2.0, 2.1)]
    made = draw_files(vehicles, "pyflyt", ExportSettings())
    assert sorted(made.files) == [f"draws/vehicle_{n}/vehicle_{n}.{end}" for n in (1, 2) for end in ("urdf", "yaml")]
    robot = ElementTree.fromstring(made.files["draws/vehicle_2/vehicle_2.urdf"])
    mass = robot.find("link/inertial/mass")
    assert mass is not None
    assert (robot.get("name"), mass.get("value")) == ("vehicle_2", "2.1")
    assert "draws" in made.start
