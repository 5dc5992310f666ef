"""Aerial Gym's configuration: each field, and its equations in flight, rewritten from its source."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.unit.exports.flown import flown
from tests.unit.exports.motion import STEP_S, doublet, imported, inequality, own
from tests.unit.exports.vehicles import SIH, asymmetric, second, sih

from rotorid.errors import ModelError, UsageError
from rotorid.exports import Exported, ExportSettings, draw_files
from rotorid.exports.aerial_gym import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray

STILL = dict.fromkeys(("M_u", "L_v"), 0.0)
DIAGONAL = dict.fromkeys(("I_xy", "I_xz", "I_yz"), 0.0)
FLIP = np.array([1.0, -1.0, -1.0])
VEHICLES = [
    sih(),
    second(**STILL, T_motor=0.04, L_p=-2.0, N_r=-0.5),
    asymmetric(**STILL, **DIAGONAL, delay=0.0),
]


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The base class of its configurations, of which ours replaces what a vehicle is."""

    asset = type("robot_asset", (), {"linear_damping": 0.01, "angular_damping": 0.01, "density": 1e-6})
    parts = ["aerial_gym", "config", "robot_config", "base_quad_config"]
    for count in range(1, len(parts) + 1):
        monkeypatch.setitem(sys.modules, ".".join(parts[:count]), ModuleType(parts[count - 1]))
    vars(sys.modules[".".join(parts)])["BaseQuadCfg"] = type("BaseQuadCfg", (), {"robot_asset": asset})


def loaded(exported: Exported, folder: Path) -> tuple[Any, dict[str, Any]]:
    """The configuration and, by the URDF, mass, inertia and rotors of the whole."""
    (config,) = imported(exported, folder, "vehicle_aerial_gym.py").VEHICLES
    place = Path(config.robot_asset.asset_folder) / config.robot_asset.file
    return config, whole(ElementTree.fromstring(place.read_text()))


def whole(robot: ElementTree.Element) -> dict[str, Any]:
    def values(element: ElementTree.Element | None, key: str) -> FloatArray:
        assert element is not None
        return np.array((element.get(key) or "").split(), float)

    names = [str(link.get("name")) for link in robot.findall("link")]
    at = dict.fromkeys(names, np.zeros(3))
    for joint in robot.findall("joint"):
        child = joint.find("child")
        assert child is not None
        at[str(child.get("link"))] = values(joint.find("origin"), "xyz")
    mass, first, second_moment = 0.0, np.zeros(3), np.zeros((3, 3))
    for link in robot.findall("link"):
        m = float(values(link.find("inertial/mass"), "value")[0])
        r = at[str(link.get("name"))] + values(link.find("inertial/origin"), "xyz")
        own_inertia = link.find("inertial/inertia")
        xx, xy, xz, yy, yz, zz = (values(own_inertia, key)[0] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        mass, first = mass + m, first + m * r
        second_moment += np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        second_moment += m * (r @ r * np.eye(3) - np.outer(r, r))
    # Bodies are numbered in the order of their names below the base.
    hubs = [at[name] for name in sorted(names[1:])]
    return {"mass": mass, "center": first / mass, "inertia": second_moment, "hubs": np.array(hubs)}


def simulated(config: Any, body: dict[str, Any], outputs: FloatArray) -> dict[str, FloatArray]:
    """``motor_model.py`` with its own integration, ``calc_motor_forces_torques_from_thrusts``, ``simulate_drag``."""
    allocator, damping = config.control_allocator_config, config.damping
    motor = allocator.motor_model_config
    bodies = np.array(allocator.application_mask) - 1
    c_0, c_1, c_2 = config.thrust_by_output
    thrusts = np.clip(c_0 + c_1 * outputs + c_2 * outputs**2, motor.min_thrust, motor.max_thrust)
    k = motor.motor_thrust_constant_min

    def lag(thrust: FloatArray, wanted: FloatArray) -> FloatArray:
        falling = np.sign(thrust) * np.sign(wanted - thrust) < 0
        rate = 1.0 / np.where(
            falling, motor.motor_time_constant_decreasing_min, motor.motor_time_constant_increasing_min
        )
        now, then = (np.sqrt(f / k) if motor.use_rps else f for f in (thrust, wanted))
        # rk4_integration: the error grows with what was added, as in the source.
        slopes = [then - now]
        for share in (0.5, 0.5, 1.0):
            slopes.append(then - now - share * STEP_S * rate * slopes[-1])
        k_1, k_2, k_3, k_4 = (rate * slope for slope in slopes)
        reached = now + STEP_S / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)
        return k * reached**2 if motor.use_rps else reached

    def accelerations(f: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        v, w = FLIP * v, FLIP * w
        push = np.stack([0.0 * f, 0.0 * f, f], axis=1)
        moment = np.cross(body["hubs"][bodies], push).sum(axis=0)
        moment[2] += (motor.thrust_to_torque_ratio * f * -np.array(allocator.motor_directions)).sum()
        force = push.sum(axis=0) - np.array(damping.linvel_linear_damping_coefficient) * v
        force -= np.array(damping.linvel_quadratic_damping_coefficient) * np.linalg.norm(v) * v
        moment -= np.array(damping.angular_linear_damping_coefficient) * w
        moment -= np.array(damping.angular_quadratic_damping_coefficient) * np.abs(w) * w
        turned = np.linalg.solve(body["inertia"], moment - np.cross(w, body["inertia"] @ w))
        return np.concatenate([FLIP * force / body["mass"], FLIP * turned])

    return flown(accelerations, thrusts, lag, STEP_S)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_its_equations_fly_as_ours_do(vehicle: JoinedVehicle, tmp_path: Path) -> None:
    multirotor = vehicle.multirotor
    assert multirotor is not None
    config, body = loaded(export(vehicle, ExportSettings()), tmp_path)
    for axis in range(3):
        outputs = doublet(multirotor, axis)
        found = inequality(own(multirotor, outputs), simulated(config, body, outputs), curved=True)
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


def test_each_field_is_the_number_of_the_vehicle(tmp_path: Path) -> None:
    exported = export(sih(), ExportSettings())
    config, body = loaded(exported, tmp_path)
    layout = library_layout("quad.x").scaled(SIH["arm"])
    assert body["mass"] == pytest.approx(1.0, rel=1e-8)
    np.testing.assert_allclose(body["center"], 0.0, atol=1e-9)
    np.testing.assert_allclose(body["inertia"], np.diag([0.025, 0.025, 0.03]), atol=1e-9)
    np.testing.assert_allclose(body["hubs"], layout.positions * FLIP, atol=1e-8)
    allocator, motor = config.control_allocator_config, config.control_allocator_config.motor_model_config
    assert (allocator.num_motors, allocator.application_mask) == (4, [1, 2, 3, 4])
    assert allocator.motor_directions == layout.spins.tolist()
    matrix = np.array(allocator.allocation_matrix)
    np.testing.assert_allclose(matrix[:3], [[0.0] * 4, [0.0] * 4, [1.0] * 4])
    np.testing.assert_allclose(matrix[3], -layout.positions[:, 1], atol=1e-9)
    np.testing.assert_allclose(matrix[4], -layout.positions[:, 0], atol=1e-9)
    np.testing.assert_allclose(matrix[5], -0.02 * layout.spins)
    assert (motor.min_thrust, motor.max_thrust, motor.thrust_to_torque_ratio) == (0.0, 5.0, 0.02)
    assert (motor.use_rps, motor.use_discrete_approximation) == (False, False)
    assert config.thrust_by_output == [0.0, 5.0, 0.0]
    np.testing.assert_allclose(config.damping.linvel_linear_damping_coefficient, [1.0, 1.0, 1.0])
    np.testing.assert_allclose(config.damping.angular_linear_damping_coefficient, [0.025, 0.025, 0.025])
    assert (config.robot_asset.linear_damping, config.robot_asset.angular_damping) == (0.0, 0.0)
    assert config.robot_asset.density == 1e-6


def test_lags_of_both_directions_and_the_root_of_a_bent_curve(tmp_path: Path) -> None:
    config, _ = loaded(export(asymmetric(T_motor_up=0.02, T_motor_down=0.04), ExportSettings()), tmp_path)
    motor = config.control_allocator_config.motor_model_config
    assert motor.use_rps
    assert motor.motor_time_constant_increasing_min == motor.motor_time_constant_increasing_max == 0.02
    assert motor.motor_time_constant_decreasing_min == motor.motor_time_constant_decreasing_max == 0.04


def test_a_hexacopter_has_six_motors_and_products_of_inertia_are_kept(tmp_path: Path) -> None:
    known = SIH | {"I_xy": 0.002, "I_xz": -0.001}
    vehicle = joined_vehicle([], given=known, layout=library_layout("hexa.x"))
    config, body = loaded(export(vehicle, ExportSettings()), tmp_path)
    assert config.control_allocator_config.application_mask == [1, 2, 3, 4, 5, 6]
    assert np.array(config.control_allocator_config.allocation_matrix).shape == (6, 6)
    # Signs of forward, left, up.
    assert body["inertia"][0, 1] == pytest.approx(-0.002)
    assert body["inertia"][0, 2] == pytest.approx(0.001)
    with pytest.raises(UsageError, match="--set T_motor="):
        export(
            joined_vehicle([], given={k: v for k, v in SIH.items() if k != "T_motor"}, layout=None), ExportSettings()
        )
    with pytest.raises(ModelError, match="no rigid body has such"):
        export(joined_vehicle([], given=SIH | {"I_zz": 0.06}, layout=library_layout("quad.x")), ExportSettings())


def test_drawn_vehicles_are_classes_of_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vehicles = [export(second(T_motor=0.04, m=mass), ExportSettings()) for mass in (2.0, 2.1)]
    made = draw_files(vehicles, "aerial-gym", ExportSettings())
    assert sorted(made.files) == ["draws/vehicle_1.urdf", "draws/vehicle_2.urdf", "draws/vehicle_aerial_gym.py"]
    exported = Exported(target="aerial-gym", files=made.files, compared=())
    found = imported(exported, tmp_path, "draws/vehicle_aerial_gym.py").VEHICLES
    masses = []
    for config in found:
        place = Path(config.robot_asset.asset_folder) / config.robot_asset.file
        masses.append(whole(ElementTree.fromstring(place.read_text()))["mass"])
    assert masses == pytest.approx([2.0, 2.1])
    assert [config.robot_asset.name for config in found] == ["vehicle_1", "vehicle_2"]
    registered: list[tuple[str, object, object]] = []

    class Registry:
        def register(self, name: str, robot: object, config: object) -> None:
            registered.append((name, robot, config))

    stubs: dict[str, dict[str, object]] = {
        "isaacgym": {},
        "aerial_gym.registry": {},
        "aerial_gym.registry.robot_registry": {"robot_registry": Registry()},
        "aerial_gym.robots": {},
        "aerial_gym.robots.base_multirotor": {"BaseMultirotor": object},
    }
    for name, members in stubs.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "vehicle_aerial_gym", raising=False)
    exec(made.start, {})
    ((name, _, chosen),) = registered
    assert name == "vehicle"
    assert re.fullmatch(r"vehicle_[12]", chosen.__name__)  # type: ignore[attr-defined]
    sys.modules.pop("vehicle_aerial_gym", None)
