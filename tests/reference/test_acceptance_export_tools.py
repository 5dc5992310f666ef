"""A vehicle identified from logs, flown in MuJoCo, RotorPy and as an FMU; its models in python-control and Octave."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.exports.motion import doublet, imported, inequality, own
from tests.unit.exports.test_fmu import COMPILER
from tests.unit.exports.test_fmu import flown as flown_as_fmu
from tests.unit.exports.test_matlab import octave
from tests.unit.exports.test_mujoco import flown as flown_in_mujoco
from tests.unit.exports.test_rotorpy import flown as flown_in_rotorpy

from rotorid.exports import ExportSettings, export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.identifying.identification import identify, identify_motors
from rotorid.io.registry import read
from rotorid.results.model import IdentifiedModel
from rotorid.settings.motors import MotorSettings
from rotorid.simulation.multirotor import Multirotor
from rotorid.typing import FloatArray

pytestmark = pytest.mark.slow

Unpacked = Callable[[str], Path]


@pytest.fixture(scope="module")
def motors(unpacked: Unpacked) -> JoinedVehicle:
    logs = [unpacked(f"px4_sitl/{name}") for name in ("roll.ulg", "pitch.ulg.xz", "yaw.ulg.xz", "thrust.ulg.xz")]
    choices = MotorSettings(known={"m": 1.0, "I_zz": 0.03}, arm_m=0.2828)
    return joined_vehicle([identify_motors([read(log) for log in logs], choices)])


@pytest.fixture(scope="module")
def roll(unpacked: Unpacked) -> IdentifiedModel:
    return identify([read(unpacked("px4_sitl/roll.ulg"))], "rate.roll")


def body_of(vehicle: JoinedVehicle) -> Multirotor:
    assert vehicle.multirotor is not None
    return vehicle.multirotor


def rates_agree(vehicle: JoinedVehicle, fly: Callable[[FloatArray], dict[str, FloatArray]]) -> dict[str, float]:
    """Theil's coefficient of the rate about the axis of each doublet."""
    found = {}
    for axis, name in enumerate("pqr"):
        outputs = doublet(body_of(vehicle), axis)
        found[name] = inequality(own(body_of(vehicle), outputs), fly(outputs), curved=True)[name]
    return found


def test_mujoco_flies_it(motors: JoinedVehicle, tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    exported = export(motors, "mujoco")
    found = rates_agree(motors, lambda outputs: flown_in_mujoco(exported, tmp_path, outputs))
    assert max(found.values()) < 0.02, found


def test_an_fmu_flies_it(motors: JoinedVehicle, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    if COMPILER is None:
        pytest.skip("there is no C compiler")
    export(motors, "fmu").write(tmp_path)
    subprocess.run([sys.executable, "vehicle_compile.py"], cwd=tmp_path, check=True, timeout=120)
    names: Sequence[str] = body_of(motors).rotors.layout.motor_names
    shown = ("p", "q", "r", "velocity_north", "velocity_east", "velocity_down")

    def fly(outputs: FloatArray) -> dict[str, FloatArray]:
        y = flown_as_fmu(fmpy, tmp_path / "vehicle.fmu", names, shown, outputs.T, 0.001)[:, 1:]
        return dict(zip(("p", "q", "r", "north", "east", "down"), y, strict=True))

    found = rates_agree(motors, fly)
    assert max(found.values()) < 1e-6, found


def test_rotorpy_flies_it_with_the_damping_that_its_table_states(motors: JoinedVehicle, tmp_path: Path) -> None:
    """Its damping follows from its drag: with that of the round trip rotorid flies as it does."""
    exported, body = export(motors, "rotorpy"), body_of(motors)
    module: Any = imported(exported, tmp_path, "vehicle_rotorpy.py")
    stated = {row.name: row.exported for row in exported.compared}
    assert body.aerodynamics is not None
    air = body.aerodynamics.copy()
    for place, name in enumerate(("L_p", "M_q", "N_r"), start=3):
        air[place, place] = body.inertia_kg_m2[place - 3, place - 3] * stated[name]
    compromise = replace(motors, multirotor=replace(body, aerodynamics=air))
    found = rates_agree(compromise, lambda outputs: flown_in_rotorpy(module, outputs))
    assert max(found.values()) < 0.02, found
    without = rates_agree(motors, lambda outputs: flown_in_rotorpy(module, outputs))
    assert max(without.values()) < 0.15, without


def test_octave_and_python_control_have_the_model(roll: IdentifiedModel, tmp_path: Path) -> None:
    pytest.importorskip("control", reason="python-control is not installed")
    omega = np.geomspace(1.0, 44.0, 30)
    choices = ExportSettings(delay="states", pade_order=4)
    module: Any = imported(export(roll, "control", choices), tmp_path, "vehicle_control.py")
    np.testing.assert_allclose(module.rate_roll(1j * omega), roll.response(omega)[0, 0], rtol=1e-9)
    export(roll, "matlab", choices).write(tmp_path)
    texts = " ".join(f"{value:.17g}" for value in omega)
    asked = [
        "vehicle;",
        f"H = freqresp(rate_roll, [{texts}]);",
        'printf("%.17g %.17g\\n", [real(H(:)) imag(H(:))].\');',
    ]
    pairs = np.array(octave(tmp_path, asked)).reshape(-1, 2)
    np.testing.assert_allclose(pairs @ np.array([1.0, 1.0j]), roll.response(omega)[0, 0], rtol=1e-9)
