"""Hostile tables in text: one sentence that names line or column, whatever their shape."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.hostile.damage import assert_complete, hang_limit

from rotorid.errors import RotoridError
from rotorid.io import read

HEADER = b"time [s],q [rad/s]\n"
ROWS = b"0,0\n0.01,1\n0.02,2\n"


def refusal(folder: Path, content: bytes) -> str:
    (folder / "flight.csv").write_bytes(content)
    with hang_limit(), pytest.raises(RotoridError) as caught:
        read(folder / "flight.csv")
    assert_complete(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is empty"),
        (b"\n\n,\n", "first column is ''"),
        (HEADER, "contains no flight: a header and no samples"),
        (HEADER + b"0,0\n0.01", "line 3 has 1 cells"),
        (HEADER + b"0,0\n0.01,\n", "line 3, column 'q [rad/s]' is ''"),
        (HEADER + b"0,0\n0.01,nan\n", "line 3, column 'q [rad/s]' is 'nan'"),
        (HEADER + b"0,0\n0.01,1e999\n", "is '1e999'"),
        (HEADER + b"0,0\n0.01,1,2\n", "line 3 has 3 cells"),
        (HEADER + ROWS + b"\0\0\0\0", "not in a known format"),
        (HEADER + ROWS + b"\xff\xfe", "is not UTF-8 text"),
        (HEADER + b'0,"0\n1,1\n', "cannot be read: could not convert"),
        (b"time [s],q [furlong]\n0,0\n", "unknown unit 'furlong'; expected a unit such as"),
        (b"time [s],q [rad/s],q [rad/s]\n0,0,0\n", "two columns"),
        (b"time [s],time [s],q [rad/s]\n0,0,0\n", "two columns"),
        (b"\xff\xfet\0i\0m\0e\0,\0", "has the columns time"),
        (b"," * 4000 + b"\n0\n", "first column is ''"),
    ],
)
def test_tables_that_are_none_are_one_sentence(content: bytes, sentence: str, tmp_path: Path) -> None:
    assert sentence in refusal(tmp_path, content)


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(HEADER[:-1] + b"," + b"x" * 200_000 + b"\n0,0,0\n", id="a name"),
        pytest.param(HEADER + b"0,0\n0.01," + b"x" * 200_000 + b"\n", id="a cell"),
    ],
)
def test_absurdly_long_cells_are_one_sentence(content: bytes, tmp_path: Path) -> None:
    assert "flight.csv" in refusal(tmp_path, content)


@pytest.mark.parametrize("ending", ["xz", "gz", "bz2"])
def test_a_table_that_is_called_packed_and_is_not_is_read(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"flight.csv.{ending}"
    path.write_bytes(HEADER + ROWS)
    assert read(path).topics[0].values.shape == (1, ROWS.count(b"\n"))
