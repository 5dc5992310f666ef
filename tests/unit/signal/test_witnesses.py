"""Each witness of a flight says yes, no or nothing; the first that speaks decides, and two overrule it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import airborne
from rotorid.signal.witnesses import Answer, Name, Witness, witnesses_of
from rotorid.typing import FloatArray

TIME_S = np.arange(0.0, 80.0, 0.02)
UP = np.clip(np.minimum(TIME_S - 20.0, 60.0 - TIME_S), 0.0, 1.0)
"""On the ground until 20 s and from 60 s on."""
RNG = np.random.default_rng(44)
STIR = RNG.standard_normal(TIME_S.size)


def topic(step: int = 1, **channels: FloatArray) -> Topic:
    return Topic(
        name="t",
        time_s=TIME_S[::step],
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        values=np.stack([values[::step] for values in channels.values()]),
    )


def record(*topics: Topic, firmware: str = "PX4", **status: Any) -> FlightRecord:
    source = Source(name="a.ulg", format="ulog", sha256="0" * 64, firmware=firmware)
    return FlightRecord(source=source, topics=topics, status=Status(**status))


def says(found: FlightRecord, name: Name, start_s: float, stop_s: float) -> Answer:
    witness: Witness = next(one for one in witnesses_of(found) if one.name == name)
    return witness.answer(start_s, stop_s)


def motors(level: FloatArray, prefix: str = "motor_") -> dict[str, FloatArray]:
    stirred = 0.03 * level
    return {f"{prefix}{number}": level + stirred * np.roll(STIR, number) for number in range(1, 5)}


FLOWN: dict[Name, Callable[[], FlightRecord]] = {
    "arming": lambda: record(topic(p=STIR), armed=((20.0, 60.0),)),
    "landed flag": lambda: record(topic(p=STIR), armed=((15.0, 65.0),), in_air=((20.0, 60.0),)),
    "mode": lambda: record(topic(p=STIR), modes=(("loiter", 0.0, 20.0), ("system identification", 20.0, 60.0))),
    "throttle": lambda: record(topic(thrust_command=(0.4 + 0.02 * STIR) * UP)),
    "motor outputs": lambda: record(topic(**motors(0.05 + 0.45 * UP))),
    "motor speeds": lambda: record(topic(**motors(200.0 + 600.0 * UP, "motor_speed_"))),
    "current": lambda: record(topic(battery_current=0.6 + (12.0 + STIR) * UP)),
    "height": lambda: record(topic(10, down=-6.0 * UP + 0.01 * STIR)),
    "motion": lambda: record(topic(p=(0.005 + UP) * STIR, q=(0.005 + UP) * np.roll(STIR, 7))),
}
"""A log of each that shows its flight."""

NEVER: dict[Name, Callable[[], FlightRecord]] = {
    "arming": lambda: record(topic(p=STIR), armed=()),
    "landed flag": lambda: record(topic(p=STIR), armed=((15.0, 65.0),), in_air=()),
    "throttle": lambda: record(topic(thrust_command=0.0 * UP)),
    "motor outputs": lambda: record(topic(**motors(np.full(TIME_S.size, 0.0)))),
    "motion": lambda: record(topic(p=0.0 * STIR)),
}
"""A log of each that shows that there was none."""

SILENT: dict[Name, Callable[[], FlightRecord]] = {
    "arming": lambda: record(topic(p=STIR)),
    "landed flag": lambda: record(topic(p=STIR), armed=((15.0, 65.0),)),
    "mode": lambda: record(topic(p=STIR), modes=(("loiter", 0.0, 80.0),)),
    # It counts from hover; it is constant; it is a column of a table that nobody moved.
    "throttle": lambda: record(topic(thrust_command=0.05 * STIR)),
    "motor outputs": lambda: record(topic(**dict.fromkeys(("motor_1", "motor_2"), np.full(TIME_S.size, 0.5)))),
    # Telemetry that is not connected.
    "motor speeds": lambda: record(topic(**motors(0.0 * UP, "motor_speed_"))),
    "current": lambda: record(topic(battery_current=0.0 * UP)),
    # A hover that begins and ends in the air.
    "height": lambda: record(topic(10, down=-6.0 + 0.01 * STIR)),
    # A gyro that never moves.
    "motion": lambda: record(topic(p=0.0 * STIR, q=0.0 * STIR, r=0.0 * STIR)),
}
"""A log of each that shows nothing."""


@pytest.mark.parametrize("name", FLOWN)
def test_a_witness_shows_a_flight(name: Name) -> None:
    found = FLOWN[name]()
    assert says(found, name, 25.0, 55.0) == ("nothing" if name == "arming" else "yes")
    assert says(found, name, 2.0, 12.0) == ("nothing" if name == "mode" else "no")


@pytest.mark.parametrize("name", NEVER)
def test_a_witness_denies_a_flight(name: Name) -> None:
    assert says(NEVER[name](), name, 25.0, 55.0) == "no"
    with pytest.raises(InsufficientDataError, match="no flight"):
        airborne(NEVER[name]())


@pytest.mark.parametrize("name", SILENT)
def test_a_witness_says_nothing(name: Name) -> None:
    assert says(SILENT[name](), name, 25.0, 55.0) == "nothing"


@pytest.mark.parametrize("name", [name for name in FLOWN if name not in ("arming", "mode")])
def test_each_alone_shows_the_flight(name: Name) -> None:
    (flight,) = airborne(FLOWN[name]()).intervals
    assert flight == pytest.approx((20.5, 59.5), abs=0.6)


@pytest.mark.parametrize("hertz", [1.0, 10.0])
def test_slow_logs_show_it_to_a_sample(hertz: float) -> None:
    step = round(50.0 / hertz)
    (flight,) = airborne(record(topic(step, thrust_command=(0.4 + 0.02 * STIR) * UP))).intervals
    assert flight == pytest.approx((21.0, 59.0), abs=1.0 / hertz + 0.1)


def test_an_attitude_alone_shows_motion() -> None:
    angles = {"phi": 0.2 * UP * np.sin(3.0 * TIME_S), "theta": 0.2 * UP * np.cos(2.0 * TIME_S)}
    found = airborne(record(topic(5, **angles)))
    assert found.longest == pytest.approx((20.0, 60.0), abs=0.8)
    assert not found.by_thrust


def test_flags_that_came_late_are_filled_by_thrust() -> None:
    thrust = topic(thrust_command=(0.4 + 0.02 * STIR) * UP)
    late = record(thrust, armed=((40.0, 62.0),), in_air=((40.0, 60.0),), unlogged=((0.0, 40.0),), flagged_in="flag")
    found = airborne(late)
    assert found.longest == pytest.approx((21.0, 59.0), abs=0.3)
    assert found.seen_in == "flag and thrust_command"
    # Without what is unknown, the flag denies what came before it.
    known = replace(late, status=replace(late.status, unlogged=()))
    assert airborne(known).longest[0] == 40.0


def test_a_vehicle_whose_motors_never_ran_did_not_fly() -> None:
    carried = topic(p=STIR, q=np.roll(STIR, 3), r=np.roll(STIR, 9), **motors(0.0 * UP))
    for status in ({}, {"armed": ((0.0, 80.0),)}, {"in_air": ((20.0, 60.0),), "armed": ((0.0, 80.0),), "early": True}):
        with pytest.raises(InsufficientDataError) as caught:
            airborne(record(carried, **status))
        assert [finding.kind for finding in caught.value.findings] == ["never_airborne"]


def test_motors_that_idle_while_a_hand_moves_the_vehicle_are_no_flight() -> None:
    idle = {f"motor_{number}": np.where(UP > 0.0, 0.1, 0.0) for number in range(1, 5)}
    bench = record(topic(p=STIR, q=STIR, r=STIR, **idle), armed=((20.0, 60.0),))
    with pytest.raises(InsufficientDataError, match="the motors never ran"):
        airborne(bench)
    # In airmode they work against the hand, at a throttle of zero.
    airmode = topic(p=STIR, thrust_command=0.0 * UP, thrust_stick=0.0 * UP, **motors(0.1 + 0.2 * UP))
    with pytest.raises(InsufficientDataError, match="the throttle never rose"):
        airborne(record(airmode, armed=((20.0, 60.0),), firmware="Betaflight"))


EARLY: dict[str, Any] = {"armed": ((15.0, 65.0),), "in_air": ((20.0, 60.0),), "early": True, "flagged_in": "EV"}


def test_a_calm_hover_is_a_flight_by_thrust_or_height() -> None:
    """33 s and more without turning or accelerating: indoors, or in a quiet simulator."""
    calm = {"p": 1e-3 * STIR, "q": 1e-3 * STIR, "r": 1e-3 * STIR}
    hover = (0.3 + 0.01 * STIR) * UP
    assert airborne(record(topic(thrust_command=hover, **calm), **EARLY)).longest[1] == pytest.approx(59.0, abs=0.3)
    assert len(airborne(record(topic(down=-1.5 * UP, **calm), **EARLY)).intervals) == 1
    # Who stands with a raised throttle neither moves nor climbs.
    with pytest.raises(InsufficientDataError, match="nothing else confirms it"):
        airborne(record(topic(thrust_command=hover, down=0.01 * STIR, **calm), **EARLY))


def test_a_lost_take_off_is_found_by_thrust_and_height() -> None:
    found = airborne(
        record(
            topic(thrust_command=(0.4 + 0.02 * STIR) * UP, down=-5.0 * UP + 0.01 * STIR),
            armed=((15.0, 65.0),),
            in_air=(),
            early=True,
            flagged_in="EV",
        )
    )
    assert found.longest == pytest.approx((21.0, 59.0), abs=0.3)


def test_an_early_flag_begins_where_thrust_carries_and_a_late_one_ends_there() -> None:
    height = 5.0 * np.clip(np.minimum(TIME_S - 21.0, 59.0 - TIME_S), 0.0, 1.0)
    thrust = topic(thrust_command=(0.4 + 0.02 * STIR) * UP, down=0.01 * STIR - height)
    flags = EARLY | {"armed": ((10.0, 65.0),), "in_air": ((12.0, 61.5),)}
    assert airborne(record(thrust, **flags)).longest == pytest.approx((21.0, 59.0), abs=0.3)


def test_a_climb_above_hover_does_not_hide_the_hover() -> None:
    """At 95 % of the throttle for the first half, then a landing at 40 %."""
    level = np.where(TIME_S < 40.0, 0.9, 0.4)
    (flight,) = airborne(record(topic(thrust_command=(level + 0.02 * STIR) * UP))).intervals
    assert flight == pytest.approx((20.7, 59.3), abs=0.6)
