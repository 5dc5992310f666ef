"""The autopilot that holds a hover: a cascade of velocity, angle and rate, with constant gains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.typing import FloatArray

MEASURED = ("p", "q", "r", "phi", "theta", "psi", "u", "v", "w")
"""What the autopilot measures, in the order of its error matrix."""


@dataclass(frozen=True, kw_only=True)
class HoverController:
    r"""Gains of a cascade like PX4's: velocity to angle to rate to command, heading to yaw rate, climb to thrust.

    .. math:: \phi_{set} = -k v, \quad p_{set} = K_\phi (\phi_{set} - \phi), \quad
        \delta_{roll} = P (p_{set} - p) + I \int (p_{set} - p) \, dt

    and likewise in pitch (with the other sign of lean), in yaw from the heading, and in thrust from the velocity down.
    There is no derivative term and no limit: the loop is linear.

    Parameters
    ----------
    rate_p
        Command per rad/s of rate error: roll, pitch, yaw.
    rate_i
        Command per rad of its integral.
    angle_p
        Rate set-point per rad of angle error, 1/s: roll, pitch, heading.
    lean_rad_per_m_s
        Tilt set-point against each m/s of drift.
    climb_p, climb_i
        Thrust command per m/s of sink, and per m of its integral.
    """

    rate_p: tuple[float, float, float]
    rate_i: tuple[float, float, float]
    angle_p: tuple[float, float, float]
    lean_rad_per_m_s: float
    climb_p: float
    climb_i: float

    @property
    def proportional(self) -> FloatArray:
        """Command per unit of error, in the order of the axes."""
        return np.array([*self.rate_p, self.climb_p])

    @property
    def integral(self) -> FloatArray:
        """Command per second of unit error, in the order of the axes."""
        return np.array([*self.rate_i, self.climb_i])

    @property
    def error(self) -> FloatArray:
        """Rate errors of roll, pitch, yaw and the sink rate, shape ``(4, 9)``, from what is measured."""
        roll, pitch, heading = self.angle_p
        rows = (
            {"p": -1.0, "phi": -roll, "v": -roll * self.lean_rad_per_m_s},
            {"q": -1.0, "theta": -pitch, "u": pitch * self.lean_rad_per_m_s},
            {"r": -1.0, "psi": -heading},
            {"w": 1.0},
        )
        return np.array([[row.get(name, 0.0) for name in MEASURED] for row in rows])
