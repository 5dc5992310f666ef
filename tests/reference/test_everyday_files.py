"""Flights as people log them: what reading finds in each file, and what it says, as the table of the data tells."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data import FlightRecord
from rotorid.documents.result import result_document
from rotorid.errors import LogError
from rotorid.io.ardupilot.dataflash import decode

Unpack = Callable[[str], Path]


def read(unpacked: Unpack, name: str) -> FlightRecord:
    return rotorid.read(unpacked(f"everyday/{name}.xz"))


def said(record: FlightRecord) -> dict[str, str]:
    """Kind and place of each finding to its sentence."""
    return {f"{finding.kind} {finding.where}": finding.message for finding in record.findings}


def test_a_freestyle_flight_is_read_whole(unpacked: Unpack) -> None:
    record = read(unpacked, "betaflight_431_freestyle.bbl")
    assert not {"impossible_value", "clock_disorder", "corrupt_log"} & {finding.kind for finding in record.findings}
    assert record["p"].values.size == 137_390
    assert record["p"].sample_rate_hz == pytest.approx(1000.0, rel=0.01)
    # Flips at 1000 deg/s are flights, not faults.
    assert np.abs(record["p"].values).max() > np.radians(1000.0)


def test_frames_of_another_file_leave_no_impossible_value(unpacked: Unpack) -> None:
    record = read(unpacked, "betaflight_damaged_test_log.BFL")
    kinds = {finding.kind for finding in record.findings}
    assert {"corrupt_log", "impossible_value", "clock_disorder"} <= kinds
    for topic in record.topics:
        assert np.all(np.diff(topic.time_s) >= 0.0)
        assert np.diff(topic.time_s).max() < 3.0
        assert np.isfinite(topic.values).all()
    for number in range(1, 5):
        assert np.abs(record[f"motor_{number}"].values).max() <= 1.2
    for axis in ("roll", "pitch", "yaw", "thrust"):
        assert np.abs(record[f"{axis}_command"].values).max() <= 1.2


def test_motor_speeds_have_the_numbers_of_their_outputs(unpacked: Unpack) -> None:
    record = read(unpacked, "arducopter_462_log_5.bin")
    outputs = {channel.name: channel.source for topic in record.topics for channel in topic.channels}
    assert [outputs[f"motor_{number}"] for number in range(1, 5)] == ["RCOU.C3", "RCOU.C4", "RCOU.C1", "RCOU.C2"]
    speeds = {topic.name: topic.channels[0].name for topic in record.topics if topic.name.startswith("ESC")}
    assert speeds == {
        "ESC[0]": "motor_speed_3",
        "ESC[1]": "motor_speed_4",
        "ESC[2]": "motor_speed_1",
        "ESC[3]": "motor_speed_2",
    }
    # All bits that matter are set; what holds the log down is the limit of its storage.
    assert "LOG_BLK_RATEMAX = 5 limits every message to 5 Hz" in said(record)["rate_too_low RATE"]
    assert "LOG_BITMASK" not in said(record)["rate_too_low RATE"]


def test_an_output_beyond_one_is_no_sign_of_old_firmware(unpacked: Unpack) -> None:
    record = read(unpacked, "arducopter_462_log_4.bin")
    assert not [key for key in said(record) if key.startswith(("legacy_units", "impossible_value"))]
    assert record["yaw_command"].values.max() == pytest.approx(5.48, abs=0.01)
    moved = np.radians(382.3)
    assert np.abs(next(record.holding("p"))[0].values[record.topics[0].row("p")]).max() == pytest.approx(
        moved, rel=1e-3
    )


def test_centivolts_and_outputs_of_3_2(unpacked: Unpack) -> None:
    record = read(unpacked, "arducopter_321_1.BIN")
    volts = record["battery_voltage"].values
    assert (volts[0], volts[-1]) == (pytest.approx(12.39), pytest.approx(10.97))
    assert [channel.source for topic in record.topics for channel in topic.channels if topic.name == "RCOU"] == [
        f"RCOU.Chan{number}" for number in range(1, 5)
    ]
    for number in range(1, 5):
        assert 0.0 < record[f"motor_{number}"].values.min() < record[f"motor_{number}"].values.max() < 1.0
    # This firmware has no RATE message: no bit makes it write one.
    assert "LOG_BITMASK" not in said(record)["missing_channel RATE"]
    assert "3.4" in said(record)["missing_channel RATE"]
    assert "RATE" not in said(record)["rate_too_low RCOU"]


def test_one_stamp_of_zero_does_not_begin_a_log(unpacked: Unpack) -> None:
    record = read(unpacked, "px4_115_s500.ulg")
    assert record.start_s == pytest.approx(1093.9, abs=0.05)
    assert record.stop_s == pytest.approx(1126.7, abs=0.05)
    assert "clock_disorder manual_control_setpoint" in said(record)
    assert "impossible_value r_setpoint" not in said(record)
    assert "roll_stick" not in record.instruments.get("roll", ())


def test_a_plane_on_the_bench_reads_and_is_advised_what_it_can_follow(unpacked: Unpack) -> None:
    record = read(unpacked, "px4_165_fixed_wing_never_flown.ulg")
    assert np.all(record["roll_command"].values == 0.0)
    slow = said(record)["rate_too_low actuator_controls_0"]
    # Before 1.8 it is no mask of bits.
    assert "SDLOG_PROFILE = 2 (system identification, it is 0)" in slow


def test_sdlog2_is_named_with_the_way_to_convert_it(unpacked: Unpack) -> None:
    with pytest.raises(LogError, match=r"sdlog2.*sdlog2_dump\.py.*mapping=") as error:
        read(unpacked, "px4_sdlog2.px4log")
    assert error.value.exit_code == 2


def with_yaw_output(source: Path, target: Path, number: int, value: float) -> Path:
    """A copy of a log with ``YOut`` of one RATE message replaced: four bytes."""
    content = bytearray(source.read_bytes())
    table = decode(bytes(content)).tables["RATE"]
    offset, letter = table.format.fields["YOut"]
    assert letter == "f"
    struct.pack_into("<f", content, int(table.positions[number - 1]) + offset, value)
    target.write_bytes(content)
    return target


def test_one_output_of_1_6_costs_one_message(shared_data: Path, tmp_path: Path) -> None:
    """It once made every rate 1/4500. Here, where nothing else turns the vehicle, it is left out as a lone sample."""
    source = shared_data / "ardupilot_sitl" / "x_calm_roll.BIN"
    made = rotorid.read(with_yaw_output(source, tmp_path / "made.BIN", 200, 1.6))
    (topic, _), *_ = made.holding("yaw_command")
    clean = next(topic for topic in rotorid.read(source).topics if topic.name == "RATE")
    np.testing.assert_array_equal(topic.values, np.delete(clean.values, 199, axis=1))
    assert "1 isolated spike" in said(made)["impossible_value yaw_command"]


@pytest.mark.slow
def test_one_output_of_1_6_does_not_change_the_model(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "ardupilot_sitl" / "x_calm_roll.BIN"
    record = rotorid.read(with_yaw_output(source, tmp_path / "made.BIN", 200, 1.6))
    gain = result_document(rotorid.identify([record], "rate.roll")).parameters["L_roll"]
    assert gain.value == pytest.approx(437.9, rel=2e-3)
