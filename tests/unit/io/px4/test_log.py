"""PX4 topics, old and new, on logs that are built here message by message."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.px4 import log as px4

SOURCE = Source(name="flight.ulg", format=px4.FORMAT, sha256="")
PIECES = {"uint64_t": "Q", "float": "f"}
Fields = Mapping[str, Sequence[float]]


def message(letter: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(letter)) + payload


def keyed(kind: str, name: str, value: bytes) -> bytes:
    key = f"{kind} {name}".encode()
    return bytes([len(key)]) + key + value


def ulog(topics: Mapping[str, Fields], parameters: Mapping[str, float] | None = None, extra: bytes = b"") -> bytes:
    """A ULog with one instance of each topic; stamps are unsigned, all else is float."""
    parts = [px4.MAGIC + b"\x01" + struct.pack("<Q", 0)]  # type: ignore[attr-defined]
    parts += [
        message("P", keyed("float", name, struct.pack("<f", value))) for name, value in (parameters or {}).items()
    ]
    for name, fields in topics.items():
        kinds = ["uint64_t" if label.startswith("timestamp") else "float" for label in fields]
        names = ";".join(f"{kind} {label}" for kind, label in zip(kinds, fields, strict=True))
        parts.append(message("F", f"{name}:{names};".encode()))
    for number, (name, fields) in enumerate(topics.items()):
        parts.append(message("A", struct.pack("<BH", 0, number) + name.encode()))
        packer = struct.Struct("<H" + "".join("Q" if label.startswith("timestamp") else "f" for label in fields))
        parts += [message("D", packer.pack(number, *row)) for row in zip(*fields.values(), strict=True)]
    return b"".join([*parts, extra])


def stamps(count: int = 5, step_us: int = 4000) -> list[int]:
    return [1_000_000 + step_us * index for index in range(count)]


def read(folder: Path, topics: Mapping[str, Fields], parameters: Mapping[str, float] | None = None) -> FlightRecord:
    (folder / "flight.ulg").write_bytes(ulog(topics, parameters))
    return px4.read(folder / "flight.ulg", SOURCE)


def spread(names: str, **clocks: Sequence[int]) -> dict[str, Sequence[float]]:
    """Fields with constant values 1, 2, 3, ... in their order."""
    count = len(next(iter(clocks.values())))
    return {**clocks, **{name: [float(number)] * count for number, name in enumerate(names.split(), start=1)}}


def value_of(record: FlightRecord, name: str) -> float:
    topic, row = next(record.holding(name))
    return float(topic.values[row, 0])


@pytest.mark.parametrize(
    ("topic", "fields", "expected"),
    [
        ("vehicle_torque_setpoint", "xyz[0] xyz[1] xyz[2]", {"roll_command": 1, "pitch_command": 2, "yaw_command": 3}),
        ("vehicle_thrust_setpoint", "xyz[0] xyz[1] xyz[2]", {"thrust_command": -3}),
        (
            "actuator_controls_0",
            "control[0] control[1] control[2] control[3]",
            {"roll_command": 1, "thrust_command": 4},
        ),
        ("vehicle_angular_velocity", "xyz[0] xyz[1] xyz[2]", {"p": 1, "q": 2, "r": 3}),
        ("sensor_combined", "gyro_rad[0] gyro_rad[1] gyro_rad[2]", {"p": 1, "q": 2, "r": 3}),
        ("vehicle_attitude", "rollspeed pitchspeed yawspeed", {"p": 1, "q": 2, "r": 3}),
        ("vehicle_local_position", "x y z vx vy vz", {"north": 1, "down": 3, "velocity_north": 4, "velocity_down": 6}),
        ("trajectory_setpoint", "velocity[0] velocity[1] velocity[2]", {"velocity_north_feedforward": 1}),
        (
            "vehicle_local_position_setpoint",
            "acceleration[0] acceleration[1] acceleration[2]",
            {"acceleration_north_setpoint": 1, "acceleration_down_setpoint": 3},
        ),
        ("vehicle_attitude_setpoint", "roll_body pitch_body yaw_body", {"phi_setpoint": 1, "psi_setpoint": 3}),
        ("vehicle_rates_setpoint", "roll pitch yaw", {"p_setpoint": 1, "q_setpoint": 2, "r_setpoint": 3}),
        ("manual_control_setpoint", "roll pitch yaw throttle", {"roll_stick": 1, "pitch_stick": 2, "thrust_stick": 4}),
        # Before 2022 x was forward, which is pitch, and y to the right, which is roll.
        ("manual_control_setpoint", "x y z r", {"pitch_stick": 1, "roll_stick": 2, "thrust_stick": 3, "yaw_stick": 4}),
        ("battery_status", "voltage_v", {"battery_voltage": 1}),
    ],
)
def test_every_topic_becomes_its_channels(tmp_path: Path, topic: str, fields: str, expected: dict[str, float]) -> None:
    record = read(tmp_path, {topic: spread(fields, timestamp=stamps())})
    assert {name: value_of(record, name) for name in expected} == expected


def test_attitude_comes_from_the_quaternion(tmp_path: Path) -> None:
    half = np.pi / 8
    fields = {
        "timestamp": stamps(),
        **{f"q[{i}]": [v] * 5 for i, v in enumerate([np.cos(half), np.sin(half), 0.0, 0.0])},
    }
    record = read(tmp_path, {"vehicle_attitude": fields})
    # Logged in single precision.
    assert value_of(record, "phi") == pytest.approx(np.pi / 4, rel=1e-6)
    assert value_of(record, "psi") == 0.0


def test_motors_that_do_not_exist_are_left_out(tmp_path: Path) -> None:
    fields = spread("control[0] control[1] control[2]", timestamp=stamps()) | {"control[2]": [float("nan")] * 5}
    record = read(tmp_path, {"actuator_motors": fields})
    assert record.channel_names == ("motor_1", "motor_2")


def test_the_newest_topic_is_preferred_and_the_older_one_kept(tmp_path: Path) -> None:
    topics = {
        "actuator_controls_0": spread("control[0] control[1] control[2] control[3]", timestamp=stamps()),
        "vehicle_torque_setpoint": spread("xyz[0] xyz[1] xyz[2]", timestamp=stamps()),
    }
    assert [topic.name for topic, _ in read(tmp_path, topics).holding("roll_command")] == list(topics)[::-1]


def test_a_measurement_has_the_stamp_of_its_sample_and_a_command_that_of_its_publication(tmp_path: Path) -> None:
    clocks = {"timestamp": stamps(), "timestamp_sample": [stamp - 400 for stamp in stamps()]}
    topics = {
        name: spread("xyz[0] xyz[1] xyz[2]", **clocks)
        for name in ("vehicle_angular_velocity", "vehicle_torque_setpoint")
    }
    record = read(tmp_path, topics)
    assert next(record.holding("p"))[0].time_s[0] == pytest.approx(1.0 - 400e-6, abs=1e-12)
    assert next(record.holding("roll_command"))[0].time_s[0] == 1.0


@pytest.mark.parametrize("samples", [[0] * 5, [stamp + 1 for stamp in stamps()], [1] * 5])
def test_sample_stamps_that_cannot_be_true_are_not_used(tmp_path: Path, samples: list[int]) -> None:
    fields = spread("xyz[0] xyz[1] xyz[2]", timestamp=stamps(), timestamp_sample=samples)
    record = read(tmp_path, {"vehicle_angular_velocity": fields})
    assert record.topics[0].time_s[0] == 1.0


def test_samples_that_are_no_numbers_are_left_out_with_a_finding(tmp_path: Path) -> None:
    fields = spread("roll_body pitch_body yaw_body", timestamp=stamps()) | {"yaw_body": [float("nan"), 1, 1, 1, 1]}
    record = read(tmp_path, {"vehicle_attitude_setpoint": fields})
    assert {topic.channels[0].name: topic.time_s.size for topic in record.topics} == {
        "phi_setpoint": 5,
        "psi_setpoint": 4,
    }
    assert [finding.numbers["lost_samples"] for finding in record.findings if finding.kind == "gap"] == [1]


def test_yaw_has_no_set_point_among_its_instruments(tmp_path: Path) -> None:
    topics = {
        "manual_control_setpoint": spread("roll pitch yaw throttle", timestamp=stamps()),
        "vehicle_attitude_setpoint": spread("roll_body pitch_body yaw_body", timestamp=stamps()),
        "vehicle_rates_setpoint": spread("roll pitch yaw", timestamp=stamps()),
    }
    assert read(tmp_path, topics).instruments == {
        "roll": ("roll_stick", "phi_setpoint"),
        "pitch": ("pitch_stick", "theta_setpoint"),
        "yaw": ("yaw_stick",),
        "thrust": ("thrust_stick",),
    }


@pytest.mark.parametrize(("step_us", "slow"), [(8000, False), (8100, True)])
def test_commands_below_half_the_gyro_rate_are_remarked_on(tmp_path: Path, step_us: int, slow: bool) -> None:
    topics = {
        "vehicle_torque_setpoint": spread("xyz[0] xyz[1] xyz[2]", timestamp=stamps(step_us=step_us)),
        "vehicle_angular_velocity": spread("xyz[0] xyz[1] xyz[2]", timestamp=stamps()),
    }
    found = [finding for finding in read(tmp_path, topics).findings if finding.kind == "rate_too_low"]
    assert bool(found) == slow
    assert all("SDLOG_PROFILE" in finding.message for finding in found)


def test_a_raw_sensor_is_the_last_resort_and_not_used_when_it_is_turned(tmp_path: Path) -> None:
    raw: dict[str, Fields] = {"sensor_gyro": spread("x y z", timestamp=stamps())}
    assert value_of(read(tmp_path, raw), "q") == 2.0
    both = raw | {"sensor_combined": spread("gyro_rad[0] gyro_rad[1] gyro_rad[2]", timestamp=stamps())}
    assert [topic.name for topic, _ in read(tmp_path, both).holding("q")] == ["sensor_combined"]
    turned = read(tmp_path, raw | {"battery_status": spread("voltage_v", timestamp=stamps())}, {"SENS_BOARD_ROT": 4.0})
    assert "q" not in turned.channel_names
    assert any("SENS_BOARD_ROT" in finding.message for finding in turned.findings)


def test_dropouts_parameters_and_firmware_are_kept(tmp_path: Path) -> None:
    extra = b"".join(
        [
            message("O", struct.pack("<H", 250)),
            message("P", keyed("float", "MC_ROLL_P", struct.pack("<f", 7.0))),
            message("I", keyed("uint32_t", "ver_sw_release", struct.pack("<I", 0x010E02FF))),
            message("I", keyed("char[3]", "sys_name", b"PX4")),
        ]
    )
    topics = {"battery_status": spread("voltage_v", timestamp=stamps())}
    (tmp_path / "flight.ulg").write_bytes(ulog(topics, {"MC_ROLL_P": 6.5, "MC_YAW_P": 2.0}, extra))
    record = px4.read(tmp_path / "flight.ulg", SOURCE)
    assert record.parameters == {"MC_ROLL_P": 7.0, "MC_YAW_P": 2.0}
    assert record.source.firmware == "PX4 1.14.2"
    (gap,) = (finding for finding in record.findings if finding.kind == "gap")
    assert gap.numbers["lost_s"] == 0.25
    assert gap.message.startswith("The logger lost 0.250 s of data at ")


def debug(letters: str, published: Sequence[tuple[str, float]], kind: str = "char") -> bytes:
    """Formats, subscriptions and messages of signals of one's own; thrust with twice the value."""
    vector = f"debug_vect:uint64_t timestamp;float x;float y;float z;{kind}[{letters}] name;"
    scalar = f"debug_key_value:uint64_t timestamp;float value;{kind}[{letters}] key;"
    parts = [message("F", text.encode()) for text in (vector, scalar)]
    parts += [message("A", struct.pack("<BH", 0, 90) + b"debug_vect")]
    parts += [message("A", struct.pack("<BH", 0, 91) + b"debug_key_value")]
    for index, (name, value) in enumerate(published):
        stamp, text = 1_000_000 + 2000 * index, name.encode().ljust(int(letters), b"\0")
        parts.append(message("D", struct.pack("<HQfff", 90, stamp, value, -value, 0.0) + text))
        parts.append(message("D", struct.pack("<HQf", 91, stamp, 2.0 * value) + text))
    return b"".join(parts)


def read_debug(folder: Path, extra: bytes) -> FlightRecord:
    topics = {"vehicle_angular_velocity": spread("xyz[0] xyz[1] xyz[2]", timestamp=stamps())}
    (folder / "flight.ulg").write_bytes(ulog(topics, None, extra))
    return px4.read(folder / "flight.ulg", SOURCE)


@pytest.mark.parametrize("kind", ["char", "int8_t"])
def test_an_excitation_is_what_was_published_under_its_name(tmp_path: Path, kind: str) -> None:
    published = [("excite", 0.5), ("excited", 9.0), ("excite", 0.25), ("excit", 9.0), ("velx", 9.0), ("excite", -1.0)]
    record = read_debug(tmp_path, debug("10", published, kind))
    topic, row = next(record.holding("roll_excitation"))
    assert topic.values[row].tolist() == [0.5, 0.25, -1.0]
    np.testing.assert_allclose(topic.time_s, [1.0, 1.004, 1.01], rtol=1e-15)
    pitch, thrust = (next(record.holding(f"{axis}_excitation")) for axis in ("pitch", "thrust"))
    assert pitch[0].values[pitch[1]].tolist() == [-0.5, -0.25, 1.0]
    assert thrust[0].values[thrust[1]].tolist() == [1.0, 0.5, -2.0]
    assert topic.channels[row].source == "debug_vect.x"
    assert record.instruments["yaw"] == ("yaw_excitation",)


@pytest.mark.parametrize(
    ("letters", "published"), [("10", [("velx", 1.0)] * 5), ("10", []), ("6", [("excite", 1.0)] * 5)]
)
def test_signals_under_other_names_are_no_excitation(
    tmp_path: Path, letters: str, published: list[tuple[str, float]]
) -> None:
    record = read_debug(tmp_path, debug(letters, published))
    assert record.channel_names == ("p", "q", "r")
    assert record.instruments == {}


def test_a_log_without_any_known_topic_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="contains no topic"):
        read(tmp_path, {"cpuload": spread("load", timestamp=stamps())})


def test_the_sticks_of_the_simulator_move_when_they_should(unpacked: Callable[[str], Path]) -> None:
    record = px4.read(unpacked("px4_sitl/roll.ulg"), SOURCE)
    topic, row = next(record.holding("roll_stick"))
    moving = topic.time_s[np.abs(topic.values[row]) > 0.01]
    # A sweep from 40.54 to 122.54 s that starts and stops softly.
    assert 40.54 <= moving[0] <= 43.0
    assert 120.0 <= moving[-1] <= 122.54
    assert not record.findings


def test_the_fifo_log_of_2017_gives_rates_and_specific_force(unpacked: Callable[[str], Path]) -> None:
    record = px4.read(unpacked("px4/s250_2017.ulg"), SOURCE)
    topic, row = next(record.holding("az"))
    assert topic.values[row].mean() == pytest.approx(-9.81, rel=0.02)
    assert {"p", "q", "r"} <= set(record.channel_names)
    assert "missing_channel" in {finding.kind for finding in record.findings}
