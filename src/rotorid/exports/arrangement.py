"""A vehicle's rotors in the order in which another tool numbers them: by their bearings, and how they turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import ModelError
from rotorid.models.rotors import RotorLayout
from rotorid.typing import FloatArray

ROTORS = 4
"""Of a quadrotor, which most tools fly alone."""

_UPRIGHT = 1e-6
_TOLERANCE_DEG = 40.0
"""How far a rotor may stand from its bearing in an X."""


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


def require_four(layout: RotorLayout, target: str) -> None:
    """Refuse what has more or fewer than four rotors.

    Raises
    ------
    ModelError
        It has.
    """
    if layout.rotors != ROTORS:
        raise ModelError(f"{layout.name} has {layout.rotors} rotors", needed=f"four rotors, which {target} flies")


def require_four_upright(layout: RotorLayout, target: str) -> None:
    """Refuse what is not four upright rotors.

    Raises
    ------
    ModelError
        There are more or fewer, or they are tilted.
    """
    require_four(layout, target)
    refuse_tilted(layout, target)


def require_x(layout: RotorLayout, bearings_deg: Sequence[float], spins: Sequence[float], target: str) -> Arranged:
    """The rotors in the order of a tool that flies four in an X alone, with the arguments of :func:`arranged`.

    Raises
    ------
    ModelError
        They stand or turn otherwise.
    """
    found = arranged(layout, bearings_deg, spins, tolerance_deg=_TOLERANCE_DEG)
    if found is None:
        raise ModelError(
            f"the rotors of {layout.name} stand or turn otherwise",
            needed=f"four rotors in an X that turn against their neighbors, which {target} flies",
        )
    return found
