"""Cutting: what lies on the ground is cut off, and channels that nobody logged are made of those that were."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import Flight
from rotorid.flights.segments import cut
from rotorid.typing import FloatArray

RATE_HZ = 100.0
TIME_S = np.arange(0.0, 60.0, 1.0 / RATE_HZ)


def record(**channels: FloatArray) -> FlightRecord:
    topic = Topic(
        name="clock",
        time_s=TIME_S,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=name) for name in channels),
        values=np.stack(list(channels.values())),
    )
    return FlightRecord(source=Source(name="a.csv", format="CSV", sha256="a"), topics=(topic,))


def roll(start_s: float, stop_s: float) -> Maneuver:
    return Maneuver(axis="roll", kind="other", start_s=start_s, stop_s=stop_s, origin="given")


FLIGHT = np.where((TIME_S >= 10.0) & (TIME_S < 50.0), 0.4, 0.0)


@pytest.mark.parametrize(
    ("given", "kept"), [((5.0, 45.0), (10.0, 45.0)), ((20.0, 58.0), (20.0, 49.99)), ((20.0, 40.0), (20.0, 40.0))]
)
def test_a_maneuver_ends_where_the_flight_does(given: tuple[float, float], kept: tuple[float, float]) -> None:
    segments, findings = cut([Flight(record(p=np.sin(TIME_S), thrust_command=FLIGHT), roll(*given))], channels=("p",))
    (segment,) = segments
    assert (segment.maneuver.start_s, segment.maneuver.stop_s) == pytest.approx(kept)
    assert segment.history.time_s[[0, -1]] == pytest.approx(kept)
    said = [f.severity for f in findings if f.kind == "airborne"]
    assert said == (["warning"] if given != kept else [])


def test_a_maneuver_on_the_ground_is_used_and_said_so() -> None:
    segments, findings = cut(
        [Flight(record(p=np.sin(TIME_S), thrust_command=FLIGHT), roll(0.0, 11.0))], channels=("p",)
    )
    assert segments[0].maneuver.start_s == 0.0
    assert ["mostly on the ground" in f.message for f in findings if f.kind == "airborne"] == [True]


def test_a_thrust_around_hover_cuts_nothing() -> None:
    lone = record(p=np.sin(TIME_S), thrust_command=0.1 * np.sin(TIME_S))
    assert [f for f in cut([Flight(lone, roll(0.0, 59.0))], channels=("p",))[1] if f.kind == "airborne"] == []


def test_an_acceleration_is_reconstructed_beside_what_is_logged() -> None:
    lone = record(p=np.sin(TIME_S), roll_command=np.cos(TIME_S))
    (segment,), findings = cut([Flight(lone, roll(5.0, 55.0))], channels=("roll_command", "p_dot"))
    assert segment.history.names == ("roll_command", "p_dot")
    # The gain of the spline's derivative at 0.01 rad per sample is one within 1e-10; its ends fade.
    inside = slice(50, -50)
    np.testing.assert_allclose(segment.history["p_dot"][inside], np.cos(segment.history.time_s)[inside], atol=1e-8)
    (finding,) = (f for f in findings if f.kind == "reconstructed")
    assert (finding.where, finding.severity) == ("p_dot", "info")
    assert finding.message == "p_dot is not logged; it was computed from p."
    assert segment.history.processing[-1] == "p_dot reconstructed"


def test_body_velocities_are_reconstructed_by_rotation() -> None:
    yaw = np.full(TIME_S.size, np.pi / 2.0)
    level = np.zeros(TIME_S.size)
    north, east = np.sin(TIME_S), np.cos(TIME_S)
    lone = record(velocity_north=north, velocity_east=east, velocity_down=level, phi=level, theta=level, psi=yaw)
    (segment,), _ = cut([Flight(lone, roll(5.0, 55.0))], channels=("u", "v"))
    # Heading east: forward is east, and right is south.
    np.testing.assert_allclose(segment.history["u"], np.cos(segment.history.time_s), atol=1e-9)
    np.testing.assert_allclose(segment.history["v"], -np.sin(segment.history.time_s), atol=1e-9)


def test_missing_ingredients_are_named() -> None:
    with pytest.raises(InsufficientDataError) as caught:
        cut(
            [Flight(record(phi=np.zeros(TIME_S.size), velocity_north=np.sin(TIME_S)), roll(5.0, 55.0))], channels=("u",)
        )
    assert [finding.kind for finding in caught.value.findings] == ["missing_channel"]
    assert "velocity_east, velocity_down, theta, psi too" in caught.value.remedy


def test_a_shift_moves_one_channel_and_is_written_down() -> None:
    lone = record(p=np.sin(TIME_S), q=np.sin(TIME_S))
    (segment,), _ = cut([Flight(lone, roll(5.0, 55.0))], channels=("p", "q"), shifts={"p": 0.037, "r": 1.0})
    inside = slice(100, -100)
    np.testing.assert_allclose(segment.history["p"][inside], np.sin(segment.history.time_s - 0.037)[inside], atol=1e-4)
    np.testing.assert_allclose(segment.history["q"], np.sin(segment.history.time_s), atol=1e-12)
    assert segment.history.processing[-1] == "p delayed by 37 ms"


def test_a_shift_longer_than_the_maneuver_is_refused() -> None:
    with pytest.raises(UsageError, match="a shift of p by 90 s is too long for a maneuver of 50 s"):
        cut([Flight(record(p=np.sin(TIME_S)), roll(5.0, 55.0))], channels=("p",), shifts={"p": 90.0})
