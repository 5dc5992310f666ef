"""Reader of MAVLink telemetry logs (``.tlog``), as ground stations write them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.errors import LogError
from rotorid.io.mavlink import Messages, Telemetry, decode, starts_like_telemetry
from rotorid.io.privacy import without_places
from rotorid.io.tlog_clock import BootClock
from rotorid.io.tlog_topics import message_topics, pulse_topics
from rotorid.typing import AnyArray

FORMAT = "MAVLink telemetry"

ARDUPILOT, PX4 = 3, 12
"""``HEARTBEAT.autopilot`` of the two firmwares whose habits are known."""

_AUTOPILOT_COMPONENT = 1
_INTEGER_TYPES = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}
_REMEDY = "copy it again from the ground station"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a row of MAVLink frames behind eight-byte stamps."""
    return starts_like_telemetry(head)


def read(path: Path, source: Source) -> FlightRecord:
    """Read a telemetry log.

    Telemetry is a decimated copy of what the autopilot knows, often 4 to 50 Hz, without a filter against aliasing: good
    for an overview and for slow modes, not for motor lag and delay. All stamps are seconds since the boot of the
    autopilot, as it sent them; messages without a stamp stand where the ground station received them. Only the
    autopilot that sent most is read. Positions are relative to the origin of the estimator.

    Parameters
    ----------
    path
        The log, unpacked.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        The file cannot be read, holds no frame, or nothing that the package has a name for.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    telemetry = decode(data)
    if not telemetry.messages:
        raise LogError(
            f"{source.name} holds {telemetry.frames} MAVLink frames and no message that is known, intact",
            needed="telemetry of a flight, such as ATTITUDE",
            remedy=_REMEDY,
        )
    sender = _autopilot(telemetry.messages)
    messages = dict(_sent_by(telemetry.messages, sender))
    firmware = _firmware(messages)
    parameters = _parameters(messages, firmware)
    clock = BootClock.of(messages.values())
    topics = (
        *message_topics(messages, clock, scaled_raw=firmware == ARDUPILOT),
        *(pulse_topics(messages, clock, parameters) if firmware == ARDUPILOT else ()),
    )
    if not topics:
        raise LogError(
            f"{source.name} holds {', '.join(messages) or 'no message'} of the autopilot {sender[0]}",
            needed="a telemetry log of a flight, such as ATTITUDE with SERVO_OUTPUT_RAW",
            remedy="raise the stream rates (SR0_EXTRA1, SR0_RAW_SENS, SR0_RC_CHAN), or use the log on the SD card",
        )
    return FlightRecord(
        source=replace(source, firmware={ARDUPILOT: "ArduPilot", PX4: "PX4"}.get(firmware, "")),
        topics=topics,
        parameters=without_places(parameters),
        instruments=_instruments(topics),
        findings=(
            *_damage(telemetry, len(data)),
            *_others(telemetry.messages, sender),
            *clock.findings(),
            _decimated(topics),
            *_missing(topics),
        ),
    )


def _autopilot(messages: Mapping[str, Messages]) -> tuple[int, int]:
    """System and component that sent most, a flight controller rather than a camera or the ground station."""
    senders = np.concatenate([_senders(item) for item in messages.values()])
    found, count = np.unique(senders, return_counts=True)
    best = max(zip(found.tolist(), count.tolist(), strict=True), key=lambda it: (it[0] & 0xFF == 1, it[1]))[0]
    return best >> 8, best & 0xFF


def _senders(messages: Messages) -> AnyArray:
    return messages.system.astype(np.int64) << 8 | messages.component


def _sent_by(messages: Mapping[str, Messages], sender: tuple[int, int]) -> Iterator[tuple[str, Messages]]:
    for name, item in messages.items():
        chosen = item.chosen(_senders(item) == (sender[0] << 8 | sender[1]))
        if chosen.fields.size:
            yield name, chosen


def _firmware(messages: Mapping[str, Messages]) -> int:
    beats = messages.get("HEARTBEAT")
    return -1 if beats is None else int(beats.fields["autopilot"][-1])


def _parameters(messages: Mapping[str, Messages], firmware: int) -> dict[str, float]:
    """The autopilot's parameters as far as they were sent; of one that changed, the last value."""
    if "PARAM_VALUE" not in messages:
        return {}
    fields = messages["PARAM_VALUE"].fields
    found: dict[str, float] = {}
    for label, value, kind in zip(fields["param_id"], fields["param_value"], fields["param_type"], strict=True):
        # PX4 lays the bytes of an integer into the float; ArduPilot sends its value.
        whole = firmware == PX4 and int(kind) in _INTEGER_TYPES
        number = value.tobytes() if whole else b""
        plain = float(np.frombuffer(number, _INTEGER_TYPES[int(kind)])[0]) if whole else float(value)
        name = label.split(b"\0")[0].decode("ascii", errors="replace")
        if name and np.isfinite(plain):
            found[name] = plain
    return found


def _instruments(topics: tuple[Topic, ...]) -> dict[str, tuple[str, ...]]:
    held = {channel.name for topic in topics for channel in topic.channels}
    return {axis: (f"{axis}_stick",) for axis in ("roll", "pitch", "yaw", "thrust") if f"{axis}_stick" in held}


def _damage(telemetry: Telemetry, size_bytes: int) -> Iterator[Finding]:
    if not telemetry.lost_bytes and not telemetry.failed:
        return
    where = f", first at byte {telemetry.first_byte} of {size_bytes}" if telemetry.lost_bytes else ""
    yield Finding(
        kind="corrupt_log",
        severity="warning",
        where="telemetry",
        message=f"{telemetry.lost_bytes} bytes of the file belong to no frame{where}, and {telemetry.failed} frames "
        f"have a wrong checksum; both were left out. A radio link may cause that; otherwise {_REMEDY}.",
        numbers={
            "lost_bytes": telemetry.lost_bytes,
            "places": telemetry.places,
            "first_byte": telemetry.first_byte,
            "wrong_checksums": telemetry.failed,
            "frames": telemetry.frames,
        },
    )


def _others(messages: Mapping[str, Messages], sender: tuple[int, int]) -> Iterator[Finding]:
    if "ATTITUDE" not in messages:
        return
    item = messages["ATTITUDE"]
    systems = np.unique(item.system[item.component == _AUTOPILOT_COMPONENT])
    others = systems[systems != sender[0]].tolist()
    if others:
        yield Finding(
            kind="several_vehicles",
            severity="warning",
            where="telemetry",
            message=f"The log holds several vehicles. System {sender[0]}, which sent most, was read; "
            f"{', '.join(map(str, others))} left out.",
            numbers={"read_system": sender[0], "other_systems": len(others)},
        )


def _decimated(topics: tuple[Topic, ...]) -> Finding:
    fastest = max(topics, key=lambda topic: topic.sample_rate_hz)
    return Finding(
        kind="decimated",
        severity="info",
        where="telemetry",
        message="Telemetry is decimated without a filter, so that faster motion appears as slower: the fastest topic, "
        f"{fastest.name}, comes at {fastest.sample_rate_hz:.0f} Hz. Use the log on the vehicle's SD card for motor "
        "lag, delay and anything above a fifth of that rate.",
        numbers={"fastest_hz": fastest.sample_rate_hz},
    )


def _missing(topics: tuple[Topic, ...]) -> Iterator[Finding]:
    held = {channel.name for topic in topics for channel in topic.channels}
    if not any(name.endswith("_command") or name.startswith("motor_") for name in held):
        yield Finding(
            kind="missing_channel",
            severity="warning",
            where="motor_1",
            message="The log does not say what the motors were told: that needs SERVO_OUTPUT_RAW and the parameters "
            "SERVOn_FUNCTION or FRAME_CLASS of ArduPilot, or ACTUATOR_CONTROL_TARGET of PX4.",
        )
