"""Channels beside those of the loops: sensors before their filters, terms of the controllers, flight modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.unit.io.ardupilot.test_log import Log
from tests.unit.io.blackbox_log import END, header, intra, record_of

import rotorid
from rotorid.data.record import Source
from rotorid.io.ardupilot import log as ardupilot
from rotorid.io.ardupilot.dataflash import decode
from rotorid.io.px4 import log as px4
from rotorid.io.px4.sensors import sensor_topics

DEGREE = math.pi / 180.0


def test_a_fifo_is_spread_over_the_time_before_its_stamp() -> None:
    arrays = {
        "sensor_gyro_fifo/timestamp": np.array([1_001_000, 1_005_000], dtype=np.uint64),
        "sensor_gyro_fifo/timestamp_sample": np.array([1_000_000, 1_004_000], dtype=np.uint64),
        "sensor_gyro_fifo/dt": np.full(2, 1000.0, dtype=np.float32),
        "sensor_gyro_fifo/scale": np.full(2, 0.5, dtype=np.float32),
        "sensor_gyro_fifo/samples": np.full(2, 4, dtype=np.uint8),
    }
    for axis in "xyz":
        for place in range(32):
            arrays[f"sensor_gyro_fifo/{axis}[{place}]"] = np.array([place, 4 + place], dtype=np.int16)

    (topic,) = sensor_topics(arrays, {})

    assert [channel.name for channel in topic.channels] == ["p_raw", "q_raw", "r_raw"]
    np.testing.assert_allclose(topic.time_s, 0.997 + 0.001 * np.arange(8), atol=1e-9)
    np.testing.assert_allclose(topic.values[0], 0.5 * np.arange(8))
    assert not list(sensor_topics(arrays, {"SENS_BOARD_ROT": 2.0}))


def test_speeds_of_px4_belong_to_the_motor_that_their_controller_names() -> None:
    arrays = {"esc_status/timestamp": np.arange(1, 4, dtype=np.uint64)}
    for index, (rpm, function) in enumerate([(-6000, 102), (3000, 101)]):
        arrays[f"esc_status/esc[{index}].esc_rpm"] = np.full(3, rpm, dtype=np.int32)
        arrays[f"esc_status/esc[{index}].actuator_function"] = np.full(3, function, dtype=np.uint8)

    (topic,) = sensor_topics(arrays, {})

    speeds = {channel.name: row[0] for channel, row in zip(topic.channels, topic.values, strict=True)}
    assert speeds == pytest.approx({"motor_speed_2": 200.0 * math.pi, "motor_speed_1": 100.0 * math.pi})


def test_px4_wants_what_the_sensors_need() -> None:
    wanted = px4.wanted_fields()

    assert {"dt", "scale", "samples", "z[31]"} <= set(wanted["sensor_gyro_fifo"])
    assert {"voltage_v", "current_a"} <= set(wanted["battery_status"])


def test_terms_of_ardupilot_are_no_sensors_of_many(tmp_path: Path) -> None:
    """The integral is called I, as the numbers of sensors are."""
    log = Log()
    for index in range(5):
        terms = {"P": 0.1, "I": 0.01 * index, "D": 0.02, "FF": 0.0}
        log.add("PIDR", "Qffff", TimeUS=1_000_000 + 10_000 * index, **terms)
    log.add("MODE", "QBB", TimeUS=1_000_000, Mode=2, ModeNum=2)

    path = tmp_path / "log.bin"
    path.write_bytes(log.data)
    tables = decode(path.read_bytes()).tables
    record = ardupilot.record_of(tables, Source(name="log.bin", format=ardupilot.FORMAT, sha256=""))

    np.testing.assert_allclose(record["roll_i_term"].values, 0.01 * np.arange(5), atol=1e-8)
    assert record.status.modes == (("altitude hold", 1.0, 1.04),)


def unfiltered(folder: Path, version: str, mode: int, scale: int) -> bool:
    """Whether the debug fields of a log are taken for the gyro; they hold it times a factor, plus noise."""
    names = [f"{field}[{index}]" for field in ("gyroADC", "debug") for index in range(3)]
    lines = f"H Firmware type:Cleanflight\nH Firmware revision:Betaflight {version}\nH debug_mode:{mode}\n"
    lines += "H gyro_scale:0x3f800000\n"
    data = header(names, inter_encoding=[0] * 6, inter_predictor=[0] * 6, lines=lines, signs=[1] * 6)
    for index in range(400):
        rate = round(300.0 * math.sin(0.03 * index))
        values = [rate, rate, rate, *[scale * rate + (-1) ** index * 20] * 3]
        data += intra(8 * index, 1000 * index, *values)
    record = record_of(data + END, folder)
    if "p_raw" not in record:
        return False
    assert record["p_raw"].values == pytest.approx(DEGREE * (scale * record["p"].values / DEGREE), abs=21.0 * DEGREE)
    return True


@pytest.mark.parametrize(
    ("version", "mode", "scale", "found"),
    [
        ("4.3.1 (8d4f005) X", 6, 1, True),
        ("4.3.1 (8d4f005) X", 6, 3, False),
        ("4.3.1 (8d4f005) X", 8, 1, False),
        ("3.1.5 (8d4f005) X", 3, 1, True),
        ("3.1.5 (8d4f005) X", 8, 1, False),
        ("2.9.0 (8d4f005) X", 3, 1, False),
    ],
)
def test_debug_fields_are_the_gyro_where_mode_and_motion_say_so(
    version: str, mode: int, scale: int, found: bool, tmp_path: Path
) -> None:
    assert unfiltered(tmp_path, version, mode, scale) is found


def test_batches_before_and_behind_the_filters(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("everyday/arducopter_462_log_5.bin.xz"), sandbox=False)
    raw, filtered = record["p_raw"], record["p_filtered"]

    assert raw.sample_rate_hz == pytest.approx(1979.0, abs=1.0)
    assert np.std(np.diff(raw.values)) > 3.0 * np.std(np.diff(filtered.values))
    assert record["az_raw"].values.mean() == pytest.approx(-9.81, abs=1.0)
