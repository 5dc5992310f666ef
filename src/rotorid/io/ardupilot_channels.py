"""Which column of which ArduPilot message is which channel, as tables, and the topics they make."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rotorid.data.channel import Channel
from rotorid.data.record import Topic
from rotorid.io.dataflash_formats import Table
from rotorid.typing import AnyArray, BoolArray
from rotorid.units import parse_unit


@dataclass(frozen=True, slots=True)
class Row:
    """One column of a message: the channel that it is, its unit, and a factor where no unit says it.

    The channel is ``scale * value + offset`` in ``unit``.
    """

    column: str
    channel: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0


def _rows(text: str, unit: str) -> tuple[Row, ...]:
    """Rows that share a unit: ``"R:p P:q"``."""
    pairs = (pair.split(":") for pair in text.split())
    return tuple(Row(column, channel, unit) for column, channel in pairs)


_RATES = "R:p RDes:p_setpoint P:q PDes:q_setpoint Y:r YDes:r_setpoint"
_OUTPUTS = "ROut:roll_command POut:pitch_command YOut:yaw_command"
_EKF = (*_rows("VN:velocity_north VE:velocity_east VD:velocity_down", "m/s"), *_rows("PN:north PE:east PD:down", "m"))
_ATTITUDE = _rows(
    "Roll:phi DesRoll:phi_setpoint Pitch:theta DesPitch:theta_setpoint Yaw:psi DesYaw:psi_setpoint", "deg"
)

MESSAGES: Mapping[str, tuple[Row, ...]] = MappingProxyType(
    {
        "RATE": (*_rows(_OUTPUTS + " AOut:thrust_command", "1"), *_rows(_RATES, "deg/s")),
        "IMU": (*_rows("GyrX:p GyrY:q GyrZ:r", "rad/s"), *_rows("AccX:ax AccY:ay AccZ:az", "m/s^2")),
        "ANG": _ATTITUDE,
        "ATT": _ATTITUDE,
        "XKF1": _EKF,
        "NKF1": _EKF,
        "EKF1": _EKF,
        "CTUN": (Row("ThO", "thrust_command", "1"), Row("ThrOut", "thrust_command", "1", 1e-3)),
        "BAT": _rows("Volt:battery_voltage", "V"),
        "CURR": _rows("Volt:battery_voltage", "V"),
    }
)
"""Messages in order of preference, the rows of old and new firmware side by side."""

SYSTEM_ID = (*_rows("Gx:p Gy:q Gz:r", "deg/s"), *_rows("Ax:ax Ay:ay Az:az", "m/s^2"))
"""Unfiltered gyros and accelerometers that SYSTEMID mode logs."""

LEGACY_RATE = (
    Row("ROut", "roll_command", "1", 1.0 / 4500.0),
    Row("RllOut", "roll_command", "1", 1.0 / 4500.0),
    Row("POut", "pitch_command", "1", 1.0 / 4500.0),
    Row("PitOut", "pitch_command", "1", 1.0 / 4500.0),
    Row("YOut", "yaw_command", "1", 1.0 / 4500.0),
    Row("YawOut", "yaw_command", "1", 1.0 / 4500.0),
    Row("AOut", "thrust_command", "1", 1e-3),
    Row("AccOut", "thrust_command", "1", 1e-3),
    *_rows(_RATES + " Rll:p RllDes:p_setpoint Pit:q PitDes:q_setpoint Yaw:r YawDes:r_setpoint", "cdeg/s"),
)
"""``RATE`` of firmware before 3.4: centidegrees per second, mixer inputs of ±4500, throttle of 0 to 1000."""

_INSTANCE_COLUMNS = ("I", "Inst", "Instance", "C")


def is_legacy_rate(table: Table) -> bool:
    """Whether ``RATE`` is in the units of firmware before 3.4: its outputs are then far beyond one."""
    if "RllOut" in table:
        return True
    outputs = [table.column(name) for name in ("ROut", "POut", "YOut", "AOut") if table.holds_numbers(name)]
    return any(bool(np.any(np.abs(output[np.isfinite(output)]) > 1.5)) for output in outputs)


def instances(table: Table) -> AnyArray | None:
    """Number of the sensor behind each message, or ``None`` when the messages are not numbered."""
    names = (table.instance_column, *_INSTANCE_COLUMNS)
    column = next((name for name in names if name is not None and table.holds_numbers(name)), None)
    return None if column is None else table.column(column)


def topic_of(
    table: Table, rows: Iterable[Row], *, name: str | None = None, chosen: BoolArray | slice | None = None
) -> Topic | None:
    """The channels that a table holds, or ``None`` when it holds none of the rows or has no clock.

    Parameters
    ----------
    table
        Messages of one kind.
    rows
        The columns looked for; a column that is not there is left out.
    name
        Name of the topic, when it is not that of the message.
    chosen
        The messages that belong to the topic; all when not given.
    """
    held = [row for row in rows if table.holds_numbers(row.column)]
    part = table if chosen is None else table.chosen(chosen)
    time_s = part.time_s
    if not held or time_s is None:
        return None
    values = part.numbers(*(row.column for row in held))
    with np.errstate(over="ignore"):
        for target, row in zip(values, held, strict=True):
            target *= row.scale
            target += row.offset
            target *= parse_unit(row.unit).factor
    return Topic(
        name=name or table.name,
        time_s=time_s,
        channels=tuple(
            Channel(name=row.channel, unit=parse_unit(row.unit).si, source=f"{table.name}.{row.column}") for row in held
        ),
        values=values,
    )


def common_topics(tables: Mapping[str, Table]) -> Iterator[Topic]:
    """Topics of the messages that every log has, best first; of several sensors the first one."""
    for name, rows in MESSAGES.items():
        if name not in tables:
            continue
        table = tables[name]
        legacy = name == "RATE" and is_legacy_rate(table)
        number = instances(table)
        first = None if number is None else number == number.min()
        topic = topic_of(table, LEGACY_RATE if legacy else rows, chosen=first)
        if topic is not None:
            yield topic
