"""MATLAB files: structs and arrays through a mapping, plain files by the vocabulary."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source, places
from rotorid.errors import LogError, UsageError
from rotorid.io.tables import matlab as mat
from rotorid.io.tables.mapping import parse_mapping, read_mapping

SOURCE = Source(name="flight.mat", format=mat.FORMAT, sha256="")
TIME = np.arange(50) / 20.0


def read_saved(folder: Path, content: dict[str, Any], mapping: dict[str, Any] | None = None) -> FlightRecord:
    from scipy.io import savemat

    savemat(folder / "flight.mat", content)
    parsed = None if mapping is None else parse_mapping(mapping)
    return mat.read(folder / "flight.mat", SOURCE, parsed, sandbox=False)


def test_structs_matrices_and_cells_are_reached_by_their_names(tmp_path: Path) -> None:
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = TIME, np.sin(TIME)
    content = {"M": {"value": TIME**2, "timestamp": TIME}, "gyr": np.stack([TIME, 2.0 * TIME, 3.0 * TIME]), "c": cells}
    channels = {
        "pitch_command": {"source": "M.value", "time": "M.timestamp"},
        "q": {"source": "gyr", "row": 1, "time": "M.timestamp", "unit": "deg/s"},
        "theta": {"source": "c[1]", "time": "c[0]"},
    }
    record = read_saved(tmp_path, content, {"channels": channels})
    assert [topic.name for topic in record.topics] == ["M.timestamp", "c[0]"]
    np.testing.assert_array_equal(record.topics[0].values[0], TIME**2)
    np.testing.assert_allclose(record.topics[0].values[1], np.deg2rad(2.0 * TIME), rtol=1e-15)
    np.testing.assert_array_equal(record.topics[1].values[0], np.sin(TIME))


@pytest.mark.parametrize(
    ("clock", "expected"),
    [
        ({"time": {"source": "ms", "unit": "ms"}}, [1.0, 1.1, 1.4]),
        ({"steps": {"source": "dt"}}, [0.0, 0.1, 0.4]),
        ({"sample_rate_hz": 10.0}, [0.0, 0.1, 0.2]),
    ],
)
def test_a_common_clock_is_stamps_steps_or_a_rate(tmp_path: Path, clock: dict[str, Any], expected: list[float]) -> None:
    content = {"ms": np.array([1000.0, 1100.0, 1400.0]), "dt": np.array([0.1, 0.3, 0.2]), "y": np.arange(3)}
    record = read_saved(tmp_path, content, {"clock": clock, "channels": {"q": {"source": "y"}}})
    np.testing.assert_allclose(record.topics[0].time_s, expected, rtol=1e-12)


def test_the_only_variable_has_its_own_name(tmp_path: Path) -> None:
    motors = {f"motor_{number}": {"source": "*", "column": number} for number in range(1, 5)}
    mapping = {"clock": {"time": {"source": "*", "column": 0}}, "channels": motors}
    record = read_saved(tmp_path, {"flown": np.arange(35.0).reshape(7, 5)}, mapping)
    assert places(next(record.holding(name)) for name in motors) == "flown"


def test_a_wrong_length_of_steps_is_seen(tmp_path: Path) -> None:
    mapping = {"clock": {"steps": {"source": "dt"}}, "channels": {"q": {"source": "y"}}}
    assert read_saved(tmp_path, {"dt": np.ones(2), "y": np.arange(3)}, mapping).topics[0].time_s.tolist() == [0, 1, 2]
    with pytest.raises(LogError, match="y has 4 samples and its clock 3 stamps"):
        read_saved(tmp_path, {"dt": np.ones(2), "y": np.arange(4)}, mapping)


def test_segments_by_sample_become_times(tmp_path: Path) -> None:
    mapping = {
        "clock": {"time": {"source": "t"}},
        "channels": {"yaw_command": {"source": "y"}},
        "segments": {"use": [{"start_sample": 10, "stop_sample": 30}]},
    }
    (segment,) = read_saved(tmp_path, {"t": TIME, "y": TIME}, mapping).declared
    assert (segment.axis, segment.origin, segment.start_s, segment.stop_s) == ("yaw", "given", TIME[10], TIME[30])


@pytest.mark.parametrize("wrap", [lambda content: content, lambda content: {"flight": content, "other": TIME}])
def test_without_a_mapping_the_names_mean_themselves(tmp_path: Path, wrap: Any) -> None:
    record = read_saved(tmp_path, wrap({"time": TIME, "q": TIME, "roll_excitation": TIME, "note": "text"}))
    assert record.channel_names == ("q", "roll_excitation")
    assert record.instruments == {}


def test_without_a_mapping_and_without_names_it_says_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"contains t, y.*--map"):
        read_saved(tmp_path, {"t": TIME, "y": TIME})


@pytest.mark.parametrize(
    ("source", "error", "sentence"),
    [
        ({"source": "qq"}, UsageError, "contains no 'qq'.*one of t, short, mat, hole, q1"),
        ({"source": "q"}, UsageError, "did you mean q1"),
        ({"source": "short"}, LogError, "short has 3 samples and its clock 50 stamps"),
        ({"source": "mat"}, UsageError, "mat is a matrix of 2 by 50"),
        ({"source": "mat", "row": 2}, UsageError, "has no row 2.*from 0 to 1"),
        ({"source": "q1", "row": 0}, UsageError, "has no row 0"),
        ({"source": "hole"}, LogError, "sample 8 of hole is nan"),
    ],
)
def test_a_mapping_that_does_not_fit_is_told_so(
    tmp_path: Path, source: dict[str, Any], error: type[Exception], sentence: str
) -> None:
    hole = TIME.copy()
    hole[7] = np.nan
    content = {"t": TIME, "short": np.zeros(3), "mat": np.zeros((2, 50)), "hole": hole, "q1": TIME}
    with pytest.raises(error, match=sentence):
        read_saved(tmp_path, content, {"clock": {"time": {"source": "t"}}, "channels": {"q": source}})


@pytest.mark.parametrize("head", [b"MATLAB 7.3 MAT-file, Platform: GLNXA64", b"\x89HDF\r\n\x1a\n"])
def test_version_7_3_is_told_how_to_save(tmp_path: Path, head: bytes) -> None:
    (tmp_path / "flight.mat").write_bytes(head.ljust(600))
    assert mat.sniff(head)
    with pytest.raises(LogError, match=r"save\(NAME, '-v7'\)"):
        mat.read(tmp_path / "flight.mat", SOURCE)


def test_the_pitch_rig_is_read_through_the_sandbox(shared_data: Path) -> None:
    folder = shared_data / "antx"
    record = mat.read(folder / "sweep.mat", SOURCE, read_mapping(folder / "map.toml"))
    assert set(record.channel_names) >= {"pitch_command", "q", "theta", "theta_setpoint", "north"}
    topic, row = next(record.holding("q"))
    assert topic.sample_rate_hz == pytest.approx(250.0, rel=0.01)
    assert topic.values[row].size == 20788


def test_the_bebop_is_read_with_its_vertical_axis_turned_down(shared_data: Path) -> None:
    from scipy.io import loadmat

    folder = shared_data / "bebop"
    for path in sorted((folder / "ident").glob("*.mat")):
        record = mat.read(path, SOURCE, read_mapping(folder / "map.toml"), sandbox=False)
        topic, row = next(record.holding("velocity_down"))
        np.testing.assert_array_equal(topic.values[row], -loadmat(path)["vz"].ravel())
        assert np.median(np.diff(topic.time_s)) == pytest.approx(0.0504, rel=0.05)
