"""Logs of two vehicles are refused together, and what a log leaves out speaks against nothing."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import UsageError
from rotorid.flights.same_vehicle import Aircraft, aircraft_of, different_gains, require_one_vehicle


def log(form: str, name: str, parameters: dict[str, float] | None = None) -> FlightRecord:
    rate = Channel(name="p", unit="rad/s")
    topic = Topic(name="rates", time_s=np.arange(3) * 0.1, channels=(rate,), values=np.zeros((1, 3)))
    source = Source(name=name, format=form, sha256=name)
    return FlightRecord(source=source, topics=(topic,), parameters=parameters or {})


def test_two_autopilots_are_two_vehicles() -> None:
    with pytest.raises(UsageError, match="PX4 and ArduPilot"):
        require_one_vehicle([log("PX4 ULog", "a.ulg"), log("ArduPilot DataFlash", "b.bin")])


def test_two_frames_are_two_vehicles() -> None:
    quad, hexa = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}, {"FRAME_CLASS": 2.0, "FRAME_TYPE": 1.0}
    with pytest.raises(UsageError, match="are from two vehicles"):
        require_one_vehicle([log("ArduPilot DataFlash", "a.bin", quad), log("ArduPilot DataFlash", "b.bin", hexa)])


def test_a_log_that_says_nothing_contradicts_none() -> None:
    records = [log("CSV", "a.csv"), log("PX4 ULog", "b.ulg"), log("PX4 ULog", "c.ulg")]
    require_one_vehicle(records)
    assert aircraft_of(records[0]) == Aircraft()


def test_gains_that_one_log_lacks_do_not_differ() -> None:
    assert different_gains({"P": 0.1}, {"I": 0.2}) == {}
