"""Tables whose columns have stamps of their own: long ones, of one row for each value, and sparse ones.

A *long* table has a column of stamps, one of names and one of values. A *sparse* one is wide, and a column is empty
wherever its source was not sampled. Both become named arrays, each with its own stamps.
"""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from rotorid.errors import LogError, UsageError
from rotorid.io.tables.mapping import ChannelMapping, MappedChannel, Series
from rotorid.typing import FloatArray
from rotorid.units import UNITS_AND_ALIASES

_NAMES = frozenset({"name", "key", "variable", "signal", "channel", "field", "metric", "measurement", "topic", "tag"})
_VALUES = frozenset({"value", "val", "data", "reading"})
_CLOCKS = frozenset({"time", "t", "timestamp", "stamp", "time_s", "time_ms", "time_us", "time_ns", "elapsed_time"})

_CLOCK = "clock"
_FEWEST_ROWS = 20
_LEAST_EMPTY = 0.05
_FEWEST_SAMPLES = 2
_MOST_NAMES = 5000


@dataclass(frozen=True, kw_only=True, slots=True)
class LongLayout:
    """Columns of a long table.

    Parameters
    ----------
    clock, time
        Header and place of the stamps.
    names
        Places of the parts of a name, which are joined by points: topic and field.
    unit
        Place of the unit of each value, where there is one.
    value, width
        Place of the values; number of columns.
    """

    clock: str
    time: int
    names: tuple[int, ...]
    unit: int | None
    value: int
    width: int

    def name_of(self, cells: Sequence[str]) -> str:
        """What the value of a row is called, with its unit behind it."""
        name = ".".join(part for place in self.names if (part := cells[place].strip()))
        unit = "" if self.unit is None else cells[self.unit].strip().strip("[]()")
        return f"{name} [{unit}]" if unit in UNITS_AND_ALIASES and "[" not in name else name


def long_layout(header: Sequence[str]) -> LongLayout | None:
    """The columns of a long table; ``None`` where the header is that of a wide one.

    Examples
    --------
    >>> long_layout(["time [s]", "name", "value"]).names, long_layout(["time [s]", "q [rad/s]", "p [rad/s]"])
    ((1,), None)
    """
    bare = [_bare(cell) for cell in header]
    places = [[place for place, name in enumerate(bare) if name in known] for known in (_CLOCKS, _NAMES, _VALUES)]
    if not all(places) or len(places[2]) != 1:
        return None
    time, value = places[0][0], places[2][0]
    unit = next((place for place, name in enumerate(bare) if name in ("unit", "units")), None)
    return LongLayout(clock=header[time], time=time, names=tuple(places[1]), unit=unit, value=value, width=len(header))


def _bare(cell: str) -> str:
    name = cell.partition("[")[0].partition("(")[0].strip().lower()
    return name.strip("_%").replace(" ", "_")


Scattered = tuple[dict[str, FloatArray], dict[str, FloatArray]]
"""Values by name, and the stamps of each."""


def read_long(path: Path, file: str, separator: str, first_line: int, layout: LongLayout) -> Scattered:
    """Values of a long table by name, and their stamps in the unit of the file.

    Rows without a number, such as texts and states, are no samples.

    Raises
    ------
    LogError
        A row is too short, a stamp is no number, or no row holds a number.
    """
    found: dict[str, tuple[array[float], array[float]]] = {}
    for number, cells in _rows(path, separator, first_line):
        if len(cells) < layout.width:
            raise LogError(
                f"{file}, line {number} has {len(cells)} cells and the header {layout.width}",
                needed="one cell for each column",
                remedy="complete or delete the line; the last one is often cut when a recording stops",
            )
        stamp, value = _number(cells[layout.time]), _number(cells[layout.value])
        if not np.isfinite(stamp):
            raise LogError(
                f"{file}, line {number}, column {layout.clock!r} is {cells[layout.time].strip()!r}",
                needed="a finite number with a decimal point",
                remedy="correct or delete the line",
            )
        if np.isfinite(value):
            times, values = found.setdefault(layout.name_of(cells), (array("d"), array("d")))
            times.append(stamp)
            values.append(value)
            if len(found) > _MOST_NAMES:
                raise LogError(f"{file} has more than {_MOST_NAMES} names", needed="a name for each signal")
    if not found:
        raise LogError(
            f"{file} contains no flight: no row has a number as its value",
            needed="samples",
            remedy="check how it was written",
        )
    return (
        {name: np.array(values) for name, (_, values) in found.items()},
        {name: np.array(times) for name, (times, _) in found.items()},
    )


def read_sparse(
    path: Path, header: Sequence[str], wanted: Sequence[int], separator: str, first_line: int, mapping: ChannelMapping
) -> Scattered | None:
    """Columns of a wide table without their empty cells, and the stamps of each.

    ``None`` where that does not explain why the table could not be read: a single empty cell is a fault of the file,
    one row in twenty a slower source. The clock must be full.
    """
    clock = mapping.clock.time if mapping.clock else None
    if clock is None or clock.source not in header or mapping.experiments is not None:
        return None
    columns = [array("d") for _ in wanted]
    for _, cells in _rows(path, separator, first_line):
        if len(cells) != len(header):
            return None
        for place, column in enumerate(wanted):
            value = _number(cells[column])
            if not np.isfinite(value) and cells[column].strip().lower() not in ("", "nan", "null", "none", "-"):
                return None
            columns[place].append(value)
    table = {header[column]: np.array(values) for column, values in zip(wanted, columns, strict=True)}
    empty = {name: ~np.isfinite(values) for name, values in table.items()}
    rows = len(columns[0])
    shares = [float(mask.mean()) for mask in empty.values() if mask.any()]
    if rows < _FEWEST_ROWS or empty[clock.source].any() or not shares or min(shares) < _LEAST_EMPTY:
        return None
    kept = {name: ~mask for name, mask in empty.items() if np.count_nonzero(~mask) >= _FEWEST_SAMPLES}
    if len(kept) < len(table):
        return None
    return (
        {name: values[kept[name]] for name, values in table.items()},
        {name: table[clock.source][kept[name]] for name in table},
    )


def _rows(path: Path, separator: str, first_line: int) -> Iterator[tuple[int, list[str]]]:
    with path.open(encoding="utf-8-sig", errors="replace", newline=None) as lines:
        for number, line in enumerate(islice(lines, first_line - 1, None), start=first_line):
            if not line.strip():
                continue
            try:
                yield number, next(csv.reader([line], delimiter=separator), [])
            except csv.Error:
                yield number, [line]


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def with_stamps(
    mapping: ChannelMapping, stamps: Mapping[str, FloatArray]
) -> tuple[ChannelMapping, dict[str, FloatArray]]:
    """A mapping in which each channel has the stamps of its source, and these stamps by the names that it uses.

    Channels with equal stamps share them, and so a topic.
    """
    clocks: dict[str, FloatArray] = {}

    def clock_of(source: str, given: Series | None) -> Series:
        given = given or (mapping.clock.time if mapping.clock else None)
        own = stamps[source]
        name = next((name for name, known in clocks.items() if np.array_equal(known, own)), "")
        if not name:
            count = len(clocks) + 1
            name = _CLOCK if count == 1 else f"{_CLOCK} {count}"
            clocks[name] = own
        return Series(source=name, unit=given.unit if given else "")

    def own(channel: MappedChannel) -> MappedChannel:
        first, *others = (name for name, _ in channel.samples.terms)
        if stray := next((name for name in others if not np.array_equal(stamps[name], stamps[first])), ""):
            raise UsageError(
                f"{channel.where} adds up {first} and {stray}, which are logged at different times",
                needed="variables with the same stamps",
                remedy="correct `sum` in the mapping",
            )
        return replace(channel, time=clock_of(first, channel.time))

    channels = tuple(own(channel) for channel in mapping.channels)
    attitude = mapping.attitude
    if attitude is not None:
        attitude = replace(attitude, time=clock_of(attitude.parts[0].source, attitude.time))
    return replace(mapping, channels=channels, attitude=attitude, clock=None), clocks
