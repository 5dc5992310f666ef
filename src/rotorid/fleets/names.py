"""What the quantities of a fleet are called, and in which unit they are shown.

A table names them by model and parameter, such as ``rate.roll L_roll``, or by their place in a review, such as
``margins.roll.gain_margin_db``. Readers see words.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rotorid.data.quantities import figure, words_of_path
from rotorid.data.quantity import unit as unit_on_paper
from rotorid.fleets.table import REVIEW

_SYMBOLS = {
    "L_roll": "roll control power",
    "M_pitch": "pitch control power",
    "N_yaw": "yaw control power",
    "Z_thrust": "thrust control power",
    "L_p": "roll damping",
    "M_q": "pitch damping",
    "N_r": "yaw damping",
    "Z_w": "vertical damping",
    "T_motor": "motor lag",
    "tau_roll": "roll delay",
    "tau_pitch": "pitch delay",
    "tau_yaw": "yaw delay",
    "tau_thrust": "thrust delay",
    "I_xx": "roll inertia",
    "I_yy": "pitch inertia",
    "I_zz": "yaw inertia",
    "kappa": "rotor torque over thrust",
    "thrust_slope": "rotor thrust per output",
    "thrust_full": "rotor thrust at full output",
}
_MEAN_OUTPUT = re.compile(r"motor_(\d+)")
_PARTS = re.compile(r"(\w+)(.*)", re.DOTALL)


@dataclass(frozen=True, kw_only=True, slots=True)
class Shown:
    """How a quantity is written: its words, its symbol if it has one, its unit, and the factor to that unit."""

    words: str
    symbol: str
    unit: str
    factor: float = 1.0

    @property
    def label(self) -> str:
        """Words and symbol, as in ``roll control power L_roll``."""
        return f"{self.words} {self.symbol}".strip()


def shown(model: str, parameter: str, unit: str) -> Shown:
    """How a quantity of a table is written.

    Examples
    --------
    >>> shown("rate.roll", "L_roll (clear of zero)", "rad/s^2").label
    'roll control power L_roll (clear of zero)'
    >>> shown("review", "margins.roll.gain_margin_db", "dB").words
    'gain margin of roll'
    >>> shown("review", "loops.p.rise_time_s", "s")
    Shown(words='rise time of roll rate', symbol='', unit='ms', factor=1000.0)
    >>> shown("hover.lateral", "Y_v", "1/s").label
    'Y_v of hover.lateral'
    """
    if model != REVIEW:
        name, rest = _named(parameter)
        words = _SYMBOLS.get(name)
        symbol = f"{name}{rest}" if words else f"{name}{rest} of {model}"
        return Shown(words=words or "", symbol=symbol, unit=unit_on_paper(unit))
    path, _, rest = parameter.partition(" ")
    name = path.rpartition(".")[2]
    more = f" {rest}" if rest else ""
    if (found := _MEAN_OUTPUT.fullmatch(name)) is not None:
        return Shown(words=f"mean output of motor {found[1]}{more}", symbol="", unit="%", factor=100.0)
    row = figure(name)
    if row is None:
        return Shown(words=f"{name.replace('_', ' ')}{more}", symbol="", unit=unit_on_paper(unit))
    return Shown(words=f"{words_of_path(path)}{more}", symbol="", unit=row.unit, factor=row.factor or 1.0)


def words_of(model: str, parameter: str) -> str:
    """Words of a quantity for a sentence, without its symbol where it has words."""
    found = shown(model, parameter, "")
    return f"{found.words}{_named(parameter)[1]}" if found.words and model != REVIEW else found.label


def _named(parameter: str) -> tuple[str, str]:
    """The symbol of a parameter, and what follows it."""
    found = _PARTS.fullmatch(parameter)
    return (found[1], found[2]) if found else (parameter, "")
