"""Channels that contradict each other in the mean are named; those of a sound flight are not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.flights.agreement import channel_agreement
from rotorid.typing import FloatArray

TIME_S = np.arange(0.0, 60.0, 0.01)
FLIGHT = ((0.0, float(TIME_S[-1])),)


def rows() -> dict[str, FloatArray]:
    """A minute of swinging from side to side with a climb, exact but for noise of the sensors."""
    rng = np.random.default_rng(1)
    phi, theta = 0.3 * np.sin(1.1 * TIME_S), 0.2 * np.cos(0.7 * TIME_S)
    climb_rate = 0.8 * np.sin(0.2 * TIME_S)
    down_dot = -np.gradient(climb_rate, TIME_S)
    lift = (down_dot - 9.80665) / (np.cos(phi) * np.cos(theta))
    north_speed = 3.0 * np.sin(0.4 * TIME_S)
    return {
        "phi": phi,
        "theta": theta,
        "p": np.gradient(phi, TIME_S),
        "ax": 0.1 * rng.normal(size=TIME_S.size),
        "ay": 0.1 * rng.normal(size=TIME_S.size),
        "az": lift + 0.3 * rng.normal(size=TIME_S.size),
        "velocity_down": -climb_rate,
        "velocity_north": north_speed,
        "north": np.cumsum(north_speed) * 0.01 + 0.1 * rng.normal(size=TIME_S.size),
    }


def record(channels: dict[str, FloatArray], copy_of_p: FloatArray | None = None) -> FlightRecord:
    topics = [
        Topic(name=name, time_s=TIME_S, channels=(Channel(name=name, unit=STANDARD_UNITS[name]),), values=row[None])
        for name, row in channels.items()
    ]
    if copy_of_p is not None:
        gyro = (Channel(name="p", unit="rad/s"),)
        topics.append(Topic(name="IMU2", time_s=TIME_S, channels=gyro, values=copy_of_p[None]))
    return FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=tuple(topics))


def test_sound_channels_agree() -> None:
    sound = rows()
    noisy = sound["p"] + 0.2 * np.random.default_rng(2).normal(size=TIME_S.size)
    assert channel_agreement(record(sound, noisy), FLIGHT) == ()


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        (lambda found: {"az": 0.8 * found["az"]}, "az", "0.80 g"),
        (lambda found: {"az": -found["az"]}, "az", "-1.00 g"),
        (lambda found: {"velocity_north": 0.01 * found["velocity_north"]}, "", ""),
        (lambda found: {"north": 3.0 * found["north"]}, "velocity_north", "3.00 times"),
        (lambda found: {"north": -found["north"]}, "velocity_north", "-1.00 times"),
    ],
)
def test_a_channel_of_another_scale_is_named(
    change: Callable[[dict[str, FloatArray]], dict[str, FloatArray]], where: str, words: str
) -> None:
    sound = rows()
    found = channel_agreement(record(sound | change(sound)), FLIGHT)
    assert [finding.where for finding in found] == [where] * bool(where)
    assert all(words in finding.message for finding in found)


def test_a_position_with_resets_agrees() -> None:
    sound = rows()
    jumps = np.zeros(TIME_S.size)
    jumps[[1500, 3000, 4500]] = 5.0
    assert channel_agreement(record(sound | {"north": sound["north"] + np.cumsum(jumps)}), FLIGHT) == ()


@pytest.mark.parametrize("copy", [lambda p: 0.5 * p, lambda p: np.roll(p, 700)], ids=["scale", "another motion"])
def test_a_gyro_that_contradicts_its_copy_is_named(copy: Callable[[FloatArray], FloatArray]) -> None:
    sound = rows()
    (found,) = channel_agreement(record(sound, copy(sound["p"])), FLIGHT)
    assert found.where == "p"
    assert "IMU2" in found.message


def test_unknown_is_not_wrong() -> None:
    sound = rows()
    assert channel_agreement(record({"az": 0.5 * sound["az"]}), FLIGHT) == ()
    assert channel_agreement(record(sound | {"az": 0.5 * sound["az"]}), ((0.0, 10.0),)) == ()
