"""Gyro and accelerometer of an ArduPilot log as fast as the sensor, before the autopilot's filters or behind them.

They stand in batches (``ISBH``, ``ISBD``) or in raw messages (``GYR``, ``ACC``).

A batch is a header with a number, the sensor, the rate and a scale, and sixteen or more data messages of 32 samples
with the same number and a place in the batch. Which side of the filters it was taken on, ``INS_LOG_BAT_OPT`` says: bit
1 behind them, bit 2 both, then with as many further sensors as there are behind the filters; ``INS_RAW_LOG_OPT`` with
bits 2 and 3 says the same of the raw messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from rotorid.data.record import Channel, Topic
from rotorid.io.ardupilot.dataflash import Table
from rotorid.typing import AnyArray, FloatArray

BATCH_MESSAGES = frozenset({"ISBH", "ISBD", "GYR", "ACC"})
"""Messages to read besides those of the channels."""

_SENSORS: Mapping[int, tuple[str, str]] = MappingProxyType({0: ("ax ay az", "m/s^2"), 1: ("p q r", "rad/s")})
"""``ISBH.type``."""

_RAW = (("GYR", ("GyrX", "GyrY", "GyrZ"), 1, "I"), ("ACC", ("AccX", "AccY", "AccZ"), 0, "I"))
_HEADER = ("N", "type", "instance", "mul", "smp_cnt", "SampleUS", "smp_rate")
_IN_MESSAGE = 32


def sensor_topics(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> Iterator[Topic]:
    """Topics of the first sensor of each kind, before and behind the filters as far as they were logged.

    Parameters
    ----------
    tables
        Messages by name.
    parameters
        Of the autopilot.
    """
    yield from _batches(tables, int(parameters.get("INS_LOG_BAT_OPT", 0.0)))
    yield from _messages(tables, int(parameters.get("INS_RAW_LOG_OPT", 0.0)))


def _sides(instances: AnyArray, *, behind: bool, both: bool) -> tuple[tuple[int, str], ...]:
    """The first sensor's instance, and that of the same one behind the filters."""
    numbers = sorted({int(number) for number in instances})
    if both and len(numbers) % 2 == 0:
        return (numbers[0], "raw"), (numbers[len(numbers) // 2], "filtered")
    return ((numbers[0], "filtered" if behind and not both else "raw"),)


def _batches(tables: Mapping[str, Table], options: int) -> Iterator[Topic]:
    header, data = tables.get("ISBH"), tables.get("ISBD")
    if header is None or data is None or not (header.holds_numbers(*_HEADER) and len(header) and len(data)):
        return
    if not all(column in data for column in ("N", "seqno", "x", "y", "z")):
        return
    heads, parts = header.read(*_HEADER), data.read("N", "seqno", "x", "y", "z")
    samples = np.stack([parts[axis].reshape(len(data), -1) for axis in "xyz"])
    if samples.shape[-1] != _IN_MESSAGE:
        return
    for kind, (names, unit) in _SENSORS.items():
        of_kind = heads["type"] == kind
        if not of_kind.any():
            continue
        for instance, stage in _sides(heads["instance"][of_kind], behind=bool(options & 2), both=bool(options & 4)):
            chosen = np.flatnonzero(of_kind & (heads["instance"] == instance))
            found = _joined(header, data, heads, parts, samples, chosen)
            if found is not None:
                time_s, values = found
                source = f"ISBD[{'acc' if kind == 0 else 'gyro'} {instance}]"
                yield _topic(source, time_s, [f"{name}_{stage}" for name in names.split()], unit, values)


def _joined(
    header: Table,
    data: Table,
    heads: Mapping[str, AnyArray],
    parts: Mapping[str, AnyArray],
    samples: AnyArray,
    chosen: AnyArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Stamps and values of the batches that are whole, one behind the other."""
    times, rows = [], []
    # A number comes again after 65536 batches: data belong to the last header before them.
    edges = np.searchsorted(data.positions, np.append(header.positions, np.iinfo(np.int64).max))
    for place in chosen:
        begin, end = int(edges[place]), int(edges[place + 1])
        own = begin + np.flatnonzero(parts["N"][begin:end] == heads["N"][place])
        count = int(heads["smp_cnt"][place])
        rate_hz, scale = float(heads["smp_rate"][place]), float(heads["mul"][place])
        whole = np.array_equal(parts["seqno"][own], np.arange(own.size)) and own.size * _IN_MESSAGE >= count > 1
        if not whole or not (np.isfinite(rate_hz) and rate_hz > 0.0 and scale > 0.0):
            continue
        rows.append(samples[:, own].reshape(3, -1)[:, :count] / scale)
        times.append(float(heads["SampleUS"][place]) * 1e-6 + np.arange(count) / rate_hz)
    if not times:
        return None
    return np.concatenate(times), np.concatenate(rows, axis=1)


def _messages(tables: Mapping[str, Table], options: int) -> Iterator[Topic]:
    for name, columns, kind, numbered in _RAW:
        table = tables.get(name)
        if table is None or not len(table) or not table.holds_numbers("SampleUS", numbered, *columns):
            continue
        names, unit = _SENSORS[kind]
        instances = table.column(numbered)
        for instance, stage in _sides(instances, behind=bool(options & 4), both=bool(options & 8)):
            part = table.chosen(instances == instance)
            numbers = part.numbers("SampleUS", *columns)
            channels = [f"{channel}_{stage}" for channel in names.split()]
            yield _topic(f"{name}[{instance}]", numbers[0] * 1e-6, channels, unit, numbers[1:])


def _topic(name: str, time_s: FloatArray, names: Sequence[str], unit: str, values: FloatArray) -> Topic:
    channels = tuple(
        Channel(name=channel, unit=unit, source=f"{name}.{axis}") for channel, axis in zip(names, "xyz", strict=True)
    )
    return Topic(name=name, time_s=time_s, channels=channels, values=values)
