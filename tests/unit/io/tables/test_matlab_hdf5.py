"""MATLAB 7.3 and plain HDF5 files, built with the layout that MATLAB gives to them; identification data."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.tables import matlab as mat
from rotorid.io.tables.mapping import parse_mapping

h5py = pytest.importorskip("h5py", reason="the extra [hdf5] is not installed")

SOURCE = Source(name="flight.mat", format=mat.FORMAT, sha256="")
TIME = np.arange(50) / 20.0


def matlab_file(path: Path, fill: Callable[[Any], None]) -> Path:
    """A file of version 7.3: a text block in front, columns stored as rows."""
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    content = bytearray(path.read_bytes())
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64"
    content[: len(text)] = text
    path.write_bytes(content)
    assert mat.sniff(content[:4096])
    return path


def read(path: Path, mapping: dict[str, Any] | None = None) -> FlightRecord:
    return mat.read(path, SOURCE, None if mapping is None else parse_mapping(mapping), sandbox=False)


def test_columns_structs_and_cells_are_reached_as_in_older_versions(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        file["M/value"], file["M/timestamp"] = TIME[None] ** 2, TIME[None]
        file["gyr"] = np.stack([TIME, 2.0 * TIME, 3.0 * TIME])  # 50 by 3 in MATLAB
        file["#refs#/a"], file["#refs#/b"] = TIME[None], np.sin(TIME)[None]
        file["c"] = np.array([[file["#refs#/a"].ref], [file["#refs#/b"].ref]], dtype=h5py.ref_dtype)
        file["note"] = np.frombuffer(b"t\0e\0x\0t\0", "u2")[None]
        file["note"].attrs["MATLAB_class"] = np.bytes_(b"char")

    channels = {
        "pitch_command": {"source": "M.value", "time": "M.timestamp"},
        "q": {"source": "gyr", "column": 1, "time": "M.timestamp", "unit": "deg/s"},
        "theta": {"source": "c[1]", "time": "c[0]"},
    }
    record = read(matlab_file(tmp_path / "flight.mat", fill), {"channels": channels})
    np.testing.assert_array_equal(record.topics[0].values[0], TIME**2)
    np.testing.assert_allclose(record.topics[0].values[1], np.deg2rad(2.0 * TIME), rtol=1e-15)
    np.testing.assert_array_equal(record.topics[1].values[0], np.sin(TIME))


def test_a_plain_hdf5_file_is_not_turned(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "flight.mat", "w") as file:
        file["flight/time"], file["flight/q"] = TIME, np.sin(TIME)
        file["flight/other"] = np.zeros((50, 3))
    record = read(tmp_path / "flight.mat")
    assert record.channel_names == ("q",)
    np.testing.assert_array_equal(record.topics[0].values[0], np.sin(TIME))


def test_the_sandbox_reads_it_too(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        file["time"], file["q"] = TIME[None], TIME[None]

    record = mat.read(matlab_file(tmp_path / "flight.mat", fill), SOURCE)
    np.testing.assert_array_equal(record.topics[0].values[0], TIME)


@pytest.mark.parametrize("version", ["7", "7.3"])
@pytest.mark.parametrize(("outputs", "inputs"), [("OutputData", "InputData"), ("y", "u")])
def test_identification_data_have_a_clock(tmp_path: Path, version: str, outputs: str, inputs: str) -> None:
    from scipy.io import savemat

    y = np.stack([TIME, 2.0 * TIME], axis=1)
    fields = {outputs: y, inputs: TIME[:, None], "Ts": 0.05}

    def fill(file: Any) -> None:
        for name, value in fields.items():
            file[f"z/{name}"] = np.atleast_2d(value).T

    path = tmp_path / "flight.mat"
    if version == "7":
        savemat(path, {"z": fields})
    else:
        matlab_file(path, fill)
    channels = {
        "roll_command": {"source": f"z.{inputs}"},
        "phi": {"source": f"z.{outputs}", "column": 1, "unit": "deg"},
    }
    record = read(path, {"clock": {"time": {"source": "z.SamplingInstants"}}, "channels": channels})
    # The first sample of an iddata object stands at Ts unless Tstart says otherwise.
    np.testing.assert_allclose(record.topics[0].time_s, 0.05 + TIME, rtol=1e-12)
    np.testing.assert_allclose(record.topics[0].values[1], np.deg2rad(2.0 * TIME), rtol=1e-12)


def test_without_h5py_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = matlab_file(tmp_path / "flight.mat", lambda file: file.create_dataset("time", data=TIME))
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(LogError, match=r"pip install 'rotorid\[hdf5\]'.*'-v7'"):
        read(path)
