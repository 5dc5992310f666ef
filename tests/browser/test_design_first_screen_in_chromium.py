"""The first screen of a flight plan: what to fly, how well it will measure, and what to do; everything else folds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.browser.first_screen import PHONE, first_screen, written
from tests.unit.report.test_design_page import CHOICES, designed

from rotorid.report.design import render_design

MOST_PIXELS = 3200


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(render_design(designed()[:1], CHOICES, title="One plan"), tmp_path_factory.mktemp("page"))


def test_the_answer_is_above_the_fold_and_details_fold(shared_browser: Any, page: Path) -> None:
    seen = first_screen(shared_browser, page)
    assert "Pilot sweep on roll and pitch, 49 s in all: expected error of 2 parameters: 2 to 5 %" in seen.words
    assert "random and model error, as identify will state them" in seen.words
    assert "What to fly" in seen.words
    assert seen.height <= MOST_PIXELS
    assert "Simulated flight and its limits" in seen.summaries
    assert "Expected frequency responses" in seen.summaries
    assert first_screen(shared_browser, page, width=PHONE).sideways <= 0
