"""Is the motor named that lost thrust, at its first flight, and is a healthy one left alone?

20 simulated vehicles, five healthy flights each, then one with a rotor that lost 3 to 15 % of its thrust; and 200
further healthy flights with all figures but those of loops, 20 with these too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
from tests.twins.health_flights import RATES_HZ, Loss, flight_of

import rotorid
from rotorid.flights.motor_balance import PATTERNS, BalanceChange, balance_change
from rotorid.reviewing.baseline import compared
from rotorid.reviewing.motors import motors
from rotorid.reviewing.values import MotorReview, Review

VEHICLES, EARLIER = 20, 5
SHARES = (0.03, 0.05, 0.08, 0.11, 0.15)
FURTHER = 5
NAMED = 0.9
FALSE = 0.01


def seen(name: str, vehicle: int, flight: int, loss: Loss | None = None) -> MotorReview | None:
    found, _ = motors(flight_of(name, vehicle, flight, loss))
    return found if PATTERNS[0] in found.numbers else None


def column(found: MotorReview, what: str) -> np.ndarray:
    return np.array([getattr(found.numbers[name], what) for name in PATTERNS])


def answer(earlier: list[MotorReview], found: MotorReview | None) -> BalanceChange | None:
    if found is None or found.patterns is None:
        return None
    return balance_change(
        np.stack([column(one, "value") for one in earlier]),
        np.stack([column(one, "std") for one in earlier]),
        column(found, "value"),
        column(found, "std"),
        patterns=found.patterns,
    )


def answers(name: str, vehicles: range) -> Iterator[tuple[float, int, BalanceChange | None]]:
    """Share of thrust that was lost, the rotor, and what was said at the first flight."""
    for vehicle in vehicles:
        earlier = [found for flight in range(1, EARLIER + 1) if (found := seen(name, vehicle, flight)) is not None]
        rotor = 1 + vehicle % 4
        for share in SHARES:
            yield share, rotor, answer(earlier, seen(name, vehicle, EARLIER + 1, Loss(rotor=rotor, share=share)))


def checked(name: str, vehicles: range) -> None:
    given = list(answers(name, vehicles))
    for share in SHARES:
        own = [(rotor, found) for lost, rotor, found in given if lost == share]
        said = [(rotor, found) for rotor, found in own if found is not None]
        changed = sum(found.verdict == "changed" for _, found in said)
        right = sum(found.motor == rotor for rotor, found in said)
        wrong = sum(found.motor not in (None, rotor) for rotor, found in said)
        print(f"{name} −{100 * share:.0f} %: {len(own)} flights, {len(said)} hovered, {changed} changed, {right} named")
        assert not wrong
        if share >= 0.08:
            assert right >= NAMED * len(own), (name, share, right, len(own))


@pytest.mark.slow
@pytest.mark.parametrize("name", RATES_HZ)
def test_the_motor_is_named_at_its_first_flight(name: str) -> None:
    checked(name, range(1, VEHICLES + 1))


def test_the_motor_of_two_vehicles_is_named_at_its_first_flight() -> None:
    checked("crazyflie", range(1, 3))


def reviewed(name: str, vehicle: int, flight: int, *, loops: bool) -> Review:
    found = rotorid.review(flight_of(name, vehicle, flight, loops=loops), models=False)
    # The pictures are not compared, and take room.
    return dataclasses.replace(found, noise=dataclasses.replace(found.noise, maps=()))


@pytest.mark.slow
@pytest.mark.parametrize(("vehicles", "loops"), [(VEHICLES, False), (2, True)])
@pytest.mark.parametrize("name", RATES_HZ)
def test_healthy_flights_raise_few_false_alarms_over_all_figures(name: str, vehicles: int, loops: bool) -> None:
    alarms, flights, checked_figures = [], 0, []
    for vehicle in range(1, vehicles + 1):
        earlier = [reviewed(name, vehicle, flight, loops=loops) for flight in range(1, EARLIER + 1)]
        for flight in range(EARLIER + 1, EARLIER + 1 + FURTHER):
            found = compared(reviewed(name, vehicle, flight, loops=loops), earlier)
            flights += 1
            checked_figures.append(len(found.figures))
            if found.verdict == "changed":
                alarms.append((vehicle, flight, found.sentences[0]))
    print(f"{name}: {len(alarms)} of {flights} healthy flights, {np.mean(checked_figures):.0f} figures each", alarms)
    assert len(alarms) <= FALSE * flights
