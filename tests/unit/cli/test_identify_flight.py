"""``rotorid identify --model physical.flight``, as a person types it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import Ran, rotorid
from tests.unit.identifying.flight_logs import flown, layout_file, log_file, without


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flight")


@pytest.fixture(scope="module")
def words(folder: Path) -> list[str]:
    return ["--model", "physical.flight", "--layout", str(layout_file(folder)), "--rotor-diameter", "0.2032"]


@pytest.fixture(scope="module")
def identified(folder: Path, words: list[str]) -> Ran:
    mass = f"m={flown().truth['m']}"
    return rotorid("identify", log_file(folder), *words, "--fix", mass, "--out", folder / "out", "--json")


@pytest.fixture(scope="module")
def judged(folder: Path, words: list[str], identified: Ran) -> Ran:
    """The same on another log too: climbs at one heading turn yaw by gusts alone."""
    assert identified.code == 0
    log_file(folder, flown(mission="climbs", seed=1).record, "other.csv")
    unseen = ["--verify", folder / "other.csv"]
    return rotorid("identify", folder / "flight.csv", *words, "--fix", "m=0.52", *unseen, "--out", folder / "judged")


def test_files_and_json(identified: Ran, folder: Path) -> None:
    assert identified.code == 0
    document = json.loads(identified.out)
    assert document["model"] == "physical.flight"
    assert document["flight"]["velocity"] == "measured"
    assert document["flight"]["disc_assumed"] is False
    drag = document["flight"]["hover"]["drag"]
    assert abs(drag["value"] - 0.25) < 3.0 * drag["std"] + 0.02
    files = {file.name for file in (folder / "out").iterdir()}
    assert files == {"result.json", "responses.npz", "model.toml", "report.html"}
    assert json.loads((folder / "out" / "result.json").read_text(encoding="utf-8")) == document


def test_the_terminal_names_drag_and_error(judged: Ran) -> None:
    assert judged.code == 0
    assert "rotor drag" in judged.out
    assert "thrust of a rotor in hover" in judged.out


def test_unseen_data_are_scored_where_they_judge(judged: Ran, folder: Path) -> None:
    document = json.loads((folder / "judged" / "result.json").read_text(encoding="utf-8"))
    (scores,) = document["verification"]["records"].values()
    reasons = [found["message"] for found in document["findings"] if found["kind"] == "not_verified"]
    all_six = {"ax", "ay", "az", "p_dot", "q_dot", "r_dot"}
    assert set(scores) < all_six
    (reason,) = reasons
    named = reason.partition(" does not judge ")[2].partition(":")[0]
    assert set(named.replace(" and ", ", ").split(", ")) <= all_six - set(scores)
    (line,) = [line for line in judged.out.splitlines() if line.startswith("unseen data: ")]
    assert all((f" {name} TIC " in line) == (name in scores) for name in all_six)


def test_a_vehicle_of_unknown_size_is_refused(folder: Path, identified: Ran) -> None:
    assert identified.code == 0
    log = folder / "flight.csv"
    ran = rotorid("identify", log, "--model", "physical.flight", "--layout", "quad.x", "--out", folder / "o")
    assert ran.code == 1
    assert "--arm" in " ".join(ran.err.split())


def test_a_missing_axis_is_refused(folder: Path, words: list[str]) -> None:
    log = log_file(folder, without(flown().record, "ay"), "blind.csv")
    ran = rotorid("identify", log, *words, "--out", folder / "o", "--json")
    assert ran.code == 1
    assert "missing_channel" in {finding["kind"] for finding in json.loads(ran.out)["findings"]}


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (["--band", "1:10"], "--band does not apply to physical.flight"),
        (["--bootstrap", "20"], "--bootstrap does not apply to physical.flight"),
        (["--fix", "m=1.2 lb*s"], "m"),
        (["--arm", "-1"], "--arm -1 m is not positive"),
    ],
)
def test_options_that_do_not_belong_are_refused(
    extra: list[str], said: str, folder: Path, words: list[str], identified: Ran
) -> None:
    assert identified.code == 0
    ran = rotorid("identify", folder / "flight.csv", *words, *extra)
    assert ran.code == 2
    assert said in " ".join(ran.err.split())


def test_models_lists_it() -> None:
    ran = rotorid("models")
    assert ran.code == 0
    assert "physical.flight" in ran.out
