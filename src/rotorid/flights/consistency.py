"""Whether the sensors and clocks of a log agree with each other, and remarks on the data of its maneuvers.

Rates and specific force are compared with the attitude and the velocities of the log, topics that hold the same channel
with each other, and outputs with their commands and motors (:func:`check_consistency`), over the longest maneuver of
each axis, or the middle of the flight. What known filters explain is no error. :func:`data_quality` joins that with
what else limits the trust in a maneuver: saturation, inputs that move together, the battery.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.autopilots.filters import combined_response
from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.base import cached_by_value
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.quantity import milliseconds, with_error
from rotorid.data.record import AXES, LOWEST_RATE_HZ, Channel, FlightRecord, Maneuver, TimeHistory, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.flights import Flight
from rotorid.results.segment import Segment
from rotorid.signal.airborne import Airborne
from rotorid.signal.autopilot_filters import known_filters
from rotorid.signal.clock import resample
from rotorid.signal.kinematics import (
    ACCELERATIONS,
    EARTH_VELOCITIES,
    VELOCITIES,
    KinematicCheck,
    derivative,
    kinematic_consistency,
)
from rotorid.signal.motors import motor_limits
from rotorid.signal.quality import battery_sag, quality_findings
from rotorid.signal.skew import Relation, TimeSkew, time_skew
from rotorid.typing import Axis, FloatArray

SHORTEST_S = 20.0
"""Ten windows of two seconds: shorter checks are too uncertain, and the flight around an excitation is better."""

LONGEST_S = 120.0
"""Of a longer maneuver the middle is looked at."""

Nature: TypeAlias = Literal["same_channel", "vehicle"]

_SENSORS: Mapping[Axis, tuple[str, str | None]] = {
    "roll": ("p", "ay"),
    "pitch": ("q", "ax"),
    "yaw": ("r", None),
    "thrust": ("az", None),
}
"""Channels that move with an axis: first the output of its rate model."""

_TWICE_LOGGED: Mapping[Axis, tuple[str, ...]] = {
    "roll": ("p", "phi", "ay", "roll_command"),
    "pitch": ("q", "theta", "ax", "pitch_command"),
    "yaw": ("r", "psi", "yaw_command"),
    "thrust": ("az", "thrust_command"),
}
"""Channels of an axis that several topics may hold."""

_BAND_RAD_S = (0.0, 60.0)
"""Where skews, and delays of the known filters, are taken."""

_COVERED = 0.9
"""Share of a stretch that a channel has to cover to be compared."""

_SURE = 3.0
"""Standard deviations from which a skew counts."""

_MIX = "the motor mix"

_LONGEST_VEHICLE_S = 0.2
"""Without an excitation of its axis, a longer delay from command to output is that of a controller."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """An interval on the log's own clock, and the axes that move in it."""

    axes: tuple[Axis, ...]
    start_s: float
    stop_s: float


@dataclass(frozen=True, kw_only=True)
class ChannelSkew:
    """How far one signal of a log comes after another.

    Parameters
    ----------
    channel
        Of the vocabulary; where the nature is ``vehicle``, the output.
    reference, delayed
        Topics that hold the channel; where the nature is ``vehicle``, command and output.
    nature
        ``same_channel``: stamps and filters alone. ``vehicle``: also its delay and the lag of its motors.
    skew
        The measurement.
    sample_s
        Of the slower one.
    known_s
        Least and most of the skew that filters explain.
    stretch
        Where it was measured.
    """

    channel: str
    reference: str
    delayed: str
    nature: Nature
    skew: TimeSkew
    sample_s: float
    known_s: tuple[float, float]
    stretch: Stretch

    @property
    def unexplained_s(self) -> float:
        """Part of a time offset that no known filter explains; zero for a vehicle, whose delay is unknown."""
        low, high = self.known_s
        seconds = self.skew.seconds
        return 0.0 if self.nature == "vehicle" else min(seconds - low, 0.0) + max(seconds - high, 0.0)

    @property
    def suspicious(self) -> bool:
        """Whether more than a sample, and surely so, is left unexplained."""
        left = abs(self.unexplained_s)
        return left > self.sample_s and left > _SURE * self.skew.std

    @property
    def remedy(self) -> str:
        """The option of ``identify`` that takes a suspicious skew out; empty for others."""
        return f"--shift {self.channel}:{self.unexplained_s:.4f}" if self.suspicious else ""

    @property
    def seconds(self) -> float:
        """How far the delayed signal comes after the reference."""
        return self.skew.seconds

    @property
    def std_s(self) -> float:
        """One standard deviation of the skew."""
        return self.skew.std

    @property
    def coherence(self) -> float:
        """Mean coherence of the two signals."""
        return self.skew.coherence

    @property
    def start_s(self) -> float:
        """Where it was measured begins, on the log's own clock."""
        return self.stretch.start_s

    @property
    def stop_s(self) -> float:
        """Where it was measured ends."""
        return self.stretch.stop_s


@dataclass(frozen=True, kw_only=True)
class Consistency:
    """All that was compared.

    Parameters
    ----------
    checks
        Sensors against the kinematics, each with the stretch it was measured over.
    skews
        Signals against each other.
    findings
        Both in words, and what could not be done.
    """

    checks: tuple[tuple[Stretch, KinematicCheck], ...] = ()
    skews: tuple[ChannelSkew, ...] = ()
    findings: tuple[Finding, ...] = ()


def stretches(
    record: FlightRecord, maneuvers: Sequence[Maneuver], flight: Airborne | None = None
) -> tuple[Stretch, ...]:
    """Where to look: the longest maneuver of each axis, or else the middle of the longest flight.

    Parameters
    ----------
    maneuvers
        Of any axis; those below 20 s are too short.
    flight
        Flights, where they are known; else the whole record stands in.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=())
    >>> sweep = Maneuver(axis="roll", kind="sweep", start_s=10.0, stop_s=200.0)
    >>> stretches(record, [sweep])
    (Stretch(axes=('roll',), start_s=45.0, stop_s=165.0),)
    """
    chosen = []
    for axis in AXES:
        own = [m for m in maneuvers if m.axis == axis and m.duration_s >= SHORTEST_S]
        if own:
            longest = max(own, key=lambda maneuver: maneuver.duration_s)
            chosen.append(_middle((axis,), longest.start_s, longest.stop_s))  # type: ignore[arg-type]
    if chosen:
        return tuple(chosen)
    return (_middle(AXES, *(flight.longest if flight else (record.start_s, record.stop_s))),)  # type: ignore[arg-type]


def check_consistency(record: FlightRecord, where: Sequence[Stretch]) -> Consistency:
    """Compare the sensors of a log with the kinematics, and its clocks with each other.

    Rates are compared with the attitude, specific force with velocities and attitude, topics that hold the same
    channel with each other, and the output of an axis with its command and its motors. What a known filter of the
    autopilot explains is no error.

    Parameters
    ----------
    where
        See :func:`stretches`.

    Returns
    -------
    Consistency
        Never an exception: what cannot be compared stands among the findings.
    """
    found = [_of_stretch(record, stretch) for stretch in where]
    skews = tuple(skew for one in found for skew in one.skews)
    return Consistency(
        checks=tuple(check for one in found for check in one.checks),
        skews=skews,
        findings=(*(finding for one in found for finding in one.findings), *map(_skew_finding, skews)),
    )


@cached_by_value
def _of_stretch(record: FlightRecord, stretch: Stretch) -> Consistency:
    """One stretch, which several measurements of the same maneuvers ask about; of the skews there is no finding yet."""
    found = list(_kinematics(record, stretch))
    return Consistency(
        checks=tuple((stretch, check) for channels, _ in found for check in channels),
        skews=(*_same_channels(record, stretch), *_vehicle(record, stretch)),
        findings=tuple(finding for _, remarks in found for finding in remarks),
    )


def _middle(axes: tuple[Axis, ...], start_s: float, stop_s: float) -> Stretch:
    spare_s = max(stop_s - start_s - LONGEST_S, 0.0)
    return Stretch(axes=axes, start_s=start_s + 0.5 * spare_s, stop_s=stop_s - 0.5 * spare_s)


def _kinematics(record: FlightRecord, stretch: Stretch) -> Iterator[tuple[Sequence[KinematicCheck], Sequence[Finding]]]:
    """Rates, then specific force: velocities are slower and would drag the rates down to their own."""
    moving = {name for axis in stretch.axes for name in _SENSORS[axis] if name}
    velocities = VELOCITIES if set(VELOCITIES) <= set(record.channel_names) else EARTH_VELOCITIES
    for sensors, references in (
        ([name for name in RATES if name in moving], ATTITUDE),
        ([name for name in ACCELERATIONS if name in moving], (*velocities, *ATTITUDE)),
    ):
        present = [name for name in sensors if name in record.channel_names]
        there = [name for name in references if name in record.channel_names]
        if not present or not there or (sensors[0] in ACCELERATIONS and len(there) < len(references)):
            continue
        needed = RATES if velocities is VELOCITIES and sensors[0] in ACCELERATIONS else ()
        names = dict.fromkeys((*present, *there, *(name for name in needed if name in record.channel_names)))
        try:
            history = _longest(record, tuple(names), stretch)
            lags = {name: _kinematic_lag(record, history, name) for name in present}
            result = kinematic_consistency(history, channels=present, known_lag_s=lags)
        except InsufficientDataError as error:
            yield (), [_unchecked(present, error)]
        else:
            yield result.checks, result.findings


def _same_channels(record: FlightRecord, stretch: Stretch) -> Iterator[ChannelSkew]:
    """Each channel that moves, in its best topic against the others that cover the stretch."""
    for name in dict.fromkeys(name for axis in stretch.axes for name in _TWICE_LOGGED[axis]):
        sources = [(topic, row) for topic, row in record.holding(name) if _covers(topic, stretch)]
        for other in sources[1:]:
            try:
                skew, rate_hz = _between(record, sources[0], other, stretch)
            except InsufficientDataError:
                # Signals that barely move are not coherent; the channels of other axes show the offset instead.
                continue
            (low, high), (least, most) = (filter_lag(record, t, t.channels[row]) for t, row in (sources[0], other))
            yield ChannelSkew(
                channel=name,
                reference=sources[0][0].place(sources[0][1]),
                delayed=other[0].place(other[1]),
                nature="same_channel",
                skew=skew,
                sample_s=1.0 / rate_hz,
                known_s=(least - high, most - low),
                stretch=stretch,
            )


def _vehicle(record: FlightRecord, stretch: Stretch) -> Iterator[ChannelSkew]:
    """Command and motors of each axis against its output."""
    for axis in stretch.axes:
        output = _SENSORS[axis][0]
        motors = tuple(name for name in _motors(record) if _fast(record, name))
        for names in ((f"{axis}_command",), motors):
            if not names or not all(_fast(record, name) for name in (*names, output)):
                continue
            try:
                history = _longest(record, (*names, output), stretch)
                history = history if names != motors else _mixed(history, motors, output)
                relation: Relation = "opposite" if axis == "thrust" else "integral"
                reference = history.names[0]
                skew = time_skew(
                    history, reference=reference, delayed=output, band_rad_s=_BAND_RAD_S, relation=relation
                )
            except InsufficientDataError:
                # Nothing moves coherently: a hover says nothing of the delay of a vehicle.
                continue
            if len(stretch.axes) > 1 and not _SURE * skew.std < skew.seconds < _LONGEST_VEHICLE_S:
                # Without an excitation of its own, an axis shows its controller as often as itself.
                continue
            yield ChannelSkew(
                channel=output,
                reference=reference,
                delayed=output,
                nature="vehicle",
                skew=skew,
                sample_s=1.0 / history.sample_rate_hz,
                known_s=(0.0, 0.0),
                stretch=stretch,
            )


def _between(
    record: FlightRecord, first: tuple[Topic, int], second: tuple[Topic, int], stretch: Stretch
) -> tuple[TimeSkew, float]:
    """Skew of one channel between two topics, and the rate at which they were compared."""
    topics = []
    for (topic, row), name in ((first, "reference"), (second, "delayed")):
        channel = topic.channels[row]
        values = np.unwrap(topic.values[row]) if channel.name in ATTITUDE else topic.values[row]
        topics.append(replace(topic, channels=(replace(channel, name=name),), values=values[None]))
    history = _longest(replace(record, topics=tuple(topics)), ("reference", "delayed"), stretch)
    skew = time_skew(history, reference="reference", delayed="delayed", band_rad_s=_BAND_RAD_S, relation="same")
    return skew, history.sample_rate_hz


def _mixed(history: TimeHistory, motors: Sequence[str], output: str) -> TimeHistory:
    """The motors as one signal: their mean for heave, else each with the sign with which it turns the axis.

    No geometry is needed: which way a motor turns the vehicle shows in the angular acceleration.
    """
    values = np.stack([history[name] for name in motors])
    mean = values.mean(axis=0)
    if output == "az":
        mix = mean
    else:
        centered = values - mean
        centered = centered - centered.mean(axis=1, keepdims=True)
        mix = np.sign(centered @ derivative(history[output], history.sample_rate_hz)) @ centered
    channel = history.channels[history.names.index(output)]
    return replace(history, values=np.stack([mix, history[output]]), channels=(Channel(name=_MIX, unit="1"), channel))


def _longest(record: FlightRecord, names: Sequence[str], stretch: Stretch) -> TimeHistory:
    return resample(record, channels=names, start_s=stretch.start_s, stop_s=stretch.stop_s).longest


def _kinematic_lag(record: FlightRecord, history: TimeHistory, name: str) -> tuple[float, float]:
    """Lag of a sensor behind the attitude explained by its filters: zero if they filter the attitude too."""
    source = history.channels[history.names.index(name)].source
    lags = [
        filter_lag(record, t, t.channels[row]) for t, row in record.holding(name) if t.channels[row].source == source
    ]
    return min((0.0, *(low for low, _ in lags))), max((0.0, *(high for _, high in lags)))


def filter_lag(record: FlightRecord, topic: Topic, channel: Channel) -> tuple[float, float]:
    """Least and most delay of the known filters of a channel over the band, at both rates they may have worked at."""
    delays = [0.0]
    omega = np.linspace(0.1, 1.0, 10) * _BAND_RAD_S[1]
    chains = [
        known_filters(record, channel.source, sensor_rate_hz=rate) for rate in (None, topic.sample_rate_hz or None)
    ]
    found = [chain for chain in chains if chain]
    for chain in found:
        delays += list(-np.unwrap(np.angle(combined_response(chain, omega))) / omega)
    delays = delays[1:] if found else delays
    return float(min(delays)), float(max(delays))


def _covers(topic: Topic, stretch: Stretch) -> bool:
    if topic.time_s.size < 2:
        return False
    start_s, stop_s = max(topic.time_s[0], stretch.start_s), min(topic.time_s[-1], stretch.stop_s)
    return bool(stop_s - start_s >= _COVERED * (stretch.stop_s - stretch.start_s))


def _fast(record: FlightRecord, name: str) -> bool:
    return any(topic.sample_rate_hz >= LOWEST_RATE_HZ for topic, _ in record.holding(name))


def _motors(record: FlightRecord) -> tuple[str, ...]:
    return record.outputs


def _unchecked(names: Sequence[str], error: InsufficientDataError) -> Finding:
    where = ", ".join(names)
    return remark(
        "kinematics_unchecked", where, f"{where} could not be checked against the kinematics: {error.came.rstrip('.')}."
    )


def known_words(low: float, high: float, seconds: float) -> str:
    """A delay compared with the delay of the known filters, in words."""
    if (low, high) == (0.0, 0.0):
        return "no filter is known"
    near, far = sorted((abs(low), abs(high)))
    if low < 0.0 < high:
        return f"known filters explain {1e3 * low:.1f} to {1e3 * high:.1f} ms"
    words = f"{1e3 * near:.1f} to {1e3 * far:.1f} ms"
    if (low + high) * seconds >= 0.0:
        return f"known filters explain {words}"
    return f"known filters would shift it by {words} in the opposite direction"


def _skew_finding(item: ChannelSkew) -> Finding:
    skew = item.skew
    words = f"{milliseconds(abs(skew.seconds), skew.std)} ms {'after' if skew.seconds >= 0.0 else 'before'}"
    low, high = item.known_s
    if item.nature == "vehicle":
        message = (
            f"{item.delayed} is {words} {item.reference}: vehicle delay, motor lag, filters and any time-stamp error "
            "together, which one record cannot separate."
        )
    else:
        message = f"{item.channel} of {item.delayed} is {words} that of {item.reference}"
        message += f"; {known_words(low, high, skew.seconds)}."
        if item.suspicious:
            message += (
                f" One sample is {1e3 * item.sample_s:.2f} ms. If the stamps of {item.reference} are wrong, "
                f"add {item.remedy} to rotorid identify."
            )
    return (warn if item.suspicious else remark)(
        "clock_skew",
        f"{item.delayed}/{item.reference}: {item.channel}",
        message,
        skew_s=skew.seconds,
        std_s=skew.std,
        sample_s=item.sample_s,
        known_low_s=low,
        known_high_s=high,
    )


_REMARKED_SAG_PERCENT = 1.0

_LARGEST_SCALE_ERROR = 0.3
"""Beyond this no error of a sensor is left, but one of units or axes."""


def data_quality(
    flights: Sequence[Flight], segments: Sequence[Segment], inputs: Sequence[str], agreement: Sequence[Consistency]
) -> tuple[Finding, ...]:
    """Remarks on all maneuvers, each kind and place once; of several maneuvers the first that shows it speaks."""
    limits = {flight.record.source.name: motor_limits(flight.record) for flight in flights}
    remarks = [
        finding
        for segment in segments
        for finding in quality_findings(
            segment.history, axis=segment.maneuver.axis, accounted=inputs, limits=limits.get(segment.record)
        )
    ]
    sags = (battery_sag(flight.record, flight.maneuver) for flight in flights)
    remarks += [sag for sag in sags if sag and abs(sag.numbers["change_percent"]) >= _REMARKED_SAG_PERCENT]
    remarks += [finding for consistency in agreement for finding in consistency.findings]
    return tuple({(finding.kind, finding.where): finding for finding in reversed(remarks)}.values())


def sensor_agreement(flights: Sequence[Flight]) -> tuple[Consistency, ...]:
    """Whether sensors and clocks agree over the longest maneuver of each axis, in each log.

    Of short maneuvers the flight from the first to the last is looked at, and nothing is remarked on.
    """
    records = {id(flight.record): flight.record for flight in flights}
    groups = [
        (record, [flight.maneuver for flight in flights if flight.record is record]) for record in records.values()
    ]
    return tuple(found for group in groups if (found := _agreement(*group)) is not None)


def _agreement(record: FlightRecord, maneuvers: Sequence[Maneuver]) -> Consistency | None:
    if max(maneuver.duration_s for maneuver in maneuvers) >= SHORTEST_S:
        return check_consistency(record, stretches(record, maneuvers))
    axes = tuple(axis for axis in AXES if any(maneuver.axis == axis for maneuver in maneuvers))
    start_s, stop_s = min(maneuver.start_s for maneuver in maneuvers), max(maneuver.stop_s for maneuver in maneuvers)
    if stop_s - start_s < SHORTEST_S:
        return None
    checks: list[tuple[Stretch, KinematicCheck]] = []
    whole = _middle(axes, start_s, stop_s)  # type: ignore[arg-type]
    for found, _ in _kinematics(record, whole):
        checks += [(whole, check) for check in found]
    return Consistency(checks=tuple(checks))


def sensor_errors(agreement: Sequence[Consistency], outputs: Sequence[str]) -> FloatArray | None:
    """How far outputs disagree with the attitude of their logs, in the log where they do so most.

    It is unknown which of the two is wrong, so a response may be off by the whole difference.

    Parameters
    ----------
    agreement
        See :func:`sensor_agreement`.
    outputs
        Channels; only rates are judged, since specific force hangs on much else.

    Returns
    -------
    numpy.ndarray or None
        Relative error of the scale and delay in seconds, shape ``(outputs, 2)``; ``None`` where nothing disagrees.

    Raises
    ------
    InsufficientDataError
        A rate has the wrong sign, or another scale by 30 % or more: the log holds it in another unit or axis.
    """
    errors = np.zeros((len(outputs), 2))
    for check in _contradictions(agreement):
        if check.channel not in outputs:
            continue
        off = check.scale - 1.0
        if check.relation != "same" or abs(off) > _LARGEST_SCALE_ERROR:
            raise InsufficientDataError(
                f"{check.channel} is {check.scale:.2f} times what {check.against} gives{_looks(check)}",
                needed="a rate that matches the derivative of the logged attitude",
                remedy="check signs, units and axes of both; rotorid inspect compares them",
                findings=[refusal("kinematic_inconsistency", check.channel, _contradiction(check), scale=check.scale)],
            )
        low, high = check.known_lag_s
        late = min(check.lag_s - low, 0.0) + max(check.lag_s - high, 0.0)
        place = outputs.index(check.channel)
        errors[place] = np.maximum(errors[place], np.abs([off, late]))
    return errors if errors.any() else None


def _contradictions(agreement: Sequence[Consistency]) -> Iterator[KinematicCheck]:
    for consistency in agreement:
        for _, check in consistency.checks:
            if check.verdict == "inconsistent" and check.channel in RATES:
                yield check


def _looks(check: KinematicCheck) -> str:
    return "" if check.relation == "same" else f", like its {check.relation}"


def _contradiction(check: KinematicCheck) -> str:
    return (
        f"{check.channel} is {with_error(check.scale, check.scale_std)} times what {check.against} "
        f"gives{_looks(check)}: one of them has a wrong unit, axis or sign, so no model would be right."
    )
