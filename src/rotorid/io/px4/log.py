"""PX4 logs as flight records: which field of which topic is which channel, in the names of PX4 old and new.

One table serves every container that holds PX4's topics: ULog files, folders of ``ulog2csv``, and bags. What a careful
engineer remarks before using a log comes with the parameter of the logger that mends it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.autopilots.advice import unread_words
from rotorid.autopilots.px4.advice import gap_advice, logging_advice
from rotorid.autopilots.px4.versions import firmware_shown
from rotorid.data.display import capital
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic, Unread
from rotorid.errors import LogError
from rotorid.frames import euler_from_quaternion
from rotorid.io.flags import vehicle_findings
from rotorid.io.parameters import kept_parameters, parameters_changed
from rotorid.io.px4.outputs import OUTPUT_FIELDS, motor_outputs, rate_hz_of
from rotorid.io.px4.sensors import SENSOR_FIELDS, sensor_topics
from rotorid.io.px4.status import STATUS_FIELDS, status_of
from rotorid.io.px4.ulog import MAGIC, extract
from rotorid.typing import AnyArray, FloatArray

FORMAT = "PX4 ULog"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a ULog."""
    return head.startswith(MAGIC)


def read(path: Path, source: Source) -> FlightRecord:
    """Read a PX4 log.

    Parameters
    ----------
    path
        A ULog file.
    source
        Name, format and hash of the file as the user gave it.

    Raises
    ------
    LogError
        The file cannot be parsed, or holds no topic that the package has a name for.
    """
    log = extract(path, {**dict.fromkeys(NEAR, ()), **wanted_fields()})
    facts = {
        "parameters": kept_parameters(log.parameters),
        "changed": log.changed,
        "dropouts": log.dropouts,
        "damage": log.damage,
        "size_bytes": log.size_bytes,
        "subscribed": log.subscribed,
    }
    return record_of(log.arrays, facts, replace(source, firmware=_firmware(log.info)))


def _firmware(info: Mapping[str, str | int]) -> str:
    """``PX4 1.17.0``, from the packed number that the log carries: major, minor, patch, kind of release."""
    release = info.get("ver_sw_release")
    if not isinstance(release, int) or release == 0:
        return str(info.get("sys_name", ""))
    kinds = {0: " (development)", 64: " (alpha)", 128: " (beta)", 192: " (release candidate)", 255: ""}
    kind = kinds[max(limit for limit in kinds if limit <= release & 0xFF)]
    return f"{info.get('sys_name', 'PX4')} {release >> 24 & 0xFF}.{release >> 16 & 0xFF}.{release >> 8 & 0xFF}{kind}"


_SAMPLED = ("timestamp_sample", "timestamp")
_PUBLISHED = ("timestamp",)
_LARGEST_STAMP_DELAY_US = 100_000
_MOSTLY_VALID = 0.9


@dataclass(frozen=True, kw_only=True, slots=True)
class Rule:
    """Fields of a topic and the channels that they are.

    Parameters
    ----------
    topic, fields
        As the log names them. PX4 logs SI units and FRD/NED axes throughout.
    channels
        One for each field; three Euler angles for the four parts of a quaternion.
    sign
        Factor of the values.
    clocks
        Stamps to use, best first. A measurement is stamped when the motion was sampled, a command when it was
        published: between those two instants lies the delay of the airframe, without that of the controller.
    optional
        Fields that are absent or never a number are left out one by one; otherwise all must be there.
    last_resort
        Used only when no other topic holds the channels: the raw axes of a sensor.
    named
        Field with the name under which the values were published, and that name; for topics that many signals share.
    """

    topic: str
    fields: tuple[str, ...]
    channels: tuple[str, ...]
    sign: float = 1.0
    clocks: tuple[str, ...] = _PUBLISHED
    optional: bool = False
    last_resort: bool = False
    named: tuple[str, str] | None = None

    @property
    def letters(self) -> dict[str, int]:
        """Fields of the letters of the name, and what they must be; a zero ends a name."""
        field, name = self.named or ("", "")
        return {f"{field}[{place}]": letter for place, letter in enumerate(name.encode() + b"\0") if field}


def _rule(topic: str, fields: str, channels: str, **options: Any) -> Rule:
    return Rule(topic=topic, fields=tuple(fields.split()), channels=tuple(channels.split()), **options)


_ATTITUDE_SETPOINT = "phi_setpoint theta_setpoint psi_setpoint"
_STICKS = "roll_stick pitch_stick yaw_stick thrust_stick"
_MOTOR_FIELDS = " ".join(f"control[{index}]" for index in range(12))
_MOTORS = " ".join(f"motor_{number}" for number in range(1, 13))

RULES: tuple[Rule, ...] = (
    _rule("vehicle_torque_setpoint", "xyz[0] xyz[1] xyz[2]", "roll_command pitch_command yaw_command"),
    _rule("vehicle_thrust_setpoint", "xyz[2]", "thrust_command", sign=-1.0),
    _rule(
        "actuator_controls_0",
        "control[0] control[1] control[2] control[3]",
        "roll_command pitch_command yaw_command thrust_command",
    ),
    _rule("actuator_motors", _MOTOR_FIELDS, _MOTORS, optional=True),
    _rule("vehicle_angular_velocity", "xyz[0] xyz[1] xyz[2]", "p q r", clocks=_SAMPLED),
    _rule("vehicle_acceleration", "xyz[0] xyz[1] xyz[2]", "ax ay az", clocks=_SAMPLED),
    _rule("sensor_combined", "gyro_rad[0] gyro_rad[1] gyro_rad[2]", "p q r"),
    _rule("sensor_combined", "accelerometer_m_s2[0] accelerometer_m_s2[1] accelerometer_m_s2[2]", "ax ay az"),
    _rule("vehicle_attitude", "q[0] q[1] q[2] q[3]", "phi theta psi", clocks=_SAMPLED),
    _rule("vehicle_attitude", "rollspeed pitchspeed yawspeed", "p q r", clocks=_SAMPLED),
    _rule("sensor_gyro", "x y z", "p q r", clocks=_SAMPLED, last_resort=True),
    _rule("sensor_accel", "x y z", "ax ay az", clocks=_SAMPLED, last_resort=True),
    _rule(
        "vehicle_local_position",
        "x y z vx vy vz",
        "north east down velocity_north velocity_east velocity_down",
        clocks=_SAMPLED,
    ),
    # NaN where a mode controls no velocity.
    _rule(
        "trajectory_setpoint",
        "velocity[0] velocity[1] velocity[2]",
        "velocity_north_feedforward velocity_east_feedforward velocity_down_feedforward",
        optional=True,
    ),
    _rule(
        "vehicle_local_position_setpoint",
        "acceleration[0] acceleration[1] acceleration[2]",
        "acceleration_north_setpoint acceleration_east_setpoint acceleration_down_setpoint",
        optional=True,
    ),
    _rule("vehicle_attitude_setpoint", "roll_body pitch_body yaw_body", _ATTITUDE_SETPOINT),
    _rule("vehicle_attitude_setpoint", "q_d[0] q_d[1] q_d[2] q_d[3]", _ATTITUDE_SETPOINT),
    _rule("vehicle_rates_setpoint", "roll pitch yaw", "p_setpoint q_setpoint r_setpoint"),
    _rule("manual_control_setpoint", "roll pitch yaw throttle", _STICKS),
    _rule("manual_control_setpoint", "y x r z", _STICKS),
    _rule("battery_status", "voltage_v", "battery_voltage"),
    _rule("wind", "windspeed_north windspeed_east", "wind_north wind_east"),
    _rule("wind_estimate", "windspeed_north windspeed_east", "wind_north wind_east"),
)
"""Newest names first: the order of the topics is the order of preference."""

EXCITATION = "excite"
"""Name under which whatever excites a flight publishes what it adds to the set-points of torque and thrust."""

_SETPOINT_EXCITATION = "excite_sp"
"""The same for what is added to a set-point of rate or attitude, in its unit."""

EXCITATION_RULES: tuple[Rule, ...] = (
    _rule(
        "debug_vect",
        "x y z",
        "roll_excitation pitch_excitation yaw_excitation",
        optional=True,
        named=("name", EXCITATION),
    ),
    _rule(
        "debug_vect",
        "x y z",
        "roll_setpoint_excitation pitch_setpoint_excitation yaw_setpoint_excitation",
        optional=True,
        named=("name", _SETPOINT_EXCITATION),
    ),
    _rule("debug_key_value", "value", "thrust_excitation", optional=True, named=("key", EXCITATION)),
)
"""PX4 has no topic for test inputs, but two for signals of one's own, which it logs and which MAVLink can send too."""

ALL_RULES = (*RULES, *EXCITATION_RULES)

# Set-points of the outer loops contain feedback, and that of yaw most of all: only what is added behind the controller,
# and sticks, excite every axis. The tilt set-points come last, since in stabilized flight they are the stick through a
# fixed curve.
_INSTRUMENTS = {
    "roll": ("roll_excitation", "roll_setpoint_excitation", "roll_stick", "phi_setpoint"),
    "pitch": ("pitch_excitation", "pitch_setpoint_excitation", "pitch_stick", "theta_setpoint"),
    "yaw": ("yaw_excitation", "yaw_setpoint_excitation", "yaw_stick"),
    "thrust": ("thrust_excitation", "thrust_stick"),
}


def _empty(name: str, facts: Mapping[str, Any]) -> LogError:
    """The error of a log without a topic that is read, and the one setting that mends it."""
    came, subscribed = f"{name} contains no topic with commands, rates, attitude or position", facts.get("subscribed")
    if facts.get("damage"):
        remedy = "it is damaged: copy it again from the vehicle"
    elif subscribed is not None and not subscribed:
        came = f"{name} contains no topic at all, only what precedes them"
        remedy = "set SDLOG_MODE = 0 (log from arming to disarming) and arm"
    else:
        few = ", ".join(subscribed[:_MOST_NAMED]) + ", ..." * (len(subscribed) > _MOST_NAMED) if subscribed else ""
        came, remedy = f"{came}{few and ', only '}{few}", "set SDLOG_PROFILE = 1 (default topics)"
    return LogError(
        came, needed="a log of a flight, such as vehicle_torque_setpoint with vehicle_angular_velocity", remedy=remedy
    )


_MOST_NAMED = 5


_TRUTH = "it is the simulator's truth, which no vehicle logs"
_RECEIVER = "it is the receiver's, before the calibration and the choice of the sticks"

NEAR: Mapping[str, tuple[tuple[str, ...], str]] = {
    "vehicle_imu": (
        ("p", "q", "r", "ax", "ay", "az"),
        "its angles and speeds are sums over an interval",
    ),
    "vehicle_angular_velocity_groundtruth": (("p", "q", "r"), _TRUTH),
    "vehicle_attitude_groundtruth": (("phi", "theta", "psi"), _TRUTH),
    "rc_channels": (tuple(_STICKS.split()), _RECEIVER),
    "input_rc": (tuple(_STICKS.split()), _RECEIVER),
    "esc_status": (("motor_speed_",), "none of its motors ever turned"),
}
"""Topics near to channels that a log may lack: these channels, and why they do not come from there."""


def _near(arrays: Mapping[str, AnyArray], topics: Sequence[Topic]) -> Iterator[Unread]:
    """Topics of a log that were read for none of the channels that they are near to."""
    logged = {channel.name for topic in topics for channel in topic.channels}
    for name, (channels, why) in NEAR.items():
        item = Unread(name=name, channels=channels, why=why)
        if f"{name}/timestamp" in arrays and not any(map(item.near, logged)):
            yield replace(item, rate_hz=rate_hz_of(arrays, name))


def wanted_fields() -> dict[str, list[str]]:
    """Name of each topic to the names of its fields, as the table wants them; stamps are wanted without being named."""
    wanted: dict[str, list[str]] = {topic: list(fields) for topic, fields in STATUS_FIELDS.items()}
    for topic, fields in (*SENSOR_FIELDS.items(), *OUTPUT_FIELDS.items()):
        wanted.setdefault(topic, []).extend(fields)
    for rule in ALL_RULES:
        wanted.setdefault(rule.topic, []).extend((*rule.fields, *rule.letters))
    return wanted


def record_of(arrays: Mapping[str, AnyArray], facts: Mapping[str, Any], source: Source) -> FlightRecord:
    """The flight record behind the arrays of a PX4 log, whatever container they came from.

    Parameters
    ----------
    arrays
        ``topic/field`` to samples as logged, shape ``(samples,)`` and of one length within a topic; the stamps
        ``topic/timestamp`` and ``topic/timestamp_sample`` are unsigned microseconds.
    facts
        What the container says: ``parameters``, and what `findings_of` asks for.
    source
        Name, format and hash of the log.

    Raises
    ------
    LogError
        No topic is one that the package has a name for.
    """
    parameters: Mapping[str, float] = facts["parameters"]
    topics, remarks = _topics(arrays, parameters)
    unread: tuple[Unread, ...] = ()
    if all(topic.row("motor_1") is None for topic in topics):
        # Motors of newer firmware are demands of their own; only where they are not logged, the drivers' outputs are.
        outputs, assumed, unread = motor_outputs(arrays, parameters)
        topics, remarks = (*topics, *outputs), (*remarks, *assumed)
    topics = (*topics, *sensor_topics(arrays, parameters)) if topics else ()
    if not topics:
        raise _empty(source.name, facts)
    status = status_of(arrays, parameters, _span_s(topics))
    unread = (*unread, *_near(arrays, topics))
    return FlightRecord(
        source=source,
        topics=topics,
        parameters=parameters,
        instruments=_instruments(topics),
        findings=(*vehicle_findings(status), *findings_of(topics, facts, source.firmware, unread), *remarks),
        status=status,
        unread=unread,
    )


def _span_s(topics: Sequence[Topic]) -> tuple[float, float]:
    """First and last stamp of what was logged in flight: of the topic that lasts longest."""
    longest = max(topics, key=lambda topic: float(np.ptp(topic.time_s)))
    return float(longest.time_s[0]), float(longest.time_s[-1])


def _topics(
    arrays: Mapping[str, AnyArray], parameters: Mapping[str, float]
) -> tuple[tuple[Topic, ...], tuple[Finding, ...]]:
    topics: list[Topic] = []
    findings: list[Finding] = []
    for rule in ALL_RULES:
        samples = _named(rule, arrays)
        fields = _present(rule, samples)
        logged = {channel.name for topic in topics for channel in topic.channels}
        own = {channel.name for topic in topics if topic.name == rule.topic for channel in topic.channels}
        # A second name of the same fields, or a raw sensor next to its calibrated form.
        if not fields or own & set(rule.channels) or (rule.last_resort and logged & set(rule.channels)):
            continue
        if rule.last_resort and parameters.get("SENS_BOARD_ROT", 0.0) != 0.0:
            findings.append(_rotated(rule.topic, parameters["SENS_BOARD_ROT"]))
            continue
        for topic in _topic(rule, fields, samples):
            topics.append(topic)
            lost = samples[f"{rule.topic}/timestamp"].size - topic.time_s.size
            if lost:
                findings.append(_not_numbers(topic, lost))
    return tuple(topics), tuple(findings)


def _named(rule: Rule, arrays: Mapping[str, AnyArray]) -> Mapping[str, AnyArray]:
    """The samples that a rule is about: all, or those that were published under its name."""
    letters = {f"{rule.topic}/{field}": letter for field, letter in rule.letters.items()}
    if not letters:
        return arrays
    if not all(field in arrays for field in letters):
        return {}
    kept = np.logical_and.reduce([arrays[field] == letter for field, letter in letters.items()])
    fields = [f"{rule.topic}/{field}" for field in (*_SAMPLED, *rule.fields)]
    return {field: arrays[field][kept] for field in fields if field in arrays}


def _present(rule: Rule, arrays: Mapping[str, AnyArray]) -> tuple[str, ...]:
    present = tuple(field for field in rule.fields if f"{rule.topic}/{field}" in arrays)
    if rule.optional:
        return tuple(field for field in present if np.isfinite(arrays[f"{rule.topic}/{field}"]).any())
    return present if present == rule.fields else ()


def _topic(rule: Rule, fields: Sequence[str], arrays: Mapping[str, AnyArray]) -> Iterator[Topic]:
    """One topic of the samples that are numbers; channels with other gaps than the rest stand alone."""
    values = np.empty((len(fields), arrays[f"{rule.topic}/timestamp"].size))
    for row, field in zip(values, fields, strict=True):
        np.multiply(arrays[f"{rule.topic}/{field}"], rule.sign, out=row, dtype=np.float64)
    names = [rule.channels[rule.fields.index(field)] for field in fields] if rule.optional else list(rule.channels)
    sources = [f"{rule.topic}.{field}" for field in fields]
    if len(names) < len(fields):
        values, sources = euler_from_quaternion(values), [f"{rule.topic}.{fields[0][:-3]}"] * 3
    time_s = _stamps(rule, arrays)
    finite = np.isfinite(values) & np.isfinite(time_s)
    groups: dict[bytes, list[int]] = {}
    for number, pattern in enumerate(finite):
        groups.setdefault(pattern.tobytes(), []).append(number)
    for rows in groups.values():
        kept = finite[rows[0]]
        channels = tuple(
            Channel(name=names[number], unit=STANDARD_UNITS[names[number]], source=sources[number]) for number in rows
        )
        if kept.any():
            # One indexing, since every one of them copies all samples; none for a log without gaps.
            chosen = values if finite.all() else values[np.ix_(rows, kept)]
            yield Topic(name=rule.topic, time_s=time_s[kept], channels=channels, values=chosen)


def _stamps(rule: Rule, arrays: Mapping[str, AnyArray]) -> FloatArray:
    """Seconds on the log's own clock, by the best clock that can be right."""
    published = arrays[f"{rule.topic}/timestamp"]
    chosen, valid = published, np.ones(published.size, dtype=np.bool_)
    for clock in rule.clocks:
        stamps = arrays.get(f"{rule.topic}/{clock}", published)
        # Unsigned stamps wrap when they are subtracted, so that a sample "after" its publication is huge as well.
        near = published - stamps <= _LARGEST_STAMP_DELAY_US
        # One damaged stamp is left out; it does not move those of all other samples to another clock.
        if np.count_nonzero(near) > _MOSTLY_VALID * near.size:
            chosen, valid = stamps, near
            break
    # Microseconds since boot stay exact in double precision for two centuries.
    seconds: FloatArray = chosen.astype(np.float64) * 1e-6
    seconds[~valid] = np.nan
    return seconds


def _instruments(topics: Sequence[Topic]) -> dict[str, tuple[str, ...]]:
    logged = {channel.name for topic in topics for channel in topic.channels}
    present = {axis: tuple(name for name in names if name in logged) for axis, names in _INSTRUMENTS.items()}
    return {axis: names for axis, names in present.items() if names}


def _rotated(topic: str, rotation: float) -> Finding:
    return warn(
        "missing_channel",
        topic,
        f"{topic} is in the axes of a sensor that is mounted turned (SENS_BOARD_ROT = {rotation:g}) and was "
        "not used; log vehicle_angular_velocity and vehicle_acceleration instead (SDLOG_PROFILE).",
        SENS_BOARD_ROT=rotation,
    )


def _not_numbers(topic: Topic, lost: int) -> Finding:
    names = ", ".join(channel.name for channel in topic.channels)
    return remark(
        "gap",
        topic.name,
        f"{lost} samples of {names} in {topic.name} are not numbers and were left out.",
        lost_samples=lost,
    )


_NEEDED = {
    "p": "the body rates p, q, r (vehicle_angular_velocity)",
    "roll_command": "what the mixer receives (vehicle_torque_setpoint, before 2022 actuator_controls_0)",
    "thrust_command": "the collective thrust (vehicle_thrust_setpoint, before 2022 actuator_controls_0)",
}


def findings_of(
    topics: Sequence[Topic], facts: Mapping[str, Any], firmware: str, unread: Sequence[Unread] = ()
) -> Iterator[Finding]:
    """Damage, dropouts, missing channels and slow topics of a log.

    Parameters
    ----------
    facts
        What the container says: ``damage``, ``dropouts``, ``size_bytes``, ``parameters``, and which of these
        ``changed``, if it says that.
    firmware
        As it introduces itself.
    unread
        What the log holds near to channels that it lacks.
    """
    yield from _damage(facts["damage"], facts["size_bytes"])
    yield from _dropouts(facts["dropouts"], facts["parameters"])
    if changed := facts.get("changed"):
        yield parameters_changed(changed, "Parameters changed in the log")
    sources = (channel.source.partition("[")[0] for topic in topics for channel in topic.channels)
    advice = logging_advice(facts["parameters"], firmware_shown(firmware, (*sources, *facts["parameters"])))
    remedy = f"{capital(advice)}."
    yield from _missing(topics, unread, remedy)
    yield from _slow(topics, remedy)


def _damage(damage: Sequence[tuple[int, int, str]], size_bytes: int) -> Iterator[Finding]:
    if not damage:
        return
    lost = sum(stop - start for start, stop, _ in damage)
    first, _, reason = damage[0]
    places = "in one place" if len(damage) == 1 else f"in {len(damage)} places"
    yield warn(
        "corrupt_log",
        f"byte {first}",
        f"The file is damaged {places}, first at byte {first} of {size_bytes}: {reason}. {lost} bytes were "
        "left out; everything else was read. Copy the log again from the vehicle if that is possible.",
        first_byte=first,
        lost_bytes=lost,
        places=len(damage),
        size_bytes=size_bytes,
    )


def _dropouts(dropouts: Sequence[tuple[float, float]], parameters: Mapping[str, float]) -> Iterator[Finding]:
    if not dropouts:
        return
    total_s = sum(duration for _, duration in dropouts)
    at_s, longest_s = max(dropouts, key=lambda drop: drop[1])
    several = f"data {len(dropouts)} times, {total_s:.3f} s in all and {longest_s:.3f} s at most,"
    lost = f"The logger lost {f'{total_s:.3f} s of data' if len(dropouts) == 1 else several}"
    yield (warn if longest_s > 0.0 else remark)(
        "gap",
        "logger",
        f"{lost} at {at_s:.2f} s. {capital(gap_advice(parameters))}.",
        dropouts=len(dropouts),
        lost_s=total_s,
        longest_s=longest_s,
        longest_at_s=at_s,
    )


def _missing(topics: Sequence[Topic], unread: Sequence[Unread], remedy: str) -> Iterator[Finding]:
    logged = {channel.name for topic in topics for channel in topic.channels}
    for name, meaning in _NEEDED.items():
        if name not in logged:
            near = unread_words(unread, (name,))
            known = f"{near}. " if near else ""
            yield warn("missing_channel", name, f"The log does not contain {meaning}. {known}{remedy}")


def _slow(topics: Sequence[Topic], remedy: str) -> Iterator[Finding]:
    gyro_hz = next((topic.sample_rate_hz for topic in topics if topic.row("p") is not None), 0.0)
    commands = [topic for topic in topics if any(channel.name.endswith("_command") for channel in topic.channels)]
    for topic in commands:
        if 0.0 < topic.sample_rate_hz < 0.5 * gyro_hz:
            yield warn(
                "rate_too_low",
                topic.name,
                f"{topic.name} was logged at {topic.sample_rate_hz:.0f} Hz and the rates at {gyro_hz:.0f} Hz: "
                f"the slower one limits the band and adds delay. {remedy}",
                rate_hz=topic.sample_rate_hz,
                gyro_rate_hz=gyro_hz,
            )
