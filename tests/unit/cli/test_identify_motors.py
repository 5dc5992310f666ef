"""``rotorid identify --model physical.motors``, as a person types it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from tests.unit.cli.commands import Ran, rotorid
from tests.unit.identifying.motor_logs import flight


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("motors") / "flight.csv")


@pytest.fixture(scope="module")
def identified(log: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    folder = tmp_path_factory.mktemp("identified")
    words = ["--model", "physical.motors", "--layout", "quad.x", "--arm", "0.283", "--fix", "m=1.2"]
    return folder, rotorid("identify", log, *words, "--out", folder, "--json")


def test_files_and_json(identified: tuple[Path, Ran]) -> None:
    folder, ran = identified
    assert ran.code == 0
    document = json.loads(ran.out)
    assert document["model"] == "physical.motors"
    assert document["motors"]["layout"] == "quad.x"
    assert {file.name for file in folder.iterdir()} == {"result.json", "responses.npz", "model.toml", "report.html"}
    assert json.loads((folder / "result.json").read_text(encoding="utf-8")) == document


def test_a_refusal_exits_with_one_and_says_why(tmp_path: Path) -> None:
    calm = flight(tmp_path / "calm.csv", size=0.0)
    ran = rotorid(
        "identify", calm, "--model", "physical.motors", "--layout", "quad.x", "--out", tmp_path / "o", "--json"
    )
    assert ran.code == 1
    assert "no_excitation" in {finding["kind"] for finding in json.loads(ran.out)["findings"]}
    assert "on no axis" in " ".join(ran.err.split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--band", "1:10"], "--band does not apply to physical.motors"),
        (["--method", "output_error"], "--method output_error does not apply to physical.motors"),
        (["--starts", "central"], "--starts does not apply to physical.motors"),
        (["--cross-validate", "each"], "--cross-validate does not apply to physical.motors"),
        (["--decoupled"], "--decoupled does not apply to physical.motors"),
        (["--curve", "cubic"], "unknown curve 'cubic'"),
        (["--arm", "-1"], "--arm -1 m is not positive"),
    ],
)
def test_options_that_do_not_belong_are_refused(log: Path, words: list[str], said: str) -> None:
    ran = rotorid("identify", log, "--model", "physical.motors", "--layout", "quad.x", *words)
    assert ran.code == 2
    assert said in " ".join(ran.err.split())


def test_its_options_are_refused_by_other_models(log: Path) -> None:
    ran = rotorid("identify", log, "--model", "rate.roll", "--arm", "0.2")
    assert ran.code == 2
    assert "--arm does not apply to rate.roll; leave it out, or use physical.motors" in " ".join(ran.err.split())


@pytest.mark.parametrize("name", ["", "result.json", "model.toml"])
def test_verify_takes_its_results(name: str, identified: tuple[Path, Ran], log: Path, tmp_path: Path) -> None:
    ran = rotorid("verify", identified[0] / name, log, "--out", tmp_path / "out", "--json")
    assert ran.code == 0
    (check,) = json.loads(ran.out)["maneuvers"]
    assert set(check["moved"]) == {"az", "p_dot", "q_dot", "r_dot"}
    assert "seen_data" in {finding["kind"] for finding in json.loads(ran.out)["findings"]}


def test_compare_scores_its_results_on_a_log(identified: tuple[Path, Ran], log: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(identified[0], other)
    ran = rotorid("compare", identified[0], other, "--log", log, "--out", tmp_path / "beside", "--json")
    assert ran.code == 0
    document = json.loads(ran.out)
    assert {one["model"] for one in document["models"]} == {"physical.motors"}
    (scored,) = document["maneuvers"]
    first, second = (one["mean_percent"] for one in scored["models"].values())
    assert first == second > 50.0
