"""Which stretches of which logs are fitted, and which are kept unseen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.pipeline.flights import flights_by_thrust
from rotorid.pipeline.instruments import Flown, find_instrument, is_injection
from rotorid.pipeline.settings import IdentifySettings
from rotorid.signal.airborne import airborne
from rotorid.signal.clock import missing_channel
from rotorid.signal.segment import classify, excitation_signals, find_excitations
from rotorid.typing import Axis

RICH_KINDS = ("sweep", "random_binary", "multisine")


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Maneuvers of the axes of a model.

    Parameters
    ----------
    fitted
        Rich enough to fit: sweeps, random binary signals, or what the user gave.
    unseen
        Doublets and multisteps of the same logs, kept for verification.
    """

    fitted: tuple[Flown, ...]
    unseen: tuple[Flown, ...]

    def fits(self, record: FlightRecord, maneuver: Maneuver) -> bool:
        """Whether any part of a maneuver is fitted, also when its log was read again."""
        sha256 = record.source.sha256
        return any(_overlap(maneuver, m) for r, m in self.fitted if r is record or r.source.sha256 == sha256)


def select_maneuvers(
    records: Sequence[FlightRecord], axes: Sequence[Axis], settings: IdentifySettings, *, whole: bool = False
) -> Selection:
    """Split the excitations of the axes into those to fit and those to keep unseen.

    Left out is what only looks like a maneuver: set-points that an outer loop moves while the signal rests in which the
    fitted excitations of the axis were seen, and what ends on the ground, where no model of a free flight holds.

    Parameters
    ----------
    records, axes, settings
        What was flown, what is wanted, and the choices of the run.
    whole
        Whether a record without any excitation is taken whole: of an input that is no command nothing can be found.

    Raises
    ------
    InsufficientDataError
        Nothing rich enough was flown on these axes.
    UsageError
        No record came, or the same one twice.
    """
    each_once(records)
    found = [(record, m) for record in records for axis in axes for m in find_excitations(record, axis)]
    if settings.segments:
        given = of_axes(settings.segments, axes)
        fitted = [(record, described(record, m)) for record in records for m in given if inside(record, m)]
    else:
        fitted = [
            (record, described(record, m) if m.origin == "given" else m)
            for record, m in found
            if m.kind in RICH_KINDS or m.origin == "given"
        ]
    if not fitted and whole and not settings.segments:
        fitted = whole_flights(records, axes)
    if not fitted:
        raise _nothing_flown(records, axes, [m for _, m in found], settings)
    unseen = [
        (record, m)
        for record, m in found
        if m.kind in ("doublet", "multistep")
        and not any(_overlap(m, f) for r, f in fitted if r is record)
        and not _answers(record, m, fitted)
    ]
    return Selection(fitted=tuple(fitted), unseen=wholly_flown(unseen))


def wholly_flown(flown: Sequence[Flown]) -> tuple[Flown, ...]:
    """Maneuvers that begin and end in the air, as far as thrust tells."""
    flights = {id(record): flights_by_thrust(record) for record, _ in flown}

    def flies(item: Flown) -> bool:
        record, maneuver = item
        flight = flights[id(record)]
        return flight is None or any(
            start_s <= maneuver.start_s and maneuver.stop_s <= stop_s for start_s, stop_s in flight.intervals
        )

    return tuple(item for item in flown if flies(item))


def _answers(record: FlightRecord, maneuver: Maneuver, fitted: Sequence[Flown]) -> bool:
    """Whether a set-point only passes on what an outer loop wants, while whoever flew the sweeps rests."""
    names = excitation_signals(record, maneuver.axis)
    # An injection enters far inside, and says nothing of the loops around it.
    outer = [
        names.index(m.signal)
        for _, m in fitted
        if m.axis == maneuver.axis and m.signal in names and not is_injection(m.signal)
    ]
    return bool(outer) and maneuver.signal in names and names.index(maneuver.signal) > max(outer)


def whole_flights(records: Sequence[FlightRecord], axes: Sequence[Axis]) -> list[Flown]:
    """The airborne part of each record, where nothing in it stands out as an excitation."""
    flown = []
    for record in records:
        start_s, stop_s = airborne(record).longest
        flown.append((record, Maneuver(axis=axes[0], kind="other", start_s=start_s, stop_s=stop_s, origin="found")))
    return flown


def of_axes(segments: Sequence[Maneuver], axes: Sequence[Axis]) -> list[Maneuver]:
    """The given segments, of which every one must be of an axis of the model."""
    for segment in segments:
        if segment.axis not in axes:
            raise UsageError(
                f"the segment {segment.axis}:{segment.start_s:g}:{segment.stop_s:g} is of another axis",
                needed=f"segments of {' or '.join(axes)}",
                remedy="leave it out, or choose the inputs or the model of that axis",
            )
    return list(segments)


def each_once(records: Sequence[FlightRecord]) -> None:
    """The same data twice would count as twice the evidence, and could be held out from itself."""
    if not records:
        raise UsageError("no record came", needed="at least one flight log")
    seen: dict[str, str] = {}
    for record in records:
        name, other = record.source.name, seen.get(record.source.sha256)
        if other is not None:
            came = f"{name} was given twice" if name == other else f"{name} and {other} are the same log"
            raise UsageError(came, needed="each log once", remedy="leave one of them out")
        seen[record.source.sha256] = name


def inside(record: FlightRecord, maneuver: Maneuver) -> bool:
    """Whether any part of a maneuver lies within a record."""
    return maneuver.start_s < record.stop_s and maneuver.stop_s > record.start_s


def _overlap(a: Maneuver, b: Maneuver) -> bool:
    return a.start_s < b.stop_s and b.start_s < a.stop_s


def described(record: FlightRecord, given: Maneuver) -> Maneuver:
    """A given segment with the kind and band of what its best excitation signal does there, unless it has them."""
    if given.kind != "other":
        return given
    name = find_instrument([(record, given)], given.axis) or f"{given.axis}_command"
    for topic, row in record.holding(name):
        inside = (topic.time_s >= given.start_s) & (topic.time_s <= given.stop_s) & np.isfinite(topic.values[row])
        if np.count_nonzero(inside) > 10:
            motion = topic.values[row, inside]
            kind, band = classify(topic.time_s[inside], motion - np.median(motion))
            return replace(given, kind=kind, band_rad_s=band, signal=name)
    return given


def _nothing_flown(
    records: Sequence[FlightRecord], axes: Sequence[Axis], found: Sequence[Maneuver], settings: IdentifySettings
) -> InsufficientDataError:
    names, wanted = ", ".join(record.source.name for record in records), " or ".join(axes)
    needed = "a sweep, a multisine or a random binary signal of some 20 s and more"
    remedy = "fly one (ArduPilot: SYSTEMID mode; PX4: slow to fast stick), or name an interval with --segment"
    if settings.segments:
        came = f"no given segment of {wanted} lies inside {names}"
        spans = ", ".join(f"{r.start_s:.1f} to {r.stop_s:.1f} s of {r.source.name}" for r in records)
        needed, remedy = f"a segment of {wanted} within {spans}", "see the excitations that rotorid inspect finds"
    elif found:
        kinds = ", ".join(f"{m.kind} at {m.start_s:.1f} s" for m in found[:4])
        came = f"{names} holds only short {wanted} maneuvers ({kinds})"
    else:
        came = f"{names} holds no excitation of {wanted}"
    for record in records:
        for axis in axes:
            if f"{axis}_command" not in record.channel_names:
                return missing_channel(record, f"{axis}_command")
    return InsufficientDataError(
        came,
        needed=needed,
        remedy=remedy,
        findings=[Finding(kind="no_excitation", severity="error", where=wanted, message=f"{came}.")],
    )
