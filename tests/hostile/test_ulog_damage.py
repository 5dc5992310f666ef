"""Damaged PX4 logs: nothing is believed that is not there, and every break is said."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io import read
from rotorid.io.px4 import log as px4
from rotorid.io.px4.ulog import HEADER_BYTES, MAGIC, walk

LOG = "px4/sample_log_small.ulg"
SOURCE = Source(name="flight.ulg", format=px4.FORMAT, sha256="")


@pytest.fixture(scope="module")
def intact(unpacked: Callable[[str], Path]) -> bytes:
    return unpacked(LOG).read_bytes()


def message_starts(data: bytes) -> list[int]:
    starts = [HEADER_BYTES]
    while starts[-1] < len(data):
        starts.append(starts[-1] + 3 + int.from_bytes(data[starts[-1] : starts[-1] + 2], "little"))
    return starts[:-1]


def read_bytes(folder: Path, data: bytes) -> FlightRecord:
    (folder / "flight.ulg").write_bytes(data)
    return px4.read(folder / "flight.ulg", SOURCE)


def test_an_intact_log_has_no_damage(intact: bytes) -> None:
    found = walk(intact)
    assert not found.damage
    assert found.intact == ((0, len(intact)),)


def test_every_cut_inside_a_message_is_seen(intact: bytes) -> None:
    starts = set(message_starts(intact))
    for cut in np.random.default_rng(0).integers(HEADER_BYTES + 1, len(intact), 40).tolist():
        assert bool(walk(intact[:cut]).damage) == (cut not in starts)


def test_every_flipped_bit_in_a_size_or_type_of_data_is_seen_and_costs_little(intact: bytes) -> None:
    rng = np.random.default_rng(1)
    data_messages = [start for start in message_starts(intact) if intact[start + 2] == ord("D")]
    for start in rng.choice(data_messages, 60).tolist():
        damaged = bytearray(intact)
        damaged[start + int(rng.integers(3))] ^= 1 << int(rng.integers(8))
        found = walk(bytes(damaged))
        assert found.damage
        # The walk finds its way again within a few messages.
        assert sum(item.stop - item.start for item in found.damage) < 2000


@pytest.mark.parametrize("place", [1, 4, 12, -3])
def test_a_message_of_an_unknown_type_costs_nothing_but_itself(intact: bytes, place: int) -> None:
    """Among the definitions, too, where no data message is known yet by which to find the way again."""
    at = message_starts(intact)[place]
    found = walk(intact[:at] + struct.pack("<HB", 3, ord("Z")) + b"abc" + intact[at:])
    assert [(item.start, item.stop) for item in found.damage] == [(at, at + 6)]
    assert [part.positions.size for part in found.streams] == [part.positions.size for part in walk(intact).streams]


def test_around_the_damage_only_true_samples_are_read(intact: bytes, tmp_path: Path) -> None:
    whole = read_bytes(tmp_path, intact)
    # From the start of a message on: inside of one, noise would stand in a payload, which has no checksum.
    middle = next(start for start in message_starts(intact) if start > len(intact) // 2)
    damaged = intact[:middle] + np.random.default_rng(2).bytes(700) + intact[middle + 700 :]
    record = read_bytes(tmp_path, damaged)
    (finding,) = (finding for finding in record.findings if finding.kind == "corrupt_log")
    assert finding.numbers["first_byte"] == middle
    for topic in record.topics:
        original = next(item for item in whole.topics if item.channels == topic.channels)
        kept = np.isin(original.time_s, topic.time_s)
        np.testing.assert_array_equal(original.values[:, kept], topic.values)
        # 700 bytes and the two messages that they cut hold a dozen samples at most.
        assert original.time_s.size - topic.time_s.size <= 12


def test_a_cut_log_is_read_to_the_cut_and_says_so(intact: bytes, tmp_path: Path) -> None:
    (tmp_path / "flight.ulg").write_bytes(intact[: len(intact) // 2 + 1])
    record = read(tmp_path / "flight.ulg")
    assert record.stop_s > record.start_s
    (finding,) = (finding for finding in record.findings if finding.kind == "corrupt_log")
    assert "ends inside a message" in finding.message


@pytest.mark.parametrize("length", [7, 10, 16])
def test_a_log_that_ends_in_its_header_is_one_sentence(intact: bytes, tmp_path: Path, length: int) -> None:
    (tmp_path / "flight.ulg").write_bytes(intact[:length])
    with pytest.raises(LogError, match="ends inside its header"):
        read(tmp_path / "flight.ulg")


def test_a_header_followed_by_noise_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "flight.ulg").write_bytes(MAGIC + bytes(9) + np.random.default_rng(3).bytes(100_000))
    with pytest.raises(LogError, match="contains no topic"):
        read(tmp_path / "flight.ulg")


def definition(letter: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(letter)) + payload


def test_data_appended_after_a_crash_are_read_on_both_sides_of_damage(tmp_path: Path) -> None:
    """The log ends in a cut message, a second part was appended, and a byte of the first part is damaged as well."""

    def sample(number: int) -> bytes:
        return definition("D", struct.pack("<HQf", 0, 1000 * number, float(number)))

    head = definition("F", b"battery_status:uint64_t timestamp;float voltage_v;") + definition(
        "A", b"\0\0\0battery_status"
    )
    offset = len(MAGIC) + 9 + 3 + 40 + len(head) + 9 * len(sample(0)) + 8
    flags = definition("B", bytes(8) + b"\1" + bytes(7) + struct.pack("<3Q", offset, 0, 0))
    first = [sample(number) for number in range(9)]
    first[2] = b"\xff" + first[2][1:]
    second = [sample(number) for number in range(20, 29)]
    data = b"".join([MAGIC, b"\1", bytes(8), flags, head, *first, sample(9)[:8], *second])

    record = read_bytes(tmp_path, data)
    assert record.topics[0].values[0].tolist() == [0, 1, *range(3, 9), *range(20, 29)]
    (finding,) = (finding for finding in record.findings if finding.kind == "corrupt_log")
    assert finding.numbers["places"] == 2
    assert finding.numbers["lost_bytes"] == len(sample(2)) + 8


@pytest.mark.parametrize(
    ("formats", "sentence"),
    [
        (["a:a inner;"], "contains itself"),
        (["a:b inner;", "b:a inner;"], "contains itself"),
        (["a:b[65535] x;", "b:c[65535] x;", "c:d[65535] x;", "d:uint8_t[9] x;"], "larger than any message"),
        (["a:b[65535] x;", "b:cc[65535] x;", "cc:"], "larger than any message"),
        ([f"{i}:{i + 1} x;" for i in range(20)] + ["a:0 x;"], "nested too deeply"),
    ],
)
def test_definitions_that_would_hang_a_parser_are_refused(tmp_path: Path, formats: list[str], sentence: str) -> None:
    parts = [MAGIC + bytes(9), *(definition("F", text.encode()) for text in formats)]
    (tmp_path / "flight.ulg").write_bytes(b"".join([*parts, definition("A", b"\0\0\0a")]))
    with pytest.raises(LogError, match=sentence):
        read(tmp_path / "flight.ulg")


def test_any_flipped_bit_gives_a_record_or_one_sentence(intact: bytes, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    sentences = 0
    for _ in range(25):
        damaged = bytearray(intact[:200_000])
        for place in rng.integers(0, len(damaged), 30).tolist():
            damaged[place] ^= 1 << int(rng.integers(8))
        try:
            record = read_bytes(tmp_path, bytes(damaged))
        except LogError:
            sentences += 1
        else:
            assert "corrupt_log" in {finding.kind for finding in record.findings}
    assert sentences < 25
