"""Motors over the flights of a fleet: which changed at which flight, and who is out of balance."""

from __future__ import annotations

from typing import Any

import numpy as np
from tests.unit.flights.test_motor_balance import alone, patterns

from rotorid.documents.fleet import fleet_document
from rotorid.fleets.analysis import FleetAnalysis, analyze
from rotorid.fleets.table import REVIEW, Counts, LogAnswer, Row
from rotorid.fleets.verdicts import verdicts_of
from rotorid.flights.motor_balance import PATTERNS
from rotorid.report.fleet import notable

FLIGHTS, VEHICLES, DAMAGED, SINCE, MOTOR = 8, 6, 3, 6, 2


def row(vehicle: int, flight: int, parameter: str, value: float, std: float) -> Row:
    log = f"v{vehicle}-{flight:02d}.ulg"
    numbers: dict[str, Any] = {
        "value": value,
        "std": std,
        "std_random": std,
        "lower": value - std,
        "upper": value + std,
    }
    return Row(
        log=log,
        log_sha256=log,
        vehicle=f"v{vehicle}",
        time_utc="",
        flight=1,
        model=REVIEW,
        parameter=parameter,
        unit="1",
        findings="",
        format="PX4 ULog",
        firmware="",
        settings="",
        **numbers,
    )


def fleet_of(seed: int, *, rise: float = 0.12, imbalance: float = 0.05) -> FleetAnalysis:
    rng, rows = np.random.default_rng(seed), []
    for vehicle in range(1, VEHICLES + 1):
        own = 0.03 * rng.standard_normal(3)
        for flight in range(1, FLIGHTS + 1):
            values = own + 0.003 * rng.standard_normal(3)
            if vehicle == DAMAGED and flight >= SINCE:
                values = values + alone("quad.x", MOTOR, rise)
            rows += [
                row(vehicle, flight, f"motors.{name}", value, 0.001)
                for name, value in zip(PATTERNS, values, strict=True)
            ]
            rows.append(row(vehicle, flight, "motors.imbalance", imbalance if vehicle == 1 else 0.05, 0.01))
    return analyze(rows, patterns={one.log_sha256: patterns("quad.x") for one in rows})


def test_the_flight_and_the_motor_of_a_damaged_propeller_are_named() -> None:
    found = fleet_of(1)

    (cause,) = (one for one in found.causes if one.vehicle == f"v{DAMAGED}")
    assert cause.at_flight == SINCE
    assert cause.log == f"v{DAMAGED}-{SINCE:02d}.ulg"
    assert cause.words.startswith(f"output of motor {MOTOR} +")
    assert cause.usual == f"damaged propeller or weak motor {MOTOR}"
    assert {one.vehicle: one.verdict for one in verdicts_of(found)}[f"v{DAMAGED}"] == "changed"


def test_healthy_fleets_name_hardly_any_motor() -> None:
    assert sum(bool(fleet_of(seed, rise=0.0).causes) for seed in range(10)) <= 1


def test_motors_out_of_balance_are_looked_at_without_a_cause() -> None:
    found = fleet_of(2, imbalance=0.4)
    counts = Counts(logs=48, answered=48, refused=0, unreadable=0, duplicates=0, resumed=0, rows=192)
    document = fleet_document(found, failed=(), counts=counts, settings={})

    (one,) = document.out_of_balance
    assert (one.vehicle, one.flights, one.of_flights) == ("v1", FLIGHTS, FLIGHTS)
    (line,) = (item for item in notable(document) if "out of balance" in item.what)
    assert line.line == "v1: motors out of balance: 40 % in 8 of 8 flights, below 30 % is usual"
    assert not fleet_of(2).unbalanced


def test_patterns_go_through_the_journal() -> None:
    answer = LogAnswer(log="a", place="a", mark="", log_sha256="a", settings="", patterns=((1.0, -1.0, 1.0),))
    assert LogAnswer.from_json(answer.as_json()).patterns == answer.patterns
