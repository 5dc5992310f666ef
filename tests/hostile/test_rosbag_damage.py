"""Damaged bags: read up to where they are whole, with a finding, or refused in one sentence."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.ros import bag as rosbag
from rotorid.io.ros.containers import LARGEST_CHUNK_BYTES, MCAP_MAGIC, ROS1_MAGIC, SQLITE_MAGIC, decompressed

pytest.importorskip("rosbags", reason="the extra [ros] is not installed")

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

SOURCE = Source(name="flight.bag", format=rosbag.FORMAT, sha256="")
CONTAINERS = ("ros1", "sqlite", "mcap")
COUNT = 150
KIND = "std_msgs/msg/Float64"


def intact_bag(folder: Path, container: str) -> bytes:
    return bag_of(folder, container, ((10**18 + k * 5_000_000, float(k)) for k in range(COUNT)))


def bag_of(folder: Path, container: str, samples: Iterable[tuple[int, float]]) -> bytes:
    """A bag of one topic: nanoseconds and numbers."""
    store = get_typestore(Stores.ROS1_NOETIC if container == "ros1" else Stores.ROS2_HUMBLE)
    if container == "ros1":
        path = folder / "flight.bag"
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if container == "mcap" else rosbag2.StoragePlugin.SQLITE3
        path = folder / "flight" / ("flight.mcap" if container == "mcap" else "flight.db3")
        writer = rosbag2.Writer(folder / "flight", version=9, storage_plugin=plugin)
    with writer:
        link = writer.add_connection("/rig/pitch_command", KIND, typestore=store)
        for stamp, number in samples:
            message = store.types[KIND](data=number)
            data = store.serialize_ros1(message, KIND) if container == "ros1" else store.serialize_cdr(message, KIND)
            writer.write(link, stamp, bytes(data))
    return path.read_bytes()


@pytest.fixture(scope="module", params=CONTAINERS)
def intact(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return intact_bag(tmp_path_factory.mktemp("bag"), request.param)


def read_bytes(folder: Path, data: bytes) -> FlightRecord:
    (folder / "flight.bag").write_bytes(data)
    return rosbag.read(folder / "flight.bag", SOURCE, sandbox=False)


def is_damaged(record: FlightRecord) -> bool:
    return any(finding.kind == "corrupt_log" for finding in record.findings)


def test_an_intact_bag_has_no_damage(intact: bytes, tmp_path: Path) -> None:
    record = read_bytes(tmp_path, intact)
    assert not is_damaged(record)
    assert record.topics[0].values[0].tolist() == list(range(COUNT))


@pytest.mark.parametrize("count", [60, pytest.param(200, marks=pytest.mark.slow)])
def test_every_truncation_is_read_to_the_cut_and_said(intact: bytes, tmp_path: Path, count: int) -> None:
    cuts = np.linspace(1, len(intact) - 1, count).astype(int).tolist()
    held = []
    for cut in cuts:
        try:
            record = read_bytes(tmp_path, intact[:cut])
        except LogError:
            held.append(0)
            continue
        assert is_damaged(record)
        values = record.topics[0].values[0]
        assert values.tolist() == list(range(values.size))
        held.append(values.size)
    assert held == sorted(held)
    if intact.startswith(SQLITE_MAGIC):
        # A cut page is given up as a whole, and there are few of them.
        assert 0 < held[-1] <= COUNT
    else:
        # Messages in a cut chunk, or in front of a missing index, are not given up.
        assert held[-1] == COUNT
        assert len({count for count in held if 0 < count < COUNT}) > 10


@pytest.mark.parametrize("count", [80, pytest.param(500, marks=pytest.mark.slow)])
def test_flipped_bits_give_a_record_or_one_sentence(intact: bytes, tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(1)
    said = 0
    for place in rng.integers(0, len(intact), count).tolist():
        damaged = bytearray(intact)
        damaged[place] ^= 1 << int(rng.integers(8))
        try:
            record = read_bytes(tmp_path, bytes(damaged))
        except LogError:
            said += 1
        else:
            said += is_damaged(record)
            assert sum(topic.time_s.size for topic in record.topics) <= COUNT
    # None of the three keeps checksums here: only broken structure can be seen.
    assert 0 < said < count


@pytest.mark.parametrize("magic", [ROS1_MAGIC, SQLITE_MAGIC, MCAP_MAGIC])
@pytest.mark.parametrize("rest", [b"", b"\xff" * 1000, bytes(1000), np.random.default_rng(2).bytes(5000)])
def test_a_beginning_followed_by_nonsense_is_one_sentence(tmp_path: Path, magic: bytes, rest: bytes) -> None:
    with pytest.raises(LogError):
        read_bytes(tmp_path, magic + rest)


@pytest.mark.parametrize("data", [b"", b"\0" * 500, b"#ROSBAG V1.2\n", b"<html>"])
def test_foreign_files_are_refused(tmp_path: Path, data: bytes) -> None:
    assert not rosbag.sniff(data)
    with pytest.raises(LogError, match="not start like a bag"):
        read_bytes(tmp_path, data)


def test_a_database_of_something_else_is_refused(tmp_path: Path) -> None:
    base = sqlite3.connect(tmp_path / "contacts.db")
    base.execute("CREATE TABLE people (name TEXT)")
    base.commit()
    base.close()
    with pytest.raises(LogError, match="not a ROS 2 bag"):
        read_bytes(tmp_path, (tmp_path / "contacts.db").read_bytes())


def chunk(compression: bytes, announced: int, content: bytes) -> bytes:
    head = struct.pack("<QQQI", 0, 0, announced, 0) + struct.pack("<I", len(compression)) + compression
    record = head + struct.pack("<Q", len(content)) + content
    return MCAP_MAGIC + b"\x06" + struct.pack("<Q", len(record)) + record


@pytest.mark.parametrize("announced", [3 << 30, 1000, LARGEST_CHUNK_BYTES])
@pytest.mark.parametrize("compression", ["zstd", "lz4", "bz2"])
def test_a_bomb_is_not_unpacked(tmp_path: Path, compression: str, announced: int) -> None:
    import bz2

    zeros = bytes(1 << 20)
    if compression == "zstd":
        bomb = pytest.importorskip("zstandard").ZstdCompressor().compress(zeros)
    elif compression == "lz4":
        bomb = pytest.importorskip("lz4.frame").compress(zeros)
    else:
        bomb = bz2.compress(zeros)
    with pytest.raises(ValueError, match=r"a chunk"):
        decompressed(bomb, compression, announced)
    with pytest.raises(LogError, match="contains no messages"):
        read_bytes(tmp_path, chunk(compression.encode(), announced, bomb))


@pytest.mark.parametrize("compression", ["zstd", "lz4", "bz2"])
def test_good_chunks_come_back(compression: str) -> None:
    import bz2

    content = np.random.default_rng(3).integers(0, 9, 100_000).astype(np.uint8).tobytes()
    if compression == "zstd":
        packed = pytest.importorskip("zstandard").ZstdCompressor().compress(content)
    elif compression == "lz4":
        packed = pytest.importorskip("lz4.frame").compress(content)
    else:
        packed = bz2.compress(content)
    assert decompressed(packed, compression, len(content)) == content


@pytest.mark.parametrize(
    "definition",
    ["float64 data\n" * 3, "std_msgs/Float64 data\n", "import os", "float64[4294967295] data", "float64 data=1\n" * 9],
)
def test_definitions_that_make_no_sense_cost_their_topic(tmp_path: Path, definition: str) -> None:
    intact_bag(tmp_path, "sqlite")
    path = tmp_path / "flight" / "flight.db3"
    base = sqlite3.connect(path)
    base.execute("UPDATE message_definitions SET encoded_message_definition = ?", (definition,))
    base.commit()
    base.close()
    with pytest.raises(LogError, match="/rig/pitch_command"):
        read_bytes(tmp_path, path.read_bytes())


def changed(folder: Path, definition: str, kind: str, content: bytes) -> bytes:
    """A database whose messages are of another type, each with the same content."""
    intact_bag(folder, "sqlite")
    path = folder / "flight" / "flight.db3"
    base = sqlite3.connect(path)
    base.execute("UPDATE message_definitions SET encoded_message_definition = ?, topic_type = ?", (definition, kind))
    base.execute("UPDATE topics SET type = ?", (kind,))
    base.execute("UPDATE messages SET data = ?", (content,))
    base.commit()
    base.close()
    return path.read_bytes()


CDR = b"\0\1\0\0"
LISTS = f"geometry_msgs/Vector3 angular_velocity\n{'=' * 80}\nMSG: geometry_msgs/Vector3\n" + "".join(
    f"float64[2] {axis}\n" for axis in "xyz"
)


@pytest.mark.parametrize(
    ("definition", "kind", "content"),
    [
        pytest.param("float64[2] data\n", KIND, bytes(16), id="lists where a number should be"),
        pytest.param(LISTS, "sensor_msgs/msg/Imu", bytes(48), id="lists in a vector"),
        pytest.param("float64 data\n", KIND, b"", id="nothing in the messages"),
        pytest.param(f"a/B x\n{'=' * 80}\nMSG: a/B\na/B x\n", KIND, bytes(16), id="a type that contains itself"),
        pytest.param(
            "a/B0 x\n" + "".join(f"{'=' * 80}\nMSG: a/B{n}\na/B{n + 1} x\n" for n in range(900)),
            KIND,
            bytes(16),
            id="types deep inside of types",
        ),
        pytest.param(
            "a/B0 x\n" + "".join(f"{'=' * 80}\nMSG: a/B{n}\na/B{n + 1}[9] x\n" for n in range(30)),
            KIND,
            bytes(16),
            id="lists of lists of lists",
        ),
        pytest.param("float64[2000000000] data\n", KIND, bytes(16), id="a list without end"),
    ],
)
def test_definitions_that_the_rules_do_not_expect_are_one_sentence(
    tmp_path: Path, definition: str, kind: str, content: bytes
) -> None:
    with pytest.raises(LogError, match="/rig/pitch_command"):
        read_bytes(tmp_path, changed(tmp_path, definition, kind, CDR + content))


@pytest.mark.parametrize("content", [b"\x28\xb5\x2f\xfd", b"\x28\xb5\x2f\xfd" + b"\xff" * 9])
def test_messages_that_only_begin_like_compressed_ones_do_not_decode(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(LogError, match="contains /rig/pitch_command"):
        read_bytes(tmp_path, changed(tmp_path, "float64 data\n", KIND, content))


def test_a_clock_that_is_not_finite_is_not_used(tmp_path: Path) -> None:
    endless = struct.pack("<d3f", float("inf"), 1, 2, 3)
    data = changed(
        tmp_path, "float64 timestamp\nfloat32[3] xyz\n", "px4_msgs/msg/VehicleAngularVelocity", CDR + endless
    )
    assert np.isfinite(read_bytes(tmp_path, data).topics[0].time_s).all()
