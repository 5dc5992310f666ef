"""Which stretches of which logs are fitted, which are kept unseen, and which channel is the instrument."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.settings import IdentifySettings
from rotorid.signal.clock import missing_channel, one_clock
from rotorid.signal.segment import LEAST_MOTION, classify, excitation_signals, find_excitations
from rotorid.typing import Axis

Flown = tuple[FlightRecord, Maneuver]

RICH_KINDS = ("sweep", "random_binary")


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


def axis_of(input: str) -> Axis:
    """Axis of a command channel."""
    return input.removesuffix("_command")  # type: ignore[return-value]


def select_maneuvers(records: Sequence[FlightRecord], axes: Sequence[Axis], settings: IdentifySettings) -> Selection:
    """Split the excitations of the axes into those to fit and those to keep unseen.

    Raises
    ------
    InsufficientDataError
        Nothing rich enough was flown on these axes.
    UsageError
        No record came, or the same one twice.
    """
    _each_once(records)
    found = [(record, m) for record in records for axis in axes for m in find_excitations(record, axis)]
    if settings.segments:
        given = [m for m in settings.segments if m.axis in axes]
        fitted = [(record, _described(record, m)) for record in records for m in given if _inside(record, m)]
    else:
        fitted = [(record, m) for record, m in found if m.kind in RICH_KINDS]
        fitted += [(record, _described(record, m)) for record, m in found if m.origin == "given"]
    if not fitted:
        raise _nothing_flown(records, axes, [m for _, m in found], settings)
    unseen = [
        (record, m)
        for record, m in found
        if m.kind in ("doublet", "multistep") and not any(_overlap(m, f) for r, f in fitted if r is record)
    ]
    return Selection(fitted=tuple(fitted), unseen=tuple(unseen))


def _each_once(records: Sequence[FlightRecord]) -> None:
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


def _inside(record: FlightRecord, maneuver: Maneuver) -> bool:
    return maneuver.start_s < record.stop_s and maneuver.stop_s > record.start_s


def _overlap(a: Maneuver, b: Maneuver) -> bool:
    return a.start_s < b.stop_s and b.start_s < a.stop_s


def _described(record: FlightRecord, given: Maneuver) -> Maneuver:
    """A given segment with the kind and band of what its best excitation signal does there."""
    name = find_instrument([(record, given)], given.axis) or f"{given.axis}_command"
    for topic, row in record.holding(name):
        inside = (topic.time_s >= given.start_s) & (topic.time_s <= given.stop_s) & np.isfinite(topic.values[row])
        if np.count_nonzero(inside) > 10:
            motion = topic.values[row, inside]
            kind, band = classify(topic.time_s[inside], motion - np.median(motion))
            return replace(given, kind=kind, band_rad_s=band, signal=name)
    return given


def find_instrument(flown: Sequence[Flown], axis: Axis) -> str | None:
    """The channel that excites ``axis`` in every maneuver and contains no feedback, or ``None``.

    The best candidate that moves. Candidates are what the reader knows to be free of feedback, then set-points from
    the outermost loop inward: as soon as an outer loop is excited, the set-points inside it contain its feedback.
    """
    candidates = [set(excitation_signals(record, axis)) for record, _ in flown]
    shared = set.intersection(*candidates) if candidates else set()
    for name in excitation_signals(flown[0][0], axis):
        if name in shared and not name.endswith("_command") and all(_moves(r, m, name) for r, m in flown):
            return name
    return None


def _moves(record: FlightRecord, maneuver: Maneuver, name: str) -> bool:
    for topic, row in record.holding(name):
        inside = (topic.time_s >= maneuver.start_s) & (topic.time_s <= maneuver.stop_s)
        values = topic.values[row, inside]
        values = values[np.isfinite(values)]
        if values.size > 10:
            return float(np.ptp(values)) > LEAST_MOTION.get(STANDARD_UNITS.get(name, "1"), 0.02)
    return False


def cut(
    flown: Sequence[Flown],
    *,
    channels: Sequence[str],
    followers: Sequence[str] = (),
    rest_s: float = 0.0,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Maneuvers as time histories on one clock, all at the rate of the first.

    Parameters
    ----------
    flown
        Records and maneuvers.
    channels, followers
        See :func:`rotorid.signal.clock.one_clock`.
    rest_s
        Seconds of rest to take along on either side.
    progress
        Told what is done, sentence by sentence.

    Raises
    ------
    InsufficientDataError
        A channel is missing.
    """
    for record, _ in flown:
        for name in channels:
            if name not in record.channel_names:
                raise missing_channel(record, name)
    rate: float | None = None
    segments: list[Segment] = []
    findings: list[Finding] = []
    for record, maneuver in flown:
        progress(f"{record.source.name}: {maneuver.axis} {maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s")
        conditioned = one_clock(
            record,
            channels=channels,
            followers=followers,
            start_s=maneuver.start_s - rest_s,
            stop_s=maneuver.stop_s + rest_s,
            sample_rate_hz=rate,
        )
        findings += conditioned.findings
        for history in conditioned.histories:
            rate = history.sample_rate_hz
            segments.append(Segment(record=record.source.name, maneuver=maneuver, history=history))
    return tuple(segments), (*findings, *other_sources(segments, segments, channels))


def other_sources(
    reference: Sequence[Segment], segments: Sequence[Segment], channels: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that come from another place in the log than in the first segment of ``reference``.

    Autopilots log one quantity in several places, filtered and not; a filter shifts a model by its delay.
    """
    findings = {}
    for segment in segments:
        for name in channels:
            here, there = source_of(segment, name), source_of(reference[0], name)
            if here != there:
                findings[segment.record, name] = Finding(
                    kind="other_source",
                    severity="warning",
                    where=f"{segment.record}: {name}",
                    message=(
                        f"{name} comes from {there} in one place and from {here} in another. Where the autopilot "
                        "filters one and not the other, they differ by the delay of that filter."
                    ),
                )
    return tuple(findings.values())


def source_of(segment: Segment, name: str) -> str:
    """Where a channel of a segment stands in its log."""
    return segment.history.channels[segment.history.names.index(name)].source


def histories(segments: Sequence[Segment]) -> tuple[TimeHistory, ...]:
    """The data of several segments."""
    return tuple(segment.history for segment in segments)


def _nothing_flown(
    records: Sequence[FlightRecord], axes: Sequence[Axis], found: Sequence[Maneuver], settings: IdentifySettings
) -> InsufficientDataError:
    names, wanted = ", ".join(record.source.name for record in records), " or ".join(axes)
    needed = "a sweep or a random binary signal of some 20 s and more"
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
