"""Damaged Crazyflie logs: nothing crashes or hangs, what is left is right, and the damage is said."""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from tests.work import require_linear

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io import crazyflie
from rotorid.io.crazyflie import decode

SOURCE = Source(name="log00", format=crazyflie.FORMAT, sha256="")
SAMPLES = 60
HEADER = (
    b"\xbc"
    + struct.pack("<HH", 2, 2)
    + b"\xff\xfffixedFrequency\0\x02\0gyro.x(f)\0acc.z(f)\0"
    + b"\0\0batteryLow\0\x01\0pm.vbat(f)\0"
)
RECORDS = [
    struct.pack("<HQff", 0xFFFF, 1_000_000 + 1000 * number, number, 1.0)
    if number % 5
    else struct.pack("<HQf", 0, 1_000_000 + 1000 * number, number)
    for number in range(SAMPLES)
]
STARTS = np.cumsum([len(HEADER), *map(len, RECORDS)]).tolist()
BODY = HEADER + b"".join(RECORDS)
LOG = BODY + struct.pack("<I", zlib.crc32(BODY))


def read(folder: Path, data: bytes) -> FlightRecord:
    (folder / "log00").write_bytes(data)
    return crazyflie.read(folder / "log00", SOURCE)


def numbers(data: bytes) -> list[int]:
    """Number of every record that was read, which stands in its first variable."""
    return sorted(int(value) for event in decode(data).events for value in next(iter(event.columns.values())))


def test_the_log_is_sound(tmp_path: Path) -> None:
    assert numbers(LOG) == list(range(SAMPLES))
    assert not decode(LOG).gaps
    assert "corrupt_log" not in {finding.kind for finding in read(tmp_path, LOG).findings}


@pytest.mark.parametrize("cut", range(1, len(LOG), 4))
def test_a_cut_log_keeps_every_whole_record_and_says_that_it_is_cut(cut: int, tmp_path: Path) -> None:
    whole = sum(start <= cut for start in STARTS[1:])
    try:
        record = read(tmp_path, LOG[:cut])
    except LogError:
        assert whole == 0
        return
    assert sum(topic.time_s.size for topic in record.topics) == whole
    assert "corrupt_log" in {finding.kind for finding in record.findings}


def test_flipped_bits_are_always_said_and_cost_at_most_their_record(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for place in rng.integers(len(HEADER), len(BODY), 500).tolist():
        data = bytearray(LOG)
        data[place] ^= 1 << int(rng.integers(8))
        record = read(tmp_path, bytes(data))
        assert "corrupt_log" in {finding.kind for finding in record.findings}
        # A flip in a value changes the value, one in a type or a stamp costs the record; the neighbors stay. Only the
        # first records are believed no more than the two behind them.
        hit = int(np.searchsorted(STARTS, place, side="right")) - 1
        kept = {round((stamp - 1.0) * 1e3) for topic in record.topics for stamp in topic.time_s}
        assert kept >= set(range(SAMPLES)) - set(range(0 if hit < 3 else hit, hit + 1))


def test_flipped_bits_in_the_header_are_one_sentence_or_are_said(tmp_path: Path) -> None:
    for place in range(len(HEADER)):
        for bit in range(8):
            data = bytearray(LOG)
            data[place] ^= 1 << bit
            with suppress(LogError):
                record = read(tmp_path, bytes(data))
                assert "corrupt_log" in {finding.kind for finding in record.findings}


@pytest.mark.parametrize("place", range(3, SAMPLES - 3, 7))
@pytest.mark.parametrize("garbage", [bytes(333), b"\xff" * 333, b"\x01" * 333, np.random.default_rng(1).bytes(5000)])
def test_garbage_between_records_costs_nothing_but_itself(place: int, garbage: bytes) -> None:
    at = STARTS[place]
    data = LOG[:at] + garbage + LOG[at:]
    assert numbers(data) == list(range(SAMPLES))
    (gap,) = decode(data).gaps
    assert gap == (at, at + len(garbage))


def test_a_log_that_lost_its_power_ends_in_an_erased_block(tmp_path: Path) -> None:
    record = read(tmp_path, BODY + bytes(4096))
    assert sum(topic.time_s.size for topic in record.topics) == SAMPLES
    (finding,) = (finding for finding in record.findings if finding.kind == "corrupt_log")
    assert finding.numbers["lost_bytes"] == 4096


@pytest.mark.parametrize(
    ("header", "sentence"),
    [
        (b"\xbc\x02\0\xff\xff\0\0a\0\x01\0gyro.x(f)\0", "ends inside its header"),
        (b"\xbc\x02\0\x01\0\0\0a\0\xff\xffgyro.x(f)\0", "ends inside its header"),
        (b"\xbc\x02\0\x01\0\0\0a\0\x01\0gyro.x(P)\0", "no known type"),
        (b"\xbc\x02\0\x01\0\0\0a\0\x01\0" + b"x" * 900 + b"\0", "a name has no end"),
        (b"\xbc\x02\0\x01\0\0\0a\0\x02\0gyro.x(f)\0gyro.x(f)\0", "names a variable twice"),
        (b"\xbc\x02\0\x02\0\0\0a\0\0\0\0\0b\0\0\0", "the same number"),
        (b"\xbc\x02\0\x01\0\0\0a\0\x01\0gyro.x(f)\0", "no samples"),
        (b"\xbc\x09\0\x01\0", "does not start like"),
        (b"", "does not start like"),
        (b"%PDF-1.7", "does not start like"),
    ],
)
def test_absurd_headers_are_one_sentence(tmp_path: Path, header: bytes, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        read(tmp_path, header)


@pytest.mark.parametrize(
    "tail",
    [
        pytest.param(bytes(2_000_000), id="zeros, which are a known type"),
        pytest.param(b"\xff" * 2_000_000, id="ones, which are another"),
        pytest.param(np.random.default_rng(2).bytes(2_000_000), id="noise"),
        pytest.param(struct.pack("<HQf", 0, 7, 0.0) * 140_000, id="records whose stamps stand still in the past"),
        pytest.param((struct.pack("<HQff", 0xFFFF, 1 << 62, 0, 0) + RECORDS[0]) * 60_000, id="stamps out of order"),
    ],
)
def test_two_megabytes_of_malice_are_linear_work(tail: bytes) -> None:
    log = decode(LOG[:-4] + tail)
    assert sum(event.time_s.size for event in log.events) >= SAMPLES
    require_linear(lambda size: decode(LOG[:-4] + tail[:size]), size=len(tail) // 64)


def test_numbers_that_are_none_are_left_out_without_a_warning(tmp_path: Path) -> None:
    signaling = struct.pack("<HQ", 0xFFFF, 1_000_000 + 1000 * SAMPLES) + b"\x01\0\xa0\x7f\x01\0\xa0\x7f"
    record = read(tmp_path, BODY + signaling)
    assert sum(topic.time_s.size for topic in record.topics) == SAMPLES
    assert "gap" in {finding.kind for finding in record.findings}
