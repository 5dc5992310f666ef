"""Words and links that every page has."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.unit.report.sample import identification

from rotorid.data.display import capital
from rotorid.data.quantity import with_interval
from rotorid.io.files import write_atomically
from rotorid.report.files import write_together
from rotorid.report.frame import typeset, with_files
from rotorid.report.identification import render_sections


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("a bias of -0.5 m/s^2", "a bias of −0.5 m/s²"),
        ("(-3 to -1 dB)", "(−3 to −1 dB)"),
        ("1.2e-05 kg m^2 and 3e+07", "1.2·10⁻⁵ kg m² and 3·10⁷"),
        ("flown 2026-11-25 as log-3.ulg", "flown 2026-11-25 as log-3.ulg"),
        ("give --declination -3 or --set kappa=-0.1", "give --declination -3 or --set kappa=-0.1"),
        ("a well-known 5-10 %", "a well-known 5-10 %"),
    ],
)
def test_a_sentence_is_set_as_on_paper_and_commands_stay(written: str, read: str) -> None:
    assert typeset(written) == read


def test_only_the_first_letter_is_raised() -> None:
    assert (capital("gain A of MC_ROLL_P"), capital("")) == ("Gain A of MC_ROLL_P", "")


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ((27.0, 26.96, 27.04), ("27.00", "26.96 to 27.04")),
        ((105.93, 104.0, 107.0), ("105.9", "104.0 to 107.0")),
        ((-0.01, -0.4, 0.4), ("0.0", "−0.4 to 0.4")),
        ((3.0, 2.0, float("inf")), ("3.0", "2.0 to ∞")),
        ((1.7, 1.7, 1.7), ("1.7", "")),
    ],
)
def test_an_interval_is_never_two_equal_ends(ends: tuple[float, float, float], told: tuple[str, str]) -> None:
    assert with_interval(*ends) == told


def test_files_that_are_written_together_are_linked_from_their_page(tmp_path: Path) -> None:
    page = render_sections([identification()], title="t")
    write_together(
        tmp_path,
        {
            "a & b.json": lambda path: write_atomically(path, "{}"),
            "report.html": lambda path: write_atomically(path, page),
        },
    )
    written = (tmp_path / "report.html").read_bytes().decode()
    assert '<li><a href="a%20%26%20b.json"><code>a &amp; b.json</code></a>' in written
    assert 'href="report.html"' not in written
    later = with_files(written, ["tables/x.csv"])
    assert later.index("a%20%26%20b.json") < later.index("tables/x.csv")


def test_a_page_elsewhere_is_left_alone() -> None:
    assert with_files("<html></html>", ["result.json"]) == "<html></html>"
