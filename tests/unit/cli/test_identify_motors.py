"""``rotorid identify --model physical.motors``, as a person types it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.pipeline.motor_logs import flight


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("motors") / "flight.csv")


def test_files_and_json(log: Path, tmp_path: Path) -> None:
    words = ["--model", "physical.motors", "--layout", "quad.x", "--arm", "0.283", "--fix", "m=1.2"]
    ran = rotorid("identify", log, *words, "--out", tmp_path, "--json")
    assert ran.code == 0
    document = json.loads(ran.out)
    assert document["model"] == "physical.motors"
    assert document["motors"]["layout"] == "quad.x"
    assert {file.name for file in tmp_path.iterdir()} == {"result.json", "responses.npz", "model.toml", "report.html"}
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8")) == document


def test_a_refusal_exits_with_one_and_says_why(tmp_path: Path) -> None:
    calm = flight(tmp_path / "calm.csv", size=0.0)
    ran = rotorid(
        "identify", calm, "--model", "physical.motors", "--layout", "quad.x", "--out", tmp_path / "o", "--json"
    )
    assert ran.code == 1
    assert "no_excitation" in {finding["kind"] for finding in json.loads(ran.out)["findings"]}
    assert "along no axis" in " ".join(ran.err.split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--band", "1:10"], "band rad s came with physical.motors"),
        (["--method", "output_error"], "method came with physical.motors"),
        (["--search", "sobol"], "search came with physical.motors"),
        (["--bootstrap", "100"], "bootstrap came with physical.motors"),
        (["--cross-validate", "each"], "cross validate came with physical.motors"),
        (["--curve", "cubic"], "the curve 'cubic' came"),
        (["--arm", "-1"], "an arm of -1 m came"),
    ],
)
def test_options_that_do_not_belong_are_refused(log: Path, words: list[str], said: str) -> None:
    ran = rotorid("identify", log, "--model", "physical.motors", "--layout", "quad.x", *words)
    assert ran.code == 2
    assert said in " ".join(ran.err.split())


def test_its_options_are_refused_by_other_models(log: Path) -> None:
    ran = rotorid("identify", log, "--model", "rate.roll", "--arm", "0.2")
    assert ran.code == 2
    assert "them with physical.motors alone" in " ".join(ran.err.split())
