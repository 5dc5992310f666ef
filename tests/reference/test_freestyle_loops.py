"""A freestyle flight of a real five-inch quadrotor: its closed loops as it was flown, without any test input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.flights.whole_flights import FlightData, flown, loop_response
from rotorid.reviewing.loops import loops
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import LoopReview

FREESTYLE_S = (45.0, 165.0)


@pytest.fixture(scope="module")
def flight(unpacked: Callable[[str], Path]) -> FlightData:
    return flown(rotorid.read(unpacked("everyday/betaflight_431_freestyle.bbl.xz")))


@pytest.fixture(scope="module")
def told(flight: FlightData) -> tuple[dict[str, LoopReview], tuple[Unavailable, ...]]:
    return loops(flight)


def test_it_is_one_flight_flown_by_rates(flight: FlightData) -> None:
    ((start_s, stop_s),) = flight.flights
    assert start_s == pytest.approx(42.0, abs=1.0)
    # It is disarmed in the air, a moment before the log ends.
    assert stop_s == pytest.approx(176.1, abs=0.1)
    assert flight.instrument("roll") == ("direct", "p_setpoint")


def test_the_roll_rate_follows_its_setpoint(flight: FlightData) -> None:
    response = loop_response(flight, reference="p_setpoint", answer="p", intervals=(FREESTYLE_S,))
    omega = response.omega_rad_s
    decibel = 20.0 * np.log10(np.abs(response.values[0, 0]))
    low, high = (omega >= 1.0) & (omega <= 25.0), (omega >= 1.0) & (omega <= 30.0)
    assert np.abs(decibel[low]).max() < 0.5
    assert np.abs(decibel[high]).max() < 0.9


@pytest.mark.parametrize(
    ("name", "number", "value", "near"),
    [
        ("p", "bandwidth_90deg_rad_s", 78.7, 2.0),
        ("p", "bandwidth_3db_rad_s", 74.0, 3.5),
        ("p", "rise_time_s", 0.0295, 0.0009),
        ("p", "delay_s", 0.0207, 0.0005),
        ("p", "overshoot_percent", 1.9, 0.6),
        ("q", "bandwidth_90deg_rad_s", 58.3, 1.2),
        ("q", "bandwidth_3db_rad_s", 47.0, 3.0),
        ("q", "rise_time_s", 0.043, 0.003),
        ("q", "delay_s", 0.027, 0.001),
    ],
)
def test_numbers_of_its_loops(
    told: tuple[dict[str, LoopReview], tuple[Unavailable, ...]], name: str, number: str, value: float, near: float
) -> None:
    """As an independent analysis of the same log has them, with its own 95 % half widths."""
    quantity = told[0][name].numbers[number]
    assert quantity.value == pytest.approx(value, abs=near)
    assert quantity.lower < value < quantity.upper


def test_saturation_is_said_and_yaw_is_not_told(
    told: tuple[dict[str, LoopReview], tuple[Unavailable, ...]],
) -> None:
    """A third of the time a motor stood at a limit, which yaw pays for first: no linear loop has its response."""
    found, untold = told
    assert "saturation" in {finding.kind for finding in found["p"].findings}
    assert "r" not in found
    assert [one.what for one in untold if one.what.startswith("loops.r")] == ["loops.r"]
    # In acro nothing holds an attitude: it is not missed.
    assert not [one for one in untold if "phi" in one.what or "theta" in one.what]
