"""Structured faults of good logs: single bad values and stamps, as flipped bits and lost bytes leave them.

A fault is put into the record of a sound flight as a reader would hand it on, before the screen that all records pass;
what comes out is held against the sound flight sample by sample. :func:`spoil` also serves campaigns that go on to
models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from rotorid.data import FlightRecord, Topic
from rotorid.data.ranges import MEASURED, TURNING, range_of
from rotorid.typing import FloatArray

ValueFault = Literal["nan", "huge", "negative huge", "zero", "flipped", "hundredfold", "stuck", "beyond"]
StampFault = Literal["stamp zero", "stamp back", "stamp ahead"]
VALUE_FAULTS: tuple[ValueFault, ...] = get_args(ValueFault)
STAMP_FAULTS: tuple[StampFault, ...] = get_args(StampFault)

SAYING = frozenset({"impossible_value", "clock_disorder", "gap"})
_SLOWEST_HZ = 15.0
"""Slower than this one sample may be a motion, and only impossible values are told apart."""
_HIDDEN_STEPS, _HIDDEN_ROUGHNESS, _HIDDEN_LEVELS = 12.0, 10.0, 2.5
"""What a wrong sample may differ by and stay: a little more than the limits of the screen."""
_SURROUNDINGS = 20


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One bad sample: which topic of the record, which row of it (none for a stamp), which sample, and what it is."""

    topic: int
    row: int | None
    sample: int
    kind: ValueFault | StampFault


def spoil(record: FlightRecord, seed: int) -> tuple[FlightRecord, tuple[Fault, ...]]:
    """The record with one to five faults, and where they are; one seed, one record."""
    rng = np.random.default_rng(seed)
    faults: dict[tuple[int, int], Fault] = {}
    long = [number for number, topic in enumerate(record.topics) if topic.time_s.size > 100]
    for _ in range(int(rng.integers(1, 6))):
        number = int(rng.choice(long))
        topic = record.topics[number]
        sample = int(rng.integers(1, topic.time_s.size - 1))
        stamp = rng.random() < 0.3
        fault = Fault(
            topic=number,
            row=None if stamp else int(rng.integers(len(topic.channels))),
            sample=sample,
            kind=STAMP_FAULTS[rng.integers(3)] if stamp else VALUE_FAULTS[rng.integers(len(VALUE_FAULTS))],
        )
        # Two faults side by side are no single ones.
        if all(abs(sample - other) > 2 * _SURROUNDINGS for known, other in faults if known == number):
            faults[number, sample] = fault
    topics = [
        _spoiled(topic, [fault for fault in faults.values() if fault.topic == number])
        for number, topic in enumerate(record.topics)
    ]
    return replace(record, topics=tuple(topics)), tuple(faults.values())


def _spoiled(topic: Topic, faults: Sequence[Fault]) -> Topic:
    if not faults:
        return topic
    time_s, values = topic.time_s.copy(), topic.values.copy()
    for fault in faults:
        if fault.row is None:
            stamps = {"stamp zero": 0.0, "stamp back": time_s[fault.sample] - 6.0007, "stamp ahead": 1e6}
            time_s[fault.sample] = stamps[fault.kind]
        else:
            values[fault.row, fault.sample] = _wrong(values[fault.row], fault.sample)[fault.kind]
    return replace(topic, time_s=time_s, values=values)


def _wrong(values: FloatArray, sample: int) -> Mapping[str, float]:
    sound = float(values[sample])
    return {
        "nan": np.nan,
        "huge": 1e30,
        "negative huge": -1e30,
        "zero": 0.0,
        "flipped": -sound,
        "hundredfold": 100.0 * sound,
        "stuck": float(values[sample - 1]),
        "beyond": (2.5 + 6.5 * (sample % 97) / 97.0) * float(np.nanmax(np.abs(values))),
    }


def misread(sound: FlightRecord, spoiled: FlightRecord, read: FlightRecord, faults: Sequence[Fault]) -> list[str]:
    """What is wrong with a record that was read with faults; empty when it is the sound one without the bad samples.

    Parameters
    ----------
    sound, spoiled
        The flight before and after the faults were put in.
    read
        What came out of the screen.
    faults
        Where they are.
    """
    wrong = []
    lost = False
    for number, topic in enumerate(sound.topics):
        own = [fault for fault in faults if fault.topic == number]
        for row, channel in enumerate(topic.channels):
            found = [part for part in read.topics if part.name == topic.name and channel in part.channels]
            if not found:
                wrong.append(f"{channel.name} of {topic.name} is gone")
                continue
            part = found[0]
            values = part.values[part.channels.index(channel)]
            kept = np.isin(np.arange(topic.time_s.size), [fault.sample for fault in own], invert=True)
            # Of the samples at hand those of the faults may be gone or there; all others must be there unchanged.
            places = np.minimum(np.searchsorted(part.time_s, topic.time_s), part.time_s.size - 1)
            held = part.time_s[places] == topic.time_s
            differing = int(np.sum(kept & ~(held & (values[places] == topic.values[row]))))
            if differing:
                wrong.append(f"{differing} sound samples of {channel.name} in {topic.name} are gone or changed")
            lost |= values.size < topic.time_s.size
            stayed = [fault for fault in own if fault.row == row and held[fault.sample]]
            wrong += [
                f"{fault} stays as {spoiled.topics[number].values[row, fault.sample]:.4g}"
                for fault in stayed
                if not _hidden(topic, row, fault.sample, float(spoiled.topics[number].values[row, fault.sample]))
            ]
        for fault in own:
            stamp = float(spoiled.topics[number].time_s[fault.sample])
            # In a slow topic a stamp may be wrong and still follow the one before it.
            rises = topic.time_s[fault.sample - 1] <= stamp <= topic.time_s[fault.sample + 1]
            held_still = any(stamp in part.time_s for part in read.topics if part.name == topic.name)
            if fault.row is None and held_still and not rises:
                wrong.append(f"{fault} stays at {stamp:.6g} s")
    if lost and not any(finding.kind in SAYING for finding in read.findings):
        wrong.append("samples are gone, and nothing says so")
    return wrong


def _hidden(topic: Topic, row: int, sample: int, value: float) -> bool:
    """Whether nothing tells a wrong value from the motion around it."""
    channel, values = topic.channels[row], topic.values[row]
    low, high = range_of(channel) or (-np.inf, np.inf)
    if not low <= value <= high:
        return False
    if topic.sample_rate_hz < _SLOWEST_HZ:
        return True
    others = np.delete(values, sample)
    level = float(np.abs(others - np.median(others)).max())
    if abs(value - float(np.median(others))) <= _HIDDEN_LEVELS * level and channel.name not in MEASURED:
        return True
    steps = np.abs(_turned(channel.name, np.diff(others)))
    around = others[max(sample - _SURROUNDINGS, 0) : sample + _SURROUNDINGS]
    rough = float(np.abs(np.diff(_turned(channel.name, np.diff(around)))).max())
    error = abs(float(_turned(channel.name, np.array([value - values[sample]]))[0]))
    return error <= max(_HIDDEN_STEPS * float(np.percentile(steps, 99.9)), _HIDDEN_ROUGHNESS * rough)


def _turned(name: str, differences: FloatArray) -> FloatArray:
    turns = np.clip(np.round(differences / (2.0 * np.pi)), -1.0, 1.0)
    return differences - 2.0 * np.pi * turns if name in TURNING else differences
