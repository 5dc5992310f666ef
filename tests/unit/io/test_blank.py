"""Files that hold nothing say so in one line, with the one setting that makes the next one hold a flight."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from rotorid.errors import LogError
from rotorid.io.blank import blank_tail
from rotorid.io.registry import read

_FMT = struct.Struct("<BBB BB4s16s64s")


def definition(number: int, length: int, name: str, letters: str, columns: str) -> bytes:
    return _FMT.pack(0xA3, 0x95, 128, number, length, name.encode(), letters.encode(), columns.encode())


DEFINITIONS = definition(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns") + definition(
    9, 15, "BARO", "Qf", "TimeUS,Alt"
)
SDLOG2 = definition(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns") + definition(
    2, 59, "ATT", "ffff", "qw,qx,qy,qz"
)
ULOG = b"ULog\x01\x12\x35\x01" + bytes(8)
CARD = b"\xbc" + struct.pack("<HHH", 2, 1, 7) + b"fixedFrequency\0" + struct.pack("<H", 1) + b"gyro.x(f)\0"
BLACKBOX = (
    b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n"
    b"H Field I name:loopIteration,time,gyroADC[0]\nH Field I signed:0,0,1\nH Field I predictor:0,0,0\n"
    b"H Field I encoding:1,1,0\nH Field P predictor:6,2,1\nH Field P encoding:9,0,0\n"
)


def table(rows: int) -> bytes:
    return b"time [s],q [rad/s]\n" + b"".join(b"%.2f,0.1\n" % (0.01 * row) for row in range(rows))


EMPTY = {
    "zeros.bin": (bytes(4096), "only zeros, 4096 bytes", "copy it again"),
    "erased.bbl": (b"\xff" * 4096, "erased flash memory", "nothing was logged"),
    "header.ulg": (ULOG + bytes(9000), "only zeros from byte 8 of 9016", "copy it again"),
    "header.csv": (table(0) + bytes(1000), "only zeros from byte 19", "copy it again"),
    "tail.csv": (table(500) + bytes(1000), "only zeros from byte 4519 of 5519", "copy it again"),
    "nothing.ulg": (
        ULOG + struct.pack("<HBB", 15, ord("I"), 11) + b"char[3] abcxyz",
        "no topic at all",
        "SDLOG_MODE = 0",
    ),
    "nothing.bin": (DEFINITIONS, "no flight, only definitions", "LOG_DISARMED = 1"),
    "other.bin": (
        DEFINITIONS + struct.pack("<BBBQf", 0xA3, 0x95, 9, 10**6, 1.0),
        "no rates, attitude or motor outputs, only BARO",
        "LOG_BITMASK = 176126",
    ),
    "stub.px4log": (SDLOG2, "beginning of a log of PX4 before 2017", "arm"),
    "nothing.bbl": (BLACKBOX, "a header and no frame", "blackbox_mode = NORMAL"),
    "log00": (CARD + struct.pack("<I", zlib.crc32(CARD)), "a header and no samples", "config.txt"),
    "nothing.csv": (table(0), "a header and no samples", "check how it was written"),
}


@pytest.mark.parametrize("name", EMPTY)
def test_what_holds_nothing_says_so_and_what_to_do(name: str, tmp_path: Path) -> None:
    content, came, remedy = EMPTY[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError) as error:
        read(tmp_path / name)
    assert came in error.value.came
    assert remedy in error.value.remedy
    assert str(error.value).startswith(name)
    assert "\n" not in str(error.value)


def test_a_log_that_ends_in_zeros_is_read_and_says_so(tmp_path: Path) -> None:
    body = CARD + b"".join(struct.pack("<HQf", 7, 1000 * k, 0.1 * k) for k in range(100))
    (tmp_path / "log01").write_bytes(body + bytes(8192))
    record = read(tmp_path / "log01")
    assert np.allclose(record["p"].values[:100], np.radians(0.1 * np.arange(100)))
    first = record.findings[0]
    assert (first.kind, dict(first.numbers)["first_byte"]) == ("corrupt_log", len(body.rstrip(b"\0")))


def test_erased_flash_behind_a_log_is_no_damage(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"head" + b"\xff" * 9000)
    tail = blank_tail(tmp_path / "a.bin")
    assert tail is not None
    assert tail.finding() is None
    (tmp_path / "a.bin").write_bytes(b"head" + bytes(100))
    assert blank_tail(tmp_path / "a.bin") is None
