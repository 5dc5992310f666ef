"""A vehicle's rotors in the order in which another tool numbers them: by their bearings, and how they turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import ModelError
from rotorid.models.rotors import RotorLayout
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True)
class Arranged(Immutable):
    """A layout in the order of another tool.

    Parameters
    ----------
    order
        Index of the vehicle's rotor for each rotor of the tool.
    mirrored
        Whether every rotor turns the other way than the tool has it. Yaw by output then changes its sign, and the
        mixer of the tool knows: motion is the same.
    """

    order: tuple[int, ...]
    mirrored: bool

    def positions(self, layout: RotorLayout) -> FloatArray:
        """Rotors of the layout in the tool's order, shape ``(rotors, 3)``."""
        return np.asarray(layout.positions[list(self.order)])

    def restored(self, by_output: FloatArray) -> FloatArray:
        """Accelerations per output of the tool's rotors, shape ``(6, rotors)``, for those of the vehicle."""
        back = np.empty_like(by_output)
        back[:, list(self.order)] = by_output
        if self.mirrored:
            back[5] *= -1.0
        return back


def arranged(
    layout: RotorLayout, bearings_deg: Sequence[float], spins: Sequence[float], *, tolerance_deg: float
) -> Arranged | None:
    """The rotors of a layout in the order of another tool; ``None`` where they stand or turn otherwise.

    Parameters
    ----------
    layout
        The vehicle's rotors.
    bearings_deg
        Where the tool's rotors stand, clockwise from the nose.
    spins
        How they turn: +1 counterclockwise, seen from above.
    tolerance_deg
        How far a rotor may be from its bearing.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> arranged(library_layout("quad.x.betaflight"), [45, -135, -45, 135], [1, 1, -1, -1], tolerance_deg=30).order
    (1, 2, 3, 0)
    """
    if layout.rotors != len(bearings_deg):
        return None
    own = np.arctan2(layout.positions[:, 1], layout.positions[:, 0])
    off = np.abs(np.angle(np.exp(1j * (own[None, :] - np.radians(bearings_deg)[:, None]))))
    near = off <= np.radians(tolerance_deg)
    for sign in (1.0, -1.0):
        same = near & np.equal.outer(sign * np.asarray(spins, dtype=np.float64), layout.spins)
        # Rotors above each other turn against each other, so that bearing and spin name one rotor.
        if np.all(same.sum(axis=0) == 1) and np.all(same.sum(axis=1) == 1):
            return Arranged(order=tuple(int(row.argmax()) for row in same), mirrored=sign < 0.0)
    return None


def refuse_tilted(layout: RotorLayout, target: str) -> None:
    """Refuse rotors that do not push straight up.

    Raises
    ------
    ModelError
        One is tilted.
    """
    if np.abs(layout.thrust_axes - np.array([[0.0], [0.0], [-1.0]])).max() > _UPRIGHT:
        raise ModelError(f"the rotors of {layout.name} are tilted", needed=f"upright ones, which {target} flies")


_UPRIGHT = 1e-6
