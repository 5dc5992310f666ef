"""Paparazzi logs: ``NAME.data``, one message a line, with the definitions of the messages in ``NAME.log``.

A line is ``seconds aircraft MESSAGE field field …``. Names, order and units of the fields are those of ``messages.xml``
of the flight, which the ground station copies into ``NAME.log``; without it a field is only a place. Whole numbers are
logged as sent, in binary fractions of radians, meters or their rates: ``alt_unit_coef`` of the definition is that
fraction in ``alt_unit``, rounded, and is read as the exact power of two. Axes are FRD and NED, but for the positions of
``ROTORCRAFT_FP``, which are east, north and up.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import MOTORS, STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import LogError, UsageError
from rotorid.typing import FloatArray
from rotorid.units import parse_unit

FORMAT = "Paparazzi data"

_MOST_DEFINITION_BYTES = 8 << 20
_FEW_LINES = 20

MESSAGES: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "IMU_GYRO": {"gp": "p", "gq": "q", "gr": "r"},
        "IMU_GYRO_SCALED": {"gp": "p", "gq": "q", "gr": "r"},
        "IMU_ACCEL": {"ax": "ax", "ay": "ay", "az": "az"},
        "IMU_ACCEL_SCALED": {"ax": "ax", "ay": "ay", "az": "az"},
        "ATTITUDE": {"phi": "phi", "theta": "theta", "psi": "psi"},
        "STAB_ATTITUDE": {
            "phi": "phi",
            "theta": "theta",
            "psi": "psi",
            "p": "p",
            "q": "q",
            "r": "r",
            "phi_ref": "phi_setpoint",
            "theta_ref": "theta_setpoint",
            "psi_ref": "psi_setpoint",
            "p_ref": "p_setpoint",
            "q_ref": "q_setpoint",
            "r_ref": "r_setpoint",
        },
        "STAB_ATTITUDE_INT": {
            "est_phi": "phi",
            "est_theta": "theta",
            "est_psi": "psi",
            "est_p": "p",
            "est_q": "q",
            "est_r": "r",
            "ref_phi": "phi_setpoint",
            "ref_theta": "theta_setpoint",
            "ref_psi": "psi_setpoint",
        },
        "ROTORCRAFT_FP": {
            "east": "east",
            "north": "north",
            "up": "-down",
            "phi": "phi",
            "theta": "theta",
            "psi": "psi",
            "veast": "velocity_east",
            "vnorth": "velocity_north",
            "vup": "-velocity_down",
        },
        "ROTORCRAFT_CMD": {
            "cmd_roll": "roll_command",
            "cmd_pitch": "pitch_command",
            "cmd_yaw": "yaw_command",
            "cmd_thrust": "thrust_command",
        },
        "ENERGY": {"voltage": "battery_voltage", "bat": "battery_voltage", "current": "battery_current"},
        "BAT": {"voltage": "battery_voltage"},
    }
)
"""Message to its fields and the channels that they are, best first; a minus turns the sign."""
MESSAGES_OF_MOTORS = ("ACTUATORS", "RPM")

_FULL_COMMAND = 9600.0
"""``MAX_PPRZ``: a whole command."""
_PULSES = (800.0, 2300.0)
_MOST_FRACTION_BITS = 24
_ROUNDED = 5e-3
_SI_OF_WORDS = {"decivolt": ("V", 0.1), "dV": ("V", 0.1), "pprz": ("1", 1.0 / _FULL_COMMAND)}


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a row of Paparazzi messages.

    Examples
    --------
    >>> sniff(b"0.512 42 ATTITUDE 0.01 1.57 -0.02"), sniff(b"0.512 42 12 0.01")
    (True, False)
    """
    lines = [line for line in head.decode("latin-1").splitlines()[:_FEW_LINES] if line.strip()]
    return len(lines) > 0 and all(_message(line) is not None for line in lines[: max(1, len(lines) - 1)])


def _message(line: str) -> tuple[float, str, str, list[str]] | None:
    cells = line.split()
    if len(cells) < 3 or not cells[1].isdecimal() or not cells[2][0].isupper() or "," in cells[2]:
        return None
    if not cells[2].replace("_", "").isalnum() or cells[2] != cells[2].upper():
        return None
    try:
        return float(cells[0]), cells[1], cells[2], cells[3:]
    except ValueError:
        return None


def read(path: Path, source: Source) -> FlightRecord:
    """Read a log.

    Of several aircraft the one that sent most is read.

    Parameters
    ----------
    path
        The ``.data`` file; its definitions are looked for in ``NAME.log`` and ``messages.xml`` of the same folder.
    source
        What is known of the file.

    Raises
    ------
    LogError
        The file cannot be read, the definitions are missing, or no message is one that is read.
    """
    try:
        lines = path.read_text(encoding="latin-1").splitlines()
    except OSError as error:
        raise LogError(f"{source.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    found = [message for line in lines if (message := _message(line)) is not None]
    aircraft = Counter(message[1] for message in found).most_common()
    rows: dict[str, list[tuple[float, list[str]]]] = {}
    for time_s, number, name, cells in found:
        if number == aircraft[0][0]:
            rows.setdefault(name, []).append((time_s, cells))
    definitions = _definitions(path)
    if not definitions:
        raise LogError(
            f"{source.name} is a Paparazzi log of {', '.join(list(rows)[:5])} without the definitions of its messages",
            needed=f"{Path(source.name).stem}.log, which the ground station wrote with it, in the same folder",
            remedy="copy it there, or messages.xml of the flight",
        )
    topics = tuple(topic for name in MESSAGES if name in rows for topic in _topics(name, rows[name], definitions))
    topics += tuple(topic for name in MESSAGES_OF_MOTORS if name in rows for topic in _motors(name, rows[name]))
    if not topics:
        raise LogError(
            f"{source.name} contains only {', '.join(list(rows)[:8])}",
            needed=f"messages such as {', '.join(list(MESSAGES)[:4])}",
            remedy="add IMU_GYRO_SCALED and ROTORCRAFT_CMD to the telemetry file of the aircraft",
        )
    findings = (*_others(aircraft), *_damage(lines, found), *_assumed(topics))
    return FlightRecord(source=replace(source, firmware="Paparazzi"), topics=topics, findings=findings)


def _others(aircraft: Sequence[tuple[str, int]]) -> Iterator[Finding]:
    if len(aircraft) > 1:
        others = ", ".join(number for number, _ in aircraft[1:])
        yield warn("several_vehicles", "log", f"Aircraft {aircraft[0][0]} was read; {others} are in the log too.")


def _damage(lines: Sequence[str], found: Sequence[object]) -> Iterator[Finding]:
    if lost := sum(bool(line.strip()) for line in lines) - len(found):
        yield warn("corrupt_log", "log", f"{lost} lines are no complete messages and were left out.", lines=lost)


def _assumed(topics: Sequence[Topic]) -> Iterator[Finding]:
    if any(topic.name == "ACTUATORS" for topic in topics):
        yield remark(
            "assumed_geometry",
            "ACTUATORS",
            "Pulses of 1000 to 2000 µs were read as motor outputs of 0 to 1, in their order; the log names no motors.",
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Field:
    """A field of a message: its type, and its unit and that of its fraction as the definitions name them."""

    name: str
    kind: str
    unit: str = ""
    alt_unit: str = ""
    alt_factor: float | None = None


def _definitions(path: Path) -> Mapping[str, tuple[Field, ...]]:
    """Fields of each message, of the file that the ground station wrote beside the log."""
    for place in (path.with_suffix(".log"), path.with_name("messages.xml")):
        try:
            known = place.is_file() and place.stat().st_size <= _MOST_DEFINITION_BYTES
            found = definitions_of(place.read_text(encoding="utf-8", errors="replace")) if known else {}
        except OSError:
            continue
        if found:
            return found
    return {}


def definitions_of(text: str) -> Mapping[str, tuple[Field, ...]]:
    """Fields of the telemetry messages that an XML text defines.

    The text is not parsed as XML, only its tags ``message`` and ``field``: nothing that it declares is followed.

    Examples
    --------
    >>> text = '<message name="BAT"><field name="voltage" type="float" unit="V"/></message>'
    >>> definitions_of(text)["BAT"][0].unit
    'V'
    """
    found: dict[str, list[Field]] = {}
    fields: list[Field] | None = None
    for tag in text.split("<"):
        if tag.startswith("message ") and "name=" in tag:
            name = _attribute(tag, "name")
            # Later classes may have messages of the same name, which the vehicle does not send.
            fields = found.setdefault(name, []) if name not in found else None
            # A telemetry file of the aircraft names messages with a period, without fields.
            if "period=" in tag:
                found.pop(name, None)
                fields = None
        elif tag.startswith("field ") and fields is not None:
            factor = _attribute(tag, "alt_unit_coef")
            fields.append(
                Field(
                    name=_attribute(tag, "name"),
                    kind=_attribute(tag, "type"),
                    unit=_attribute(tag, "unit"),
                    alt_unit=_attribute(tag, "alt_unit"),
                    alt_factor=_finite(factor),
                )
            )
    return MappingProxyType({name: tuple(fields) for name, fields in found.items() if fields})


def _attribute(tag: str, name: str) -> str:
    _, found, rest = tag.partition(f' {name}="')
    return rest.partition('"')[0] if found else ""


def _finite(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value != 0.0 else None


def _topics(
    name: str, rows: Sequence[tuple[float, list[str]]], definitions: Mapping[str, tuple[Field, ...]]
) -> Iterator[Topic]:
    """The channels of a message whose fields have names."""
    fields = definitions.get(name, ())
    channels: list[Channel] = []
    values: list[FloatArray] = []
    complete = [(time_s, cells) for time_s, cells in rows if len(cells) >= len(fields)]
    for place, field in enumerate(fields):
        channel = MESSAGES[name].get(field.name, "")
        factor = _factor(field, STANDARD_UNITS.get(channel.lstrip("-"), ""))
        known = channel.lstrip("-") in {item.name for item in channels}
        if not channel or known or factor is None:
            continue
        sign = -1.0 if channel.startswith("-") else 1.0
        channels.append(
            Channel(
                name=channel.lstrip("-"),
                unit=STANDARD_UNITS[channel.lstrip("-")],
                source=f"{name}.{field.name}",
            )
        )
        values.append(sign * factor * np.array([_float(cells[place]) for _, cells in complete]))
    if channels and complete:
        yield _finite_topic(name, np.array([time_s for time_s, _ in complete]), channels, np.stack(values))


def _factor(field: Field, si: str) -> float | None:
    """Factor from the number in the log to SI; ``None`` where the definition names no unit that is known."""
    if si == "1" and field.kind.startswith("int"):
        return 1.0 / _FULL_COMMAND
    if field.alt_factor is not None and "int" in field.kind and (known := _unit(field.alt_unit)) is not None:
        unit, factor = known
        return _exact(field.alt_factor * factor) if unit == si else None
    known = _unit(field.unit)
    if known is None and field.kind in ("float", "double"):
        # Floats without a unit are SI, as the firmware computes.
        return 1.0
    return known[1] if known is not None and known[0] == si else None


def _unit(text: str) -> tuple[str, float] | None:
    if text in _SI_OF_WORDS:
        return _SI_OF_WORDS[text]
    try:
        unit = parse_unit(text) if text else None
    except UsageError:
        return None
    return (unit.si, unit.factor) if unit is not None else None


def _exact(factor: float) -> float:
    """The power of two behind a fraction that was rounded to a few digits."""
    bits = round(-math.log2(abs(factor)))
    power = math.ldexp(1.0, -bits)
    return power if 0 < bits <= _MOST_FRACTION_BITS and abs(factor / power - 1.0) < _ROUNDED else factor


def _motors(name: str, rows: Sequence[tuple[float, list[str]]]) -> Iterator[Topic]:
    """Outputs or speeds of motors, which are one list in a line: ``1200,1300,…``."""
    split = [(time_s, cells[0].split(",")) for time_s, cells in rows if cells]
    count = Counter(len(cells) for _, cells in split).most_common(1)
    width = min(count[0][0], MOTORS) if count else 0
    complete = [(time_s, cells) for time_s, cells in split if width and len(cells) == count[0][0]]
    if not complete:
        return
    values = np.array([[_float(cell) for cell in cells[:width]] for _, cells in complete]).T
    if name == "ACTUATORS":
        if not np.all((values >= _PULSES[0]) & (values <= _PULSES[1])):
            return
        values, stem, unit = (values - 1000.0) / 1000.0, "motor", "1"
    else:
        values, stem, unit = values * parse_unit("rpm").factor, "motor_speed", "rad/s"
    channels = [
        Channel(name=f"{stem}_{number}", unit=unit, source=f"{name}[{number - 1}]") for number in range(1, width + 1)
    ]
    yield _finite_topic(name, np.array([time_s for time_s, _ in complete]), channels, values)


def _finite_topic(name: str, time_s: FloatArray, channels: Sequence[Channel], values: FloatArray) -> Topic:
    good = np.isfinite(values).all(axis=0) & np.isfinite(time_s)
    return Topic(name=name, time_s=time_s[good], channels=tuple(channels), values=values[:, good])


def _float(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
