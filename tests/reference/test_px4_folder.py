"""A real PX4 flight that was kept as CSV: roll is a plant, and yaw shows the controller's inverse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.data.response import FrequencyResponse
from rotorid.io.px4 import folder as px4_folder
from rotorid.signal.clock import resample
from rotorid.spectral.estimate import frequency_response

PILOTED_S = (65.0, 105.0)
"""The part in which the pilot moves roll, then pitch."""


@pytest.fixture(scope="module")
def record(shared_data: Path) -> FlightRecord:
    folder = shared_data / "px4" / "zmr250"
    assert px4_folder.is_folder_log(folder)
    return px4_folder.read_folder(folder, Source(name="zmr250", format=px4_folder.FORMAT, sha256=""))


def response(record: FlightRecord, command: str, rate: str, omega_rad_s: list[float]) -> FrequencyResponse:
    start_s, stop_s = PILOTED_S
    flown = resample(record, channels=[command, rate], start_s=start_s, stop_s=stop_s).histories
    return frequency_response(
        flown, inputs=[command], outputs=[rate], omega_rad_s=np.array(omega_rad_s), windows_s=[8.0, 4.0, 2.0]
    )


def test_topics_rates_and_gains_are_those_of_the_log(record: FlightRecord) -> None:
    rates = {name: next(record.holding(name))[0].sample_rate_hz for name in ("roll_command", "p", "r_setpoint")}
    assert rates == pytest.approx({"roll_command": 50.0, "p": 250.0, "r_setpoint": 85.0}, rel=0.01)
    assert next(record.holding("p"))[0].name == "sensor_combined"
    assert record.parameters["MC_YAWRATE_P"] == pytest.approx(0.15, rel=1e-6)
    # Of the 473 those stay that are on the list of what is kept, and no number of a sensor is.
    assert {"MC_ROLLRATE_P", "SYS_AUTOSTART", "MAV_TYPE"} <= set(record.parameters)
    assert not [name for name in record.parameters if name.startswith("CAL_") or name.endswith("_ID")]
    (finding,) = record.findings
    assert (finding.kind, finding.where) == ("rate_too_low", "actuator_controls_0")


def test_roll_is_a_plant(record: FlightRecord) -> None:
    """Its phase falls from about -90 degrees, an integrator, over -130 at 19 rad/s to -173 at 41: lag and delay."""
    measured = response(record, "roll_command", "p", [3.0, 19.0, 41.0])
    assert measured.coherence.min() > 0.6
    assert np.rad2deg(np.angle(measured.values[0, 0, 0])) == pytest.approx(-90.0, abs=20.0)
    published = np.deg2rad([-130.0, -173.0])
    apart = np.abs(np.angle(measured.values[0, 0, 1:] * np.exp(-1j * published)))
    # The phase has the relative error of the magnitude; the published numbers, of the same flight, have about the same.
    assert (apart < 3.0 * np.sqrt(2.0) * measured.random_error[0, 0, 1:]).all()


def test_yaw_is_the_inverse_of_the_controller(record: FlightRecord) -> None:
    """Coherent, flat and of opposite sign: nobody moved yaw, so that the loop shows ``-1/C``."""
    measured = response(record, "yaw_command", "r", [5.0, 8.0, 12.0, 19.0, 30.0])
    assert measured.coherence.min() > 0.95
    gain = np.abs(measured.values[0, 0]) * record.parameters["MC_YAWRATE_P"]
    # The integral part of the controller adds some percent at the low end.
    np.testing.assert_allclose(gain, 1.0, rtol=0.06)
    assert (measured.values[0, 0].real < -0.9 * np.abs(measured.values[0, 0])).all()
