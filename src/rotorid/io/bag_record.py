"""From the arrays of a bag to topics in the vocabulary of the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rotorid.data.channel import STANDARD_UNITS, Channel
from rotorid.data.record import Topic
from rotorid.io.bag_extract import RECEIVED, STAMP
from rotorid.io.bag_topics import RULES, Rule, ignored_bits, rules_for, turned
from rotorid.io.sandbox import Extract
from rotorid.typing import AnyArray, BoolArray, FloatArray

PLAIN_KINDS = ("std_msgs/msg/Float64", "std_msgs/msg/Float32")
"""A number without meaning, unless the topic ends in a name of the vocabulary."""

_MICROSECOND = 1e-6


def topics_of(extract: Extract) -> Iterator[Topic]:
    """Topics that the rules have a name for, best first.

    Of two topics of one type the one without ``raw`` in its name comes first; then the names decide.

    Parameters
    ----------
    extract
        What the parser found.
    """
    held: set[str] = set()
    for rule, topic in _matches(extract.facts["topics"]):
        arrays = _of_topic(topic, extract.arrays)
        if rule.last_resort and held & set(rule.channels):
            continue
        found = _topic(rule, topic, arrays, extract.facts["topics"][topic]["frames"])
        if found is not None and not _second_name(found, topic, held):
            held |= {f"{topic}/{channel.name}" for channel in found.channels} | {item.name for item in found.channels}
            yield found
    for topic, about in extract.facts["topics"].items():
        name = topic.rpartition("/")[2]
        arrays = _of_topic(topic, extract.arrays)
        if about["kind"] in PLAIN_KINDS and name in STANDARD_UNITS and "data" in arrays:
            yield _plain(topic, name, arrays)


def stamps_of(topic: str, arrays: Mapping[str, AnyArray], clocks: tuple[str, ...] = ()) -> tuple[FloatArray, str]:
    """Stamps of a topic in seconds, and the path that they come from.

    A stamp counts when it moves: a header that nobody filled in stays at zero.
    """
    held = _of_topic(topic, arrays)
    for path, factor in (*((clock, _MICROSECOND) for clock in clocks), (STAMP, 1.0)):
        if path in held and _moves(held[path]):
            return np.asarray(held[path] * factor, dtype=np.float64), path
    return np.asarray(held[RECEIVED], dtype=np.float64), RECEIVED


def _moves(stamps: AnyArray) -> bool:
    return bool(np.isfinite(stamps).all() and stamps.min() > 0.0 and (stamps.size == 1 or np.ptp(stamps) > 0.0))


def _of_topic(topic: str, arrays: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Numbers of a topic by path; a bag may define a field that the rules know as a list, which is then none."""
    return {
        name[len(topic) + 1 :]: array
        for name, array in arrays.items()
        if name.startswith(f"{topic}.") and array.ndim == 1
    }


def _matches(topics: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[Rule, str]]:
    """Rules and the topics that they fit, in order of preference."""
    by_name = sorted(topics, key=lambda name: ("raw" in name, name))
    found = [(rule, topic) for topic in by_name for rule in rules_for(topics[topic]["kind"], topic)]
    order = {(rule.kind, rule.fields, rule.topic): place for place, rule in enumerate(RULES)}
    yield from sorted(found, key=lambda match: order[match[0].kind, match[0].fields, match[0].topic])


def _second_name(found: Topic, topic: str, held: set[str]) -> bool:
    """Whether the same topic gave these channels already, under the names of another firmware."""
    return any(f"{topic}/{channel.name}" in held for channel in found.channels)


def _topic(rule: Rule, topic: str, arrays: Mapping[str, AnyArray], frames: tuple[str, str]) -> Topic | None:
    fields = tuple(name for name in rule.fields if name in arrays)
    if rule.optional:
        fields = tuple(name for name in fields if np.isfinite(arrays[name]).any())
    if not fields or (not rule.optional and fields != rule.fields):
        return None
    raw = np.stack([arrays[name] for name in fields])
    kept = np.isfinite(raw).all(axis=0) & _meant(rule, arrays, raw)
    values = turned(raw[:, kept], rule, (frames[0], frames[1])) if kept.any() else None
    if values is None:
        return None
    names = [rule.channels[rule.fields.index(name)] for name in fields] if rule.optional else list(rule.channels)
    sources = [f"{topic}.{name}" for name in fields]
    if len(names) < len(fields):
        sources = [f"{topic}.{fields[0].removesuffix('.x').removesuffix('[0]')}"] * len(names)
    stamps, _ = stamps_of(topic, {f"{topic}.{name}": array for name, array in arrays.items()}, rule.clocks)
    return Topic(
        name=topic,
        time_s=stamps[kept],
        channels=tuple(
            Channel(name=name, unit=STANDARD_UNITS[name], source=source)
            for name, source in zip(names, sources, strict=True)
        ),
        values=values,
    )


def _meant(rule: Rule, arrays: Mapping[str, AnyArray], raw: FloatArray) -> BoolArray:
    """Messages that mean what the rule reads: not declared absent, of the right group, not masked, not empty."""
    meant: BoolArray = np.ones(raw.shape[1], dtype=np.bool_)
    if rule.absent in arrays:
        meant &= arrays[rule.absent] != -1.0
    if rule.only is not None and rule.only[0] in arrays:
        meant &= arrays[rule.only[0]] == rule.only[1]
    if "type_mask" in arrays:
        meant &= (arrays["type_mask"].astype(np.int64) & ignored_bits(rule)) == 0
    if rule.axes == "attitude":
        meant &= np.any(raw != 0.0, axis=0)
    return meant


def _plain(topic: str, name: str, arrays: Mapping[str, AnyArray]) -> Topic:
    kept = np.isfinite(arrays["data"])
    channel = Channel(name=name, unit=STANDARD_UNITS[name], source=f"{topic}.data")
    return Topic(name=topic, time_s=arrays[RECEIVED][kept], channels=(channel,), values=arrays["data"][None, kept])
