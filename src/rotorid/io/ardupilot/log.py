"""ArduPilot logs as flight records: which column of which DataFlash message is which channel of the vocabulary.

Most messages become topics by a table. Three things need more than a row of it: the motors, whose channels and pulse
widths the parameters show; the pilot's sticks; and the runs of SYSTEMID mode, each a declared maneuver with what was
injected where.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.ardupilot.advice import decimation_findings, missing_rate, slow_topics
from rotorid.autopilots.ardupilot.firmware import Firmware, named
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import AXES, Channel, FlightRecord, Source, Status, Topic, Unread
from rotorid.errors import LogError, UsageError
from rotorid.frames import euler_from_quaternion
from rotorid.io.ardupilot.batches import BATCH_MESSAGES, sensor_topics
from rotorid.io.ardupilot.dataflash import Table, decode, sniff
from rotorid.io.ardupilot.firmware import firmware_of, is_centivolts, is_legacy_rate
from rotorid.io.ardupilot.status import STATUS_MESSAGES, status_of
from rotorid.io.ardupilot.system_id import ENTRIES, Run, declared_maneuvers, run_findings, runs_of
from rotorid.io.files import file_bytes
from rotorid.io.flags import vehicle_findings
from rotorid.io.parameters import changed_in, kept_parameters, parameters_changed
from rotorid.typing import AnyArray, BoolArray
from rotorid.units import parse_unit

__all__ = ["FORMAT", "read", "sniff"]

FORMAT = "ArduPilot DataFlash"


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
_WIND = _rows("VWN:wind_north VWE:wind_east", "m/s")
_ATTITUDE = _rows(
    "Roll:phi DesRoll:phi_setpoint Pitch:theta DesPitch:theta_setpoint Yaw:psi DesYaw:psi_setpoint", "deg"
)


def _of_position_control(letter: str, way: str) -> tuple[Row, ...]:
    """Columns of ``PSCN``, ``PSCE``, ``PSCD``: D is desired by stick or path, T is asked for by the loop before."""
    return (
        Row(f"DV{letter}", f"velocity_{way}_feedforward", "m/s"),
        Row(f"TA{letter}", f"acceleration_{way}_setpoint", "m/s^2"),
    )


_NOTCHES = 12


def _notches(*columns: str) -> tuple[Row, ...]:
    """Centers of a notch for each motor, or of one; older and newer names side by side."""
    return tuple(
        Row(column.format(number), f"notch_frequency_{number}", "Hz")
        for column in columns
        for number in range(1, 1 + (_NOTCHES if "{}" in column else 1))
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
        "PSCN": _of_position_control("N", "north"),
        "PSCE": _of_position_control("E", "east"),
        "PSCD": _of_position_control("D", "down"),
        "CTUN": (
            Row("ThO", "thrust_command", "1"),
            Row("ThrOut", "thrust_command", "1", 1e-3),
            Row("ThH", "hover_thrust", "1"),
        ),
        "BAT": (*_rows("Volt:battery_voltage", "V"), *_rows("Curr:battery_current", "A")),
        "CURR": (*_rows("Volt:battery_voltage", "V"), *_rows("Curr:battery_current", "A")),
        "PIDR": _rows("P:roll_p_term I:roll_i_term D:roll_d_term FF:roll_f_term Dmod:roll_slew_factor", "1"),
        "PIDP": _rows("P:pitch_p_term I:pitch_i_term D:pitch_d_term FF:pitch_f_term Dmod:pitch_slew_factor", "1"),
        "PIDY": _rows("P:yaw_p_term I:yaw_i_term D:yaw_d_term FF:yaw_f_term Dmod:yaw_slew_factor", "1"),
        "VIBE": (
            *_rows("VibeX:ax_vibration VibeY:ay_vibration VibeZ:az_vibration", "m/s^2"),
            Row("Clip", "accel_clips", "1"),
            Row("Clip0", "accel_clips", "1"),
        ),
        "XKF2": _WIND,
        "NKF2": _WIND,
        # Where the notches were, then where they should have been; of several harmonic notches the first.
        "FCN": _notches("CF{}"),
        "FCNS": _notches("CF"),
        "FTN": _notches("NF{}", "DnF{}"),
        "FTNS": _notches("NF"),
        "FTN1": _notches("DnF"),
    }
)
"""Messages in order of preference, the rows of old and new firmware side by side."""

_NOTCH_MESSAGES = ("FCN", "FCNS", "FTN", "FTNS", "FTN1")

SYSTEM_ID = (*_rows("Gx:p Gy:q Gz:r", "deg/s"), *_rows("Ax:ax Ay:ay Az:az", "m/s^2"))
"""Unfiltered gyros and accelerometers that SYSTEMID mode logs."""

_LEGACY_RATE = (
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

_CENTIVOLTS = (Row("Volt", "battery_voltage", "V", 0.01), Row("Curr", "battery_current", "A", 0.01))
"""Voltage and current of firmware before 3.4: whole hundredths."""

_VOLTAGES = ("BAT", "CURR")

_PULSES = ("C{}", "Ch{}", "Chan{}")
"""Names of the columns of ``RCOU`` and ``RCIN``, newest first; firmware 3.1 to 3.3 has the others."""

_INSTANCE_COLUMNS = ("I", "Inst", "Instance", "C")

MOTOR_FUNCTIONS: Mapping[int, int] = MappingProxyType(
    {function: function - 32 for function in range(33, 41)} | {function: function - 73 for function in range(82, 86)}
)
"""``SERVOn_FUNCTION`` to the number of the motor."""

FRAME_CLASS_MOTORS: Mapping[int, int] = MappingProxyType({1: 4, 2: 6, 3: 8, 4: 8, 5: 6, 7: 3, 12: 12, 14: 10})
"""``FRAME_CLASS`` to the number of motors."""

FRAME_NAME_MOTORS: Mapping[str, int] = MappingProxyType(
    {"QUAD": 4, "HEXA": 6, "OCTA": 8, "OCTA_QUAD": 8, "OCTAQUAD": 8, "Y6": 6, "TRI": 3, "DECA": 10, "DODECAHEXA": 12}
)
"""The same as the message ``Frame: QUAD/X`` names it."""

DSHOT_TYPES = range(4, 8)
"""``MOT_PWM_TYPE`` of digital protocols, which know no limits but 1000 and 2000."""

_PWM_RANGE = 8
"""``MOT_PWM_TYPE`` of pulses that go through the limits of each output."""

STICKS: Mapping[str, tuple[str, int]] = MappingProxyType(
    {"roll": ("RCMAP_ROLL", 1), "pitch": ("RCMAP_PITCH", 2), "yaw": ("RCMAP_YAW", 4), "thrust": ("RCMAP_THROTTLE", 3)}
)
"""Axis to the parameter that names its stick's channel, and the usual channel."""

QUATERNIONS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    dict.fromkeys(("XKQ", "XKQ1", "NKQ1", "AHR2"), ("Q1", "Q2", "Q3", "Q4"))
)
"""Messages with an attitude as a quaternion, for logs without its angles."""

_OWN = frozenset({"SIDD", "SIDS", "PARM", "VER", "MSG", "RCOU", "RCIN", "ESC", "RPM", "TIME"})
_OLD_ESCS = frozenset(f"ESC{number}" for number in range(1, 33))
WANTED = frozenset({*MESSAGES, *QUATERNIONS, *STATUS_MESSAGES, *BATCH_MESSAGES, *_OWN, *_OLD_ESCS})
"""Messages that are read at all."""


def read(path: Path, source: Source) -> FlightRecord:
    """Read a log.

    Rates and accelerations come from ``SIDD`` while SYSTEMID mode ran, else from ``RATE`` and ``IMU``; mixer inputs
    from ``RATE``. All stamps are those of the log. ``RATE`` and ``IMU`` have passed the gyro filter
    (``INS_GYRO_FILTER``), ``SIDD`` has not: a model fitted to the former carries the filter's delay. Positions are
    relative to the origin of the estimator; where on Earth that is does not enter the record. The file is mapped and
    only the messages behind the channels are collected, so that memory follows the record and not the log.

    Parameters
    ----------
    path
        The log, unpacked.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        The file cannot be read or is no DataFlash log.
    """
    log = decode(file_bytes(path), WANTED)
    if not log.tables.keys() - _NO_FLIGHT:
        log = decode(file_bytes(path))  # the error names what is there
    return record_of(log.tables, source, log.findings, log.defined)


def record_of(
    tables: Mapping[str, Table],
    source: Source,
    findings: Iterable[Finding] = (),
    defined: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> FlightRecord:
    """The flight record behind the messages of an ArduPilot log, whatever container they came from.

    Parameters
    ----------
    tables
        Message name to its table.
    source
        What is known of the file; the firmware is filled in.
    findings
        Of the container.
    defined
        Name to columns of the messages that the log defines, whether there is one or not.

    Raises
    ------
    LogError
        The messages are those of PX4 before 2017, which framed its logs alike, or hold no channel that is read.
    """
    if ("TIME" in tables and "StartTime" in tables["TIME"]) or _is_sdlog2(defined):
        raise _sdlog2(source.name, empty=not tables.keys() - _NO_FLIGHT)
    parameters, firmware = _parameters(tables), firmware_of(tables)
    if not firmware.text:
        firmware = named(source.firmware)
    runs = runs_of(tables, parameters)
    sticks = stick_topic(tables, parameters)
    topics = (
        *_system_id_topics(tables, runs),
        *_common_topics(tables, firmware),
        *motor_topics(tables, parameters),
        *(() if sticks is None else (sticks,)),
        *sensor_topics(tables, parameters),
    )
    topics = (*topics, *_attitude(tables, topics))
    if not any(topic.channels and topic.time_s.size for topic in topics):
        raise _empty(source.name, tables)
    status = status_of(tables, parameters, firmware.text, _span_s(topics))
    return FlightRecord(
        source=replace(source, firmware=firmware.text),
        topics=topics,
        parameters=kept_parameters(parameters),
        declared=declared_maneuvers(runs),
        instruments=_instruments(runs, sticks),
        findings=(
            *findings,
            *vehicle_findings(status),
            *_changed(tables, status),
            *run_findings(runs),
            *decimation_findings(topics, [run.band_rad_s[1] if run.band_rad_s else 0.0 for run in runs], parameters),
            *_dialect(tables, firmware, parameters),
            *_contradictions(tables),
            *slow_topics(topics, parameters, firmware),
        ),
        status=status,
        unread=tuple(_unread(tables, topics)),
    )


def _attitude(tables: Mapping[str, Table], topics: Sequence[Topic]) -> Iterator[Topic]:
    """Angles from the first quaternion of a log that lacks them."""
    if any(topic.row("phi") is not None for topic in topics):
        return
    for name, columns in QUATERNIONS.items():
        table = tables.get(name)
        if table is None or not table.holds_numbers(*columns):
            continue
        number = instances(table)
        part = table if number is None else table.chosen(number == number.min())
        if part.time_s is not None and len(part):
            channels = tuple(Channel(name=angle, unit="rad", source=f"{name}.Q") for angle in ("phi", "theta", "psi"))
            angles = euler_from_quaternion(part.numbers(*columns))
            yield Topic(name=name, time_s=part.time_s, channels=channels, values=angles)
            return


_NEAR: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "RCOU": ("motor_", "neither SERVOn_FUNCTION nor a frame names its motors"),
        "ESC": ("motor_speed_", "none of its instances is the output of a motor (SERVOn_FUNCTION)"),
        "RPM": ("motor_speed_", "its sensors are assigned to no motor"),
    }
)
"""Messages near to channels that a log may lack: these, and why they do not come from there."""


def _unread(tables: Mapping[str, Table], topics: Sequence[Topic]) -> Iterator[Unread]:
    logged = {channel.name for topic in topics for channel in topic.channels}
    for name, (channels, why) in _NEAR.items():
        time_s = tables[name].time_s if name in tables else None
        item = Unread(name=name, channels=(channels,), why=why)
        if time_s is not None and time_s.size and not any(map(item.near, logged)):
            span_s = float(np.ptp(time_s))
            yield replace(item, rate_hz=(time_s.size - 1) / span_s if span_s > 0.0 else 0.0)


def _span_s(topics: tuple[Topic, ...]) -> tuple[float, float]:
    """First and last stamp of the topic that lasts longest."""
    longest = max((topic.time_s for topic in topics if topic.time_s.size), key=np.ptp, default=np.zeros(1))
    return float(longest[0]), float(longest[-1])


def _parameters(tables: Mapping[str, Table]) -> Mapping[str, float]:
    """The autopilot's parameters; of one that changed in flight, the last value."""
    table = tables.get("PARM")
    if table is None or not (table.holds_text("Name") and table.holds_numbers("Value")):
        return {}
    return {
        str(name): float(value)
        for name, value in zip(table.column("Name"), table.column("Value"), strict=True)
        if np.isfinite(value)
    }


def _changed(tables: Mapping[str, Table], status: Status) -> Iterator[Finding]:
    """Gains and filters that changed from when the motors first could run."""
    table = tables.get("PARM")
    if table is None or not (table.holds_text("Name") and table.holds_numbers("Value")):
        return
    stated = list(zip(map(str, table.column("Name")), map(float, table.column("Value")), strict=True))
    begun = 0
    if status.armed and table.time_s is not None:
        begun = int(np.searchsorted(table.time_s, status.armed[0][0]))
    if changed := changed_in([*dict(stated[:begun]).items(), *stated[begun:]]):
        yield parameters_changed(changed, "Parameters changed after arming")


_SDLOG2 = frozenset({"ATSP", "ATTC", "LPSP", "GPSP", "SENS", "LPOS"})
"""Messages that PX4 defined and ArduPilot never did."""


def _is_sdlog2(defined: Mapping[str, tuple[str, ...]]) -> bool:
    return len(_SDLOG2 & defined.keys()) > 1 or "qw" in defined.get("ATT", ())


def _sdlog2(name: str, *, empty: bool) -> LogError:
    kind = "a log of PX4 before 2017 (sdlog2)"
    if empty:
        return LogError(
            f"{name} is the beginning of {kind}: it defines messages and contains none",
            needed="a log of a flight",
            remedy="copy it again from the card; if it is the same there, arm, since it is written in flight only",
        )
    return LogError(
        f"{name} is {kind}, which is framed like ArduPilot's and contains other messages",
        needed="a PX4 .ulg, or a table that a mapping can name",
        remedy="convert it with sdlog2_dump.py of PX4's Tools/sdlog2 to CSV, and name its columns with --map FILE.toml",
    )


def _empty(name: str, tables: Mapping[str, Table]) -> LogError:
    """The error of a log without a message of a flight, and the one setting that mends it."""
    held = [message for message, table in tables.items() if message.partition("#")[0] not in _NO_FLIGHT]
    timeless = {name: len(tables[name]) for name in held if tables[name].clock is None and name in _OF_FLIGHT}
    if timeless:
        counts = ", ".join(f"{count} {message}" for message, count in timeless.items())
        return LogError(
            f"{name} contains {counts}, which have no stamps (TimeUS, TimeMS), as firmware before 3.2 logs them",
            needed="stamps, without which nothing over time can be computed",
            remedy="if the text was made from a .bin of newer firmware, give the .bin; else update and fly again",
        )
    if held:
        came, remedy = f"no rates, attitude or motor outputs, only {', '.join(held[:5])}", "set LOG_BITMASK = 176126"
    else:
        came, remedy = "no flight, only definitions and parameters", "arm, or set LOG_DISARMED = 1 to log before arming"
    return LogError(f"{name} contains {came}", needed="a log of a flight, such as RATE with IMU", remedy=remedy)


_OF_FLIGHT = frozenset({*MESSAGES, "RCOU", "MOT", "MOTB", "INAV", "NTUN"})
_NO_FLIGHT = frozenset({"FMT", "FMTU", "UNIT", "MULT", "PARM", "VER", "MSG"})


def _instruments(runs: tuple[Run, ...], sticks: Topic | None) -> Mapping[str, tuple[str, ...]]:
    """Signals without feedback: the injection where there was one, then the stick, which a pilot closes slowly."""
    excited = {run.axis for run in runs}
    channels = () if sticks is None else tuple(channel.name for channel in sticks.channels)
    listed = {
        axis: (
            *([f"{axis}_excitation"] if axis in excited else []),
            *([f"{axis}_stick"] if f"{axis}_stick" in channels else []),
        )
        for axis in AXES
    }
    return {axis: names for axis, names in listed.items() if names}


def _dialect(tables: Mapping[str, Table], firmware: Firmware, parameters: Mapping[str, float]) -> Iterator[Finding]:
    if "RATE" not in tables:
        yield missing_rate(firmware, parameters)
    elif is_legacy_rate(tables["RATE"], firmware):
        yield remark(
            "legacy_units",
            "RATE",
            "RATE is in the units of firmware before 3.4: rates were read as centidegrees per second, roll, "
            "pitch and yaw outputs as parts of 4500, throttle as parts of 1000",
        )
    for name in _VOLTAGES:
        if name in tables and is_centivolts(tables[name], "Volt"):
            yield remark(
                "legacy_units", name, f"{name}.Volt was read as hundredths of a volt, as firmware before 3.4 logs it"
            )


def _common_topics(tables: Mapping[str, Table], firmware: Firmware) -> Iterator[Topic]:
    """Topics of the messages that every log has, best first; of several sensors the first one."""
    for name, rows in MESSAGES.items():
        if name not in tables:
            continue
        table = tables[name]
        number = None if name.startswith("PID") else instances(table)
        first = None if number is None else number == number.min()
        rows = _in_units_of(table, rows, firmware)
        if name in _NOTCH_MESSAGES:
            # A message has room for more motors than there are, and is no number while its notch is at rest.
            rows = tuple(
                row for row in rows if table.holds_numbers(row.column) and np.nan_to_num(table.column(row.column)).any()
            )
        topic = topic_of(table, rows, chosen=first)
        if topic is not None:
            yield topic


def _in_units_of(table: Table, rows: tuple[Row, ...], firmware: Firmware) -> tuple[Row, ...]:
    """The rows of a message in the units of the firmware that wrote it."""
    if table.name == "RATE" and is_legacy_rate(table, firmware):
        return _LEGACY_RATE
    if table.name in _VOLTAGES and is_centivolts(table, "Volt"):
        return _CENTIVOLTS
    return rows


def _is_contradicted(table: Table, row: Row) -> bool:
    """Whether the log declares another unit for a column than the one that it is known to have."""
    label = table.units.get(row.column, "")
    try:
        declared = parse_unit(label)
    except UsageError:
        return False
    known = parse_unit(row.unit)
    return bool(label) and declared.si == known.si and not math.isclose(declared.factor, known.factor, rel_tol=1e-6)


def _contradictions(tables: Mapping[str, Table]) -> Iterator[Finding]:
    for name, rows in {**MESSAGES, "SIDD": SYSTEM_ID}.items():
        wrong = [row for row in rows if name in tables and _is_contradicted(tables[name], row)]
        if wrong:
            columns = ", ".join(f"{name}.{row.column}" for row in wrong)
            label = tables[name].units[wrong[0].column]
            yield warn(
                "corrupt_log",
                name,
                f"the log declares {label} for {columns}, which ArduPilot logs in {wrong[0].unit}; since one of the "
                "two is wrong, they were left out",
                columns=len(wrong),
            )


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
    numeric_rows = [row for row in rows if table.holds_numbers(row.column) and not _is_contradicted(table, row)]
    part = table if chosen is None else table.chosen(chosen)
    time_s = part.time_s
    if not numeric_rows or time_s is None:
        return None
    values = part.numbers(*(row.column for row in numeric_rows))
    with np.errstate(over="ignore"):
        for target, row in zip(values, numeric_rows, strict=True):
            target *= row.scale
            target += row.offset
            target *= parse_unit(row.unit).factor
    return Topic(
        name=name or table.name,
        time_s=time_s,
        channels=tuple(
            Channel(name=row.channel, unit=parse_unit(row.unit).si, source=f"{table.name}.{row.column}")
            for row in numeric_rows
        ),
        values=values,
    )


def instances(table: Table) -> AnyArray | None:
    """Number of the sensor behind each message, or ``None`` when the messages are not numbered."""
    names = (table.instance_column, *_INSTANCE_COLUMNS)
    column = next((name for name in names if name is not None and table.holds_numbers(name)), None)
    return None if column is None else table.column(column)


def motor_topics(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> Iterator[Topic]:
    """Motor outputs, 0 to 1 over the range of the pulse width, and measured motor speeds."""
    motors = motor_channels(tables, parameters)
    if "RCOU" in tables:
        rows = []
        for channel, motor in sorted(motors.items(), key=lambda pair: pair[1]):
            low, high = _motor_range(parameters, channel)
            pulse = _pulse(tables["RCOU"], channel)
            rows.append(Row(pulse, f"motor_{motor}", "1", 1.0 / (high - low), -low / (high - low)))
        topic = topic_of(tables["RCOU"], rows)
        if topic is not None:
            yield topic
    yield from _speed_topics(tables, motors)


def _pulse(table: Table, channel: int) -> str:
    """Column of a channel's pulse width."""
    names = [name.format(channel) for name in _PULSES]
    return next((name for name in names if name in table), names[0])


def motor_channels(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> Mapping[int, int]:
    """Output channel to motor number, from 1; empty when the log does not say how many motors there are."""
    functions = {
        int(match[1]): int(value) for name, value in parameters.items() if (match := _SERVO_FUNCTION.fullmatch(name))
    }
    if functions:
        return {
            channel: MOTOR_FUNCTIONS[function]
            for channel, function in sorted(functions.items())
            if function in MOTOR_FUNCTIONS
        }
    count = FRAME_CLASS_MOTORS.get(int(parameters.get("FRAME_CLASS", 0.0)), 0) or _announced_motors(tables)
    return {motor: motor for motor in range(1, count + 1)}


_SERVO_FUNCTION = re.compile(r"SERVO(\d{1,2})_FUNCTION")


def _announced_motors(tables: Mapping[str, Table]) -> int:
    if "MSG" not in tables or not tables["MSG"].holds_text("Message"):
        return 0
    texts = tables["MSG"].column("Message").tolist()
    frames = (re.split(r"[ /]", text.removeprefix("Frame: "))[0] for text in texts if text.startswith("Frame: "))
    return next((FRAME_NAME_MOTORS[frame] for frame in frames if frame in FRAME_NAME_MOTORS), 0)


def _motor_range(parameters: Mapping[str, float], channel: int) -> tuple[float, float]:
    """Pulse widths of no and of full output: as set for the motors, or else the throttle stick's (old firmware).

    With ``PWMRange`` each output has its own.
    """
    kind = int(parameters.get("MOT_PWM_TYPE", 0.0))
    if kind in DSHOT_TYPES:
        return 1000.0, 2000.0
    throttle = int(parameters.get("RCMAP_THROTTLE", 3.0))
    own = [(f"SERVO{channel}_MIN", f"SERVO{channel}_MAX")] if kind == _PWM_RANGE else []
    for low_name, high_name in (*own, ("MOT_PWM_MIN", "MOT_PWM_MAX"), (f"RC{throttle}_MIN", f"RC{throttle}_MAX")):
        low, high = parameters.get(low_name, 0.0), parameters.get(high_name, 0.0)
        if 0.0 < low < high:
            return low, high
    return 1000.0, 2000.0


def _speed_topics(tables: Mapping[str, Table], motors: Mapping[int, int]) -> Iterator[Topic]:
    """Speeds that the motor controllers report; each numbers itself by its output channel, from 0."""
    table = tables.get("ESC")
    numbers = None if table is None else instances(table)
    reporting = set() if numbers is None else {int(number) for number in np.unique(numbers)}
    if reporting == set(range(len(motors))) and not reporting & {channel - 1 for channel in motors}:
        # Numbered among themselves, as controllers on a bus are: in the order of the outputs.
        motors = {number + 1: motor for number, (_, motor) in enumerate(sorted(motors.items()))}
    for channel, motor in motors.items():
        row = Row("RPM", f"motor_speed_{motor}", "rpm")
        topic = None
        if table is not None and numbers is not None and bool(np.any(numbers == channel - 1)):
            topic = topic_of(table, [row], name=f"ESC[{channel - 1}]", chosen=numbers == channel - 1)
        elif f"ESC{channel}" in tables:
            topic = topic_of(tables[f"ESC{channel}"], [row])
        if topic is not None:
            yield topic


def stick_topic(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> Topic | None:
    """Sticks, −1 to 1 and 0 to 1 for the throttle, with the calibration and direction of the log's parameters."""
    if "RCIN" not in tables:
        return None
    return topic_of(tables["RCIN"], [_stick(axis, tables["RCIN"], parameters) for axis in AXES])


def _stick(axis: str, table: Table, parameters: Mapping[str, float]) -> Row:
    name, usual = STICKS[axis]
    channel = int(parameters.get(name, usual))
    column = _pulse(table, channel)
    low = parameters.get(f"RC{channel}_MIN", 1000.0)
    high = parameters.get(f"RC{channel}_MAX", 2000.0)
    span = high - low if high > low else 1000.0
    if axis == "thrust":
        return Row(column, "thrust_stick", "1", 1.0 / span, -low / span)
    center = parameters.get(f"RC{channel}_TRIM", 1500.0)
    reversed_ = parameters.get(f"RC{channel}_REVERSED", 0.0) == 1.0 or parameters.get(f"RC{channel}_REV", 1.0) == -1.0
    slope = (-2.0 if reversed_ else 2.0) / span
    return Row(column, f"{axis}_stick", "1", slope, -center * slope)


def _system_id_topics(tables: Mapping[str, Table], runs: tuple[Run, ...]) -> Iterator[Topic]:
    """One topic for each run, so that an excitation channel holds the runs of its axis alone."""
    for number, run in enumerate(runs, start=1):
        rows: tuple[Row, ...] = SYSTEM_ID
        if run.axis is not None:
            rows = (*rows, Row("Targ", f"{run.axis}_excitation", ENTRIES[run.entry][1]))
        topic = topic_of(tables["SIDD"], rows, name=f"SIDD run {number}", chosen=run.messages)
        if topic is not None:
            yield topic
