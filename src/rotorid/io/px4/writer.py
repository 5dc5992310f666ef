"""A simulated flight as the ULog file that PX4 would have written of it.

What a topic holds stands in `rotorid.io.px4.log`, the table that reads it too. Here stand its fields as PX4 1.17 has
them, how often they are logged, and the container: formats, parameters and information first, then all samples in order
of time. Messages of a topic are the rows of a structured array, so that a file is put together by a few copies of whole
arrays.

Rates follow what PX4 logs with ``SDLOG_PROFILE = 57``, that is the default set, system identification, high rate and
debugging: what those sets log without an interval is logged at every turn of the control loop here too. Attitude comes
at 250 Hz, position at 25 Hz, sticks at 100 Hz and the battery at 2 Hz, as a log of PX4's own simulator with that
profile holds them.

References
----------
PX4, ``src/modules/logger/logged_topics.cpp`` and ``msg/``; PX4 developer guide, "ULog File Format".
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from pathlib import Path

import numpy as np

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.frames import quaternion_from_euler
from rotorid.io.files import write_atomically
from rotorid.io.px4.log import ALL_RULES, EXCITATION, Rule
from rotorid.io.px4.ulog import MAGIC, SYNC, TYPES, Definitions, Member
from rotorid.io.tables.mapping import nearest
from rotorid.typing import AnyArray, FloatArray, IntArray

_PROFILE = 25
_DEBUG_PROFILE = 32


@dataclass(frozen=True, kw_only=True, slots=True)
class Layout:
    """How a topic is logged.

    Parameters
    ----------
    topic
        Its name.
    fields
        Types and names in the order of PX4, which leaves the padding at the end of a message out.
    rate_hz
        Messages in a second; every turn of the control loop when omitted.
    fixed
        Values of fields that are no channels. Any other number with a decimal point is not a number, any other integer
        zero.
    flags
        Fields that say that something is known, and the channel that must be there for it.
    raw
        Whether the values are those of the sensors, before the filters of the autopilot.
    """

    topic: str
    fields: str
    rate_hz: float | None = None
    fixed: Mapping[str, float | bytes] = dataclass_field(default_factory=dict)
    flags: Mapping[str, str] = dataclass_field(default_factory=dict)
    raw: bool = False


_SAMPLED = "uint64_t timestamp;uint64_t timestamp_sample;"
_NO_THRUST = {"thrust_body[0]": 0.0, "thrust_body[1]": 0.0}

LAYOUTS: tuple[Layout, ...] = (
    Layout(
        topic="sensor_combined",
        fields="uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
        "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;"
        "uint8_t accelerometer_clipping;uint8_t gyro_clipping;uint8_t accel_calibration_count;"
        "uint8_t gyro_calibration_count",
        raw=True,
    ),
    Layout(topic="vehicle_angular_velocity", fields=_SAMPLED + "float[3] xyz;float[3] xyz_derivative"),
    Layout(topic="vehicle_acceleration", fields=_SAMPLED + "float[3] xyz"),
    Layout(
        topic="vehicle_attitude",
        fields=_SAMPLED + "float[4] q;float[4] delta_q_reset;uint8_t quat_reset_counter",
        rate_hz=250.0,
    ),
    Layout(
        topic="vehicle_local_position",
        fields=_SAMPLED + "uint64_t ref_timestamp;double ref_lat;double ref_lon;float x;float y;float z;"
        "float[2] delta_xy;float delta_z;float vx;float vy;float vz;float z_deriv;float[2] delta_vxy;float delta_vz;"
        "float ax;float ay;float az;float heading;float heading_var;float unaided_heading;float delta_heading;"
        "float tilt_var;float ref_alt;float dist_bottom;float dist_bottom_var;float delta_dist_bottom;float eph;"
        "float epv;float evh;float evv;float vxy_max;float vz_max;float hagl_min;float hagl_max_z;float hagl_max_xy;"
        "bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;uint8_t xy_reset_counter;uint8_t z_reset_counter;"
        "uint8_t vxy_reset_counter;uint8_t vz_reset_counter;uint8_t heading_reset_counter;"
        "bool heading_good_for_control;bool xy_global;bool z_global;bool dist_bottom_valid;"
        "uint8_t dist_bottom_reset_counter;uint8_t dist_bottom_sensor_bitfield;bool dead_reckoning",
        rate_hz=25.0,
        flags={
            "xy_valid": "north",
            "z_valid": "down",
            "v_xy_valid": "velocity_north",
            "v_z_valid": "velocity_down",
        },
    ),
    Layout(
        topic="manual_control_setpoint",
        fields=_SAMPLED + "float roll;float pitch;float yaw;float throttle;float flaps;float aux1;float aux2;"
        "float aux3;float aux4;float aux5;float aux6;uint16_t buttons;bool valid;uint8_t data_source;"
        "bool sticks_moving",
        rate_hz=100.0,
        fixed={"valid": 1, "data_source": 1},
    ),
    Layout(
        topic="vehicle_attitude_setpoint",
        fields="uint64_t timestamp;float yaw_sp_move_rate;float[4] q_d;float[3] thrust_body",
        rate_hz=250.0,
        fixed=_NO_THRUST,
    ),
    Layout(
        topic="vehicle_rates_setpoint",
        fields="uint64_t timestamp;float roll;float pitch;float yaw;float[3] thrust_body;bool reset_integral",
        fixed=_NO_THRUST,
    ),
    Layout(
        topic="debug_vect",
        fields="uint64_t timestamp;float x;float y;float z;char[10] name",
        fixed={"name": EXCITATION.encode()},
    ),
    Layout(
        topic="debug_key_value",
        fields="uint64_t timestamp;float value;char[10] key",
        fixed={"key": EXCITATION.encode()},
    ),
    Layout(topic="vehicle_torque_setpoint", fields=_SAMPLED + "float[3] xyz"),
    Layout(topic="vehicle_thrust_setpoint", fields=_SAMPLED + "float[3] xyz", fixed={"xyz[0]": 0.0, "xyz[1]": 0.0}),
    Layout(topic="actuator_motors", fields=_SAMPLED + "float[12] control;uint16_t reversible_flags"),
    Layout(
        topic="battery_status",
        fields="uint64_t timestamp;float voltage_v;float current_a;float current_average_a;float discharged_mah;"
        "float remaining;float scale;float time_remaining_s;float temperature;float[14] voltage_cell_v;"
        "float max_cell_voltage_delta;float full_charge_capacity_wh;float remaining_capacity_wh;float nominal_voltage;"
        "float internal_resistance_estimate;float ocv_estimate;float ocv_estimate_filtered;"
        "float volt_based_soc_estimate;float voltage_prediction;float prediction_error;"
        "float estimation_covariance_norm;uint16_t capacity;uint16_t cycle_count;uint16_t average_time_to_empty;"
        "uint16_t manufacture_date;uint16_t state_of_health;uint16_t max_error;uint16_t interface_error;"
        "uint16_t faults;uint16_t over_discharge_count;bool connected;uint8_t cell_count;uint8_t source;"
        "uint8_t priority;uint8_t id;bool is_powering_off;bool is_required;uint8_t warning",
        rate_hz=2.0,
        fixed={"current_a": -1.0, "remaining": -1.0, "connected": 1, "id": 1},
    ),
)
"""In the order in which messages of one instant are logged: what was measured, what was asked for, what was sent."""

INTEGERS = (
    r"SDLOG_\w+|SYS_(?!VEHICLE_RESP$)\w+|MAV_\w+|PWM_\w+|CA_(AIRFRAME|FAILURE_MODE|METHOD|ROTOR_COUNT|R_REV)"
    r"|IMU_(GYRO_(CAL_EN|DNF_EN|DNF_HMC|RATEMAX)|INTEG_RATE)|SENS_BOARD_ROT"
    r"|MC_(AIRMODE|AT_APPLY|AT_EN|BAT_SCALE_EN|ORBIT_YAW_MOD|SLOW_MAP_\w+)"
    r"|MPC_(ACC_DECOUPLE|ALT_MODE|LAND_RC_HELP|POS_MODE|THR_CURVE|YAW_MODE)|BAT\d_(N_CELLS|SOURCE)"
)
"""Names of PX4's parameters that are whole numbers, among those that concern control, mixing, sensing and logging."""

_INFORMATION: Mapping[str, str | int] = {
    "sys_name": "PX4",
    "ver_hw": "ROTORID_SIM",
    # Major, minor and patch, then the kind of release: zero is one under development.
    "ver_sw_release": 1 << 24 | 17 << 16,
}
_THRUST = Rule(topic="", fields=("thrust_body[2]",), channels=("thrust_command",), sign=-1.0)
_MOTORS = 12


def write_px4(
    path: Path, flight: SimulatedFlight, *, rates_hz: Mapping[str, float] | None = None, start_s: float = 30.0
) -> None:
    r"""Write a simulated flight as a ULog file, as PX4 with ``SDLOG_PROFILE = 57`` would have logged it.

    A topic is written when the flight has channels of it, one that holds an attitude when it has all three angles;
    components that the flight does not have are not numbers, as in PX4. Samples are picked, not averaged: message
    :math:`i` of a topic is the first turn of the control loop at or after :math:`i / r`, so that a rate :math:`r` that
    divides that of the loop gives even steps, and any other is kept on average. Stamps of sampling and of publication
    are the same. Test inputs, for which PX4 has no topic, are in ``debug_vect`` (roll, pitch, yaw) and
    ``debug_key_value`` (thrust) under the name `rotorid.io.px4.log.EXCITATION`.

    What the flight does not have, the log does not invent: no flight mode, no landed flags, no position on Earth. It
    calls its hardware ``ROTORID_SIM``.

    Parameters
    ----------
    path
        File to write or replace.
    flight
        A flight of PX4's controller, or of a simple one.
    rates_hz
        Topic to messages in a second, for those that are to differ from `LAYOUTS`; above the
        rate of the loop every turn is logged.
    start_s
        Time since boot at the zero of the flight's own clock.

    Raises
    ------
    UsageError
        A value is not a number in single precision, the flight is one of ArduPilot or has more than twelve motors, a
        topic or a rate is unknown, a whole-numbered parameter is none, stamps fall below zero, nothing is there to be
        logged, or the place cannot be written. Nothing is written then.

    Examples
    --------
    >>> import tempfile
    >>> from rotorid.io.registry import read
    >>> flight = SimulatedFlight(vehicle="demo", autopilot="px4", sample_rate_hz=4.0, time_s=[0.0, 0.25],
    ...                         columns={"p": [0, 0.5]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_px4(Path(folder) / "flight.ulg", flight)
    ...     record = read(Path(folder) / "flight.ulg")
    >>> record.source.firmware, record.topics[0].name, record.topics[0].time_s.tolist()
    ('PX4 1.17.0 (development)', 'vehicle_angular_velocity', [30.0, 30.25])
    """
    if flight.autopilot == "ardupilot" or f"motor_{_MOTORS + 1}" in flight.columns:
        raise UsageError(
            f"PX4 cannot have logged a flight of {flight.vehicle} with {flight.autopilot}",
            needed=f"PX4's controller or a simple one, and at most {_MOTORS} motors",
            remedy="write a DataFlash log or a CSV",
        )
    rates = _rates(rates_hz or {})
    stamps = _stamps(flight, start_s)
    topics = [topic for layout in LAYOUTS for topic in _logged(flight, layout, stamps, rates[layout.topic])]
    if not topics:
        raise UsageError(
            f"the flight of {flight.vehicle} contains no channel that PX4 logs",
            needed="commands, rates, attitude or position",
        )
    debug = any(topic.name.startswith("debug_") for topic in topics)
    parameters = {"SDLOG_PROFILE": float(_PROFILE + _DEBUG_PROFILE * debug), **flight.parameters}
    write_ulog(
        path,
        topics,
        parameters={name: _typed(name, value) for name, value in parameters.items()},
        information=_INFORMATION,
    )


def _rates(asked: Mapping[str, float]) -> dict[str, float | None]:
    rates = {layout.topic: layout.rate_hz for layout in LAYOUTS}
    for topic, rate_hz in asked.items():
        if topic not in rates:
            close = nearest(topic, rates)
            raise UsageError(
                f"unknown topic {topic}",
                needed=f"one of {', '.join(rates)}",
                remedy=f"did you mean {close}?" if close else "",
            )
        if not rate_hz > 0.0:
            raise UsageError(f"the rate of {topic} is {rate_hz:g} Hz", needed="a positive rate")
        rates[topic] = rate_hz
    return rates


def _stamps(flight: SimulatedFlight, start_s: float) -> IntArray:
    """Microseconds since boot."""
    stamps = np.rint((flight.time_s + start_s) * 1e6)
    if not (stamps.size and np.isfinite(stamps).all() and stamps[0] >= 0.0 and np.all(np.diff(stamps) > 0.0)):
        raise UsageError(
            f"the flight of {flight.vehicle} has {flight.samples} stamps that cannot be those of a log",
            needed="finite ones from zero up, at least a microsecond apart",
            remedy="" if flight.samples else "simulate at least one turn of the control loop",
        )
    return stamps.astype(np.int64)


def _logged(flight: SimulatedFlight, layout: Layout, stamps: IntArray, rate_hz: float | None) -> Iterator[LoggedTopic]:
    """The topic, when the flight has channels of it."""
    logged = flight.raw if layout.raw else flight.columns
    dtype = message_dtype(layout.fields)
    own = [rule for rule in ALL_RULES if rule.topic == layout.topic and _fits(rule, dtype)]
    rules = [rule for rule in own if _is_logged(rule, logged)]
    if not rules:
        return
    if rules[0].named:
        # A topic holds one message a turn: what is added behind the controllers goes first.
        rules = rules[:1]
    turns = _turns(flight, rate_hz)
    samples = _blank(layout, dtype, turns.size, 1e6 / flight.sample_rate_hz)
    for clock in {"timestamp", "timestamp_sample"} & set(dtype.names or ()):
        samples[clock] = stamps[turns]
    if rules[0].named:
        field, name = rules[0].named
        samples[field] = name.encode()
    for flag, channel in layout.flags.items():
        samples[flag] = channel in logged
    for rule in (*rules, *([_THRUST] if _fits(_THRUST, dtype) else [])):
        for field, values in _values(rule, _picked(rule, logged, turns, flight)):
            _column(samples, field)[:] = values
    yield LoggedTopic(name=layout.topic, layout=layout.fields, samples=samples)


def _fits(rule: Rule, dtype: np.dtype[np.void]) -> bool:
    return all(field.partition("[")[0] in (dtype.names or ()) for field in rule.fields)


def _is_logged(rule: Rule, channels: Mapping[str, FloatArray]) -> bool:
    present = [name in channels for name in rule.channels]
    return all(present) if _is_attitude(rule) else any(present)


def _is_attitude(rule: Rule) -> bool:
    return len(rule.channels) < len(rule.fields)


def _turns(flight: SimulatedFlight, rate_hz: float | None) -> IntArray:
    """Turns of the control loop that are logged."""
    every = 1.0 if rate_hz is None else max(flight.sample_rate_hz / rate_hz, 1.0)
    # A step that is whole but for rounding must not be rounded up to the next turn.
    turns: IntArray = np.ceil(np.arange(int(flight.samples / every) + 1) * every - 1e-6).astype(np.int64)
    return turns[turns < flight.samples]


def _blank(layout: Layout, dtype: np.dtype[np.void], rows: int, period_us: float) -> AnyArray:
    """Rows without channels: floating-point numbers that are none, other zeros, and what is fixed."""
    row: AnyArray = np.zeros(1, dtype=dtype)
    for name in dtype.names or ():
        if dtype[name].base.kind == "f":
            row[name] = np.nan
        elif name.endswith("_integral_dt"):
            row[name] = round(period_us)
    for field, value in layout.fixed.items():
        _column(row, field)[:] = value
    return np.repeat(row, rows)


def _column(samples: AnyArray, field: str) -> AnyArray:
    """The part of the rows that a field such as ``xyz[2]`` is."""
    name, _, place = field.rstrip("]").partition("[")
    column: AnyArray = samples[name][:, int(place)] if place else samples[name]
    return column


def _picked(
    rule: Rule, channels: Mapping[str, FloatArray], turns: IntArray, flight: SimulatedFlight
) -> dict[str, FloatArray]:
    """Channels of a rule that the flight has, at the turns that are logged; a number that is none is refused."""
    picked: dict[str, FloatArray] = {}
    for name in rule.channels:
        if name in channels:
            wrong = np.flatnonzero(~(np.abs(channels[name]) <= _LARGEST))
            if wrong.size:
                first = wrong[0]
                raise UsageError(
                    (
                        f"{name} of the flight of {flight.vehicle} is "
                        f"{channels[name][first]:g} at {flight.time_s[first]:g} s"
                    ),
                    needed="numbers in the range of single precision",
                    remedy="find out why the simulation diverged",
                )
            picked[name] = channels[name][turns]
    return picked


def _values(rule: Rule, picked: Mapping[str, FloatArray]) -> Iterator[tuple[str, FloatArray]]:
    """Fields of a rule and their values."""
    if _is_attitude(rule):
        yield from zip(
            rule.fields, quaternion_from_euler(np.stack([picked[name] for name in rule.channels])), strict=True
        )
        return
    for field, name in zip(rule.fields, rule.channels, strict=True):
        if name in picked:
            yield field, picked[name] * rule.sign


def _typed(name: str, value: float) -> float | int:
    """A parameter in the type that PX4 has it in."""
    if not re.fullmatch(INTEGERS, name):
        return float(value)
    if not float(value).is_integer():
        raise UsageError(f"the parameter {name} = {value:g} is not a whole number", needed="an integer, as in PX4")
    return int(value)


_VERSION = 1
_NO_FLAGS = bytes(40)
_SYNC_EVERY_US = 500_000
_LARGEST_PAYLOAD = 0xFFFF
_MOST_TOPICS = 1 << 16
_INT32 = 1 << 31
_LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, kw_only=True, eq=False)
class LoggedTopic:
    """All messages of one topic.

    Parameters
    ----------
    name
        As the log names it: ``vehicle_torque_setpoint``.
    layout
        Types and names of the fields as ULog spells them, ``timestamp`` first: ``uint64_t timestamp;float[3] xyz``.
    samples
        One row for each message, of the type that `message_dtype` makes of the layout; stamps in microseconds.
    instance
        Which of several topics of one name.
    """

    name: str
    layout: str
    samples: AnyArray
    instance: int = 0

    def __post_init__(self) -> None:
        if self.samples.dtype != message_dtype(self.layout):
            raise ValueError(f"the samples of {self.name} have not the type of its layout")


def write_ulog(
    path: Path,
    topics: Sequence[LoggedTopic],
    *,
    parameters: Mapping[str, float | int],
    information: Mapping[str, str | int],
) -> None:
    """Write a ULog file, whole or not at all; equal input makes equal bytes.

    Messages stand in order of their stamps, those of one instant in the order of the topics, with a synchronization
    message every half second. As in PX4, nothing pads a message at its end.

    Parameters
    ----------
    path
        File to write or replace.
    topics
        At least one, each with stamps that do not fall.
    parameters
        Name to value: ``int32_t`` for a Python integer, ``float`` for any other number.
    information
        Name to text or unsigned number, such as ``sys_name`` and ``ver_sw_release``.

    Raises
    ------
    UsageError
        There is no topic, two have the same name and instance, stamps fall, a message is longer than 64 KiB, a name is
        not plain text, a parameter cannot be held in 32 bits, or the place cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from rotorid.io.px4.ulog import extract
    >>> layout = "uint64_t timestamp;float voltage_v"
    >>> rows = np.array([(1_000_000, 16.5), (1_500_000, 16.25)], dtype=message_dtype(layout))
    >>> battery = LoggedTopic(name="battery_status", layout=layout, samples=rows)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder) / "flight.ulg"
    ...     write_ulog(log, [battery], parameters={"CA_ROTOR_COUNT": 4}, information={"sys_name": "PX4"})
    ...     found = extract(log, {"battery_status": ["voltage_v"]})
    ...     found.arrays["battery_status/voltage_v"].tolist(), dict(found.parameters)
    ([16.5, 16.25], {'CA_ROTOR_COUNT': 4.0})
    """
    _check(topics)
    first_us = min((int(topic.samples["timestamp"][0]) for topic in topics if topic.samples.size), default=0)
    head = [
        MAGIC + struct.pack("<BQ", _VERSION, first_us),
        _message("B", _NO_FLAGS),
        *(_message("I", _information(name, value)) for name, value in information.items()),
        *(_message("F", f"{name}:{layout};".encode()) for name, layout in _formats(topics).items()),
        *(_message("P", _parameter(name, value)) for name, value in parameters.items()),
        *(
            _message("A", struct.pack("<BH", topic.instance, number) + topic.name.encode())
            for number, topic in enumerate(topics)
        ),
    ]
    write_atomically(path, _merged(b"".join(head), list(_blocks(topics))))


def message_dtype(layout: str) -> np.dtype[np.void]:
    """Type of the rows of a topic, without gaps between its fields.

    Parameters
    ----------
    layout
        Fields of plain types, as in `LoggedTopic`; an array of ``char`` is one text.

    Raises
    ------
    ValueError
        A field has a type that ULog does not have, or the first one is no stamp.

    Examples
    --------
    >>> message_dtype("uint64_t timestamp;float[3] xyz;char[10] name").itemsize
    30
    """
    definitions = Definitions()
    definitions.learn(f"topic:{layout};".encode())
    members = definitions.formats.get("topic", ())
    unknown = [member.kind for member in members if member.kind not in TYPES]
    if (
        unknown
        or not members
        or (members[0].kind, members[0].count, members[0].name) != ("uint64_t", None, "timestamp")
    ):
        raise ValueError(f"unsupported layout {layout!r}: it starts with its stamp, and has plain types")
    return np.dtype([_field(member) for member in members])


def _field(member: Member) -> tuple[str, str] | tuple[str, str, tuple[int, ...]]:
    if member.kind == "char":
        return member.name, f"S{member.count or 1}"
    return member.name, TYPES[member.kind], () if member.count is None else (member.count,)


def _check(topics: Sequence[LoggedTopic]) -> None:
    names = [(topic.name, topic.instance) for topic in topics]
    if not 0 < len(topics) <= _MOST_TOPICS or len(set(names)) < len(names):
        raise UsageError(
            f"{len(topics)} topics have {len(set(names))} names", needed="topics, each of its own name and instance"
        )
    for topic in topics:
        stamps = topic.samples["timestamp"]
        if np.any(stamps[1:] < stamps[:-1]):
            raise UsageError(f"the stamps of {topic.name} fall", needed="samples in order of time")
        if topic.samples.dtype.itemsize + 2 > _LARGEST_PAYLOAD:
            raise UsageError(f"a message of {topic.name} is too long", needed=f"at most {_LARGEST_PAYLOAD} bytes")


def _formats(topics: Sequence[LoggedTopic]) -> dict[str, str]:
    formats: dict[str, str] = {}
    for topic in topics:
        if formats.setdefault(topic.name, topic.layout) != topic.layout:
            raise UsageError(f"{topic.name} has two layouts", needed="one for all instances of a topic")
    return formats


def _message(letter: str, payload: bytes) -> bytes:
    if len(payload) > _LARGEST_PAYLOAD or not payload[:1]:
        raise UsageError(f"the message has {len(payload)} bytes", needed=f"1 to {_LARGEST_PAYLOAD} bytes")
    return struct.pack("<HB", len(payload), ord(letter)) + payload


def _key(kind: str, name: str) -> bytes:
    text = f"{kind} {name}"
    if not (name.isascii() and name.isidentifier() and len(text) < 256):
        raise UsageError(f"ULog cannot store the name {name[:40]!r}", needed="letters, digits and underscores")
    return bytes([len(text)]) + text.encode()


def _information(name: str, value: str | int) -> bytes:
    if isinstance(value, str):
        text = value.encode()
        return _key(f"char[{len(text)}]", name) + text
    if not 0 <= value < 2 * _INT32:
        raise UsageError(f"{name} = {value} is out of range", needed="an unsigned number of 32 bits")
    return _key("uint32_t", name) + struct.pack("<I", value)


def _parameter(name: str, value: float | int) -> bytes:
    if isinstance(value, int) and -_INT32 <= value < _INT32:
        return _key("int32_t", name) + struct.pack("<i", value)
    if isinstance(value, int) or not abs(value) <= _LARGEST:
        raise UsageError(f"the parameter {name} = {value} is out of range", needed="a number of 32 bits")
    return _key("float", name) + struct.pack("<f", value)


def _blocks(topics: Sequence[LoggedTopic]) -> Iterator[tuple[AnyArray, AnyArray]]:
    """Stamps of each topic, and its whole messages as plain bytes; those that help a reader to find its way last."""
    for number, topic in enumerate(topics):
        fields = [("size", "<u2"), ("letter", "u1"), ("number", "<u2"), ("payload", topic.samples.dtype)]
        rows = np.empty(topic.samples.size, dtype=fields)
        rows["size"] = topic.samples.dtype.itemsize + 2
        rows["letter"] = ord("D")
        rows["number"] = number
        rows["payload"] = topic.samples
        yield topic.samples["timestamp"], rows.view(f"V{rows.dtype.itemsize}")
    ends = [topic.samples["timestamp"][[0, -1]] for topic in topics if topic.samples.size]
    if ends:
        stamps = np.arange(np.min(ends), np.max(ends), _SYNC_EVERY_US, dtype=np.uint64)
        yield stamps, np.full(stamps.size, np.void(_message("S", SYNC)))


def _merged(head: bytes, blocks: Sequence[tuple[AnyArray, AnyArray]]) -> bytes:
    """The head of a file and all messages in order of their stamps."""
    starts, total = _starts([stamps for stamps, _ in blocks], [rows.dtype.itemsize for _, rows in blocks])
    merged = np.empty(len(head) + total, dtype=np.uint8)
    merged[: len(head)] = np.frombuffer(head, dtype=np.uint8)
    for (_, rows), places in zip(blocks, starts, strict=True):
        if rows.size:
            # Every byte starts an item of this overlapping view, so that one assignment places all rows of a topic.
            overlapping: AnyArray = np.ndarray(
                shape=(total - rows.dtype.itemsize + 1,),
                dtype=rows.dtype,
                buffer=merged.data,
                offset=len(head),
                strides=(1,),
            )
            overlapping[places] = rows
    return merged.tobytes()


def _starts(stamps: Sequence[AnyArray], widths: Sequence[int]) -> tuple[list[IntArray], int]:
    """First byte of each message, block by block, and the length of all."""
    counts = [block.size for block in stamps]
    order = np.argsort(np.concatenate(stamps), kind="stable")
    sizes = np.repeat(np.asarray(widths, dtype=np.int64), counts)
    stops = np.cumsum(sizes[order])
    starts = np.empty_like(stops)
    starts[order] = stops - sizes[order]
    return np.split(starts, np.cumsum(counts)[:-1]), int(stops[-1]) if stops.size else 0
