"""Balance of the motors over the flights of a vehicle: which motor changed, and whose motors are out of balance.

Each flight is compared with those before it, back to the last change, by the test of ``review --baseline``
(:mod:`rotorid.flights.motor_balance`), in its words. A vehicle's clearest change counts over all its flights, and over
a fleet the share of false ones is kept small by :func:`rotorid.uncertainty.differences.discoveries`.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import Quantity
from rotorid.fleets.table import REVIEW, Row
from rotorid.fleets.vehicles import order_of
from rotorid.flights.motor_balance import FEWEST_EARLIER, PAIR_PATTERNS, PAIRS, PATTERNS, BalanceChange, balance_change
from rotorid.typing import FloatArray
from rotorid.uncertainty.differences import discoveries

_PLACED, _PAIRS = (tuple(f"motors.{name}" for name in names) for names in (PATTERNS, PAIRS))
BALANCE = (*_PLACED, *_PAIRS)
"""What the table calls the amplitudes of the balance."""

_IMBALANCE = "motors.imbalance"


class MotorChange(NamedTuple):
    """A flight of a vehicle from which on its motors share the work in another way; flights count from 1."""

    vehicle: str
    at_flight: int
    log: str
    change: BalanceChange


class OutOfBalance(NamedTuple):
    """A vehicle whose motors share the work less evenly than those of healthy vehicles do."""

    vehicle: str
    flights: int
    of_flights: int
    imbalance: Quantity


class _Flight(NamedTuple):
    """Amplitudes of one flight, shape ``(3,)``, with their errors; its number and its log."""

    number: int
    row: Row
    values: FloatArray
    stds: FloatArray
    placed: bool


def motor_changes(rows: Sequence[Row], patterns: Mapping[str, FloatArray]) -> tuple[MotorChange, ...]:
    """Changes of the balance in a fleet, the first of each vehicle.

    Parameters
    ----------
    rows
        Of a fleet that was reviewed.
    patterns
        Hash of a log to the patterns over its rotors.
    """
    clearest: list[tuple[float, str, list[tuple[_Flight, BalanceChange]]]] = []
    for vehicle, flights in _flights(rows).items():
        tested = list(_tested(flights, patterns))
        if tested:
            least = min(change.probability for _, change in tested)
            clearest.append((min(1.0, least * len(tested)), vehicle, tested))
    found = discoveries([probability for probability, *_ in clearest])
    limit = max((one[0] for one, chosen in zip(clearest, found, strict=True) if chosen), default=-1.0)
    changes = []
    for (_, vehicle, tested), chosen in zip(clearest, found, strict=True):
        clear = [entry for entry in tested if entry[1].words and entry[1].probability * len(tested) <= limit]
        if chosen and clear:
            flight, change = clear[0]
            changes.append(MotorChange(vehicle, flight.number, flight.row.log, change))
    return tuple(changes)


def _flights(rows: Sequence[Row]) -> dict[str, list[_Flight]]:
    """Flights of each vehicle in their order, of which the balance is known."""
    numbers: dict[str, dict[tuple[str, int], dict[str, Row]]] = defaultdict(lambda: defaultdict(dict))
    for row in sorted((row for row in rows if row.model == REVIEW), key=order_of):
        numbers[row.vehicle][row.log_sha256, row.flight][row.parameter] = row
    found: dict[str, list[_Flight]] = {}
    for vehicle, flights in numbers.items():
        for number, known in enumerate(flights.values(), start=1):
            placed = any(place in known for place in _PLACED)
            own = [known.get(place) for place in (_PLACED if placed else _PAIRS)]
            if first := next((row for row in own if row is not None), None):
                values = np.array([math.nan if row is None else row.value for row in own])
                stds = np.array([math.nan if row is None else row.std for row in own])
                found.setdefault(vehicle, []).append(_Flight(number, first, values, stds, placed))
    return found


def _tested(flights: Sequence[_Flight], patterns: Mapping[str, FloatArray]) -> Iterator[tuple[_Flight, BalanceChange]]:
    """Each flight compared with those before it that know the same amplitudes of the same rotors."""
    for place, flight in enumerate(flights):
        rotors = _rotors(flight, patterns)
        if rotors is None:
            continue
        same = [
            one
            for one in flights[:place]
            if np.array_equal(np.isfinite(one.values), np.isfinite(flight.values))
            and one.placed == flight.placed
            and _like(_rotors(one, patterns), rotors)
        ]
        if len(same) < FEWEST_EARLIER:
            continue
        known = np.where(np.isfinite(flight.values), rotors, np.nan)
        earlier, errors = np.stack([one.values for one in same]), np.stack([one.stds for one in same])
        yield (
            flight,
            balance_change(earlier, errors, flight.values, flight.stds, patterns=known, placed=flight.placed),
        )


def _rotors(flight: _Flight, patterns: Mapping[str, FloatArray]) -> FloatArray | None:
    return patterns.get(flight.row.log_sha256) if flight.placed else PAIR_PATTERNS


def _like(other: FloatArray | None, rotors: FloatArray) -> bool:
    return other is not None and other.shape == rotors.shape


def out_of_balance(rows: Sequence[Row]) -> tuple[OutOfBalance, ...]:
    """Vehicles whose imbalance lies beyond the limit of the card in any flight."""
    row_of = QUANTITIES["imbalance"]
    flights: dict[str, list[Quantity]] = defaultdict(list)
    for row in rows:
        if (
            row.model == REVIEW
            and row.parameter == _IMBALANCE
            and math.isfinite(row.lower)
            and math.isfinite(row.upper)
        ):
            flights[row.vehicle].append(
                Quantity(value=row.value, std=row.std, lower=row.lower, upper=row.upper, unit=row.unit)
            )
    found = []
    for vehicle, many in sorted(flights.items()):
        uneven = [one for one in many if row_of.judged(one) == "look"]
        if uneven:
            most = max(uneven, key=lambda one: one.value)
            found.append(OutOfBalance(vehicle, len(uneven), len(many), most))
    return tuple(found)
