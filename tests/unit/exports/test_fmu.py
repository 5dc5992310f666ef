"""The FMUs: FMPy finds nothing wrong with them, and once compiled they move as rotorid simulates."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.unit.exports.models import HOVER, ROLL, model, vehicle
from tests.unit.exports.motion import STEP_S, doublet, late, own
from tests.unit.exports.vehicles import asymmetric, second, sih

from rotorid.exports import Exported, ExportSettings
from rotorid.exports.fmu import export
from rotorid.exports.state_space import variable_name
from rotorid.flying.vehicle_from_results import JoinedVehicle
from rotorid.typing import FloatArray

COMPILER = shutil.which(os.environ.get("CC", "cc"))
RATE_HZ = 200.0


def compiled(exported: Exported, folder: Path) -> None:
    """Run the script of an export, as a person would."""
    if COMPILER is None:
        pytest.skip("there is no C compiler")
    exported.write(folder)
    done = subprocess.run(
        [sys.executable, "vehicle_compile.py"], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr


def inputs(names: tuple[str, ...], samples: int = 160) -> FloatArray:
    """A doublet on each input, one after the other."""
    u = np.zeros((len(names), samples))
    for row, start in zip(u, range(10, 160, 60), strict=False):
        row[start : start + 20], row[start + 20 : start + 40] = 0.1, -0.1
    return u


def flown(
    fmpy: Any, place: Path, names: Sequence[str], outputs: Sequence[str], u: FloatArray, step_s: float = 1.0 / RATE_HZ
) -> FloatArray:
    """Outputs at the samples of held inputs and at the end, by the functions of the FMU themselves."""
    from fmpy.fmi2 import FMU2Slave

    described = fmpy.read_model_description(str(place))
    unpacked = fmpy.extract(str(place))
    references = {one.name: one.valueReference for one in described.modelVariables}
    slave = FMU2Slave(
        guid=described.guid,
        unzipDirectory=unpacked,
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="one",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    rows = []
    for k, column in enumerate(u.T):
        slave.setReal([references[name] for name in names], column.tolist())
        rows.append(slave.getReal([references[name] for name in outputs]))
        # Two steps of unlike length: the result is the same.
        slave.doStep(k * step_s, 0.3 * step_s)
        slave.doStep((k + 0.3) * step_s, 0.7 * step_s)
    rows.append(slave.getReal([references[name] for name in outputs]))
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(unpacked, ignore_errors=True)
    return np.array(rows).T


@pytest.mark.parametrize(
    ("choices", "count"),
    [(ExportSettings(delay="lag"), 2), (ExportSettings(delay="states", sample_rate_hz=RATE_HZ), 1)],
    ids=["continuous", "sampled"],
)
def test_it_moves_as_rotorid_simulates_it(choices: ExportSettings, count: int, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    found = vehicle(*[model(HOVER), model(ROLL)][:count])
    compiled(export(found, choices), tmp_path)
    for one in found.models:
        structure = one.structure
        u = inputs(structure.inputs)
        y = flown(fmpy, tmp_path / f"vehicle_{variable_name(one.name)}.fmu", structure.inputs, structure.outputs, u)[
            :, :-1
        ]
        if choices.sample_rate_hz is not None:
            # Delays are memory: exact.
            expected = one.simulate(u, sample_rate_hz=RATE_HZ, hold="zero")
        else:
            own = one.rational(delays="lag", sample_rate_hz=RATE_HZ)
            x, rows = np.zeros(len(own.A)), []
            for column in u.T:
                rows.append(own.C @ x + own.D @ column)
                x = own.A @ x + own.B @ column
            expected = np.array(rows).T
        np.testing.assert_allclose(y, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("found", "choices", "steps"),
    [
        (asymmetric(delay=0.006), ExportSettings(), 6.0),
        (asymmetric(delay=0.0064), ExportSettings(), 6.4),
        (asymmetric(delay=0.006), ExportSettings(delay="none"), 0.0),
        (asymmetric(delay=0.006), ExportSettings(delay="lag"), 0.0),
        (second(X_u=-0.2, Y_v=-0.3), ExportSettings(), 0.0),
    ],
    ids=["delayed", "part of a step", "left out", "lag", "at once"],
)
def test_the_vehicle_moves_as_rotorid_simulates_it(
    found: JoinedVehicle, choices: ExportSettings, steps: float, tmp_path: Path
) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    exported, body = export(found, choices), found.multirotor
    assert body is not None
    compiled(exported, tmp_path)
    if choices.delay == "lag":
        body = replace(body, rotors=replace(body.rotors, lag_up_s=0.036, lag_down_s=0.036))
    outputs = doublet(body, 0) + doublet(body, 2) - body.hover_shares
    names = ("p", "q", "r", "velocity_north", "velocity_east", "velocity_down")
    y = flown(fmpy, tmp_path / "vehicle.fmu", body.rotors.layout.motor_names, names, outputs.T, STEP_S)[:, 1:]
    whole = int(steps)
    share = steps - whole
    mine = own(body, (1.0 - share) * late(outputs, whole) + share * late(outputs, whole + 1))
    for theirs, (name, signal) in zip(y, mine.items(), strict=True):
        np.testing.assert_allclose(theirs, signal, atol=1e-9, err_msg=name)
    assert np.abs(mine["p"]).max() > 0.1


def test_wind_and_angles_of_the_vehicle(tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    found = sih()
    compiled(export(found, ExportSettings()), tmp_path)
    body = found.multirotor
    assert body is not None
    names = (*body.rotors.layout.motor_names, "wind_north", "wind_east", "wind_down")
    u = np.vstack([np.tile(body.hover_shares[:, None], 400), np.tile([[2.0], [0.0], [0.0]], 400)])
    shown = ("velocity_north", "u", "ax", "az", "phi", "theta", "north", "down")
    north, forward, ax, az, phi, theta, place, down = flown(fmpy, tmp_path / "vehicle.fmu", names, shown, u, STEP_S)
    time_s = STEP_S * np.arange(401)
    # X_u is -1 1/s: it drifts with the wind.
    np.testing.assert_allclose(north, 2.0 * (1.0 - np.exp(-time_s)), atol=1e-9)
    np.testing.assert_allclose(place, 2.0 * (time_s - 1.0 + np.exp(-time_s)), atol=1e-9)
    np.testing.assert_allclose(forward, north, atol=1e-12)
    np.testing.assert_allclose(ax[1:], 2.0 - north[1:], atol=1e-9)
    np.testing.assert_allclose(az, -9.80665, atol=1e-9)
    assert max(np.abs(signal).max() for signal in (phi, theta, down)) < 1e-9


def test_fmpy_finds_nothing_wrong(tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    from fmpy.validation import validate_fmu

    exported = export(vehicle(), ExportSettings(delay="states"))
    exported.write(tmp_path)
    for name in ("vehicle_rate_roll.fmu", "vehicle_hover_two.fmu"):
        assert validate_fmu(str(tmp_path / name)) == []
        described = fmpy.read_model_description(str(tmp_path / name))
        assert described.coSimulation.canHandleVariableCommunicationStepSize


def test_the_file_holds_sources_that_need_nothing() -> None:
    exported = export(vehicle(), ExportSettings())
    raw = exported.files["vehicle_hover_two.fmu"]
    assert isinstance(raw, bytes)
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        assert archive.namelist() == [
            "modelDescription.xml",
            "sources/model.h",
            "sources/dynamics.h",
            "sources/hover_two.c",
            "documentation/index.html",
        ]
        described = ElementTree.fromstring(archive.read("modelDescription.xml"))
        source, header = (archive.read(f"sources/{name}").decode() for name in ("hover_two.c", "model.h"))
        page = archive.read("documentation/index.html").decode()
    included = [line.removeprefix("#include ") for line in source.splitlines() if line.startswith("#include ")]
    assert included == ["<math.h>", "<stdlib.h>", "<string.h>", '"model.h"', '"dynamics.h"']
    names = [one.attrib["name"] for one in described.iter("ScalarVariable")]
    assert names == ["pitch_command", "thrust_command", "q", "ax", "az"]
    assert [one.attrib["index"] for one in described.iter("Unknown")] == ["3", "4", "5", "3", "4", "5"]
    assert f'#define GUID "{described.attrib["guid"]}"' in header
    assert "hover.two: delay at 50 rad/s" in page
    assert raw == export(vehicle(), ExportSettings()).files["vehicle_hover_two.fmu"]


@pytest.mark.parametrize("name", ["rate_roll", "vehicle"])
def test_the_sources_have_no_warnings(name: str, tmp_path: Path) -> None:
    if COMPILER is None:
        pytest.skip("there is no C compiler")
    exported = export(asymmetric() if name == "vehicle" else vehicle(), ExportSettings())
    exported.write(tmp_path)
    with zipfile.ZipFile(tmp_path / next(iter(exported.files))) as archive:
        archive.extractall(tmp_path)
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    prefix = f"-DFMI2_FUNCTION_PREFIX={name}_"
    for options in (strict, [*strict, prefix]):
        done = subprocess.run(
            [COMPILER, *options, str(tmp_path / f"sources/{name}.c")], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
