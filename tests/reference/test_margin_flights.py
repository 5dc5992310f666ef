"""Margins of ordinary flights of real vehicles, told without a sweep."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.flights.whole_flights import flown, loop_response
from rotorid.models.autopilots.betaflight import BASE, TOP
from rotorid.reviewing.margins import margins
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import MarginReview

Told = tuple[dict[str, MarginReview], dict[str, Unavailable]]


@pytest.fixture(scope="module")
def freestyle(unpacked: Callable[[str], Path]) -> FlightRecord:
    return rotorid.read(unpacked("everyday/betaflight_431_freestyle.bbl.xz"))


@pytest.fixture(scope="module")
def told(freestyle: FlightRecord) -> Told:
    found, untold = margins(flown(freestyle))
    return {str(axis): one for axis, one in found.items()}, {one.what: one for one in untold}


def test_roll_with_d_at_its_top(told: Told) -> None:
    roll = told[0]["roll"]
    # 39.7 ± 2 degrees at 103 rad/s: an estimate of another program, which took the D filter at a higher throttle, and
    # the mean over the throttle, where ours is the loop of hover.
    top = roll.ends[TOP]
    assert top["phase_margin_deg"].value == pytest.approx(39.7, abs=2.0)
    assert top["crossover_rad_s"].value == pytest.approx(97.4, rel=0.03)
    assert top["crossover_rad_s"].lower < 103.0 < top["crossover_rad_s"].upper
    assert roll.ends[BASE]["phase_margin_deg"].value == pytest.approx(33.5, abs=2.0)
    assert roll.ends[BASE]["crossover_rad_s"].value == pytest.approx(80.6, rel=0.03)
    # The terms in the log say that D flew near its top.
    assert roll.numbers["phase_margin_deg"].value == top["phase_margin_deg"].value
    assert 4.0 < roll.numbers["phase_margin_deg"].upper - roll.numbers["phase_margin_deg"].lower < 10.0
    assert roll.instrument == "direct"


def test_pitch_at_both_ends(told: Told) -> None:
    pitch = told[0]["pitch"]
    assert pitch.ends[TOP]["phase_margin_deg"].value == pytest.approx(39.3, abs=2.5)
    top = pitch.ends[TOP]["crossover_rad_s"]
    assert top.value == pytest.approx(75.4, rel=0.04)
    assert top.lower < 83.0 < top.upper
    assert pitch.ends[BASE]["phase_margin_deg"].value == pytest.approx(34.7, abs=2.5)


def test_the_terms_in_the_log_are_those_of_the_header(told: Told) -> None:
    for axis in ("roll", "pitch"):
        review = told[0][axis]
        assert review.explained is not None
        assert review.explained > 0.95
        kinds = [finding.kind for finding in review.findings]
        # D between two ends, and an integral that is taken back while the sticks move.
        assert kinds.count("moving_gains") == 2


def test_yaw_is_turned_around(freestyle: FlightRecord, told: Told) -> None:
    # Motors that turn the other way make a command that the vehicle follows, not one that it opposes.
    plant = loop_response(flown(freestyle), reference="yaw_command", answer="r", instrument="r_setpoint")
    low = plant.omega_rad_s < 30.0
    assert np.abs(np.degrees(np.angle(plant.values[0, 0, low]))).max() < 110.0
    margin = told[0]["yaw"].numbers["phase_margin_deg"]
    assert 40.0 < margin.value < 110.0


def test_what_the_flight_cannot_tell_is_named(told: Told) -> None:
    missing = told[1]["margins.yaw.gain_margin_db"]
    assert "at least" in missing.why
    assert missing.remedy
