r"""Where the rotors of a vehicle sit, which way they turn, and what a newton of thrust of each does to it.

Rotor :math:`i` at :math:`r_i` pushes along the unit vector :math:`a_i` with the thrust :math:`T_i`, and its drag turns
the vehicle the other way round than it turns itself:

.. math::

    F = \sum_i a_i T_i, \qquad M = \sum_i (r_i \times a_i - s_i \kappa a_i) \, T_i

with :math:`s = +1` for a rotor that turns counterclockwise seen from above and :math:`-1` for a clockwise one, and
:math:`\kappa` the ratio of torque to thrust in meters. Axes are forward, right, down, so that for rotors that push
straight up (:math:`a = (0, 0, -1)`)

.. math:: F_z = -\sum T_i, \quad L = -\sum y_i T_i, \quad M = \sum x_i T_i, \quad N = \kappa \sum s_i T_i

A counterclockwise rotor turns the nose to the right, which is a positive yaw moment.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import ModelError
from rotorid.typing import FloatArray

UP = (0.0, 0.0, -1.0)
"""Thrust of a rotor that is not tilted, in body axes."""

_TYPICAL_KAPPA = 0.1
"""Torque over thrust and arm, for judging rank alone: a rotor's is 0.02 to 0.2 of its arm."""

_SMALLEST = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class RotorLayout(Immutable):
    """Positions, thrust axes and directions of rotation, in the order in which the vehicle numbers its motors.

    Parameters
    ----------
    name
        What messages call it.
    positions
        Forward, right and down of the center of gravity, shape ``(rotors, 3)``; meters when ``arm_known``, else in
        units of the arm, the horizontal distance of the farthest rotor.
    spins
        +1 for a rotor that turns counterclockwise seen from above (and turns the nose right), -1 for a clockwise one,
        shape ``(rotors,)``.
    axes
        Direction of the thrust, shape ``(rotors, 3)``; straight up when none is given. They are made unit vectors.
    arm_known
        Whether the positions are in meters.
    yaw_weights
        The weights of yaw in the autopilot's mixer where they are not the spins, shape ``(rotors,)``.
    source
        What told the layout.
    findings
        What an engineer should know of it.

    Examples
    --------
    >>> layout = RotorLayout(name="quad.x", positions=[[1, 1, 0], [-1, -1, 0], [1, -1, 0], [-1, 1, 0]],
    ...                      spins=[1, 1, -1, -1])
    >>> layout.motor_names, layout.uncontrollable
    (('motor_1', 'motor_2', 'motor_3', 'motor_4'), ())
    >>> layout.scaled(0.25).moment_arms[0].round(4).tolist()
    [-0.1768, 0.1768, 0.1768, -0.1768]
    """

    name: str
    positions: FloatArray
    spins: FloatArray
    axes: FloatArray | None = None
    arm_known: bool = False
    yaw_weights: FloatArray | None = None
    source: str = ""
    findings: tuple[Finding, ...] = field(default=())

    def __post_init__(self) -> None:
        positions = read_only(self.positions, np.float64, ndim=2)
        spins = read_only(self.spins, np.float64, ndim=1)
        axes = np.tile(UP, (spins.size, 1)) if self.axes is None else np.array(self.axes, dtype=np.float64)
        weights = spins if self.yaw_weights is None else read_only(self.yaw_weights, np.float64, ndim=1)
        if not spins.size or not positions.shape == axes.shape == (spins.size, 3) or weights.size != spins.size:
            raise ModelError(
                f"the layout {self.name} has positions of shape {positions.shape}, axes of shape {axes.shape}, "
                f"{spins.size} spins and {weights.size} weights of yaw",
                needed="three coordinates, an axis, a spin and a weight for each rotor",
            )
        length = np.linalg.norm(axes, axis=1)
        if not (np.isfinite(positions).all() and np.isin(spins, (-1.0, 1.0)).all() and (length > _SMALLEST).all()):
            raise ModelError(
                f"the layout {self.name} holds a position that is no number, a spin that is not +1 or -1, or an axis "
                "without a direction",
                needed="finite positions, spins of +1 (ccw) or -1 (cw), axes that are not zero",
            )
        self._set(
            positions=positions,
            spins=spins,
            axes=read_only(axes / length[:, None], np.float64, ndim=2),
            yaw_weights=weights,
            findings=tuple(self.findings),
        )

    @property
    def rotors(self) -> int:
        return int(self.spins.size)

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Names of the channels of the motors."""
        return tuple(f"motor_{number}" for number in range(1, self.rotors + 1))

    @property
    def arm(self) -> float:
        """Horizontal distance of the farthest rotor from the center of gravity: meters, or one when it is unknown."""
        return float(np.hypot(self.positions[:, 0], self.positions[:, 1]).max())

    @property
    def thrust_axes(self) -> FloatArray:
        """Force on the vehicle per newton of thrust, shape ``(3, rotors)``."""
        assert self.axes is not None
        return self.axes.T

    @property
    def moment_arms(self) -> FloatArray:
        """Moment per newton of thrust by the positions alone, shape ``(3, rotors)``, in the unit of the positions."""
        return np.cross(self.positions, self.thrust_axes.T).T

    @property
    def torque_axes(self) -> FloatArray:
        r"""Moment per newton of thrust and per meter of :math:`\kappa` by the drag of the rotors, ``(3, rotors)``."""
        return -self.spins * self.thrust_axes

    def effectiveness(self, kappa: float) -> FloatArray:
        r"""Forces x, y, z and moments L, M, N per newton of thrust of each rotor, shape ``(6, rotors)``.

        Parameters
        ----------
        kappa
            Torque over thrust, in the unit of the positions.
        """
        return np.concatenate([self.thrust_axes, self.moment_arms + kappa * self.torque_axes])

    @property
    def uncontrollable(self) -> tuple[str, ...]:
        """Those of thrust, roll, pitch and yaw that the rotors cannot make without the others; empty for a good layout.

        An axis is controllable when it adds to the rank of the four: a plus whose rotors all turn the same way has no
        yaw, a row of rotors no moment about the row.
        """
        rows = self.effectiveness(_TYPICAL_KAPPA * self.arm)[2:]
        names = ("thrust", "roll", "pitch", "yaw")
        size = np.linalg.norm(rows, axis=1)
        scaled = rows / np.where(size > _SMALLEST * max(self.arm, _SMALLEST), size, np.inf)[:, None]
        rank = np.linalg.matrix_rank(scaled, tol=_SMALLEST)
        return tuple(
            name
            for row, name in enumerate(names)
            if np.linalg.matrix_rank(np.delete(scaled, row, axis=0), tol=_SMALLEST) == rank
        )

    def scaled(self, arm_m: float) -> RotorLayout:
        """The same layout with the farthest rotor at the horizontal distance ``arm_m``.

        Raises
        ------
        ModelError
            The length is not positive, or all rotors sit on the axis of yaw.
        """
        if not 0.0 < arm_m < np.inf or self.arm < _SMALLEST:
            raise ModelError(
                f"an arm of {arm_m:g} m came for the layout {self.name}, whose arm is {self.arm:g}",
                needed="a positive length and rotors away from the axis of yaw",
            )
        return replace(self, positions=self.positions * (arm_m / self.arm), arm_known=True)
