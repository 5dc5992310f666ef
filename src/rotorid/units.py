"""Unit strings of logs and files, and the factor that brings them to SI.

The vocabulary holds what flight logs really contain. An unknown unit is an error, never a silent factor of one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.errors import UsageError, nearest_name

STANDARD_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class Unit:
    """An SI unit and the factor to it: ``value_si = factor * value``."""

    si: str
    factor: float = 1.0


_DEGREE = math.pi / 180.0
_TURN = 2.0 * math.pi

UNITS: Mapping[str, Unit] = {
    "1": Unit("1"),
    "%": Unit("1", 0.01),
    "s": Unit("s"),
    "ms": Unit("s", 1e-3),
    "us": Unit("s", 1e-6),
    "ns": Unit("s", 1e-9),
    "min": Unit("s", 60.0),
    "m": Unit("m"),
    "cm": Unit("m", 1e-2),
    "mm": Unit("m", 1e-3),
    "m/s": Unit("m/s"),
    "cm/s": Unit("m/s", 1e-2),
    "mm/s": Unit("m/s", 1e-3),
    "km/h": Unit("m/s", 1.0 / 3.6),
    "m/s^2": Unit("m/s^2"),
    "cm/s^2": Unit("m/s^2", 1e-2),
    "g": Unit("m/s^2", STANDARD_GRAVITY_M_S2),
    "mg": Unit("m/s^2", 1e-3 * STANDARD_GRAVITY_M_S2),
    "rad": Unit("rad"),
    "deg": Unit("rad", _DEGREE),
    "cdeg": Unit("rad", 0.01 * _DEGREE),
    "rad/s": Unit("rad/s"),
    "mrad/s": Unit("rad/s", 1e-3),
    "deg/s": Unit("rad/s", _DEGREE),
    "cdeg/s": Unit("rad/s", 0.01 * _DEGREE),
    "rpm": Unit("rad/s", _TURN / 60.0),
    "rad/s^2": Unit("rad/s^2"),
    "deg/s^2": Unit("rad/s^2", _DEGREE),
    "Hz": Unit("rad/s", _TURN),
    "kHz": Unit("rad/s", 1e3 * _TURN),
    "V": Unit("V"),
    "mV": Unit("V", 1e-3),
    "A": Unit("A"),
    "N": Unit("N"),
    "N m": Unit("N m"),
    "kg": Unit("kg"),
}

_ALIASES: Mapping[str, str] = {
    "": "1",
    "-": "1",
    "degrees": "deg",
    "radians": "rad",
    "seconds": "s",
    "sec": "s",
    "msec": "ms",
    "usec": "us",
    "degree": "deg",
    "deg/sec": "deg/s",
    "rad/sec": "rad/s",
    "m/sec": "m/s",
    "µs": "us",
    "hz": "Hz",
    "khz": "kHz",
    "G": "g",
    "mG": "mg",
    "m/s/s": "m/s^2",
    "m/s2": "m/s^2",
    "m/s²": "m/s^2",
    "rad/s/s": "rad/s^2",
    "rad/s2": "rad/s^2",
    "rad/s²": "rad/s^2",
    "deg/s/s": "deg/s^2",
    "deg/s2": "deg/s^2",
    "deg/s²": "deg/s^2",
    "°": "deg",
    "°/s": "deg/s",
}


UNITS_AND_ALIASES = frozenset({*UNITS, *_ALIASES} - {"", "-"})
"""All unit strings that are known."""


def parse_unit(text: str) -> Unit:
    """The SI unit behind a unit string, and the factor to it.

    Parameters
    ----------
    text
        A unit as logs write it: ``deg/s``, ``m/s^2``, ``us``, ``1``.

    Raises
    ------
    UsageError
        The unit is unknown.

    Examples
    --------
    >>> parse_unit("deg/s").si, round(parse_unit("deg/s").factor, 6)
    ('rad/s', 0.017453)
    """
    name = text.strip()
    name = _ALIASES.get(name, name)
    if name not in UNITS:
        near = nearest_name(name, UNITS)
        raise UsageError(
            f"unknown unit {text!r}",
            needed="" if near else "a unit such as rad/s, deg/s, Hz, m/s^2, s or 1",
            remedy=f"did you mean {near}?" if near else "",
        )
    return UNITS[name]


def factor_to(si: str, text: str) -> float:
    """Factor from a unit as logs write it to one of :func:`rotorid.data.record.units_of`.

    Parameters
    ----------
    si
        Unit of the answer: an SI unit, or ``us`` of pulses.
    text
        Unit of the numbers; empty for the same.

    Examples
    --------
    >>> factor_to("1", "%"), round(factor_to("us", "ms"), 6), factor_to("V", "")
    (0.01, 1000.0, 1.0)
    """
    return parse_unit(text or si).factor / parse_unit(si).factor


def writable(unit: str) -> str:
    """A unit that a person may write behind a number; ``1`` in place of one that is no word of :data:`UNITS`.

    Examples
    --------
    >>> writable("kg"), writable("kg m^2")
    ('kg', '1')
    """
    return unit if unit in UNITS else "1"


_MEASURE = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)(.*)", re.DOTALL)


class Measure(float):
    """A number in SI that was written with its unit.

    Parameters
    ----------
    value
        In SI.
    si
        Its SI unit; empty where none was written.

    Examples
    --------
    >>> Measure(0.02, "s"), Measure(0.02, "s").si
    (0.02, 's')
    """

    si: str

    def __new__(cls, value: float, si: str = "") -> Measure:
        """A float that knows its unit."""
        made = super().__new__(cls, value)
        made.si = si
        return made


def read_measure(text: str, unit: str | None = None, *, came: str = "", needed: str = "") -> float:
    """A number with or without a unit behind it.

    Parameters
    ----------
    text
        Such as ``20cm``, ``5 ms``, ``0.2``.
    unit
        What the answer is in, and a number that stands alone. Without one the answer is a :class:`Measure`, and a
        number that stands alone is in SI.
    came, needed
        For the error, in place of the text and of a number in this unit.

    Raises
    ------
    UsageError
        It is no finite number, or its unit is unknown, of another quantity or ambiguous.

    Examples
    --------
    >>> read_measure("20cm", "m"), read_measure("0.2", "m"), round(read_measure("8 Hz", "rad/s"), 3)
    (0.2, 0.2, 50.265)
    >>> read_measure("0.25kHz", "Hz"), read_measure("20 deg", "deg")
    (250.0, 20.0)
    """
    quoted = came or f"{text!r} cannot be read"
    accepted = "a number" if unit in (None, "1") else f"a number in {unit}, or with a unit"
    found = _MEASURE.fullmatch(text.strip())
    if found is None or not math.isfinite(float(found[1])):
        raise UsageError(quoted, needed=needed or accepted)
    number, written = float(found[1]), found[2].strip()
    wanted = None if unit is None else parse_unit(unit)
    if not written:
        return number if wanted is not None else Measure(number)
    subject = quoted.removesuffix(" cannot be read")
    if written == "g" and (wanted is None or wanted.si == "kg"):
        raise UsageError(f"{subject}: g may be grams or gravity", needed="kg or m/s^2")
    try:
        given = parse_unit(written)
    except UsageError as error:
        raise UsageError(f"{subject}: {error.came}", needed=error.needed, remedy=error.remedy) from None
    if wanted is not None and given.si != wanted.si:
        raise UsageError(f"{subject} is in {given.si}", needed=needed or accepted)
    # Decimal factors of ten are written as they are read: 20 cm is 0.2 m.
    value = float(f"{number * (given.factor / (wanted.factor if wanted else 1.0)):.15g}")
    return value if wanted is not None else Measure(value, given.si)


def read_measures(text: str, unit: str, between: str, *, came: str = "", needed: str = "") -> tuple[float, ...]:
    """Numbers with a sign between them; where one unit alone is written, it is that of all of them.

    Parameters
    ----------
    text
        Such as ``0.1:8Hz`` or ``10,5``.
    unit, came, needed
        As for :func:`read_measure`.

    Raises
    ------
    UsageError
        As :func:`read_measure`.

    Examples
    --------
    >>> read_measures("1:60", "rad/s", ":"), read_measures("500ms,2s", "s", ","), read_measures("500,200ms", "s", ",")
    ((1.0, 60.0), (0.5, 2.0), (0.5, 0.2))
    """
    parts = [part.strip() for part in text.split(between)]
    found = [_MEASURE.fullmatch(part) for part in parts]
    written = {match[2].strip() for match in found if match is not None} - {""}
    shared = written.pop() if len(written) == 1 else ""
    return tuple(
        read_measure(
            f"{part} {shared}" if match is not None and not match[2].strip() else part, unit, came=came, needed=needed
        )
        for part, match in zip(parts, found, strict=True)
    )


def require_units(given: Mapping[str, float], units: Mapping[str, str], *, option: str) -> None:
    """Raise for numbers in a unit of another quantity.

    Parameters
    ----------
    given
        By name; those without a unit are in SI.
    units
        SI units by name, as far as they are known.
    option
        For the error.

    Raises
    ------
    UsageError
        A unit is of another quantity, or the unit of the name is not yet known.

    Examples
    --------
    >>> require_units({"m": Measure(1.4, "kg"), "L_p": -2.0}, {"m": "kg"}, option="--fix")
    """
    for name, value in given.items():
        written = value.si if isinstance(value, Measure) else ""
        if written and written != units.get(name):
            needed = units.get(name, "SI without a unit")
            raise UsageError(f"{option} {name} is in {written}", needed=needed)
