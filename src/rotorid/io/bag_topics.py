"""Which field of which ROS message is which channel, as a table, and the turn from ROS axes to FRD and NED."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from rotorid.frames import euler_from_quaternion
from rotorid.io import px4_topics
from rotorid.typing import FloatArray

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
    _rule("sensor_msgs/BatteryState", "voltage", "battery_voltage"),
)
"""In order of preference."""

_IGNORED_BITS: Mapping[str, int] = {"thrust_command": 64, "p_setpoint": 7, "phi_setpoint": 128}
"""First channel of a rule for ``mavros_msgs/AttitudeTarget`` to the bits of ``type_mask`` that declare it void."""

_MASKED = "mavros_msgs/msg/AttitudeTarget"

_ASKED = re.compile(r"setpoint|target|cmd|command|desired|reference")
"""Words in the name of a topic that say it is asked for and not measured."""


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


def paths_by_kind() -> dict[str, list[str]]:
    """Type of message to everything that the rules read from it."""
    wanted: dict[str, list[str]] = {}
    for rule in RULES:
        wanted.setdefault(rule.kind, []).extend(rule.paths)
    wanted[_MASKED].append("type_mask")
    return {kind: list(dict.fromkeys(paths)) for kind, paths in wanted.items()}


def ignored_bits(rule: Rule) -> int:
    """Bits of ``type_mask`` that declare the fields of a rule void; zero where there is no mask."""
    return _IGNORED_BITS.get(rule.channels[0], 0) if rule.kind == _MASKED else 0


def turned(values: FloatArray, rule: Rule, frames: tuple[str, str]) -> FloatArray | None:
    r"""Values in FRD and NED.

    A vector in FLU turns by :math:`(x, -y, -z)`, one in ENU by :math:`(y, x, -z)`; of the angles of FLU in ENU, roll
    stays, pitch changes its sign, and :math:`\psi = \pi/2 - \psi_{ENU}`. A frame whose name ends in ``ned`` or ``frd``,
    as MAVROS and PX4 name theirs, is taken as such.

    Parameters
    ----------
    values
        Rows as the fields of the rule, shape ``(fields, samples)``.
    rule
        What they are.
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
