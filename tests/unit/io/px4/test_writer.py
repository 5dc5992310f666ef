"""Simulated flights as PX4 logs: every channel comes back, at its rate and instant, in PX4's own fields."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyulog
from pyulog.ulog2csv import convert_ulog2csv

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import AXES, FlightRecord
from rotorid.errors import UsageError
from rotorid.excitation.sweep import pilot_sweep
from rotorid.excitation.switching import doublet
from rotorid.io.px4.ulog import walk
from rotorid.io.px4.writer import INTEGERS, LAYOUTS, write_px4
from rotorid.io.registry import read
from rotorid.signal.airborne import airborne
from rotorid.signal.excitations import find_excitations
from rotorid.typing import FloatArray

RATES_HZ = {
    "vehicle_attitude": 250.0,
    "vehicle_attitude_setpoint": 250.0,
    "vehicle_local_position": 25.0,
    "manual_control_setpoint": 100.0,
    "battery_status": 2.0,
}
SENSORS = ("p", "q", "r", "ax", "ay", "az")
ANGLES = ("phi", "theta", "psi")
NAMES = [
    *(f"{axis}_{kind}" for kind in ("command", "excitation", "stick") for axis in AXES),
    *(f"motor_{number}" for number in range(1, 5)),
    *SENSORS,
    *ANGLES,
    *(f"{name}_setpoint" for name in ("p", "q", "r", *ANGLES)),
    *("velocity_north", "velocity_east", "velocity_down", "north", "east", "down", "battery_voltage"),
]
LARGEST_ANGLE = 1.2
SINGLE = 2.0**-24
"""Half of the step from one to the next number in single precision."""


def flight(samples: int = 2000, rate_hz: float = 1000.0, names: list[str] = NAMES, **others: Any) -> SimulatedFlight:
    """Random signals under every name; angles far from where Euler angles lose their meaning."""
    rng = np.random.default_rng(3)
    columns = {name: LARGEST_ANGLE * rng.uniform(-1.0, 1.0, samples) for name in names}
    raw = {name: rng.normal(size=samples) for name in SENSORS}
    return SimulatedFlight(
        **{
            "vehicle": "test",
            "autopilot": "px4",
            "sample_rate_hz": rate_hz,
            "time_s": np.arange(samples) / rate_hz,
            "columns": columns,
            "raw": raw,
            **others,
        }
    )


def written(folder: Path, flown: SimulatedFlight, **options: Any) -> FlightRecord:
    write_px4(folder / "flight.ulg", flown, **options)
    return read(folder / "flight.ulg")


def of(record: FlightRecord, topic: str) -> Mapping[str, FloatArray]:
    """Channels of a topic and its stamps."""
    found = [one for one in record.topics if one.name == topic]
    channels = {channel.name: one.values[row] for one in found for row, channel in enumerate(one.channels)}
    return channels | {"time_s": found[0].time_s}


def log_of(folder: Path) -> Any:
    return pyulog.ULog(str(folder / "flight.ulg"))


def test_every_channel_comes_back_at_its_rate(tmp_path: Path) -> None:
    flown = flight()
    record = written(tmp_path, flown, start_s=12.5)
    assert {topic.name for topic in record.topics} == {layout.topic for layout in LAYOUTS}
    assert set(record.channel_names) == set(NAMES)
    assert not record.findings
    # Each part of a quaternion is rounded by half a step at most, their norm by twice that; a small turn is twice the
    # change of the quaternion, and shows in roll and yaw divided by the cosine of pitch.
    tolerance = 2.0 * SINGLE * 2.0 / np.cos(LARGEST_ANGLE)
    for topic in record.topics:
        every = round(1000.0 / RATES_HZ.get(topic.name, 1000.0))
        np.testing.assert_array_equal(np.rint(1e6 * topic.time_s), 12.5e6 + 1000 * np.arange(0, 2000, every))
        source = flown.raw if topic.name == "sensor_combined" else flown.columns
        for channel, values in zip(topic.channels, topic.values, strict=True):
            expected = source[channel.name][::every]
            if "attitude" in topic.name:
                np.testing.assert_allclose(values, expected, rtol=0.0, atol=tolerance, err_msg=channel.name)
            else:
                np.testing.assert_array_equal(values, expected.astype(np.float32), err_msg=channel.name)


def test_the_readers_of_px4_find_its_own_fields(tmp_path: Path) -> None:
    flown = flight()
    write_px4(tmp_path / "flight.ulg", flown)
    topics = {data.name: data.data for data in log_of(tmp_path).data_list}
    single = {name: values.astype(np.float32) for name, values in flown.columns.items()}
    thrust, motors = topics["vehicle_thrust_setpoint"], topics["actuator_motors"]
    # PX4's axes point forward, right and down, so that thrust is negative.
    np.testing.assert_array_equal(thrust["xyz[2]"], -single["thrust_command"])
    np.testing.assert_array_equal(topics["vehicle_rates_setpoint"]["thrust_body[2]"], -single["thrust_command"])
    assert not thrust["xyz[0]"].any()
    np.testing.assert_array_equal(motors["control[3]"], single["motor_4"])
    assert all(np.isnan(motors[f"control[{place}]"]).all() for place in range(4, 12))
    np.testing.assert_array_equal(topics["debug_vect"]["y"], single["pitch_excitation"])
    name = bytes(topics["debug_key_value"][f"key[{place}]"][0] for place in range(10))
    assert name == b"excite\0\0\0\0"
    np.testing.assert_array_equal(topics["sensor_combined"]["gyro_integral_dt"], 1000)
    np.testing.assert_array_equal(topics["sensor_combined"]["gyro_rad[1]"], flown.raw["q"].astype(np.float32))
    assert topics["vehicle_local_position"]["xy_valid"].all()
    quaternion = np.stack([topics["vehicle_attitude"][f"q[{place}]"] for place in range(4)])
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=0), 1.0, rtol=0.0, atol=4.0 * SINGLE)


def test_all_messages_stand_in_order_of_time_without_damage(tmp_path: Path) -> None:
    write_px4(tmp_path / "flight.ulg", flight())
    data = (tmp_path / "flight.ulg").read_bytes()
    found = walk(data, [layout.topic for layout in LAYOUTS])
    assert not found.damage
    at = np.concatenate([stream.positions for stream in found.streams])
    stamps = np.frombuffer(b"".join(data[place + 5 : place + 13] for place in np.sort(at)), dtype="<u8")
    # Nine topics at every turn, and attitude and its set-point, position, sticks and battery at their own rates.
    assert stamps.size == 9 * 2000 + 2 * 500 + 50 + 200 + 4
    assert np.all(np.diff(stamps.astype(np.int64)) >= 0)


def test_parameters_and_firmware_are_those_of_px4(tmp_path: Path) -> None:
    parameters = {"CA_ROTOR_COUNT": 4.0, "MC_ROLLRATE_P": 0.15, "IMU_GYRO_CUTOFF": 40.0, "SYS_AUTOSTART": 4001.0}
    record = written(tmp_path, flight(parameters=parameters))
    assert record.parameters == {**parameters, "MC_ROLLRATE_P": np.float32(0.15), "SDLOG_PROFILE": 57.0}
    assert record.source.firmware == "PX4 1.17.0 (development)"
    log = log_of(tmp_path)
    whole = {name for name, value in log.initial_parameters.items() if isinstance(value, int)}
    assert whole == {"CA_ROTOR_COUNT", "SYS_AUTOSTART", "SDLOG_PROFILE"}
    assert log.msg_info_dict["ver_hw"] == "ROTORID_SIM"


def test_the_logging_profile_is_that_of_the_flight_or_fits_the_topics(tmp_path: Path) -> None:
    calm = flight(names=["p", "q", "r"])
    assert written(tmp_path, calm).parameters == {"SDLOG_PROFILE": 25.0}
    assert written(tmp_path, replace(calm, parameters={"SDLOG_PROFILE": 1.0})).parameters == {"SDLOG_PROFILE": 1.0}


def test_only_what_the_flight_has_is_logged(tmp_path: Path) -> None:
    names = ["pitch_command", "pitch_excitation", "motor_2", "theta", "velocity_down", "q_setpoint"]
    record = written(tmp_path, flight(names=names, raw={}))
    # An attitude needs all three angles.
    assert set(record.channel_names) == set(names) - {"theta"}
    assert {topic.name for topic in record.topics} == {
        "vehicle_torque_setpoint",
        "debug_vect",
        "actuator_motors",
        "vehicle_local_position",
        "vehicle_rates_setpoint",
    }
    position = next(data.data for data in log_of(tmp_path).data_list if data.name == "vehicle_local_position")
    assert [bool(position[flag][0]) for flag in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")] == [0, 0, 0, 1]


def test_rates_can_be_chosen_and_hold_on_average(tmp_path: Path) -> None:
    flown = flight(samples=4000, rate_hz=400.0)
    rates = {"vehicle_attitude": 250.0, "vehicle_angular_velocity": 1e6, "battery_status": 0.05, "debug_vect": 133.0}
    record = written(tmp_path, flown, rates_hz=rates)
    attitude, rate = of(record, "vehicle_attitude"), of(record, "vehicle_angular_velocity")
    assert (rate["time_s"].size, of(record, "battery_status")["time_s"].size) == (4000, 1)
    assert (attitude["time_s"].size, of(record, "debug_vect")["time_s"].size) == (2500, 1330)
    # Turns are 2.5 ms apart: the stamps keep step with 4 ms and never run ahead of it.
    late = attitude["time_s"] - 30.0 - np.arange(2500) / 250.0
    assert -1e-6 < late.min() <= late.max() < 2.5e-3
    turns = np.rint((of(record, "debug_vect")["time_s"] - 30.0) * 400.0).astype(int)
    expected = flown.columns["roll_excitation"][turns].astype(np.float32)
    np.testing.assert_array_equal(of(record, "debug_vect")["roll_excitation"], expected)


def test_stamps_of_a_clock_that_does_not_divide_a_second_are_exact(tmp_path: Path) -> None:
    flown = flight(samples=3000, rate_hz=300.0, time_s=7.0 + np.arange(3000) / 300.0)
    time_s = of(written(tmp_path, flown), "vehicle_torque_setpoint")["time_s"]
    assert np.abs(time_s - 30.0 - flown.time_s).max() <= 0.5e-6 + 1e-12


def test_test_inputs_are_found_as_excitations_free_of_feedback(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    sweep = pilot_sweep(amplitude=0.1, band_rad_s=(1.0, 30.0), duration_s=30.0, sample_rate_hz=250.0, rng=rng)
    steps = doublet(amplitude=0.2, pulse_s=0.5, sample_rate_hz=250.0)
    samples = 60 * 250
    columns = {f"{axis}_excitation": np.zeros(samples) for axis in AXES}
    columns["roll_excitation"][1000 : 1000 + sweep.size] = sweep
    columns["thrust_excitation"][11000 : 11000 + steps.size] = steps
    columns |= {f"{axis}_command": columns[f"{axis}_excitation"] + 0.3 * rng.normal(size=samples) for axis in AXES}
    columns["thrust_command"] = columns["thrust_excitation"] + 0.5
    columns |= {name: rng.normal(size=samples) for name in "pqr"}
    record = written(tmp_path, flight(samples=samples, rate_hz=250.0, columns=columns, raw={}))
    assert {axis: names[0] for axis, names in record.instruments.items()} == {
        axis: f"{axis}_excitation" for axis in AXES
    }
    (roll,), (thrust,) = find_excitations(record, "roll"), find_excitations(record, "thrust")
    assert (roll.kind, roll.signal, thrust.kind) == ("sweep", "roll_excitation", "doublet")
    assert 34.0 <= roll.start_s < roll.stop_s <= 34.0 + sweep.size / 250.0
    assert find_excitations(record, "pitch") == ()
    assert airborne(record).longest == pytest.approx((30.0, 90.0), abs=0.1)


def test_the_export_to_csv_holds_the_same_but_for_what_it_writes_as_text(tmp_path: Path) -> None:
    logged = written(tmp_path, flight(samples=200, rate_hz=250.0))
    (tmp_path / "csv").mkdir()
    convert_ulog2csv(str(tmp_path / "flight.ulg"), "", str(tmp_path / "csv"), ",", None, None)
    exported = read(tmp_path / "csv")
    # Names of signals are text there, and a signal without its name is nobody's.
    kept = [topic for topic in logged.topics if not topic.name.startswith("debug_")]
    assert [topic.name for topic in exported.topics] == [topic.name for topic in kept]
    assert exported.instruments["roll"] == logged.instruments["roll"][1:]
    for ours, theirs in zip(kept, exported.topics, strict=True):
        # The export writes single precision with the digits that tell it apart.
        np.testing.assert_allclose(theirs.values, ours.values, rtol=1e-6, atol=1e-6, err_msg=ours.name)


def test_equal_flights_make_equal_bytes(tmp_path: Path) -> None:
    for name in ("one.ulg", "two.ulg"):
        write_px4(tmp_path / name, flight())
    assert (tmp_path / "one.ulg").read_bytes() == (tmp_path / "two.ulg").read_bytes()


@pytest.mark.parametrize(
    ("changes", "options", "sentence"),
    [
        ({"wrong": ("q", np.nan)}, {}, r"q of the flight of test is nan at 1.234 s"),
        ({"wrong": ("phi", np.inf)}, {}, r"phi of the flight of test is inf at 1.234 s"),
        ({"wrong": ("motor_3", -1e39)}, {}, r"motor_3 of the flight of test is -1e\+39 at 1.234 s"),
        ({"raw": {"p": np.full(2000, np.nan)}}, {}, "p of the flight of test is nan at 0 s"),
        ({"names": ["motor_13"]}, {}, "at most 12 motors"),
        ({"names": ["u"], "raw": {}}, {}, "no channel that PX4 logs"),
        ({"autopilot": "ardupilot"}, {}, "with ardupilot"),
        ({"parameters": {"CA_ROTOR_COUNT": 4.5}}, {}, "CA_ROTOR_COUNT = 4.5"),
        ({"parameters": {"MC_ROLL_P": np.nan}}, {}, "MC_ROLL_P = nan"),
        ({"time_s": np.zeros(2000)}, {}, "2000 stamps that cannot be"),
        ({"time_s": np.full(2000, np.inf)}, {}, "2000 stamps that cannot be"),
        ({"samples": 0}, {}, "0 stamps that cannot be"),
        ({}, {"start_s": -1.0}, "2000 stamps that cannot be"),
        ({}, {"rates_hz": {"vehicle_atitude": 10.0}}, "did you mean vehicle_attitude?"),
        ({}, {"rates_hz": {"vehicle_attitude": 0.0}}, "the rate of vehicle_attitude is 0 Hz"),
        ({}, {"rates_hz": {"vehicle_attitude": np.nan}}, "the rate of vehicle_attitude is nan Hz"),
    ],
)
def test_what_no_log_can_hold_is_refused_and_nothing_written(
    tmp_path: Path, changes: dict[str, Any], options: dict[str, Any], sentence: str
) -> None:
    flown = flight(**{name: value for name, value in changes.items() if name != "wrong"})
    if "wrong" in changes:
        channel, value = changes["wrong"]
        values = np.where(np.arange(2000) == 1234, value, flown.columns[channel])
        flown = replace(flown, columns={**flown.columns, channel: values})
    with pytest.raises(UsageError, match=sentence):
        write_px4(tmp_path / "flight.ulg", flown, **options)
    assert not list(tmp_path.iterdir())


def test_fields_and_types_are_those_of_a_log_of_px4(unpacked: Callable[[str], Path]) -> None:
    known = walk(unpacked("px4_sitl/roll.ulg").read_bytes()).definitions.formats
    compared = [layout for layout in LAYOUTS if not layout.topic.startswith("debug_")]
    for layout in compared:
        theirs = [member for member in known[layout.topic] if not member.name.startswith("_padding")]
        spelled = ";".join(
            f"{member.kind}{'' if member.count is None else f'[{member.count}]'} {member.name}" for member in theirs
        )
        assert layout.fields == spelled, layout.topic


def test_parameters_that_are_whole_numbers_in_px4_are_here(unpacked: Callable[[str], Path]) -> None:
    parameters = pyulog.ULog(str(unpacked("px4_sitl/roll.ulg")), []).initial_parameters
    families = re.compile(r"(CA|SDLOG|SYS|IMU|MC|MPC|THR|HTE|BAT1?|MAV|PWM)_|SENS_BOARD_")
    compared = {name: value for name, value in parameters.items() if families.match(name)}
    assert len(compared) > 300
    wrong = [name for name, value in compared.items() if isinstance(value, int) != bool(re.fullmatch(INTEGERS, name))]
    assert not wrong


@pytest.mark.slow
def test_eight_minutes_at_a_kilohertz_are_written(tmp_path: Path) -> None:
    flown = flight(samples=480_000)
    write_px4(tmp_path / "flight.ulg", flown)
    assert (tmp_path / "flight.ulg").stat().st_size > 190e6
