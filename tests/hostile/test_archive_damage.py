"""Hostile archives: bombs, nesting and nonsense end in one sentence, within the limits, and leave nothing behind."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import tempfile
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.hostile.damage import assert_complete
from tests.hostile.samples import csv, zipped

from rotorid.errors import LogError
from rotorid.io import read
from rotorid.io.files import UnpackLimits, compression_of, unpacked

MIB = 1 << 20
PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "gz": gzip.compress,
    "xz": lzma.compress,
    "bz2": bz2.compress,
    "zip": zipped,
}
LIMITS = UnpackLimits(size_bytes=64 * MIB, ratio=300.0, free_bytes=8 * MIB)


def refusal(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    with pytest.raises(LogError) as caught:
        read(path)
    assert_complete(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("suffix", PACKERS)
def test_a_bomb_is_refused_in_little_memory_and_leaves_nothing(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    bomb = tmp_path / f"bomb.{suffix}"
    bomb.write_bytes(PACKERS[suffix](bytes(100 * MIB)))
    tracemalloc.start()
    with (
        pytest.raises(LogError, match="unpacks to more than"),
        unpacked(bomb, compression_of(bomb.read_bytes()), LIMITS),
    ):
        pass
    assert tracemalloc.get_traced_memory()[1] < 24 * MIB
    tracemalloc.stop()
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.parametrize("outer", PACKERS)
@pytest.mark.parametrize("inner", PACKERS)
def test_archives_inside_archives_are_not_followed(outer: str, inner: str, tmp_path: Path) -> None:
    nested = PACKERS[outer](PACKERS[inner](csv().content))
    assert "is an archive inside an archive" in refusal(tmp_path / f"flight.{outer}", nested)


@pytest.mark.parametrize("suffix", PACKERS)
@pytest.mark.parametrize("rest", [b"", b"\xff" * 999, bytes(999), b"PK" * 500], ids=["nothing", "ones", "zeros", "PK"])
def test_a_beginning_followed_by_nonsense_is_one_sentence(suffix: str, rest: bytes, tmp_path: Path) -> None:
    head = PACKERS[suffix](b"")[:6]
    assert "cannot be unpacked" in refusal(tmp_path / f"flight.{suffix}", head + rest)


@pytest.mark.parametrize("pack", [bytes, *PACKERS.values()], ids=["plain", *PACKERS])
def test_empty_content_is_one_sentence(pack: Callable[[bytes], bytes], tmp_path: Path) -> None:
    assert "is empty" in refusal(tmp_path / "flight", pack(b""))


def test_an_xz_file_may_not_ask_for_more_memory_than_a_decoder_needs(tmp_path: Path) -> None:
    greedy = [{"id": lzma.FILTER_LZMA2, "dict_size": 1 << 30}]
    packed = lzma.compress(csv().content, filters=greedy)
    tracemalloc.start()
    sentence = refusal(tmp_path / "flight.csv.xz", packed)
    assert tracemalloc.get_traced_memory()[1] < 16 * MIB
    tracemalloc.stop()
    assert "cannot be unpacked as xz" in sentence


def test_an_xz_file_of_several_padded_streams_is_read_to_its_end(tmp_path: Path) -> None:
    content = csv().content
    halves = [lzma.compress(content[:700]), bytes(8), lzma.compress(b""), lzma.compress(content[700:]), bytes(4)]
    (tmp_path / "flight.csv.xz").write_bytes(b"".join(halves))
    (tmp_path / "flight.csv").write_bytes(content)
    found, plain = read(tmp_path / "flight.csv.xz").topics[0], read(tmp_path / "flight.csv").topics[0]
    assert found.values.tolist() == plain.values.tolist()


def test_anything_behind_an_xz_file_is_said(tmp_path: Path) -> None:
    sentence = refusal(tmp_path / "flight.csv.xz", lzma.compress(csv().content) + b"\0\0\0\0left over")
    assert "cannot be unpacked as xz" in sentence


def archive_of(**members: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(name.replace("__", "."), content)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (archive_of(), "a zip of 0 files"),
        (archive_of(a__csv=b"1", b__csv=b"2"), "a zip of 2 files"),
        (archive_of(**{f"n{number}": b"" for number in range(5000)}), "a zip of 5000 files"),
    ],
    ids=["no files", "two files", "thousands of files"],
)
def test_zips_of_something_else_are_one_sentence(content: bytes, sentence: str, tmp_path: Path) -> None:
    assert sentence in refusal(tmp_path / "flight.zip", content)


def test_a_name_that_is_no_text_is_one_sentence(tmp_path: Path) -> None:
    content = bytearray(archive_of(a__csv=csv().content).replace(b"a.csv", b"\xff\xfe.cs"))
    # The flag that names are UTF-8, in front of the file and in the directory.
    content[7] |= 0x08
    content[content.index(b"PK\x01\x02") + 9] |= 0x08
    assert "cannot be unpacked as zip" in refusal(tmp_path / "flight.zip", bytes(content))


def test_a_method_that_lets_the_file_take_memory_is_not_used(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("flight.csv", csv().content)
    assert "lets the file decide how much memory" in refusal(tmp_path / "flight.zip", buffer.getvalue())


def test_names_that_lead_out_of_the_folder_lead_nowhere(tmp_path: Path) -> None:
    """The member's own name is never used: what is unpacked is called after the archive, in a folder of its own."""
    content = archive_of(**{"../../escaped__csv": csv().content})
    (tmp_path / "flight.zip").write_bytes(content)
    assert read(tmp_path / "flight.zip").channel_names == ("q", "pitch_command")
    assert not list(tmp_path.rglob("escaped*"))
    assert not (tmp_path.parent / "escaped.csv").exists()
