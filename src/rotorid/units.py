"""Unit strings of logs and files, and the factor that brings them to SI.

The vocabulary holds what flight logs really contain. An unknown unit is an error, never a silent factor of one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.errors import UsageError

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
    "µs": "us",
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


def parse_unit(text: str) -> Unit:
    """The SI unit behind a unit string, and the factor to it.

    Parameters
    ----------
    text
        A unit as logs write it: ``deg/s``, ``m/s^2``, ``us``, ``1``.

    Raises
    ------
    UsageError
        The unit is not known.

    Examples
    --------
    >>> parse_unit("deg/s").si, round(parse_unit("deg/s").factor, 6)
    ('rad/s', 0.017453)
    """
    name = text.strip()
    name = _ALIASES.get(name, name)
    if name not in UNITS:
        raise UsageError(
            f"the unit {text!r} is not known", needed=f"one of {', '.join(UNITS)}", remedy="correct the unit"
        )
    return UNITS[name]


_MEASURE = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)(.*)", re.DOTALL)


def read_measure(text: str, si: str | None = None, *, name: str = "") -> float:
    """A number as a person writes it, in SI: with a unit behind it, or in SI already.

    Parameters
    ----------
    text
        Such as ``20cm``, ``5 ms``, ``0.2``.
    si
        The SI unit that is wanted; any where none is named.
    name
        Of the option, for the error.

    Raises
    ------
    UsageError
        It is no finite number, its unit is not known, of something else, or may mean two things.

    Examples
    --------
    >>> read_measure("20cm", "m"), read_measure("0.2", "m"), round(read_measure("8 Hz", "rad/s"), 3)
    (0.2, 0.2, 50.265)
    """
    wanted = "a number" if si is None else f"a number in {si}, or with its unit behind it"
    found = _MEASURE.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"{name} {text!r}".strip() + " came", needed=wanted)
    number, written = float(found[1]), found[2].strip()
    if not math.isfinite(number):
        raise UsageError(f"{name} {text!r}".strip() + " came", needed=wanted)
    if not written:
        return number
    if si is None and written == "g":
        raise UsageError(f"{name} {text!r}".strip() + " came, grams or gravity", needed="kg, or m/s^2")
    unit = parse_unit(written)
    if si is not None and unit.si != si:
        raise UsageError(f"{name} {text!r}".strip() + f" came, which is in {unit.si}", needed=wanted)
    # Decimal factors of ten are written as they are read: 20 cm is 0.2 m.
    return float(f"{number * unit.factor:.15g}")
