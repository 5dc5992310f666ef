"""The first screen of the page of ``tune``: new gains, what gets better, and margins with a scale."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.browser.first_screen import PHONE, FirstScreen, first_screen, written
from tests.browser.test_tuning_in_chromium import PARAMETERS, proposed

from rotorid.proposing.proposal import TuningProposal
from rotorid.report.tune import render_tune
from rotorid.tuning.firmware import written as written_gains

MOST_PIXELS = 2200
"""Of the page of one axis with everything folded but its sliders, which stand on top."""


def changed() -> TuningProposal:
    """A proposal whose parameters are those of its gains."""
    proposal = proposed()
    tuning = proposal.axes["roll"]
    new = written_gains(tuning.controller, tuning.proposal.proposed.gains)
    parameters = {name: (value, new.get(name, value)) for name, value in PARAMETERS.items()}
    object.__setattr__(tuning, "parameters", parameters)
    object.__setattr__(proposal, "files", {"proposed.params": "new"})
    return proposal


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(render_tune(changed(), title="Gains from flight.ulg"), tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def seen(shared_browser: Any, page: Path) -> FirstScreen:
    return first_screen(shared_browser, page)


def test_the_answer_is_above_the_fold(seen: FirstScreen) -> None:
    assert "Roll: P 0.1 → " in seen.words
    assert "New gains for roll. With the new gains, a disturbance tilts the vehicle" in seen.words
    assert "In the first flight, watch for roll shaking at about" in seen.words
    assert "less than today" in seen.words
    assert "Fly the new gains gently" in seen.words
    # Sliders stand on top, with what they change.
    assert "MC_ROLLRATE_P" in seen.words
    for figure in ("Peak sensitivity M_s", "Phase margin", "Noise in the motor command"):
        assert figure in seen.words


def test_everything_else_is_folded(seen: FirstScreen) -> None:
    assert seen.height <= MOST_PIXELS
    assert "proposed.params" in seen.summaries
    assert "Roll: all parameters, margins and pictures" in seen.summaries
    assert [words for _, words in seen.headings][1:5] == [
        "Try gains by hand",
        "How robust are the loops?",
        "Load the new gains, or go back",
        "Details",
    ]


def test_no_page_scrolls_sideways_on_a_phone(shared_browser: Any, page: Path) -> None:
    assert first_screen(shared_browser, page, width=PHONE).sideways <= 0
