"""The page of a fleet begins with the vehicles to look at and why; everything else folds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.first_screen import HEIGHT, FirstScreen, first_screen, written
from tests.browser.test_fleet_in_chromium import page_of
from tests.fleet_logs import table_of


@pytest.fixture(scope="module")
def fleet_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten vehicles of twelve flights, of which one loses a tenth of its control power at its ninth flight."""
    rng = np.random.default_rng(0)
    values = 100.0 + rng.normal(0, 3.0, (10, 1)) + rng.normal(0, 1.0, (10, 12))
    values[7, 8:] *= 0.9
    return written(page_of(table_of(values)), tmp_path_factory.mktemp("fleet"))


@pytest.fixture(scope="module")
def page(shared_browser: Any, fleet_page: Path) -> FirstScreen:
    return first_screen(shared_browser, fleet_page)


def test_the_vehicle_to_look_at_comes_first(page: FirstScreen) -> None:
    assert "1 of 10 vehicles changed: v07." in page.words
    assert "Changed: roll control power −" in page.words
    assert "propellers" in page.words
    assert "At most 5 % of the listed changes are expected to be false alarms." in page.words


def test_the_page_is_short_and_ordered(page: FirstScreen) -> None:
    assert page.height <= 2 * HEIGHT
    assert [words for level, words in page.headings if level == 2] == ["What is normal", "More"]
    assert "All numbers" in page.summaries


def test_a_phone_needs_no_sideways_scroll(shared_browser: Any, fleet_page: Path) -> None:
    assert first_screen(shared_browser, fleet_page, width=400).sideways <= 0
