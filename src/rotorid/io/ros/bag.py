"""ROS bags as flight records: ROS 1 (``.bag``), ROS 2 (``.db3``, ``.mcap``) and other MCAP files with ROS messages.

A table says which field of which message is which channel. Values are turned from ROS axes (FLU, ENU) to FRD and NED
here and nowhere else.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic, Unread
from rotorid.errors import LogError, UsageError
from rotorid.frames import euler_from_quaternion
from rotorid.io import sandbox as sandboxed
from rotorid.io.px4 import log as px4_topics
from rotorid.io.ros import containers as bag_extract
from rotorid.io.ros.containers import MCAP_MAGIC, RECEIVED, ROS1_MAGIC, SQLITE_MAGIC, STAMP
from rotorid.io.sandbox import Extract
from rotorid.io.tables.mapped import assemble, sources_of
from rotorid.io.tables.mapping import ChannelMapping, nearest
from rotorid.typing import AnyArray, BoolArray, FloatArray

FORMAT = "ROS bag"

_INSTRUMENTS = ("stick", "excitation")


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a ROS 1 bag, an SQLite database or an MCAP file."""
    return head.startswith((ROS1_MAGIC, SQLITE_MAGIC, MCAP_MAGIC))


def read(path: Path, source: Source, mapping: ChannelMapping | None = None, *, sandbox: bool = True) -> FlightRecord:
    """Read a bag.

    Values are turned from ROS axes (FLU, ENU) to FRD and NED; the name of its topic distinguishes a
    set-point from a measurement. Stamps are those of the header; a topic without a header has the time of its
    reception, which adds the delay of the network, with a finding. Of a bag in several files, each is its own log.

    Parameters
    ----------
    path
        One file: of a ROS 2 bag the ``.db3`` or ``.mcap`` in its folder. Its ``metadata.yaml`` is not needed.
    source
        Name, format and hash of the file as the user gave it.
    mapping
        Where each channel stands, as ``/topic.field.part``, with ``row`` or ``column`` for an element of an array.
        ``/topic.header.stamp`` and ``/topic.@received`` are stamps in seconds. Values are turned as ``frame``,
        ``world`` and ``scale`` say. Without a mapping the types of the messages decide, and a number alone
        (``std_msgs/Float64``) counts when its topic ends in a name of the vocabulary.
    sandbox
        Parse in a child process with limits: code is made from the definitions in a bag.

    Raises
    ------
    LogError
        The package ``rosbags`` is not installed, the file is no bag, or nothing in it has a name.
    UsageError
        The mapping does not fit the bag.
    """
    options = {"by_kind": {}, "by_topic": _by_topic(mapping)} if mapping else _by_rules()
    if sandbox:
        extract = sandboxed.extract("rosbag", path, options, name=source.name)
    else:
        extract = bag_extract.extract(path, options)
    if mapping is not None:
        _check(mapping, extract, source.name)
        return assemble(extract.arrays, mapping, source, findings_of((), extract))
    topics = tuple(_topics_of(extract))
    if not topics:
        raise LogError(
            f"{source.name} contains {_listed(extract.facts['topics'])}",
            needed="a topic of sensor_msgs/Imu, nav_msgs/Odometry, px4_msgs or the like, with its definition",
            remedy="name the channels of other topics with a mapping: --map FILE.toml",
        )
    logged = {channel.name for topic in topics for channel in topic.channels}
    axes = ("roll", "pitch", "yaw", "thrust")
    present = {axis: tuple(f"{axis}_{kind}" for kind in _INSTRUMENTS if f"{axis}_{kind}" in logged) for axis in axes}
    return FlightRecord(
        source=source,
        topics=topics,
        instruments={axis: names for axis, names in present.items() if names},
        findings=tuple(findings_of(topics, extract)),
        unread=tuple(_unread(logged, extract.facts["topics"])),
    )


_NEAR: Mapping[str, tuple[str, str]] = {
    "mavros_msgs/msg/RCOut": ("motor_", "bags contain neither the limits of pulses nor which are motors"),
    "px4_msgs/msg/ActuatorOutputs": ("motor_", "bags contain neither their limits nor which are motors"),
    "mav_msgs/msg/Actuators": ("motor_", "speeds that are asked for are no share of full output"),
    "actuator_msgs/msg/Actuators": ("motor_", "speeds that are asked for are no share of full output"),
}
"""Types near to channels that a bag may lack: these, and why they do not come from there."""


def _unread(logged: set[str], topics: Mapping[str, Mapping[str, Any]]) -> Iterator[Unread]:
    for topic, about in topics.items():
        if about["kind"] in _NEAR:
            channels, why = _NEAR[about["kind"]]
            item = Unread(name=topic, channels=(channels,), why=why)
            if not any(map(item.near, logged)):
                yield item


def _by_rules() -> dict[str, Any]:
    return {"by_kind": _paths_by_kind() | {kind: ["data"] for kind in PLAIN_KINDS}, "by_topic": {}}


def _by_topic(mapping: ChannelMapping) -> dict[str, list[str]]:
    wanted: dict[str, list[str]] = {}
    for name in sources_of(mapping):
        topic, _, path = name.partition(".")
        wanted.setdefault(topic, []).append(path)
    return wanted


def _check(mapping: ChannelMapping, extract: Extract, file: str) -> None:
    """Say which topic or field of a mapping does not exist, and which do."""
    topics: Mapping[str, Mapping[str, Any]] = extract.facts["topics"]
    for name in sources_of(mapping):
        if name in extract.arrays:
            continue
        topic, _, path = name.partition(".")
        if topic not in topics:
            close = nearest(topic, topics)
            raise UsageError(
                f"{file} has no topic {topic!r}",
                needed=f"a source `/topic.field`, the topic one of {_listed(topics)}",
                remedy=f"did you mean {close}?" if close else "correct `source` or `time` in the mapping",
            )
        about = topics[topic]
        if about["unreadable"] or not about["fields"]:
            why = about["unreadable"] or f"none of its {about['count']} messages can be decoded"
            raise LogError(f"{file}: the topic {topic} cannot be read: {why}", needed="a definition of its messages")
        raise UsageError(
            f"{file}: the topic {topic} ({about['kind']}) has no number at {path!r} in every message",
            needed=f"a path that starts with one of {', '.join(about['fields'])}",
            remedy="correct `source` or `time` in the mapping",
        )


def _listed(topics: Mapping[str, Mapping[str, Any]]) -> str:
    return ", ".join(f"{topic} ({about['kind']})" for topic, about in list(topics.items())[:30]) or "no messages"


Axes: TypeAlias = Literal["plain", "body", "earth", "attitude", "px4_attitude"]
"""What kind of quantity turns: nothing, a vector in FLU, one in ENU, a quaternion x, y, z, w of both, or PX4's own."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Rule:
    """Fields of a type of message and the channels that they are.

    Parameters
    ----------
    kind
        Type of the message: ``sensor_msgs/msg/Imu``.
    fields
        Paths in the message.
    channels
        One for each field; three Euler angles for the four parts of a quaternion.
    axes
        How the values turn into FRD and NED.
    sign
        Factor of the values.
    topic
        Regular expression that the name of the topic must match.
    only
        Path and value without which a message does not count.
    absent
        Path of a number that is −1 where the fields hold nothing.
    clocks
        Paths of stamps in microseconds, best first; empty for the stamp of the header.
    optional
        Fields that are absent or never a number are left out one by one.
    last_resort
        Used only when no other topic holds the channels.
    """

    kind: str
    fields: tuple[str, ...]
    channels: tuple[str, ...]
    axes: Axes = "plain"
    sign: float = 1.0
    topic: str = ""
    only: tuple[str, float] | None = None
    absent: str = ""
    clocks: tuple[str, ...] = ()
    optional: bool = False
    last_resort: bool = False

    @property
    def paths(self) -> tuple[str, ...]:
        """Everything that must be read from a message."""
        more = [self.absent] if self.absent else []
        return (*self.fields, *more, *([self.only[0]] if self.only else []), *self.clocks)


def _rule(kind: str, fields: str, channels: str, axes: Axes = "plain", **options: Any) -> Rule:
    package, _, name = kind.partition("/")
    return Rule(
        kind=f"{package}/msg/{name}",
        fields=tuple(fields.split()),
        channels=tuple(channels.split()),
        axes=axes,
        **options,
    )


def _xyz(stem: str, letters: str = "xyz") -> str:
    return " ".join(f"{stem}.{letter}" for letter in letters)


_EULER, _RATES, _SPEEDS = "phi theta psi", "p q r", "u v w"
_POSITION, _VELOCITY = "north east down", "velocity_north velocity_east velocity_down"
_COMMANDS = "roll_command pitch_command yaw_command thrust_command"


def _twist(kind: str, stem: str) -> tuple[Rule, ...]:
    """A twist says nothing about its axes: the names that MAVROS and the navigation stack use do."""
    linear, angular = _xyz(f"{stem}linear"), _xyz(f"{stem}angular")
    return (
        _rule(kind, linear, _SPEEDS, "body", topic=r"velocity_body$"),
        _rule(kind, angular, _RATES, "body", topic=r"velocity_body$"),
        _rule(kind, linear, _VELOCITY, "earth", topic=r"velocity_local$|setpoint_velocity/"),
        _rule(kind, linear, _SPEEDS, "body", topic=r"^(?!.*setpoint_velocity/).*cmd_vel"),
        _rule(kind, f"{stem}angular.z", "r", sign=-1.0, topic=r"^(?!.*setpoint_velocity/).*cmd_vel"),
    )


def _px4_rules() -> tuple[Rule, ...]:
    """The table of the PX4 reader, with the names that the messages carry in ROS 2: ``VehicleTorqueSetpoint``."""
    return tuple(
        Rule(
            kind="px4_msgs/msg/" + rule.topic.title().replace("_", ""),
            fields=rule.fields,
            channels=rule.channels,
            axes="px4_attitude" if len(rule.fields) == 4 and len(rule.channels) == 3 else "plain",
            sign=rule.sign,
            clocks=rule.clocks,
            optional=rule.optional,
            last_resort=rule.last_resort,
        )
        for rule in px4_topics.RULES
    )


_GROUP_ZERO = ("group_mix", 0.0)
_NUMBERED = 12
_ACTUATORS = ("mav_msgs/Actuators", "angular_velocities"), ("actuator_msgs/Actuators", "velocity")
_ESCS = ("mavros_msgs/ESCTelemetry", "esc_telemetry[{}].rpm"), ("mavros_msgs/ESCStatus", "esc_status[{}].rpm")


def _motors(kind: str, path: str, channel: str, **options: Any) -> Rule:
    """A rule for every motor: a path and a channel with a place for its number, from 0 and from 1."""
    fields, channels = (
        " ".join(text.format(first + number) for number in range(_NUMBERED))
        for text, first in ((path, 0), (channel, 1))
    )
    return _rule(kind, fields, channels, optional=True, **options)


def _actuator_rules() -> Iterator[Rule]:
    """Speeds of rotors, which a topic of commands only asks for, and outputs from 0 to 1."""
    for kind, speeds in _ACTUATORS:
        yield _motors(kind, f"{speeds}[{{}}]", "motor_speed_{}", topic=rf"^(?!.*(?:{_ASKED.pattern}))")
        yield _motors(kind, "normalized[{}]", "motor_{}")
    for kind, path in (*_ESCS, ("px4_msgs/EscStatus", "esc[{}].esc_rpm")):
        yield _motors(kind, path, "motor_speed_{}", sign=math.pi / 30.0)


_ASKED = re.compile(r"setpoint|target|cmd|command|desired|reference")
"""Words in the name of a topic that say it is asked for and not measured."""

RULES: tuple[Rule, ...] = (
    *_px4_rules(),
    _rule(
        "mavros_msgs/ActuatorControl", "controls[0] controls[1] controls[2] controls[3]", _COMMANDS, only=_GROUP_ZERO
    ),
    _rule("mavros_msgs/AttitudeTarget", "thrust", "thrust_command"),
    _rule("mavros_msgs/AttitudeTarget", _xyz("body_rate"), "p_setpoint q_setpoint r_setpoint", "body"),
    _rule(
        "mavros_msgs/AttitudeTarget",
        _xyz("orientation", "xyzw"),
        "phi_setpoint theta_setpoint psi_setpoint",
        "attitude",
    ),
    _rule("sensor_msgs/Imu", _xyz("angular_velocity"), _RATES, "body", absent="angular_velocity_covariance[0]"),
    _rule(
        "sensor_msgs/Imu", _xyz("linear_acceleration"), "ax ay az", "body", absent="linear_acceleration_covariance[0]"
    ),
    _rule("sensor_msgs/Imu", _xyz("orientation", "xyzw"), _EULER, "attitude", absent="orientation_covariance[0]"),
    _rule("nav_msgs/Odometry", _xyz("pose.pose.orientation", "xyzw"), _EULER, "attitude"),
    _rule("nav_msgs/Odometry", _xyz("pose.pose.position"), _POSITION, "earth"),
    _rule("nav_msgs/Odometry", _xyz("twist.twist.linear"), _SPEEDS, "body"),
    _rule("nav_msgs/Odometry", _xyz("twist.twist.angular"), _RATES, "body"),
    _rule("geometry_msgs/PoseStamped", _xyz("pose.orientation", "xyzw"), _EULER, "attitude"),
    _rule("geometry_msgs/PoseStamped", _xyz("pose.position"), _POSITION, "earth"),
    *_twist("geometry_msgs/TwistStamped", "twist."),
    *_twist("geometry_msgs/Twist", ""),
    _rule("geometry_msgs/PoseWithCovarianceStamped", _xyz("pose.pose.orientation", "xyzw"), _EULER, "attitude"),
    _rule("geometry_msgs/PoseWithCovarianceStamped", _xyz("pose.pose.position"), _POSITION, "earth"),
    _rule("geometry_msgs/TransformStamped", _xyz("transform.rotation", "xyzw"), _EULER, "attitude"),
    _rule("geometry_msgs/TransformStamped", _xyz("transform.translation"), _POSITION, "earth"),
    _rule("geometry_msgs/QuaternionStamped", _xyz("quaternion", "xyzw"), _EULER, "attitude"),
    *_actuator_rules(),
    _rule("sensor_msgs/BatteryState", "voltage", "battery_voltage"),
)
"""In order of preference."""

_IGNORED_BITS: Mapping[str, int] = {"thrust_command": 64, "p_setpoint": 7, "phi_setpoint": 128}
"""First channel of a rule for ``mavros_msgs/AttitudeTarget`` to the bits of ``type_mask`` that declare it void."""

_MASKED = "mavros_msgs/msg/AttitudeTarget"


def rules_for(kind: str, topic: str) -> tuple[Rule, ...]:
    """The rules for a topic; where its name says that it is asked for, the channels are set-points.

    Examples
    --------
    >>> [rule.channels for rule in rules_for("geometry_msgs/msg/TwistStamped", "/robot/cmd_vel")]
    [('u_setpoint', 'v_setpoint', 'w_setpoint'), ('r_setpoint',)]
    """
    found = [rule for rule in RULES if rule.kind == kind and re.search(rule.topic, topic)]
    if kind.startswith(("geometry_msgs/", "nav_msgs/")) and _ASKED.search(topic):
        found = [replace(rule, channels=tuple(f"{name}_setpoint" for name in rule.channels)) for rule in found]
    return tuple(found)


def _paths_by_kind() -> dict[str, list[str]]:
    """Type of message to everything that the rules read from it."""
    wanted: dict[str, list[str]] = {}
    for rule in RULES:
        wanted.setdefault(rule.kind, []).extend(rule.paths)
    wanted[_MASKED].append("type_mask")
    return {kind: list(dict.fromkeys(paths)) for kind, paths in wanted.items()}


def _ignored_bits(rule: Rule) -> int:
    """Bits of ``type_mask`` that declare the fields of a rule void; zero where there is no mask."""
    return _IGNORED_BITS.get(rule.channels[0], 0) if rule.kind == _MASKED else 0


def _topics_of(extract: Extract) -> Iterator[Topic]:
    """Topics that the rules have a name for, best first.

    Of two topics of one type the one without ``raw`` in its name comes first; then the names decide.
    """
    known_names: set[str] = set()
    for rule, topic in _matches(extract.facts["topics"]):
        arrays = _of_topic(topic, extract.arrays)
        if rule.last_resort and known_names & set(rule.channels):
            continue
        found = _topic(rule, topic, arrays, extract.facts["topics"][topic]["frames"])
        if found is not None and not _second_name(found, topic, known_names):
            known_names |= {f"{topic}/{channel.name}" for channel in found.channels} | {
                item.name for item in found.channels
            }
            yield found
    for topic, about in extract.facts["topics"].items():
        name = topic.rpartition("/")[2]
        arrays = _of_topic(topic, extract.arrays)
        if about["kind"] in PLAIN_KINDS and name in STANDARD_UNITS and "data" in arrays:
            yield _plain(topic, name, arrays)


def _stamps_of(topic: str, arrays: Mapping[str, AnyArray], clocks: tuple[str, ...] = ()) -> tuple[FloatArray, str]:
    """Stamps of a topic in seconds, and the path that they come from.

    A stamp counts when it moves: a header that nobody filled in stays at zero.
    """
    of_topic = _of_topic(topic, arrays)
    for path, factor in (*((clock, _MICROSECOND) for clock in clocks), (STAMP, 1.0)):
        if path in of_topic and _stamps_rise(of_topic[path]):
            return np.asarray(of_topic[path] * factor, dtype=np.float64), path
    return np.asarray(of_topic[RECEIVED], dtype=np.float64), RECEIVED


def _stamps_rise(stamps: AnyArray) -> bool:
    return bool(np.isfinite(stamps).all() and stamps.min() > 0.0 and (stamps.size == 1 or np.ptp(stamps) > 0.0))


def _of_topic(topic: str, arrays: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Numbers of a topic by path; a bag may define a field that the rules know as a list, which is then none."""
    return {
        name[len(topic) + 1 :]: array
        for name, array in arrays.items()
        if name.startswith(f"{topic}.") and array.ndim == 1
    }


def _matches(topics: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[Rule, str]]:
    """Rules and the topics that they fit, in order of preference."""
    by_name = sorted(topics, key=lambda name: ("raw" in name, name))
    found = [(rule, topic) for topic in by_name for rule in rules_for(topics[topic]["kind"], topic)]
    order = {(rule.kind, rule.fields, rule.topic): place for place, rule in enumerate(RULES)}
    yield from sorted(found, key=lambda match: order[match[0].kind, match[0].fields, match[0].topic])


def _second_name(found: Topic, topic: str, known_names: set[str]) -> bool:
    """Whether the same topic gave these channels already, under the names of another firmware."""
    return any(f"{topic}/{channel.name}" in known_names for channel in found.channels)


def _topic(rule: Rule, topic: str, arrays: Mapping[str, AnyArray], frames: tuple[str, str]) -> Topic | None:
    fields = tuple(name for name in rule.fields if name in arrays)
    if rule.optional:
        fields = tuple(name for name in fields if np.isfinite(arrays[name]).any())
    if not fields or (not rule.optional and fields != rule.fields):
        return None
    raw = np.stack([arrays[name] for name in fields])
    kept = np.isfinite(raw).all(axis=0) & _meant(rule, arrays, raw)
    values = turned(raw[:, kept], rule, (frames[0], frames[1])) if kept.any() else None
    if values is None:
        return None
    names = [rule.channels[rule.fields.index(name)] for name in fields] if rule.optional else list(rule.channels)
    sources = [f"{topic}.{name}" for name in fields]
    if len(names) < len(fields):
        sources = [f"{topic}.{fields[0].removesuffix('.x').removesuffix('[0]')}"] * len(names)
    stamps, _ = _stamps_of(topic, {f"{topic}.{name}": array for name, array in arrays.items()}, rule.clocks)
    return Topic(
        name=topic,
        time_s=stamps[kept],
        channels=tuple(
            Channel(name=name, unit=STANDARD_UNITS[name], source=source)
            for name, source in zip(names, sources, strict=True)
        ),
        values=values,
    )


def _meant(rule: Rule, arrays: Mapping[str, AnyArray], raw: FloatArray) -> BoolArray:
    """Messages that mean what the rule reads: not declared absent, of the right group, not masked, not empty."""
    meant: BoolArray = np.ones(raw.shape[1], dtype=np.bool_)
    if rule.absent in arrays:
        meant &= arrays[rule.absent] != -1.0
    if rule.only is not None and rule.only[0] in arrays:
        meant &= arrays[rule.only[0]] == rule.only[1]
    if "type_mask" in arrays:
        meant &= (arrays["type_mask"].astype(np.int64) & _ignored_bits(rule)) == 0
    if rule.axes == "attitude":
        meant &= np.any(raw != 0.0, axis=0)
    return meant


def turned(values: FloatArray, rule: Rule, frames: tuple[str, str]) -> FloatArray | None:
    r"""Values in FRD and NED.

    A vector in FLU turns by :math:`(x, -y, -z)`, one in ENU by :math:`(y, x, -z)`; of the angles of FLU in ENU, roll
    stays, pitch changes its sign, and :math:`\psi = \pi/2 - \psi_{ENU}`. A frame whose name ends in ``ned`` or ``frd``,
    as MAVROS and PX4 name theirs, is taken as such.

    Parameters
    ----------
    values
        Rows as the fields of the rule, shape ``(fields, samples)``.
    frames
        ``frame_id`` and ``child_frame_id`` of the header.

    Returns
    -------
    FloatArray or None
        Rows as the channels of the rule; ``None`` for an attitude that mixes the two worlds.

    Examples
    --------
    >>> import numpy as np
    >>> rule = rules_for("sensor_msgs/msg/Imu", "/imu")[1]
    >>> turned(np.array([[0.1], [0.2], [9.81]]), rule, ("base_link", "")).ravel().tolist()
    [0.1, -0.2, -9.81]
    """
    outer, inner = (_is_down(frame) for frame in frames)
    body_down = inner if frames[1] else outer
    if rule.axes == "body":
        return values if body_down else values * np.array([[1.0], [-1.0], [-1.0]])
    if rule.axes == "earth":
        return values if outer else np.stack([values[1], values[0], -values[2]])
    if rule.axes == "px4_attitude":
        return euler_from_quaternion(values)
    if rule.axes == "attitude":
        if frames[1] and outer != inner:
            return None
        phi, theta, psi = euler_from_quaternion(values[[3, 0, 1, 2]])
        return np.stack([phi, theta, psi]) if outer else np.stack([phi, -theta, np.arctan2(np.cos(psi), np.sin(psi))])
    return values * rule.sign


def _is_down(frame: str) -> bool:
    return frame.lower().endswith(("ned", "frd"))


PLAIN_KINDS = ("std_msgs/msg/Float64", "std_msgs/msg/Float32")
"""A number without meaning, unless the topic ends in a name of the vocabulary."""

_MICROSECOND = 1e-6


def _plain(topic: str, name: str, arrays: Mapping[str, AnyArray]) -> Topic:
    kept = np.isfinite(arrays["data"])
    channel = Channel(name=name, unit=STANDARD_UNITS[name], source=f"{topic}.data")
    return Topic(name=topic, time_s=arrays[RECEIVED][kept], channels=(channel,), values=arrays["data"][None, kept])


_LARGEST_SKEW_S = 1.0
_NAMED = 20


def findings_of(topics: Sequence[Topic], extract: Extract) -> Iterator[Finding]:
    """Remarks on a bag.

    Parameters
    ----------
    topics
        What was read by the rules; empty when a mapping named the channels, and with them the stamps.
    """
    facts = extract.facts
    yield from _damage(facts)
    yield from _unreadable(facts["topics"])
    if topics:
        yield from _clocks(topics, extract.arrays)
        yield from _without_meaning(topics, facts["topics"])


def _damage(facts: Mapping[str, Any]) -> Iterator[Finding]:
    damage, size_bytes = facts["damage"], facts["size_bytes"]
    failed = sum(about["failed"] for about in facts["topics"].values())
    if not damage and not failed:
        return
    where = f"; first at byte {damage[0][0]} of {size_bytes}: {damage[0][1]}" if damage else ""
    yield warn(
        "corrupt_log",
        "bag",
        f"The bag is damaged in {len(damage)} places and {failed} of its messages do not decode{where}. What "
        "is whole was read; copy the bag again, or repair it with `rosbag reindex` or `ros2 bag reindex`.",
        places=len(damage),
        first_byte=damage[0][0] if damage else 0,
        size_bytes=size_bytes,
        failed_messages=failed,
    )


def _unreadable(topics: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    for topic, about in topics.items():
        if about["unreadable"]:
            yield warn(
                "missing_channel",
                topic,
                f"The topic {topic} ({about['kind']}) was left out, since its messages cannot be decoded: "
                f"{about['unreadable']}. Bags of ROS 2 hold the definitions since the release Iron.",
            )


def _clocks(topics: Sequence[Topic], arrays: Mapping[str, AnyArray]) -> Iterator[Finding]:
    received = {topic.name: arrays[f"{topic.name}.{RECEIVED}"] for topic in topics}
    unstamped = [
        topic.name for topic in topics if topic.time_s.size and np.isin(topic.time_s, received[topic.name]).all()
    ]
    if unstamped:
        names = ", ".join(dict.fromkeys(unstamped))
        yield remark(
            "receive_time",
            unstamped[0],
            f"{names} have no time stamp and were placed at their reception time, which adds the "
            "delay and the jitter of the network to every delay that is identified. Publish stamped messages.",
            topics=len(set(unstamped)),
        )
    offsets = {
        topic.name: float(np.median(received[topic.name]) - np.median(topic.time_s))
        for topic in topics
        if topic.time_s.size
    }
    if not offsets:
        return
    early, late = min(offsets, key=offsets.__getitem__), max(offsets, key=offsets.__getitem__)
    skew_s = offsets[late] - offsets[early]
    if skew_s > _LARGEST_SKEW_S:
        yield warn(
            "clock_skew",
            late,
            f"{late} and {early} are stamped by clocks that differ by {skew_s:.3f} s, so that they do not fit "
            "together. Let all nodes use one clock (use_sim_time, time synchronization of the autopilot), or name "
            "stamps of one clock with a mapping: --map FILE.toml.",
            skew_s=skew_s,
        )


def _without_meaning(topics: Sequence[Topic], by_topic: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    used = {topic.name for topic in topics}
    others = [
        f"{topic} ({about['kind']})"
        for topic, about in by_topic.items()
        if topic not in used and not about["unreadable"]
    ]
    if others:
        more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
        yield remark(
            "unknown_topic",
            "bag",
            f"{', '.join(others[:_NAMED])}{more} say nothing that the vocabulary has a name for and were left "
            "out. A mapping can name them: --map FILE.toml.",
            topics=len(others),
        )
