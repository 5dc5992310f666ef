"""Folders of ``ulog2csv`` files that are built here: names, clocks, parameters, hash."""

from __future__ import annotations

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.px4 import folder as px4_folder

SOURCE = Source(name="flight", format=px4_folder.FORMAT, sha256="")
TORQUE = "timestamp,xyz[0],xyz[1],xyz[2]\n" + "".join(f"{1000000 + 4000 * n},{n},2.5,-3\n" for n in range(5))
RATES = "timestamp,timestamp_sample,xyz[0],xyz[1],xyz[2]\n" + "".join(
    f"{1000000 + 4000 * n},{999000 + 4000 * n},1,2,3\n" for n in range(5)
)


def folder_of(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text)
    return folder


def read(folder: Path) -> FlightRecord:
    return px4_folder.read_folder(folder, SOURCE)


def test_topics_become_channels_with_the_clocks_of_the_log(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, a_vehicle_torque_setpoint_0=TORQUE, a_vehicle_angular_velocity_0=RATES)
    record = read(folder)
    assert set(record.channel_names) == {"roll_command", "pitch_command", "yaw_command", "p", "q", "r"}
    torque, rates = record.topics
    np.testing.assert_allclose(torque.time_s, 1.0 + 0.004 * np.arange(5), rtol=1e-15)
    np.testing.assert_allclose(rates.time_s, 0.999 + 0.004 * np.arange(5), rtol=1e-15)
    np.testing.assert_array_equal(torque.values[0], np.arange(5))


def test_other_files_and_other_instances_are_passed_over(tmp_path: Path) -> None:
    folder = folder_of(
        tmp_path, a_vehicle_torque_setpoint_0=TORQUE, a_vehicle_torque_setpoint_1="broken", notes="no, table\n"
    )
    assert read(folder).channel_names == ("roll_command", "pitch_command", "yaw_command")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "parameters.octave",
            "# name MC_P\n# type: scalar\n0.15\n# name SYS_AUTOSTART\n# type: matrix\n# rows: 1\n1 2\n",
        ),
        ("a_params.txt", "MC_P = 0.15\nSYS_AUTOSTART = 2;\n__import__('os') = 3\n"),
        ("parameters.txt", "MC_P 0.15\nSYS_AUTOSTART\t2e0\nnot a parameter\n"),
        ("parameters.csv", "MC_P,0.15\nSYS_AUTOSTART,2\n"),
    ],
)
def test_parameters_are_read_from_the_usual_forms(tmp_path: Path, name: str, text: str) -> None:
    folder = folder_of(tmp_path, a_vehicle_torque_setpoint_0=TORQUE)
    (folder / name).write_text(text)
    assert read(folder).parameters == {"MC_P": 0.15, "SYS_AUTOSTART": 2.0}


def test_the_hash_follows_names_and_contents_of_the_log_and_nothing_else(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, a_vehicle_torque_setpoint_0=TORQUE)
    first = read(folder).source.sha256
    (folder / "notes.txt").write_text("a windy day")
    assert read(folder).source.sha256 == first
    folder_of(folder, a_vehicle_torque_setpoint_0=TORQUE.replace("2.5", "2.6"))
    changed = read(folder).source.sha256
    (folder / "a_vehicle_torque_setpoint_0.csv").rename(folder / "b_vehicle_torque_setpoint_0.csv")
    assert len({first, changed, read(folder).source.sha256}) == 3
    assert len(first) == 64


def test_a_topic_without_a_sample_is_no_obstacle(tmp_path: Path) -> None:
    empty = "timestamp,voltage_v\n"
    folder = folder_of(tmp_path, a_vehicle_torque_setpoint_0=TORQUE, a_battery_status_0=empty)
    assert "battery_voltage" not in read(folder).channel_names


def test_what_is_a_folder_of_a_log(tmp_path: Path) -> None:
    assert not px4_folder.is_folder_log(tmp_path)
    assert not px4_folder.is_folder_log(tmp_path / "missing")
    (tmp_path / "vehicle_torque_setpoint_0.txt").write_text(TORQUE)
    assert not px4_folder.is_folder_log(tmp_path)
    assert px4_folder.is_folder_log(folder_of(tmp_path, a_vehicle_torque_setpoint_0=TORQUE))


def test_two_logs_in_one_folder_are_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, a_vehicle_torque_setpoint_0=TORQUE, b_vehicle_torque_setpoint_0=TORQUE)
    with pytest.raises(LogError, match="2 logs: a, b"):
        read(folder)


def test_a_folder_without_a_topic_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="contains no topic"):
        read(tmp_path)


@pytest.mark.parametrize("packed", [False, True])
def test_one_file_of_the_folder_is_one_topic(tmp_path: Path, packed: bool) -> None:
    path = tmp_path / ("a_vehicle_angular_velocity_0.csv" + ".gz" * packed)
    path.write_bytes(gzip.compress(RATES.encode(), mtime=0) if packed else RATES.encode())
    record = rotorid.read(path)
    np.testing.assert_allclose(record["q"].values, 2.0)
    np.testing.assert_allclose(record["q"].time_s, 0.999 + 0.004 * np.arange(5), rtol=1e-15)
    (finding,) = record.findings
    assert "give the folder" in finding.message
    assert "SDLOG_PROFILE" not in finding.message


def test_a_zip_of_the_folder_says_to_unpack_it(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        archive.writestr("a_vehicle_angular_velocity_0.csv", RATES)
        archive.writestr("a_vehicle_torque_setpoint_0.csv", TORQUE)
    with pytest.raises(LogError, match="the folder if they are the files of ulog2csv"):
        rotorid.read(tmp_path / "log.zip")
