r"""Gains and filters that Betaflight makes of its tuning sliders (``simplified_...``) when they are applied.

.. math:: P = \lfloor P_0 m p q \rfloor, \quad I = \lfloor I_0 m p i q \rfloor, \quad
    D_{base} = \lfloor D_0 m d r \rfloor, \quad F = \lfloor F_0 m q f \rfloor

with the defaults :math:`P_0 \dots F_0` of the firmware and the sliders master :math:`m`, PI :math:`p`, I :math:`i`,
D :math:`d`, feed-forward :math:`f`, and of pitch alone PI :math:`q` and D :math:`r`. The firmware computes with 32 bits
and multiplies by 0.01 instead of dividing by 100: 80 times 1.2 becomes 95.

References
----------
``src/main/config/simplified_tuning.c`` of betaflight/betaflight, 4.3 to 2025.12.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.firmware import Version
from rotorid.errors import UsageError

SINCE: Version = (4, 3)
"""First version with these sliders."""

D_IS_BASE_SINCE: Version = (2025, 12)
"""From this version on ``d_roll`` is the base of a D that moves and ``d_max_roll`` its top; before, ``d_roll`` was the
top and ``d_min_roll`` the base."""

MODES = ("OFF", "RP", "RPY")
"""Words of ``simplified_pids_mode``: which axes the sliders move."""


class _Defaults(NamedTuple):
    p: int
    i: int
    d: int
    f: int
    d_top: int


_DEFAULTS: Mapping[str, _Defaults] = MappingProxyType(
    {
        "roll": _Defaults(45, 80, 30, 120, 40),
        "pitch": _Defaults(47, 84, 34, 125, 46),
        "yaw": _Defaults(45, 80, 0, 120, 0),
    }
)
_MOST, _MOST_F, _MOST_HZ = 250, 1000, 1000
_FILTERS: Mapping[str, tuple[tuple[str, str, int], ...]] = MappingProxyType(
    {
        of: (
            (f"{of}_lpf1_dyn_min_hz", f"{of}_lpf1_dyn_min_hz", low),
            (f"{of}_lpf1_dyn_max_hz", f"{of}_lpf1_dyn_min_hz", high),
            (f"{of}_lpf1_static_hz", f"{of}_lpf1_static_hz", low),
            (f"{of}_lpf2_static_hz", f"{of}_lpf2_static_hz", second),
        )
        for of, low, high, second in (("dterm", 75, 150, 150), ("gyro", 250, 500, 500))
    }
)
"""Each cutoff with the one that must not be zero for it to move, and its default."""


def sliders_applied(sliders: Mapping[str, float], current: Mapping[str, float], version: Version) -> dict[str, float]:
    """Gains and cutoffs that the firmware makes of its sliders, by the names of its command line.

    Parameters
    ----------
    sliders
        ``simplified_...`` settings, modes as numbers.
    current
        Cutoffs by the names of the command line: one of zero is off and stays so.
    version
        Of the firmware.

    Raises
    ------
    UsageError
        A slider is missing, or the version has none.

    Examples
    --------
    >>> even = dict.fromkeys(("i_gain", "d_gain", "pi_gain", "dmax_gain", "feedforward_gain", "pitch_d_gain"), 100.0)
    >>> even |= {"pitch_pi_gain": 100.0, "master_multiplier": 120.0, "pids_mode": 1.0, "dterm_filter": 0.0}
    >>> found = sliders_applied({f"simplified_{k}": v for k, v in even.items()} | {"simplified_gyro_filter": 0.0}, {},
    ...                         (4, 5))
    >>> found["p_roll"], found["i_roll"], found["d_min_roll"], found["d_roll"], "p_yaw" in found
    (53.0, 95.0, 35.0, 47.0, False)
    """
    if version < SINCE:
        raise UsageError(
            f"Betaflight {version[0]}.{version[1]} has no sliders on board", needed="gains, or Betaflight 4.3 and later"
        )

    def slider(name: str) -> float:
        found = sliders.get(f"simplified_{name}")
        if found is None and name == "d_max_gain":
            found = sliders.get("simplified_dmax_gain")
        if found is None:
            raise UsageError(
                f"simplified_{name} is neither in the file nor in the log", needed="all sliders that are applied"
            )
        return found

    found: dict[str, float] = {}
    for axis in tuple(_DEFAULTS)[: _axes(slider("pids_mode"))]:
        found |= _gains(axis, {name: _share(slider(name)) for name in _names(axis)}, version)
    for of, cutoffs in _FILTERS.items():
        if slider(f"{of}_filter"):
            multiplier = int(slider(f"{of}_filter_multiplier"))
            found |= {
                name: float(min(default * multiplier // 100, _MOST_HZ))
                for name, switch, default in cutoffs
                if current.get(switch, 0.0) > 0.0
            }
    return found


def _axes(mode: float) -> int:
    """How many of roll, pitch and yaw a mode moves."""
    return {0: 0, 1: 2, 2: 3}[int(mode)]


def _names(axis: str) -> tuple[str, ...]:
    own = ("pitch_pi_gain", "pitch_d_gain") if axis == "pitch" else ()
    return ("master_multiplier", "pi_gain", "i_gain", "d_gain", "d_max_gain", "feedforward_gain", *own)


def _share(percent: float) -> np.float32:
    """A slider as the compiled firmware has it."""
    return np.float32(percent) * np.float32(0.01)


def _stored(value: np.float32, most: int) -> float:
    return float(min(int(value), most))


def _gains(axis: str, of: Mapping[str, np.float32], version: Version) -> dict[str, float]:
    default, one = _DEFAULTS[axis], np.float32(1.0)
    master, d_max = of["master_multiplier"], of["d_max_gain"]
    pitch_pi, pitch_d = of.get("pitch_pi_gain", one), of.get("pitch_d_gain", one)
    of_pi, of_d = master * of["pi_gain"], master * of["d_gain"] * pitch_d
    base = np.float32(default.d) * of_d
    found = {
        f"p_{axis}": _stored(np.float32(default.p) * of_pi * pitch_pi, _MOST),
        f"i_{axis}": _stored(np.float32(default.i) * of_pi * of["i_gain"] * pitch_pi, _MOST),
        f"f_{axis}": _stored(np.float32(default.f) * master * pitch_pi * of["feedforward_gain"], _MOST_F),
    }
    if version >= D_IS_BASE_SINCE:
        left = np.float32(default.d) / np.float32(default.d_top) if default.d_top else one
        rises = d_max + (one - d_max) * left if default.d_top else one
        top = np.float32(default.d_top) * of_d * rises
        return found | {f"d_{axis}": _stored(base, _MOST), f"d_max_{axis}": _stored(top, _MOST)}
    more = np.float32(default.d_top - default.d) / np.float32(default.d) if default.d else np.float32(0.0)
    top = base * (one + more * d_max)
    return found | {f"d_{axis}": _stored(top, _MOST), f"d_min_{axis}": _stored(base, _MOST)}
