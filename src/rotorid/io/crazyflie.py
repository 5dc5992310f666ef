"""Logs of a Crazyflie's uSD deck: firmware variables as a flight record in the vocabulary of the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rotorid.data.channel import LOWEST_RATE_HZ, STANDARD_UNITS, Channel
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.errors import LogError
from rotorid.io.crazyflie_walk import Event, UsdLog, decode, sniff
from rotorid.typing import AnyArray, FloatArray
from rotorid.units import parse_unit

__all__ = ["FORMAT", "read", "sniff"]

FORMAT = "Crazyflie uSD"

_FULL_THROTTLE = 65535.0
_FULL_COMMAND = 32767.0
_MOTORS = tuple(f"motor.m{number}" for number in range(1, 5))


class Meaning(NamedTuple):
    """The channel that a variable of the firmware is, its unit, and the sign or factor that comes before the unit."""

    channel: str
    unit: str
    scale: float = 1.0


def _rows(group: str, variables: str, channels: str, unit: str, *scales: float) -> dict[str, Meaning]:
    names = zip(variables.split(), channels.split(), scales or (1.0, 1.0, 1.0, 1.0), strict=False)
    return {f"{group}.{variable}": Meaning(channel, unit, scale) for variable, channel, scale in names}


# The firmware's axes are forward, left, up, so that y and z turn their sign. Its attitude, the set-points of it and
# everything that follows from them count the pitch angle the other way round, nose up, as this package does.
MEANINGS: Mapping[str, Meaning] = {
    **_rows("gyro", "x y z", "p q r", "deg/s", 1.0, -1.0, -1.0),
    **_rows("stateEstimateZ", "rateRoll ratePitch rateYaw", "p q r", "mrad/s", 1.0, 1.0, -1.0),
    **_rows("acc", "x y z", "ax ay az", "g", 1.0, -1.0, -1.0),
    **_rows("motor", "m1 m2 m3 m4", "motor_1 motor_2 motor_3 motor_4", "1", *4 * (1.0 / _FULL_THROTTLE,)),
    **_rows("rpm", "m1 m2 m3 m4", "motor_speed_1 motor_speed_2 motor_speed_3 motor_speed_4", "rpm"),
    **_rows(
        "controller",
        "cmd_roll cmd_pitch cmd_yaw",
        "roll_command pitch_command yaw_command",
        "1",
        *3 * (1.0 / _FULL_COMMAND,),
    ),
    **_rows("stateEstimate", "roll pitch yaw", "phi theta psi", "deg", 1.0, 1.0, -1.0),
    **_rows("stateEstimate", "x y z", "north east down", "m", 1.0, -1.0, -1.0),
    **_rows("stateEstimate", "vx vy vz", "velocity_north velocity_east velocity_down", "m/s", 1.0, -1.0, -1.0),
    **_rows("stateEstimateZ", "x y z", "north east down", "mm", 1.0, -1.0, -1.0),
    **_rows("stateEstimateZ", "vx vy vz", "velocity_north velocity_east velocity_down", "mm/s", 1.0, -1.0, -1.0),
    **_rows("controller", "roll pitch yaw", "phi_setpoint theta_setpoint psi_setpoint", "deg", 1.0, 1.0, -1.0),
    **_rows("controller", "rollRate pitchRate yawRate", "p_setpoint q_setpoint r_setpoint", "deg/s", 1.0, 1.0, -1.0),
    # Its velocities are left out: some commanders give them in body axes, and the log does not say which did.
    **_rows("ctrltarget", "roll pitch yaw", "phi_setpoint theta_setpoint psi_setpoint", "deg", 1.0, 1.0, -1.0),
    **_rows("ctrltarget", "x y z", "north_setpoint east_setpoint down_setpoint", "m", 1.0, -1.0, -1.0),
    **_rows("pm", "vbat", "battery_voltage", "V"),
    **_rows("pm", "vbatMV", "battery_voltage", "mV"),
}
"""Variable to channel, best first: of two that are the same channel in one event, the earlier one is used."""

_NEEDED = {
    "p": "the body rates: gyro.x, gyro.y, gyro.z",
    "az": "the specific force: acc.x, acc.y, acc.z",
    "thrust_command": "what the motors were told: motor.m1 to motor.m4",
}


def read(path: Path, source: Source) -> FlightRecord:
    """Read a uSD log of version 1 or 2.

    Axes become FRD and NED: *north* is the x axis of the firmware's estimator, which points where the vehicle pointed
    when it was switched on, unless a positioning system says otherwise. ``thrust_command`` is the mean of the four
    motor commands, 0 to 1, where an event holds all of them; it is the command after the battery compensation, so that
    its gain to thrust changes with the voltage. Gyro and accelerometer have passed the firmware's low-pass filters (80
    and 30 Hz unless changed), which a fitted delay contains.

    Parameters
    ----------
    path
        The log, as it stands on the card.
    source
        What is known of the file.

    Raises
    ------
    LogError
        The file cannot be read, its header is damaged, or it holds no variable that has a name here.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{source.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    if not sniff(data[:4096]):
        raise LogError(
            f"{source.name} does not start like a Crazyflie log of version 1 or 2",
            needed="the file that the uSD deck wrote",
            remedy="copy it again from the card",
        )
    log = decode(data)
    topics = tuple(topic for event in log.events if (topic := _topic(event)) is not None)
    if not topics:
        held = ", ".join(repr(name)[1:-1] for event in log.events for name in event.columns) or "nothing"
        raise LogError(
            f"{source.name} has no samples of a variable with a known name; its header announces {held[:300]}",
            needed="variables such as gyro.x, acc.z, motor.m1",
            remedy="name them in config.txt on the card before the next flight",
        )
    kept, remarks = _finite(topics)
    findings = (*_damage(log), *remarks, *_missing(kept), *_slow(kept))
    return FlightRecord(source=replace(source, firmware="Crazyflie"), topics=kept, findings=findings)


def _topic(event: Event) -> Topic | None:
    """The variables of an event that have a meaning, as channels on the event's clock."""
    channels: list[Channel] = []
    rows: list[FloatArray] = []
    for variable, meaning in MEANINGS.items():
        if variable in event.columns and meaning.channel not in {channel.name for channel in channels}:
            unit = STANDARD_UNITS[meaning.channel]
            channels.append(Channel(name=meaning.channel, unit=unit, source=variable))
            rows.append(_doubles(event.columns[variable], meaning.scale * parse_unit(meaning.unit).factor))
    if all(variable in event.columns for variable in _MOTORS):
        with np.errstate(invalid="ignore"):
            mean = np.mean([_doubles(event.columns[variable], 1.0 / _FULL_THROTTLE) for variable in _MOTORS], axis=0)
        channels.append(Channel(name="thrust_command", unit="1", source="mean of motor.m1 to motor.m4"))
        rows.append(mean)
    if not rows or not event.time_s.size:
        return None
    return Topic(name=event.name, time_s=event.time_s, channels=tuple(channels), values=np.stack(rows))


def _doubles(values: AnyArray, factor: float) -> FloatArray:
    """Values times a factor; what damage made of them may be no number, or none that fits, and is left out later."""
    with np.errstate(invalid="ignore", over="ignore"):
        scaled: FloatArray = values.astype(np.float64) * factor
    return scaled


def _finite(topics: tuple[Topic, ...]) -> tuple[tuple[Topic, ...], tuple[Finding, ...]]:
    """Topics without the samples that are not numbers, and what was left out."""
    kept: list[Topic] = []
    findings: list[Finding] = []
    for topic in topics:
        good = np.isfinite(topic.values).all(axis=0)
        lost = int(good.size - np.count_nonzero(good))
        if lost:
            message = f"{lost} samples of {topic.name} are not numbers and were left out."
            numbers = {"lost_samples": float(lost)}
            findings.append(Finding(kind="gap", severity="info", where=topic.name, message=message, numbers=numbers))
        kept.append(replace(topic, time_s=topic.time_s[good], values=topic.values[:, good]) if lost else topic)
    return tuple(kept), tuple(findings)


def _damage(log: UsdLog) -> Iterator[Finding]:
    if log.checksum_holds and not log.gaps:
        return
    lost = sum(stop - start for start, stop in log.gaps)
    first = log.gaps[0][0] if log.gaps else log.size_bytes
    what = "does not match the content" if not log.checksum_holds else "matches, but records are of unknown types"
    yield Finding(
        kind="corrupt_log",
        severity="warning",
        where=f"byte {first}",
        message=f"The checksum at the end of the log {what}: values may be wrong anywhere. {lost} bytes in "
        f"{len(log.gaps)} places were left out and the rest was read. A vehicle that loses power before the log is "
        "stopped writes none; otherwise copy the log again from the card.",
        numbers={"first_byte": first, "lost_bytes": lost, "places": len(log.gaps), "size_bytes": log.size_bytes},
    )


def _missing(topics: tuple[Topic, ...]) -> Iterator[Finding]:
    held = {channel.name for topic in topics for channel in topic.channels}
    for name, meaning in _NEEDED.items():
        if name not in held:
            yield Finding(
                kind="missing_channel",
                severity="warning",
                where=name,
                message=f"The log does not hold {meaning}. Name them in config.txt on the card before the next flight.",
            )


def _slow(topics: tuple[Topic, ...]) -> Iterator[Finding]:
    for topic in topics:
        rate_hz = topic.sample_rate_hz
        if 0.0 < rate_hz < LOWEST_RATE_HZ and any(topic.row(name) is not None for name in _NEEDED):
            yield Finding(
                kind="rate_too_low",
                severity="warning",
                where=topic.name,
                message=f"{topic.name} was logged at {rate_hz:.1f} Hz, too slow for motor-level work, which needs at "
                f"least {LOWEST_RATE_HZ:.0f} Hz; set a higher frequency in config.txt on the card.",
                numbers={"rate_hz": rate_hz, "needed_hz": LOWEST_RATE_HZ},
            )
