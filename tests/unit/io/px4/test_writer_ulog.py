"""The ULog writer: what it writes is read back by our walk and by PX4's own reader, or nothing is written."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import pyulog

from rotorid.errors import UsageError
from rotorid.io.px4.ulog import HEADER_BYTES, TYPES, extract, walk
from rotorid.io.px4.writer import LoggedTopic, message_dtype, write_ulog
from rotorid.typing import AnyArray

BATTERY = "uint64_t timestamp;float voltage_v"
SYNC = bytes.fromhex("2f731320250cbb12")


def topic(name: str, stamps: AnyArray | list[int], layout: str = BATTERY, instance: int = 0) -> LoggedTopic:
    """Samples whose other fields count up."""
    samples = np.zeros(len(stamps), dtype=message_dtype(layout))
    samples["timestamp"] = stamps
    for field in message_dtype(layout).names or ():
        if field != "timestamp" and samples[field].ndim == 1:
            samples[field] = np.arange(len(stamps)).astype(samples[field].dtype)
    return LoggedTopic(name=name, layout=layout, samples=samples, instance=instance)


def write(path: Path, *topics: LoggedTopic, parameters: Mapping[str, float | int] | None = None) -> bytes:
    write_ulog(path, topics, parameters=parameters or {}, information={"sys_name": "PX4", "ver_sw_release": 1 << 31})
    return path.read_bytes()


def messages(data: bytes) -> list[tuple[str, bytes]]:
    """Letter and payload of every message."""
    found, position = [], HEADER_BYTES
    while position < len(data):
        size, letter = struct.unpack_from("<HB", data, position)
        found.append((chr(letter), data[position + 3 : position + 3 + size]))
        position += 3 + size
    assert position == len(data)
    return found


def test_every_type_of_the_format_comes_back_from_both_readers(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    kinds = [kind for kind in TYPES if kind != "char"]
    layout = ";".join(
        ["uint64_t timestamp", *(f"{kind} a_{kind};{kind}[3] b_{kind}" for kind in kinds), "char[4] text"]
    )
    rows = np.frombuffer(rng.bytes(50 * message_dtype(layout).itemsize), dtype=message_dtype(layout)).copy()
    rows["timestamp"] = np.sort(rng.integers(0, 1 << 40, 50))
    rows["text"] = b"ab"
    write(tmp_path / "flight.ulg", LoggedTopic(name="all", layout=layout, samples=rows))
    (theirs,) = pyulog.ULog(str(tmp_path / "flight.ulg")).data_list
    names = [f"a_{kind}" for kind in kinds] + [f"b_{kind}[{place}]" for kind in kinds for place in range(3)]
    ours = extract(tmp_path / "flight.ulg", {"all": names})
    assert not ours.damage
    np.testing.assert_array_equal(theirs.data["text[1]"], ord("b"))
    np.testing.assert_array_equal(theirs.data["text[2]"], 0)
    for name in names:
        stem, _, place = name.rstrip("]").partition("[")
        expected = rows[stem][:, int(place)] if place else rows[stem]
        np.testing.assert_array_equal(ours.arrays[f"all/{name}"], expected, err_msg=name)
        np.testing.assert_array_equal(theirs.data[name], expected, err_msg=name)


def test_messages_of_all_topics_stand_in_order_of_time(tmp_path: Path) -> None:
    slow, fast = topic("slow", np.arange(0, 3_000_001, 10_000)), topic("fast", np.arange(2_000, 3_000_001, 4_000))
    data = write(tmp_path / "flight.ulg", slow, fast)
    order = [(struct.unpack_from("<HQ", payload)) for letter, payload in messages(data) if letter == "D"]
    expected = [(0, int(stamp)) for stamp in slow.samples["timestamp"]]
    expected += [(1, int(stamp)) for stamp in fast.samples["timestamp"]]
    # At one instant the order is that of the topics.
    assert order == sorted(expected, key=lambda item: (item[1], item[0]))
    assert not walk(data).damage
    assert [payload for letter, payload in messages(data) if letter == "S"] == [SYNC] * 6


def test_the_file_starts_as_the_format_says(tmp_path: Path) -> None:
    data = write(tmp_path / "flight.ulg", topic("b", [9_000]), topic("a", [7_000]), parameters={"CA_ROTOR_COUNT": 4})
    assert data[:16] == b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 7_000)
    found = messages(data)
    assert found[0] == ("B", bytes(40))
    assert "".join(letter for letter, _ in found) == "BIIFFPAADSD"
    assert found[5][1] == b"\x16int32_t CA_ROTOR_COUNT\x04\0\0\0"


def test_statements_keep_their_types(tmp_path: Path) -> None:
    parameters = {"CA_ROTOR_COUNT": 4, "CA_R_REV": -(1 << 31), "MC_ROLLRATE_P": 0.15, "MC_YAW_P": 2.0}
    write(tmp_path / "flight.ulg", topic("battery_status", [0]), parameters=parameters)
    log = pyulog.ULog(str(tmp_path / "flight.ulg"))
    rounded = {
        name: value if isinstance(value, int) else float(np.float32(value)) for name, value in parameters.items()
    }
    assert log.initial_parameters == rounded
    assert {name: type(value) for name, value in log.initial_parameters.items()} == {
        name: type(value) for name, value in parameters.items()
    }
    assert log.msg_info_dict == {"sys_name": "PX4", "ver_sw_release": 1 << 31}
    assert extract(tmp_path / "flight.ulg", {}).parameters == rounded


def test_instances_of_a_topic_stay_apart(tmp_path: Path) -> None:
    write(tmp_path / "flight.ulg", topic("battery_status", [1, 2]), topic("battery_status", [3, 4, 5], instance=1))
    found = {
        data.multi_id: data.data["timestamp"].tolist() for data in pyulog.ULog(str(tmp_path / "flight.ulg")).data_list
    }
    assert found == {0: [1, 2], 1: [3, 4, 5]}


def test_a_topic_without_messages_is_announced_and_empty(tmp_path: Path) -> None:
    data = write(tmp_path / "flight.ulg", topic("never", []), topic("battery_status", [5]))
    assert sum(letter == "A" for letter, _ in messages(data)) == 2
    assert not walk(data).damage
    assert [letter for letter, _ in messages(write(tmp_path / "none.ulg", topic("never", [])))][-1] == "A"


def test_equal_input_makes_equal_bytes(tmp_path: Path) -> None:
    topics = topic("a", np.arange(0, 10**6, 1000)), topic("b", np.arange(0, 10**6, 1000))
    assert write(tmp_path / "one.ulg", *topics) == write(tmp_path / "two.ulg", *topics)


@pytest.mark.parametrize(
    ("topics", "parameters", "sentence"),
    [
        ([], {}, "0 topics"),
        ([topic("a", [1]), topic("a", [2])], {}, "2 topics have 1 names"),
        ([topic("a", [1]), topic("a", [2], "uint64_t timestamp;float v", 1)], {}, "a has two layouts"),
        ([topic("a", [2, 1])], {}, "the stamps of a fall"),
        ([topic("a", [1], "uint64_t timestamp;uint8_t[65530] much")], {}, "a message of a is too long"),
        ([topic("a", [1])], {"MC_ROLL_P": float("nan")}, "MC_ROLL_P = nan"),
        ([topic("a", [1])], {"MC_ROLL_P": 1e39}, r"MC_ROLL_P = 1e\+39"),
        ([topic("a", [1])], {"CA_ROTOR_COUNT": 1 << 31}, "CA_ROTOR_COUNT = 2147483648"),
        ([topic("a", [1])], {"MC ROLL P": 1.0}, "the name 'MC ROLL P'"),
        ([topic("a", [1])], {"P" * 250: 1.0}, "the name 'PPP"),
    ],
)
def test_what_no_log_can_hold_is_refused_and_the_old_file_kept(
    tmp_path: Path, topics: list[LoggedTopic], parameters: dict[str, float], sentence: str
) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(b"before")
    with pytest.raises(UsageError, match=sentence):
        write(path, *topics, parameters=parameters)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "layout", ["float voltage_v", "uint64_t[2] timestamp", "uint64_t timestamp;report[2] esc", "", "uint32_t timestamp"]
)
def test_a_layout_without_stamp_or_of_unknown_types_is_refused(layout: str) -> None:
    with pytest.raises(ValueError, match="starts with its stamp"):
        message_dtype(layout)


def test_samples_of_another_type_than_the_layout_are_refused() -> None:
    with pytest.raises(ValueError, match="not the type of its layout"):
        LoggedTopic(name="a", layout=BATTERY, samples=np.zeros(3))
