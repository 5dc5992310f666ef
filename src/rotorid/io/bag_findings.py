"""What a careful engineer remarks on a bag: damage, missing headers, clocks that disagree, topics without a meaning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import Topic
from rotorid.io.bag_extract import RECEIVED
from rotorid.io.sandbox import Extract
from rotorid.typing import AnyArray

_LARGEST_SKEW_S = 1.0
_NAMED = 20


def findings_of(topics: Sequence[Topic], extract: Extract) -> Iterator[Finding]:
    """Remarks on a bag.

    Parameters
    ----------
    topics
        What was read by the rules; empty when a mapping named the channels, and with them the stamps.
    extract
        What the parser found.
    """
    facts = extract.facts
    yield from _damage(facts)
    yield from _unreadable(facts["topics"])
    if topics:
        yield from _clocks(topics, extract.arrays)
        yield from _without_meaning(topics, facts["topics"])


def _damage(facts: Mapping[str, Any]) -> Iterator[Finding]:
    damage, size_bytes = facts["damage"], facts["size_bytes"]
    failed = sum(about["failed"] for about in facts["topics"].values())
    if not damage and not failed:
        return
    where = f"; first at byte {damage[0][0]} of {size_bytes}: {damage[0][1]}" if damage else ""
    yield Finding(
        kind="corrupt_log",
        severity="warning",
        where="bag",
        message=f"The bag is damaged in {len(damage)} places and {failed} of its messages do not decode{where}. What "
        "is whole was read; copy the bag again, or repair it with `rosbag reindex` or `ros2 bag reindex`.",
        numbers={
            "places": len(damage),
            "first_byte": damage[0][0] if damage else 0,
            "size_bytes": size_bytes,
            "failed_messages": failed,
        },
    )


def _unreadable(topics: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    for topic, about in topics.items():
        if about["unreadable"]:
            yield Finding(
                kind="missing_channel",
                severity="warning",
                where=topic,
                message=f"The topic {topic} ({about['kind']}) was left out, since its messages cannot be decoded: "
                f"{about['unreadable']}. Bags of ROS 2 hold the definitions since the release Iron.",
            )


def _clocks(topics: Sequence[Topic], arrays: Mapping[str, AnyArray]) -> Iterator[Finding]:
    received = {topic.name: arrays[f"{topic.name}.{RECEIVED}"] for topic in topics}
    unstamped = [
        topic.name for topic in topics if topic.time_s.size and np.isin(topic.time_s, received[topic.name]).all()
    ]
    if unstamped:
        names = ", ".join(dict.fromkeys(unstamped))
        yield Finding(
            kind="receive_time",
            severity="info",
            where=unstamped[0],
            message=f"{names} carry no stamp of their own and stand at the time of their reception, which adds the "
            "delay and the jitter of the network to every delay that is identified. Publish stamped messages.",
            numbers={"topics": len(set(unstamped))},
        )
    offsets = {
        topic.name: float(np.median(received[topic.name]) - np.median(topic.time_s))
        for topic in topics
        if topic.time_s.size
    }
    early, late = min(offsets, key=offsets.__getitem__), max(offsets, key=offsets.__getitem__)
    skew_s = offsets[late] - offsets[early]
    if skew_s > _LARGEST_SKEW_S:
        yield Finding(
            kind="clock_skew",
            severity="warning",
            where=late,
            message=f"{late} and {early} are stamped by clocks that differ by {skew_s:.3f} s, so that they do not fit "
            "together. Let all nodes use one clock (use_sim_time, time synchronization of the autopilot), or name "
            "stamps of one clock with a mapping: --map FILE.toml.",
            numbers={"skew_s": skew_s},
        )


def _without_meaning(topics: Sequence[Topic], held: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    used = {topic.name for topic in topics}
    others = [
        f"{topic} ({about['kind']})" for topic, about in held.items() if topic not in used and not about["unreadable"]
    ]
    if others:
        more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
        yield Finding(
            kind="unknown_topic",
            severity="info",
            where="bag",
            message=f"{', '.join(others[:_NAMED])}{more} say nothing that the vocabulary has a name for and were left "
            "out. A mapping can name them: --map FILE.toml.",
            numbers={"topics": len(others)},
        )
