"""Damaged and malicious HDF5 files: one sentence, nothing read from elsewhere, no more memory than a log may take."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord
from rotorid.errors import LogError, RotoridError
from rotorid.io import read
from rotorid.io.tables.matlab import numbers_of

h5py = pytest.importorskip("h5py", reason="the extra [hdf5] is not installed")

TIME = np.arange(60.0)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("hdf5") / "flight.mat"
    with h5py.File(path, "w") as file:
        file["time"], file["q"] = TIME, np.sin(TIME)
        file["s/a"] = TIME
        file["c"] = np.array([file["s/a"].ref], dtype=h5py.ref_dtype)
    return path.read_bytes()


def outcome(path: Path, content: bytes) -> int | str:
    path.write_bytes(content)
    try:
        return len(numbers_of(path))
    except LogError as error:
        return str(error)


def test_every_cut_is_one_sentence(tmp_path: Path, sound: bytes) -> None:
    for cut in np.linspace(0, len(sound) - 1, 220).astype(int).tolist():
        found = outcome(tmp_path / "flight.mat", sound[:cut])
        assert isinstance(found, str)
        assert found.startswith("flight.mat cannot be read as HDF5")


def test_flipped_bits_are_numbers_or_one_sentence(tmp_path: Path, sound: bytes) -> None:
    """What the child of the sandbox meets; a crash here would be one sentence of its parent."""
    rng = np.random.default_rng(0)
    for place in rng.integers(len(sound), size=500).tolist():
        content = bytearray(sound)
        content[place] ^= 1 << int(rng.integers(8))
        found = outcome(tmp_path / "flight.mat", bytes(content))
        assert isinstance(found, int) or found.startswith("flight.mat")


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_file_is_survived_behind_the_sandbox(tmp_path: Path, sound: bytes, seed: int) -> None:
    content = bytearray(sound)
    rng = np.random.default_rng(seed)
    for place in rng.integers(8, len(content), 40).tolist():
        content[place] = int(rng.integers(256))
    (tmp_path / "flight.mat").write_bytes(content)
    with suppress(RotoridError):
        assert isinstance(read(tmp_path / "flight.mat"), FlightRecord)


@pytest.mark.parametrize("shape", [(1 << 30,), (1 << 40, 1 << 10)])
def test_a_declared_size_is_refused_before_memory_is_taken(tmp_path: Path, shape: tuple[int, ...]) -> None:
    with h5py.File(tmp_path / "flight.mat", "w") as file:
        file.create_dataset("time", shape=shape, dtype="f8", chunks=(1 << 10,) * len(shape))
    assert (tmp_path / "flight.mat").stat().st_size < 1 << 13
    with pytest.raises(LogError, match="declares arrays of more than 64 MiB"):
        numbers_of(tmp_path / "flight.mat")


def test_links_to_other_files_are_not_followed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["q"] = TIME
    with h5py.File(tmp_path / "flight.mat", "w") as file:
        file["time"] = TIME
        file["q"] = h5py.ExternalLink("secret.h5", "/q")
        file["p"] = h5py.SoftLink("/time")
    assert set(numbers_of(tmp_path / "flight.mat")) == {"time"}


def test_data_in_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(TIME.tobytes())
    with h5py.File(tmp_path / "flight.mat", "w") as file:
        file.create_dataset("q", (60,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 480)])
    with pytest.raises(LogError, match="q is in another file"):
        numbers_of(tmp_path / "flight.mat")


def test_groups_and_cells_that_hold_themselves_end(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "flight.mat", "w") as file:
        file["time"] = TIME
        for number in range(10):
            file[f"loop{number}"] = file["/"]
        cells = file.create_dataset("c", (9,), dtype=h5py.ref_dtype)
        cells[:] = np.array([cells.ref] * 9, dtype=h5py.ref_dtype)
    assert set(numbers_of(tmp_path / "flight.mat")) == {"time"}


def test_deep_nesting_ends(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "flight.mat", "w") as file:
        file["/".join(["a"] * 300)] = TIME
        file["time"] = TIME
    assert set(numbers_of(tmp_path / "flight.mat")) == {"time"}
