"""Damaged and malicious NumPy archives: one sentence, no pickle, no more memory than a log may take."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import RotoridError
from rotorid.io.tables import npz

SOURCE = Source(name="flight.npz", format=npz.FORMAT, sha256="")
MIB = 1 << 20


def member(header: str, data: bytes = b"", version: int = 1) -> bytes:
    length = len(header).to_bytes(2 if version == 1 else 4, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + length + header.encode("latin-1") + data


def archive_of(**members: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return buffer.getvalue()


def outcome(folder: Path, content: bytes) -> FlightRecord | str:
    (folder / "flight.npz").write_bytes(content)
    try:
        return npz.read(folder / "flight.npz", SOURCE)
    except RotoridError as error:
        return str(error)


@pytest.fixture(scope="module")
def sound() -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, time=np.arange(60.0), q=np.sin(np.arange(60.0)))
    return buffer.getvalue()


def test_every_cut_is_one_sentence(tmp_path: Path, sound: bytes) -> None:
    for cut in np.linspace(0, len(sound) - 1, 220).astype(int).tolist():
        found = outcome(tmp_path, sound[:cut])
        assert isinstance(found, str)
        assert found.startswith("flight.npz")


def test_flipped_bits_are_one_sentence_or_change_nothing(tmp_path: Path, sound: bytes) -> None:
    rng = np.random.default_rng(0)
    for place in rng.integers(len(sound), size=500).tolist():
        content = bytearray(sound)
        content[place] ^= 1 << int(rng.integers(8))
        found = outcome(tmp_path, bytes(content))
        if isinstance(found, FlightRecord):
            # Every member carries a checksum: what is read is what was written.
            np.testing.assert_array_equal(found.topics[0].values[0], np.sin(np.arange(60.0)))
        else:
            assert found.startswith("flight.npz")


TIME = member("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }", np.arange(2.0).tobytes())


@pytest.mark.parametrize(
    ("q", "sentence"),
    [
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999,), }"), "which its size contradicts"),
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -2), }", bytes(16)), "is damaged"),
        (member("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1, " * 40 + "), }", bytes(8)), "contradicts"),
        (member("{'descr': '<f8', 'fortran_order': exit(), 'shape': (2,), }", bytes(16)), "is damaged"),
        (member("(" * 5000), "is damaged"),
        (member("", version=2)[:8] + b"\xff\xff\xff\xff", "is damaged"),
        (b"\x93NUMPY\x07\0", "is not a NumPy array"),
        (b"", "is not a NumPy array"),
    ],
)
def test_absurd_headers_are_one_sentence(tmp_path: Path, q: bytes, sentence: str) -> None:
    found = outcome(tmp_path, archive_of(time=TIME, q=q))
    assert isinstance(found, str)
    assert sentence in found


@pytest.mark.parametrize("kind", ["<f9", "<f0", "<b8", "<i3", ">u99"])
def test_numbers_of_a_width_that_does_not_exist_are_one_sentence(tmp_path: Path, kind: str) -> None:
    """One flipped bit makes `<f9` of `<f8`; in a large array the checksum behind it comes too late."""
    q = member(f"{{'descr': '{kind}', 'fortran_order': False, 'shape': (9000,), }}", bytes(72_000))
    found = outcome(tmp_path, archive_of(time=TIME, q=q))
    assert isinstance(found, str)
    assert "cannot be read as a NumPy archive" in found


@pytest.mark.parametrize("method", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_methods_that_numpy_does_not_write_are_not_used(tmp_path: Path, method: int) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr("time.npy", TIME)
    found = outcome(tmp_path, buffer.getvalue())
    assert isinstance(found, str)
    assert "a method that NumPy does not write" in found


def test_a_pickle_is_not_opened(tmp_path: Path) -> None:
    q = member("{'descr': '|O', 'fortran_order': False, 'shape': (2,), }", b"cos\nsystem\n(S'true'\ntR.")
    found = outcome(tmp_path, archive_of(time=TIME, q=q))
    assert isinstance(found, str)
    assert "contains time;" in found


def test_a_bomb_is_refused_before_it_takes_memory(tmp_path: Path) -> None:
    count = 16 * MIB
    bomb = member(f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}", bytes(8 * count))
    content = archive_of(time=TIME, q=bomb)
    assert len(content) < MIB
    tracemalloc.start()
    found = outcome(tmp_path, content)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert isinstance(found, str)
    assert "declares arrays of 128 MiB" in found
    assert peak < 4 * MIB


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"%PDF-1.7", bytes(999)])
def test_foreign_files_are_one_sentence(tmp_path: Path, content: bytes) -> None:
    found = outcome(tmp_path, content)
    assert isinstance(found, str)
    assert "cannot be read as a NumPy archive" in found
