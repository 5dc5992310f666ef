"""Motors of real logs: directions seen in the data themselves, and reconstructions against what was logged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.unit.signal.motor_outputs import reconstructed_outputs

from rotorid.io.registry import read
from rotorid.models.autopilots.layouts import layout_of, mixer_of
from rotorid.models.rotors import library_layout
from rotorid.signal.motors import MotorHistory, motor_history, reconstructed_demands
from rotorid.typing import FloatArray

Unpacked = Callable[[str], Path]

SITL_ROLL = "ardupilot_sitl/x_calm_roll.BIN"
PX4_ROLL = "px4_sitl/roll.ulg"


def path_of(unpacked: Unpacked, folder: Path, name: str) -> Path:
    return unpacked(name if (folder / name).exists() else f"{name}.xz")


def smooth(samples: FloatArray, width: int) -> FloatArray:
    return np.convolve(samples, np.hanning(width + 2) / np.hanning(width + 2).sum(), mode="same")


def motor_speed(motors: MotorHistory, moments: FloatArray, time_s: FloatArray, rate: FloatArray) -> float:
    """Correlation of a moment with the angular acceleration that follows it, within a tenth of a second."""
    rate_hz = min(200.0, motors.sample_rate_hz)
    clock = np.arange(max(time_s[0], motors.time_s[0]), min(time_s[-1], motors.time_s[-1]), 1.0 / rate_hz)
    width = max(int(0.1 * rate_hz), 1)
    moment = smooth(np.interp(clock, motors.time_s, moments), width)
    acceleration = np.gradient(smooth(np.interp(clock, time_s, rate), width))
    delays = range(max(int(0.1 * rate_hz), 1))
    found = [np.corrcoef(moment[: moment.size - delay], acceleration[delay:])[0, 1] for delay in delays]
    return float(max(found, key=abs))


@pytest.mark.parametrize(
    ("name", "axes", "span"),
    [
        ("ardupilot_sitl/x_wind_rollpitch.BIN", "pq", None),
        ("ardupilot_sitl/x_wind_yawthrust.BIN", "r", None),
        ("ardupilot/erle_brain3.BIN", "pqr", None),
        ("px4_sitl/roll.ulg", "p", None),
        ("px4_sitl/pitch.ulg", "q", None),
        ("px4_sitl/yaw.ulg", "r", None),
        ("crazyflie/log10", "pqr", (35.0, 65.0)),
        ("betaflight/smooth_tune.BBL", "pqr", None),
    ],
)
def test_moments_of_the_layout_turn_the_vehicle(
    unpacked: Unpacked, shared_data: Path, name: str, axes: str, span: tuple[float, float] | None
) -> None:
    """A rotor in a wrong place or with a wrong spin turns the sign of an axis around, or mixes axes."""
    record = read(path_of(unpacked, shared_data, name))
    layout = layout_of(record)
    motors = motor_history(record, mixer_of(layout, record.source.format))
    moments = layout.effectiveness(0.1)[3:] @ motors.values
    gyro = max((topic for topic, _ in record.holding("p")), key=lambda topic: float(np.ptp(topic.time_s)))
    start, stop = span or (gyro.time_s[0], gyro.time_s[-1])
    inside = (gyro.time_s >= start) & (gyro.time_s <= stop)
    for axis in axes:
        row = gyro.row(axis)
        assert row is not None
        rate = gyro.values[row, inside]
        assert motor_speed(motors, moments["pqr".index(axis)], gyro.time_s[inside], rate) > 0.3, axis


def test_ardupilot_demands_agree_with_slow_outputs(unpacked: Unpacked, shared_data: Path) -> None:
    """RCOU is a whole number of microseconds, cut off: what rounding leaves is 0.29 of them rms, and half of one on
    average, which the gain takes up in part; 1 µs of the 800 between the spins bounds both."""
    record = read(path_of(unpacked, shared_data, SITL_ROLL))
    layout = layout_of(record)
    demands, agreement = reconstructed_demands(record, mixer_of(layout, record.source.format))
    assert layout.name == "quad.x"
    assert agreement is not None
    assert agreement.agrees
    assert agreement.shift == 0
    assert agreement.samples > 2000
    assert agreement.rms < 1.0 / 800.0
    assert demands.sample_rate_hz == pytest.approx(200.0, rel=0.01)
    # The simulated airfield lies at 584 m, where the standard atmosphere has 0.945 of its density at sea level. The log
    # holds the voltage under load, and the firmware took the resting one, 0.7 % more: 1 % of thrust.
    assert agreement.gain == pytest.approx(1.0 / 0.945, rel=0.012)


def test_ardupilot_outputs_at_the_rate_of_the_loop(unpacked: Unpacked, shared_data: Path) -> None:
    record = read(path_of(unpacked, shared_data, SITL_ROLL))
    time_s, outputs = reconstructed_outputs(record, mixer_of(layout_of(record), record.source.format))
    logged = next(record.holding("motor_1"))[0]
    flown = (logged.time_s > 60.0) & (logged.time_s < 260.0)
    again = np.stack([np.interp(logged.time_s[flown], time_s, row) for row in outputs])
    assert float(np.sqrt(np.mean((again - logged.values[:, flown]) ** 2))) < 1e-3


def test_px4_actuators_follow_from_its_set_points(unpacked: Unpacked, shared_data: Path) -> None:
    """Both are single precision: 6e-8 of one, and a few sums."""
    record = read(path_of(unpacked, shared_data, PX4_ROLL))
    layout = layout_of(record)
    _, agreement = reconstructed_demands(record, mixer_of(layout, record.source.format))
    assert agreement is not None
    assert agreement.rms < 1e-6
    assert agreement.gain == pytest.approx(1.0, abs=1e-6)
    assert motor_history(record).kind == "thrust_demand"


def test_px4_layout_has_the_signs_of_the_simulators_equations(unpacked: Unpacked, shared_data: Path) -> None:
    """L = -u0 + u1 + u2 - u3, M = u0 - u1 + u2 - u3, N = u0 + u1 - u2 - u3."""
    layout = layout_of(read(path_of(unpacked, shared_data, PX4_ROLL)))
    np.testing.assert_array_equal(
        np.sign(layout.effectiveness(0.1)[3:].round(12)), [[-1, 1, 1, -1], [1, -1, 1, -1], [1, 1, -1, -1]]
    )
    np.testing.assert_allclose(layout.positions, library_layout("quad.x").positions, atol=1e-7)


@pytest.mark.parametrize("name", ["ardupilot/erle_brain3.BIN", "ardupilot/beast_0036.BIN"])
def test_slow_logs_are_said_to_be_slow(unpacked: Unpacked, shared_data: Path, name: str) -> None:
    record = read(path_of(unpacked, shared_data, name))
    motors = motor_history(record, mixer_of(layout_of(record), record.source.format))
    slow = next(finding for finding in motors.findings if finding.kind == "rate_too_low")
    assert slow.numbers["rate_hz"] < 25.0 < slow.numbers["needed_hz"]


def test_all_axes_of_a_slow_log_fit_the_layout(unpacked: Unpacked, shared_data: Path) -> None:
    """Not to the rounding: RATE and RCOU have stamps of their own at 24 and 9 Hz, and the vehicle moves in between."""
    record = read(path_of(unpacked, shared_data, "ardupilot/erle_brain3.BIN"))
    _, agreement = reconstructed_demands(record, mixer_of(layout_of(record), record.source.format))
    assert agreement is not None
    assert not agreement.agrees
    assert min(agreement.correlations) > 0.9
