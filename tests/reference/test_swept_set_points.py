"""Margins of real flights in which a program swept the set-points of the attitude and the sticks rested."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import rotorid
from rotorid.flights.whole_flights import flown
from rotorid.reviewing.margins import margins
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import MarginReview
from rotorid.typing import Axis

OFFBOARD, GUIDED = "px4_sih_offboard_plan.ulg.xz", "ap_x_guided_multisine.BIN.xz"

PEAKS = {
    # tune finds 1.23 (1.20 to 1.25) in the same log.
    OFFBOARD: (1.23, 0.02),
    # A wide sweep at the mixer with the same gains finds 1.84 (1.75 to 1.91).
    GUIDED: (1.84, 0.05),
}
"""Sensitivity peak of a log, and how far a margin may lie from it."""

Told = tuple[dict[Axis, MarginReview], tuple[Unavailable, ...]]


@pytest.fixture(scope="module", params=PEAKS, ids=lambda name: name.split(".")[0])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def told(name: str, unpacked: Callable[[str], Path]) -> Told:
    return margins(flown(rotorid.read(unpacked(f"real_stacks/{name}"), sandbox=False)))


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_swept_set_point_shows_the_sensitivity_peak(
    name: str, told: Told, axis: Axis, request: pytest.FixtureRequest
) -> None:
    if (name, axis) == (GUIDED, "pitch"):
        reason = "the multisine ends at 67 rad/s; the lag that goes on to the peak at 122 says 1.78 (1.49 to 2.26)"
        request.applymarker(pytest.mark.xfail(reason=reason, raises=AssertionError, strict=True))
    peak, within = PEAKS[name]
    assert told[0][axis].numbers["sensitivity_peak"].value == pytest.approx(peak, abs=within)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_the_sensitivity_peak_lies_in_its_interval(name: str, told: Told, axis: Axis) -> None:
    one, peak = told[0][axis], PEAKS[name][0]
    shown = one.numbers["sensitivity_peak"]
    assert shown.lower < peak < shown.upper
    assert shown.value == pytest.approx(peak, abs=0.08)
    # Beyond the band a model goes on, and the review names what it reads there.
    assert ("sensitivity_peak" in one.by_model) == (name == GUIDED)
    assert one.instrument == "excitation"
    assert {"phase_margin_deg", "gain_margin_db"} <= one.numbers.keys()


def test_nothing_but_gusts_moves_yaw(told: Told) -> None:
    found, untold = told
    assert found["yaw"].instrument == "setpoint"
    assert {one.what for one in untold if "barely moved" in one.why} == {
        "margins.yaw.disturbance_rejection_rad_s",
        "margins.yaw.gain_margin_db",
        "margins.yaw.sensitivity_peak",
    }
