"""The page of a verification begins with how well unseen flight is predicted, with a scale for each number."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.browser.first_screen import HEIGHT, FirstScreen, first_screen, written
from tests.unit.report.verification_sample import verified

from rotorid.report.verification import render_checks


@pytest.fixture(scope="module")
def verification_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    document, found = verified()
    return written(render_checks(document, found, title="rate.roll on unseen flight"), tmp_path_factory.mktemp("v"))


@pytest.fixture(scope="module")
def page(shared_browser: Any, verification_page: Path) -> FirstScreen:
    return first_screen(shared_browser, verification_page)


def test_the_answer_and_its_scale_come_first(page: FirstScreen) -> None:
    assert "rate.roll predicts 1 unseen maneuver well." in page.words
    assert "up to 0.25" in page.words
    assert "(up to 50 is very good, up to 100 acceptable)" in page.words
    assert page.words.index("Maneuver by maneuver") > page.words.index("predicts 1 unseen maneuver well")


def test_the_page_is_short(page: FirstScreen) -> None:
    assert page.height <= 4 * HEIGHT
    assert page.levels_without_gap


def test_a_phone_needs_no_sideways_scroll(shared_browser: Any, verification_page: Path) -> None:
    assert first_screen(shared_browser, verification_page, width=400).sideways <= 0
