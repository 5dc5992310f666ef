"""Which channels and which stretches of a log tell a delay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.instruments import Flown, axes_of
from rotorid.pipeline.selection import RICH_KINDS, described, inside, of_axes, whole_flights
from rotorid.pipeline.settings import MeasureSettings
from rotorid.signal.segment import LEAST_MOTION, candidate_excitations, find_excitations
from rotorid.typing import Axis

_SETPOINT = "_setpoint"
_RATES = {"roll_command": "p", "pitch_command": "q", "yaw_command": "r"}


def default_pairs(records: Sequence[FlightRecord]) -> tuple[tuple[str, str], ...]:
    """Every set-point that moves, with its response; commands with their rates where no set-point does.

    Where any axis was excited on purpose, only pairs of such axes count: what feedback moves tells no delay.

    Raises
    ------
    InsufficientDataError
        No such pair is logged.
    """
    setpoints = [(name, name.removesuffix(_SETPOINT)) for name in STANDARD_UNITS if name.endswith(_SETPOINT)]
    for offered in (setpoints, list(_RATES.items())):
        pairs = [pair for pair in offered if all(_logged(record, *pair) for record in records)]
        excited = [pair for pair in pairs if any(_excited(record, *pair) for record in records)]
        if excited or pairs:
            return tuple(excited or pairs)
    message = "The log holds neither a set-point that moves with its response nor a command with its rate."
    raise InsufficientDataError(
        "no pair of set-point and response is logged",
        needed="channels such as phi_setpoint and phi",
        remedy="name a pair with --input and --output, or the channels with --map",
        findings=[Finding(kind="missing_channel", severity="error", where="set-points", message=message)],
    )


def chosen_maneuvers(
    records: Sequence[FlightRecord], input: str, output: str, settings: MeasureSettings
) -> tuple[tuple[Flown, ...], tuple[Finding, ...]]:
    """Stretches to use for one pair: given ones, excitations, what looks like one, or else whole records.

    Raises
    ------
    InsufficientDataError
        No given segment lies inside a record.
    """
    axes = axes_of((input,), (output,))
    if settings.segments:
        return _given(records, axes, settings), ()
    parts = [_of_record(record, axes, input) for record in records]
    return tuple(item for flown, _ in parts for item in flown), tuple(f for _, findings in parts for f in findings)


def _of_record(record: FlightRecord, axes: Sequence[Axis], input: str) -> tuple[list[Flown], list[Finding]]:
    """Excitations of one record, or what looks like some, or all of it with a remark."""
    rich = [(record, m) for axis in axes for m in find_excitations(record, axis) if _is_rich(m)]
    likely = rich or [(record, m) for axis in axes for m in candidate_excitations(record, axis)]
    if likely:
        return likely, []
    whole = _whole(record, axes)
    return whole, [_read_whole(record, maneuver, input) for _, maneuver in whole]


def _is_rich(maneuver: Maneuver) -> bool:
    return maneuver.kind in RICH_KINDS or maneuver.origin == "given"


def _given(records: Sequence[FlightRecord], axes: Sequence[Axis], settings: MeasureSettings) -> tuple[Flown, ...]:
    segments = of_axes(settings.segments, axes)
    flown = tuple((record, described(record, m)) for record in records for m in segments if inside(record, m))
    if flown:
        return flown
    spans = ", ".join(f"{r.start_s:.1f} to {r.stop_s:.1f} s of {r.source.name}" for r in records)
    message = f"No given segment lies inside {spans}."
    raise InsufficientDataError(
        "no given segment lies inside the records",
        needed=f"a segment of {' or '.join(axes)} within {spans}",
        remedy="see the excitations that rotorid inspect finds",
        findings=[Finding(kind="no_excitation", severity="error", where=", ".join(axes), message=message)],
    )


def _whole(record: FlightRecord, axes: Sequence[Axis]) -> list[Flown]:
    try:
        return whole_flights([record], axes)
    except InsufficientDataError:
        # Nothing in the log tells take-off and landing.
        start_s, stop_s = record.start_s, record.stop_s
        if stop_s <= start_s:
            raise _one_sample(record) from None
        return [(record, Maneuver(axis=axes[0], kind="other", start_s=start_s, stop_s=stop_s, origin="found"))]


def _one_sample(record: FlightRecord) -> InsufficientDataError:
    message = f"{record.source.name} holds samples of one moment only"
    return InsufficientDataError(
        message,
        needed="a record of some seconds",
        remedy="check how it was written",
        findings=[Finding(kind="no_delay", severity="error", where=record.source.name, message=f"{message}.")],
    )


def _read_whole(record: FlightRecord, maneuver: Maneuver, input: str) -> Finding:
    return Finding(
        kind="no_excitation",
        severity="info",
        where=record.source.name,
        message=(
            f"No excitation was found in {record.source.name}, so {input} is read from {maneuver.start_s:.1f} to "
            f"{maneuver.stop_s:.1f} s."
        ),
        numbers={"start_s": maneuver.start_s, "stop_s": maneuver.stop_s},
    )


def _logged(record: FlightRecord, input: str, output: str) -> bool:
    """Whether both channels are there and the input moves."""
    if output not in record.channel_names:
        return False
    least = LEAST_MOTION.get(STANDARD_UNITS.get(input, "1"), 0.0)
    return any(
        values.size > 1 and float(np.ptp(values)) > least
        for topic, row in record.holding(input)
        if (values := topic.values[row][np.isfinite(topic.values[row])]).size
    )


def _excited(record: FlightRecord, input: str, output: str) -> bool:
    axes = axes_of((input,), (output,))
    return any(_is_rich(m) for axis in axes for m in find_excitations(record, axis)) or any(
        candidate_excitations(record, axis) for axis in axes
    )
