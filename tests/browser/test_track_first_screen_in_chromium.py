"""The page of a tracked flight begins with what changed, to what, and when; model and notes fold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.first_screen import HEIGHT, FirstScreen, first_screen, written

from rotorid.data.findings import warn
from rotorid.identifying.settings import TrackSettings
from rotorid.identifying.tracking import FlightTracking
from rotorid.report.track import render_track
from rotorid.results.provenance import provenance
from rotorid.verification.tracking import Step, Tracking


@pytest.fixture(scope="module")
def track_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of 140 s that takes a payload at 100 s."""
    time_s = np.arange(0.5, 140.0, 0.5)
    ratio = np.where(time_s < 100.0, 1.0, 0.77)
    found = FlightTracking(
        log="flight.ulg",
        model="rate.roll",
        axis="roll",
        parameters={"L_roll": 112.7, "L_p": -1.04},
        parameter_stds={"L_roll": 1.3, "L_p": None},
        parameter_units={"L_roll": "rad/s^2", "L_p": "1/s"},
        given=False,
        instrument="roll_stick",
        reference_s=(0.0, 60.0),
        tracking=Tracking(
            time_s=time_s,
            ratio=ratio,
            std=np.full(time_s.size, 0.02),
            cannot_tell=("",) * time_s.size,
            steps=(Step(at_s=104.0, since_s=100.0, ratio=0.77, std=0.02),),
            reference_gain=1.0,
            thrust_exponent=None,
            level=np.full(time_s.size, 0.5),
            rougher=np.ones(time_s.size),
        ),
        trims=(),
        findings=(warn("gap", "roll_stick", "A gap of 1 s."),),
        provenance=provenance([], TrackSettings()),
    )
    return written(render_track(found), tmp_path_factory.mktemp("track"))


@pytest.fixture(scope="module")
def page(shared_browser: Any, track_page: Path) -> FirstScreen:
    return first_screen(shared_browser, track_page)


def test_the_change_comes_first(page: FirstScreen) -> None:
    assert "Changed at about 100 s: roll control power fell to 77.0 ± 2.0 % of its value" in page.words
    assert "(detected at 104 s)" in page.words
    assert page.drawn == 1


def test_the_page_is_short_and_its_parameters_have_errors(page: FirstScreen, track_page: Path) -> None:
    assert page.height <= 2 * HEIGHT
    assert page.levels_without_gap
    assert "Parameters of the reference model" in page.summaries
    assert "112.7 ± 1.3" in track_page.read_text(encoding="utf-8")


def test_a_phone_needs_no_sideways_scroll(shared_browser: Any, track_page: Path) -> None:
    assert first_screen(shared_browser, track_page, width=400).sideways <= 0
