"""What differs between the loops of a cascade where gains are searched: frequencies, shapes and the disturbance.

A rate loop with its angle loop, and a velocity loop with its position loop, have the same form and the same limits. The
outer one is ten times slower, and its gains have other ratios.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from rotorid.data.base import Immutable
from rotorid.typing import FloatArray, LoopName


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopKind(Immutable):
    """One kind of loop.

    Parameters
    ----------
    rate, angle
        What the inner and the outer of both loops control.
    outer
        Whether it controls a velocity and, around it, the position; else a rate and the angle.
    lowest_rad_s, highest_rad_s
        Frequencies on which it is looked at.
    disturbance_rad_s
        Corner of the disturbance against which the attitude, or the place, is held.
    integrals, derivatives, angles
        Ratios I/P and D/P, and angle (position) gains that are tried.
    adds_derivative
        Whether a loop without D may get one.
    angle_room
        Least crossover of the inner loop over the angle (position) gain.
    step_rate_hz, step_shown_s
        Samples of its step response, and how much of it is shown.
    """

    rate: str = "rate"
    angle: str = "angle"
    outer: bool = False
    lowest_rad_s: float = 0.5
    highest_rad_s: float = 600.0
    disturbance_rad_s: float = 1.5
    integrals: FloatArray
    derivatives: FloatArray
    angles: FloatArray
    adds_derivative: bool = False
    angle_room: float = 3.0
    step_rate_hz: float = 250.0
    step_shown_s: float = 2.0

    def worded(self, sentence: str) -> str:
        """A sentence on a rate and its angle loop, in the words of this kind.

        Examples
        --------
        >>> KINDS["velocity"].worded("M_s of the rate loop exceeds 1.7")
        'M_s of the velocity loop exceeds 1.7'
        """
        words = {"rate loop": f"{self.rate} loop", "angle loop": f"{self.angle} loop", "angle P": f"{self.angle} P"}
        for ours, own in words.items():
            sentence = sentence.replace(ours, own)
        return sentence


_DERIVATIVES = np.concatenate([[0.0], np.geomspace(0.003, 0.2, 13)])
_ANGLES = np.geomspace(0.8, 12.0, 8)

_TILT = LoopKind(integrals=np.geomspace(0.3, 12.0, 18), derivatives=_DERIVATIVES, angles=_ANGLES)
_YAW = LoopKind(integrals=np.geomspace(0.1, 5.0, 18), derivatives=np.zeros(1), angles=_ANGLES)

_VELOCITY = LoopKind(
    rate="velocity",
    angle="position",
    outer=True,
    lowest_rad_s=0.03,
    highest_rad_s=60.0,
    disturbance_rad_s=0.3,
    integrals=np.geomspace(0.05, 2.0, 18),
    derivatives=np.concatenate([[0.0], np.geomspace(0.02, 0.6, 13)]),
    angles=np.geomspace(0.3, 4.0, 8),
    # A position is held by a velocity that is hardly faster: both of PX4 cross over at .95 and 1.8 rad/s.
    angle_room=1.5,
    step_rate_hz=50.0,
    step_shown_s=8.0,
)

_CLIMB = replace(_VELOCITY, rate="climb", angle="height")

KINDS: Mapping[LoopName, LoopKind] = MappingProxyType(
    {"roll": _TILT, "pitch": _TILT, "yaw": _YAW, "velocity": _VELOCITY, "climb": _CLIMB}
)
"""The kind of every loop that is tuned."""

LOOP_WORDS: Mapping[str, str] = MappingProxyType({"rate": "rate loop", "whole": "with angle loop"})
"""What each loop of an axis is called in tables."""


def loop_words(axis: LoopName) -> Mapping[str, str]:
    """What both loops of an axis, or of an outer loop, are called in tables.

    Examples
    --------
    >>> loop_words("velocity")["whole"], loop_words("roll")["whole"]
    ('with position loop', 'with angle loop')
    """
    return {loop: KINDS[axis].worded(words) for loop, words in LOOP_WORDS.items()}
