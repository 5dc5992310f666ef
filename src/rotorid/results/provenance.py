"""Provenance of a result: logs with hashes, choices, seed and stretches, enough to reproduce it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, overload

from rotorid import __version__
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, worst_first
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.data.response import Estimate, FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.settings.option import Setting, Settings

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, kw_only=True)
class LoggedManeuver(Maneuver):
    """A maneuver and the name of the log that it lies in.

    Parameters
    ----------
    axis, kind, start_s, stop_s, band_rad_s, origin, signal
        As in :class:`rotorid.data.record.Maneuver`.
    record
        Name of the log.
    """

    record: str


Logged = TypeVar("Logged", bound=LoggedManeuver)


@dataclass(frozen=True, kw_only=True)
class Provenance(Immutable):
    """Provenance of a result.

    Parameters
    ----------
    command
        Words of the command line, empty where a program called.
    inputs
        Name of each log to its SHA-256.
    settings
        Choices of the run by name.
    estimate
        How the response was estimated; ``None`` where there is none.
    instruments
        Channels used as instruments of a joint estimate.
    sources
        What a name in the result stands for, such as the channel behind an input.
    maneuvers
        Stretches that were used.
    """

    version: str = __version__
    command: tuple[str, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Setting] = field(default_factory=dict)
    seed: int = 0
    estimate: Estimate | None = None
    instruments: tuple[str, ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)
    maneuvers: tuple[LoggedManeuver, ...] = ()

    def __post_init__(self) -> None:
        self._set(inputs=self.inputs, settings=self.settings, sources=self.sources)


class Stretch(Protocol):
    """An interval of a log."""

    @property
    def record(self) -> FlightRecord: ...
    @property
    def maneuver(self) -> Maneuver: ...


def provenance(
    records: Sequence[FlightRecord],
    settings: Settings,
    *,
    flights: Sequence[Stretch] = (),
    response: FrequencyResponse | None = None,
    sources: Mapping[str, str] | None = None,
) -> Provenance:
    """Provenance of a result from ``records``.

    Parameters
    ----------
    flights
        The stretches used: a log and an interval of it.
    response
        The estimate, where there is one.
    sources
        What names stand for.
    """
    names = _names(records)
    return Provenance(
        inputs=hashes(records),
        settings=settings.as_json(),
        seed=settings.seed,
        estimate=response.estimate if response else None,
        instruments=tuple(response.instruments) if response else (),
        sources=sources or {},
        maneuvers=tuple(
            replace(
                logged(flight.record, flight.maneuver), record=names.get(_key(flight.record), flight.record.source.name)
            )
            for flight in flights
        ),
    )


@overload
def logged(record: FlightRecord, maneuver: Maneuver) -> LoggedManeuver: ...
@overload
def logged(record: FlightRecord, maneuver: Maneuver, kind: type[Logged], **more: Any) -> Logged: ...
def logged(
    record: FlightRecord, maneuver: Maneuver, kind: type[LoggedManeuver] = LoggedManeuver, **more: Any
) -> LoggedManeuver:
    """A maneuver with the name of its log.

    Parameters
    ----------
    record, maneuver
        A stretch of a log.
    kind
        What to make of it.
    more
        Fields of that kind which a maneuver has not.
    """
    same = {item.name: getattr(maneuver, item.name) for item in fields(Maneuver)}
    return kind(record=record.source.name, **same, **more)


def hashes(records: Sequence[FlightRecord]) -> dict[str, str]:
    """Hash of each log by its name; logs of one name are distinguished by a number."""
    return {name: sha256 for (_, sha256), name in _names(records).items()}


def _names(records: Sequence[FlightRecord]) -> dict[tuple[str, str], str]:
    """Name and hash of each log to the name that no other log has."""
    names: dict[tuple[str, str], str] = {}
    for record in records:
        name, count = record.source.name, 1
        while name in names.values() and _key(record) not in names:
            count += 1
            name = f"{record.source.name} ({count})"
        names.setdefault(_key(record), name)
    return names


def _key(record: FlightRecord) -> tuple[str, str]:
    return record.source.name, record.source.sha256


@dataclass(frozen=True, kw_only=True)
class Refused(Immutable):
    """Data that cannot support a result: why, and no number.

    Parameters
    ----------
    findings
        Remarks, the grave ones first.
    """

    findings: tuple[Finding, ...]
    provenance: Provenance
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()


def refused(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    settings: Settings,
    *,
    otherwise: Finding,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
) -> Refused:
    """Why data cannot support a result.

    Parameters
    ----------
    error
        What ended the run.
    otherwise
        The finding that stands for an error which brings none.
    """
    findings = (*(finding for record in records for finding in record.findings), *(error.findings or (otherwise,)))
    return Refused(
        findings=worst_first(findings),
        provenance=provenance(records, settings),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
    )
