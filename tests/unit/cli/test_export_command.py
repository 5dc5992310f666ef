"""``rotorid export``: files and what is said, joined results, draws, and every refusal leaving nothing behind."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.cli.commands import Ran, rotorid
from tests.unit.flying.test_vehicle_from_results import hover, motors

from rotorid.documents.export import ExportDocument, ModelsDocument
from rotorid.documents.result import save

PX4_FILES = {"bird.params", "bird_set.sh", "22001_sihsim_bird"}


@pytest.fixture(scope="module")
def of_motors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result of motors that knows the inertia of yaw."""
    folder = tmp_path_factory.mktemp("motors")
    save(motors(I_zz=0.038), folder)
    return folder


@pytest.fixture(scope="module")
def of_hover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hover")
    save(hover(X_u=-0.3, M_u=1.1, M_q=-0.71), folder)
    return folder


def refused(ran: Ran, out: Path, *words: str) -> None:
    """One sentence, exit code 2, and nothing written."""
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("rotorid: ")
    assert ran.err.count("\n") == 1
    for word in words:
        assert word in ran.err
    assert not out.exists()


def test_files_document_and_words(of_motors: Path, of_hover: Path, tmp_path: Path) -> None:
    out = tmp_path / "sih"
    ran = rotorid("export", of_motors, of_hover, "--to", "px4-sih", "--name", "bird", "--out", out)
    assert ran.code == 0
    assert {path.name for path in out.iterdir()} == PX4_FILES | {"export.json"}
    document = ExportDocument.model_validate_json((out / "export.json").read_text())
    assert (document.target, document.name) == ("px4-sih", "bird")
    assert document.results == ["physical.motors", "hover.longitudinal"]
    for file in document.files:
        assert hashlib.sha256((out / file.name).read_bytes()).hexdigest() == file.sha256
    assert {"m", "I_zz"} <= set(document.given)
    assert "I_xx" not in document.given
    assert document.numbers["X_u"].std == pytest.approx(0.015)
    rows = {one.name: one for one in document.quantities}
    assert rows["X_u"].identified == pytest.approx(-0.3)
    assert rows["M_u"].difference_percent is None
    for words in (
        "Wrote bird for px4-sih",
        "roll acceleration per output",
        "given: m = 1.5 kg",
        "kept exactly:",
        "use it:",
        "folder:",
    ):
        assert words in ran.out


def test_the_answer_as_json_alone(of_motors: Path, tmp_path: Path) -> None:
    ran = rotorid("export", of_motors, "--to", "gazebo", "--out", tmp_path / "out", "--json")
    assert json.loads(ran.out) == json.loads((tmp_path / "out" / "export.json").read_text())
    assert json.loads(ran.out)["schema"] == "rotorid.export/1"
    quiet = rotorid("export", of_motors, "--to", "gazebo", "--out", tmp_path / "out", "--quiet")
    assert (quiet.code, quiet.out) == (0, "")


def test_a_result_is_replaced_and_foreign_files_stay(of_motors: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert rotorid("export", of_motors, "--to", "px4-sih", "--out", out).code == 0
    (out / "notes.txt").write_text("mine")
    assert rotorid("export", of_motors, "--to", "gazebo", "--out", out).code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "22002_gz_vehicle",
        "export.json",
        "notes.txt",
        "vehicle",
        "vehicle.world.sdf",
    ]


@pytest.mark.parametrize(("target", "file"), [("rl-tools", "rl_tools.json"), ("crazyflow", "crazyflow.toml")])
def test_draws_for_learners_are_one_file_with_the_lines_that_load_it(
    of_motors: Path, tmp_path: Path, target: str, file: str
) -> None:
    out = tmp_path / "out"
    ran = rotorid("export", of_motors, "--to", target, "--draws", "12", "--set", "T_motor=0.05", "--out", out)
    assert ran.code == 0
    assert [path.name for path in (out / "draws").iterdir()] == [f"vehicle_{file}"]
    assert f"draws/vehicle_{file}" in ran.out
    assert len(ran.out.splitlines()) <= 40
    assert f"draws/vehicle_{file}" in json.loads((out / "export.json").read_text())["draws"]["start"]
    assert (out / "draws" / f"vehicle_{file}").read_text().count("vehicle_") == 12


def test_draws_are_vehicles_in_numbered_folders(of_motors: Path, tmp_path: Path) -> None:
    def drawn(folder: str, seed: int) -> list[float]:
        out = tmp_path / folder
        ran = rotorid("export", of_motors, "--to", "ardupilot", "--draws", "12", "--seed", str(seed), "--out", out)
        assert ran.code == 0
        assert "drawn: 12 vehicles" in ran.out
        names = sorted(path.name for path in (out / "draws").iterdir())
        assert names == [f"{number:02d}" for number in range(1, 13)]
        tables = [json.loads((out / "draws" / name / "vehicle.json").read_text()) for name in names]
        return [table["moment_inertia"][0] for table in tables]

    first = drawn("one", 1)
    assert first == drawn("two", 1)
    assert first != drawn("three", 2)
    # Known to one percent.
    assert np.std(first) == pytest.approx(0.01 * 0.02, rel=0.6)
    assert np.mean(first) == pytest.approx(0.02, rel=0.01)


def test_what_is_missing_is_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "out"
    save(motors(), tmp_path / "yaw")
    without_yaw = rotorid("export", tmp_path / "yaw", "--to", "px4-sih", "--out", out)
    # Half of I_xx + I_yy by the identified ratio.
    refused(without_yaw, out, "--set kappa=", "I_zz is at most 0.042", "kappa at most 0.021")
    save(motors(scale=None, I_zz=0.03), tmp_path / "scale")
    refused(rotorid("export", tmp_path / "scale", "--to", "gazebo", "--out", out), out, "--set m=")
    given = rotorid(
        "export", tmp_path / "scale", "--to", "gazebo", "--out", out, "--set", "m=1.5", "--set", "I_zz=0.03"
    )
    assert given.code == 0


def test_models_without_scale_go_to_json(tmp_path: Path) -> None:
    save(motors(scale=None), tmp_path / "scale")
    ran = rotorid("export", tmp_path / "scale", "--to", "json", "--out", tmp_path / "out")
    assert ran.code == 0
    document = ModelsDocument.model_validate_json((tmp_path / "out" / "vehicle.json").read_text())
    (model,) = document.models
    names = model.covariance.names
    std = np.sqrt(np.diag(model.covariance.matrix))
    assert std[names.index("I_xx")] == pytest.approx(model.parameters["I_xx"].std)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--to", "px4_sih"), ["unknown target 'px4_sih'", "did you mean px4-sih?"]),
        (("--to", "gazebo", "--name", "my quad"), ["'my quad'", "--name"]),
        (("--to", "gazebo", "--name", "../up"), ["--name"]),
        (("--to", "gazebo", "--set", "mass=1.4"), ["no number of a vehicle 'mass'"]),
        (("--to", "gazebo", "--set", "m=heavy"), ["NAME=VALUE"]),
        (("--to", "gazebo", "--set", "m=-1"), ["a positive number"]),
        (("--to", "gazebo", "--delay-as-lag", "--pade", "3"), ["--delay-as-lag and --pade"]),
        (("--to", "json", "--sample-rate", "-5"), ["--sample-rate -5"]),
        (("--to", "json", "--name", "export"), ["export.json"]),
        (("--to", "gazebo", "--set", "c_2=-40"), ["thrust"]),
    ],
)
def test_wrong_use_is_one_sentence(
    arguments: tuple[str, ...], words: list[str], of_motors: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    refused(rotorid("export", of_motors, *arguments, "--out", out), out, *words)


def test_a_refused_model_is_no_vehicle(of_motors: Path, tmp_path: Path) -> None:
    document: dict[str, Any] = json.loads((of_motors / "result.json").read_text())
    document["parameters"] = {}
    (tmp_path / "refused").mkdir()
    (tmp_path / "refused" / "result.json").write_text(json.dumps(document))
    out = tmp_path / "out"
    refused(rotorid("export", tmp_path / "refused", "--to", "json", "--out", out), out, "has no model")
    refused(rotorid("export", tmp_path / "nothing", "--to", "json", "--out", out), out, "nothing")


def test_several_targets_need_several_calls(of_motors: Path, tmp_path: Path) -> None:
    ran = rotorid("export", of_motors, "--to", "mujoco,gazebo", "--out", tmp_path / "out")
    refused(
        ran, tmp_path / "out", "--to takes one target", "'mujoco,gazebo'", "export once for each, such as --to mujoco"
    )


def test_results_that_contradict_each_other(of_motors: Path, tmp_path: Path) -> None:
    save(motors(I_zz=0.038, I_xx=0.03, log="two.ulg"), tmp_path / "other")
    out = tmp_path / "out"
    ran = rotorid("export", of_motors, tmp_path / "other", "--to", "gazebo", "--out", out)
    refused(ran, out, "contradict each other in I_xx", "--set I_xx=")


def test_several_models_of_one_run_are_read(of_motors: Path, of_hover: Path, tmp_path: Path) -> None:
    documents = []
    for folder in (of_motors, of_hover):
        document = json.loads((folder / "result.json").read_text())
        place = tmp_path / "several" / document["model"]
        place.mkdir(parents=True)
        for file in folder.iterdir():
            (place / file.name).write_bytes(file.read_bytes())
        documents.append(document)
    documents.append({"model": "rate.yaw", "findings": []})
    (tmp_path / "several" / "results.json").write_text(
        json.dumps({"schema": "rotorid.results/1", "results": documents, "provenance": documents[0]["provenance"]})
    )
    ran = rotorid("export", tmp_path / "several", "--to", "px4-sih", "--out", tmp_path / "out", "--json")
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["results"] == ["physical.motors", "hover.longitudinal"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is no JSON"),
        ("[]", "is no results.json"),
        ('{"schema": "rotorid.results/1", "results": 3}', "is no results.json"),
        ('{"schema": "rotorid.results/1", "results": [{"model": "rate.yaw", "findings": []}]}', "has no model"),
        ('{"schema": "rotorid.results/1", "results": [{"model": ["x"], "parameters": {"a": 1}}]}', "is not in"),
    ],
)
def test_results_that_are_none(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "several").mkdir()
    (tmp_path / "several" / "results.json").write_text(text)
    out = tmp_path / "out"
    refused(rotorid("export", tmp_path / "several", "--to", "json", "--out", out), out, words)
