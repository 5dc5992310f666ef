"""Reader of ROS 1 bags (``.bag``), ROS 2 bags (``.db3``, ``.mcap``) and other MCAP files with ROS messages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io import bag_extract
from rotorid.io import sandbox as sandboxed
from rotorid.io.bag_container import MCAP_MAGIC, ROS1_MAGIC, SQLITE_MAGIC
from rotorid.io.bag_findings import findings_of
from rotorid.io.bag_record import PLAIN_KINDS, topics_of
from rotorid.io.bag_topics import paths_by_kind
from rotorid.io.mapped import assemble, sources_of
from rotorid.io.mapping import ChannelMapping, nearest
from rotorid.io.sandbox import Extract

FORMAT = "ROS bag"

_INSTRUMENTS = ("stick", "excitation")


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a ROS 1 bag, an SQLite database or an MCAP file."""
    return head.startswith((ROS1_MAGIC, SQLITE_MAGIC, MCAP_MAGIC))


def read(path: Path, source: Source, mapping: ChannelMapping | None = None, *, sandbox: bool = True) -> FlightRecord:
    """Read a bag.

    Values are turned from ROS axes (FLU, ENU) to FRD and NED; a set-point is told from a measurement by the name of its
    topic. Stamps are those of the header; a topic without a header stands at the time of its reception, which adds the
    delay of the network, with a finding. Of a bag in several files, each is a log of its own.

    Parameters
    ----------
    path
        One file: of a ROS 2 bag the ``.db3`` or ``.mcap`` in its folder. Its ``metadata.yaml`` is not needed.
    source
        Name, format and hash of the file as the user gave it.
    mapping
        Where each channel stands, as ``/topic.field.part``, with ``row`` or ``column`` for an element of an array.
        ``/topic.header.stamp`` and ``/topic.@received`` are stamps in seconds. Values are turned as ``frame``,
        ``world`` and ``scale`` say. Without a mapping the types of the messages decide, and a number alone
        (``std_msgs/Float64``) counts when its topic ends in a name of the vocabulary.
    sandbox
        Parse in a child process with limits: code is made from the definitions in a bag.

    Raises
    ------
    LogError
        The package ``rosbags`` is not installed, the file is no bag, or nothing in it has a name.
    UsageError
        The mapping does not fit the bag.
    """
    options = {"by_kind": {}, "by_topic": _by_topic(mapping)} if mapping else _by_rules()
    if sandbox:
        extract = sandboxed.extract("rosbag", path, options, name=source.name)
    else:
        extract = bag_extract.extract(path, options)
    if mapping is not None:
        _check(mapping, extract, source.name)
        return assemble(extract.arrays, mapping, source, findings_of((), extract))
    topics = tuple(topics_of(extract))
    if not topics:
        raise LogError(
            f"{source.name} holds {_listed(extract.facts['topics'])}",
            needed="a topic of sensor_msgs/Imu, nav_msgs/Odometry, px4_msgs or the like, with its definition",
            remedy="name the channels of other topics with a mapping: --map FILE.toml",
        )
    held = {channel.name for topic in topics for channel in topic.channels}
    axes = ("roll", "pitch", "yaw", "thrust")
    present = {axis: tuple(f"{axis}_{kind}" for kind in _INSTRUMENTS if f"{axis}_{kind}" in held) for axis in axes}
    return FlightRecord(
        source=source,
        topics=topics,
        instruments={axis: names for axis, names in present.items() if names},
        findings=tuple(findings_of(topics, extract)),
    )


def _by_rules() -> dict[str, Any]:
    return {"by_kind": paths_by_kind() | {kind: ["data"] for kind in PLAIN_KINDS}, "by_topic": {}}


def _by_topic(mapping: ChannelMapping) -> dict[str, list[str]]:
    wanted: dict[str, list[str]] = {}
    for name in sources_of(mapping):
        topic, _, path = name.partition(".")
        wanted.setdefault(topic, []).append(path)
    return wanted


def _check(mapping: ChannelMapping, extract: Extract, file: str) -> None:
    """Say which topic or field of a mapping does not exist, and which do."""
    topics: Mapping[str, Mapping[str, Any]] = extract.facts["topics"]
    for name in sources_of(mapping):
        if name in extract.arrays:
            continue
        topic, _, path = name.partition(".")
        if topic not in topics:
            close = nearest(topic, topics)
            raise UsageError(
                f"{file} has no topic {topic!r}",
                needed=f"a source `/topic.field`, the topic one of {_listed(topics)}",
                remedy=f"did you mean {close}?" if close else "correct `source` or `time` in the mapping",
            )
        about = topics[topic]
        if about["unreadable"] or not about["fields"]:
            why = about["unreadable"] or f"none of its {about['count']} messages can be decoded"
            raise LogError(f"{file}: the topic {topic} cannot be read: {why}", needed="a definition of its messages")
        raise UsageError(
            f"{file}: the topic {topic} ({about['kind']}) has no numbers at {path!r} that every message holds",
            needed=f"a path that starts with one of {', '.join(about['fields'])}",
            remedy="correct `source` or `time` in the mapping",
        )


def _listed(topics: Mapping[str, Mapping[str, Any]]) -> str:
    return ", ".join(f"{topic} ({about['kind']})" for topic, about in list(topics.items())[:30]) or "no messages"
