"""The page of ``inspect``: what the log is good for and what not before any scrolling, everything else folded below."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.browser.first_screen import PHONE, first_screen, written
from tests.unit.report.test_inspection_page import flight

from rotorid.report.inspection import render_inspection
from rotorid.report.inspection_words import not_for
from rotorid.reviewing.inspection import inspect

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    record = flight()
    return written(render_inspection(record, inspect(record)), tmp_path_factory.mktemp("page"))


@pytest.mark.parametrize("dark", [False, True])
def test_the_first_screen_answers(shared_browser: Any, page: Path, dark: bool) -> None:
    seen = first_screen(shared_browser, page, dark=dark)
    assert [words for level, words in seen.headings if level == 2][:2] == ["Good for", "Not for"]
    for row in not_for(inspect(flight())):
        assert row.what in seen.words
    assert seen.levels_without_gap
    assert seen.height <= 1600
    assert seen.drawn == 0


def test_a_phone_needs_no_sideways_scroll(shared_browser: Any, page: Path) -> None:
    seen = first_screen(shared_browser, page, width=PHONE)
    assert seen.sideways <= 0
    assert seen.height <= 3000
