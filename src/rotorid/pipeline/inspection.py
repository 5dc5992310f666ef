"""What a log holds, and what it can support.

Which models a log can support, and what to change where it cannot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import AXES, LOWEST_RATE_HZ, FlightRecord, Maneuver, Topic
from rotorid.documents.base import Document
from rotorid.documents.result import FindingDocument, ManeuverDocument
from rotorid.errors import InsufficientDataError
from rotorid.models.library import RATE_AXES
from rotorid.pipeline.assemble import finding_documents, maneuver_document
from rotorid.pipeline.consistency import ChannelSkew, Stretch, check_consistency, stretches
from rotorid.pipeline.frequency_fit import LOWEST_TOP_RAD_S
from rotorid.pipeline.instruments import axis_of, find_instrument
from rotorid.pipeline.selection import RICH_KINDS
from rotorid.signal.airborne import Airborne, airborne
from rotorid.signal.excitations import candidate_excitations, find_excitations
from rotorid.signal.kinematics import KinematicCheck
from rotorid.typing import Axis, FloatArray, IntArray

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

_PerAxis: TypeAlias = Mapping[str, Sequence[Maneuver]]


class NeedDocument(Document):
    """One thing that a model needs, and whether the log has it."""

    need: str
    there: bool
    found: str


class SupportDocument(Document):
    """Whether a model can be identified from this log, and what to change if not."""

    possible: bool
    because: str
    remedy: str = ""
    instrument: str | None = None
    needs: list[NeedDocument] = Field(default_factory=list)


def supports(record: FlightRecord, found: _PerAxis, candidates: _PerAxis) -> dict[str, SupportDocument]:
    """Name of each rate model to whether the log supports it.

    Parameters
    ----------
    record
        The log.
    found, candidates
        Axis to excitations, and to stretches that may have been meant as such.
    """
    return {model: _support(record, axis.input, axis.output, found, candidates) for model, axis in RATE_AXES.items()}


def segment_of(axis: str, start_s: float, stop_s: float) -> str:
    """The value of ``--segment`` that takes an interval.

    Examples
    --------
    >>> segment_of("roll", 0.0, 17.5512)
    'roll:0.00:17.55'
    """
    return f"{axis}:{start_s:.2f}:{stop_s:.2f}"


def _support(record: FlightRecord, input: str, output: str, found: _PerAxis, candidates: _PerAxis) -> SupportDocument:
    name = axis_of(input)
    rates = {channel: _best_rate_hz(record, channel) for channel in (input, output)}
    rich = [maneuver for maneuver in found[name] if maneuver.kind in RICH_KINDS]
    tried = max(candidates[name], key=lambda maneuver: maneuver.duration_s, default=None)
    moved = rich or ([tried] if tried else [])
    instrument = find_instrument([(record, maneuver) for maneuver in moved], name) if moved else None
    verdict = _unlogged(record, rates) or _unflown(record, name, rich, found[name], tried)
    if verdict is None:
        estimate = f"joint estimate with {instrument}" if instrument else "direct estimate only; feedback may bias it"
        because = f"{len(rich)} rich excitation(s), {min(rates.values()):.0f} Hz, {estimate}"
        verdict = SupportDocument(possible=True, because=because, instrument=instrument)
    return verdict.model_copy(update={"needs": _needs(rates, name, rich, instrument)})


def _best_rate_hz(record: FlightRecord, channel: str) -> float:
    """Rate of the fastest topic that holds a channel; zero where none does."""
    return max((topic.sample_rate_hz for topic, _ in record.holding(channel)), default=0.0)


def _unlogged(record: FlightRecord, rates: Mapping[str, float]) -> SupportDocument | None:
    """The refusal of a log that lacks channels, or holds them too slowly."""
    advice = _LOGGING_ADVICE.get(record.source.format, _OTHER_LOGGING)
    missing = [name for name in rates if name not in record.channel_names]
    if missing:
        return SupportDocument(possible=False, because=f"the log lacks {' and '.join(missing)}", remedy=advice)
    slow = [f"{name} at {rate:.3g} Hz" for name, rate in rates.items() if rate < LOWEST_RATE_HZ]
    if slow:
        because = f"{' and '.join(slow)} is too slow; {LOWEST_RATE_HZ:.0f} Hz is the least"
        return SupportDocument(possible=False, because=because, remedy=advice)
    return None


def _unflown(
    record: FlightRecord, axis: Axis, rich: Sequence[Maneuver], found: Sequence[Maneuver], tried: Maneuver | None
) -> SupportDocument | None:
    """The refusal of a flight that does not excite an axis, or not fast enough; a candidate is pointed at."""
    if not rich:
        kinds = ", ".join(dict.fromkeys(maneuver.kind for maneuver in found))
        because = (
            f"only short maneuvers ({kinds}) excite this axis" if kinds else "no excitation of this axis was found"
        )
        flying = _FLYING_ADVICE.get(record.source.format, _OTHER_FLYING)
        remedy = flying.format(axis=axis, sid_axis=_SID_AXIS[axis])
        if tried is not None:
            remedy += f", or try --segment {segment_of(axis, tried.start_s, tried.stop_s)}"
        return SupportDocument(possible=False, because=because, remedy=remedy)
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s and maneuver.kind == "sweep"]
    if len(tops) == len(rich) and max(tops) < LOWEST_TOP_RAD_S:
        because = f"the sweeps end at {max(tops):.2g} rad/s; a rate model needs {LOWEST_TOP_RAD_S:g} rad/s and more"
        return SupportDocument(possible=False, because=because, remedy="fly a sweep that goes faster")
    return None


def _needs(
    rates: Mapping[str, float], axis: Axis, rich: Sequence[Maneuver], instrument: str | None
) -> list[NeedDocument]:
    """What a rate model needs, each with what the log has of it; without the last, feedback may bias the model."""
    logged = [
        NeedDocument(
            need=f"{name} at {LOWEST_RATE_HZ:.0f} Hz or more",
            there=rate >= LOWEST_RATE_HZ,
            found=f"{rate:.3g} Hz" if rate else "not logged",
        )
        for name, rate in rates.items()
    ]
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s]
    reach = f" up to {max(tops):.3g} rad/s" if tops else ""
    flown = ", ".join(dict.fromkeys(maneuver.kind.replace("_", " ") for maneuver in rich))
    return [
        *logged,
        NeedDocument(
            need=f"a sweep, multisine or random binary signal on {axis}",
            there=bool(rich),
            found=f"{len(rich)} ({flown}){reach}" if rich else "none found",
        ),
        NeedDocument(need="an instrument free of feedback", there=bool(instrument), found=instrument or "none found"),
    ]


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
    >>> from rotorid.data.record import Channel
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
        never = [warn(f.kind, f.where, f.message) for f in error.findings]
        unknown = remark("airborne", "log", f"When the vehicle flew is not known: {error.came.rstrip('.')}.")
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
