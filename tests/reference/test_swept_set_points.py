"""Margins of real flights in which a program swept the set-points of the attitude and the sticks rested."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import rotorid
from rotorid.pipeline.preparation.whole_flights import flown
from rotorid.pipeline.review.margins import margins


@pytest.mark.parametrize(
    ("name", "peak", "share"),
    [
        # tune finds 1.23 (1.20 to 1.25) in the same log.
        ("real_stacks/px4_sih_offboard_plan.ulg.xz", 1.23, 0.02),
        # A wide sweep at the mixer with the same gains finds 1.84 (1.75 to 1.91). The multisine ends below that peak,
        # at 40 and 67 rad/s, so that a model goes on to it.
        ("real_stacks/ap_x_guided_multisine.BIN.xz", 1.84, 0.03),
    ],
)
def test_a_swept_set_point_shows_the_sensitivity_peak(
    unpacked: Callable[[str], Path], name: str, peak: float, share: float
) -> None:
    found, untold = margins(flown(rotorid.read(unpacked(name), sandbox=False)))
    for axis in ("roll", "pitch"):
        one = found[axis]
        assert one.instrument == "excitation"
        shown = one.numbers["sensitivity_peak"]
        assert shown.value == pytest.approx(peak, rel=share)
        assert shown.lower < peak < shown.upper
        assert {"phase_margin_deg", "gain_margin_db"} <= one.numbers.keys()
    # Nothing moved yaw but gusts.
    assert found["yaw"].instrument == "setpoint"
    assert {one.what for one in untold if "rested" in one.why} == {
        "margins.yaw.disturbance_rejection_rad_s",
        "margins.yaw.gain_margin_db",
        "margins.yaw.sensitivity_peak",
    }
