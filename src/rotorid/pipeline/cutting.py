"""Maneuvers cut out of their logs, brought onto one clock and one rate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.building import (
    built,
    is_logged,
    reconstructed_findings,
    require_channels,
    shifted,
    with_ingredients,
    with_zeros,
)
from rotorid.pipeline.flights import while_flying
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.instruments import Flown, is_injection
from rotorid.signal.clock import Conditioned, one_clock

_SAME_RATE = 1.02


def cut(
    flown: Sequence[Flown],
    *,
    channels: Sequence[str],
    followers: Sequence[str] = (),
    shifts: Mapping[str, float] | None = None,
    rest_s: float = 0.0,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Maneuvers as time histories on one clock, all at the rate of the slowest.

    What lies before take-off and after landing is cut off, channels that are not logged are reconstructed where their
    ingredients are, and shifts that were asked for are applied last.

    Parameters
    ----------
    flown
        Records and maneuvers.
    channels, followers
        See :func:`rotorid.signal.clock.one_clock`; of ``channels`` those too that
        :func:`rotorid.signal.reconstruct.reconstruct` makes.
    shifts
        Channel to seconds by which it is delayed, see :func:`rotorid.signal.skew.shift`. Channels that are not cut out
        here are passed over.
    rest_s
        Seconds of rest to take along on either side.
    progress
        Told what is done, sentence by sentence.

    Raises
    ------
    InsufficientDataError
        A channel is missing.
    UsageError
        A shift is longer than a maneuver.
    """
    for record, _ in flown:
        require_channels(record, channels)
    flown, landed = while_flying(flown)

    def conditioned(item: Flown, sample_rate_hz: float | None) -> Conditioned:
        record, maneuver = item
        progress(f"{record.source.name}: {maneuver.axis} {maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s")
        start_s, stop_s = maneuver.start_s - rest_s, maneuver.stop_s + rest_s
        silent = [name for name in followers if is_injection(name) and not is_logged(record, name, start_s, stop_s)]
        found = one_clock(
            record,
            channels=with_ingredients(record, channels),
            followers=[name for name in followers if name not in silent],
            start_s=start_s,
            stop_s=stop_s,
            sample_rate_hz=sample_rate_hz,
        )
        return replace(found, histories=tuple(with_zeros(history, silent) for history in found.histories))

    first = [conditioned(item, None) for item in flown]
    rates = [history.sample_rate_hz for part in first for history in part.histories]
    if not rates:
        raise _nothing_left(flown)
    slowest = min(rates)
    parts = first
    if any(rate != slowest for rate in rates):
        parts = [conditioned(item, slowest) for item in flown]
    wanted = tuple(dict.fromkeys((*channels, *followers)))
    segments = tuple(
        Segment(record=record.source.name, maneuver=maneuver, history=shifted(built(history, wanted), shifts or {}))
        for (record, maneuver), part in zip(flown, parts, strict=True)
        for history in part.histories
    )
    remarks = (*landed, *(f for part in parts for f in part.findings), *_rates(rates, slowest))
    return segments, (
        *remarks,
        *reconstructed_findings(histories(segments)),
        *other_sources(segments, segments, channels),
    )


def _rates(rates: Sequence[float], slowest: float) -> tuple[Finding, ...]:
    """What to say about records of different rates."""
    fastest = max(rates)
    if fastest <= _SAME_RATE * slowest:
        return ()
    return (
        Finding(
            kind="rate_too_low",
            severity="warning",
            where="records",
            message=f"Records of {slowest:.4g} to {fastest:.4g} Hz were brought to {slowest:.4g} Hz.",
            numbers={"rate_hz": slowest, "fastest_hz": fastest},
        ),
    )


def _nothing_left(flown: Sequence[Flown]) -> InsufficientDataError:
    names = ", ".join(dict.fromkeys(record.source.name for record, _ in flown))
    return InsufficientDataError(
        f"no stretch of a second without a gap is left in the maneuvers of {names}",
        needed="maneuvers logged without gaps",
        remedy="use a faster card or log fewer topics",
        findings=[
            Finding(kind="gap", severity="error", where=names, message=f"Gaps leave no stretch of a second in {names}.")
        ],
    )


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
