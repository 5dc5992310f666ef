"""Yaw drift of many flights over voltage: both slopes contain the truth, and flights without drift change nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.fleet_logs import read_table, row_of
from tests.twins.yaw_drift_flights import write_flight, yaw_drift_flight, yaw_drift_record
from tests.unit.cli.commands import rotorid

from rotorid.documents.base import to_json
from rotorid.documents.fleet import FleetDocument, fleet_document
from rotorid.fleets.analysis import FleetAnalysis, analyze
from rotorid.fleets.table import Counts, Row
from rotorid.report.fleet import render_fleet
from rotorid.reviewing.yaw_drift import yaw_drift
from rotorid.signal.battery import battery_voltages

FLOWN = ((2.0, 238.0),)
COUNTS = Counts(logs=15, answered=15, refused=0, unreadable=0, duplicates=0, resumed=0, rows=90)


def rows_of(vehicle: int, flight: int, **drift: Any) -> Iterator[Row]:
    """What a review of a simulated flight puts into the table."""
    start_v = drift.pop("start_v", 16.8 - 0.3 * ((2 * flight + vehicle) % 5))
    columns = yaw_drift_flight(seed=100 * vehicle + flight, start_v=start_v, **{"fall_v": 1.0, **drift})
    record = yaw_drift_record(columns)
    numbers, _ = yaw_drift(record, FLOWN)
    volts = battery_voltages(record, FLOWN)
    groups = {"yaw": numbers, "battery": volts}
    for group, found in groups.items():
        for name, one in found.items():
            more = {"model": "review", "parameter": f"{group}.{name}", "unit": one.unit}
            yield row_of(f"quad-{vehicle}", flight, one.value, one.std, **more)


def fleet_of(vehicles: int = 3, flights: int = 5, **drift: Any) -> FleetAnalysis:
    return analyze(
        row
        for vehicle in range(1, vehicles + 1)
        for flight in range(1, flights + 1)
        for row in rows_of(vehicle, flight, **drift)
    )


def test_slopes_within_and_between_flights_contain_the_truth() -> None:
    found = {one.parameter: one for one in fleet_of(drift_per_volt=0.05, trim_per_volt=0.02).yaw}
    for name, truth, unit in (("yaw.drift_rad_s", 0.05, "rad/s/V"), ("yaw.yaw_trim", 0.02, "1/V")):
        for slope in (found[name].within, found[name].between):
            assert slope is not None
            assert 0.0 < slope.lower < truth < slope.upper
            assert slope.unit == unit
        assert len(found[name].flights) == 15


def test_flights_without_drift_change_nothing() -> None:
    analysis = fleet_of(flights=6)
    assert not analysis.changed
    assert not [history for history in analysis.histories if history.drift is not None]
    for one in analysis.yaw:
        for slope in (one.within, one.between):
            assert slope is not None
            assert slope.lower < 0.0 < slope.upper


def test_what_drifts_in_time_alone_shows_only_within_flights() -> None:
    """A drift that follows the time in flight has a slope within flights, and none between them."""
    rows: list[Row] = []
    for vehicle in (1, 2, 3):
        for flight in range(1, 6):
            start_v = 16.8 - 0.3 * ((2 * flight + vehicle) % 5)
            # The same course of the drift in each flight, at whatever voltage.
            rows += rows_of(vehicle, flight, start_v=start_v, drift_per_volt=0.1, drift_rad_s=0.1 * (16.0 - start_v))
    (drift,) = [one for one in analyze(rows).yaw if one.parameter == "yaw.drift_rad_s"]
    assert drift.within is not None
    assert drift.within.lower < 0.1 < drift.within.upper
    assert drift.between is not None
    assert drift.between.lower < 0.0 < drift.between.upper


def test_a_voltage_that_does_not_move_is_not_enough_data() -> None:
    for one in fleet_of(vehicles=2, start_v=16.0, fall_v=0.1).yaw:
        assert one.within is None
        assert "less than 2 % in each flight" in one.why_within
        assert one.between is None
        assert "less than 2 % in voltage" in one.why_between
        assert one.flights


def document_of(analysis: FleetAnalysis) -> FleetDocument:
    return fleet_document(analysis, failed=(), counts=COUNTS, settings={})


def test_document_and_page_have_both_slopes_or_say_what_is_missing() -> None:
    moved, still = fleet_of(drift_per_volt=0.05), fleet_of(vehicles=2, start_v=16.0, fall_v=0.1)
    document = document_of(moved)
    assert FleetDocument.model_validate_json(to_json(document)) == document
    page = render_fleet(moved, document)
    assert "Yaw drift over battery voltage" in page
    assert "Between flights of a vehicle" in page
    page = render_fleet(still, document_of(still))
    assert "Not enough data" in page
    assert "the voltage changed by less than 2 % in each flight" in page


@pytest.mark.slow  # half a minute: nine reviews
def test_fleet_of_logs_has_the_slopes_in_its_table(tmp_path: Path) -> None:
    for vehicle in (1, 2, 3):
        for flight in (1, 2, 3):
            columns = yaw_drift_flight(seed=10 * vehicle + flight, drift_per_volt=0.05, start_v=16.8 - 0.4 * flight)
            write_flight(tmp_path / "logs" / f"quad-{vehicle}" / f"flight-{vehicle}-{flight}.csv", columns)
    rotorid("fleet", tmp_path / "logs", "--review", "--models", "rate.yaw", "--out", tmp_path / "fleet", "--quiet")
    document = FleetDocument.model_validate_json((tmp_path / "fleet" / "fleet.json").read_text(encoding="utf-8"))
    (drift,) = [one for one in document.yaw_over_voltage if one.parameter == "yaw.drift_rad_s"]
    for slope in (drift.within, drift.between):
        assert slope is not None
        assert slope.lower is not None
        assert slope.upper is not None
        assert slope.lower < 0.05 < slope.upper
    rows = [row for row in read_table(tmp_path / "fleet" / "fleet.parquet") if row.parameter == "yaw.drift_per_volt"]
    assert len(rows) == 9
    assert {row.unit for row in rows} == {"rad/s/V"}
