"""Does a fleet's table say what was changed, and nothing else? 400 simulated flights, and fleets of numbers alone."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from tests.twins.fleet_flights import Event, write_fleet

from rotorid.fleets import FleetSettings, Row, analyze, fleet, population
from rotorid.fleets.analysis import FleetAnalysis, History

VEHICLES = FLIGHTS = 20
PROPELLERS = Event(vehicle=3, flight=9, factors={"thrust": 0.92})
PAYLOAD = Event(vehicle=7, flight=12, factors={"I_xx": 1.15, "I_yy": 1.15})
ESC = Event(vehicle=12, flight=15, factors={}, lag_s=0.006)
ODD = Event(vehicle=17, flight=1, factors={"I_xx": 1.2})
EVENTS = (PROPELLERS, PAYLOAD, ESC)
MODELS = ("rate.roll", "rate.pitch", "physical.motors")
WITHIN_FLIGHTS = 3
TOLD_BY = {
    PROPELLERS.vehicle: {"L_roll", "M_pitch", "thrust_slope"},
    PAYLOAD.vehicle: {"L_roll", "M_pitch", "I_xx", "I_yy"},
    ESC.vehicle: {"T_motor"},
}


def number_of(history: History) -> int:
    return int(history.vehicle.removeprefix("quad-"))


def synthetic(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, stated errors, vehicles: mean 5, between 0.3, within 0.1."""
    rng = np.random.default_rng(seed)
    who = np.repeat(np.arange(20), 20)
    stated = rng.uniform(0.02, 0.2, 400)
    values = 5.0 + rng.normal(0, 0.3, 20)[who] + rng.normal(0, 0.1, 400) + rng.normal(0, stated)
    return values, stated, who


def coverage(fleets: int) -> dict[str, float]:
    inside = dict.fromkeys(("mean", "between", "within", "normal"), 0.0)
    for seed in range(fleets):
        values, stated, who = synthetic(seed)
        found = population(values, stated, who, unit="1")
        assert found.between is not None
        assert found.within is not None
        inside["mean"] += found.mean.lower <= 5.0 <= found.mean.upper
        inside["between"] += found.between.lower <= 0.3 <= found.between.upper
        inside["within"] += found.within.lower <= 0.1 <= found.within.upper
        new = 5.0 + np.random.default_rng([seed, 1]).normal(0, np.hypot(0.3, 0.1), 1000)
        inside["normal"] += float(np.mean((found.low < new) & (new < found.high)))
    return {name: count / fleets for name, count in inside.items()}


@pytest.mark.slow
def test_spreads_and_normal_ranges_hold_what_they_promise_over_200_fleets() -> None:
    found = coverage(200)
    print(found)
    assert all(0.90 <= share <= 0.99 for share in found.values()), found


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    kept = os.environ.get("ROTORID_FLEET_STUDY")
    folder = Path(kept) if kept else tmp_path_factory.mktemp("fleet")
    if not (folder / "logs").exists():
        write_fleet(folder / "logs", vehicles=VEHICLES, flights=FLIGHTS, events=(*EVENTS, ODD), seed=1)
    return list(fleet(folder / "logs", settings=FleetSettings(models=MODELS), out=folder / "out"))


def flights_until(rows: list[Row], last: dict[int, int]) -> FleetAnalysis:
    """What was said when each vehicle had flown so often."""
    kept = [
        row
        for row in rows
        if int(row.log.split("-")[2].removesuffix(".ulg")) <= last.get(int(row.log.split("-")[1]), FLIGHTS)
    ]
    return analyze(kept)


@pytest.mark.slow
def test_every_log_answers(rows: list[Row]) -> None:
    assert len({row.log for row in rows}) == VEHICLES * FLIGHTS


@pytest.mark.slow
@pytest.mark.parametrize("event", EVENTS, ids=["propellers", "payload", "esc"])
def test_a_change_is_found_within_three_flights(rows: list[Row], event: Event) -> None:
    told = flights_until(rows, {event.vehicle: event.flight + WITHIN_FLIGHTS - 1})
    own = [one for one in told.changed if number_of(one) == event.vehicle]
    for one in own:
        print(one.model, one.parameter, [(change.at_flight, round(change.ratio, 3)) for change in one.changes])
    right = [one for one in own if one.parameter in TOLD_BY[event.vehicle]]
    assert right
    assert all(one.changes[0].at_flight == event.flight for one in right)


@pytest.mark.slow
def test_the_odd_vehicle_is_found_and_hardly_any_other(rows: list[Row]) -> None:
    told = analyze(rows)
    odd = {(number_of(one), one.parameter) for one in told.histories if one.odd_vehicle is not None}
    print(sorted(odd))
    assert (ODD.vehicle, "L_roll") in odd
    others = {entry for entry in odd if entry[0] != ODD.vehicle}
    assert len(others) <= 0.05 * len(told.histories)


@pytest.mark.slow
def test_false_alarms_are_rare(rows: list[Row]) -> None:
    told = analyze(rows)
    changed = {event.vehicle for event in EVENTS}
    quiet = [one for one in told.histories if number_of(one) not in changed]
    alarms = [one for one in quiet if one.changes or one.drift]
    print(len(alarms), len(quiet), [(one.vehicle, one.parameter) for one in alarms])
    assert len(alarms) <= 0.05 * len(quiet)
