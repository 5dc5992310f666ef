"""Many flights at once: the same on any number of threads, and the same as alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.simulation import craft

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import RotoridError, UsageError
from rotorid.simulation.multirotor_flight import Aircraft, Sortie, columns, fly_batch, fly_multirotor, seed_of, whole
from rotorid.simulation.wind import Wind

GUSTY = Wind(north_m_s=3.0, turbulence_m_s=0.5)


def aircraft(mass_kg: float = 1.2) -> Aircraft:
    return Aircraft(vehicle=craft.vehicle(mass_kg=mass_kg), autopilot=craft.autopilot())


def sorties(count: int) -> Iterator[Sortie]:
    """Flights of heavier and heavier vehicles."""
    for index in range(count):
        yield Sortie(aircraft=aircraft(1.0 + 0.05 * index), duration_s=0.5, wind=GUSTY)


def test_any_number_of_threads_gives_the_same_flights() -> None:
    one, three = (
        list(fly_batch(sorties(7), columns("p", "motor_1"), seed=5, workers=workers, settle_s=0.2))
        for workers in (1, 3)
    )
    assert [each.index for each in three] == list(range(7))
    for first, second in zip(one, three, strict=True):
        assert first.seed == second.seed
        for name in ("p", "motor_1"):
            np.testing.assert_array_equal(first.result[name], second.result[name])


def test_a_flight_is_the_same_alone() -> None:
    found = list(fly_batch(sorties(4), whole, seed=5, settle_s=0.2))[3]
    assert found.seed == seed_of(5, 3)
    alone = fly_multirotor(aircraft(1.15), duration_s=0.5, wind=GUSTY, seed=found.seed, settle_s=0.2)
    np.testing.assert_array_equal(found.result.raw["q"], alone.raw["q"])


def test_nothing_is_left_of_the_flight_before() -> None:
    step = PlannedInput(
        axis="roll", shape="doublet", start_s=0.0, values=np.array([0.05]), sample_rate_hz=2.0, amplitude=0.05
    )
    plan = FlightPlan(name="step", inputs=(step,), trim_s=0.0)
    flights = [Sortie(aircraft=aircraft(), plan=plan, duration_s=1.0), Sortie(aircraft=aircraft(), duration_s=0.5)]
    _, after = fly_batch(flights, columns("p", "roll_command"), seed=5, workers=1, settle_s=0.0)
    alone = fly_multirotor(aircraft(), duration_s=0.5, seed=after.seed, settle_s=0.0)
    for name, values in after.result.items():
        np.testing.assert_array_equal(values, alone.columns[name])


def test_columns_are_those_of_the_whole_flight() -> None:
    names = ("p", "motor_1", "thrust_command")
    few = fly_batch(sorties(2), columns(*names), seed=5, settle_s=0.2)
    for one, other in zip(few, fly_batch(sorties(2), whole, seed=5, settle_s=0.2), strict=True):
        for name in names:
            np.testing.assert_array_equal(one.result[name], other.result.columns[name])
        assert columns(*names)(other.result).keys() == one.result.keys()
        with pytest.raises(ValueError, match="read-only"):
            one.result["p"][0] = 0.0


def test_seeds_of_their_own_are_kept_and_others_differ() -> None:
    own = [Sortie(aircraft=aircraft(), duration_s=0.2, seed=11) for _ in range(2)]
    same = [one.result["p"] for one in fly_batch(own, columns("p"), settle_s=0.0)]
    np.testing.assert_array_equal(same[0], same[1])
    given = [Sortie(aircraft=aircraft(), duration_s=0.2) for _ in range(2)]
    different = [one.result["p"] for one in fly_batch(given, columns("p"), settle_s=0.0)]
    assert np.all(different[0] != different[1])


def test_flights_that_fail_are_outcomes() -> None:
    heavy = replace(aircraft(), vehicle=craft.vehicle(mass_kg=20.0))
    flights = [Sortie(aircraft=one, duration_s=0.2) for one in (aircraft(), heavy, aircraft())]
    found = list(fly_batch(flights, columns("p"), settle_s=0.0))
    assert [one.error is None for one in found] == [True, False, True]
    with pytest.raises(RotoridError, match="too heavy"):
        _ = found[1].result
    missing = next(iter(fly_batch(flights[:1], columns("pp"), settle_s=0.0)))
    assert isinstance(missing.error, UsageError)


def test_flights_are_taken_as_they_are_needed() -> None:
    taken: list[int] = []

    def endless() -> Iterator[Sortie]:
        while True:
            taken.append(len(taken))
            yield Sortie(aircraft=aircraft(), duration_s=0.1)

    told: list[int] = []
    coming = fly_batch(endless(), columns("p"), workers=2, settle_s=0.0, progress=told.append)
    for wanted in range(3):
        assert next(coming).index == wanted
    coming.close()  # type: ignore[attr-defined]
    assert told == [1, 2, 3]
    assert len(taken) < 20


def test_errors_of_a_program_are_raised() -> None:
    def keep(_: object) -> float:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        list(fly_batch(sorties(2), keep, settle_s=0.0))
