"""Drag and wind of logs whose truth is known, and of real ones: by the tilt, and by plain regression beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

import rotorid
from rotorid.data.record import FlightRecord, Intervals
from rotorid.errors import InsufficientDataError
from rotorid.flights.tilt_drag import TiltDrag, tilt_drag, tilt_drag_of
from rotorid.flights.whole_flights import flown

Unpacked = Callable[[str], Path]

MAPPINGS = Path(__file__).resolve().parents[2] / "docs" / "mappings"
CALM, WINDY = ("x_calm_roll.BIN", "x_calm_verify.BIN.xz"), "x_wind_rollpitch.BIN.xz"
REST_1_S, SQUARE_1_M = 0.241, 0.0336
"""Of ArduPilot's simulated vehicle, along each axis."""


def logged(unpacked: Unpacked, name: str) -> tuple[FlightRecord, Intervals]:
    record = rotorid.read(unpacked(name))
    return record, flown(record).flights


def drag_of(unpacked: Unpacked, name: str) -> TiltDrag:
    return tilt_drag(*logged(unpacked, name))


@pytest.mark.parametrize("name", ["roll.ulg", "pitch.ulg.xz", "verify.ulg.xz"])
def test_px4_simulator_shows_its_drag_where_plain_regression_misses_it(unpacked: Unpacked, name: str) -> None:
    found = drag_of(unpacked, f"px4_sitl/{name}")
    assert found.drag.lower <= 1.0 <= found.drag.upper
    assert found.drag.std < 0.12
    assert found.plain.value < 0.93
    assert [finding.kind for finding in found.findings()] == ["both_ways_disagree"]
    assert math.hypot(found.wind_north.value, found.wind_east.value) < 0.3  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "name", ["px4_sitl/thrust.ulg.xz", "px4_sitl/yaw.ulg.xz", "ardupilot_sitl/x_calm_thrust.BIN.xz"]
)
def test_sweeps_of_thrust_and_yaw_are_not_enough_data(unpacked: Unpacked, name: str) -> None:
    with pytest.raises(InsufficientDataError, match="horizontal motion") as caught:
        drag_of(unpacked, name)
    assert "fly back and forth" in caught.value.remedy


def test_ardupilot_simulator_shows_both_parts_of_its_drag(unpacked: Unpacked) -> None:
    logs = [logged(unpacked, f"ardupilot_sitl/{name}") for name in (*CALM, WINDY)]
    for found in (*(tilt_drag(*log) for log in logs[:2]), tilt_drag_of(logs)):
        assert found.at_rest is not None
        assert found.quadratic is not None
        assert found.at_rest.value == pytest.approx(REST_1_S, rel=0.08)
        assert found.quadratic.value == pytest.approx(SQUARE_1_M, rel=0.08)
        assert found.agrees


def test_ardupilot_simulator_shows_its_wind(unpacked: Unpacked) -> None:
    found = drag_of(unpacked, f"ardupilot_sitl/{WINDY}")
    assert found.wind_north is not None
    assert found.wind_east is not None
    assert found.wind_north.value == pytest.approx(-1.65, abs=0.3)
    assert found.wind_east.value == pytest.approx(-2.86, abs=0.3)
    # It headed east throughout: the bias of the accelerometer could be all of the rest.
    assert 0.5 < found.wind_north.std < 1.0


def test_a_log_of_fast_flight_shows_drag(unpacked: Unpacked) -> None:
    found = drag_of(unpacked, "everyday/arducopter_321_1.BIN.xz")
    assert found.drag.lower <= 0.29 <= found.drag.upper
    assert found.drag.std < 0.07
    assert found.quadratic is not None
    assert found.quadratic.lower > 0.0
    assert 13.0 < found.top_speed().value < 19.0


@pytest.mark.parametrize(
    ("name", "drag_1_s"), [("ardupilot/erle_brain3.BIN", 0.31), ("ardupilot/beast_0036.BIN", 0.26)]
)
@pytest.mark.xfail(
    raises=AssertionError,
    reason="an estimate without the place of the accelerometer, which sits 4.5 cm above the center of gravity",
)
def test_drag_of_two_real_logs_as_an_instrument_without_the_place_shows_it(
    unpacked: Unpacked, name: str, drag_1_s: float
) -> None:
    found = drag_of(unpacked, name)
    assert abs(found.drag.value - drag_1_s) <= 0.03


@pytest.mark.parametrize("name", ["ardupilot/erle_brain3.BIN", "ardupilot/beast_0036.BIN"])
def test_real_logs_show_one_drag_and_one_place_of_the_accelerometer_in_every_band(
    unpacked: Unpacked, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    record, flights = logged(unpacked, name)
    whole = tilt_drag(record, flights)
    assert whole.drag.value == pytest.approx(0.2, abs=0.025)
    for low_hz, high_hz in ((0.1, 2.0), (0.2, 2.0)):
        for module in ("braking", "tilt_drag"):
            monkeypatch.setattr(f"rotorid.flights.{module}.LOW_HZ", low_hz)
            monkeypatch.setattr(f"rotorid.flights.{module}.HIGH_HZ", high_hz)
        found = tilt_drag(record, flights)
        assert abs(found.drag.value - whole.drag.value) < 2.0 * whole.drag.std
        assert found.height.value == pytest.approx(-0.047, abs=0.004)


@pytest.mark.parametrize("flight", ["B2_circle_fast_rep2", "B3_figure8_fast_rep2", "B8_star_fast_rep1"])
def test_flights_of_one_crazyflie_show_one_drag(unpacked: Unpacked, flight: str) -> None:
    found = nanobench(unpacked, flight)
    assert found.drag.value == pytest.approx(0.40, rel=0.05)
    assert found.drag.lower <= 0.40 <= found.drag.upper
    assert found.agrees


def test_a_crazyflie_that_hardly_moved_shows_none(unpacked: Unpacked) -> None:
    with pytest.raises(InsufficientDataError, match="horizontal motion"):
        nanobench(unpacked, "B6_linear_ramp_rep1")


def nanobench(unpacked: Unpacked, flight: str) -> TiltDrag:
    record = rotorid.read(unpacked(f"flight/nanobench_{flight}.csv.xz"), mapping=MAPPINGS / "nanobench.toml")
    return tilt_drag(record, ((record.start_s, record.stop_s),))
