"""CSV logs: our own header, any header through a mapping, and the cell that spoils a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io.tables import csv as csv_tables
from rotorid.io.tables.csv import read, sniff, write_csv
from rotorid.io.tables.mapping import parse_mapping

SOURCE = Source(name="flight.csv", format="CSV", sha256="")


def read_text(folder: Path, text: str | bytes, **channels: dict[str, object]) -> FlightRecord:
    path = folder / "flight.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    mapping = (
        parse_mapping({"clock": {"time": {"source": "t", "unit": "ms"}}, "channels": channels}) if channels else None
    )
    return read(path, SOURCE, mapping)


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    time_s = 1000.0 + np.arange(500) / 400.0
    columns = {"pitch_command": rng.normal(size=500), "q": rng.normal(size=500), "theta_setpoint": rng.normal(size=500)}
    write_csv(tmp_path / "flight.csv", time_s, columns)
    record = read(tmp_path / "flight.csv", SOURCE)
    assert record.channel_names == tuple(columns)
    # A table says nothing about feedback; signals are judged when an instrument is looked for.
    assert record.instruments == {}
    # Ten digits of 1000 s are 1 µs, seven digits of a number are half a unit in the seventh.
    assert np.abs(record.topics[0].time_s - time_s).max() <= 0.5e-6
    np.testing.assert_allclose(record.topics[0].values, np.stack(list(columns.values())), rtol=0.5e-6, atol=0.0)


def test_units_of_the_header_are_brought_to_si(tmp_path: Path) -> None:
    record = read_text(tmp_path, "time [ms],q [deg/s],az [g],phi\n1000,180,-1,0.5\n1010,0,-1,0.5\n")
    np.testing.assert_allclose(record.topics[0].time_s, [1.0, 1.01], rtol=1e-15)
    np.testing.assert_allclose(record.topics[0].values[:, 0], [np.pi, -9.80665, 0.5], rtol=1e-15)
    assert [channel.unit for channel in record.topics[0].channels] == ["rad/s", "m/s^2", "rad"]


def test_an_unknown_column_is_left_out_with_a_finding(tmp_path: Path) -> None:
    record = read_text(tmp_path, "time [s],q [rad/s],pich_command [1],note\n0,1,2,text\n1,1,2,\n")
    assert record.channel_names == ("q",)
    assert [finding.kind for finding in record.findings] == ["unknown_column", "unknown_column"]
    assert "pitch_command" in record.findings[0].message


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_quotes_and_line_ends_of_other_programs(tmp_path: Path, separator: str) -> None:
    lines = ['\ufefftime [s],"q [rad/s]"', "0,1.5", "", '1,"2.5"']
    record = read_text(tmp_path, "\r\n".join(lines).replace(",", separator) + "\r\n")
    assert record.topics[0].values.tolist() == [[1.5, 2.5]]


def test_a_mapping_takes_any_header_and_ignores_the_rest(tmp_path: Path) -> None:
    text = "state,t,gyro y\nidle,0,90\nfly,10,-90\n"
    record = read_text(tmp_path, text, q={"source": "gyro y", "unit": "deg/s", "scale": -1.0})
    np.testing.assert_allclose(record.topics[0].time_s, [0.0, 0.01])
    np.testing.assert_allclose(record.topics[0].values, [[-np.pi / 2, np.pi / 2]])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time [s],q [rad/s]\n", "contains no flight: a header and no samples"),
        ("\n\n", "is empty"),
        ("time [s],q [rad/s]\n0,1\n1,oops\n", r"line 3, column 'q \[rad/s\]' is 'oops'"),
        ("time [s],q [rad/s]\n\n0,1\n1,\n", r"line 4, column 'q \[rad/s\]' is ''"),
        ("time [s],q [rad/s]\n0,1\n1,nan\n", "line 3, column .* is 'nan'"),
        ("time [s],q [rad/s]\ninf,1\n1,2\n", "line 2, column 'time .* is 'inf'"),
        ("time [s],q [rad/s]\n0,1\n1\n", "line 3 has 1 cells and the header 2"),
        ("time [s],q [rad/s]\n0,1\n1,2,3\n", "line 3 has 3 cells and the header 2"),
        ("time [s],note\n0,1\n", "has the columns time"),
        ("stamp,q\n0,1\n", "first column is 'stamp'"),
        ("timestamp,output[0]\n0,1\n", "first column is 'timestamp'.*ulog2csv.*give their folder"),
        ("time [s],q,q\n0,1,1\n", "two columns 'q'"),
        ("time [s],q,q [rad/s]\n0,1,1\n", "two columns for q"),
        (b"time [s],q\n0,\xff\n", "not UTF-8 text"),
        (b"time [s],q\xff\n0,1\n", "not UTF-8 text"),
    ],
)
def test_a_broken_table_names_the_place(tmp_path: Path, text: str | bytes, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        read_text(tmp_path, text)


@pytest.mark.parametrize("header", ["time [s],q [m/s]", "time [s],q [furlong]", "time [rad],q"])
def test_a_wrong_unit_is_wrong_use(tmp_path: Path, header: str) -> None:
    with pytest.raises(UsageError, match="column '"):
        read_text(tmp_path, f"{header}\n0,1\n")


def test_a_mapping_that_misses_a_column_hears_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no column 'gyro_y'.* did you mean gyroy"):
        read_text(tmp_path, "t,gyroy\n0,1\n", q={"source": "gyro_y"})


def test_only_tables_are_taken_for_tables() -> None:
    assert sniff("time [s],ax [m/s²]\n".encode())
    assert not sniff(b"# A heading\n\nSome, text")
    assert not sniff(b"a,b\0c\n")
    assert not sniff(b"\xa3,\x95,\x80\n")


def test_a_writer_refuses_what_a_reader_would_not_know(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="pich_command"):
        write_csv(tmp_path / "a.csv", np.zeros(2), {"pich_command": np.zeros(2)})
    with pytest.raises(ValueError, match="q: "):
        write_csv(tmp_path / "a.csv", np.zeros(2), {"q": np.zeros(3)})


def _as_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small files go the way of large ones, in pieces of a few lines."""
    monkeypatch.setattr(csv_tables, "_LARGE_BYTES", 0)
    monkeypatch.setattr(csv_tables, "_PIECE_BYTES", 100)


def test_large_files_have_the_bits_of_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(size=(300, 3)) * 10.0 ** rng.integers(-30, 30, (300, 3))
    forms = ("{:.7g}", "{!r}", " {:.3e} ", "{:+.12f}", "{:.1E}", "{:.0f}.")
    rows = [[forms[(i + j) % 6].format(float(v)) for j, v in enumerate(row)] for i, row in enumerate(values)]
    path = tmp_path / "log.csv"
    path.write_text("p,q,r\n" + "\r\n".join(",".join(row) for row in rows[:99]) + "\n\n \r\n")
    with path.open("a") as log:
        log.write("\n".join(",".join(row) for row in rows[99:]))
    _as_large(monkeypatch)
    table = csv_tables._large_table(path, path.name, ["p", "q", "r"], [0, 2], ",", 2)
    assert table is not None
    np.testing.assert_array_equal(table, [[float(row[0]), float(row[2])] for row in rows])


@pytest.mark.parametrize("spoiled", ["1.0,x", "1.0,nan", "1.0", "1.0,2.0,3.0", "1.0,", "1.0,1e999"])
def test_large_files_are_refused_by_the_same_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoiled: str
) -> None:
    path = tmp_path / "log.csv"
    lines = [f"{0.01 * k:.2f},{k}" for k in range(100)]
    lines[70] = spoiled
    path.write_text("\ntime [s],p [rad/s]\n" + "\n".join(lines) + "\n")
    said = []
    for large in (False, True):
        if large:
            _as_large(monkeypatch)
        with pytest.raises(LogError, match="line 73") as caught:
            read(path, SOURCE)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_quoted_cells_of_large_files_are_read_the_slow_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time [s],p [rad/s]\n" + "".join(f'{0.01 * k:.2f},"{k}"\n' for k in range(100)))
    _as_large(monkeypatch)
    assert read(path, SOURCE).topics[0].values[0].tolist() == list(range(100))
