"""A real Crazyflie that was flown up and down: what the motors were told explains what the accelerometer felt."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source, TimeHistory
from rotorid.io import crazyflie
from rotorid.signal.clock import resample
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import FloatArray

MOTORS = [f"motor_{number}" for number in range(1, 5)]


@pytest.fixture(scope="module")
def record(shared_data: Path) -> FlightRecord:
    return crazyflie.read(shared_data / "crazyflie" / "log10", Source(name="log10", format=crazyflie.FORMAT, sha256=""))


@pytest.fixture(scope="module")
def flown(record: FlightRecord) -> TimeHistory:
    (history,) = resample(record, channels=["thrust_command", "az", *MOTORS], start_s=35.0, stop_s=65.0).histories
    return history


def coherence(history: TimeHistory, omega_rad_s: FloatArray) -> FloatArray:
    response = frequency_response(
        [history], inputs=["thrust_command"], outputs=["az"], omega_rad_s=omega_rad_s, windows_s=[10.0, 5.0, 2.0]
    )
    assert response.omega_rad_s.size == omega_rad_s.size
    return response.coherence[0, 0]


def test_the_log_is_whole(shared_data: Path) -> None:
    record = crazyflie.read(shared_data / "crazyflie" / "log10", Source(name="log10", format="", sha256=""))
    (topic,) = record.topics
    assert (topic.name, topic.time_s.size) == ("fixedFrequency", 50496)
    assert topic.sample_rate_hz == pytest.approx(1011.0, rel=1e-3)
    assert np.diff(topic.time_s).max() <= 7.1e-3
    assert record.findings == ()
    assert record.instruments == {}


def test_on_the_ground_the_accelerometer_reads_gravity_upward(record: FlightRecord) -> None:
    topic, row = next(record.holding("az"))
    # Before the motors turn; the sensor's bias is within 0.03 g.
    assert topic.values[row, :200].mean() == pytest.approx(-9.81, abs=0.3)


def test_the_thrust_of_the_motor_commands_is_coherent_with_the_acceleration(flown: TimeHistory) -> None:
    """Thrust goes with the square of the command: over its large motions a straight line does not explain it."""
    thrust = np.mean([flown[name] ** 2 for name in MOTORS], axis=0)
    quadratic = replace(flown, values=np.vstack([thrust, flown.values[1:]]))
    assert coherence(quadratic, np.geomspace(1.3, 34.0, 40)).min() > 0.6


@pytest.mark.xfail(
    strict=True, raises=AssertionError, reason="0.36: over the ends of the band thrust is no line of its command"
)
def test_the_linear_thrust_command_is_coherent_over_the_band(flown: TimeHistory) -> None:
    assert coherence(flown, np.geomspace(1.3, 34.0, 40)).min() > 0.6


def test_the_linear_thrust_command_is_coherent_in_the_middle_of_the_band(flown: TimeHistory) -> None:
    assert coherence(flown, np.geomspace(2.0, 18.0, 30)).min() > 0.6
    assert coherence(flown, np.geomspace(1.3, 34.0, 40)).min() > 0.35


def test_more_thrust_pushes_upward(flown: TimeHistory) -> None:
    response = frequency_response(
        [flown], inputs=["thrust_command"], outputs=["az"], omega_rad_s=np.array([3.0, 3.5]), windows_s=[10.0, 5.0]
    )
    # Upward is negative; the motors' lag of 72 ms turns the phase by 12 degrees here.
    assert (response.values[0, 0].real < 0.0).all()
