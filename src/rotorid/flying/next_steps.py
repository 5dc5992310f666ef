"""Next steps for a log: one list of commands for all verbs, each checked before it is printed.

A command stands in the list only if its channels are logged, the verb would take the log, and the firmware has what it
asks for. The way in which the log was read (a mapping of its columns) is part of each command. A plan is for the
vehicle of the log where its motors were identified, with its own gains where the log holds them.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.base import Immutable
from rotorid.data.record import FlightRecord
from rotorid.errors import RotoridError
from rotorid.io.formats import PACKED
from rotorid.signal.airborne import control_of
from rotorid.typing import Axis

if TYPE_CHECKING:
    from rotorid.flying.user_vehicles import OwnVehicle
    from rotorid.results.model import IdentifiedModel
    from rotorid.vehicles.catalog import VehicleEntry

RESULTS = "rotorid-out"
"""The folder of results, as the command line calls it."""


@dataclass(frozen=True, kw_only=True)
class LoopChannels(Immutable):
    """A loop whose response the log shows: its set-point, its answer, and whether it needs no instrument."""

    reference: str
    answer: str
    direct: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownOfLog(Immutable):
    """Facts that a verb found in a log, from which the next steps follow.

    Parameters
    ----------
    models
        Names of models that it supports.
    segment
        Model and value of ``--segment`` of an interval that may have been meant as an excitation.
    loop
        A loop that was measured.
    wanted_axes
        Axes to plan a flight for: they were looked at, and no model of them stands.
    tunes
        Whether a sweep of the log gave a rate model from which gains follow.
    reviewed
        Whether the review was made.
    """

    record: FlightRecord
    models: tuple[str, ...] = ()
    identified: Sequence[IdentifiedModel] = ()
    segment: tuple[str, str] | None = None
    loop: LoopChannels | None = None
    wanted_axes: tuple[Axis, ...] = ()
    tunes: bool = False
    reviewed: bool = True


def next_steps(known: KnownOfLog) -> Iterator[str]:
    """The commands that lead on from here, for this very log, as they are typed.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> source = Source(name="my flight.csv", format="CSV", sha256="", mapping="names.toml")
    >>> known = KnownOfLog(record=FlightRecord(source=source, topics=()), models=("rate.roll",), reviewed=False)
    >>> for command in next_steps(known):
    ...     print(command)
    rotorid identify 'my flight.csv' --map names.toml --model rate.roll --out 'rotorid-out/my flight-models'
    rotorid review 'my flight.csv' --map names.toml
    """
    record = known.record
    log, folder = log_words(record), f"{RESULTS}/{_stem(record.source.name)}-models"
    if known.models:
        yield _command("identify", *log, "--model", ",".join(known.models), "--out", folder)
    if known.tunes:
        yield _command("tune", *log)
    if known.segment is not None:
        model, segment = known.segment
        yield _command("identify", *log, "--model", model, "--segment", segment)
    if known.loop is not None:
        direct = ("--estimate", "direct") if known.loop.direct else ()
        yield _command("response", *log, "--inputs", known.loop.reference, "--outputs", known.loop.answer, *direct)
    if not known.reviewed:
        yield _command("review", *log)
    lost = control_of(record)
    # A vehicle that lost control needs a repair before anyone sweeps it.
    if known.wanted_axes and (lost is None or lost.lost_at_s is None):
        yield _command("design", "sweep", *_vehicle(known, folder), "--axis", ",".join(known.wanted_axes))


def sweep_for_tune(record: FlightRecord, axes: Sequence[Axis]) -> str:
    """The command that plans the sweep which ``tune`` needs, with the gains of a log; empty where none would take it.

    Parameters
    ----------
    record
        The log whose gains flew.
    axes
        What is to be swept.
    """
    from rotorid.vehicles.catalog import VEHICLES

    vehicle = craft_of(record)
    if VEHICLES[vehicle].interface is not None or not _accepted(VEHICLES[vehicle], None, record):
        return ""
    log = _file(record.source.name)
    return _command("design", "sweep", "--vehicle", vehicle, "--for-tune", log, "--axis", ",".join(axes))


def log_words(record: FlightRecord) -> tuple[str, ...]:
    """The words of a command line that name a log, and how it is read."""
    source = record.source
    return (_file(source.name), *(("--map", _file(source.mapping)) if source.mapping else ()))


def craft_of(record: FlightRecord) -> str:
    """The vehicle of the library that flies as the autopilot of a log does."""
    return autopilot_of(record).vehicle


def _vehicle(known: KnownOfLog, folder: str) -> tuple[str, ...]:
    """The vehicle of a plan: that of the log, where it is known and the plan accepts it."""
    from rotorid.vehicles.catalog import VEHICLES

    record, like = known.record, craft_of(known.record)
    gains = ("--gains", _file(record.source.name))
    own = _own_entry(known, folder, like)
    if own is not None:
        words = ("--vehicle", folder, "--like", like)
        if _accepted(*own, record):
            return (*words, *gains)
        if _accepted(*own):
            return words
    if _accepted(VEHICLES[like], None, record):
        return ("--vehicle", like, *gains)
    return ("--vehicle", like)


def _own_entry(known: KnownOfLog, folder: str, like: str) -> tuple[VehicleEntry, OwnVehicle] | None:
    """The vehicle that the results of a log make; none where they make none."""
    from rotorid.flying.user_vehicles import own_vehicle
    from rotorid.vehicles.catalog import VehicleEntry, aircraft

    if not known.identified:
        return None
    try:
        own = own_vehicle(known.identified, like=aircraft(like), name=PurePath(folder).name)
    except RotoridError:
        return None
    return VehicleEntry(name=own.aircraft.name, summary="", source="", make=lambda: own.aircraft), own


def _accepted(entry: VehicleEntry, own: OwnVehicle | None, record: FlightRecord | None = None) -> bool:
    """Whether a design would take a vehicle, with the gains, the noise and the wind of a log where there is one."""
    from rotorid.flying.designs import has_room
    from rotorid.flying.flight_air import flown_as
    from rotorid.flying.settings import DesignSettings, plan_settings

    choices = DesignSettings(vehicle=entry, kinds=("pilot_sweep",), plan=plan_settings(entry), own=own)
    if record is None:
        return has_room(choices)
    if record.source.mapping:
        # A design reads its log without a mapping; tables have no parameters either.
        return False
    try:
        return has_room(flown_as(choices, record))
    except RotoridError:
        return False


def _file(name: str) -> str:
    """A file as a word of a command line: no option."""
    return f"./{name}" if name.startswith("-") else name


def _stem(name: str) -> str:
    path = PurePath(name)
    return PurePath(path.stem).stem if path.suffix.lower() in PACKED else path.stem


def _command(*words: str) -> str:
    return shlex.join(["rotorid", *words])
