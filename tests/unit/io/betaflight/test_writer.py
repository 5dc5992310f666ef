"""A simulated flight comes back from the blackbox log that is written of it, and its settings fly what they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.io import read, write_log
from rotorid.io.betaflight.blackbox import decode
from rotorid.io.betaflight.writer import write_betaflight
from rotorid.models.autopilots import axis_controller
from rotorid.models.autopilots.layouts import layout_of
from rotorid.vehicles.betaflight import RATE_HZ, SETTINGS, betaflight_autopilot, layout

COUNT = 2000


@pytest.fixture(scope="module")
def flown() -> SimulatedFlight:
    rng = np.random.default_rng(3)
    names = "p q r ax ay az p_setpoint q_setpoint r_setpoint roll_stick pitch_stick yaw_stick thrust_stick"
    columns = {name: np.cumsum(rng.normal(size=COUNT)) * 0.01 for name in names.split()}
    columns |= {f"motor_{k}": 0.3 + 0.1 * np.sin(0.02 * k * np.arange(COUNT)) for k in range(1, 5)}
    columns["thrust_command"] = 0.3 + 0.25 * columns["thrust_stick"]
    columns["battery_voltage"] = np.linspace(16.4, 15.1, COUNT)
    return SimulatedFlight(
        vehicle="demo",
        autopilot="betaflight",
        sample_rate_hz=RATE_HZ,
        time_s=np.arange(COUNT) / RATE_HZ,
        columns=columns,
        parameters=SETTINGS,
    )


def _half_a_count(name: str) -> float:
    if name.endswith("_stick"):
        return 0.5 / 5000.0
    if name.startswith("motor_"):
        return 0.5 / (2047 - 158)
    return {"a": 0.5 * 9.80665 / 2048.0, "b": 0.005}.get(name[0], 0.05 * np.pi / 180.0)


def test_what_was_written_is_read(flown: SimulatedFlight, tmp_path: Path) -> None:
    file = tmp_path / "flown.bbl"
    write_log(file, flown, format="bbl")
    record = read(file)
    (topic,) = record.topics
    assert record.source.format == "Betaflight blackbox"
    assert topic.sample_rate_hz == pytest.approx(RATE_HZ)
    assert topic.time_s[0] == pytest.approx(20.0)
    for name in flown.columns:
        if not name.startswith("thrust"):
            # Half a count of the field.
            np.testing.assert_allclose(record[name], flown.columns[name], atol=1.001 * _half_a_count(name), rtol=0.0)
    # The throttle stands at what hovers, and moves as far as the stick asked.
    np.testing.assert_allclose(record["thrust_stick"], flown.columns["thrust_command"], atol=2e-4)
    assert dict(record.parameters).items() >= dict(SETTINGS).items()


def test_every_frame_is_there_and_nothing_else(flown: SimulatedFlight, tmp_path: Path) -> None:
    file = tmp_path / "flown.bbl"
    write_log(file, flown, format="bbl")
    decoded = decode(file.read_bytes())
    assert len(decoded.frames) == COUNT
    damage = decoded.damage
    assert (damage.skipped_bytes, damage.lost_frames, damage.cut_bytes, damage.ended) == (0, 0, 0, True)


def test_the_motors_are_where_the_log_is_taken_to_have_them(flown: SimulatedFlight, tmp_path: Path) -> None:
    file = tmp_path / "flown.bbl"
    write_log(file, flown, format="bbl")
    told = layout_of(read(file))
    np.testing.assert_allclose(told.scaled(layout().arm).positions, layout().positions, atol=1e-12)
    np.testing.assert_array_equal(told.spins, layout().spins)


@pytest.mark.parametrize(("place", "axis"), list(enumerate(("roll", "pitch", "yaw"))))
def test_the_settings_of_the_log_are_the_gains_that_flew(place: int, axis: str) -> None:
    firmware, rates = "Betaflight 4.4.3", betaflight_autopilot().rates
    told = axis_controller(SETTINGS, axis, firmware=firmware)  # type: ignore[arg-type]
    assert told is not None
    controller = told.controller
    assert controller.proportional_s == pytest.approx(rates.proportional[place], rel=1e-12)
    assert controller.integral == pytest.approx(rates.integral[place], rel=1e-12)
    assert controller.derivative_s2 == pytest.approx(rates.derivative[place], rel=1e-12)
    assert controller.step_s == pytest.approx(1.0 / RATE_HZ)
    # A result keeps the names of the command line: they mean the same controller.
    again = axis_controller(
        {**told.gains, **told.filters},
        axis,
        firmware=firmware,
        loop_rate_hz=RATE_HZ,  # type: ignore[arg-type]
    )
    assert again is not None
    assert again.controller == controller


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12])
def test_what_is_no_number_is_refused(value: float, tmp_path: Path) -> None:
    flight = SimulatedFlight(
        vehicle="demo", autopilot="betaflight", sample_rate_hz=1000.0, time_s=[0.0], columns={"p": [value]}
    )
    with pytest.raises(UsageError):
        write_log(tmp_path / "a.bbl", flight, format="bbl")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("autopilot", "motors"), [("px4", 4), ("ardupilot", 4), ("betaflight", 6), ("betaflight", 3), ("simple", 0)]
)
def test_what_betaflight_does_not_fly_so_is_refused(autopilot: str, motors: int, tmp_path: Path) -> None:
    columns = {"p": [0.0], **{f"motor_{number}": [0.5] for number in range(1, motors + 1)}}
    flight = SimulatedFlight(vehicle="demo", autopilot=autopilot, sample_rate_hz=1000.0, time_s=[0.0], columns=columns)
    with pytest.raises(UsageError, match="four motors"):
        write_log(tmp_path / "a.bbl", flight, format="bbl")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("start_s", [40_020.0, -1.0])
def test_a_time_beyond_the_clock_of_a_log_is_refused(start_s: float, tmp_path: Path) -> None:
    flight = SimulatedFlight(
        vehicle="demo", autopilot="betaflight", sample_rate_hz=1000.0, time_s=[0.0], columns={"p": [0.0]}
    )
    with pytest.raises(UsageError, match="clock"):
        write_betaflight(tmp_path / "a.bbl", flight, start_s=start_s)
    assert not list(tmp_path.iterdir())
