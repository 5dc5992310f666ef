"""Which versions of PX4 have what a log holds: its topics, fields and parameters came and went with them.

The packed version number of a log is that of the last tag of its build. A build without tags calls itself 1.8.0,
whatever it is, and a fork may call itself anything.

References
----------
``msg``, ``src/modules/mc_rate_control``, ``src/modules/sensors`` and ``src/modules/control_allocator`` of
PX4/PX4-Autopilot at its release tags; release notes of 1.10 to 1.16.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from rotorid.autopilots.firmware import Version, is_before, version_of

NEVER: Version = (9999, 0)
"""Before this version everything was still there."""

HAD: Mapping[str, tuple[Version, Version]] = MappingProxyType(
    {
        "vehicle_angular_velocity": ((1, 10), NEVER),
        "vehicle_acceleration": ((1, 11), NEVER),
        "hover_thrust_estimate": ((1, 11), NEVER),
        "vehicle_torque_setpoint": ((1, 12), NEVER),
        "vehicle_thrust_setpoint": ((1, 12), NEVER),
        "control_allocator_status": ((1, 12), NEVER),
        "actuator_motors": ((1, 13), NEVER),
        "manual_control_setpoint.roll": ((1, 14), NEVER),
        "MC_DTERM_CUTOFF": ((1, 6), (1, 11)),
        "IMU_DGYRO_CUTOFF": ((1, 11), NEVER),
        "IMU_GYRO_NF_FREQ": ((1, 9), (1, 13)),
        "IMU_GYRO_NF0_FRQ": ((1, 13), NEVER),
        "IMU_GYRO_DNF_EN": ((1, 13), NEVER),
        "CA_ROTOR_COUNT": ((1, 13), NEVER),
        "MC_YAW_TQ_CUTOFF": ((1, 16), NEVER),
    }
)
"""Topic, field or parameter to the first version that has it, and the first that has it no more."""


_BEFORE: Mapping[str, str] = MappingProxyType(
    {
        "vehicle_angular_velocity": "sensor_combined",
        "vehicle_acceleration": "sensor_combined",
        "vehicle_torque_setpoint": "actuator_controls_0",
        "vehicle_thrust_setpoint": "actuator_controls_0",
        "actuator_motors": "actuator_outputs",
    }
)
"""Topic to the one that held the same before it existed."""

_SINCE: Mapping[str, Version] = MappingProxyType({"sensor_gyro_fifo": (1, 11), "vehicle_imu_status": (1, 11)})
"""Topics that show no version, since boards differ in them, and the first that publishes them."""


def topic_of(topic: str, firmware: str) -> str:
    """The topic that holds this in a firmware: by today's name or an older one; empty where there was none.

    Examples
    --------
    >>> topic_of("actuator_motors", "PX4 1.12.3"), topic_of("actuator_motors", "PX4 1.15.0")
    ('actuator_outputs', 'actuator_motors')
    >>> topic_of("hover_thrust_estimate", "PX4 1.9.2")
    ''
    """
    since = HAD[topic][0] if topic in HAD else _SINCE.get(topic, (0, 0))
    return _BEFORE.get(topic, "") if is_before(firmware, since) else topic


def versions_with(names: Iterable[str]) -> tuple[Version, Version, str]:
    """The oldest version that has all of some names, the first that is too new, and the name that shows the oldest.

    Parameters
    ----------
    names
        Topics, fields (``topic.field``) and parameters of a log; those that are not in :data:`HAD` say nothing.

    Examples
    --------
    >>> versions_with(["vehicle_torque_setpoint.xyz", "IMU_DGYRO_CUTOFF", "SYS_AUTOSTART"])
    ((1, 12), (9999, 0), 'vehicle_torque_setpoint')
    >>> versions_with(["MC_DTERM_CUTOFF"])
    ((1, 6), (1, 11), 'MC_DTERM_CUTOFF')
    """
    found = {known: HAD[known] for name in names for known in (name, name.partition(".")[0]) if known in HAD}
    if not found:
        return (0, 0), NEVER, ""
    shown = max(found, key=lambda name: (found[name][0], name))
    return found[shown][0], min(last for _, last in found.values()), shown


def firmware_shown(firmware: str, names: Iterable[str]) -> str:
    """The name of a firmware, with another version where its log holds what that version does not have.

    Parameters
    ----------
    firmware
        As it introduces itself.
    names
        As for :func:`versions_with`.

    Examples
    --------
    A build without tags, and one that may call itself so:

    >>> firmware_shown("PX4 1.8.0 (beta)", ["actuator_motors.control", "MC_YAW_TQ_CUTOFF"])
    'PX4 1.16 or newer'
    >>> firmware_shown("PX4 1.8.0", ["vehicle_attitude.q"])
    'PX4 1.8.0'
    """
    version = version_of(firmware)
    oldest, too_new, _ = versions_with(names)
    if version is None or oldest >= too_new:
        return firmware
    if version < oldest:
        return f"PX4 {oldest[0]}.{oldest[1]} or newer"
    return f"PX4 {too_new[0]}.{too_new[1] - 1} or older" if version >= too_new else firmware
