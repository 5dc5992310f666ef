"""NumPy archives: names, mappings, and which members are left alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io.tables import npz
from rotorid.io.tables.mapping import parse_mapping

SOURCE = Source(name="flight.npz", format=npz.FORMAT, sha256="")
TIME = np.arange(50) / 20.0


def read(path: Path, mapping: dict[str, Any] | None = None) -> FlightRecord:
    return npz.read(path, SOURCE, None if mapping is None else parse_mapping(mapping))


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_names_of_the_vocabulary_mean_themselves(tmp_path: Path, save: Any) -> None:
    save(tmp_path / "flight.npz", time=TIME, q=np.sin(TIME).astype("f4"), motor_1=np.arange(50, dtype="u2"), other=TIME)
    record = read(tmp_path / "flight.npz")
    (topic,) = record.topics
    assert record.channel_names == ("q", "motor_1")
    np.testing.assert_array_equal(topic.time_s, TIME)
    np.testing.assert_array_equal(topic.values, [np.sin(TIME).astype("f4"), np.arange(50)])


def test_a_mapping_picks_rows_units_and_a_clock(tmp_path: Path) -> None:
    gyro = np.asfortranarray(np.arange(150.0).reshape(3, 50))
    np.savez(tmp_path / "flight.npz", gyro=gyro, big=TIME.astype(">f8"))
    channels = {"q": {"source": "gyro", "row": 1, "unit": "deg/s"}, "p": {"source": "big"}}
    record = read(tmp_path / "flight.npz", {"clock": {"sample_rate_hz": 20.0}, "channels": channels})
    np.testing.assert_allclose(record.topics[0].values[0], np.deg2rad(gyro[1]), rtol=1e-15)
    np.testing.assert_array_equal(record.topics[0].values[1], TIME)
    np.testing.assert_allclose(record.topics[0].time_s, TIME, rtol=1e-15)


def test_text_records_and_objects_are_never_read(tmp_path: Path) -> None:
    objects = np.array([{"a": 1}, None], dtype=object)
    np.savez(tmp_path / "flight.npz", time=TIME, q=TIME, r=np.array(["a"]), p=np.zeros(2, "i4,f8"), az=objects)
    assert read(tmp_path / "flight.npz").channel_names == ("q",)


def test_a_missing_name_is_told_what_there_is(tmp_path: Path) -> None:
    np.savez(tmp_path / "flight.npz", time=TIME, gyro_y=TIME)
    with pytest.raises(LogError, match=r"contains time, gyro_y.*--map"):
        read(tmp_path / "flight.npz")
    with pytest.raises(UsageError, match=r"contains no 'gyro_x'.*did you mean gyro_y"):
        read(tmp_path / "flight.npz", {"clock": {"sample_rate_hz": 9}, "channels": {"q": {"source": "gyro_x"}}})


def test_only_a_zip_of_arrays_is_taken_for_it(tmp_path: Path) -> None:
    import zipfile

    np.savez(tmp_path / "flight.npz", time=TIME)
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        archive.writestr("flight.ulg", b"ULog")
    assert npz.sniff((tmp_path / "flight.npz").read_bytes())
    assert not npz.sniff((tmp_path / "log.zip").read_bytes())
    assert not npz.sniff(b"PK")
