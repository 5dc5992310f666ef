"""What the loops of a cascade are called: inner ones control rate and angle, outer ones a velocity and its position."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.tuning.kinds import KINDS
from rotorid.typing import LoopName

_MOTIONS: Mapping[LoopName, str] = MappingProxyType({"yaw": "turns", "velocity": "moves", "climb": "lifts or drops"})


def both_loops(axis: LoopName) -> str:
    """Both loops together, as the subject of a sentence.

    Examples
    --------
    >>> both_loops("roll"), both_loops("velocity")
    ('rate and angle loop together', 'velocity and position loop together')
    """
    return f"{KINDS[axis].rate} and {KINDS[axis].angle} loop together"


def is_outer(axis: LoopName) -> bool:
    """Whether a loop controls a velocity."""
    return KINDS[axis].outer


def motion_of(axis: LoopName) -> str:
    """What a disturbance does to the vehicle: tilts, turns or moves it."""
    return _MOTIONS.get(axis, "tilts")


def answer_of(axis: LoopName, *, whole: bool) -> str:
    """What follows a set-point: the axis itself, or the position of an outer loop where that is closed."""
    return KINDS[axis].angle if whole and is_outer(axis) else axis


def amplified(axis: LoopName) -> str:
    """What a loop near its limit amplifies."""
    return "slow swings" if is_outer(axis) else "shaking"


def shaking(axis: LoopName) -> str:
    """What a loop near its limit does."""
    return f"slow swings of the {KINDS[axis].angle}" if is_outer(axis) else f"{axis} shaking"
