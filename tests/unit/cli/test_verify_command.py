"""``rotorid verify``: exit codes, streams, files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import Ran, rotorid

from rotorid.documents.result import result_document
from rotorid.documents.verify import VerifyDocument
from rotorid.report.files import to_json
from rotorid.results.model import IdentifiedModel

pytestmark = pytest.mark.usefixtures("computed_once")

SEGMENT = ("--segment", "roll:56.2:105.9")


@pytest.fixture(scope="module")
def result(by_api: IdentifiedModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``verify`` reads of the files that ``identify`` writes."""
    folder = tmp_path_factory.mktemp("result")
    (folder / "result.json").write_text(to_json(result_document(by_api)))
    (folder / "model.toml").write_text(by_api.to_toml())
    return folder


@pytest.fixture(scope="module")
def verified(result: Path, flight: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    folder = tmp_path_factory.mktemp("verified") / "made" / "here"
    return folder, rotorid("verify", result, flight, *SEGMENT, "--out", folder, "--json")


def test_json_is_the_file_and_nothing_else(verified: tuple[Path, Ran]) -> None:
    folder, ran = verified
    assert ran.code == 0
    assert ran.out == (folder / "verification.json").read_text()
    document = VerifyDocument.model_validate_json(ran.out)
    assert json.loads(ran.out)["schema"] == "rotorid.verify/1"
    assert document.model == "rate.roll"
    assert document.band_rad_s is not None
    (sweep,) = document.frequency
    assert sweep.pairs["p/roll_command"].value < 50.0
    assert document.provenance.inputs.keys() == {"sweeps.csv"}
    page = (folder / "report.html").read_text()
    assert "rate.roll on unseen flight" in page
    assert "predicts unseen sweeps" in page


@pytest.mark.parametrize("name", ["result.json", "model.toml"])
def test_any_file_of_a_result_names_it(
    name: str, result: Path, verified: tuple[Path, Ran], flight: Path, tmp_path: Path
) -> None:
    ran = rotorid("verify", result / name, flight, *SEGMENT, "--out", tmp_path, "--json")
    assert json.loads(ran.out)["frequency"] == json.loads(verified[1].out)["frequency"]


def test_a_person_reads_costs_and_where_the_file_is(result: Path, flight: Path, tmp_path: Path) -> None:
    ran = rotorid("verify", result, flight, *SEGMENT, "--out", tmp_path)
    assert ran.code == 0
    assert "p/roll_command cost" in ran.out
    assert str(tmp_path / "verification.json") in ran.out
    assert str(tmp_path / "report.html") in ran.out


def test_quiet_says_nothing(result: Path, flight: Path, tmp_path: Path) -> None:
    assert rotorid("verify", result, flight, *SEGMENT, "--out", tmp_path, "--quiet") == (0, "", "")


def test_a_log_that_cannot_judge_ends_with_one_and_its_findings(result: Path, flight: Path, tmp_path: Path) -> None:
    log = tmp_path / "half.csv"
    lines = flight.read_text().splitlines()
    log.write_text("\n".join(line.split(",")[0] + "," + line.split(",")[1] for line in lines[:8000]))
    ran = rotorid("verify", result, log, "--out", tmp_path / "none", "--json")
    assert ran.code == 1
    assert {finding["kind"] for finding in json.loads(ran.out)["findings"]} == {"not_verified"}
    assert not (tmp_path / "none").exists()


def test_gains_come_from_a_file(result: Path, flight: Path, tmp_path: Path) -> None:
    gains = tmp_path / "gains.toml"
    gains.write_text("[roll]\nproportional_s = 0.06\n")
    ran = rotorid("verify", result, flight, *SEGMENT, "--controller", gains, "--out", tmp_path, "--json")
    assert json.loads(ran.out)["provenance"]["settings"]["controllers"] == ["roll: proportional_s=0.06"]
    gains.write_text("[roll]\nproportional = 0.06\n")
    ran = rotorid("verify", result, flight, *SEGMENT, "--controller", gains, "--out", tmp_path, "--json")
    assert ran.code == 2
    assert "line 2" in ran.err
    assert "proportional_s" in ran.err


@pytest.mark.parametrize(
    "options",
    [
        ("--low-pass", "much"),
        ("--scale", "-2"),
        ("--segment", "roll:9:3"),
        ("--segment", "roll:900:950"),
        ("--band", "60:1"),
    ],
    ids=lambda options: options[0],
)
def test_wrong_use_ends_with_two(options: tuple[str, str], result: Path, flight: Path, tmp_path: Path) -> None:
    ran = rotorid("verify", result, flight, *options, "--out", tmp_path / "none")
    assert ran.code == 2
    assert ran.out == ""
    assert ran.err.startswith("rotorid: ")


def test_a_result_that_is_none_ends_with_two(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("verify", tmp_path / "nowhere", flight)
    assert ran.code == 2
    assert "does not exist" in ran.err
