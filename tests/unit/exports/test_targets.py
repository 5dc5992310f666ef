"""What holds of every target: files that parse, the same files twice, and what is asked for."""

from __future__ import annotations

import ast
import io
import json
import math
import zipfile
from dataclasses import replace
from pathlib import PurePosixPath
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.unit.exports.models import HOVER, ROLL, model, vehicle
from tests.unit.exports.vehicles import SIH, sih
from tests.unit.flying.test_vehicle_from_results import motors

from rotorid.errors import ModelError, UsageError
from rotorid.exports import TARGETS, Exported, ExportSettings, export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout

SCALED = [name for name, target in TARGETS.items() if target.scale]
LINEAR = [name for name, target in TARGETS.items() if target.states]
UNCOMMENTED = (".json", ".config", ".world.sdf", "_compile.py", ".mat")


def whole() -> JoinedVehicle:
    """A body and models."""
    return replace(sih(), models=(model(ROLL), model(HOVER)))


def parsed(name: str, content: str | bytes) -> None:
    """Read a file as strictly as what it is for."""
    if isinstance(content, bytes):
        if name.endswith(".fmu"):
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                assert archive.testzip() is None
                ElementTree.fromstring(archive.read("modelDescription.xml"))
        else:
            assert content.startswith(b"MATLAB 5.0 MAT-file")
        return
    assert content.endswith("\n")
    assert not any(line != line.rstrip() for line in content.splitlines())
    if name.endswith((".xml", ".sdf", ".urdf", ".config")):
        ElementTree.fromstring(content.encode())
    elif name.endswith(".json"):
        json.loads(content, parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))
    elif name.endswith(".py"):
        ast.parse(content)


@pytest.mark.parametrize("target", list(TARGETS))
def test_files_parse_and_hold_the_round_trip(target: str) -> None:
    exported = export(whole(), target, ExportSettings(names="bird"))
    assert exported.target == target
    assert exported.start
    assert exported.compared
    for name, content in exported.files.items():
        place = PurePosixPath(name)
        assert not place.is_absolute()
        assert ".." not in place.parts
        assert "bird" in name
        parsed(name, content)
        if isinstance(content, str) and not name.endswith(UNCOMMENTED):
            assert all(row.name in content for row in exported.compared)


@pytest.mark.parametrize("target", list(TARGETS))
def test_the_same_vehicle_is_the_same_files(target: str) -> None:
    first, second = (dict(export(whole(), target).files) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("target", SCALED)
def test_without_a_scale_the_mass_is_asked_for(target: str) -> None:
    with pytest.raises(UsageError, match=r"--set m=KG"):
        export(motors(scale=None), target)


@pytest.mark.parametrize("target", SCALED)
def test_torque_is_never_taken_from_a_default(target: str) -> None:
    with pytest.raises(UsageError, match=r"kappa.*I_zz is at most .* and kappa at most .*--set kappa=M"):
        export(motors(), target)
    known = {name: value for name, value in SIH.items() if name not in ("kappa", "I_zz")}
    # Without a flight in yaw neither follows from the other, and both are asked for.
    with pytest.raises(
        UsageError,
        match=r"I_zz \(kg m\^2\), kappa \(m, torque of a rotor over its thrust\) of .*"
        r"--set I_zz=.* --set kappa=M",
    ):
        export(joined_vehicle([], given=known, layout=library_layout("quad.x")), target)


@pytest.mark.parametrize("target", SCALED)
def test_the_lag_of_a_rate_model_is_no_model_of_the_motors(target: str) -> None:
    """Neither inertia nor thrust follow from it: what it lacks is named in the first answer, and that is enough."""
    found = joined_vehicle([model(ROLL)], given={"T_motor": 0.05}, layout=library_layout("quad.x"))
    with pytest.raises(UsageError) as refused:
        export(found, target)
    for name in ("m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "c_1"):
        assert f"--set {name}=" in str(refused.value)


@pytest.mark.parametrize("target", LINEAR)
def test_models_need_no_scale(target: str) -> None:
    assert export(vehicle(), target).files


def test_the_vehicle_alone_is_an_fmu_and_no_state_space() -> None:
    assert set(export(sih(), "fmu").files) == {"vehicle.fmu", "vehicle_compile.py"}
    for target in ("matlab", "control", "json"):
        with pytest.raises(UsageError, match="no model to export"):
            export(sih(), target)


@pytest.mark.parametrize("target", ["matlab", "control"])
def test_names_of_logs_end_no_comment(target: str) -> None:
    found = model(ROLL)
    hostile = {'a\nraise SystemExit("""\\': "0" * 64}
    found = replace(found, provenance=replace(found.provenance, inputs=hostile))
    exported: Exported = export(found, target)
    text = next(one for one in exported.files.values() if isinstance(one, str))
    (line,) = [line for line in text.splitlines() if "SystemExit" in line]
    assert line.startswith(("# ", "% "))
    if target == "control":
        ast.parse(text)


@pytest.mark.parametrize("choices", [ExportSettings(delay="states"), ExportSettings(sample_rate_hz=100.0)])
@pytest.mark.parametrize("target", SCALED)
def test_simulators_refuse_what_only_state_spaces_hold(target: str, choices: ExportSettings) -> None:
    with pytest.raises(UsageError, match="expected matlab, control, fmu or json"):
        export(whole(), target, choices)


@pytest.mark.parametrize("target", ["ardupilot", "urdf"])
def test_motors_without_a_lag_take_no_delay(target: str) -> None:
    with pytest.raises(UsageError, match="has no motor lag"):
        export(whole(), target, ExportSettings(delay="lag"))


@pytest.mark.parametrize(
    "target", ["px4-sih", "ardupilot", "gazebo", "rotorpy", "urdf", "crazyflow", "pyflyt", "aerial-gym"]
)
def test_tilted_rotors_do_not_become_upright_ones(target: str) -> None:
    tilted = replace(library_layout("quad.x"), axes=np.tile([0.05, 0.0, -math.sqrt(1.0 - 0.05**2)], (4, 1)))
    with pytest.raises(ModelError, match="are tilted; expected upright ones"):
        export([], target, given=SIH, layout=tilted)
