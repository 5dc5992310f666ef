"""The pages of one model and of several: the answer on the first screen, everything else folded, nothing too wide."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from tests.browser.first_screen import PHONE, first_screen, written
from tests.unit.report.hover_sample import hover_identification
from tests.unit.report.sample import doublet, identification, shown_with

from rotorid.report.identification import render_sections

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

LONGEST_PX = {"one": 4200, "several": 1800}


def page_of(kind: str, folder: Path) -> Path:
    """A page as a file."""
    checked = shown_with(identification(), verifications=(doublet(),))
    shown = [hover_identification()] if kind == "one" else [checked, hover_identification()]
    return written(render_sections(shown, title="a page"), folder)


def test_the_page_of_a_model_answers_first(shared_browser: Any, tmp_path: Path) -> None:
    seen = first_screen(shared_browser, page_of("one", tmp_path))
    for words in ("149.2 ± 0.3 rad/s²", "Fit: good.", "worst cost 4.7", "rotorid tune FOLDER"):
        assert words in seen.words, words
    assert seen.height <= LONGEST_PX["one"]
    assert [words for _, words in seen.headings][:3] == ["a page", "Parameters", "Frequency response and model"]
    assert seen.levels_without_gap
    assert seen.drawn <= 2
    assert not re.search(r"\d rad/s(?!²)", seen.text)


def test_the_page_of_several_models_lists_them_first(shared_browser: Any, tmp_path: Path) -> None:
    seen = first_screen(shared_browser, page_of("several", tmp_path))
    for words in ("All 2 models fit the data well.", "437 ± 3 rad/s²", "149.2 ± 0.3 rad/s²", "rotorid tune FOLDER"):
        assert words in seen.words, words
    assert seen.height <= LONGEST_PX["several"]
    assert seen.drawn == 0
    assert seen.levels_without_gap
    assert [words for level, words in seen.headings if level <= 2][-2:] == ["Roll", "hover.longitudinal"]


@pytest.mark.parametrize("kind", LONGEST_PX)
def test_a_phone_scrolls_in_one_direction(kind: str, shared_browser: Any, tmp_path: Path) -> None:
    assert first_screen(shared_browser, page_of(kind, tmp_path), width=PHONE).sideways <= 0
