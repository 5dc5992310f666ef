"""Channel names in a reader's words, and the units of paper: degrees instead of radians."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rotorid.data.channel import STANDARD_UNITS

_WORDS = {
    "p": "roll rate",
    "q": "pitch rate",
    "r": "yaw rate",
    "phi": "roll angle",
    "theta": "pitch angle",
    "psi": "heading",
    "u": "forward speed",
    "v": "sideward speed",
    "w": "downward speed",
    "ax": "forward specific force",
    "ay": "sideward specific force",
    "az": "downward specific force",
}

_WHOLE = {"p_dot": "roll acceleration", "q_dot": "pitch acceleration", "r_dot": "yaw acceleration"}

_SUFFIXES = {"_setpoint": "setpoint", "_dot": "derivative"}

_DEGREES = 180.0 / math.pi

_PAPER = {
    "rad": ("°", _DEGREES),
    "rad/s": ("°/s", _DEGREES),
    "rad/s^2": ("°/s²", _DEGREES),
    "m/s^2": ("m/s²", 1.0),
    "1": ("", 1.0),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Quantity:
    """How a channel is written on paper.

    Parameters
    ----------
    words
        ``roll rate p``.
    unit
        Unit of paper, empty for a plain number.
    factor
        ``value_on_paper = factor * value_si``.
    """

    words: str
    unit: str
    factor: float

    @property
    def label(self) -> str:
        return f"{self.words} [{self.unit}]" if self.unit else self.words


def quantity(name: str) -> Quantity:
    """Words, unit and factor of a channel; a name outside the vocabulary is shown as it stands, without a unit.

    Examples
    --------
    >>> quantity("p").label, quantity("pitch_command").label
    ('roll rate p [°/s]', 'pitch command')
    """
    unit = STANDARD_UNITS.get(name)
    if unit is None:
        return Quantity(words=name, unit="", factor=1.0)
    paper, factor = _PAPER.get(unit, (unit, 1.0))
    return Quantity(words=_words(name), unit=paper, factor=factor)


def magnitude_label(output: str, input: str, *, in_db: bool) -> str:
    """What the magnitude axis of a response ``output/input`` shows, in decibels or in SI units.

    Examples
    --------
    >>> magnitude_label("p", "roll_command", in_db=True)
    'Magnitude of roll rate p over roll command [dB]'
    >>> magnitude_label("u", "theta", in_db=False)
    'Magnitude of forward speed u over pitch angle theta [(m/s)/rad]'
    """
    above, below = STANDARD_UNITS.get(output, ""), STANDARD_UNITS.get(input, "")
    # A factor between equal or unknown units carries none.
    plain = "" if not above or not below or above == below else above if below == "1" else f"({above})/{below}"
    unit = "dB" if in_db else plain
    words = f"Magnitude of {quantity(output).words} over {quantity(input).words}"
    return f"{words} [{unit}]" if unit else words


def _words(name: str) -> str:
    if name in _WHOLE:
        return _WHOLE[name]
    for suffix, word in _SUFFIXES.items():
        symbol = name.removesuffix(suffix)
        if symbol != name and symbol in _WORDS:
            return f"{_WORDS[symbol]} {word}"
    return f"{_WORDS[name]} {name}" if name in _WORDS else name.replace("_", " ")
