"""``rotorid compare``: exit codes, streams, files."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree

import pytest
from tests.unit.cli.commands import ROLL, Ran, rotorid
from tests.unit.identifying.response_twins import flight as response_flight
from tests.unit.identifying.response_twins import written

from rotorid.documents.compare import CompareDocument
from rotorid.documents.result import load
from rotorid.errors import UsageError
from rotorid.io.tables.csv import write_csv

pytestmark = pytest.mark.usefixtures("computed_once")


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("results")
    return [
        written(folder / "first", "response.first_order", 1),
        written(folder / "second", "response.second_order", 1),
    ]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight that none of the results has seen."""
    path = tmp_path_factory.mktemp("log") / "flight_3.csv"
    topic = response_flight(3).topics[0]
    write_csv(path, topic.time_s, dict(zip((c.name for c in topic.channels), topic.values, strict=True)))
    return path


@pytest.fixture(scope="module")
def compared(results: list[Path], log: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    folder = tmp_path_factory.mktemp("compared") / "made" / "here"
    return folder, rotorid("compare", *results, "--log", log, "--out", folder, "--json")


def test_json_is_the_file_and_nothing_else(compared: tuple[Path, Ran]) -> None:
    folder, ran = compared
    assert ran.code == 0
    assert ran.out == (folder / "compare.json").read_text()
    document = CompareDocument.model_validate_json(ran.out)
    assert json.loads(ran.out)["schema"] == "rotorid.compare/1"
    assert [one.label for one in document.models] == ["first", "second"]
    assert document.provenance.command[:2] == ["rotorid", "compare"]
    assert "2 models compared" in (folder / "report.html").read_text()


def test_a_person_reads_one_table(results: list[Path], log: Path, tmp_path: Path) -> None:
    ran = rotorid("compare", *results, "--log", log, "--out", tmp_path)
    assert ran.code == 0
    for words in ("response.first_order", "response.second_order", "cross-validated %", "K_phi", "flight_3.csv"):
        assert words in ran.out
    assert "second" in ran.out
    assert str(tmp_path / "compare.json") in ran.out
    assert str(tmp_path / "report.html") in ran.out


def test_a_part_of_a_log_can_be_chosen(results: list[Path], log: Path, tmp_path: Path) -> None:
    ran = rotorid("compare", *results, "--log", log, "--segment", "roll:2:9", "--out", tmp_path, "--json")
    (maneuver,) = json.loads(ran.out)["maneuvers"]
    assert (maneuver["start_s"], maneuver["stop_s"]) == (2.0, 9.0)


def test_quiet_says_nothing(results: list[Path], tmp_path: Path) -> None:
    assert rotorid("compare", *results, "--out", tmp_path, "--quiet") == (0, "", "")


def test_logs_that_score_nothing_end_with_one_and_their_findings(results: list[Path], tmp_path: Path) -> None:
    log = tmp_path / "other.csv"
    topic = response_flight(3).topics[0]
    write_csv(log, topic.time_s, {"p": topic.values[1]})
    ran = rotorid("compare", *results, "--log", log, "--out", tmp_path / "none", "--json")
    assert ran.code == 1
    document = json.loads(ran.out)
    assert {finding["kind"] for finding in document["findings"]} == {"not_verified"}
    assert len(document["models"]) == 2
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    "options", [("--hold", "second"), ("--segment", "roll:9:3"), ("--log", "nowhere.csv")], ids=lambda one: one[0]
)
def test_wrong_use_ends_with_two(options: tuple[str, str], results: list[Path], tmp_path: Path) -> None:
    ran = rotorid("compare", *results, *options, "--out", tmp_path / "none")
    assert ran.code == 2
    assert ran.out == ""
    assert ran.err.startswith("rotorid: ")


@pytest.fixture
def both(results: list[Path], tmp_path: Path) -> Path:
    """The same results as identify writes several models."""
    folder = tmp_path / "both"
    told = []
    for result in results:
        told.append(json.loads((result / "result.json").read_text(encoding="utf-8")))
        copytree(result, folder / told[-1]["model"])
    text = json.dumps({"schema": "rotorid.results/1", "results": told})
    (folder / "results.json").write_text(text, encoding="utf-8")
    return folder


def test_a_folder_of_several_models_is_its_models(both: Path, results: list[Path], tmp_path: Path) -> None:
    ran = rotorid("compare", both, "--out", tmp_path / "out", "--json")
    assert ran.code == 0
    names = ["response.first_order", "response.second_order"]
    assert [one.label for one in CompareDocument.model_validate_json(ran.out).models] == names
    ran = rotorid("compare", both, results[0], "--out", tmp_path / "three", "--json")
    assert len(json.loads(ran.out)["models"]) == 3


def test_a_folder_of_several_models_is_named_where_one_is_wanted(both: Path) -> None:
    with pytest.raises(UsageError, match=r"both has 2 models: response.first_order, response.second"):
        load(both)


def test_one_result_or_none_ends_with_two(results: list[Path], tmp_path: Path) -> None:
    assert rotorid("compare", results[0], "--out", tmp_path).code == 2
    ran = rotorid("compare", results[0], tmp_path, "--out", tmp_path)
    assert ran.code == 2
    assert "cannot be read" in ran.err


def test_models_of_responses_are_cross_validated_within_their_band(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("identify", flight, *ROLL, "--cross-validate", "each", "--out", tmp_path, "--json")
    assert ran.code == 0
    found = json.loads(ran.out)["cross_validation"]
    assert len(found["records"]) == 2
    low, high = found["band_rad_s"]
    assert 12.0 <= low < high <= 50.0
    # Noise and gusts of the demonstration leave a fifth of the motion in the band at most.
    assert found["mean_percent"] > 80.0
