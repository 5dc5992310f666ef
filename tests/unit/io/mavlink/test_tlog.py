"""MAVLink telemetry: layouts against pymavlink, clocks, senders, units, and flights that pymavlink wrote."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.mavlink import tlog
from rotorid.io.mavlink.messages import LAYOUTS, STAMP_BYTES, decode
from rotorid.units import STANDARD_GRAVITY_M_S2

am = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega", reason="pymavlink writes the logs of these tests")

SOURCE = Source(name="flight.tlog", format=tlog.FORMAT, sha256="")
BOOT_US = 1_790_000_000_000_000
LATENCY_US = 30_000


class Station:
    """A ground station that stores what an autopilot sends."""

    def __init__(self, *, version: int = 2, system: int = 1, component: int = 1, signed: bool = False) -> None:
        self.link = am.MAVLink(None, srcSystem=system, srcComponent=component)
        self.version = version
        if signed:
            self.link.signing.secret_key = bytes(32)
            self.link.signing.sign_outgoing = True

    def frame(self, time_s: float, name: str, *values: Any) -> bytes:
        message = am.mavlink_map[next(number for number, item in LAYOUTS.items() if item.name == name)](*values)
        packed = message.pack(self.link, force_mavlink1=self.version == 1)
        return struct.pack(">Q", BOOT_US + round(time_s * 1e6) + LATENCY_US) + bytes(packed)


def attitude(station: Station, time_s: float) -> bytes:
    wave = float(np.sin(time_s))
    return station.frame(time_s, "ATTITUDE", round(time_s * 1e3), wave, 0.1, -0.2, 0.3 * wave, 0.0, 0.5)


def heartbeat(station: Station, autopilot: int = 3, vehicle: int = 2) -> bytes:
    return station.frame(0.0, "HEARTBEAT", vehicle, autopilot, 0, 0, 4, 3)


def read_bytes(folder: Path, parts: Iterable[bytes]) -> FlightRecord:
    (folder / "flight.tlog").write_bytes(b"".join(parts))
    return tlog.read(folder / "flight.tlog", SOURCE)


@pytest.mark.parametrize("number", LAYOUTS)
def test_layouts_are_those_of_the_protocol(number: int) -> None:
    layout, truth = LAYOUTS[number], am.mavlink_map[number]
    assert (layout.name, layout.crc_extra) == (truth.msgname, truth.crc_extra)
    whole = truth.unpacker.format
    held = struct.calcsize(whole)
    # Values that differ from byte to byte: each field must stand where the reference has it.
    payload = bytes(range(1, held + 1))
    numbers = list(truth.unpacker.unpack(payload))
    ours = np.frombuffer(payload[: layout.fields.itemsize], layout.fields)[0]
    assert [part if isinstance(part, bytes) else part.item() for part in ours] == [
        part if not isinstance(part, float) else np.float32(part).item() for part in numbers[: len(ours)]
    ]


@pytest.mark.parametrize(("version", "signed"), [(1, False), (2, False), (2, True)])
def test_both_versions_and_signed_frames_are_read(tmp_path: Path, version: int, signed: bool) -> None:
    station = Station(version=version, signed=signed)
    times = np.arange(100) * 0.1
    record = read_bytes(tmp_path, (attitude(station, time) for time in times))
    topic, row = next(record.holding("phi"))
    np.testing.assert_allclose(topic.time_s, times, atol=1e-9)
    np.testing.assert_array_equal(topic.values[row], np.float32(np.sin(times)))
    assert [finding.kind for finding in record.findings] == ["decimated", "missing_channel"]
    assert record.findings[0].numbers["fastest_hz"] == pytest.approx(10.0)


def test_the_rate_that_counts_is_that_of_motion(tmp_path: Path) -> None:
    station = Station()
    frames = [attitude(station, 0.1 * k) for k in range(20)]
    frames += [station.frame(0.02 * k, "SYS_STATUS", 0, 0, 0, 0, 12_600, *[0] * 8) for k in range(100)]
    record = read_bytes(tmp_path, frames)
    (finding,) = (finding for finding in record.findings if finding.kind == "decimated")
    assert max(topic.sample_rate_hz for topic in record.topics) == pytest.approx(50.0)
    assert finding.numbers["fastest_hz"] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("number", "vehicle", "said"), [(1, "plane", True), (2, "multirotor", False), (20, "VTOL", True), (0, "", False)]
)
def test_the_heartbeat_names_the_vehicle(tmp_path: Path, number: int, vehicle: str, said: bool) -> None:
    station = Station()
    ground = heartbeat(Station(system=255, component=190), autopilot=8, vehicle=6)
    beats = [heartbeat(station, vehicle=number)] * 3
    record = read_bytes(tmp_path, [ground, *beats, *(attitude(station, 0.1 * k) for k in range(20))])
    assert record.status.vehicle == vehicle
    assert ("other_vehicle" in [finding.kind for finding in record.findings]) == said


def test_a_log_is_recognized_by_its_frames(tmp_path: Path) -> None:
    two = attitude(Station(), 0.0) + attitude(Station(version=1), 0.1)
    assert tlog.sniff(two + b"rest")
    assert tlog.sniff(attitude(Station(), 0.0))
    assert not tlog.sniff(two[STAMP_BYTES:])
    assert not tlog.sniff(attitude(Station(), 0.0) + b"something else entirely")
    assert not tlog.sniff(b"\x00\x06" + bytes(100))


def test_integer_sensors_are_scaled_and_raw_counts_are_not_believed(tmp_path: Path) -> None:
    station = Station()
    imu = (100, -200, -1000, 10, -20, 30, 0, 0, 0)
    frames = [station.frame(0.1 * k, "RAW_IMU", 100_000 * k, *imu) for k in range(9)]
    record = read_bytes(tmp_path, [heartbeat(station), *frames])
    rates, accelerations = record.topics
    np.testing.assert_allclose(rates.values[:, 0], [0.01, -0.02, 0.03], rtol=1e-15)
    np.testing.assert_allclose(accelerations.values[:, 0], np.array([0.1, -0.2, -1.0]) * STANDARD_GRAVITY_M_S2)
    with pytest.raises(LogError, match="contains only HEARTBEAT, RAW_IMU"):
        read_bytes(tmp_path, [heartbeat(station, autopilot=12), *frames])


def test_motors_and_sticks_follow_the_parameters(tmp_path: Path) -> None:
    station = Station()
    parameters = {"FRAME_CLASS": 1.0, "MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0, "RC3_MIN": 1000.0}
    frames = [station.frame(0.0, "PARAM_VALUE", key.encode(), value, 9, 4, 0) for key, value in parameters.items()]
    frames += [station.frame(0.0, "PARAM_VALUE", b"SIM_OPOS_LAT", 47.0, 9, 4, 0)]
    for k in range(9):
        frames.append(station.frame(0.1 * k, "SERVO_OUTPUT_RAW", 100_000 * k, 0, *[1100, 1300, 1500, 1900], *[0] * 4))
        frames.append(station.frame(0.1 * k, "RC_CHANNELS", 100 * k, 16, *[1750, 1500, 1250, 1500], *[0] * 14, 0))
    record = read_bytes(tmp_path, [heartbeat(station), *frames])
    motors, sticks = record.topics
    np.testing.assert_allclose(motors.values[:, 0], [0.0, 0.25, 0.5, 1.0], rtol=1e-15)
    np.testing.assert_allclose(sticks.values[:, 0], [0.5, 0.0, 0.0, 0.25], rtol=1e-15)
    assert record.parameters == parameters
    assert record.instruments["pitch"] == ("pitch_stick",)
    assert record.source.firmware == "ArduPilot"


def test_set_points_that_are_masked_are_left_out(tmp_path: Path) -> None:
    station = Station()
    half = float(np.sqrt(0.5))
    frames = [
        station.frame(0.1 * k, "ATTITUDE_TARGET", 100 * k, mask, [half, half, 0.0, 0.0], 0.1, 0.2, 0.3, 0.5)
        for k, mask in enumerate([0, 128, 7, 64])
    ]
    record = read_bytes(tmp_path, frames)
    sizes = {topic.channels[0].name: topic.time_s.size for topic in record.topics}
    assert sizes == {"thrust_command": 3, "phi_setpoint": 3, "p_setpoint": 3}
    topic, row = next(record.holding("phi_setpoint"))
    # Single precision of the quaternion on the wire.
    np.testing.assert_allclose(topic.values[row], np.pi / 2, rtol=1e-6)


def test_commands_come_from_the_attitude_group(tmp_path: Path) -> None:
    station = Station()
    frames = [
        station.frame(0.1 * k, "ACTUATOR_CONTROL_TARGET", 100_000 * k, k % 2, [0.25, -0.5, 0.125, 0.75, 0, 0, 0, 0])
        for k in range(8)
    ]
    (topic,) = read_bytes(tmp_path, frames).topics
    assert topic.values.T.tolist() == [[0.25, -0.5, 0.125, 0.75]] * 4
    assert topic.row("roll_command") == 0


def test_px4_integers_are_taken_from_the_bytes_of_the_float(tmp_path: Path) -> None:
    station = Station()
    value = struct.unpack("<f", struct.pack("<i", 25))[0]
    frames = [
        heartbeat(station, autopilot=12),
        station.frame(0.0, "PARAM_VALUE", b"SDLOG_PROFILE", value, 6, 2, 0),
        station.frame(0.0, "PARAM_VALUE", b"MC_ROLLRATE_P", 0.15, 9, 2, 1),
        attitude(station, 0.1),
    ]
    parameters = read_bytes(tmp_path, frames).parameters
    assert parameters["SDLOG_PROFILE"] == 25.0
    assert parameters["MC_ROLLRATE_P"] == pytest.approx(0.15, rel=1e-7)


def test_short_microsecond_stamps_are_unwrapped_and_missing_ones_are_those_of_reception(tmp_path: Path) -> None:
    station = Station()
    parameters = [station.frame(0.0, "PARAM_VALUE", b"FRAME_CLASS", 1.0, 1, 4, 0)]
    times = 2.0**32 * 1e-6 + np.arange(-5, 5) * 0.1
    frames = []
    for time in times:
        frames.append(attitude(station, float(time)))
        frames.append(
            station.frame(
                float(time), "SERVO_OUTPUT_RAW", round(time * 1e6) % 2**32, 0, 1500, 1500, 1500, 1500, 0, 0, 0, 0
            )
        )
        frames.append(station.frame(float(time) + 0.004, "SYS_STATUS", 0, 0, 0, 0, 12_600, 0, 0, 0, 0, 0, 0, 0, 0))
    record = read_bytes(tmp_path, [heartbeat(station), *parameters, *frames])
    motors = next(topic for topic in record.topics if topic.row("motor_1") is not None)
    np.testing.assert_allclose(motors.time_s, times, atol=1e-5)
    battery = next(topic for topic in record.topics if topic.row("battery_voltage") is not None)
    np.testing.assert_allclose(battery.values[0], 12.6, rtol=1e-15)
    # The stamp of boot is a whole millisecond, and so is the estimate of the boot good to one.
    np.testing.assert_allclose(battery.time_s, times + 0.004, atol=1e-3)


def test_a_restart_is_said(tmp_path: Path) -> None:
    station = Station()
    times = [*range(100, 110), *range(5, 10)]
    frames = [
        struct.pack(">Q", BOOT_US + 10**6 * (100 + k)) + attitude(station, float(time))[STAMP_BYTES:]
        for k, time in enumerate(times)
    ]
    record = read_bytes(tmp_path, frames)
    (finding,) = (finding for finding in record.findings if finding.kind == "clock_skew")
    assert finding.numbers["restarts"] == 1


def test_of_several_vehicles_the_talkative_one_is_read_and_the_ground_station_never(tmp_path: Path) -> None:
    first, second, ground = Station(system=1), Station(system=2), Station(system=255, component=190)
    frames = [attitude(first, 0.1 * k) for k in range(20)] + [attitude(second, 0.1 * k) for k in range(5)]
    frames += [heartbeat(ground, autopilot=8)] * 100
    record = read_bytes(tmp_path, frames)
    assert record.topics[0].time_s.size == 20
    (finding,) = (finding for finding in record.findings if finding.kind == "several_vehicles")
    assert finding.numbers["read_system"] == 1


def test_every_value_equals_pymavlink(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    station = Station()
    frames = []
    for k in range(200):
        frames.append(station.frame(0.02 * k, "ATTITUDE", 20 * k, *rng.normal(size=6).tolist()))
        frames.append(station.frame(0.02 * k, "LOCAL_POSITION_NED", 20 * k, *rng.normal(size=6).tolist()))
    data = b"".join(frames)
    ours = decode(data).messages
    reference = am.MAVLink(None)
    stored = [reference.decode(bytearray(frame[STAMP_BYTES:])) for frame in frames]
    for name in ("ATTITUDE", "LOCAL_POSITION_NED"):
        same = [message for message in stored if message.get_type() == name]
        for field in ours[name].fields.dtype.names or ():
            assert ours[name].fields[field].tolist() == [getattr(message, field) for message in same]


@pytest.mark.parametrize(
    ("autopilot", "vehicle", "firmware"),
    [(3, 2, "ArduCopter V4.6.2"), (3, 1, "ArduPilot V4.6.2"), (12, 2, "PX4 4.6.2")],
)
def test_the_version_of_the_firmware_is_that_which_was_sent(
    tmp_path: Path, autopilot: int, vehicle: int, firmware: str
) -> None:
    station = Station()
    number = 4 << 24 | 6 << 16 | 2 << 8 | 255
    sent = station.frame(0.0, "AUTOPILOT_VERSION", 0, number, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
    told = read_bytes(tmp_path, [heartbeat(station, autopilot, vehicle), sent, attitude(station, 1.0)])
    assert told.source.firmware == firmware


def test_speeds_of_some_motors_are_those_of_their_outputs(tmp_path: Path) -> None:
    station = Station()
    functions = {1: 33, 2: 34, 3: 35, 4: 36, 5: 37}
    frames = [heartbeat(station), *(attitude(station, 0.1 * k) for k in range(3))]
    frames += [
        station.frame(0.0, "PARAM_VALUE", f"SERVO{channel}_FUNCTION".encode(), value, 9, 5, channel)
        for channel, value in functions.items()
    ]
    zeros = [0] * 4
    for k in range(3):
        frames.append(
            station.frame(0.1 * k, "ESC_TELEMETRY_1_TO_4", zeros, zeros, zeros, zeros, [0, 4000, 0, 0], zeros)
        )
        frames.append(station.frame(0.1 * k, "ESC_TELEMETRY_5_TO_8", zeros, zeros, zeros, zeros, [900, 0, 0, 0], zeros))
    record = read_bytes(tmp_path, frames)
    found = {name: float(record[name].values[0]) for name in record.channel_names if name.startswith("motor_speed")}
    assert found == pytest.approx({"motor_speed_2": 4000 * np.pi / 30, "motor_speed_5": 900 * np.pi / 30})


def test_attitude_comes_from_a_quaternion_where_no_angles_are_sent(tmp_path: Path) -> None:
    station, half = Station(), 0.3
    values = (float(np.cos(half)), 0.0, float(np.sin(half)), 0.0, 0.1, 0.2, 0.3)
    record = read_bytes(tmp_path, [station.frame(0.1 * k, "ATTITUDE_QUATERNION", 100 * k, *values) for k in range(3)])
    assert record["theta"].values == pytest.approx([0.6] * 3)
    assert record["q"].values == pytest.approx([0.2] * 3)


def test_motors_of_px4_are_its_pulses_between_their_limits(tmp_path: Path) -> None:
    station = Station()
    frames = [heartbeat(station, autopilot=12)]
    for place, (name, value) in enumerate({"PWM_MAIN_MIN": 1100, "PWM_MAIN_MAX": 1900}.items()):
        number = float(np.array([value], np.int32).view(np.float32)[0])
        frames.append(station.frame(0.0, "PARAM_VALUE", name.encode(), number, 6, 2, place))
    pulses = [900, 1100, 1500, 1900, *[0] * 4]
    for k in range(3):
        frames += [attitude(station, 0.1 * k), station.frame(0.1 * k, "SERVO_OUTPUT_RAW", 100_000 * k, 0, *pulses)]
    record = read_bytes(tmp_path, frames)
    found = [float(record[f"motor_{number}"].values[1]) for number in range(1, 5)]
    assert found == pytest.approx([0.0, 0.0, 0.5, 1.0])
    assert record["motor_1"].channel.source == "SERVO_OUTPUT_RAW.output[0]"
