"""Flights as people log them: when they flew, what flew, and what of it is an excitation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import Maneuver
from rotorid.reviewing.inspection import Inspection, inspect

FREESTYLE = "everyday/betaflight_431_freestyle.bbl.xz"
PLANE = "everyday/px4_165_fixed_wing_never_flown.ulg.xz"


@pytest.fixture(scope="module")
def record(unpacked: Callable[[str], Path]) -> Callable[[str], rotorid.FlightRecord]:
    """Each log read once."""
    known: dict[str, rotorid.FlightRecord] = {}

    def read(name: str) -> rotorid.FlightRecord:
        if name not in known:
            known[name] = rotorid.read(unpacked(name))
        return known[name]

    return read


@pytest.fixture(scope="module")
def inspected(record: Callable[[str], rotorid.FlightRecord]) -> Callable[[str], Inspection]:
    known: dict[str, Inspection] = {}

    def look(name: str) -> Inspection:
        if name not in known:
            known[name] = inspect(record(name))
        return known[name]

    return look


@pytest.mark.parametrize(
    ("log", "flight", "seen_in"),
    [
        # Its height and thrust show a touch-down at 1122.7 s; the landing detector waits until 1123.7 s.
        ("everyday/px4_115_s500.ulg.xz", (1095.2, 1122.7), "vehicle_land_detected and vehicle_status"),
        # It has not landed when the log ends, and its throttle goes below half of hover again and again.
        ("everyday/arducopter_462_log_5.bin.xz", (115.4, 284.9), "EV"),
        # No landed flag: thrust, and body rates where the throttle is zero. Armed until 176.1 s.
        (FREESTYLE, (42.0, 175.5), "thrust_command"),
    ],
)
def test_one_flight(
    inspected: Callable[[str], Inspection], log: str, flight: tuple[float, float], seen_in: str
) -> None:
    (found,) = inspected(log).flights
    # Take-off by flags is exact to a tenth.
    assert (found.start_s, found.stop_s) == pytest.approx(flight, abs=1.0 if log == FREESTYLE else 0.1)
    assert found.seen_in == seen_in
    assert inspected(log).vehicle == "multirotor"


@pytest.mark.parametrize("log", ["everyday/arducopter_462_log_4.bin.xz", PLANE])
def test_no_flight(inspected: Callable[[str], Inspection], log: str) -> None:
    """The copter said "not landed" when the throttle rose, and tipped over; the plane was carried about."""
    found = inspected(log)
    assert found.flights == ()
    assert found.excitations == ()
    assert found.candidates == ()
    assert "never_airborne" in {finding.kind for finding in found.findings}


def test_an_old_log_whose_events_carry_no_stamps(inspected: Callable[[str], Inspection]) -> None:
    found = inspected("everyday/arducopter_321_1.BIN.xz")
    assert len(found.flights) == 8
    # The autopilot logs while it is armed: each flight ends before the gap that follows it.
    # It touched down at 208.5 s, as height and thrust show.
    assert found.flights[0].stop_s == pytest.approx(208.5, abs=0.2)
    assert found.flights[-1].stop_s == pytest.approx(902.8, abs=0.1)


def test_a_plane_is_named_and_gets_no_advice_for_multirotors(inspected: Callable[[str], Inspection]) -> None:
    found = inspected(PLANE)
    assert found.vehicle == "plane"
    assert not any(support.possible or support.remedy for support in found.supports.values())
    assert all("plane" in support.because for support in found.supports.values())
    (finding,) = (finding for finding in found.findings if finding.kind == "other_vehicle")
    assert "no multirotor" in finding.message


def test_a_vtol_is_named(shared_data: Path) -> None:
    assert rotorid.read(shared_data / "px4/sample_log_small.ulg").status.vehicle == "VTOL"


def test_flips_are_no_excitations(inspected: Callable[[str], Inspection]) -> None:
    assert [item for item in inspected(FREESTYLE).excitations if item.axis in ("roll", "pitch")] == []


def test_yaw_of_motors_that_turn_the_other_way_is_a_plant(record: Callable[[str], rotorid.FlightRecord]) -> None:
    log = record(FREESTYLE)
    # A command moves the rate its way some 60 ms later, on average over 40 ms; with the usual direction it is negative.
    command = np.convolve(log["yaw_command"].values, np.full(40, 1.0 / 40.0), "same")
    gained = log["r"].values[80:] - log["r"].values[:-80]
    assert np.corrcoef(command[40:-40], gained)[0, 1] > 0.3


def test_set_points_of_acro_are_free_of_feedback(record: Callable[[str], rotorid.FlightRecord]) -> None:
    given = Maneuver(axis="roll", kind="other", start_s=60.0, stop_s=90.0, origin="given")
    settings = {"segments": [given], "band_rad_s": (1.0, 30.0)}
    found = rotorid.response([record(FREESTYLE)], inputs=("p_setpoint",), outputs=("p",), **settings)
    warned = {finding.kind for finding in found.findings if finding.severity == "warning"}
    assert not warned & {"closed_loop_bias", "no_excitation", "inverse_controller"}


@pytest.mark.slow
def test_the_delay_behind_such_a_set_point_needs_no_instrument(record: Callable[[str], rotorid.FlightRecord]) -> None:
    (delay,) = rotorid.delay([record(FREESTYLE)], input="p_setpoint", output="p").pairs.values()
    assert not delay.feedback
    assert {finding.severity for finding in delay.findings} == {"info"}


@pytest.mark.slow
def test_roll_of_a_freestyle_flight(record: Callable[[str], rotorid.FlightRecord]) -> None:
    given = Maneuver(axis="roll", kind="other", start_s=45.0, stop_s=165.0, origin="given")
    model = rotorid.identify([record(FREESTYLE)], model="rate.roll", segments=[given], band_rad_s=(2.0, 100.0))
    assert model["L_roll"].value == pytest.approx(1150.0, rel=0.1)
    assert model.provenance.instruments == ("p_setpoint",)
