"""Which stretches of which logs a time-domain fit uses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rotorid.data.channel import AXES
from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.instruments import Flown, axes_of, is_command
from rotorid.pipeline.selection import Selection, described, each_once, inside, select_maneuvers
from rotorid.pipeline.settings import IdentifySettings
from rotorid.signal.airborne import airborne
from rotorid.signal.segment import find_excitations
from rotorid.typing import Axis


class TimeSelection(NamedTuple):
    """Maneuvers to fit, those that are kept unseen, and remarks."""

    selection: Selection
    findings: tuple[Finding, ...] = ()


def select_records(
    structure: LinearStructure, records: Sequence[FlightRecord], settings: IdentifySettings
) -> TimeSelection:
    """The stretches to fit.

    For commands of the mixer those that the frequency domain fits too. For set-points the segments that were given,
    the excitations that stand in a single set-point itself, or whole records: to a response in time any motion of
    its inputs is an excitation.

    Raises
    ------
    InsufficientDataError
        Nothing was flown that shows the model, or a record holds one sample.
    UsageError
        No record came, or the same one twice.
    """
    axes = axes_of(structure.inputs, structure.outputs)
    for record in records:
        _require_duration(record)
    if all(is_command(name) for name in structure.inputs):
        return TimeSelection(select_maneuvers(records, axes, settings))
    each_once(records)
    if settings.segments:
        return TimeSelection(Selection(fitted=_given(records, settings.segments), unseen=()))
    single = structure.inputs[0] if len(structure.inputs) == 1 else ""
    found = [(record, m) for record in records for m in _seen_in(record, single)]
    if found:
        return TimeSelection(Selection(fitted=tuple(found), unseen=()))
    whole = [_whole(record, axes) for record in records]
    return TimeSelection(Selection(fitted=tuple(whole), unseen=()), tuple(_read_whole(*item) for item in whole))


def _require_duration(record: FlightRecord) -> None:
    if record.start_s < record.stop_s:
        return
    name = record.source.name
    message = f"{name} holds one sample"
    raise InsufficientDataError(
        message,
        needed="a flight of some seconds",
        remedy="give another log",
        findings=[Finding(kind="record_too_short", severity="error", where=name, message=f"{message}.")],
    )


def _given(records: Sequence[FlightRecord], segments: Sequence[Maneuver]) -> tuple[Flown, ...]:
    flown = tuple((record, described(record, m)) for record in records for m in segments if inside(record, m))
    if not flown:
        spans = ", ".join(f"{r.start_s:.1f} to {r.stop_s:.1f} s of {r.source.name}" for r in records)
        raise UsageError("no given segment lies inside the records", needed=f"segments within {spans}")
    return flown


def _seen_in(record: FlightRecord, input: str) -> list[Maneuver]:
    """Excitations that were seen in an input itself, each interval once."""
    found = [m for axis in AXES for m in find_excitations(record, axis) if m.signal == input]  # type: ignore[arg-type]
    return sorted({(m.start_s, m.stop_s): m for m in found}.values(), key=lambda m: m.start_s)


def _whole(record: FlightRecord, axes: Sequence[Axis]) -> Flown:
    try:
        start_s, stop_s = airborne(record).longest
    except InsufficientDataError as error:
        if any(finding.kind == "never_airborne" for finding in error.findings):
            raise
        # Nothing in the log tells take-off and landing, as in records that were cut for identification.
        start_s, stop_s = record.start_s, record.stop_s
    return record, Maneuver(axis=axes[0], kind="other", start_s=start_s, stop_s=stop_s, origin="found")


def _read_whole(record: FlightRecord, maneuver: Maneuver) -> Finding:
    return Finding(
        kind="no_excitation",
        severity="info",
        where=record.source.name,
        message=(
            f"No excitation of all inputs stands out in {record.source.name}, so all of it was fitted, "
            f"{maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s. Choose a part with --segment."
        ),
        numbers={"start_s": maneuver.start_s, "stop_s": maneuver.stop_s},
    )
