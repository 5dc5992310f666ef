"""The page of ``response``: the answer on each loop before any scrolling; everything else folds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.browser.first_screen import PHONE, first_screen, written
from tests.unit.report.response_sample import responses

from rotorid.documents.response import loops_of
from rotorid.report.response import loop_answer, render_responses

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(render_responses(responses(), title="Responses"), tmp_path_factory.mktemp("page"))


@pytest.mark.parametrize("dark", [False, True])
def test_the_first_screen_answers(shared_browser: Any, page: Path, dark: bool) -> None:
    seen = first_screen(shared_browser, page, dark=dark)
    answers = [loop_answer(axis, loop) for axis, _, loop in loops_of(responses().loops)]
    assert answers
    for answer in answers:
        assert answer.headline in seen.words
    assert "is fine)" in seen.words or "is trouble)" in seen.words
    assert seen.levels_without_gap
    assert seen.height <= 3000


def test_a_phone_needs_no_sideways_scroll(shared_browser: Any, page: Path) -> None:
    seen = first_screen(shared_browser, page, width=PHONE)
    assert seen.sideways <= 0
    assert seen.height <= 4200
