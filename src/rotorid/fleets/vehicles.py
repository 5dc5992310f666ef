"""Which vehicles flew: logs under one name that contradict each other are of several.

A folder, a board or a name that was given may stand for several vehicles. Logs that name two autopilots, two kinds or
two frames are taken apart, and each vehicle is then named with what it differs in. What a log does not say makes no
vehicle of its own where all others agree.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rotorid.data.base import Immutable
from rotorid.fleets.table import Row
from rotorid.io.log_order import natural

_FACTS = ("autopilot", "kind", "frame")


@dataclass(frozen=True, kw_only=True)
class SeveralVehicles(Immutable):
    """One name that logs of several vehicles had in common, and the vehicles that they are of."""

    name: str
    vehicles: tuple[str, ...]


def separated(rows: Iterable[Row]) -> tuple[list[Row], tuple[SeveralVehicles, ...]]:
    """Rows in order, with vehicles separated by their logs, and the names that meant several.

    Examples
    --------
    >>> separated([])
    ([], ())
    """
    known = list(rows)
    groups: dict[str, list[int]] = defaultdict(list)
    for place, row in enumerate(known):
        groups[row.vehicle].append(place)
    several = []
    for name, places in groups.items():
        parts = list(_parts([(place, known[place]) for place in places], _FACTS))
        if len(parts) < 2:
            continue
        for words, members in parts:
            for place, row in members:
                known[place] = replace(row, vehicle=f"{name} ({', '.join(words)})")
        several.append(SeveralVehicles(name=name, vehicles=tuple(f"{name} ({', '.join(words)})" for words, _ in parts)))
    return known, tuple(several)


def order_of(row: Row) -> tuple[Any, ...]:
    """Sort key of flights: their time, else the names of their logs."""
    return row.time_utc, natural(row.log), row.log_sha256, row.flight


_Placed = tuple[int, Row]


def _parts(rows: Sequence[_Placed], facts: Sequence[str]) -> Iterator[tuple[tuple[str, ...], Sequence[_Placed]]]:
    """Parts of rows that agree in all facts, each with what it differs in from the others."""
    if not facts:
        yield (), rows
        return
    groups: dict[str, list[_Placed]] = defaultdict(list)
    for placed in rows:
        groups[getattr(placed[1], facts[0])].append(placed)
    if len(groups.keys() - {""}) < 2:
        yield from _parts(rows, facts[1:])
        return
    for value, own in sorted(groups.items()):
        for words, members in _parts(own, facts[1:]):
            yield (value or f"{facts[0]} not logged", *words), members
