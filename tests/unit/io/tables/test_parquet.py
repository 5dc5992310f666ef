"""Parquet tables: columns with units as in CSV, mappings, and what is said without pyarrow."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io.tables import parquet
from rotorid.io.tables.mapping import parse_mapping

pa = pytest.importorskip("pyarrow", reason="the extra [parquet] is not installed")
pq = pytest.importorskip("pyarrow.parquet", reason="the extra [parquet] is not installed")

SOURCE = Source(name="flight.parquet", format=parquet.FORMAT, sha256="")
TIME = np.arange(50) / 20.0


def read(folder: Path, columns: dict[str, Any], mapping: dict[str, Any] | None = None) -> FlightRecord:
    path = folder / "flight.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=20)
    assert parquet.sniff(path.read_bytes())
    return parquet.read(path, SOURCE, None if mapping is None else parse_mapping(mapping), sandbox=False)


def test_the_columns_say_what_they_are(tmp_path: Path) -> None:
    columns = {"time [ms]": 1e3 * TIME, "q [deg/s]": TIME, "motor_1": np.arange(50, dtype="u2"), "note": ["text"] * 50}
    record = read(tmp_path, columns)
    (topic,) = record.topics
    assert record.channel_names == ("q", "motor_1")
    np.testing.assert_allclose(topic.time_s, TIME, rtol=1e-15)
    np.testing.assert_allclose(topic.values, [np.deg2rad(TIME), np.arange(50)], rtol=1e-15)
    assert [(finding.kind, finding.where) for finding in record.findings] == [("unknown_column", "note")]


@pytest.mark.parametrize("clock", ["t", "Timestamp [s]", "elapsed_time"])
def test_stamps_may_have_any_name_that_they_have_in_text(clock: str, tmp_path: Path) -> None:
    record = read(tmp_path, {clock: TIME, "q [deg/s]": TIME})
    np.testing.assert_array_equal(record.topics[0].time_s, TIME)


def test_a_known_benchmark_is_asked_for_its_axes(tmp_path: Path) -> None:
    """Its columns ax, ay and az are called like channels, and point elsewhere."""
    columns = dict.fromkeys(("t", "x", "y", "z", "m1_erpm", "m2_erpm", "ax", "ay", "az"), TIME)
    with pytest.raises(LogError, match=r"idsia_nanodrone\.toml"):
        read(tmp_path, columns)


def test_a_mapping_names_any_columns(tmp_path: Path) -> None:
    mapping = {"clock": {"time": {"source": "t.s"}}, "channels": {"q": {"source": "gyro.y", "scale": -1.0}}}
    record = read(tmp_path, {"gyro.y": TIME, "t.s": TIME, "gyro": TIME}, mapping)
    np.testing.assert_array_equal(record.topics[0].values[0], -TIME)


@pytest.mark.parametrize(
    ("columns", "error", "sentence"),
    [
        ({"q": TIME, "stamp": TIME}, LogError, "whose first column is 'q'"),
        ({"time": TIME, "qq": TIME}, LogError, "has the columns time, qq"),
        ({"time": TIME, "q [m]": TIME}, UsageError, "has the unit 'm'.*a unit of rad/s"),
        ({"time": TIME, "q": [None, *TIME[1:]]}, LogError, "the column 'q' contains 1 holes"),
        ({"time": TIME, "q": ["x"] * 50}, LogError, "the column 'q' contains values of type string"),
        ({"time": TIME, "q": [np.nan, *TIME[1:]]}, LogError, "sample 1 of q is nan"),
    ],
)
def test_a_table_that_does_not_fit_is_told_so(
    tmp_path: Path, columns: dict[str, Any], error: type[Exception], sentence: str
) -> None:
    with pytest.raises(error, match=sentence):
        read(tmp_path, columns)


def test_a_mapping_that_names_no_column_is_told_so(tmp_path: Path) -> None:
    mapping = {"clock": {"sample_rate_hz": 20.0}, "channels": {"q": {"source": "gyro_x"}}}
    with pytest.raises(UsageError, match=r"has no column 'gyro_x'.*did you mean gyro_y"):
        read(tmp_path, {"gyro_y": TIME}, mapping)


def test_the_sandbox_reads_it_too(tmp_path: Path) -> None:
    pq.write_table(pa.table({"time": TIME, "q [deg/s]": TIME}), tmp_path / "flight.parquet")
    record = parquet.read(tmp_path / "flight.parquet", SOURCE)
    np.testing.assert_allclose(record.topics[0].values[0], np.deg2rad(TIME), rtol=1e-15)


def test_without_pyarrow_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pq.write_table(pa.table({"time": TIME, "q": TIME}), tmp_path / "flight.parquet")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(LogError, match=r"pip install 'rotorid\[parquet\]'"):
        parquet.read(tmp_path / "flight.parquet", SOURCE, sandbox=False)
