"""Damaged MATLAB files: the sandbox answers with a record or with one sentence, whatever the parser does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord
from rotorid.errors import RotoridError
from rotorid.io import read


def outcome(path: Path) -> FlightRecord | str:
    try:
        return read(path)
    except RotoridError as error:
        return str(error)


@pytest.mark.parametrize("seed", range(12))
def test_a_changed_byte_is_survived(tmp_path: Path, seed: int) -> None:
    from scipy.io import savemat

    path = tmp_path / "flight.mat"
    savemat(path, {"time": np.arange(9.0), "q": np.arange(9.0), "s": {"a": 1.0, "b": "text"}})
    content = bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    for place in rng.integers(128, len(content), 1 + seed % 3).tolist():
        content[place] = int(rng.integers(256))
    path.write_bytes(content)
    found = outcome(path)
    assert isinstance(found, FlightRecord) or found.startswith("flight.mat")


def test_a_size_that_would_fill_the_memory_is_one_sentence(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "flight.mat"
    savemat(path, {"time": np.arange(2.0)})
    content = bytearray(path.read_bytes())
    # The dimensions of the only variable: 1 by 2 becomes 2^30 by 2^30.
    at = content.index(np.array([5, 8, 1, 2], "<i4").tobytes()) + 8
    content[at : at + 8] = np.array([1 << 30, 1 << 30], "<i4").tobytes()
    path.write_bytes(content)
    found = outcome(path)
    assert isinstance(found, str)
    assert "cannot be read" in found


def test_a_truncated_file_is_one_sentence(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "flight.mat"
    savemat(path, {"time": np.arange(900.0), "q": np.arange(900.0)})
    path.write_bytes(path.read_bytes()[:3000])
    found = outcome(path)
    assert isinstance(found, str)
    assert found.startswith("flight.mat cannot be read")


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("inner", [False, True])
def test_structs_and_cells_of_many_parts_are_refused_before_they_are_parsed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, compressed: bool, inner: bool
) -> None:
    """58 000 fields, 5 MB, took SciPy 5 s."""
    from scipy.io import savemat

    from rotorid.io.tables import matlab

    path = tmp_path / "flight.mat"
    many = {"t": {f"v{k}": float(k) for k in range(300)}} if inner else {f"v{k}": float(k) for k in range(300)}
    cells = np.array([1.0, "text", {"a": [1.0, "b"]}], dtype=object)
    savemat(path, {"s": many, "c": cells, "q": np.arange(9.0)}, do_compression=compressed)
    # Each struct and cell is one, and so is each of its parts.
    parts = 300 + inner + 1 + 5 + 1
    monkeypatch.setattr(matlab, "_MOST_PARTS", parts + 1)
    assert len(matlab.extract(path, {"names": []}).arrays) == 302
    monkeypatch.setattr(matlab, "_MOST_PARTS", parts)
    with pytest.raises(RotoridError, match=f"more than {parts} arrays in its structs and cells"):
        matlab.extract(path, {"names": []})
