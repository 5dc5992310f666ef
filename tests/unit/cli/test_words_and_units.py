"""Numbers with units, choices that are listed, options under headings, colors on a terminal, pages on paper."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rotorid.cli import console
from rotorid.cli.app import COMMANDS, OPTION_GROUPS, app
from rotorid.data.record import Maneuver
from rotorid.errors import UsageError
from rotorid.pipeline.preparation.measure import _beside_excitation
from rotorid.report.printing import BROWSERS, print_pages
from rotorid.units import read_measure


@pytest.mark.parametrize(
    ("text", "si", "value"),
    [("20cm", "m", 0.2), ("283 mm", "m", 0.283), ("-5e-3", "s", -0.005), ("5ms", "s", 0.005), (".5", None, 0.5),
     ("8Hz", "rad/s", 16.0 * np.pi), ("30 deg", "rad", np.pi / 6.0), ("1.4kg", None, 1.4), ("3°", "rad", np.pi / 60.0)],
)  # fmt: skip
def test_a_number_comes_with_its_unit(text: str, si: str | None, value: float) -> None:
    assert read_measure(text, si) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "si", "said"),
    [("20ms", "m", "which is in s"), ("fast", "m", "needed: a number in m"), ("5 parsec", "m", "is not known"),
     ("", None, "needed: a number"), ("1e", "s", "is not known"), ("nan", "s", "needed: a number"),
     ("1e999", "s", "needed: a number"), ("620g", None, "grams or gravity")],
)  # fmt: skip
def test_another_unit_is_refused(text: str, si: str | None, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read_measure(text, si)


def test_the_option_stands_in_the_sentence(tmp_path: Path) -> None:
    words = ["identify", str(tmp_path / "a.ulg"), "--model", "physical.motors", "--arm", "20ms"]
    answer = CliRunner().invoke(app, words)
    assert isinstance(answer.exception, UsageError)
    assert str(answer.exception).startswith("--arm '20ms' came, which is in s")


def test_many_options_stand_under_headings() -> None:
    text = CliRunner().invoke(app, ["identify", "--help"], env={"COLUMNS": "200"}).output
    headings = re.findall(r"^(\S.*):$", text, flags=re.MULTILINE)
    assert headings == ["Arguments", *OPTION_GROUPS, "Options"]
    assert "--taper hann|half_sine" in text
    assert "--weights auto|cifer|covariance" in text
    few = CliRunner().invoke(app, ["models", "--help"]).output
    assert "Options:" in few
    assert "Results:" not in few


def test_every_heading_has_an_option_of_some_command() -> None:
    there = {
        name
        for command in COMMANDS
        for name in re.findall(r"--([a-z-]+)", CliRunner().invoke(app, [command, "--help"]).output)
    }
    named = {name for names in OPTION_GROUPS.values() for name in names.split()}
    assert named <= there


def test_a_terminal_sees_colors_and_a_pipe_does_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    console.say("rotorid: no")
    assert capsys.readouterr().err == "rotorid: no\n"
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    console.say("rotorid: no")
    assert capsys.readouterr().err == "\x1b[1;31mrotorid:\x1b[0m no\n"
    monkeypatch.setenv("NO_COLOR", "1")
    console.say("rotorid: no")
    assert capsys.readouterr().err == "rotorid: no\n"


def test_a_band_beside_the_excitation_is_remarked_on() -> None:
    sweep = Maneuver(axis="roll", kind="sweep", start_s=0.0, stop_s=60.0, band_rad_s=(1.0, 64.0), origin="found")
    flights = [(None, sweep)]
    (said,) = _beside_excitation((0.1, 4.0), flights)  # type: ignore[arg-type]
    assert said.kind == "band_beside_excitation"
    assert said.numbers["kept_percent"] == pytest.approx(100.0 / 3.0)
    assert "--band 0.1:4Hz" in said.message
    for band in ((1.0, 40.0), (2.0, 20.0), None):
        assert _beside_excitation(band, flights) == ()  # type: ignore[arg-type]
    assert _beside_excitation((200.0, 300.0), flights)[0].numbers["kept_percent"] == 0.0  # type: ignore[arg-type]


def test_a_page_is_printed(tmp_path: Path) -> None:
    if not any(shutil.which(name) for name in BROWSERS):
        pytest.skip("no browser that prints")
    (tmp_path / "a.html").write_text("<h1>Flight</h1>", encoding="utf-8")
    (printed,) = print_pages(tmp_path)
    assert printed == tmp_path / "a.pdf"
    assert printed.read_bytes().startswith(b"%PDF")
