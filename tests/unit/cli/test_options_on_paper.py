"""``--pdf``: wherever a page is written it is printed too, and a result is none the worse for a printer that fails."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
from tests.unit.cli.commands import ROLL, rotorid

PAGES = (
    "review",
    "response",
    "identify",
    "verify",
    "compare",
    "design",
    "simulate",
    "stitch",
    "tune",
    "fleet",
    "track",
    "bench",
)
ALSO = ("inspect", "demo")
PRINTS = '#!/bin/sh\nfor word; do case "$word" in --print-to-pdf=*) printf %%PDF- > "${word#*=}";; esac; done\n'
FAILS = "#!/bin/sh\nexit 1\n"

pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="a browser that is a script of the shell"),
    pytest.mark.usefixtures("computed_once"),
]


@pytest.fixture
def browser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A browser that prints an empty page at once."""
    place = tmp_path / "chromium"
    place.write_text(PRINTS, encoding="utf-8")
    place.chmod(place.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr("rotorid.report.printing.shutil.which", lambda _: str(place))
    return place


@pytest.mark.parametrize("command", [*PAGES, *ALSO])
def test_every_command_with_a_page_prints_it(command: str) -> None:
    assert "--pdf" in rotorid(command, "--help-all").out


@pytest.mark.slow
def test_a_page_is_printed_again_and_again(flight: Path, browser: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for words in (("identify", flight, *ROLL), ("inspect", flight)):
        folder = out / words[0]
        for _ in range(2):
            ran = rotorid(*words, "--pdf", "--quiet", "--out", folder)
            assert (ran.code, ran.err) == (0, "")
        (printed,) = folder.glob("*.pdf")
        assert printed.with_suffix(".html").is_file()
        # A page on paper of another result does not stay beside the new one.
        assert rotorid(*words, "--quiet", "--out", folder).code == 0
        assert not printed.exists()


def test_a_printer_that_fails_takes_no_result_along(flight: Path, browser: Path, tmp_path: Path) -> None:
    browser.write_text(FAILS, encoding="utf-8")
    for words, main in (
        (("identify", flight, *ROLL), "result.json"),
        (("review", flight, "--no-models"), "review.json"),
    ):
        ran = rotorid(*words, "--pdf", "--json", "--out", tmp_path / words[0])
        assert ran.code == 0, ran.err
        assert "did not print" in ran.err
        assert (tmp_path / words[0] / main).read_text(encoding="utf-8") == ran.out


def test_somebody_elses_paper_is_refused_before_any_work(flight: Path, browser: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.pdf").write_bytes(b"mine")
    ran = rotorid("identify", flight, *ROLL, "--pdf", "--out", tmp_path / "out")
    assert ran.code == 2
    assert "report.pdf" in ran.err
    assert (tmp_path / "out" / "report.pdf").read_bytes() == b"mine"


def test_a_page_that_is_not_written_is_not_printed(flight: Path, browser: Path) -> None:
    ran = rotorid("inspect", flight, "--pdf")
    assert ran.code == 2
    assert "--pdf is used without --out; add --out FOLDER" in ran.err


def test_without_a_browser_it_is_refused_before_any_work(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rotorid.report.printing.shutil.which", lambda _: None)
    monkeypatch.setattr("rotorid.report.printing._PLACES", {})
    for words in (("review", flight), ("identify", flight, *ROLL), ("fleet", flight)):
        ran = rotorid(*words, "--pdf", "--out", tmp_path / "out")
        assert ran.code == 2
        assert "no browser was found that can print" in ran.err
        assert not (tmp_path / "out").exists()


def test_cards_of_several_plans_are_printed_and_leave_with_the_next_run(browser: Path, tmp_path: Path) -> None:
    words = ("design", "doublet", "2-1-1", "--vehicle", "px4_quad", "--axis", "roll", "--quiet", "--out", tmp_path)
    assert rotorid(*words, "--pdf").code == 0
    printed = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.pdf")}
    assert printed == {"design.pdf", "doublet/flight-card.pdf", "two_one_one/flight-card.pdf"}
    assert rotorid(*words).code == 0
    assert not list(tmp_path.rglob("*.pdf"))
