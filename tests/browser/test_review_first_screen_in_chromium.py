"""The page of a review: seven answers before any scrolling, everything else folded below them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.browser.first_screen import PHONE, first_screen, written
from tests.unit.report.made_reviews import made_review, untold_review

from rotorid.report.review import render_reviews
from rotorid.reviewing.cards import cards

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.mark.parametrize("dark", [False, True])
def test_seven_answers_are_on_the_first_screen(shared_browser: Any, tmp_path: Path, dark: bool) -> None:
    review = made_review()
    seen = first_screen(shared_browser, written(render_reviews([review]), tmp_path), dark=dark)
    for card in cards(review):
        assert card.title in seen.words
        assert card.headline in seen.words
    assert seen.headings[0] == (1, "flight.ulg")
    assert [words for level, words in seen.headings if level == 2][:7] == [card.title for card in cards(review)]
    assert seen.levels_without_gap
    assert seen.height <= 2200
    # What is folded is drawn when it is opened.
    assert seen.drawn == 0
    assert any(words.startswith("Stability margins") for words in seen.summaries)


@pytest.mark.parametrize("review", [made_review(), untold_review()], ids=["flown", "no-flight"])
def test_a_phone_needs_no_sideways_scroll(shared_browser: Any, tmp_path: Path, review: Any) -> None:
    seen = first_screen(shared_browser, written(render_reviews([review]), tmp_path), width=PHONE)
    assert seen.sideways <= 0
    assert seen.height <= 4200
