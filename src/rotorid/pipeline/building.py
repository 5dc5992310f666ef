"""Channels that are made of others, and channels that are moved in time: what a history gets after it has one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.channel import STANDARD_UNITS, Channel
from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.clock import missing_channel
from rotorid.signal.reconstruct import ingredients, reconstruct
from rotorid.signal.skew import shift

_MARK = "reconstructed from "


def require_channels(record: FlightRecord, channels: Sequence[str]) -> None:
    """Refuse a log that neither holds a channel nor what it can be reconstructed from.

    Raises
    ------
    InsufficientDataError
        Its ``missing_channel`` names what would be needed.
    """
    logged = record.channel_names
    for name in channels:
        made_of = ingredients(name, logged)
        lacking = [part for part in made_of if part not in logged]
        if name in logged or (made_of and not lacking):
            continue
        remedy = ""
        if made_of:
            remedy = (
                f"log it, name its source with --map, or log {', '.join(lacking)} too, from which, with the rest of "
                f"{', '.join(made_of)}, it is reconstructed"
            )
        raise missing_channel(record, name, remedy=remedy)


def with_ingredients(record: FlightRecord, channels: Sequence[str]) -> tuple[str, ...]:
    """Channels to take from a log: those that it holds, and what the others are reconstructed from."""
    logged = record.channel_names
    parts = [(name,) if name in logged else ingredients(name, logged) for name in channels]
    return tuple(dict.fromkeys(name for part in parts for name in part))


def is_logged(record: FlightRecord, name: str, start_s: float, stop_s: float) -> bool:
    """Whether a channel has samples in an interval, two and more."""
    return any(
        np.count_nonzero((topic.time_s >= start_s) & (topic.time_s <= stop_s)) > 1 for topic, _ in record.holding(name)
    )


def with_zeros(history: TimeHistory, names: Sequence[str]) -> TimeHistory:
    """A history with further channels that were zero all the time: test signals that were not injected."""
    if not names:
        return history
    count = history.values.shape[1]
    return replace(
        history,
        values=np.vstack([history.values, np.zeros((len(names), count))]),
        channels=(*history.channels, *(Channel(name=n, unit=STANDARD_UNITS[n], source="not injected") for n in names)),
        processing=(*history.processing, f"{', '.join(names)} zero, since nothing was injected"),
    )


def built(history: TimeHistory, wanted: Sequence[str]) -> TimeHistory:
    """A history with the channels that are wanted, in their order; what is not there is reconstructed.

    Parameters
    ----------
    history
        With the ingredients, see :func:`with_ingredients`.
    wanted
        Channel names.
    """
    made = history if set(wanted) <= set(history.names) else reconstruct(history)
    if made.names == tuple(wanted):
        return made
    rows = [made.names.index(name) for name in wanted]
    return replace(made, values=made.values[rows], channels=tuple(made.channels[row] for row in rows))


def reconstructed_findings(histories: Sequence[TimeHistory]) -> tuple[Finding, ...]:
    """A remark for each channel that was not logged but made."""
    made = {c.name: c.source.removeprefix(_MARK) for h in histories for c in h.channels if c.source.startswith(_MARK)}
    return tuple(
        Finding(
            kind="reconstructed",
            severity="info",
            where=name,
            message=f"{name} is not in the log; it was reconstructed from {origin}.",
        )
        for name, origin in made.items()
    )


def shifted(history: TimeHistory, shifts: Mapping[str, float]) -> TimeHistory:
    """A history with those of its channels moved for which a shift is given, each against all others.

    Raises
    ------
    UsageError
        A shift is longer than the history.
    """
    for name, seconds in shifts.items():
        if name not in history.names:
            continue
        try:
            history = shift(history, name, seconds)
        except InsufficientDataError as error:
            raise UsageError(
                f"a shift of {name} by {seconds:g} s came, and a maneuver of {history.duration_s:.3g} s",
                needed="a shift much shorter than every maneuver",
                remedy="see the skews that rotorid inspect finds",
            ) from error
    return history


def require_known(shifts: Mapping[str, float], used: Sequence[str]) -> None:
    """Refuse a shift of a channel that takes no part.

    Raises
    ------
    UsageError
        It says which channels there are.
    """
    for name in shifts:
        if name not in used:
            raise UsageError(f"a shift of {name} came, which takes no part in this", needed=f"one of {', '.join(used)}")
