"""MAVLink frames of a telemetry log as tables: walked, checked, and their fields as arrays.

A ``.tlog`` is a row of frames as they came over the radio, each behind eight bytes with the time of the ground station.
The layouts of the few messages that are needed stand here as a table; nothing in the file can name a type, open a
connection or run code.

References
----------
"MAVLink developer guide", sections "Serialization" and "CRC_EXTRA calculation", mavlink.io.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from rotorid.typing import AnyArray, BoolArray, IntArray

STAMP_BYTES = 8
_SIGNATURE_BYTES = 13
_V1, _V2 = 0xFE, 0xFD
_HEADER_BYTES = {_V1: 6, _V2: 10}

# Microseconds of a clock that stands between 1996 and 2105, in front of the first byte of a frame.
_START = re.compile(rb"\x00[\x03-\x0e].{6}[\xfd\xfe]", re.DOTALL)

Group: TypeAlias = tuple[int, int, int]
"""Message number, first byte of the frame (the version), bytes of payload."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Layout:
    """Fields of a message in the order of the wire, and the byte that its checksum adds for them."""

    name: str
    crc_extra: int
    fields: np.dtype[np.void]


def _layout(name: str, crc_extra: int, fields: str) -> Layout:
    """``"I:time_boot_ms f:roll f:pitch"``: each field with the code of its type and, for arrays, its length."""
    codes = {"Q": "<u8", "I": "<u4", "i": "<i4", "H": "<u2", "h": "<i2", "B": "u1", "b": "i1", "f": "<f4"}
    items: list[tuple[str, str]] = []
    for field in fields.split():
        code, _, label = field.partition(":")
        items.append((label, code if code.startswith("S") else code[1:] + codes[code[0]]))
    return Layout(name=name, crc_extra=crc_extra, fields=np.dtype(items))


def _numbered(text: str, start: int, stop: int) -> str:
    return " ".join(text.format(number) for number in range(start, stop))


_AXES = "h:xacc h:yacc h:zacc h:xgyro h:ygyro h:zgyro"
_ESCS = " ".join(_numbered(f"H:{name}{{}}", 1, 5) for name in ("voltage", "current", "totalcurrent", "rpm"))
_SCALED = f"I:time_boot_ms {_AXES}"

LAYOUTS: Mapping[int, Layout] = MappingProxyType(
    {
        0: _layout("HEARTBEAT", 50, "I:custom_mode B:type B:autopilot B:base_mode B:system_status B:mavlink_version"),
        1: _layout("SYS_STATUS", 124, "I:present I:enabled I:health H:load H:voltage_battery"),
        22: _layout("PARAM_VALUE", 220, "f:param_value H:param_count H:param_index S16:param_id B:param_type"),
        26: _layout("SCALED_IMU", 170, _SCALED),
        27: _layout("RAW_IMU", 144, f"Q:time_usec {_AXES}"),
        30: _layout("ATTITUDE", 39, "I:time_boot_ms f:roll f:pitch f:yaw f:rollspeed f:pitchspeed f:yawspeed"),
        31: _layout(
            "ATTITUDE_QUATERNION", 246, "I:time_boot_ms f:q1 f:q2 f:q3 f:q4 f:rollspeed f:pitchspeed f:yawspeed"
        ),
        32: _layout("LOCAL_POSITION_NED", 185, "I:time_boot_ms f:x f:y f:z f:vx f:vy f:vz"),
        36: _layout(
            "SERVO_OUTPUT_RAW",
            222,
            f"I:time_usec {_numbered('H:servo{}_raw', 1, 9)} B:port {_numbered('H:servo{}_raw', 9, 17)}",
        ),
        65: _layout("RC_CHANNELS", 118, f"I:time_boot_ms {_numbered('H:chan{}_raw', 1, 19)} B:chancount"),
        83: _layout(
            "ATTITUDE_TARGET",
            22,
            "I:time_boot_ms f:qw f:qx f:qy f:qz f:body_roll_rate f:body_pitch_rate f:body_yaw_rate f:thrust "
            "B:type_mask",
        ),
        105: _layout("HIGHRES_IMU", 93, "Q:time_usec f:xacc f:yacc f:zacc f:xgyro f:ygyro f:zgyro"),
        116: _layout("SCALED_IMU2", 76, _SCALED),
        129: _layout("SCALED_IMU3", 46, _SCALED),
        148: _layout("AUTOPILOT_VERSION", 178, "Q:capabilities Q:uid I:flight_sw_version"),
        11030: _layout("ESC_TELEMETRY_1_TO_4", 144, _ESCS),
        11031: _layout("ESC_TELEMETRY_5_TO_8", 133, _ESCS),
        140: _layout("ACTUATOR_CONTROL_TARGET", 181, f"Q:time_usec {_numbered('f:control{}', 0, 8)} B:group_mlx"),
    }
)
"""Number of a message to its layout; trailing fields that nobody needs are left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Messages:
    """All messages of one kind, in the order of the file.

    Parameters
    ----------
    received_us
        When the ground station stored each, microseconds since 1970, shape ``(messages,)``.
    system, component
        Who sent each, shape ``(messages,)``.
    fields
        Structured array, shape ``(messages,)``.
    """

    received_us: IntArray
    system: AnyArray
    component: AnyArray
    fields: AnyArray

    def chosen(self, kept: BoolArray) -> Messages:
        """The messages where ``kept`` is true."""
        return Messages(
            received_us=self.received_us[kept],
            system=self.system[kept],
            component=self.component[kept],
            fields=self.fields[kept],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Telemetry:
    """What a walk over a log found.

    Parameters
    ----------
    messages
        Name to the messages whose checksum is right; only those of ``LAYOUTS``.
    frames
        Frames of any kind.
    lost_bytes, places, first_byte
        Bytes outside of frames, in how many places, and the first of them.
    failed
        Frames of a needed message whose checksum is wrong.
    """

    messages: Mapping[str, Messages]
    frames: int
    lost_bytes: int
    places: int
    first_byte: int
    failed: int


def starts_like_telemetry(head: bytes) -> bool:
    """Whether the first bytes of a file are a stamped frame with another one, or the end of the file, behind it."""
    size = _frame_bytes(head, 0)
    return size > 0 and (_frame_bytes(head, size) != 0 or size == len(head))


def decode(data: bytes) -> Telemetry:
    """Find the frames of a log and turn the needed ones into arrays.

    After damage the walk goes on at the next place that looks like a stamped frame. A message counts only when its
    checksum is right; what stands in frames of other kinds is not looked at.

    Parameters
    ----------
    data
        The whole log.

    Examples
    --------
    >>> decode(b"no telemetry").frames
    0
    """
    starts: dict[Group, list[int]] = {}
    frames, lost, places, first, position, behind = 0, 0, 0, 0, 0, -1
    while position < len(data):
        size = _frame_bytes(data, position)
        if size:
            frames += 1
            group = _group(data, position)
            if group[0] in LAYOUTS:
                starts.setdefault(group, []).append(position)
            position += size
            continue
        following = _START.search(data, position + 1)
        stop = len(data) if following is None else following.start()
        # What looked like the start of a frame may be none: losses that touch are one place.
        places, first = places + (position != behind), first if lost else position
        lost, position, behind = lost + stop - position, stop, stop
    messages, failed = _tables(np.frombuffer(data, dtype=np.uint8), starts)
    return Telemetry(messages=messages, frames=frames, lost_bytes=lost, places=places, first_byte=first, failed=failed)


def _frame_bytes(data: bytes, position: int) -> int:
    """Bytes of the stamped frame that starts here; zero when none does, or when the data end inside of it."""
    start = position + STAMP_BYTES
    if _START.match(data, position) is None or start + 3 > len(data):
        return 0
    size = STAMP_BYTES + _HEADER_BYTES[data[start]] + data[start + 1] + 2
    if data[start] == _V2:
        if data[start + 2] > 1:  # the only flag that is defined says that a signature follows
            return 0
        size += _SIGNATURE_BYTES * data[start + 2]
    return size if position + size <= len(data) else 0


def _group(data: bytes, position: int) -> Group:
    start = position + STAMP_BYTES
    if data[start] == _V1:
        return data[start + 5], _V1, data[start + 1]
    return int.from_bytes(data[start + 7 : start + 10], "little"), _V2, data[start + 1]


def _tables(data: AnyArray, starts: Mapping[Group, list[int]]) -> tuple[dict[str, Messages], int]:
    parts: dict[int, list[tuple[IntArray, Messages]]] = {}
    failed = 0
    for group, positions in starts.items():
        place = np.array(positions, dtype=np.int64)
        right, messages = _decoded(data, place, group)
        failed += int(np.count_nonzero(~right))
        parts.setdefault(group[0], []).append((place[right], messages.chosen(right)))
    return {LAYOUTS[number].name: joined for number, found in parts.items() for joined in _in_order(found)}, failed


def _in_order(parts: list[tuple[IntArray, Messages]]) -> Iterator[Messages]:
    """Messages of different length, as MAVLink 2 cuts zeros off, back in the order of the file."""
    order = np.argsort(np.concatenate([place for place, _ in parts]))
    joined = [messages for _, messages in parts]
    if order.size:
        yield Messages(
            received_us=np.concatenate([item.received_us for item in joined])[order],
            system=np.concatenate([item.system for item in joined])[order],
            component=np.concatenate([item.component for item in joined])[order],
            fields=np.concatenate([item.fields for item in joined])[order],
        )


def _decoded(data: AnyArray, place: IntArray, group: Group) -> tuple[BoolArray, Messages]:
    """Frames of one kind and length: whether the checksum is right, and the messages."""
    number, version, n_payload = group
    layout, n_header = LAYOUTS[number], _HEADER_BYTES[version]
    frames = data[place[:, None] + np.arange(STAMP_BYTES + n_header + n_payload + 2)]
    stamps = np.ascontiguousarray(frames[:, :STAMP_BYTES]).view(">u8")[:, 0]
    header = frames[:, STAMP_BYTES : STAMP_BYTES + n_header]
    payload = frames[:, STAMP_BYTES + n_header : -2]
    announced = np.ascontiguousarray(frames[:, -2:]).view("<u2")[:, 0]
    right = checksum(np.concatenate([header[:, 1:], payload], axis=1), layout.crc_extra) == announced
    known = min(n_payload, layout.fields.itemsize)
    whole = np.zeros((place.size, layout.fields.itemsize), dtype=np.uint8)
    whole[:, :known] = payload[:, :known]
    sender = 3 if version == _V1 else 5
    messages = Messages(
        received_us=stamps.astype(np.int64),
        system=header[:, sender],
        component=header[:, sender + 1],
        fields=whole.view(layout.fields)[:, 0],
    )
    return right, messages


def checksum(rows: AnyArray, crc_extra: int) -> AnyArray:
    """CRC-16/MCRF4XX of each row, continued with one more byte.

    Parameters
    ----------
    rows
        ``uint8``, shape ``(rows, bytes)``.
    crc_extra
        Byte that stands for the layout of the message.

    Returns
    -------
    AnyArray
        ``uint16``, shape ``(rows,)``.

    Examples
    --------
    The check value of the catalog, for the text 123456789:

    >>> import numpy as np
    >>> hex(int(checksum(np.frombuffer(b"12345678", dtype=np.uint8)[None, :], ord("9"))[0]))
    '0x6f91'
    """
    crc = np.full(rows.shape[0], 0xFFFF, dtype=np.uint16)
    extra = np.full(rows.shape[0], crc_extra, dtype=np.uint8)
    for column in (*rows.T, extra):
        mixed = column.astype(np.uint16) ^ (crc & 0xFF)
        mixed = (mixed ^ (mixed << 4)) & 0xFF
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    return crc
