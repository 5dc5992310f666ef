"""Crazyflie uSD logs that are built here byte by byte: axes, units, versions, events."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from rotorid.autopilots.advice import channel_advice, motor_advice, unread_words
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io import crazyflie
from rotorid.units import STANDARD_GRAVITY_M_S2

SOURCE = Source(name="log00", format=crazyflie.FORMAT, sha256="")
Variables = Mapping[str, tuple[str, float]]
"""Variable to its letter and its constant value."""

FLIGHT: Variables = {
    "acc.x": ("f", 0.1),
    "acc.y": ("f", 0.2),
    "acc.z": ("f", 1.0),
    "gyro.x": ("f", 10.0),
    "gyro.y": ("f", 20.0),
    "gyro.z": ("f", 30.0),
    **{f"motor.m{number}": ("H", 10000 * number) for number in range(1, 5)},
}


def usd(events: Sequence[Variables], *, version: int = 2, samples: int = 5, step: int = 1) -> bytes:
    """A log in which the events take turns; stamps are whole steps in the unit of the version."""
    out = b"\xbc" + struct.pack("<HH", version, len(events))
    for number, variables in enumerate(events):
        out += struct.pack("<H", number) + b"event%d\0" % number + struct.pack("<H", len(variables))
        out += b"".join(f"{name}({letter})".encode() + b"\0" for name, (letter, _) in variables.items())
    for sample in range(samples):
        for number, variables in enumerate(events):
            out += struct.pack("<HI" if version == 1 else "<HQ", number, 1000 + step * sample)
            out += b"".join(struct.pack(f"<{letter}", value) for letter, value in variables.values())
    return out + struct.pack("<I", zlib.crc32(out))


def read(folder: Path, data: bytes) -> FlightRecord:
    (folder / "log00").write_bytes(data)
    return crazyflie.read(folder / "log00", SOURCE)


def value_of(record: FlightRecord, name: str) -> float:
    topic, row = next(record.holding(name))
    return float(topic.values[row, 0])


def test_axes_turn_from_forward_left_up_to_forward_right_down(tmp_path: Path) -> None:
    record = read(tmp_path, usd([FLIGHT]))
    expected = {
        "ax": 0.1 * STANDARD_GRAVITY_M_S2,
        "ay": -0.2 * STANDARD_GRAVITY_M_S2,
        "az": -STANDARD_GRAVITY_M_S2,
        "p": np.deg2rad(10.0),
        "q": -np.deg2rad(20.0),
        "r": -np.deg2rad(30.0),
        "motor_4": 40000 / 65535,
        "thrust_command": 25000 / 65535,
    }
    # Logged in single precision.
    assert {name: value_of(record, name) for name in expected} == pytest.approx(expected, rel=1e-7)
    assert record.instruments == {}
    assert not [finding for finding in record.findings if finding.kind != "rate_too_low"]


@pytest.mark.parametrize(
    ("variable", "channel", "factor"),
    [
        # The firmware counts pitch with the nose up, although its axes point left and up.
        ("stateEstimate.pitch", "theta", np.pi / 180),
        ("stateEstimate.yaw", "psi", -np.pi / 180),
        ("stateEstimate.y", "east", -1.0),
        ("stateEstimate.vz", "velocity_down", -1.0),
        ("stateEstimateZ.ratePitch", "q", 1e-3),
        ("stateEstimateZ.rateYaw", "r", -1e-3),
        ("stateEstimateZ.z", "down", -1e-3),
        ("controller.cmd_yaw", "yaw_command", 1 / 32767),
        ("controller.pitchRate", "q_setpoint", np.pi / 180),
        ("ctrltarget.pitch", "theta_setpoint", np.pi / 180),
        ("ctrltarget.y", "east_setpoint", -1.0),
        # What the firmware calls the yaw of its target is a rate.
        ("ctrltarget.yaw", "r_setpoint", -np.pi / 180),
        ("ctrltargetZ.z", "down_setpoint", -1e-3),
        ("ctrlLee.rpyy", "theta", -1.0),
        ("ctrlLee.rpydy", "theta_setpoint", -1.0),
        ("ctrlLee.omegaz", "r", -1.0),
        ("ctrlLee.omegarx", "p_setpoint", 1.0),
        ("stabilizer.pitch", "theta", np.pi / 180),
        ("stabilizer.thrust", "thrust_command", 1 / 65535),
        ("pwm.m3_pwm", "motor_3", 1 / 65535),
        ("motor.m3req", "motor_3", 1 / 65535),
        ("locSrv.y", "east", -1.0),
        ("rpm.m2", "motor_speed_2", np.pi / 30),
        ("pm.vbat", "battery_voltage", 1.0),
        ("pm.vbatMV", "battery_voltage", 1e-3),
    ],
)
def test_other_variables_have_their_meaning(tmp_path: Path, variable: str, channel: str, factor: float) -> None:
    record = read(tmp_path, usd([{variable: ("h", 300)}]))
    assert record.channel_names == (channel,)
    assert value_of(record, channel) == pytest.approx(300 * factor, rel=1e-12)


ATTITUDE = (0.3, -0.4, 1.9)
"""Roll, pitch and yaw in the axes of this package."""


def quaternion(phi: float, theta: float, psi: float) -> dict[str, float]:
    """Parts of the firmware's quaternion, from forward, left, up to its earth: pitch and yaw turn their sign."""
    half = np.array([phi, -theta, -psi]) / 2
    (c1, c2, c3), (s1, s2, s3) = np.cos(half), np.sin(half)
    return {
        "qw": c1 * c2 * c3 + s1 * s2 * s3,
        "qx": s1 * c2 * c3 - c1 * s2 * s3,
        "qy": c1 * s2 * c3 + s1 * c2 * s3,
        "qz": c1 * c2 * s3 - s1 * s2 * c3,
    }


def compressed(parts: Mapping[str, float]) -> int:
    """Two bits for the largest part, then a sign and nine bits of each of the others."""
    values = [parts[name] for name in ("qx", "qy", "qz", "qw")]
    largest = max(range(4), key=lambda part: abs(values[part]))
    word = largest
    for part in (part for part in range(4) if part != largest):
        value = values[part] * np.sign(values[largest])
        word = word << 10 | (value < 0) << 9 | round(511 * np.sqrt(2) * abs(value))
    return word


@pytest.mark.parametrize("group", ["stateEstimate", "locSrv", "ctrltarget"])
def test_angles_come_from_quaternions(tmp_path: Path, group: str) -> None:
    parts = quaternion(*ATTITUDE)
    record = read(tmp_path, usd([{f"{group}.{name}": ("f", value) for name, value in parts.items()}]))
    names = [f"{angle}{'_setpoint' * (group == 'ctrltarget')}" for angle in ("phi", "theta", "psi")]
    assert [value_of(record, name) for name in names] == pytest.approx(ATTITUDE, abs=1e-6)


@pytest.mark.parametrize("attitude", [ATTITUDE, (0.0, 0.0, 0.0), (-2.9, 0.2, 0.1), (0.1, 1.2, -3.0)])
def test_angles_come_from_quaternions_in_32_bits(tmp_path: Path, attitude: tuple[float, float, float]) -> None:
    """One unit of nine bits is 0.08° of a half angle."""
    record = read(tmp_path, usd([{"stateEstimateZ.quat": ("I", compressed(quaternion(*attitude)))}]))
    assert [value_of(record, name) for name in ("phi", "theta", "psi")] == pytest.approx(attitude, abs=0.01)


def test_a_quaternion_that_no_commander_sets_is_no_set_point(tmp_path: Path) -> None:
    zeros = {f"ctrltarget.q{axis}": ("f", 0.0) for axis in "xyzw"}
    assert read(tmp_path, usd([{"gyro.x": ("f", 1.0), **zeros}])).channel_names == ("p",)


def test_angles_as_they_were_logged_come_before_a_quaternion(tmp_path: Path) -> None:
    parts = {f"stateEstimate.{name}": ("f", value) for name, value in quaternion(*ATTITUDE).items()}
    (topic,) = read(tmp_path, usd([{"stateEstimate.roll": ("f", 10.0), **parts}])).topics
    assert [channel.source for channel in topic.channels] == ["stateEstimate.roll"]


def test_outputs_of_the_timers_are_the_motors(tmp_path: Path) -> None:
    outputs = {f"pwm.m{number}_pwm": ("I", 6553 * number) for number in range(1, 5)}
    powers = {f"motor.m{number}": ("H", 1) for number in range(1, 5)}
    record = read(tmp_path, usd([{**powers, **outputs}]))
    assert value_of(record, "motor_4") == pytest.approx(0.4, abs=1e-4)
    assert value_of(record, "thrust_command") == pytest.approx(0.25, abs=1e-4)


def test_variables_that_are_not_read_are_not_called_missing(tmp_path: Path) -> None:
    policy = {f"ctrlrl.out{number}": ("f", 0.5) for number in range(4)}
    record = read(tmp_path, usd([{"gyro.x": ("f", 1.0), **policy}], step=4000))
    assert unread_words(record.unread, ("motor_1",)).startswith("ctrlrl.out0 is in the log (250 Hz), but rotorid does")
    (finding,) = (finding for finding in record.findings if finding.where == "thrust_command")
    assert "ctrlrl.out0 is in the log" in finding.message
    assert unread_words(record.unread, ("motor_speed_1",)) == ""


def test_advice_names_the_variables_to_log(tmp_path: Path) -> None:
    record = read(tmp_path, usd([{"gyro.x": ("f", 1.0)}]))
    assert channel_advice(record, "q") == "add gyro.x, gyro.y, gyro.z to config.txt on the card"
    assert motor_advice(record).startswith("add pwm.m1_pwm, pwm.m2_pwm, pwm.m3_pwm and pwm.m4_pwm to config.txt")


def test_a_positioning_system_comes_after_the_estimator(tmp_path: Path) -> None:
    record = read(tmp_path, usd([{"locSrv.x": ("f", 1.0)}, {"stateEstimate.x": ("f", 2.0)}]))
    assert value_of(record, "north") == 2.0


@pytest.mark.parametrize(("version", "unit_s"), [(1, 1e-3), (2, 1e-6)])
def test_stamps_are_milliseconds_in_version_1_and_microseconds_in_version_2(
    tmp_path: Path, version: int, unit_s: float
) -> None:
    (topic,) = read(tmp_path, usd([FLIGHT], version=version, step=2)).topics
    np.testing.assert_allclose(topic.time_s, unit_s * (1000 + 2 * np.arange(5)), rtol=1e-15)


def test_every_event_keeps_its_own_clock_and_the_thrust_needs_all_motors_in_one(tmp_path: Path) -> None:
    split = (
        {"motor.m1": ("H", 1), "motor.m2": ("H", 1)},
        {"motor.m3": ("H", 1), "motor.m4": ("I", 1), "pm.vbat": ("f", 4)},
    )
    record = read(tmp_path, usd(split, samples=7))
    assert [(topic.name, topic.time_s.size) for topic in record.topics] == [("event0", 7), ("event1", 7)]
    assert "thrust_command" not in record.channel_names
    assert {finding.where for finding in record.findings if finding.kind == "missing_channel"} == {
        "p",
        "az",
        "thrust_command",
    }


def test_of_two_variables_for_one_channel_the_measured_one_is_used(tmp_path: Path) -> None:
    record = read(tmp_path, usd([{"stateEstimateZ.rateRoll": ("h", 1), "gyro.x": ("f", 1.0)}]))
    (channel,) = record.topics[0].channels
    assert channel.source == "gyro.x"


def test_a_slow_log_names_the_file_that_sets_the_frequency(tmp_path: Path) -> None:
    record = read(tmp_path, usd([FLIGHT], step=50_000))
    (finding,) = (finding for finding in record.findings if finding.kind == "rate_too_low")
    assert finding.numbers["rate_hz"] == pytest.approx(20.0)
    assert "config.txt" in finding.message


def test_samples_that_are_not_numbers_are_left_out_and_counted(tmp_path: Path) -> None:
    data = usd([{"gyro.x": ("f", 1.0)}])
    hole = data.replace(struct.pack("<HQf", 0, 1002, 1.0), struct.pack("<HQf", 0, 1002, float("nan")))[:-4]
    record = read(tmp_path, hole + struct.pack("<I", zlib.crc32(hole)))
    assert record.topics[0].time_s.size == 4
    (finding,) = (finding for finding in record.findings if finding.kind == "gap")
    assert finding.numbers == {"lost_samples": 1.0}


def test_a_log_without_a_known_variable_says_what_it_holds(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"announces deck\.odd.*gyro\.x"):
        read(tmp_path, usd([{"deck.odd": ("f", 1.0)}]))


@pytest.mark.parametrize(
    "head", [b"", b"\xbc", b"\xbc\x03\0\x01\0\xff\xffname\0", b"\xbc\x02\0\0\0\xff\xffname\0", b"ULog\x01"]
)
def test_other_files_are_not_taken_for_it(head: bytes) -> None:
    assert not crazyflie.sniff(head)


def test_its_own_files_are_known_by_their_first_bytes() -> None:
    assert crazyflie.sniff(usd([FLIGHT])[:4096])
