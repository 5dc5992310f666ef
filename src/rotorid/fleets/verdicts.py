"""The verdict of each vehicle of a fleet, for terminal, page and file: changed, unchanged, or not enough data.

A vehicle changed where any of its numbers did. It is unchanged where none did and at least one would have shown a
change of 20 %. Otherwise there is not enough data, and the reason is given. All sentences are made here, from one set
of counts.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rotorid.data.base import Immutable
from rotorid.data.display import counted
from rotorid.data.quantity import significant
from rotorid.fleets.analysis import FleetAnalysis, History, quantity_of
from rotorid.fleets.names import words_of
from rotorid.fleets.table import Counts
from rotorid.io.named import skipped_words
from rotorid.uncertainty.differences import NOTICEABLE_SHARE, Verdict

_PERCENT = f"{100.0 * NOTICEABLE_SHARE:.0f} %"


@dataclass(frozen=True, kw_only=True)
class VehicleVerdict(Immutable):
    """Whether a vehicle changed.

    Parameters
    ----------
    vehicle, flights
        Which, and how often it flew.
    verdict
        Of all its numbers.
    numbers
        Model and parameter to the verdict of each.
    detectable
        To the change, as a share, that would have been found; infinite where none would.
    why
        Why there is not enough data; empty where there is.
    """

    vehicle: str
    flights: int
    verdict: Verdict
    numbers: Mapping[tuple[str, str], Verdict]
    detectable: Mapping[tuple[str, str], float]
    why: str = ""

    def __post_init__(self) -> None:
        self._set(numbers=self.numbers, detectable=self.detectable)

    @property
    def quantities(self) -> Mapping[tuple[str, str], bool]:
        """Whether each quantity could be checked; histories of one quantity are not several."""
        found: dict[tuple[str, str], bool] = {}
        for (model, parameter), verdict in self.numbers.items():
            key = (model, quantity_of(parameter))
            found[key] = found.get(key, False) or verdict != "undecided"
        return found

    @property
    def decided(self) -> int:
        """How many quantities could be checked."""
        return sum(self.quantities.values())


@dataclass(frozen=True, kw_only=True)
class Checked(Immutable):
    """For how many vehicles and numbers a change could be looked for."""

    vehicles: int
    of_vehicles: int
    numbers: int
    of_numbers: int
    changed: int
    unchanged: int


def checked(verdicts: Sequence[VehicleVerdict]) -> Checked:
    """For how many vehicles and numbers a change could be looked for.

    Examples
    --------
    >>> checked([]).of_vehicles
    0
    """
    return Checked(
        vehicles=sum(verdict.verdict != "undecided" for verdict in verdicts),
        of_vehicles=len(verdicts),
        numbers=sum(verdict.decided for verdict in verdicts),
        of_numbers=sum(len(verdict.quantities) for verdict in verdicts),
        changed=sum(verdict.verdict == "changed" for verdict in verdicts),
        unchanged=sum(verdict.verdict == "unchanged" for verdict in verdicts),
    )


def verdicts_of(analysis: FleetAnalysis) -> tuple[VehicleVerdict, ...]:
    """The verdict of each vehicle of a fleet."""
    histories: dict[str, list[History]] = defaultdict(list)
    for history in analysis.histories:
        histories[history.vehicle].append(history)
    return tuple(_verdict(vehicle, many) for vehicle, many in sorted(histories.items()))


def _verdict(vehicle: str, many: Sequence[History]) -> VehicleVerdict:
    numbers = {(history.model, history.parameter): history.verdict for history in many}
    order: tuple[Verdict, ...] = ("changed", "unchanged", "undecided")
    found = min(numbers.values(), key=order.index)
    return VehicleVerdict(
        vehicle=vehicle,
        flights=len({(row.log_sha256, row.flight) for history in many for row in history.rows}),
        verdict=found,
        numbers=numbers,
        detectable={(history.model, history.parameter): history.detectable for history in many},
        why=_why(many) if found == "undecided" else "",
    )


def _why(many: Sequence[History]) -> str:
    """Why there is not enough data for a verdict."""
    flights = {(row.log_sha256, row.flight) for history in many for row in history.rows}
    if len(flights) < 2:
        return "only 1 flight"
    repeated = [history for history in many if len(history.rows) > 1]
    if not repeated:
        return "no quantity was measured in 2 flights"
    compared = [history for history in repeated if history.scatter_known]
    if not compared:
        return "too few flights to know the usual scatter between flights"
    best = min(compared, key=lambda history: history.detectable)
    if not math.isfinite(best.detectable):
        return "all its numbers are zero within their errors"
    return f"a change of {words_of(best.model, best.parameter)} below {_percent(best.detectable)} would be missed"


def _percent(share: float) -> str:
    """A share that a reader can grasp: percents, or a factor.

    Examples
    --------
    >>> _percent(0.3649), _percent(2.4)
    ('36 %', 'a factor of 3.4')
    """
    return f"{100.0 * share:.0f} %" if share < 1.0 else f"a factor of {1.0 + share:.2g}"


def sentences(analysis: FleetAnalysis, counts: Counts) -> tuple[str, ...]:
    """The answer in a sentence, then what it is based on."""
    verdicts = verdicts_of(analysis)
    return (
        _headline(verdicts),
        *_basis(verdicts),
        *_separated(analysis),
        *_gains(analysis),
        *_others(analysis),
        _logs(counts, len(verdicts)),
    )


def _headline(verdicts: Sequence[VehicleVerdict]) -> str:
    of = checked(verdicts)
    if not of.of_vehicles:
        return "No log gave a number, so nothing can be compared."
    if of.changed:
        names = _listed([verdict.vehicle for verdict in verdicts if verdict.verdict == "changed"])
        if of.of_vehicles == 1:
            return f"The vehicle changed: {names}."
        return f"{of.changed} of {of.of_vehicles} vehicles changed: {names}."
    if not of.vehicles:
        if all(verdict.flights < 2 for verdict in verdicts):
            return f"Not enough data: only 1 flight{' of each vehicle' if of.of_vehicles > 1 else ''}."
        what = "of the vehicle" if of.of_vehicles == 1 else f"in any of {of.of_vehicles} vehicles"
        return f"Not enough data to detect a change {what}."
    if of.of_vehicles == 1:
        return f"No change found in {verdicts[0].vehicle}."
    return f"No change found in {of.vehicles} of {of.of_vehicles} vehicles" + (
        "."
        if of.vehicles == of.of_vehicles
        else f"; not enough data for the other{'s' * (of.of_vehicles - of.vehicles > 1)}."
    )


def _basis(verdicts: Sequence[VehicleVerdict]) -> Iterator[str]:
    """What the answer is based on, and why it is missing elsewhere."""
    of = checked(verdicts)
    if of.numbers:
        yield (
            f"{of.numbers} of {counted(of.of_numbers, 'quantity', 'quantities')} could be checked for a change of "
            f"{_PERCENT} or more."
        )
    if of.changed and of.unchanged:
        yield f"No change found in {counted(of.unchanged, 'other vehicle')}."
    reasons: dict[str, list[str]] = defaultdict(list)
    for verdict in verdicts:
        if verdict.why:
            reasons[verdict.why].append(verdict.vehicle)
    if len(verdicts) > 1 or all(verdict.flights > 1 for verdict in verdicts):
        for why, names in list(reasons.items())[:3]:
            yield f"Not enough data for {_listed(names)}: {why}."
        if len(reasons) > 3:
            more = sum(len(names) for names in list(reasons.values())[3:])
            yield f"Not enough data for {counted(more, 'more vehicle')}, for other reasons."
    if reasons:
        undecided = sum(map(len, reasons.values()))
        them = "" if len(verdicts) == 1 else " with it" if undecided == 1 else " with each of them"
        yield f"Fly the same maneuvers again{them} to get an answer."


def _separated(analysis: FleetAnalysis) -> Iterator[str]:
    for vehicles in analysis.several:
        yield f"{vehicles.name} has logs of {len(vehicles.vehicles)} vehicles: {_listed(vehicles.vehicles)}."


def _gains(analysis: FleetAnalysis) -> Iterator[str]:
    """Flights with other gains, which change loops and margins."""
    vehicles = sorted({gains.vehicle for gains in analysis.other_gains})
    if vehicles:
        first = analysis.other_gains[0]
        names = [
            f"{name} {significant(before)} to {significant(after)}" for name, (before, after) in first.gains.items()
        ]
        yield (
            f"Gains changed between flights of {_listed(vehicles)} ({first.log}: {_listed(names, 2)}), and loops and "
            "margins with them. Check that these logs are of one vehicle."
        )


def _others(analysis: FleetAnalysis) -> Iterator[str]:
    odd = sorted({history.vehicle for history in analysis.histories if history.odd_vehicle is not None})
    if odd:
        yield f"{counted(len(odd), 'vehicle')} differ{'s' if len(odd) == 1 else ''} from the rest: {_listed(odd)}."
    if drifting := sorted({history.vehicle for history in analysis.histories if history.drift is not None}):
        yield f"Slow change: {_listed(drifting)}."
    if flights := {(history.vehicle, odd.flight) for history in analysis.histories for odd in history.odd}:
        are = "is" if len(flights) == 1 else "are"
        yield f"{counted(len(flights), 'flight')} {are} unlike those before and after."


def _logs(counts: Counts, vehicles: int) -> str:
    gave = f"{counts.answered} of {counted(counts.logs, 'log')} gave {counted(counts.rows, 'number')}"
    parts = [f"{gave} of {counted(vehicles, 'vehicle')}" if vehicles else gave]
    if counts.refused:
        parts.append(f"{counts.refused} gave none, for the reasons listed")
    if counts.unreadable:
        parts.append(f"{counts.unreadable} could not be read")
    if counts.duplicates:
        parts.append(f"{counted(counts.duplicates, 'copy was', 'copies were')} left out")
    if counts.resumed:
        parts.append(f"{counts.resumed} {'was' if counts.resumed == 1 else 'were'} read in an earlier run")
    if counts.skipped:
        parts.append(f"skipped {skipped_words(counts.skipped)}")
    return "; ".join(parts) + "."


def _listed(names: Sequence[str], most: int = 6) -> str:
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown
