"""Angle loops of flights that an autopilot leads: the true response lies in the interval, or nothing is stated."""

from __future__ import annotations

import numpy as np
import pytest
from tests.twins.mission_loops import ANGLE_P, bandwidth_90deg, mission, truth

from rotorid.data.record import FlightRecord
from rotorid.flights.whole_flights import flown
from rotorid.reviewing.loops import LOOPS, loop_of
from rotorid.reviewing.tracking import tracking
from rotorid.reviewing.values import LoopReview

ROLL_ANGLE = next(loop for loop in LOOPS if loop.name == "phi")


def measured(record: FlightRecord) -> LoopReview | None:
    return loop_of(flown(record), ROLL_ANGLE)[0]


@pytest.mark.parametrize("gusts", [0.05, 0.2])
def test_the_true_response_lies_in_the_interval(gusts: float) -> None:
    for seed in range(3):
        found = measured(mission(seed, gusts=gusts, legs_m=4.0))
        assert found is not None
        assert found.instrument == "setpoint"
        assert [finding.severity for finding in found.findings if finding.kind == "closed_loop_bias"] == ["info"]
        crossing = found.numbers["bandwidth_90deg_rad_s"]
        assert crossing.lower <= bandwidth_90deg() <= crossing.upper
        omega = found.response.omega_rad_s
        inside = (omega >= found.band_rad_s[0]) & (omega <= found.band_rad_s[1])
        off = np.abs(found.response.values[0, 0] / truth(omega) - 1.0) / found.response.random_error[0, 0]
        # A complex error is the root of two larger than that of the magnitude.
        assert float(np.sqrt(np.mean(off[inside] ** 2) / 2.0)) < 2.0


@pytest.mark.parametrize("gusts", [0.2, 0.5])
def test_a_hover_in_gusts_shows_the_outer_loop_and_nothing_is_stated(gusts: float) -> None:
    for seed in range(3):
        record = mission(seed, gusts=gusts, legs_m=0.0)
        found, gaps = loop_of(flown(record), ROLL_ANGLE)
        assert found is None
        assert "outer loop" in gaps[0].why
        followed, _ = tracking(flown(record))
        assert "tracking_delay_s" not in followed["phi"].numbers


@pytest.mark.parametrize("log_hz", [10.0, 20.0, 50.0])
@pytest.mark.parametrize("legs_m", [4.0, 2.0])
def test_errors_and_delay_of_a_flight_are_those_of_its_loop(log_hz: float, legs_m: float) -> None:
    record = mission(5, gusts=0.1, legs_m=legs_m, log_hz=log_hz)
    numbers = tracking(flown(record))[0]["phi"].numbers
    # Far below its bandwidth an angle loop lags by one over its gain.
    assert numbers["tracking_delay_s"].lower <= 1.0 / ANGLE_P <= numbers["tracking_delay_s"].upper
    whole = mission(5, gusts=0.1, legs_m=legs_m, log_hz=200.0)
    error = whole["phi_setpoint"].values - whole["phi"].values
    true_rms, true_95 = float(np.sqrt(np.mean(error**2))), float(np.percentile(np.abs(error), 95))
    assert numbers["error_rms_rad"].lower <= true_rms <= numbers["error_rms_rad"].upper
    assert numbers["error_95_rad"].lower <= true_95 <= numbers["error_95_rad"].upper
