"""The ULog container: fields are found where they stand, in blocks of any size; what no logger writes is refused."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from rotorid.errors import LogError
from rotorid.io.px4 import ulog as ulog_walk
from rotorid.io.px4.ulog import MAGIC, Definitions, Walk, extract, walk

HEAD = MAGIC + b"\1" + bytes(8)
STAMPED = b"battery_status:uint64_t timestamp;float voltage_v;uint8_t[4] _padding0;"


def message(letter: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(letter)) + payload


def subscription(number: int, topic: str, instance: int = 0) -> bytes:
    return message("A", struct.pack("<BH", instance, number) + topic.encode())


def sample(number: int, index: int, padding: bytes = b"") -> bytes:
    return message("D", struct.pack("<HQf", number, 1000 * index, float(index)) + padding)


def written(folder: Path, *parts: bytes) -> Path:
    path = folder / "flight.ulg"
    path.write_bytes(b"".join([HEAD, *parts]))
    return path


def definitions(*formats: str) -> Definitions:
    found = Definitions()
    for text in formats:
        found.learn(text.encode())
    return found


@pytest.mark.parametrize(
    ("name", "offset", "code"),
    [
        ("timestamp", 0, "<u8"),
        ("xyz[0]", 8, "<f4"),
        ("xyz[2]", 16, "<f4"),
        ("esc[1].rpm", 20 + 6 + 2, "<i4"),
        ("esc[0].state", 20, "<u2"),
        ("last", 20 + 12, "i1"),
    ],
)
def test_a_field_stands_behind_all_that_is_in_front_of_it(name: str, offset: int, code: str) -> None:
    found = definitions(
        "topic:uint64_t timestamp;float[3] xyz;esc_report[2] esc;bool last;", "esc_report:uint16_t state;int32_t rpm;"
    )
    assert found.locate("topic", name) == (offset, np.dtype(code))


@pytest.mark.parametrize("name", ["xyz", "xyz[3]", "esc[0]", "esc[2].rpm", "timestamp[0]", "absent", "xyz[0].x", ""])
def test_a_field_that_does_not_exist_has_no_place(name: str) -> None:
    found = definitions("topic:uint64_t timestamp;float[3] xyz;report[2] esc;", "report:int32_t rpm;")
    assert found.locate("topic", name) is None


def test_only_the_first_instance_is_read_with_and_without_its_padding(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        message("F", STAMPED),
        subscription(3, "battery_status", instance=1),
        subscription(7, "battery_status"),
        sample(3, 50),
        sample(7, 1),
        sample(7, 2, bytes(4)),
        sample(3, 51),
        sample(7, 3),
    )
    log = extract(path, {"battery_status": ["voltage_v", "absent"]})
    assert sorted(log.arrays) == ["battery_status/timestamp", "battery_status/voltage_v"]
    assert log.arrays["battery_status/voltage_v"].tolist() == [1.0, 2.0, 3.0]
    assert not log.damage


def test_a_topic_that_begins_in_the_middle_is_followed_from_there(tmp_path: Path) -> None:
    """Before its subscription the same bytes are damage, after it they are data."""
    path = written(
        tmp_path,
        message("F", STAMPED),
        subscription(1, "battery_status"),
        *(sample(1, index) for index in range(5)),
        sample(2, 99),
        *(sample(1, index) for index in range(5, 9)),
        message("F", b"other:uint64_t timestamp;float voltage_v;"),
        subscription(2, "other"),
        *(sample(2, index) for index in range(4)),
    )
    log = extract(path, {"battery_status": ["voltage_v"], "other": ["voltage_v"]})
    assert log.arrays["battery_status/voltage_v"].tolist() == list(range(9))
    assert log.arrays["other/voltage_v"].tolist() == list(range(4))
    assert [stop - start for start, stop, _ in log.damage] == [len(sample(2, 99))]


def test_a_format_that_shrinks_after_its_topic_began_is_not_read_beyond_the_messages(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        message("F", STAMPED),
        subscription(1, "battery_status"),
        sample(1, 1),
        message("F", b"battery_status:uint64_t timestamp;float[60] gap;float voltage_v;"),
    )
    assert list(extract(path, {"battery_status": ["voltage_v"]}).arrays) == ["battery_status/timestamp"]


def outline(found: Walk) -> object:
    streams = [(stream.subscription, stream.positions.tolist()) for stream in found.streams]
    return found.intact, found.damage, streams, found.statements


@pytest.mark.parametrize("seed", range(12))
def test_the_size_of_the_blocks_does_not_matter(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    parts = [message("F", STAMPED), subscription(1, "battery_status"), subscription(2, "battery_status", 1)]
    for index in range(400):
        parts.append(sample(int(rng.integers(1, 3)), index, bytes(4) if rng.random() < 0.3 else b""))
        if rng.random() < 0.1:
            parts.append(message("O", b"\5\0"))
        if rng.random() < 0.05:
            parts.append(rng.bytes(int(rng.integers(1, 60))))
    data = b"".join([HEAD, *parts])[: -int(rng.integers(1, 20))]
    whole = outline(walk(data, ["battery_status"]))
    for block in (1, 7, 64, 1000):
        monkeypatch.setattr(ulog_walk, "_FIRST_BLOCK", block)
        monkeypatch.setattr(ulog_walk, "_LARGEST_BLOCK", block)
        assert outline(walk(data, ["battery_status"])) == whole


MANY = [f"topic_{index:02d}" for index in range(40)]


def many_topics() -> tuple[bytes, list[int]]:
    """A log with forty topics among parameters, and where its definitions start."""
    parts = [
        *(message("F", f"{name}:uint64_t timestamp;float value;".encode()) for name in MANY),
        *(message("P", bytes([12]) + f"float P_{index:02d}".encode().ljust(12) + bytes(4)) for index in range(40)),
        *(subscription(index, name) for index, name in enumerate(MANY)),
    ]
    starts = np.cumsum([len(HEAD), *map(len, parts)]).tolist()
    data = [sample(number, index) for index in range(30) for number in range(len(MANY))]
    return b"".join([HEAD, *parts, *data]), starts


def test_a_record_of_an_unknown_type_among_the_definitions_is_stepped_over() -> None:
    data, starts = many_topics()
    record = message("Z", bytes(range(20)))
    for start in starts:
        found = walk(data[:start] + record + data[start:], MANY)
        assert {stream.subscription.topic: stream.positions.size for stream in found.streams} == dict.fromkeys(MANY, 30)


def test_a_flipped_bit_among_the_definitions_costs_one_topic_at_most() -> None:
    data, starts = many_topics()
    rng = np.random.default_rng(3)
    for place in rng.integers(len(HEAD), starts[-1], 200).tolist():
        broken = bytearray(data)
        broken[place] ^= 1 << int(rng.integers(8))
        streams = walk(bytes(broken), MANY).streams
        whole = [stream for stream in streams if stream.positions.size == 30]
        assert len(whole) >= len(MANY) - 1


@pytest.mark.parametrize(
    ("parts", "sentence"),
    [
        pytest.param([subscription(number % 60000, "t") for number in range(70_000)], "more than 65536 topics"),
        pytest.param([message("F", b"t:" + b"float x;" * 8000)] * 70, "longer than 4 MiB"),
        pytest.param(
            [message("F", b"t:" + b"uuu x;" * 10_000), message("F", b"uuu:"), subscription(0, "t") * 120],
            "longer than those of any logger",
        ),
        pytest.param([message("O", b"\0\0") * ((1 << 20) + 1)], "parameters and dropouts"),
        pytest.param(
            [message("F", b"t:uint8_t x;"), subscription(0, "t")]
            + [b"\0\0\0" + message("D", b"\0\0\0") * 3] * ((1 << 16) + 2),
            "broken in more than 65536 places",
        ),
    ],
    ids=["topics", "formats", "measuring", "statements", "damage"],
)
def test_what_no_logger_writes_is_refused(tmp_path: Path, parts: list[bytes], sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        extract(written(tmp_path, *parts), {"t": ["x"]})


@pytest.mark.parametrize("flag", [0, 1, 7])
def test_a_file_of_an_unknown_kind_is_refused(tmp_path: Path, flag: int) -> None:
    flags = bytearray(40)
    flags[8 + flag] = 2
    with pytest.raises(LogError, match="of a kind that is not understood"):
        extract(written(tmp_path, message("B", bytes(flags))), {})


def test_memory_follows_what_is_asked_for_and_not_the_log(tmp_path: Path) -> None:
    count = 300_000
    payload = bytes(200)
    path = written(
        tmp_path,
        message("F", STAMPED),
        message("F", b"big:uint64_t timestamp;uint8_t[192] x;"),
        subscription(1, "battery_status"),
        subscription(2, "big"),
        b"".join(sample(1, index) + message("D", b"\2\0" + payload) for index in range(100)) * (count // 100),
    )
    extract(path, {"battery_status": ["voltage_v"]})  # imports and caches
    tracemalloc.start()
    log = extract(path, {"battery_status": ["voltage_v"]})
    values = log.arrays["battery_status/voltage_v"]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert values.size == count
    # Positions twice in 4 bytes, values in 4, and some 40 000 places of a block of 4 MiB in a dozen arrays and lists of
    # 8 bytes or of Python's integers. The log itself has 66 MB.
    assert peak < 12 * count + 40_000 * (12 * 8 + 3 * 40)


def test_parameters_are_the_last_ones_and_those_of_loops_that_changed_are_known(tmp_path: Path) -> None:
    def parameter(name: str, value: float) -> bytes:
        key = f"float {name}".encode()
        return message("P", bytes([len(key)]) + key + struct.pack("<f", value))

    stated = [("MC_ROLLRATE_P", 0.15), ("LND_FLIGHT_T_LO", 1.0), ("MC_ROLLRATE_P", 0.25), ("LND_FLIGHT_T_LO", 2.0)]
    found = extract(
        written(
            tmp_path,
            message("F", STAMPED),
            *(parameter(*one) for one in stated[:2]),
            subscription(0, "battery_status"),
            sample(0, 0),
            *(parameter(*one) for one in stated[2:]),
            sample(0, 1),
        ),
        {"battery_status": ("voltage_v",)},
    )
    assert found.parameters == pytest.approx({"MC_ROLLRATE_P": 0.25, "LND_FLIGHT_T_LO": 2.0})
    assert found.changed == {"MC_ROLLRATE_P": (pytest.approx(0.15), 0.25)}
