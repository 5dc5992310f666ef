"""Flight, noise and motors of ordinary logs, with what is known of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.flights.sensor_samples import rotor_speeds_hz
from rotorid.reviewing.flight import flight, logging, vehicle
from rotorid.reviewing.motors import motors
from rotorid.reviewing.noise import noise
from rotorid.reviewing.spectra import on_harmonics
from rotorid.signal.airborne import airborne, within
from rotorid.spectral.noise import short_spectra


@pytest.fixture(scope="module")
def logs(unpacked: Callable[[str], Path]) -> Callable[[str], FlightRecord]:
    held: dict[str, FlightRecord] = {}

    def log(name: str) -> FlightRecord:
        if name not in held:
            held[name] = rotorid.read(unpacked(f"everyday/{name}.xz"), sandbox=False)
        return held[name]

    return log


def test_peaks_of_a_log_with_speeds_lie_on_harmonics_of_the_rotors(logs: Callable[[str], FlightRecord]) -> None:
    """Strongest peak of each batch before the filters, within two bins of 3.9 Hz, all axes of the gyro together."""
    record = logs("arducopter_462_log_5.bin")
    shares, counts = [], []
    for name in ("p_raw", "q_raw", "r_raw"):
        track = record[name]
        kept = within(track.time_s, airborne(record).intervals)
        spectra = short_spectra(track.time_s[kept], track.values[kept])
        assert spectra is not None
        speeds = rotor_speeds_hz(record, spectra.time_s)
        assert speeds is not None
        found = on_harmonics(spectra, speeds)
        shares.append(found.share)
        counts.append(found.window.size)

    assert sum(counts) > 380
    assert np.average(shares, weights=counts) >= 0.90


def test_freestyle_has_a_frame_line_and_rotors_that_rise_with_throttle(logs: Callable[[str], FlightRecord]) -> None:
    found, untold = noise(logs("betaflight_431_freestyle.bbl"))

    frame = next(peak for peak in found.peaks if peak.channel == "p" and peak.source == "frame")
    rotors = [peak for peak in found.peaks if peak.channel in ("q", "r") and peak.source == "rotor"]
    assert frame.frequency_hz.value == pytest.approx(208.0, abs=2.0)
    assert rotors
    assert all(200.0 < peak.frequency_hz.value < 450.0 for peak in rotors)
    # Of 1000 units of the mixer: 2.3 through P and 6.1 through D by an earlier measurement.
    assert found.numbers["roll_p_noise_share"].value == pytest.approx(0.0023, rel=0.15)
    assert found.numbers["roll_d_noise_share"].value == pytest.approx(0.0061, rel=0.15)
    assert found.numbers["filter_delay_measured_s"].value == pytest.approx(0.0018, abs=0.0003)
    assert found.numbers["clipping_share"].value == 0.0
    assert not [one for one in untold if one.what == "noise.maps.before"]


def test_full_throttle_of_a_climb_is_no_thrust_ratio(shared_data: Path) -> None:
    """It climbs at 95 % throttle with one weight, and lifts off at 42 % with 1.14."""
    summary, untold = flight(rotorid.read(shared_data / "field/maik_00000003.BIN", sandbox=False))

    assert summary.thrust_to_weight is None
    (why,) = (one.why for one in untold if one.what == "flight.thrust_to_weight")
    assert "full thrust is more than 2.3 times the weight" in why


def test_freestyle_as_a_flight(logs: Callable[[str], FlightRecord]) -> None:
    record = logs("betaflight_431_freestyle.bbl")
    summary, _ = flight(record)
    seen, _ = motors(record)

    assert vehicle(record)[0].frame == "quad X"
    assert len(summary.flights) == 1
    assert summary.modes == pytest.approx({"acro": 1.0})
    assert 0.008 < summary.battery["resistance_ohm"].value < 0.025
    assert summary.thrust_to_weight is not None
    assert 4.0 < summary.thrust_to_weight.value < 8.0
    # The lag and the delay that the model of its roll rate has, 18 and 8 ms.
    assert seen.numbers["output_delay_s"].value == pytest.approx(0.026, rel=0.12)
    assert seen.numbers["saturated_low_share"].value > 0.25


def test_a_real_quadrotor_whose_diagonals_differ(logs: Callable[[str], FlightRecord]) -> None:
    record = logs("px4_115_s500.ulg")
    seen, untold = motors(record)
    summary, _ = flight(record)

    assert seen.pattern == "diagonal"
    assert seen.numbers["imbalance"].lower > 0.25
    assert {one.what for one in untold} >= {"motors.events", "motors.output_delay_s"}
    # It touches down at 1122.6 s, and is said to have landed a second later.
    assert summary.flights[0] == pytest.approx((1095.21, 1122.62), abs=0.05)
    assert set(summary.modes) == {"takeoff", "hold", "land"}
    hover = record["hover_thrust"].values
    assert summary.hover_throttle is not None
    # The autopilot's own estimate wanders between 0.470 and 0.488 in this flight.
    assert summary.hover_throttle.upper > hover.min()
    assert summary.hover_throttle.value == pytest.approx(float(np.median(hover)), abs=float(np.ptp(hover)))
    assert "vehicle_angular_velocity 4" in logging(record)[0].topics


def test_a_log_of_5_hz_says_what_to_change(logs: Callable[[str], FlightRecord]) -> None:
    record = logs("arducopter_462_log_5.bin")
    seen, untold = motors(record)

    assert "LOG_BLK_RATEMAX" in logging(record)[0].change[0]
    assert vehicle(record)[0].frame == "quad X (Betaflight, reversed)"
    assert {one.what for one in untold} >= {"motors.events", "motors.output_delay_s"}
    assert seen.numbers["saturated_high_share"].value == 0.0


@pytest.mark.parametrize("name", ["px4_sitl/roll.ulg", "px4_sitl/pitch.ulg.xz"])
def test_lag_and_delay_from_output_to_gyro(name: str, unpacked: Callable[[str], Path]) -> None:
    """The simulator's motors lag by 48 ms, and everything else is 5.3 ms late."""
    delay = motors(rotorid.read(unpacked(name), sandbox=False))[0].numbers["output_delay_s"]

    assert delay.lower <= 0.0533 <= delay.upper
    assert delay.std < 0.1 * delay.value


def test_thrust_and_battery_of_a_simulated_flight(unpacked: Callable[[str], Path]) -> None:
    """3 kg on four rotors of 18.83 N at most, hovering at 0.363 of the thrust."""
    summary, _ = flight(rotorid.read(unpacked("ardupilot_sitl/x_calm_roll.BIN"), sandbox=False))

    assert summary.hover_throttle is not None
    assert summary.thrust_to_weight is not None
    assert summary.hover_throttle.lower <= 0.363 <= summary.hover_throttle.upper
    assert summary.thrust_to_weight.lower <= 4.0 * 18.83 / (3.0 * 9.81) <= summary.thrust_to_weight.upper
