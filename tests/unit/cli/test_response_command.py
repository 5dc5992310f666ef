"""``rotorid response`` as a person runs it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import Ran, rotorid

from rotorid.documents.response import ResponseDocument
from rotorid.loops.responses import response

pytestmark = pytest.mark.usefixtures("computed_once")

PAIR = ("--inputs", "roll_command", "--outputs", "p")


@pytest.fixture(scope="module")
def results(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    folder = tmp_path_factory.mktemp("responses") / "made" / "here"
    return folder, rotorid("response", flight, *PAIR, "--out", folder, "--json")


def test_writes_its_three_files_and_nothing_else(results: tuple[Path, Ran]) -> None:
    folder, ran = results
    assert ran.code == 0, ran.err
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "response.json", "responses.npz"]


def test_standard_output_is_the_document_and_nothing_else(results: tuple[Path, Ran]) -> None:
    folder, ran = results
    printed = ResponseDocument.model_validate_json(ran.out)
    assert printed == ResponseDocument.model_validate_json((folder / "response.json").read_text())
    assert json.loads(ran.out)["schema"] == "rotorid.response/1"
    assert printed.provenance.command[:2] == ["rotorid", "response"]


def test_is_what_the_python_function_answers(results: tuple[Path, Ran], flight: Path) -> None:
    folder, _ = results
    by_api = response(flight, inputs="roll_command", outputs="p", estimate="auto")
    with np.load(folder / "responses.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["values"], by_api.response.values)
        np.testing.assert_array_equal(arrays["used"], by_api.used)
        assert arrays["inputs"].tolist() == ["roll_command"]
        share = arrays["window_share"]
        assert np.allclose(share.sum(axis=2), 1.0)
        assert {"roll_loop_values", "multiple_coherence", "leakage", "direct_values"} <= set(arrays)


def test_a_person_gets_a_table_with_the_usable_band(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("response", flight, *PAIR, "--out", tmp_path / "out")
    assert ran.code == 0
    assert "joint estimate with roll_excitation" in ran.out
    assert "p/roll_command" in ran.out
    assert "The roll whole loop is close to oscillation. Crossover 9.93 ± 0.08 rad/s, phase margin" in ran.out
    assert "(below 40° is trouble)" in ran.out
    assert str(tmp_path / "out" / "report.html") in ran.out.replace("\n", "")


def test_quiet_says_nothing(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("response", flight, *PAIR, "--out", tmp_path, "--quiet")
    assert (ran.code, ran.out, ran.err) == (0, "", "")


@pytest.mark.parametrize(
    ("options", "needed"),
    [
        (("--inputs", "roll_command,roll_command", "--outputs", "p"), "each once"),
        (("--inputs", "", "--outputs", "p"), "channel names"),
        ((*PAIR, "--band", "1:5000"), "Nyquist"),
        ((*PAIR, "--band", "9:3"), "0 < LO < HI"),
        ((*PAIR, "--estimate", "joint", "--instrument", "p"), "an instrument"),
        ((*PAIR, "--windows", "0"), "lengths above 0"),
        ((*PAIR, "--shift", "p:later"), "CHANNEL:SECONDS"),
        ((*PAIR, "--segment", "roll:9:5"), "AXIS:START:STOP"),
        ((*PAIR, "--segment", "roll:900:990"), "outside every log"),
    ],
    ids=[
        "twins",
        "none",
        "above Nyquist",
        "reversed",
        "output as instrument",
        "no window",
        "no shift",
        "backward",
        "outside",
    ],
)
def test_wrong_use_is_a_sentence_and_two(options: tuple[str, ...], needed: str, flight: Path, tmp_path: Path) -> None:
    ran = rotorid("response", flight, *options, "--out", tmp_path / "out")
    assert ran.code == 2
    assert needed in ran.err
    assert "Traceback" not in ran.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        (("--inputs", "roll_command", "--outputs", "motor_1"), "missing_channel"),
        ((*PAIR, "--segment", "roll:10:12", "--band", "0.5:2"), "record_too_short"),
    ],
    ids=["no channel", "too short"],
)
def test_data_that_cannot_answer_are_a_sentence_and_one(
    options: tuple[str, ...], kind: str, flight: Path, tmp_path: Path
) -> None:
    ran = rotorid("response", flight, *options, "--out", tmp_path / "out", "--json")
    assert ran.code == 1, ran.err
    document = ResponseDocument.model_validate_json(ran.out)
    assert kind in {finding.kind for finding in document.findings}
    assert document.pairs == {}
    assert "Traceback" not in ran.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--inputs", "roll_comand", "--outputs", "p"), "did you mean roll_command"),
        (("--inputs", "roll_command", "--outputs", "roll_command"), "is both input and output"),
        ((*PAIR, "--instrument", "foo"), "unknown channel 'foo'"),
        ((*PAIR, "--segment", "pitch:10:40"), "another axis"),
        ((*PAIR, "--seed", "-1"), "the seed -1 is negative"),
    ],
    ids=["slip", "itself", "no instrument", "another axis", "seed"],
)
def test_slips_are_named(options: tuple[str, ...], words: str, flight: Path, tmp_path: Path) -> None:
    ran = rotorid("response", flight, *options, "--out", tmp_path / "out")
    assert (ran.code, (tmp_path / "out").exists()) == (2, False)
    assert words in ran.err
