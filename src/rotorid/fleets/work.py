"""Work on one log: read it, cut it into flights, identify and review these; the answer as rows."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, LogError, reason_of
from rotorid.fleets.identity import board_of, hidden
from rotorid.fleets.places import Place, UnreachableError, fetched, is_of_place
from rotorid.fleets.table import REVIEW, Failed, Failure, LogAnswer, Row
from rotorid.flights.motor_balance import patterns_of, rotor_geometry
from rotorid.flights.same_vehicle import Aircraft, aircraft_of, gains_of
from rotorid.io.registry import read
from rotorid.letters import visible
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import ParameterEstimate
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.verbs import with_verbs
from rotorid.signal.airborne import airborne
from rotorid.signal.stretch import stretch

_SHORTEST_FLIGHT_S = 20.0
"""A flight of its own is as long."""

_ON_THE_GROUND_S = 10.0
"""Time on the ground that separates two flights."""

_MARGIN_S = 3.0
"""What a flight is cut out with, before and after."""


_FOLDERS = re.compile(r"(?<![\w.:/\\])(?:[A-Za-z]:)?[/\\](?:[^/\\\s'\"]+[/\\])*(?=[^/\\\s'\"])")
"""Folders of an absolute path, before the name of a file."""

Part = TypeVar("Part")


@dataclass(frozen=True, kw_only=True)
class Task(Immutable):
    """One log, and the settings for it.

    Parameters
    ----------
    place
        Where it is.
    asked
        What ``as_json`` of :class:`rotorid.fleets.FleetSettings` gives.
    settings
        Its hash.
    salt
        For the names of vehicles.
    copy
        Where the log lies on this machine, if not at its place.
    """

    place: Place
    asked: Mapping[str, Any]
    settings: str
    salt: str
    copy: str = ""

    def as_json(self) -> dict[str, Any]:
        """For another process."""
        return {
            "place": asdict(self.place),
            "asked": dict(self.asked),
            "settings": self.settings,
            "salt": self.salt,
            "copy": self.copy,
        }

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> Task:
        """As another process sent it."""
        return cls(**{**table, "place": Place(**table["place"])})


def answer(task: Task) -> LogAnswer:
    """Read a log and identify its flights: numbers of each model, or the reason for none."""
    started_s = time.monotonic()
    try:
        if task.copy:
            found = _answer(task, Path(task.copy))
        else:
            with fetched(task.place) as log:
                found = _answer(task, log)
    except LogError as error:
        elsewhere = isinstance(error, UnreachableError) or is_of_place(error.__cause__)
        found = failure(task, "unreachable" if elsewhere else "unreadable", str(error))
    except MemoryError:
        found = failure(task, "memory", "It asked for more memory than one log may use.")
    # A fault of the program costs this log alone, and is named in the table of failures.
    except Exception as error:
        found = failure(task, "error", f"{type(error).__name__}: {error}")
    return replace(found, seconds=round(time.monotonic() - started_s, 3))


def failure(task: Task, kind: Failure, reason: str) -> LogAnswer:
    """The answer of a log that gave none."""
    name = visible(task.place.name)
    failed = Failed(
        log=name,
        log_sha256="",
        vehicle=visible(task.place.folder),
        flight=0,
        model="",
        kind=kind,
        reason=_printed(reason),
    )
    return _empty(task, failed=(failed,))


def _printed(reason: str) -> str:
    """A reason for the tables, which are passed on: on one line, without folders of this machine.

    Examples
    --------
    >>> _printed("/home/someone/flights/a.ulg is empty; see s3://fleet/a.ulg, 3 m/s")
    'a.ulg is empty; see s3://fleet/a.ulg, 3 m/s'
    """
    return visible(_FOLDERS.sub("", " ".join(reason.split())))[:500]


def _empty(task: Task, **more: Any) -> LogAnswer:
    return LogAnswer(
        **{
            "log": visible(task.place.name),
            "place": task.place.address,
            "mark": task.place.mark,
            "log_sha256": "",
            "settings": task.settings,
            **more,
        }
    )


def _answer(task: Task, log: Path) -> LogAnswer:
    record = read(log)
    lost: dict[str, str] = {}

    def part(what: str, make: Callable[[], Part], otherwise: Part) -> Part:
        """What a log has beside its models; where it fails, its reason joins the table of failures."""
        try:
            return make()
        except Exception as error:
            lost[what] = with_verbs(str(reason_of(error, what)), "fleet")
            return otherwise

    board = part("board", lambda: board_of(log), b"")
    facts = {
        "log": visible(task.place.name),
        "log_sha256": record.source.sha256,
        "vehicle": hidden(board, task.salt.encode()) if board else visible(task.place.folder),
    }
    aircraft = part("vehicle", lambda: aircraft_of(record), Aircraft())
    gains = part("gains", lambda: gains_of(record), dict[str, float]())
    none: tuple[tuple[float, ...], ...] = ()
    patterns = part("rotors", lambda: _patterns(record) if task.asked["review"] else none, none)
    rows: list[Row] = []
    failed: list[Failed] = []
    for number, flight in flights_of(record).items():
        for name, result in _model_results(flight, task):
            if isinstance(result, str):
                reason = _printed(_stayed_on_the_ground(record) or result)
                failed.append(Failed(**facts, flight=number, model=name, kind="refused", reason=reason))
                continue
            common: dict[str, Any] = {
                **facts,
                "time_utc": "",
                "flight": number,
                "model": name,
                "format": record.source.format,
                "firmware": visible(record.source.firmware),
                "settings": task.settings,
                **{name: visible(words) for name, words in asdict(aircraft).items()},
            }
            rows += [Row(**common, **numbers) for numbers in result]
    failed += [Failed(**facts, flight=0, model=what, kind="error", reason=_printed(why)) for what, why in lost.items()]
    return _empty(
        task,
        log_sha256=record.source.sha256,
        rows=tuple(rows),
        failed=tuple(failed),
        gains=gains,
        patterns=patterns,
    )


def _patterns(record: FlightRecord) -> tuple[tuple[float, ...], ...]:
    """Patterns over the rotors; empty where not all are known."""
    positions, spins = rotor_geometry(record)
    if positions is None or spins is None:
        return ()
    found = patterns_of(positions, spins)
    return tuple(map(tuple, found.tolist())) if bool(np.isfinite(found).all()) else ()


def _model_results(record: FlightRecord, task: Task) -> Iterator[tuple[str, list[dict[str, Any]] | str]]:
    """Each model by name with its numbers, or the reason for none."""
    from rotorid.identifying.identify_many import identify_several

    models = task.asked["models"]
    if models:
        try:
            several = identify_several([record], models, settings=IdentifySettings(seed=task.asked["seed"]))
        except Exception as error:
            # All models of a log fail together: each is listed with that reason, and the next log is read.
            reason = with_verbs(str(reason_of(error, "models")), "fleet")
            yield from ((name, reason) for name in models)
        else:
            for name, model in several.items():
                if isinstance(model, IdentifiedModel):
                    yield name, _numbers_or_reason(name, model)
                else:
                    reasons = [finding.message for finding in model.findings if finding.severity == "error"]
                    yield name, reasons[0] if reasons else "The data do not support it."
    if task.asked["review"]:
        try:
            yield REVIEW, list(_measures(record))
        except Exception as error:
            # A review that fails leaves its reason; models and the next log stand.
            yield REVIEW, with_verbs(str(reason_of(error, "the review")), "fleet")


def _numbers_or_reason(name: str, model: IdentifiedModel) -> list[dict[str, Any]] | str:
    """The rows of a model; where they cannot be made, the reason, and all other models stand."""
    try:
        return list(_numbers(model))
    except Exception as error:
        return with_verbs(str(reason_of(error, name)), "fleet")


def _numbers(model: IdentifiedModel) -> Iterator[dict[str, Any]]:
    from rotorid.identifying.comparison import basis_of

    kinds = ",".join(sorted({finding.kind for finding in model.findings if finding.severity == "warning"}))
    motors = dict(model.motors.derived) if model.motors is not None else {}
    estimates: dict[str, Any] = {
        name: estimate
        for name, estimate in model.parameters.items()
        if estimate.status == "free" and estimate.std is not None
    }
    for name, entry in {**estimates, **motors}.items():
        random = entry.std_random if isinstance(entry, ParameterEstimate) else entry.std
        yield {
            "parameter": name,
            "value": entry.value,
            "std": entry.std,
            "std_random": entry.std if random is None else random,
            "lower": _or_nan(getattr(entry, "lower", None)),
            "upper": _or_nan(getattr(entry, "upper", None)),
            "unit": entry.unit,
            "findings": kinds,
            "basis": visible(basis_of(model, name)),
        }


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _measures(record: FlightRecord) -> Iterator[dict[str, Any]]:
    """The numbers of a review with their errors, by the path that its document gives them."""
    from rotorid.reviewing.assembly import review
    from rotorid.reviewing.baseline import measures

    reviewed = review(record, models=False)
    kinds = ",".join(sorted({finding.kind for finding in reviewed.findings if finding.severity == "warning"}))
    for name, quantity in measures(reviewed).items():
        yield {
            "parameter": name,
            "value": quantity.value,
            "std": quantity.std,
            "std_random": quantity.std,
            "lower": quantity.lower if math.isfinite(quantity.lower) else math.nan,
            "upper": quantity.upper if math.isfinite(quantity.upper) else math.nan,
            "unit": quantity.unit,
            "findings": kinds,
        }


_NO_FLIGHT = "The log contains no flight"


def _stayed_on_the_ground(record: FlightRecord) -> str:
    """Why the log shows that the vehicle never flew; empty where it flew, or the log does not show either."""
    try:
        airborne(record)
    except InsufficientDataError as error:
        never = next((finding.message for finding in error.findings if finding.kind == "never_airborne"), "")
        # Behind the colon is what showed it, in the same words for all logs.
        why = never.rpartition(": ")[2].rstrip(".") if ": " in never else ""
        return f"{_NO_FLIGHT}{f': {why}' if why else ''}." if never else ""
    return ""


def flights_of(record: FlightRecord) -> dict[int, FlightRecord]:
    """The flights of a log as records of their own, by the number that ``inspect`` and ``review`` give them.

    Flights with less than 10 s on the ground between them count as the first of them; shorter ones than 20 s are left
    out. A log with one flight that is left, or without any, comes as it is.
    """
    try:
        found = airborne(record).intervals
    except InsufficientDataError:
        return {1: record}
    joined: dict[int, tuple[float, float]] = {}
    last = 0
    for number, (start_s, stop_s) in enumerate(found, start=1):
        if last and start_s - joined[last][1] < _ON_THE_GROUND_S:
            joined[last] = joined[last][0], stop_s
        else:
            last = number
            joined[number] = start_s, stop_s
    flights = {number: (start, stop) for number, (start, stop) in joined.items() if stop - start >= _SHORTEST_FLIGHT_S}
    if len(flights) < 2:
        return {next(iter(flights), 1): record}
    return {number: stretch(record, start - _MARGIN_S, stop + _MARGIN_S) for number, (start, stop) in flights.items()}
