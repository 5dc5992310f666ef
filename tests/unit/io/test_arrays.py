"""Records of arrays and frames are those of a table with the same numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import LogError, UsageError
from rotorid.io.arrays import record_from_arrays, record_from_pandas
from rotorid.io.tables.csv import write_csv

TIME_S = np.arange(0.0, 2.0, 0.01)
P = np.sin(3.0 * TIME_S)


def same(one: FlightRecord, other: FlightRecord) -> None:
    assert set(one.channel_names) == set(other.channel_names)
    for name in one.channel_names:
        np.testing.assert_allclose(one[name].values, other[name].values, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(one[name].time_s, other[name].time_s, rtol=1e-12)
        assert one.unit_of(name) == other.unit_of(name)


def test_arrays_are_the_table_that_has_them(tmp_path: Path) -> None:
    record = FlightRecord.from_arrays(TIME_S, {"p [deg/s]": np.rad2deg(P), "roll_command": 0.1 * P, "note": P})
    path = tmp_path / "flight.csv"
    header = ["time [s],p [deg/s],roll_command,note"]
    rows = zip(TIME_S, np.rad2deg(P), 0.1 * P, P, strict=True)
    path.write_text("\n".join([*header, *(",".join(repr(float(cell)) for cell in row) for row in rows)]) + "\n")
    table = rotorid.read(path)
    same(record, table)
    assert [finding.kind for finding in record.findings] == [finding.kind for finding in table.findings]


def test_arrays_pass_the_checks_of_a_log(tmp_path: Path) -> None:
    """Stamps that step back and impossible values are left out, and said, as those of a table are."""
    stamps, spoiled = TIME_S.copy(), P.copy()
    stamps[120:] -= 0.505
    spoiled[20] = 1e30
    path = tmp_path / "arrays"
    rows = [f"{stamp!r},{rate!r}" for stamp, rate in zip(stamps.tolist(), spoiled.tolist(), strict=True)]
    path.write_text("\n".join(["time [s],p", *rows]) + "\n")
    record, table = record_from_arrays(stamps, {"p": spoiled}), rotorid.read(path)
    same(record, table)
    assert [finding.kind for finding in record.findings] == ["clock_disorder", "impossible_value"]
    assert [finding.message for finding in record.findings] == [finding.message for finding in table.findings]


def test_what_was_not_sampled_has_stamps_of_its_own() -> None:
    slow = np.where(np.arange(TIME_S.size) % 10 == 0, P, np.nan)
    record = record_from_arrays(TIME_S, {"p": P, "q": slow, "r": (TIME_S[::4], P[::4])})
    assert [record[name].time_s.size for name in "pqr"] == [200, 20, 50]
    assert record["q"].time_s.tolist() == TIME_S[::10].tolist()
    assert len(record.topics) == 3


def test_the_arrays_of_the_caller_stay_his() -> None:
    own = P.copy()
    record = record_from_arrays(TIME_S, {"p": own})
    own[:] = 7.0
    assert record["p"].values[0] == P[0]
    with pytest.raises(ValueError, match="read-only"):
        record["p"].values[0] = 1.0


def test_a_mapping_names_arrays_and_matrices() -> None:
    gyro = np.stack([P, 2.0 * P, 3.0 * P], axis=1)
    vector = record_from_arrays(
        TIME_S, {"imu": gyro}, mapping={"vectors": {"rates": {"source": "imu", "columns": [0, 1, 2]}}}
    )
    assert vector.channel_names == ("p", "q", "r")
    np.testing.assert_allclose(vector["r"].values, 3.0 * P)
    mapping = {"channels": {"q": {"source": "imu", "column": 1, "unit": "deg/s"}}}
    record = record_from_arrays(TIME_S, {"imu": gyro}, mapping=mapping, name="rig")
    np.testing.assert_allclose(record["q"].values, np.deg2rad(2.0 * P))
    assert record.source.name == "rig"


def test_frames_go_out_and_come_back() -> None:
    record = record_from_arrays(TIME_S, {"p": P, "battery_voltage": 16.0 + P, "r": (TIME_S[::4], P[::4])})
    again = FlightRecord.from_pandas(record.to_pandas())
    same(again, record)


def test_the_hash_is_that_of_the_numbers() -> None:
    hashes = [record_from_arrays(TIME_S, {"p": values}).source.sha256 for values in (P, P, P + 1e-9)]
    assert hashes[0] == hashes[1] != hashes[2]


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ({"p": P[:-1]}, r"arrays: p has 199 samples and 200 stamps; expected as many of each; give .*'p': \(time_s"),
        ({"p": ["a"] * 200}, "arrays: p is of type list; expected numbers"),
        ({"p": P * 1j}, "arrays: p is of type complex128; expected numbers"),
        ([P], "the channels are of type list; expected a dictionary"),
        ({"p [V]": P}, "unit 'V'"),
        ({"p": P + 1j}, "arrays: p is of type complex128; expected numbers"),
        ({"p": np.full(200, np.nan)}, "arrays: p has no samples"),
        ({"p": np.where(TIME_S[5] == TIME_S, np.inf, P)}, "sample 6 of p is inf"),
        ({"note": P}, "has the columns time_s, note"),
    ],
)
def test_what_cannot_be_a_record_is_refused_in_words(channels: object, words: str) -> None:
    with pytest.raises((LogError, UsageError), match=words):
        record_from_arrays(TIME_S, channels)  # type: ignore[arg-type]


@pytest.mark.parametrize("unit", ["ms", "ns"])
def test_dates_are_no_seconds(unit: str) -> None:
    """Their numbers are milliseconds or nanoseconds."""
    since = np.round(1e3 * TIME_S).astype("timedelta64[ms]").astype(f"timedelta64[{unit}]")
    frames = pytest.importorskip("pandas")
    words = r"is of type (timedelta|datetime)64\[\w+\]; expected numbers; give sec"
    for stamps in (since, np.datetime64("2026-01-01", unit) + since):
        with pytest.raises(LogError, match=words):
            record_from_arrays(stamps, {"p": P})
        with pytest.raises(LogError, match=words):
            record_from_arrays(TIME_S, {"p": (stamps, P)})
        with pytest.raises(LogError, match=words):
            record_from_pandas(frames.DataFrame({"p": P}, index=stamps))


def test_numbers_of_rows_are_no_seconds() -> None:
    """A frame as ``read_csv`` gives it has its stamps in a column, and counts its rows."""
    frames = pytest.importorskip("pandas")
    frame = frames.DataFrame({"time [s]": TIME_S, "p [deg/s]": np.rad2deg(P)})
    with pytest.raises(LogError, match=r"index of arrays counts rows; .* use frame.set_index\('time \[s\]'\)"):
        FlightRecord.from_pandas(frame)
    same(FlightRecord.from_pandas(frame.set_index("time [s]")), record_from_arrays(TIME_S, {"p": P}))


def test_masked_samples_are_none() -> None:
    masked = np.ma.MaskedArray(P, mask=TIME_S > 1.0)
    record = record_from_arrays(TIME_S, {"p": masked, "q": P})
    assert record["p"].values.size == np.count_nonzero(TIME_S <= 1.0)
    with pytest.raises(LogError, match="of clock is nan"):
        record_from_arrays(np.ma.MaskedArray(TIME_S, mask=TIME_S > 1.0), {"p": P})


def test_only_frames_are_frames() -> None:
    with pytest.raises(UsageError, match="is of type list; expected a pandas DataFrame"):
        record_from_pandas([1.0, 2.0])


def test_verbs_take_a_record_of_arrays(tmp_path: Path) -> None:
    channels = {"p": P, "roll_command": 0.1 * P}
    path = tmp_path / "arrays"
    write_csv(path, TIME_S, channels)
    of_arrays, of_table = rotorid.inspect(record_from_arrays(TIME_S, channels)), rotorid.inspect(path)
    assert of_arrays.supports.keys() == of_table.supports.keys()
    assert of_arrays.name == of_table.name
