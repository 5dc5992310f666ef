"""Flightmare's block of YAML: each field, and its equations in flight, rewritten from its source."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.unit.exports.flown import flown
from tests.unit.exports.motion import STEP_S, doublet, inequality, own
from tests.unit.exports.vehicles import SIH, asymmetric, second

from rotorid.errors import ModelError
from rotorid.exports import Exported, ExportSettings, draw_files
from rotorid.exports.flightmare import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray

AIRLESS = dict.fromkeys(("X_u", "Y_v", "Z_w", "M_u", "L_v", "L_p", "M_q", "N_r"), 0.0)
FLIP = np.array([1.0, -1.0, -1.0])
ORDER = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
"""Signs of x and y, forward and left, of its rotors."""
COMPILED_N = 11.2225

VEHICLES = [
    second(**AIRLESS, T_motor=0.04, I_yy=0.019),
    joined_vehicle([], given=SIH | AIRLESS, layout=library_layout("quad.x")),
]


def block_of(exported: Exported) -> dict[str, Any]:
    yaml: Any = pytest.importorskip("yaml", reason="PyYAML is not installed")
    (text,) = exported.files.values()
    block: dict[str, Any] = yaml.safe_load(text)["quadrotor_dynamics"]
    return block


def flightmare(block: dict[str, Any], omega: FloatArray, w: FloatArray) -> FloatArray:
    """``quadrotor_dynamics.cpp`` and ``Quadrotor::run``, level and without gravity, in its own axes."""
    c2, c1, c0 = block["thrust_map"]
    thrust = np.clip(c2 * omega * omega + c1 * omega + c0, 0.0, COMPILED_N)
    arm = block["arm_l"] * np.sqrt(0.5)
    t_bm = arm * np.array([[1, -1, -1, 1], [-1, -1, 1, 1], [0, 0, 0, 0]])
    inertia = block["mass"] / 12.0 * block["arm_l"] ** 2 * np.array([4.5, 4.5, 7.0])
    torque = np.append(t_bm[:2] @ thrust, block["kappa"] * np.array([1, -1, 1, -1]) @ thrust)
    return np.concatenate([[0.0, 0.0, thrust.sum() / block["mass"]], (torque - np.cross(w, inertia * w)) / inertia])


def order_of(vehicle: JoinedVehicle) -> list[int]:
    assert vehicle.multirotor is not None
    signs = np.sign(vehicle.multirotor.hubs_m[:, :2] * [1.0, -1.0])
    return [int(np.flatnonzero((signs == row).all(axis=1))[0]) for row in ORDER]


def simulated(vehicle: JoinedVehicle, block: dict[str, Any], outputs: FloatArray) -> dict[str, FloatArray]:
    """Under thrusts of the outputs by the file's own curve, which it turns into speeds by the root."""
    c2, c1, c0 = block["thrust_map"]
    wanted = np.polyval(block["thrust_map"], block["motor_omega_max"] * outputs[:, order_of(vehicle)])
    speeds = (-c1 + np.sqrt(c1**2 - 4.0 * c2 * (c0 - wanted))) / (2.0 * c2)
    c = np.exp(-STEP_S / block["motor_tau"])

    def accelerations(omega: FloatArray, _v: FloatArray, w: FloatArray) -> FloatArray:
        return flightmare(block, omega, FLIP * w) * np.tile(FLIP, 2)

    return flown(accelerations, speeds, lambda x, u: c * x + (1.0 - c) * u, STEP_S)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_its_equations_fly_as_ours_do(vehicle: JoinedVehicle) -> None:
    body = vehicle.multirotor
    assert body is not None
    block = block_of(export(vehicle, ExportSettings()))
    for axis in range(3):
        outputs = doublet(body, axis)
        found = inequality(own(body, outputs), simulated(vehicle, block, outputs), curved=True)
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


def test_each_field_is_the_number_of_the_vehicle() -> None:
    vehicle = VEHICLES[0]
    block = block_of(export(vehicle, ExportSettings()))
    assert list(block) == [
        *("mass", "arm_l", "motor_omega_min", "motor_omega_max", "motor_tau", "thrust_map", "kappa", "omega_max")
    ]
    assert (block["mass"], block["motor_tau"], block["motor_omega_min"]) == (2.1, 0.04, 0.0)
    # The identified curve by speed, bent enough for its root.
    assert block["thrust_map"] == pytest.approx([9.0e-6, 6.0e-3, -0.25])
    assert all(isinstance(value, float) for value in (*block["thrust_map"], block["kappa"], *block["omega_max"]))
    lever = 0.28 / np.sqrt(2.0)
    assert 12.0 * np.sqrt(0.5) / (4.5 * 2.1 * block["arm_l"]) == pytest.approx(lever / 0.019)
    assert block["kappa"] / (7.0 / 12.0 * 2.1 * block["arm_l"] ** 2) == pytest.approx(0.017 / 0.036)


def test_a_line_becomes_the_square_that_meets_it_at_hover() -> None:
    block = block_of(export(VEHICLES[1], ExportSettings()))
    speed = block["motor_omega_max"] * 9.80665 / 20.0
    assert np.polyval(block["thrust_map"], speed) == pytest.approx(9.80665 / 4.0)
    assert np.polyval(np.polyder(block["thrust_map"]), speed) * block["motor_omega_max"] == pytest.approx(5.0)


def test_the_mean_of_unlike_axes_is_held_and_said_so() -> None:
    exported = export(second(T_motor=0.04), ExportSettings())
    rows = {row.name: row for row in exported.compared}
    roll, pitch = (rows[f"{axis} acceleration per output"] for axis in ("roll", "pitch"))
    assert roll.held == pitch.held == "approximated"
    assert roll.exported == pytest.approx(pitch.exported)
    assert roll.exported == pytest.approx(np.sqrt(roll.identified * pitch.identified))
    assert rows["yaw acceleration per output"].held == "exact"
    assert {row.name for row in exported.compared if row.held == "not"} == {"X_u"}
    assert any("Inertia follows from mass and arm" in sentence for sentence in exported.left_out)


def test_its_limit_of_thrust_is_said_and_one_below_hover_refused() -> None:
    strong = second(T_motor=0.04, c_2=12.0)
    assert any("limits a rotor to 11.2 N" in sentence for sentence in export(strong, ExportSettings()).left_out)
    with pytest.raises(ModelError, match=r"carries 12\.3 N in hover; expected less than 11\.2 N"):
        export(second(T_motor=0.04, m=5.0, c_2=40.0), ExportSettings())


def test_rotors_that_stand_otherwise_are_refused() -> None:
    with pytest.raises(ModelError, match="stand or turn otherwise"):
        export(joined_vehicle([], given=SIH, layout=library_layout("quad.plus")), ExportSettings())
    assert export(asymmetric(), ExportSettings()).files


def test_drawn_vehicles_are_blocks_of_one_file() -> None:
    yaml: Any = pytest.importorskip("yaml", reason="PyYAML is not installed")
    vehicles = [export(second(T_motor=0.04, m=mass), ExportSettings()) for mass in (2.0, 2.1)]
    made = draw_files(vehicles, "flightmare", ExportSettings())
    (text,) = made.files.values()
    found = yaml.safe_load(text)
    assert {name: block["mass"] for name, block in found.items()} == {"vehicle_1": 2.0, "vehicle_2": 2.1}
    assert all("omega_max" in block for block in found.values())
    assert "draws/vehicle_flightmare.yaml" in made.start


def test_the_lines_that_load_it_replace_the_block(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    yaml: Any = pytest.importorskip("yaml", reason="PyYAML is not installed")
    configs = tmp_path / "flightlib" / "configs"
    configs.mkdir(parents=True)
    own_file = configs / "quadrotor_env.yaml"
    own_file.write_text("quadrotor_env:\n  sim_dt: 0.02\nquadrotor_dynamics:\n  mass: 0.73\n")
    exported = export(second(T_motor=0.04), ExportSettings())
    exported.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FLIGHTMARE_PATH", str(tmp_path))
    exec(exported.start, {})
    read = yaml.safe_load(own_file.read_text())
    assert read["quadrotor_env"] == {"sim_dt": 0.02}
    assert read["quadrotor_dynamics"] == block_of(exported)
