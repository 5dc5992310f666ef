"""`read` judges a file by its content and answers everything else with one sentence."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest

from rotorid.errors import LogError, UsageError
from rotorid.io import read

TABLE = b"time [s],q [rad/s]\n0,1\n0.1,2\n"


def test_the_content_decides_and_not_the_extension(tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(TABLE)
    record = read(path)
    assert (record.source.name, record.source.format) == ("flight.ulg", "CSV")
    assert record.source.sha256 == hashlib.sha256(TABLE).hexdigest()


def test_a_compressed_log_keeps_its_own_name_and_hash(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv.gz"
    path.write_bytes(gzip.compress(TABLE, mtime=0))
    record = read(str(path))
    assert record.channel_names == ("q",)
    assert record.source.name == "flight.csv.gz"
    assert record.source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_mapping_may_be_a_path(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text('[clock]\nsample_rate_hz = 10.0\n[channels.q]\nsource = "gyro"\n')
    (tmp_path / "flight.txt").write_text("gyro,other\n1,2\n3,4\n")
    record = read(tmp_path / "flight.txt", mapping=tmp_path / "map.toml")
    assert record.topics[0].values.tolist() == [[1.0, 3.0]]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is empty"),
        (b"Dear pilot\nhello\n", "not in a known format"),
        (b"%PDF-1.7 ,,,", "a PDF document"),
        (b"<!DOCTYPE html>\n<html>,", "a web page"),
        (b"ULogEnc\1" + bytes(99), "an encrypted PX4 log"),
        (gzip.compress(gzip.compress(TABLE, mtime=0), mtime=0), "an archive inside an archive"),
        (gzip.compress(b"", mtime=0), "is empty"),
    ],
)
def test_a_foreign_file_hears_what_it_is(tmp_path: Path, content: bytes, sentence: str) -> None:
    (tmp_path / "thing").write_bytes(content)
    with pytest.raises(LogError, match=f"^thing.*{sentence}") as caught:
        read(tmp_path / "thing")
    assert "ulg" in caught.value.needed
    assert caught.value.remedy


def test_a_missing_file_and_a_folder_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"none\.ulg cannot be opened: No such file"):
        read(tmp_path / "none.ulg")
    with pytest.raises(LogError, match="is a folder"):
        read(tmp_path)


def test_autopilot_logs_are_found_and_need_no_mapping(shared_data: Path, unpacked: Callable[[str], Path]) -> None:
    assert read(unpacked("px4/sample_log_small.ulg")).source.format == "PX4 ULog"
    assert "DataFlash" in read(unpacked("ardupilot/truncated_80k.BIN")).source.format
    with pytest.raises(UsageError, match="which is PX4 ULog"):
        read(unpacked("px4/sample_log_small.ulg"), mapping=shared_data / "antx" / "map.toml")
