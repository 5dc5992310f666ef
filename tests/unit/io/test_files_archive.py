"""Compressed logs are unpacked within limits, and damaged archives are one sentence."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from rotorid.errors import LogError
from rotorid.io.files import UnpackLimits, compression_of, unpacked

CONTENT = bytes(range(256)) * 40


def zipped(*members: tuple[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return buffer.getvalue()


PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "gzip": gzip.compress,
    "xz": lzma.compress,
    "bzip2": bz2.compress,
    "zip": lambda content: zipped(("__MACOSX/log", b"noise"), ("flight/", b""), ("flight/log.ulg", content)),
}


def unpack(path: Path, limits: UnpackLimits | None = None) -> bytes:
    with unpacked(path, compression_of(path.read_bytes()[:16]), limits) as log:
        content = log.read_bytes()
    assert not log.exists()
    return content


@pytest.mark.parametrize("kind", PACKERS)
def test_every_kind_gives_the_log_back(kind: str, tmp_path: Path) -> None:
    packed = PACKERS[kind](CONTENT)
    assert compression_of(packed) == kind
    (tmp_path / "log").write_bytes(packed)
    assert unpack(tmp_path / "log") == CONTENT


@pytest.mark.parametrize("kind", PACKERS)
def test_a_truncated_archive_is_one_sentence(kind: str, tmp_path: Path) -> None:
    packed = PACKERS[kind](CONTENT)
    (tmp_path / "log").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(LogError, match=f"cannot be unpacked as {kind}"):
        unpack(tmp_path / "log")


@pytest.mark.parametrize("kind", PACKERS)
def test_a_bomb_is_stopped_by_its_ratio(kind: str, tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(PACKERS[kind](bytes(4 << 20)))
    with pytest.raises(LogError, match="unpacks to more than 1 MiB"):
        unpack(tmp_path / "log", UnpackLimits(free_bytes=1 << 20, ratio=5.0))


def test_the_size_is_limited_whatever_the_ratio(tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(gzip.compress(bytes(2 << 20)))
    with pytest.raises(LogError, match="unpacks to more than"):
        unpack(tmp_path / "log", UnpackLimits(size_bytes=1 << 20))


def test_a_zip_of_several_files_names_them(tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(zipped(("a.ulg", b"1"), ("b.ulg", b"2")))
    with pytest.raises(LogError, match=r"zip of 2 files \(a.ulg, b.ulg\)"):
        unpack(tmp_path / "log")


def test_an_encrypted_zip_is_one_sentence(tmp_path: Path) -> None:
    packed = bytearray(zipped(("a.ulg", CONTENT)))
    packed[6] |= 1  # the flag of encryption, in the local header and in the directory
    packed[packed.index(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "log").write_bytes(packed)
    with pytest.raises(LogError, match="encrypted"):
        unpack(tmp_path / "log")
