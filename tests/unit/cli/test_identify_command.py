"""The contract of ``rotorid identify``: files, streams, exit codes, and one set of numbers however it is read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import ROLL, Ran, rotorid

from rotorid.data.quantity import error_columns, with_error
from rotorid.documents.result import ResultDocument, result_document
from rotorid.results.model import IdentifiedModel

pytestmark = pytest.mark.usefixtures("computed_once")

FILES = {"result.json", "responses.npz", "report.html", "model.toml"}


def numbers(document: ResultDocument) -> ResultDocument:
    """A result without the command that was typed, which is all that may differ."""
    return document.model_copy(update={"provenance": document.provenance.model_copy(update={"command": []})})


def test_writes_the_four_files_and_nothing_else(results: tuple[Path, Ran]) -> None:
    folder, ran = results
    assert ran.code == 0
    assert {path.name for path in folder.iterdir()} == FILES
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]


def test_json_is_all_that_standard_output_gets(results: tuple[Path, Ran]) -> None:
    _, ran = results
    assert json.loads(ran.out)["schema"] == "rotorid.result/1"
    assert ran.err == ""  # no terminal, no progress


def test_same_numbers_by_python_by_json_by_file_and_by_report(
    results: tuple[Path, Ran], by_api: IdentifiedModel
) -> None:
    folder, ran = results
    assert ran.out == (folder / "result.json").read_text(encoding="utf-8")
    assert numbers(ResultDocument.model_validate_json(ran.out)) == numbers(result_document(by_api))
    report = (folder / "report.html").read_text(encoding="utf-8")
    spread = {name: p for name, p in by_api.parameters.items() if p.std is not None}
    assert {"L_roll", "tau_roll"} <= spread.keys()
    for name, parameter in spread.items():
        # Delays are shown in ms, everything else in its unit.
        factor = 1e3 if parameter.unit == "s" else 1.0
        shown = {with_error(scale * parameter.value, scale * (parameter.std or 0.0)) for scale in (1.0, factor)}
        assert any(text in report for text in shown), name


def test_responses_hold_what_was_fitted(results: tuple[Path, Ran], by_api: IdentifiedModel) -> None:
    folder, _ = results
    with np.load(folder / "responses.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["values"], by_api.data.response.values)
        np.testing.assert_array_equal(arrays["model"], by_api.data.model_response)
        np.testing.assert_array_equal(arrays["fitted"], by_api.data.used)
        assert arrays["values"].shape == (1, 1, arrays["omega_rad_s"].size)
        assert arrays["inputs"].tolist() == ["roll_command"]


def test_quiet_says_nothing(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("identify", flight, *ROLL, "--out", tmp_path, "--quiet")
    assert (ran.code, ran.out, ran.err) == (0, "", "")


def test_a_person_sees_parameters_cost_and_where_the_report_is(
    flight: Path, by_api: IdentifiedModel, tmp_path: Path
) -> None:
    ran = rotorid("identify", flight, *ROLL, "--out", tmp_path)
    gain = by_api.parameters["L_roll"]
    assert " ".join(error_columns(gain.value, gain.std)) in " ".join(ran.out.split())
    assert "cost of p/roll_command" in ran.out
    assert f"report: {tmp_path / 'report.html'}" in ran.out


def test_default_folder_is_named_after_log_and_model(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "flight.2026.csv"
    log.symlink_to(flight)
    monkeypatch.chdir(tmp_path)
    assert rotorid("identify", log, *ROLL, "--quiet").code == 0
    made = tmp_path / "rotorid-out" / "flight.2026-rate.roll"
    assert {path.name for path in made.iterdir()} == FILES


def test_model_of_a_result_reproduces_the_result(
    flight: Path, results: tuple[Path, Ran], by_api: IdentifiedModel, tmp_path: Path
) -> None:
    model = results[0] / "model.toml"
    ran = rotorid("identify", flight, "--model", model, "--band", "12:50", "--out", tmp_path, "--json")
    assert ran.code == 0
    again = ResultDocument.model_validate_json(ran.out)
    assert again.model == "rate.roll"
    assert by_api.parameters["T_motor"].status == "dropped"
    assert set(again.parameters) == set(by_api.parameters) - {"T_motor"}
    for name in again.parameters:
        parameter = by_api.parameters[name]
        # The same minimum, approached from elsewhere: equal to a small part of the standard deviation.
        assert again.parameters[name].status == parameter.status
        assert again.parameters[name].value == pytest.approx(parameter.value, abs=0.01 * (parameter.std or 0.0))


def test_result_can_be_made_again_from_its_provenance(flight: Path, tmp_path: Path) -> None:
    asked = ("--segment", "roll:3.123456789:53", "--fix", "L_p=-0.123456789", "--windows", "12.5,5", "--seed", "7")
    ran = rotorid("identify", flight, *ROLL, *asked, "--estimate", "direct", "--out", tmp_path, "--json")
    provenance = ResultDocument.model_validate_json(ran.out).provenance
    # Names without folders: where a log lay is nobody's concern, and its hash says which it was.
    assert provenance.command == [
        *("rotorid", "identify", flight.name, *ROLL, *asked),
        *("--estimate", "direct", "--out", tmp_path.name, "--json"),
    ]
    assert provenance.settings["segments"] == ["roll:3.123456789:53.0"]
    assert provenance.settings["fix"] == ["L_p=-0.123456789"]
    assert provenance.settings["windows_s"] == [12.5, 5.0]
    assert (provenance.seed, provenance.estimate) == (7, "direct")
    assert provenance.inputs.keys() == {"sweeps.csv"}


def test_results_are_replaced_not_mixed(flight: Path, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text("old", encoding="utf-8")
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    refused = rotorid("identify", tmp_path / "missing.csv", *ROLL, "--out", tmp_path)
    assert refused.code == 2
    assert "result.json" in refused.err
    assert "--force" in refused.err
    assert (tmp_path / "result.json").read_text(encoding="utf-8") == "old"
    assert rotorid("identify", flight, *ROLL, "--out", tmp_path, "--quiet", "--force").code == 0
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["model"] == "rate.roll"
    assert {path.name for path in tmp_path.iterdir()} == FILES | {"notes.txt"}


def test_a_result_of_its_own_is_replaced_and_edited_files_are_not(flight: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for _ in range(2):
        assert rotorid("identify", flight, *ROLL, "--out", out, "--quiet").code == 0
    assert {path.name for path in out.iterdir()} == FILES
    edited = out / "model.toml"
    edited.write_text(edited.read_text(encoding="utf-8") + "# mine", encoding="utf-8")
    refused = rotorid("identify", flight, *ROLL, "--out", out)
    assert refused.code == 2
    assert "model.toml" in refused.err
    assert edited.read_text(encoding="utf-8").endswith("# mine")


def test_a_default_name_that_is_taken_is_numbered(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said = [rotorid("delay", flight).out for _ in range(2)]
    made = tmp_path / "rotorid-out"
    assert {path.name for path in made.iterdir()} == {"sweeps-delay", "sweeps-delay-2"}
    assert "sweeps-delay-2" in said[1]


def test_a_picture_that_is_not_rotorids_stays(flight: Path, tmp_path: Path) -> None:
    for name in ("a.html", "a.png"):
        picture = tmp_path / name
        picture.write_bytes(b"mine")
        refused = rotorid("inspect", flight, "--plot", picture)
        assert (refused.code, picture.read_bytes()) == (2, b"mine")
        for more in (["--force"], []):
            assert rotorid("inspect", flight, "--plot", picture, "--quiet", *more).code == 0
            assert len(picture.read_bytes()) > 1000
