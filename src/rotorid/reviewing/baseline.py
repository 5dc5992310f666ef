"""A flight compared with earlier flights of the same vehicle: what changed, which motor, and the usual cause.

Each figure of health (:attr:`rotorid.data.quantities.FigureOfMerit.health`) is compared with its scatter over the
earlier flights (:mod:`rotorid.uncertainty.next_flight`), the balance of the motors as a whole
(:mod:`rotorid.flights.motor_balance`); ``fleet --review`` asks both the same. Of a hundred flights in which nothing
changed one at most is called changed, half of that by the balance, half by all other figures together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.display import capital, counted, listed
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.quantities import figure, words_of_path
from rotorid.data.quantity import Quantity, with_unit
from rotorid.data.record import FlightRecord
from rotorid.errors import LogError, UsageError
from rotorid.flights.motor_balance import (
    FALSE_ALARM,
    FEWEST_EARLIER,
    PAIRS,
    PATTERNS,
    BalanceChange,
    balance_change,
    percent,
)
from rotorid.flights.same_vehicle import aircraft_of, different_gains, gains_of
from rotorid.io.files import sha256_of
from rotorid.io.log_order import natural, time_of
from rotorid.io.motor_speeds import checked_speeds
from rotorid.io.named import FoundLogs, find_logs
from rotorid.io.registry import read
from rotorid.reviewing.values import BaselineReview, LeftOut, Review
from rotorid.typing import FloatArray
from rotorid.uncertainty.differences import NOTICEABLE_SHARE, Verdict
from rotorid.uncertainty.next_flight import FEWEST, NextFlight, next_flights

_MOST_NAMES = 5


_MOST_FLIGHTS = 20
"""Earlier flights that are reviewed, the last ones: more show the scatter no better, and take their time."""


class Earlier(NamedTuple):
    """Logs of one vehicle before a flight, the last ones in their order, and those that were not used."""

    records: tuple[FlightRecord, ...]
    left_out: tuple[LeftOut, ...]


class _Log(NamedTuple):
    """A log that may be an earlier flight."""

    order: tuple[str, tuple[tuple[int, int, str], ...]]
    name: str
    sha256: str
    log: FlightRecord | Path


class _Flight(NamedTuple):
    """An earlier flight: its review and the gains of its rate loops."""

    review: Review
    gains: Mapping[str, float]


def earlier_logs(record: FlightRecord, logs: Path | str | Sequence[FlightRecord | Path | str]) -> Earlier:
    """The logs of a folder that are earlier flights of the vehicle of a log.

    Order is that of ``fleet``: by the date in the name of a log, else by the name. Where neither has a date, and the
    log itself is not in the folder, all are taken for earlier ones.

    Parameters
    ----------
    record
        The flight that is asked about.
    logs
        A folder, or logs.

    Raises
    ------
    UsageError
        The folder holds no log.
    """
    given = [logs] if isinstance(logs, str | Path) else list(logs)
    files = [Path(log) for log in given if not isinstance(log, FlightRecord)]
    if missing := [file for file in files if not file.exists()]:
        raise UsageError(f"{missing[0]} does not exist", needed="a folder of earlier flights")
    behind = find_logs(files) if files else FoundLogs(files=())
    known = [_log(log) for log in given if isinstance(log, FlightRecord)] + [_log(log) for log in behind.files]
    craft = aircraft_of(record)
    left_out = [LeftOut(log=file.name, why="is no log") for file in behind.skipped]
    left_out += [LeftOut(log=file.name, why="is a link that leads out of the folder") for file in behind.linked]
    kept: list[FlightRecord] = []
    for log in reversed(list(_before(record, sorted(known, key=lambda one: one.order), left_out))):
        if len(kept) == _MOST_FLIGHTS:
            left_out.append(LeftOut(log=log.name, why=f"is earlier than the last {_MOST_FLIGHTS} flights"))
            continue
        try:
            one = log.log if isinstance(log.log, FlightRecord) else read(log.log, mapping=record.source.mapping or None)
        except (LogError, UsageError) as error:
            reason = str(error).removeprefix(log.name).strip(": ")
            left_out.append(LeftOut(log=log.name, why=f"cannot be read: {reason}"))
            continue
        if contradiction := aircraft_of(one).contradiction(craft):
            left_out.append(LeftOut(log=log.name, why=f"is from another vehicle: {contradiction}"))
            continue
        kept.append(one)
    return Earlier(tuple(reversed(kept)), tuple(left_out))


def _log(log: FlightRecord | Path) -> _Log:
    if isinstance(log, FlightRecord):
        name = log.source.name
        return _Log((time_of(name), natural(name)), name, log.source.sha256, checked_speeds(log))
    return _Log((time_of(str(log)), natural(log.name)), log.name, sha256_of(log) if log.is_file() else "", log)


def _before(record: FlightRecord, logs: Sequence[_Log], left_out: list[LeftOut]) -> Iterator[_Log]:
    """Logs before a flight, each content once; the others join those that are left out."""
    own, when = record.source.sha256, time_of(record.source.name)
    here = next((log.order for log in logs if own and log.sha256 == own), None)
    seen: set[str] = set()
    for log in logs:
        if own and log.sha256 == own:
            left_out.append(LeftOut(log=log.name, why="is the log itself"))
        elif log.sha256 and log.sha256 in seen:
            left_out.append(LeftOut(log=log.name, why="is a copy of another"))
        elif (here is not None and log.order > here) or (when and log.order[0] > when):
            left_out.append(LeftOut(log=log.name, why="is later"))
        else:
            yield log
        seen.add(log.sha256)


def measures(reviewed: Review) -> dict[str, Quantity]:
    """All numbers of a review by the path that its document gives them, such as ``noise.vibration_m_s2``."""
    groups: dict[str, Mapping[str, Quantity]] = {
        **{f"loops.{name}": loop.numbers for name, loop in reviewed.loops.items()},
        **{f"margins.{axis}": margin.numbers for axis, margin in reviewed.margins.items()},
        "battery": reviewed.flight.battery,
        "yaw": reviewed.flight.yaw,
        "noise": reviewed.noise.numbers,
        "motors": {**reviewed.motors.means, **reviewed.motors.numbers},
    }
    if reviewed.flight.hover_throttle is not None:
        groups["flight"] = {"hover_throttle": reviewed.flight.hover_throttle}
    return {f"{group}.{name}": quantity for group, numbers in groups.items() for name, quantity in numbers.items()}


def compared(
    reviewed: Review,
    earlier: Sequence[Review],
    *,
    left_out: Sequence[LeftOut] = (),
    gains: Mapping[str, float] | None = None,
    earlier_gains: Sequence[Mapping[str, float]] = (),
) -> BaselineReview:
    """A review compared with those of earlier flights.

    Parameters
    ----------
    reviewed
        The flight that is asked about.
    earlier
        Reviews of earlier flights of the vehicle.
    left_out
        Logs that were not used, to be named.
    gains, earlier_gains
        Of the rate loops: flights with other gains show no change of loops and margins.
    """
    air = [
        _Flight(one, own)
        for one, own in zip(earlier, earlier_gains or [{} for _ in earlier], strict=True)
        if one.flight.flights
    ]
    left = [*left_out, *(LeftOut(log=one.name, why="contains no flight") for one in earlier if not one.flight.flights)]
    numbers = measures(reviewed)
    balance = _balance(reviewed, [flight.review for flight in air])
    figures = next_flights(_pairs(numbers, air, gains or {}), false_alarms=FALSE_ALARM)
    verdict = _verdict([*(one.verdict for one in figures.values()), *([balance.verdict] if balance else [])])
    return BaselineReview(
        flights=tuple(flight.review.name for flight in air),
        left_out=tuple(left),
        verdict=verdict,
        balance=balance,
        figures=figures,
        sentences=tuple(_sentences(verdict, balance, figures, len(air), air, gains or {})),
    )


def with_baseline(reviewed: Review, baseline: BaselineReview) -> Review:
    """A review with its comparison, whose findings name what changed."""
    return replace(
        reviewed,
        baseline=baseline,
        findings=worst_first([*_findings(baseline), *_without_imbalance(reviewed, baseline)]),
    )


def _without_imbalance(reviewed: Review, baseline: BaselineReview) -> Iterator[Finding]:
    """An imbalance that the vehicle always had is no warning, and one that is new is named by its change."""
    decided = baseline.balance is not None and baseline.balance.verdict != "undecided"
    yield from (finding for finding in reviewed.findings if not (decided and finding.kind == "motor_imbalance"))


def _balance(reviewed: Review, earlier: Sequence[Review]) -> BalanceChange | None:
    patterns = reviewed.motors.patterns
    placed = any(name in reviewed.motors.numbers for name in PATTERNS)
    names = PATTERNS if placed else PAIRS
    known = [name for name in names if name in reviewed.motors.numbers]
    if patterns is None or not known:
        return None
    same = [
        one.motors.numbers
        for one in earlier
        if one.motors.patterns is not None
        and one.motors.patterns.shape == patterns.shape
        and all(name in one.motors.numbers for name in known)
    ]
    if len(same) < FEWEST_EARLIER:
        return None

    def column(numbers: Mapping[str, Quantity], what: str) -> FloatArray:
        return np.array([getattr(numbers[name], what) if name in known else math.nan for name in names])

    return balance_change(
        np.stack([column(numbers, "value") for numbers in same]),
        np.stack([column(numbers, "std") for numbers in same]),
        column(reviewed.motors.numbers, "value"),
        column(reviewed.motors.numbers, "std"),
        patterns=patterns,
        placed=placed,
    )


def _pairs(
    numbers: Mapping[str, Quantity], earlier: Sequence[_Flight], gains: Mapping[str, float]
) -> dict[str, tuple[list[Quantity], Quantity]]:
    """Figures of health with those of earlier flights; those of loops from flights with the same gains."""
    known = [(measures(flight.review), bool(different_gains(flight.gains, gains))) for flight in earlier]
    found = {}
    for path, now in numbers.items():
        row = figure(path.rpartition(".")[2])
        if row is None or row.health is None or not math.isfinite(now.std):
            continue
        if path == "flight.hover_throttle" and "battery.hover_output_v" in numbers:
            continue
        of_loops = path.startswith(("loops.", "margins.")) or "_noise_share" in path
        before = [own[path] for own, other in known if path in own and not (of_loops and other)]
        found[path] = ([one for one in before if math.isfinite(one.std)], now)
    return found


def _verdict(each: Sequence[Verdict]) -> Verdict:
    order: tuple[Verdict, ...] = ("changed", "unchanged", "undecided")
    return min(each, key=order.index, default="undecided")


def shown_change(path: str, one: NextFlight) -> str:
    """A figure of a flight with what earlier flights let expect, for a sentence."""
    row = figure(path.rpartition(".")[2])
    if row is None or one.expected is None:
        return ""
    factor = row.factor or 1.0
    low, high = (f"{factor * end:.3g}" for end in (one.expected.lower, one.expected.upper))
    return f"{row.shown(one.now)}, expected {with_unit(f'{low} to {high}', row.unit)}"


def balance_words(balance: BalanceChange) -> str:
    """What changed of the balance, as a sentence."""
    count = counted(balance.flights, "earlier flight")
    if balance.motor is not None and balance.rise is not None:
        way = "harder" if balance.rise.value > 0.0 else "less"
        size = percent(balance.rise).lstrip("+−")
        return f"Motor {balance.motor} works {size} {way} than in {count}; the others do not."
    changes = {number: change.value for number, change in balance.outputs.items()}
    most = [number for number, change in changes.items() if change > 0.5 * max(changes.values())]
    named = f"{'Motor' if len(most) == 1 else 'Motors'} {listed([str(number) for number in most])}"
    works = "works" if len(most) == 1 else "work"
    return f"{named} {works} {percent(balance.outputs[most[0]]).lstrip('+')} harder against the others than in {count}."


def _sentences(
    verdict: Verdict,
    balance: BalanceChange | None,
    figures: Mapping[str, NextFlight],
    count: int,
    earlier: Sequence[_Flight],
    gains: Mapping[str, float],
) -> Iterator[str]:
    if balance is not None and balance.verdict == "changed":
        yield balance_words(balance)
        yield f"Usual cause: {balance.usual}."
    for path, one in figures.items():
        if one.verdict == "changed":
            yield from _changed(path, one)
    flights = counted(count, "earlier flight")
    known = sum(one.verdict != "undecided" for one in figures.values())
    if verdict == "unchanged":
        yield f"No change found since {flights}."
        if balance is None or balance.verdict == "undecided":
            yield "Not compared: the balance of the motors."
    if verdict == "undecided":
        reason = f"{max(FEWEST, FEWEST_EARLIER)} are needed" if count < FEWEST else "they scatter too much"
        yield f"Not enough data to compare with {flights}: {reason}."
    if balance is not None and balance.verdict == "unchanged":
        yield f"A motor whose output rose by {100.0 * balance.detectable:.0f} % alone would have been found."
    if figures and count >= FEWEST:
        yield (
            f"{known} of {counted(len(figures), 'figure')} could be checked for a change of "
            f"{100.0 * NOTICEABLE_SHARE:.0f} % or more."
        )
    other = {name: values for flight in earlier for name, values in different_gains(flight.gains, gains).items()}
    if other:
        names = listed(sorted(other)[:_MOST_NAMES])
        yield f"Earlier flights had other gains ({names}), so loops and margins are compared with the rest alone."


def _changed(path: str, one: NextFlight) -> Iterator[str]:
    row = figure(path.rpartition(".")[2])
    yield f"{capital(words_of_path(path))} changed: {shown_change(path, one)}."
    rose = one.expected is not None and one.now.value > one.expected.value
    if row is not None and row.health and rose:
        yield f"Usual cause: {row.health}."


def left_out_words(baseline: BaselineReview, *, all_of_them: bool = True) -> Iterator[str]:
    """Logs of the folder that were not used, each reason in a sentence."""
    reasons: dict[str, list[str]] = {}
    for log in baseline.left_out:
        reasons.setdefault(log.why, []).append(log.log)
    for why, names in reasons.items():
        shown = names if all_of_them else names[:_MOST_NAMES]
        more = f" and {len(names) - len(shown)} more" if len(names) > len(shown) else ""
        yield f"Left out: {', '.join(shown)}{more} ({why.rstrip('.')})."


def _findings(baseline: BaselineReview) -> Iterator[Finding]:
    balance = baseline.balance
    if balance is not None and balance.verdict == "changed":
        message = f"{balance_words(balance)} Usual cause: {balance.usual}."
        numbers = {f"motor_{number}_change": change.value for number, change in balance.outputs.items()}
        yield warn("changed_since_earlier", "motors", message, probability=balance.probability, **numbers)
    for path, one in baseline.figures.items():
        if one.verdict == "changed":
            message = " ".join(_changed(path, one))
            yield warn("changed_since_earlier", path, message, probability=one.probability)


def baseline_of(
    record: FlightRecord,
    reviewed: Review,
    logs: Path | str | Sequence[FlightRecord | Path | str],
    review: Callable[[FlightRecord], Review],
) -> BaselineReview:
    """Compare a flight with the earlier ones of a folder.

    Parameters
    ----------
    record, reviewed
        The flight and its review.
    logs
        A folder, or logs.
    review
        Makes the review of an earlier log.
    """
    earlier = earlier_logs(record, logs)
    return compared(
        reviewed,
        [review(one) for one in earlier.records],
        left_out=earlier.left_out,
        gains=gains_of(record, tuple(RATE_OF)),
        earlier_gains=[gains_of(one, tuple(RATE_OF)) for one in earlier.records],
    )
