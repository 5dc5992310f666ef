"""The delay of the velocity, from simulated motion whose stamps were moved; wind against bias."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from rotorid.data.quantity import Quantity
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.flight_faults import velocity_late, wind_or_bias
from rotorid.flights.velocity_stamps import VelocityDelay, prompt_velocity, velocity_delay
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

RATE_HZ, DURATION_S, DRAG_1_S = 200.0, 60.0, 0.4


def topic(name: str, names: str, time_s: FloatArray, values: FloatArray) -> Topic:
    channels = tuple(Channel(name=channel, unit=STANDARD_UNITS[channel]) for channel in names.split())
    return Topic(name=name, time_s=time_s, channels=channels, values=values)


@cache
def a_flight(late_s: float, *, body: bool = False, scale: float = 1.0, velocity_hz: float = 10.0) -> FlightRecord:
    """A vehicle that is tilted at random, with drag; its velocity is that of a while ago."""
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    waves = 2.0 * np.pi * rng.uniform(0.1, 1.5, size=(4, 12, 1)), rng.uniform(0.0, 6.0, size=(4, 12, 1))
    tilt_forward, tilt_right, turn, lift = np.sin(waves[0] * time_s + waves[1]).sum(axis=1) * 0.06
    attitude = np.stack([tilt_right, tilt_forward, 3.0 * turn])
    down = np.array([[0.0], [0.0], [STANDARD_GRAVITY_M_S2]])
    velocity, force = np.zeros((3, time_s.size)), np.zeros((3, time_s.size))
    for sample in range(time_s.size - 1):
        here = attitude[:, sample : sample + 1]
        drag = -DRAG_1_S * earth_to_body(here, velocity[:, sample : sample + 1])
        force[:, sample : sample + 1] = drag - down * (1.0 + lift[sample])
        force[2, sample] -= drag[2, 0]
        change = body_to_earth(here, force[:, sample : sample + 1]) + down
        velocity[:, sample + 1] = velocity[:, sample] + change[:, 0] / RATE_HZ
    force[:, -1] = force[:, -2]
    force[:2] *= scale
    logged = earth_to_body(attitude, velocity) if body else velocity
    every = round(RATE_HZ / velocity_hz)
    names = "u v w" if body else "velocity_north velocity_east velocity_down"
    return FlightRecord(
        source=Source(name="flight.csv", format="CSV", sha256=""),
        topics=(
            topic("imu", "ax ay az", time_s + 0.5 / RATE_HZ, force),
            topic("attitude", "phi theta psi", time_s, attitude),
            topic("velocity", names, time_s[::every] + late_s, logged[:, ::every]),
        ),
    )


def delay_of(record: FlightRecord) -> VelocityDelay:
    return velocity_delay(record, [(1.0, DURATION_S - 1.0)])


@pytest.mark.parametrize("late_s", [0.0, 0.11, 0.25])
@pytest.mark.parametrize("body", [False, True], ids=["earth", "body"])
def test_the_delay_of_a_velocity_comes_back(late_s: float, body: bool) -> None:
    found = delay_of(a_flight(late_s, body=body, velocity_hz=50.0 if body else 10.0))
    assert found.late_s.value == pytest.approx(late_s, abs=5e-3)


def test_an_accelerometer_that_shows_no_drag_does_not_move_the_delay() -> None:
    found = delay_of(a_flight(0.11, scale=0.0))
    assert found.late_s.value == pytest.approx(0.11, abs=0.01)


def test_a_late_velocity_is_a_warning_and_a_prompt_one_is_not() -> None:
    (finding,) = delay_of(a_flight(0.11)).findings("velocity")
    assert (finding.kind, finding.severity) == ("velocity_late", "warning")
    assert delay_of(a_flight(0.0)).findings("velocity") == ()
    assert velocity_late(Quantity.normal(0.06, 0.03, "s"), "velocity") == ()


def test_a_velocity_of_another_flight_is_refused() -> None:
    flight = a_flight(0.0)
    noise = np.random.default_rng(2).normal(size=flight.topics[2].values.shape)
    other = topic("velocity", "velocity_north velocity_east velocity_down", flight.topics[2].time_s, noise)
    record = FlightRecord(source=flight.source, topics=(*flight.topics[:2], other))
    with pytest.raises(InsufficientDataError, match="does not follow its acceleration"):
        delay_of(record)


def test_what_is_missing_is_named() -> None:
    flight = a_flight(0.0)
    with pytest.raises(InsufficientDataError, match="lacks phi"):
        delay_of(FlightRecord(source=flight.source, topics=(flight.topics[0], flight.topics[2])))
    with pytest.raises(InsufficientDataError, match="at 2 Hz"):
        delay_of(a_flight(0.0, velocity_hz=2.0))


def test_wind_and_bias_need_a_turn_of_the_heading() -> None:
    assert wind_or_bias(np.radians(120.0), "flight") == ()
    (finding,) = wind_or_bias(np.radians(20.0), "flight")
    assert (finding.kind, finding.severity) == ("wind_or_bias", "warning")
    assert "turned by 20°" in finding.message


def test_a_late_velocity_is_moved_and_a_prompt_one_is_left() -> None:
    late, prompt = a_flight(0.11), a_flight(0.0)
    moved, findings = prompt_velocity(late)
    assert [finding.kind for finding in findings] == ["velocity_late"]
    assert delay_of(moved).late_s.value == pytest.approx(0.0, abs=5e-3)
    assert [topic.time_s.tolist() for topic in moved.topics[:2]] == [topic.time_s.tolist() for topic in late.topics[:2]]
    assert prompt_velocity(prompt) == (prompt, ())
