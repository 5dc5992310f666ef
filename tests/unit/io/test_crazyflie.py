"""Crazyflie uSD logs that are built here byte by byte: axes, units, versions, events."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

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
        ("rpm.m2", "motor_speed_2", np.pi / 30),
        ("pm.vbat", "battery_voltage", 1.0),
        ("pm.vbatMV", "battery_voltage", 1e-3),
    ],
)
def test_other_variables_have_their_meaning(tmp_path: Path, variable: str, channel: str, factor: float) -> None:
    record = read(tmp_path, usd([{variable: ("h", 300)}]))
    assert record.channel_names == (channel,)
    assert value_of(record, channel) == pytest.approx(300 * factor, rel=1e-12)


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
