"""Damaged telemetry: a message counts only with a right checksum, and every lost byte is counted."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.mavlink import tlog
from rotorid.io.mavlink.messages import LAYOUTS, STAMP_BYTES, checksum, decode

SOURCE = Source(name="flight.tlog", format=tlog.FORMAT, sha256="")
STAMP_US = 1_790_000_000_000_000
ATTITUDE = 30
FRAMES = 120


def frame(k: int, *, number: int = ATTITUDE, payload: bytes | None = None) -> bytes:
    if payload is None:
        payload = struct.pack("<I6f", 20 * k, *(0.1 * (k % 7) + 0.01 * axis for axis in range(1, 7)))
    body = struct.pack("<BBBBBB3s", len(payload), 0, 0, k & 0xFF, 1, 1, number.to_bytes(3, "little")) + payload
    extra = LAYOUTS[number].crc_extra if number in LAYOUTS else 0
    crc = int(checksum(np.frombuffer(body, dtype=np.uint8)[None, :], extra)[0])
    return struct.pack(">Q", STAMP_US + 20_000 * k) + b"\xfd" + body + struct.pack("<H", crc)


INTACT = b"".join(frame(k) for k in range(FRAMES))
SIZE = len(INTACT) // FRAMES
LENGTH_AND_FLAGS, NUMBER = range(STAMP_BYTES + 1, STAMP_BYTES + 3), range(STAMP_BYTES + 7, STAMP_BYTES + 10)
LONGEST = STAMP_BYTES + 10 + 255 + 2 + 13


def read_bytes(folder: Path, data: bytes) -> FlightRecord:
    (folder / "flight.tlog").write_bytes(data)
    return tlog.read(folder / "flight.tlog", SOURCE)


def damage_of(record: FlightRecord) -> dict[str, float]:
    return next((dict(item.numbers) for item in record.findings if item.kind == "corrupt_log"), {})


def test_every_truncation_is_read_to_the_cut_and_counted(tmp_path: Path) -> None:
    for cut in range(SIZE, SIZE + 250):
        record = read_bytes(tmp_path, INTACT[:cut])
        assert record.topics[0].time_s.size == cut // SIZE
        assert damage_of(record).get("lost_bytes", 0) == cut % SIZE


def test_every_flipped_bit_costs_at_most_its_own_message(tmp_path: Path) -> None:
    whole = read_bytes(tmp_path, INTACT).topics[0]
    rng = np.random.default_rng(1)
    for place in rng.integers(0, len(INTACT), 500).tolist():
        damaged = bytearray(INTACT)
        damaged[place] ^= 1 << int(rng.integers(8))
        record = read_bytes(tmp_path, bytes(damaged))
        topic = record.topics[0]
        lost, inside = FRAMES - topic.time_s.size, place % SIZE
        # A wrong length or flag may swallow as many followers as fit into the longest frame; all else costs one.
        assert lost <= (1 + LONGEST // SIZE if inside in LENGTH_AND_FLAGS else 1)
        # The stamp of the ground station has no checksum, and a message of unknown kind has none that is known.
        assert damage_of(record) or (lost == 0 if inside < STAMP_BYTES else inside in NUMBER)
        kept = np.isin(whole.time_s, topic.time_s)
        np.testing.assert_array_equal(topic.values, whole.values[:, kept])


def test_noise_between_frames_is_skipped_and_counted(tmp_path: Path) -> None:
    noise = np.random.default_rng(2).bytes(5000)
    middle = SIZE * (FRAMES // 2)
    record = read_bytes(tmp_path, INTACT[:middle] + noise + INTACT[middle:])
    assert record.topics[0].time_s.size == FRAMES
    assert damage_of(record)["lost_bytes"] == len(noise)
    assert damage_of(record)["first_byte"] == middle


@pytest.mark.parametrize("data", [b"", b"\x00", b"#ROSBAG V2.0\n", bytes(100_000), b"\x00\x06" * 50_000])
def test_foreign_files_are_one_sentence(tmp_path: Path, data: bytes) -> None:
    assert not tlog.sniff(data[:4096])
    with pytest.raises(LogError, match="contains 0 MAVLink frames"):
        read_bytes(tmp_path, data)


def test_frames_of_absurd_length_and_of_unknown_kind_are_passed_over(tmp_path: Path) -> None:
    long = frame(0, payload=bytes(255))
    empty = frame(0, payload=b"")
    unknown = frame(0, number=0xFFFFFF, payload=bytes(9))
    record = read_bytes(tmp_path, unknown + long + empty + INTACT)
    # Zeros at the end are cut by the protocol, so that no payload at all is a message of zeros.
    assert record.topics[0].time_s.size == FRAMES + 2
    with pytest.raises(LogError, match="1 MAVLink frames but no intact message"):
        read_bytes(tmp_path, unknown)


def test_numbers_that_are_none_are_left_out(tmp_path: Path) -> None:
    nan = frame(3, payload=struct.pack("<I6f", 60, *[float("nan")] * 6))
    assert read_bytes(tmp_path, INTACT + nan).topics[0].time_s.size == FRAMES


@given(st.binary(max_size=400), st.integers(0, 3 * SIZE))
@settings(max_examples=200, deadline=None)
def test_any_bytes_anywhere_leave_a_count_that_adds_up(noise: bytes, place: int) -> None:
    data = INTACT[:place] + noise + INTACT[place : 3 * SIZE]
    found = decode(data)
    assert 0 <= found.lost_bytes <= len(data)
    assert (found.places == 0) == (found.lost_bytes == 0)
    assert sum(item.fields.size for item in found.messages.values()) + found.failed <= found.frames
