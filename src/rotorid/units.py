"""Unit strings of logs and files, and the factor that brings them to SI.

The vocabulary holds what flight logs really contain. An unknown unit is an error, never a silent factor of one.
"""

from __future__ import annotations

import math
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
