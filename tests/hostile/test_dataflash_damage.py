"""Damaged DataFlash logs: nothing crashes or hangs, what is left is right, and what is lost is counted."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.work import require_linear

from rotorid.data.record import Source
from rotorid.errors import LogError
from rotorid.io.ardupilot.dataflash import DataFlashLog, decode
from rotorid.io.ardupilot.log import FORMAT, read

MAGIC = b"\xa3\x95"
FMT_BYTES = 89
MESSAGES = 40


def fmt(number: int, length: int, name: bytes, letters: bytes, columns: bytes) -> bytes:
    return MAGIC + b"\x80" + struct.pack("<BB4s16s64s", number, length, name, letters, columns)


DEFINITIONS = (
    fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    + fmt(1, 15, b"RATE", b"Qf", b"TimeUS,R")
    + fmt(2, 23, b"IMU", b"Qfff", b"TimeUS,GyrX,GyrY,GyrZ")
)
BODY = [
    MAGIC + (b"\x01" + struct.pack("<Qf", index, 0.5) if index % 2 else b"\x02" + struct.pack("<Qfff", index, 1, 2, 3))
    for index in range(MESSAGES)
]
STARTS = np.cumsum([len(DEFINITIONS), *map(len, BODY)]).tolist()
LOG = DEFINITIONS + b"".join(BODY)


def stamps(log: DataFlashLog) -> list[int]:
    """Number of every message that was read."""
    held = [log.tables[name].column("TimeUS").tolist() for name in ("RATE", "IMU") if name in log.tables]
    return sorted(number for numbers in held for number in numbers)


def decoded_bytes(log: DataFlashLog) -> int:
    return sum(len(table) * table.format.length for table in log.tables.values())


def all_but(*missing: int) -> list[int]:
    return [index for index in range(MESSAGES) if index not in missing]


def test_the_log_is_sound() -> None:
    log = decode(LOG)
    assert stamps(log) == all_but()
    assert log.findings == ()


@pytest.mark.parametrize("cut", range(2 * FMT_BYTES, len(LOG), 5))
def test_cut_log_keeps_every_complete_message(cut: int) -> None:
    log = decode(LOG[:cut])

    complete = sum(start <= cut for start in STARTS[1:])
    assert stamps(log) == list(range(complete))
    assert decoded_bytes(log) + log.skipped_bytes == cut
    assert [finding.kind for finding in log.findings] == ["corrupt_log"] * bool(log.skipped_bytes)


@given(place=st.integers(0, MESSAGES - 1), garbage=st.binary(min_size=1, max_size=400))
@settings(deadline=None)
def test_garbage_between_messages_costs_nothing_but_itself(place: int, garbage: bytes) -> None:
    # Without the first magic byte, what was inserted cannot pass for messages: the count must be exact.
    garbage = garbage.replace(b"\xa3", b"\x00")
    at = STARTS[place]

    log = decode(LOG[:at] + garbage + LOG[at:])

    assert stamps(log) == all_but()
    assert log.gaps == ((at, at + len(garbage)),)
    (finding,) = log.findings
    assert finding.kind == "corrupt_log"
    assert (finding.numbers["bytes"], finding.numbers["first_byte"]) == (len(garbage), at)


@pytest.mark.parametrize("place", range(1, MESSAGES - 2))
def test_lost_bytes_cost_the_message_that_lost_them(place: int) -> None:
    at = STARTS[place] + 5

    log = decode(LOG[:at] + LOG[at + 4 :])

    assert stamps(log) == all_but(place)
    assert log.skipped_bytes == len(BODY[place]) - 4


@pytest.mark.parametrize("offset", [0, 1])
@pytest.mark.parametrize("place", range(1, MESSAGES - 2))
def test_damaged_header_costs_its_message(place: int, offset: int) -> None:
    data = bytearray(LOG)
    data[STARTS[place] + offset] ^= 0x10

    log = decode(bytes(data))

    assert stamps(log) == all_but(place)
    assert log.gaps == ((STARTS[place], STARTS[place + 1]),)


@pytest.mark.parametrize("place", range(1, MESSAGES - 3))
def test_message_of_an_undefined_type_is_skipped(place: int) -> None:
    data = bytearray(LOG)
    data[STARTS[place] + 2] = 77

    log = decode(bytes(data))

    assert stamps(log) == all_but(place)


def test_definition_that_contradicts_itself_is_reported_and_not_decoded() -> None:
    wrong = LOG.replace(b"Qfff" + bytes(12), b"Qffi" + bytes(12)).replace(b"Qffi", b"QffB", 1)

    log = decode(wrong)

    assert stamps(log) == [index for index in all_but() if index % 2]
    assert log.undecodable == ("IMU",)
    assert [finding.where for finding in log.findings] == ["IMU"]


@given(flips=st.lists(st.tuples(st.integers(0, len(LOG) - 1), st.integers(0, 7)), min_size=1, max_size=30))
@settings(deadline=None, max_examples=200)
def test_flipped_bits_never_crash_and_every_byte_is_accounted_for(flips: list[tuple[int, int]]) -> None:
    data = bytearray(LOG)
    for position, bit in flips:
        data[position] ^= 1 << bit
    try:
        log = decode(bytes(data))
    except LogError:
        assert any(position < len(DEFINITIONS) for position, _ in flips)
        return
    for table in log.tables.values():
        for name in table.columns:
            assert table.column(name).shape[0] == len(table)
    accounted = decoded_bytes(log) + log.skipped_bytes
    assert accounted == log.size or (log.undecodable and accounted < log.size)
    assert bool(log.findings) == bool(log.skipped_bytes or log.undecodable)


@pytest.mark.parametrize(
    "tail",
    [
        pytest.param(b"\xa3\x95\xa3" * 300_000, id="headers that overlap"),
        pytest.param(b"\xa3\x95\x01" * 300_000, id="headers without bodies"),
        pytest.param((MAGIC + b"\x02") * 7 + bytes(900_000), id="a run of zeros"),
        pytest.param(fmt(1, 15, b"RATE", b"Qf", b"TimeUS,R") * 10_000, id="one definition repeated"),
        pytest.param(b"".join(fmt(1, 3 + n % 200, b"R", b"B", b"x") for n in range(10_000)), id="ever new definitions"),
    ],
)
def test_a_megabyte_of_malice_is_linear_work(tail: bytes) -> None:
    log = decode(LOG + tail)

    assert decoded_bytes(log) + log.skipped_bytes <= log.size
    require_linear(lambda size: decode(LOG + tail[:size]), size=len(tail) // 16)


def test_bits_flipped_in_a_real_log(shared_data: Path) -> None:
    whole = np.frombuffer((shared_data / "ardupilot" / "truncated_80k.BIN").read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(0)
    for _ in range(30):
        data = whole.copy()
        data[rng.integers(data.size, size=20)] ^= 1 << rng.integers(8, size=20).astype(np.uint8)
        log = decode(data)
        assert decoded_bytes(log) + log.skipped_bytes <= log.size
        assert sum(len(table) for table in log.tables.values()) > 1000


@pytest.mark.parametrize("seed", range(40))
def test_record_of_a_log_with_flipped_bits_in_its_definitions(seed: int, shared_data: Path, tmp_path: Path) -> None:
    """Damaged definitions turn numbers into text and stamps into floats; the reader leaves such columns out."""
    with (shared_data / "ardupilot_sitl" / "x_calm_roll.BIN").open("rb") as file:
        data = np.frombuffer(file.read(200_000), dtype=np.uint8).copy()
    rng = np.random.default_rng(seed)
    (headers,) = np.nonzero((data[:-2] == 0xA3) & (data[1:-1] == 0x95) & (data[2:] == 0x80))
    # Bytes 9 to 24 of a definition are its letters, byte 4 its length: the ones that change what is read.
    places = rng.choice(headers, size=60, replace=False) + rng.choice([4, 9, 10, 11, 12, 13], size=60)
    data[places] ^= 1 << rng.integers(8, size=60).astype(np.uint8)
    path = tmp_path / "log.bin"
    data.tofile(path)

    record = read(path, Source(name=path.name, format=FORMAT, sha256=""))

    assert "corrupt_log" in {finding.kind for finding in record.findings}
    for topic in record.topics:
        assert topic.values.shape == (len(topic.channels), topic.time_s.size)


def test_record_survives_letters_of_equal_size(tmp_path: Path) -> None:
    """One flipped bit makes the number `f` a text `n`, another makes a float a signaling NaN."""
    parts = (
        fmt(3, 31, b"PARM", b"QNn", b"TimeUS,Name,Value"),
        MAGIC + b"\x03" + struct.pack("<Q16s4s", 0, b"MASS", b"\xff\x00\x01\x02"),
        fmt(4, 23, b"SIDD", b"Qnff", b"TimeUS,Time,Targ,Gx"),
        MAGIC + b"\x04" + struct.pack("<Qfff", 1, 1, 2, 3),
        MAGIC + b"\x01" + struct.pack("<Q", MESSAGES) + b"\x01\x00\xa0\x7f",
    )
    path = tmp_path / "log.bin"
    path.write_bytes(LOG + b"".join(parts))

    record = read(path, Source(name=path.name, format=FORMAT, sha256=""))

    assert dict(record.parameters) == {}
    assert [topic.name for topic in record.topics] == ["RATE", "IMU"]
    assert np.isnan(record.topics[0].values[0, -1])
