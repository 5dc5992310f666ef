"""``rotorid delay`` as a person runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import Ran, rotorid
from tests.unit.fitting.late_lags import INPUT, RATE_HZ, late_lag

from rotorid.documents.delay import DelayDocument

pytestmark = pytest.mark.usefixtures("computed_once")

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
    assert "p behind roll_command" in ran.out
    assert "dead time plus a lag of" in ran.out
    assert str(tmp_path / "delay.json") in ran.out.replace("\n", "")


def test_quiet_says_nothing(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("delay", flight, *PAIR, "--out", tmp_path, "--quiet")
    assert (ran.code, ran.out, ran.err) == (0, "", "")


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--input", "roll_command"), 2, "was given without"),
        (("--input", "roll_comand", "--output", "p"), 2, "did you mean roll_command"),
        ((*PAIR, "--instrument", "roll_excitatoin"), 2, "did you mean roll_excitation"),
        ((*PAIR, "--segment", "roll:9:5"), 2, "AXIS:START:STOP"),
        ((*PAIR, "--segment", "roll:900:990"), 2, "outside every log"),
        (("--input", "roll_command", "--output", "motor_1"), 1, "motor_1"),
    ],
    ids=["alone", "slip", "instrument", "backward", "outside", "no channel"],
)
def test_trouble_is_a_sentence_and_a_code(
    options: tuple[str, ...], code: int, words: str, flight: Path, tmp_path: Path
) -> None:
    ran = rotorid("delay", flight, *options, "--out", tmp_path / "out")
    assert ran.code == code
    assert words in ran.err
    assert "Traceback" not in ran.err
    assert not (tmp_path / "out").exists()


def test_noise_ends_with_one_and_says_why(tmp_path: Path) -> None:
    history, rng = late_lag(1, 2.7), np.random.default_rng(77)
    noise, time_s = rng.normal(size=history.values.shape[1]), np.arange(history.values.shape[1]) / RATE_HZ
    log = tmp_path / "noise.csv"
    columns = np.stack([time_s, history[INPUT], noise], axis=1)
    np.savetxt(log, columns, delimiter=",", header="time [s],phi_setpoint [rad],phi [rad]", comments="")
    ran = rotorid("delay", log, "--out", tmp_path / "out")
    assert ran.code == 1
    assert "no_delay" in ran.err
    assert not (tmp_path / "out").exists()
