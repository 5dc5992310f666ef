"""Files are written whole or not at all."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.io.files import sha256_of, write_atomically, write_npz


def test_a_file_is_replaced_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    target = tmp_path / "new" / "result.json"
    write_atomically(target, "first")
    write_atomically(target, "zweites ä")
    assert target.read_bytes() == "zweites ä".encode()
    assert list(target.parent.iterdir()) == [target]


def test_a_failure_keeps_the_old_content_and_leaves_nothing(tmp_path: Path) -> None:
    target = tmp_path / "taken"
    (target / "inside").mkdir(parents=True)
    with pytest.raises(UsageError, match="cannot be written"):
        write_atomically(target, "text")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_folder_that_is_a_file_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be written"):
        write_atomically(tmp_path / "file" / "result.json", b"")


def test_arrays_come_back_without_pickles(tmp_path: Path) -> None:
    arrays = {"q/pitch_command": np.array([1.0 + 2.0j]), "file": np.array(["names", "too"])}
    write_npz(tmp_path / "responses.npz", arrays)
    with np.load(tmp_path / "responses.npz", allow_pickle=False) as stored:
        assert set(stored) == set(arrays)
        assert all(np.array_equal(stored[name], array) for name, array in arrays.items())


def test_python_objects_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="objects"):
        write_npz(tmp_path / "a.npz", {"bad": np.array([object()])})
    assert not list(tmp_path.iterdir())


def test_the_hash_is_that_of_the_content(tmp_path: Path) -> None:
    content = bytes(range(256)) * 5000
    (tmp_path / "log").write_bytes(content)
    assert sha256_of(tmp_path / "log") == hashlib.sha256(content).hexdigest()


def test_arrays_are_compressed_where_it_makes_them_smaller(tmp_path: Path) -> None:
    arrays = {"noise": np.random.default_rng(1).normal(size=20_000), "still": np.zeros(20_000)}
    write_npz(tmp_path / "a.npz", arrays)
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        methods = {member.filename: member.compress_type for member in archive.infolist()}
    assert methods == {"noise.npy": zipfile.ZIP_STORED, "still.npy": zipfile.ZIP_DEFLATED}
    with np.load(tmp_path / "a.npz") as found:
        assert all(np.array_equal(found[name], array) for name, array in arrays.items())
