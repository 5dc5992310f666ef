"""``rotorid delay`` as a person runs it."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.unit.cli.commands import Ran, rotorid

from rotorid.pipeline.delay_document import DelayDocument

PAIR = ("--input", "roll_command", "--output", "p")


@pytest.fixture(scope="module")
def results(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    folder = tmp_path_factory.mktemp("delays") / "made" / "here"
    return folder, rotorid("delay", flight, *PAIR, "--out", folder, "--json")


def test_standard_output_is_the_document_and_nothing_else(results: tuple[Path, Ran]) -> None:
    folder, ran = results
    assert ran.code == 0, ran.err
    assert [path.name for path in folder.iterdir()] == ["delay.json"]
    printed = DelayDocument.model_validate_json(ran.out)
    assert printed == DelayDocument.model_validate_json((folder / "delay.json").read_text())
    pair = printed.pairs["p/roll_command"]
    assert pair.feedback
    assert pair.instrument == "roll_excitation"
    assert pair.recommended.method == "response"


def test_a_person_gets_a_table(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("delay", flight, *PAIR, "--out", tmp_path)
    assert ran.code == 0
    assert "p/roll_command" in ran.out
    assert "dead time beside a lag of" in ran.out
    assert str(tmp_path / "delay.json") in ran.out.replace("\n", "")


def test_quiet_says_nothing(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("delay", flight, *PAIR, "--out", tmp_path, "--quiet")
    assert (ran.code, ran.out, ran.err) == (0, "", "")


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--input", "roll_command"), 2, "came alone"),
        (("--input", "roll_comand", "--output", "p"), 2, "did you mean roll_command"),
        ((*PAIR, "--segment", "roll:9:5"), 2, "AXIS:START:STOP"),
        ((*PAIR, "--segment", "roll:900:990"), 1, "no given segment"),
        (("--input", "roll_command", "--output", "motor_1"), 1, "motor_1"),
    ],
    ids=["alone", "slip", "backward", "outside", "no channel"],
)
def test_trouble_is_a_sentence_and_a_code(
    options: tuple[str, ...], code: int, words: str, flight: Path, tmp_path: Path
) -> None:
    ran = rotorid("delay", flight, *options, "--out", tmp_path / "out")
    assert ran.code == code
    assert words in ran.err
    assert "Traceback" not in ran.err
    assert not (tmp_path / "out").exists()
