"""Every value that our reader gives is the value that pymavlink gives."""

from __future__ import annotations

import array
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.io.ardupilot.dataflash import DataFlashLog, Table, decode

PREFIX_BYTES = 3_000_000
"""Enough of the large log for nearly all of its message types, and ten thousand messages of the fast ones."""

LOGS = (
    "ardupilot_sitl/x_calm_roll.BIN",
    pytest.param("ardupilot/erle_brain3.BIN", marks=pytest.mark.slow),
    "ardupilot/beast_0036.BIN",
    "ardupilot/truncated_80k.BIN",
)


def read_with_pymavlink(path: Path) -> tuple[dict[str, dict[str, list[Any]]], dict[str, dict[str, str]]]:
    reader = pytest.importorskip("pymavlink.DFReader")
    log = reader.DFReader_binary(str(path.resolve()))
    columns: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    while (message := log.recv_msg()) is not None:
        for name in message.get_fieldnames():
            columns[message.get_type()][name].append(getattr(message, name))
    units = {
        layout.name: dict(zip(layout.columns, layout.units or (), strict=False)) for layout in log.formats.values()
    }
    log.close()
    return columns, units


def plain(values: list[Any]) -> np.ndarray[Any, Any]:
    if isinstance(values[0], array.array):
        return np.array([value.tolist() for value in values])
    if isinstance(values[0], bytes):
        return np.array([list(value) for value in values], dtype=np.uint8)
    return np.array(values)


def assert_same_values(table: Table, theirs: dict[str, list[Any]]) -> None:
    assert set(table.columns) == set(theirs)
    for name, values in theirs.items():
        ours = table.column(name)
        expected = plain(values)
        assert ours.shape == expected.shape, (table.name, name)
        equal_nan = ours.dtype.kind == "f"
        assert np.array_equal(ours, expected, equal_nan=equal_nan), (table.name, name)


def assert_same_log(log: DataFlashLog, path: Path) -> None:
    theirs, units = read_with_pymavlink(path)
    assert set(log.tables) == set(theirs)
    for name, table in log.tables.items():
        assert_same_values(table, theirs[name])
        assert {column: unit for column, unit in units[name].items() if unit} == dict(table.units) or name == "FMT"


@pytest.mark.parametrize("name", LOGS)
def test_values_and_units_are_those_of_pymavlink(name: str, shared_data: Path, tmp_path: Path) -> None:
    data = (shared_data / name).read_bytes()[:PREFIX_BYTES]
    path = tmp_path / "log.bin"
    path.write_bytes(data)
    assert_same_log(decode(data), path)
