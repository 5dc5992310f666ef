"""What a log holds, and what it can support."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.data.channel import AXES, LOWEST_RATE_HZ
from rotorid.data.record import FlightRecord, Topic
from rotorid.models.rate import RATE_AXES
from rotorid.pipeline.assemble import finding_documents, maneuver_document
from rotorid.pipeline.document import Document, FindingDocument, ManeuverDocument
from rotorid.pipeline.instruments import axis_of, find_instrument
from rotorid.pipeline.selection import RICH_KINDS
from rotorid.pipeline.support import LOWEST_TOP_RAD_S
from rotorid.signal.segment import find_excitations

_GAP_STEPS = 2.5

_LOGGING_ADVICE = {
    "ArduPilot DataFlash": "set LOG_BITMASK so that fast attitude (bit 0) and fast IMU (bit 18) are logged",
    "PX4 ULog": "set SDLOG_PROFILE to 25 (default, system identification and high rate)",
}
_OTHER_LOGGING = "log it, or name its source with --map"
_FLYING_ADVICE = {
    "ArduPilot DataFlash": "fly SYSTEMID mode with SID_AXIS {sid_axis}",
    "PX4 ULog": "sweep the {axis} stick, slow to fast, for a minute or more",
}
_OTHER_FLYING = "fly a {axis} sweep, slow to fast, for a minute or more, or name one with --segment"
_SID_AXIS = {"roll": 10, "pitch": 11, "yaw": 12, "thrust": 13}


class ChannelDocument(Document):
    """A channel in one topic: the same channel may stand in several."""

    name: str
    unit: str
    source: str
    topic: str
    rate_hz: float
    samples: int
    start_s: float | None
    stop_s: float | None
    gaps: int
    longest_gap_s: float


class SupportDocument(Document):
    """Whether a model can be identified from this log, and what to change if not."""

    possible: bool
    because: str
    remedy: str = ""
    instrument: str | None = None


class InspectDocument(Document):
    """Answer of ``inspect``."""

    schema_name: Annotated[Literal["rotorid.inspect/1"], Field(alias="schema")] = "rotorid.inspect/1"
    name: str
    format: str
    firmware: str
    sha256: str
    start_s: float
    stop_s: float
    parameters: int
    channels: list[ChannelDocument]
    excitations: list[ManeuverDocument]
    supports: dict[str, SupportDocument]
    findings: list[FindingDocument]


def inspect(record: FlightRecord) -> InspectDocument:
    """Say what a record holds: channels, rates, gaps, excitations, and which models it can support.

    Parameters
    ----------
    record
        A log as :func:`rotorid.read` gives it.

    Returns
    -------
    InspectDocument
        What ``rotorid inspect --json`` prints. A model counts as supported when its channels are logged fast enough
        and something rich enough was flown on its axis; whether the response is coherent only ``identify`` tells.

    Examples
    --------
    >>> from rotorid.data.channel import Channel
    >>> from rotorid.data.record import Source, Topic
    >>> time_s = np.arange(0.0, 1.0, 0.01)
    >>> gyro = Topic(
    ...     name="gyro", time_s=time_s, channels=(Channel(name="p", unit="rad/s"),), values=np.zeros((1, 100))
    ... )
    >>> record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=""), topics=(gyro,))
    >>> inspect(record).supports["rate.roll"].because
    'the log lacks roll_command'
    """
    maneuvers = sorted((m for axis in AXES for m in find_excitations(record, axis)), key=lambda m: m.start_s)  # type: ignore[arg-type]
    return InspectDocument(
        name=record.source.name,
        format=record.source.format,
        firmware=record.source.firmware,
        sha256=record.source.sha256,
        start_s=record.start_s,
        stop_s=record.stop_s,
        parameters=len(record.parameters),
        channels=[_channel(topic, row) for topic in record.topics for row in range(len(topic.channels))],
        excitations=[maneuver_document(record, maneuver) for maneuver in maneuvers],
        supports={model: _support(record, model) for model in RATE_AXES},
        findings=finding_documents(record.findings),
    )


def _channel(topic: Topic, row: int) -> ChannelDocument:
    steps = np.diff(topic.time_s)
    usual = float(np.median(steps)) if steps.size else 0.0
    gaps = steps[steps > _GAP_STEPS * usual] if usual > 0.0 else steps[:0]
    channel = topic.channels[row]
    return ChannelDocument(
        name=channel.name,
        unit=channel.unit,
        source=channel.source,
        topic=topic.name,
        rate_hz=topic.sample_rate_hz,
        samples=topic.time_s.size,
        start_s=float(topic.time_s[0]) if topic.time_s.size else None,
        stop_s=float(topic.time_s[-1]) if topic.time_s.size else None,
        gaps=int(gaps.size),
        longest_gap_s=float(gaps.max()) if gaps.size else 0.0,
    )


def _support(record: FlightRecord, model: str) -> SupportDocument:
    axis = RATE_AXES[model]
    advice = _LOGGING_ADVICE.get(record.source.format, _OTHER_LOGGING)
    missing = [name for name in (axis.input, axis.output) if name not in record.channel_names]
    if missing:
        return SupportDocument(possible=False, because=f"the log lacks {' and '.join(missing)}", remedy=advice)
    rates = {name: max(t.sample_rate_hz for t, _ in record.holding(name)) for name in (axis.input, axis.output)}
    slow = [f"{name} at {rate:.3g} Hz" for name, rate in rates.items() if rate < LOWEST_RATE_HZ]
    if slow:
        because = f"{' and '.join(slow)} is too slow; {LOWEST_RATE_HZ:.0f} Hz is the least"
        return SupportDocument(possible=False, because=because, remedy=advice)
    found = find_excitations(record, axis_of(axis.input))
    rich = [maneuver for maneuver in found if maneuver.kind in RICH_KINDS]
    if not rich:
        kinds = ", ".join(dict.fromkeys(maneuver.kind for maneuver in found))
        because = (
            f"only short maneuvers ({kinds}) excite this axis" if kinds else "no excitation of this axis was found"
        )
        flying = _FLYING_ADVICE.get(record.source.format, _OTHER_FLYING)
        name = axis_of(axis.input)
        return SupportDocument(
            possible=False, because=because, remedy=flying.format(axis=name, sid_axis=_SID_AXIS[name])
        )
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s and maneuver.kind == "sweep"]
    if len(tops) == len(rich) and max(tops) < LOWEST_TOP_RAD_S:
        because = f"the sweeps end at {max(tops):.2g} rad/s; a rate model needs {LOWEST_TOP_RAD_S:g} rad/s and more"
        return SupportDocument(possible=False, because=because, remedy="fly a sweep that goes faster")
    instrument = find_instrument([(record, maneuver) for maneuver in rich], axis_of(axis.input))
    estimate = f"joint estimate with {instrument}" if instrument else "direct estimate only; feedback may bias it"
    return SupportDocument(
        possible=True,
        because=f"{len(rich)} rich excitation(s), {min(rates.values()):.0f} Hz, {estimate}",
        instrument=instrument,
    )
