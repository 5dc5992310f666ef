"""Sensors that measure nothing are named, show no flight, and nothing is computed from them."""

from __future__ import annotations

import numpy as np
import pytest

import rotorid
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.reviewing.cards import cards
from rotorid.reviewing.inspection import inspect
from rotorid.signal.airborne import airborne
from rotorid.signal.dead_sensors import dead_accelerometer, dead_gyro
from rotorid.typing import FloatArray

TIME_S = np.arange(0.0, 30.0, 0.02)
RNG = np.random.default_rng(5)
NOISE = RNG.standard_normal((6, TIME_S.size))


def record(**channels: FloatArray) -> FlightRecord:
    topic = Topic(
        name="imu",
        time_s=TIME_S,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        values=np.stack([np.broadcast_to(values, TIME_S.shape) for values in channels.values()]),
    )
    return FlightRecord(source=Source(name="a.bag", format="ROS bag", sha256="0" * 64), topics=(topic,))


def rates(scale: float = 0.2) -> dict[str, FloatArray]:
    return dict(zip(("p", "q", "r"), scale * NOISE[:3], strict=True))


def forces(scale: float = 1.0, gravity: float = -9.81) -> dict[str, FloatArray]:
    found = dict(zip(("ax", "ay", "az"), scale * NOISE[3:], strict=True))
    return found | {"az": found["az"] + gravity}


SIMULATED = {
    name: np.random.default_rng(place).uniform(-9.8, 9.8, TIME_S.size) for place, name in enumerate(("ax", "ay", "az"))
}
"""As a stub of a simulator sends them."""


def test_a_gyro_is_dead_when_all_of_it_is_constant() -> None:
    assert "never moves" in dead_gyro(record(**rates(0.0)))
    assert dead_gyro(record(**rates(0.0) | {"r": np.asarray(0.001 * NOISE[0])})) == ""
    # Of one axis alone, as of a rig or a linear simulation, nothing is known.
    assert dead_gyro(record(p=np.zeros(TIME_S.size))) == ""


@pytest.mark.parametrize(
    ("channels", "dead"),
    [
        (SIMULATED, True),
        (forces(0.0, 0.0), True),
        # In g instead of m/s².
        (forces(0.1, -1.0), True),
        (forces(), False),
        (forces(4.0), False),
        (forces(1.0, -1.8 * 9.81), False),
        # Half of the log upside down.
        (forces() | {"az": np.where(TIME_S < 15.0, -9.81, 9.81)}, False),
    ],
    ids=["uniform", "zeros", "g", "flight", "vibration", "turns", "upside down"],
)
def test_an_accelerometer_is_dead_without_gravity(channels: dict[str, FloatArray], dead: bool) -> None:
    assert bool(dead_accelerometer(record(**channels))) == dead


def test_dead_sensors_show_no_flight_and_are_named() -> None:
    stub = record(**rates(0.0), **SIMULATED)
    with pytest.raises(InsufficientDataError) as caught:
        airborne(stub)
    assert [finding.kind for finding in caught.value.findings] == ["never_airborne", "dead_sensor", "dead_sensor"]
    assert "The gyro never moves" in str(caught.value)
    assert "gravity is 9.8 m/s²" in str(caught.value)
    inspected = inspect(stub)
    assert inspected.flights == ()
    assert {"never_airborne", "dead_sensor"} <= {finding.kind for finding in inspected.findings}
    assert {card.state for card in cards(rotorid.review(stub, models=False))} == {"cannot"}


def test_what_depends_on_a_dead_sensor_says_so() -> None:
    flown = record(**rates(0.0), **SIMULATED, thrust_command=0.4 + 0.02 * NOISE[0])
    reviewed = rotorid.review(flown, models=False)
    assert reviewed.flight.flights
    why = {gap.what: gap.why for gap in reviewed.cannot_tell}
    assert all("gyro never moves" in why[what] for what in ("loops", "margins", "oscillations", "noise.maps"))
    assert "gravity" in why["noise.vibration_m_s2"]
    assert "vibration_m_s2" not in reviewed.noise.numbers
    assert [finding.where for finding in reviewed.findings if finding.kind == "dead_sensor"] == [
        "gyro",
        "accelerometer",
    ]
    assert "good" not in {card.state for card in cards(reviewed)}


def test_no_card_is_green_where_motion_alone_shows_the_flight() -> None:
    carried = record(**rates(), **forces(0.2))
    reviewed = rotorid.review(carried, models=False)
    assert reviewed.flight.seen_in.startswith("the activity of")
    assert "good" not in {card.state for card in cards(reviewed)}
