"""What is taken along around maneuvers, and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Kind, Maneuver, Origin, Source, Topic
from rotorid.flights.flights import Flight
from rotorid.flights.segments import with_surroundings
from rotorid.typing import Axis


def record(*declared: Maneuver, name: str = "flight") -> FlightRecord:
    time_s = np.arange(0.0, 200.0, 0.01)
    topic = Topic(
        name="all", time_s=time_s, channels=(Channel(name="p", unit="rad/s"),), values=np.zeros((1, time_s.size))
    )
    source = Source(name=name, format="CSV", sha256=name)
    return FlightRecord(source=source, topics=(topic,), declared=declared)


def maneuver(
    start_s: float, stop_s: float, *, axis: Axis = "roll", kind: Kind = "sweep", origin: Origin = "declared"
) -> Maneuver:
    return Maneuver(axis=axis, kind=kind, start_s=start_s, stop_s=stop_s, origin=origin)


def spans(flown: tuple[Flight, ...]) -> list[tuple[float, float]]:
    return [(one.maneuver.start_s, one.maneuver.stop_s) for one in flown]


def test_a_maneuver_takes_its_surroundings_along() -> None:
    sweep = maneuver(50.0, 80.0)
    assert spans(with_surroundings([Flight(record(sweep), sweep)], 10.0)) == [(40.0, 90.0)]


def test_the_record_is_the_limit() -> None:
    sweep = maneuver(3.0, 198.0)
    assert spans(with_surroundings([Flight(record(sweep), sweep)], 10.0)) == [(0.0, pytest.approx(199.99))]


def test_neighbors_that_touch_become_one_and_are_not_counted_twice() -> None:
    sweeps = (maneuver(20.0, 50.0), maneuver(60.0, 90.0), maneuver(130.0, 160.0))
    log = record(*sweeps)
    assert spans(with_surroundings([Flight(log, m) for m in reversed(sweeps)], 10.0)) == [(10.0, 100.0), (120.0, 170.0)]


def test_other_maneuvers_are_barriers() -> None:
    sweep = maneuver(50.0, 80.0)
    doublet, pitch = maneuver(84.0, 86.0, kind="doublet"), maneuver(10.0, 45.0, axis="pitch")
    assert spans(with_surroundings([Flight(record(pitch, sweep, doublet), sweep)], 10.0)) == [(45.0, 84.0)]


def test_what_the_user_gave_is_obeyed() -> None:
    given = maneuver(50.0, 80.0, origin="given")
    assert spans(with_surroundings([Flight(record(), given)], 10.0)) == [(50.0, 80.0)]


def test_records_stay_apart() -> None:
    sweep = maneuver(50.0, 80.0)
    logs = [record(sweep, name="a"), record(sweep, name="b")]
    assert [one.record.source.name for one in with_surroundings([Flight(log, sweep) for log in logs], 60.0)] == [
        "a",
        "b",
    ]
