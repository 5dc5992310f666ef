"""Two, three, five or ten flights: is a change found, and is none found where there was none?

120 simulated flights of 12 vehicles in wind; six of them are changed after their fifth flight. Every analysis sees some
of the flights of one vehicle, or of all of them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from tests.twins.fleet_flights import Event, write_fleet

from rotorid.fleets import FleetSettings, Row, analyze, fleet
from rotorid.fleets.verdicts import verdicts_of

VEHICLES, FLIGHTS, AFTER = 12, 10, 5
EVENTS = (
    Event(vehicle=1, flight=AFTER + 1, factors={"thrust": 0.95}),
    Event(vehicle=2, flight=AFTER + 1, factors={"thrust": 0.92}),
    Event(vehicle=3, flight=AFTER + 1, factors={"thrust": 0.8}),
    Event(vehicle=4, flight=AFTER + 1, factors={"I_xx": 1.15, "I_yy": 1.15}),
    Event(vehicle=5, flight=AFTER + 1, factors={"I_xx": 1.5, "I_yy": 1.5}),
    Event(vehicle=6, flight=AFTER + 1, factors={}, lag_s=0.006),
)
NAMES = ("thrust −5 %", "thrust −8 %", "thrust −20 %", "inertia +15 %", "inertia +50 %", "lag +6 ms (of 48)")
MODELS = ("rate.roll", "rate.pitch", "physical.motors")
COUNTS = (2, 3, 5, 10)


def number_of(row: Row) -> tuple[int, int]:
    _, vehicle, flight = row.log.removesuffix(".ulg").split("-")
    return int(vehicle), int(flight)


def spanning(count: int) -> Iterator[tuple[int, ...]]:
    """Flights on both sides of a change."""
    before = max(count // 2, 1)
    for shift in range(3 if count < FLIGHTS else 1):
        start = AFTER - before + 1 - min(shift, AFTER - before)
        yield (*range(start, start + before), *range(AFTER + 1 + shift, AFTER + 1 + shift + count - before))


def quiet(vehicle: int, count: int) -> Iterator[tuple[int, ...]]:
    """Flights of a vehicle without a change, each in one group."""
    last = AFTER if vehicle <= len(EVENTS) else FLIGHTS
    for start in range(1, last - count + 2, count):
        yield tuple(range(start, start + count))


def verdicts(rows: Iterable[Row]) -> dict[str, str]:
    return {one.vehicle: one.verdict for one in verdicts_of(analyze(rows))}


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    kept = os.environ.get("ROTORID_FEW_FLIGHTS_STUDY")
    folder = Path(kept) if kept else tmp_path_factory.mktemp("few")
    if not (folder / "logs").exists():
        write_fleet(folder / "logs", vehicles=VEHICLES, flights=FLIGHTS, events=EVENTS, seed=3)
    return list(fleet(folder / "logs", settings=FleetSettings(models=MODELS, workers=1), out=folder / "out"))


@pytest.mark.slow
def test_few_flights_raise_few_false_alarms(rows: list[Row]) -> None:
    for count in COUNTS:
        found = [
            verdicts(row for row in rows if number_of(row)[0] == vehicle and number_of(row)[1] in flights)
            for vehicle in range(1, VEHICLES + 1)
            for flights in quiet(vehicle, count)
        ]
        said = [verdict for one in found for verdict in one.values()]
        print(count, "flights:", {name: said.count(name) for name in ("changed", "unchanged", "undecided")})
        assert said.count("changed") <= 0.05 * len(said), (count, said)


@pytest.mark.slow
@pytest.mark.parametrize("event", EVENTS, ids=NAMES)
def test_a_change_is_found_or_left_open_but_never_denied_where_it_is_large(rows: list[Row], event: Event) -> None:
    large = any(abs(factor - 1.0) >= 0.2 for factor in event.factors.values())
    for count in COUNTS:
        said = [
            verdict
            for flights in spanning(count)
            for verdict in verdicts(
                row for row in rows if number_of(row)[0] == event.vehicle and number_of(row)[1] in flights
            ).values()
        ]
        print(count, "flights:", said)
        assert not large or "unchanged" not in said


@pytest.mark.slow
@pytest.mark.parametrize("count", COUNTS)
def test_all_vehicles_together(rows: list[Row], count: int) -> None:
    flights = next(spanning(count))
    said = verdicts(row for row in rows if number_of(row)[1] in flights)
    changed = {int(vehicle.removeprefix("quad-")) for vehicle, verdict in said.items() if verdict == "changed"}
    print(count, "flights:", sorted(changed))
    assert {3, 4, 5, 6} <= changed
    assert changed <= {event.vehicle for event in EVENTS}
