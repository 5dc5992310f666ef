"""What a log holds, and what it can support."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.data.channel import AXES
from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.assemble import finding_documents, maneuver_document
from rotorid.pipeline.consistency import ChannelSkew, Stretch, check_consistency, stretches
from rotorid.pipeline.document import FindingDocument, ManeuverDocument
from rotorid.pipeline.document_base import Document
from rotorid.pipeline.supports import SupportDocument, segment_of, supports
from rotorid.signal.airborne import Airborne, airborne
from rotorid.signal.kinematics import KinematicCheck
from rotorid.signal.segment import candidate_excitations, find_excitations
from rotorid.typing import FloatArray, IntArray

_GAP_STEPS = 2.5

_SETTINGS = (
    *("LOG_BITMASK", "SCHED_LOOP_RATE", "INS_GYRO_FILTER", "INS_ACCEL_FILTER", "MOT_THST_EXPO", "FRAME_CLASS"),
    *("FRAME_TYPE", "ATC_RAT_RLL_P", "ATC_RAT_PIT_P", "ATC_RAT_YAW_P", "SID_AXIS", "SID_MAGNITUDE"),
    *("SDLOG_PROFILE", "IMU_INTEG_RATE", "IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF", "IMU_ACCEL_CUTOFF", "THR_MDL_FAC"),
    *("CA_AIRFRAME", "MC_ROLLRATE_P", "MC_PITCHRATE_P", "MC_YAWRATE_P"),
)
"""Parameters of the autopilot that decide what is logged, filtered and fed back: the first ones to look at."""


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


class CandidateDocument(ManeuverDocument):
    """A stretch that moves an axis enough to try, and the value of ``--segment`` that takes it."""

    segment: str


class BatteryDocument(Document):
    """Voltage of the battery at both ends of its record, and the lowest in between."""

    start_v: float
    stop_v: float
    lowest_v: float


class FlightDocument(Document):
    """An interval in the air, and what told."""

    start_s: float
    stop_s: float
    seen_in: str


class KinematicsDocument(Document):
    """A sensor against the motion that attitude or velocities give: scale, bias and lag with standard deviations."""

    channel: str
    against: str
    start_s: float
    stop_s: float
    scale: float
    scale_std: float
    bias: float
    bias_std: float
    lag_s: float
    lag_std_s: float
    cancellation: float
    verdict: Literal["consistent", "inconsistent", "uncertain"]


class SkewDocument(Document):
    """How far one signal comes after another, what filters explain of it, and the ``--shift`` for the rest."""

    channel: str
    reference: str
    delayed: str
    nature: Literal["same_channel", "vehicle"]
    start_s: float
    stop_s: float
    seconds: float
    std_s: float
    sample_s: float
    coherence: float
    known_s: tuple[float, float]
    remedy: str = ""


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
    candidates: list[CandidateDocument] = Field(default_factory=list)
    flights: list[FlightDocument] = Field(default_factory=list)
    kinematics: list[KinematicsDocument] = Field(default_factory=list)
    skews: list[SkewDocument] = Field(default_factory=list)
    battery: BatteryDocument | None = None
    settings: dict[str, float] = Field(default_factory=dict)


def inspect(record: FlightRecord) -> InspectDocument:
    """Say what a record holds: channels, rates, gaps, flights, excitations, whether it agrees with itself, and its use.

    Parameters
    ----------
    record
        A log as :func:`rotorid.read` gives it.

    Returns
    -------
    InspectDocument
        What ``rotorid inspect --json`` prints. A model counts as supported when its channels are logged fast enough
        and something rich enough was flown on its axis; whether the response is coherent only ``identify`` tells.
        Checks that cannot be done stand among the findings.

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
    found = {axis: find_excitations(record, axis) for axis in AXES}  # type: ignore[arg-type]
    candidates = {axis: candidate_excitations(record, axis) for axis in AXES}  # type: ignore[arg-type]
    flight, told = _flight(record)
    consistency = check_consistency(record, stretches(record, _in_time(*found.values()), flight))
    return InspectDocument(
        name=record.source.name,
        format=record.source.format,
        firmware=record.source.firmware,
        sha256=record.source.sha256,
        start_s=record.start_s,
        stop_s=record.stop_s,
        parameters=len(record.parameters),
        channels=[_channel(topic, row) for topic in record.topics for row in range(len(topic.channels))],
        excitations=[maneuver_document(record, maneuver) for maneuver in _in_time(*found.values())],
        supports=supports(record, found, candidates),
        findings=finding_documents((*record.findings, *told, *consistency.findings)),
        candidates=[_candidate(record, maneuver) for maneuver in _in_time(*candidates.values())],
        flights=_flights(flight) if flight else [],
        kinematics=[_kinematics(stretch, check) for stretch, check in consistency.checks],
        skews=[_skew(skew) for skew in consistency.skews],
        battery=_battery(record),
        settings={name: record.parameters[name] for name in _SETTINGS if name in record.parameters},
    )


def coverage(time_s: FloatArray) -> tuple[tuple[float, float], ...]:
    """Stretches without a gap, shape of ``time_s`` ``(samples,)``: steps of more than 2.5 usual ones part them.

    Examples
    --------
    >>> coverage(np.array([0.0, 0.1, 0.2, 0.9, 1.0]))
    ((0.0, 0.2), (0.9, 1.0))
    """
    time_s = time_s[np.isfinite(time_s)]
    if not time_s.size:
        return ()
    breaks = _gaps(time_s)
    starts = np.concatenate([[0], breaks + 1])
    stops = np.concatenate([breaks, [time_s.size - 1]])
    return tuple((float(time_s[a]), float(time_s[b])) for a, b in zip(starts, stops, strict=True))


def _in_time(*groups: Sequence[Maneuver]) -> list[Maneuver]:
    return sorted((maneuver for group in groups for maneuver in group), key=lambda maneuver: maneuver.start_s)


def _candidate(record: FlightRecord, maneuver: Maneuver) -> CandidateDocument:
    plain = maneuver_document(record, maneuver)
    return CandidateDocument(**plain.model_dump(), segment=segment_of(maneuver.axis, maneuver.start_s, maneuver.stop_s))


def _flight(record: FlightRecord) -> tuple[Airborne | None, tuple[Finding, ...]]:
    """The flights, or why they are not known: a log from the bench can be looked at too."""
    try:
        found = airborne(record)
    except InsufficientDataError as error:
        never = [Finding(kind=f.kind, severity="warning", where=f.where, message=f.message) for f in error.findings]
        unknown = Finding(
            kind="airborne",
            severity="info",
            where="log",
            message=f"When the vehicle flew is not known: {error.came.rstrip('.')}.",
        )
        return None, tuple(never) or (unknown,)
    return found, found.findings


def _flights(flight: Airborne) -> list[FlightDocument]:
    return [FlightDocument(start_s=start, stop_s=stop, seen_in=flight.seen_in) for start, stop in flight.intervals]


def _kinematics(stretch: Stretch, check: KinematicCheck) -> KinematicsDocument:
    return KinematicsDocument(
        channel=check.channel,
        against=check.against,
        start_s=stretch.start_s,
        stop_s=stretch.stop_s,
        scale=check.scale,
        scale_std=check.scale_std,
        bias=check.bias,
        bias_std=check.bias_std,
        lag_s=check.lag_s,
        lag_std_s=check.lag_std_s,
        cancellation=check.cancellation,
        verdict=check.verdict,
    )


def _skew(item: ChannelSkew) -> SkewDocument:
    return SkewDocument(
        channel=item.channel,
        reference=item.reference,
        delayed=item.delayed,
        nature=item.nature,
        start_s=item.stretch.start_s,
        stop_s=item.stretch.stop_s,
        seconds=item.skew.seconds,
        std_s=item.skew.std,
        sample_s=item.sample_s,
        coherence=item.skew.coherence,
        known_s=item.known_s,
        remedy=item.remedy,
    )


def _battery(record: FlightRecord) -> BatteryDocument | None:
    for topic, row in record.holding("battery_voltage"):
        volts = topic.values[row][np.isfinite(topic.values[row])]
        if volts.size:
            return BatteryDocument(start_v=float(volts[0]), stop_v=float(volts[-1]), lowest_v=float(volts.min()))
    return None


def _gaps(time_s: FloatArray) -> IntArray:
    """Index of the last sample before each gap."""
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if steps.size else 0.0
    return np.flatnonzero(steps > _GAP_STEPS * usual) if usual > 0.0 else np.empty(0, dtype=np.int64)


def _channel(topic: Topic, row: int) -> ChannelDocument:
    gaps = np.diff(topic.time_s)[_gaps(topic.time_s)]
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
