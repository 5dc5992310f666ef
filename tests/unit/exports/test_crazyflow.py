"""crazyflow's section of TOML: each field, its equations in flight, and drone-models itself where that is installed."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.exports.flown import flown
from tests.unit.exports.motion import STEP_S, doublet, inequality, own
from tests.unit.exports.vehicles import SIH, asymmetric, second, sih

from rotorid.errors import ModelError, UsageError
from rotorid.exports import Exported, ExportSettings, draw_files
from rotorid.exports.crazyflow import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray

STILL = dict.fromkeys(("M_u", "L_v", "L_p", "M_q", "N_r"), 0.0)
FLIP = np.array([1.0, -1.0, -1.0])


def section_of(exported: Exported) -> dict[str, Any]:
    (text,) = exported.files.values()
    assert isinstance(text, str)
    section: dict[str, Any] = tomllib.loads(text)["vehicle"]
    return section


def model_accelerations(section: dict[str, Any], n: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
    """``first_principles/model.py`` of drone-models, level and without gravity, in its own axes."""
    forces, torques = (a[0] + a[1] * n + a[2] * n**2 for a in (section["rpm2thrust"], section["rpm2torque"]))
    mixing = np.array(section["mixing_matrix"])
    moment = (mixing @ forces) * [section["L"], section["L"], 0.0] + (mixing @ torques) * [0.0, 0.0, 1.0]
    moment = moment - np.cross(w, np.array(section["J"]) @ w)
    force = np.array([0.0, 0.0, forces.sum()]) + np.array(section["drag_matrix"]) @ v
    return np.concatenate([force / section["mass"], np.linalg.inv(section["J"]) @ moment])


def simulated(section: dict[str, Any], outputs: FloatArray) -> dict[str, FloatArray]:
    up, _, down, _ = section["rotor_dyn_coef"]

    def lag(x: FloatArray, wanted: FloatArray) -> FloatArray:
        return wanted + (x - wanted) * np.exp(-STEP_S * np.where(wanted > x, up, down))

    def accelerations(x: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        return model_accelerations(section, section["rpm_max"] * x, FLIP * v, FLIP * w) * np.tile(FLIP, 2)

    return flown(accelerations, outputs, lag, STEP_S)


VEHICLES = [asymmetric(**STILL, delay=0.0), second(**STILL, T_motor=0.04, Y_v=-0.3, Z_w=-0.5)]


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_its_equations_fly_as_ours_do(vehicle: JoinedVehicle) -> None:
    body = vehicle.multirotor
    assert body is not None
    section = section_of(export(vehicle, ExportSettings()))
    for axis in range(3):
        outputs = doublet(body, axis)
        found = inequality(own(body, outputs), simulated(section, outputs))
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_drone_models_flies_as_ours_does(vehicle: JoinedVehicle, tmp_path: Path, monkeypatch: Any) -> None:
    if os.environ.get("SCIPY_ARRAY_API") != "1":
        pytest.skip("drone-models needs SCIPY_ARRAY_API=1 before SciPy is imported")
    pytest.importorskip("drone_models", reason="drone-models is not installed")
    from scipy.spatial.transform import Rotation

    body = vehicle.multirotor
    assert body is not None
    exported = export(vehicle, ExportSettings())
    exported.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    scope: dict[str, Any] = {}
    exec(exported.start, scope)
    for axis in range(3):
        outputs = doublet(body, axis)
        pos, quat, vel, rate = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3)
        rpm, kept = scope["drone"]["rpm_max"] * outputs[0], np.empty((len(outputs), 6))
        for k, row in enumerate(outputs):
            _, _, dv, dw, dn = scope["fly"](pos, quat, vel, rate, scope["drone"]["rpm_max"] * row, rpm)
            vel, rate, rpm = vel + STEP_S * dv, rate + STEP_S * dw, rpm + STEP_S * dn
            quat = (Rotation.from_quat(quat) * Rotation.from_rotvec(STEP_S * rate)).as_quat()
            kept[k] = [*(FLIP * rate), *(FLIP * vel)]
        names = ("p", "q", "r", "north", "east", "down")
        found = inequality(own(body, outputs), dict(zip(names, kept.T, strict=True)))
        assert max(found.values()) < 0.02, found


def test_each_field_is_the_number_of_the_vehicle() -> None:
    section = section_of(export(sih(), ExportSettings()))
    assert section["mass"] == 1.0
    assert section["J"] == [[0.025, 0.0, 0.0], [0.0, 0.025, 0.0], [0.0, 0.0, 0.03]]
    assert section["L"] == pytest.approx(0.2)
    layout = library_layout("quad.x")
    np.testing.assert_array_equal(section["mixing_matrix"][0], -np.sign(layout.positions[:, 1]))
    np.testing.assert_array_equal(section["mixing_matrix"][1], -np.sign(layout.positions[:, 0]))
    np.testing.assert_array_equal(section["mixing_matrix"][2], -layout.spins)
    np.testing.assert_allclose(np.diag(section["drag_matrix"]), [-1.0, -1.0, -1.0])
    assert section["rotor_dyn_coef"] == pytest.approx([1 / 0.048, 0.0, 1 / 0.048, 0.0])
    rpm = section["rpm_max"] * 0.6
    assert np.polyval(section["rpm2thrust"][::-1], rpm) == pytest.approx(3.0)
    assert np.polyval(section["rpm2torque"][::-1], rpm) == pytest.approx(0.06)
    assert (section["thrust_min"], section["thrust_max"]) == (0.0, 5.0)


def test_a_rectangle_has_its_levers_in_the_mixing_matrix() -> None:
    exported = export(asymmetric(), ExportSettings())
    section = section_of(exported)
    np.testing.assert_allclose(section["L"] * np.array(section["mixing_matrix"][0]), [-0.15, -0.16, 0.15, 0.16])
    np.testing.assert_allclose(section["L"] * np.array(section["mixing_matrix"][1]), [0.2, -0.22, 0.2, -0.22])
    assert any("are no square" in sentence for sentence in exported.left_out)
    assert {row.name for row in exported.compared if row.held == "not"} == {"M_u", "L_v", "L_p", "M_q", "N_r", "delay"}


def test_what_is_missing_is_asked_for() -> None:
    known = {name: value for name, value in SIH.items() if name != "T_motor"}
    with pytest.raises(UsageError, match="--set T_motor="):
        export(joined_vehicle([], given=known, layout=library_layout("quad.x")), ExportSettings())
    with pytest.raises(ModelError, match="has 6 rotors; expected four rotors"):
        export(joined_vehicle([], given=SIH, layout=library_layout("hexa.x")), ExportSettings())


def test_drawn_vehicles_are_sections_of_one_file() -> None:
    vehicles = [export(second(T_motor=0.04, m=mass), ExportSettings()) for mass in (2.0, 2.1)]
    made = draw_files(vehicles, "crazyflow", ExportSettings())
    (text,) = made.files.values()
    assert isinstance(text, str)
    found = tomllib.loads(text)
    assert {name: section["mass"] for name, section in found.items()} == {"vehicle_1": 2.0, "vehicle_2": 2.1}
    assert "draws/vehicle_crazyflow.toml" in made.start
