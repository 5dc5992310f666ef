"""Where a model holds: what the data covered, and the constants that it was fitted with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.pipeline.score_document import RangeDocument
from rotorid.plot.quantity import quantity
from rotorid.report.numbers import significant, unit

_PERCENT = 100.0
_CONSTANTS = {
    "g": ("m/s²", 1.0),
    **dict.fromkeys(("U0", "V0", "W0"), ("m/s", 1.0)),
    **dict.fromkeys(("theta0", "phi0"), ("°", 180.0 / math.pi)),
    "z_imu": ("m", 1.0),
}
"""Unit of paper of the constants of the library, and its factor; others are shown as they stand."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RangeRow:
    """What the data covered of a quantity, in the unit of paper."""

    words: str
    lowest: str
    highest: str
    rms: str
    unit: str


def range_rows(covered: Mapping[str, RangeDocument]) -> tuple[RangeRow, ...]:
    """Angles in degrees, commands in percent, the rest in SI units."""
    rows = []
    for name, spread in covered.items():
        words, shown, factor = _paper(name, spread.unit)
        lowest, highest, rms = (
            significant(factor * value, digits=3) for value in (spread.lowest, spread.highest, spread.rms)
        )
        rows.append(RangeRow(words=words, lowest=lowest, highest=highest, rms=rms, unit=shown))
    return tuple(rows)


def constants_sentence(constants: Mapping[str, float]) -> str:
    """Constants that are not zero, in the units of paper; empty where there are none.

    Examples
    --------
    >>> constants_sentence({"g": 9.80665, "U0": 2.1, "theta0": 0.0})
    'Constants of the model: g = 9.807 m/s², U0 = 2.1 m/s.'
    """
    told = []
    for name, value in constants.items():
        if value != 0.0:
            shown, factor = _CONSTANTS.get(name, ("", 1.0))
            told.append(f"{name} = {significant(factor * value, digits=4)} {shown}".rstrip())
    return f"Constants of the model: {', '.join(told)}." if told else ""


def _paper(name: str, si: str) -> tuple[str, str, float]:
    paper = quantity(name)
    if name.endswith("_command"):
        return ("throttle (thrust command)" if name == "thrust_command" else paper.words), "%", _PERCENT
    return paper.words, paper.unit or unit(si), paper.factor
