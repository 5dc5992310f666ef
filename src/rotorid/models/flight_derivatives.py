r"""Stability derivatives that the physics of flight implies, in hover and in level flight at any speed.

Around the trim of level flight at the speed V, where :math:`F / m + R^T g = 0` and :math:`M = 0`,

.. math::

    X_u = \frac{1}{m} \frac{\partial F_x}{\partial u}, \quad Z_w = \frac{1}{m} \frac{\partial F_z}{\partial w}, \quad
    M_u = \frac{1}{I_{yy}} \frac{\partial M_y}{\partial u}, \quad \dots

with the rotor speeds held: forces and moments of :func:`rotorid.models.flight.flight_loads` by u, v, w, p, q, r. Terms
of :math:`\omega \times V` are none of them, as in the models of hover, which hold them by constants.

Uncertainty of the numbers goes over by the slopes, trim included, so that derivatives of several speeds know how they
err together. In hover in still air a term by the edgewise speed alone (``c_h``) has a kink, and its slope is the mean
of both sides, zero. Assumed: no wind, and rotor speeds that give thrust at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import ModelError
from rotorid.models.flight import Airframe, flight_loads, hover_thrust
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

FORCES = ("X", "Y", "Z")
MOMENTS: Mapping[str, str] = {"L": "I_xx", "M": "I_yy", "N": "I_zz"}
"""Moment to the inertia that it is divided by."""
MOTIONS = ("u", "v", "w", "p", "q", "r")

_TURNS = 40
_BALANCE = 1e-9
"""Largest acceleration that is left in a trim, m/s²."""
_STEEPEST_RAD = 1.2
_STEP = 1e-4
"""Of velocities (m/s) and rates (rad/s), of angles (rad), and of rotor speeds and numbers as a share of them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightTrim(Immutable):
    """Steady level flight to the north in still air.

    Parameters
    ----------
    speed_m_s
        Along the horizon.
    velocity_m_s
        u, v, w, shape ``(3,)``.
    phi_rad, theta_rad
        Attitude.
    rotors
        Their speeds, in the unit of the numbers, shape ``(rotors,)``.
    """

    speed_m_s: float
    velocity_m_s: FloatArray
    phi_rad: float
    theta_rad: float
    rotors: FloatArray

    def __post_init__(self) -> None:
        for name in ("velocity_m_s", "rotors"):
            self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1)})


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightDerivatives(Immutable):
    """Stability derivatives at some speeds.

    Parameters
    ----------
    names
        Of the derivatives: ``X_u`` and so on; those of moments where the inertia is known.
    trims
        One for each speed.
    values
        1/s and their like, SI and radians, shape ``(speeds, names)``.
    covariance
        Of all of them, speed by speed, shape ``(speeds * names, speeds * names)``.
    """

    names: tuple[str, ...]
    trims: tuple[FlightTrim, ...]
    values: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        for name in ("values", "covariance"):
            self._set(**{name: read_only(getattr(self, name), np.float64, ndim=2)})

    @property
    def std(self) -> FloatArray:
        """One standard deviation, shape ``(speeds, names)``."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0)).reshape(self.values.shape)

    def at(self, place: int, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Values and covariance of some derivatives at one of the speeds, shapes ``(k,)`` and ``(k, k)``."""
        rows = [self.names.index(name) for name in names]
        among = place * len(self.names) + np.array(rows, dtype=np.int64)
        return self.values[place, rows], self.covariance[np.ix_(among, among)]


def flight_trim(values: Mapping[str, float], airframe: Airframe, speed_m_s: float) -> FlightTrim:
    """Attitude and rotor speeds of level flight, by Newton steps from hover.

    Parameters
    ----------
    values
        Of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`; what is absent is zero.
    airframe
        The vehicle.
    speed_m_s
        Forward, or backward if negative.

    Raises
    ------
    ModelError
        The rotors cannot carry the vehicle at this speed.

    Examples
    --------
    Rotor drag of 0.3 1/s at 5 m/s needs a tilt of 8.7 degrees:

    >>> frame = Airframe(positions=np.array([[0.1, 0.1, 0], [-0.1, -0.1, 0], [0.1, -0.1, 0], [-0.1, 0.1, 0]]),
    ...                  spins=np.array([1.0, 1, -1, -1]), mass_kg=0.8, disc_m2=0.05)
    >>> found = flight_trim({"c_2": 2e-6, "k_d": 6e-5, "kappa": 0.02}, frame, 5.0)
    >>> round(float(np.degrees(found.theta_rad)), 1)
    -8.6
    """
    hover = hover_thrust(values, airframe).speed
    arm_2 = float(np.mean((airframe.positions[:, :2] ** 2).sum(axis=1)))
    unknown = np.concatenate([np.zeros(2), np.ones(airframe.rotors)])
    steps = _STEP * np.eye(unknown.size)

    def left(at: FloatArray) -> FloatArray:
        angles, speeds = at[:2], hover * at[2:]
        loads = flight_loads(
            values, airframe, speeds=speeds, velocity=_level(angles, speed_m_s), rates=np.zeros((3, at.shape[1]))
        )
        acceleration = loads.force / airframe.mass_kg + STANDARD_GRAVITY_M_S2 * _down(angles)
        return np.vstack([acceleration, loads.moment / (airframe.mass_kg * arm_2)])

    for _ in range(_TURNS):
        points = np.concatenate([unknown[:, None], unknown[:, None] + steps, unknown[:, None] - steps], axis=1)
        found = left(points)
        if float(np.abs(found[:, 0]).max()) < _BALANCE:
            break
        slopes = (found[:, 1 : 1 + unknown.size] - found[:, 1 + unknown.size :]) / (2.0 * _STEP)
        # A number that is zero, such as the torque of the rotors, leaves what it would move where it is.
        unknown = unknown - np.linalg.lstsq(slopes, found[:, 0], rcond=1e-12)[0]
        if not (np.abs(unknown[:2]).max() < _STEEPEST_RAD and unknown[2:].min() > 0.0):
            raise _no_trim(speed_m_s)
    else:
        raise _no_trim(speed_m_s)
    angles = unknown[:2, None]
    return FlightTrim(
        speed_m_s=float(speed_m_s),
        velocity_m_s=_level(angles, speed_m_s)[:, 0],
        phi_rad=float(unknown[0]),
        theta_rad=float(unknown[1]),
        rotors=hover * unknown[2:],
    )


def flight_derivatives(
    values: Mapping[str, float],
    airframe: Airframe,
    speeds_m_s: Sequence[float],
    *,
    free: Sequence[str] = (),
    covariance: FloatArray | None = None,
) -> FlightDerivatives:
    """Stability derivatives at some speeds, with what the errors of the numbers make of them.

    Parameters
    ----------
    values
        Of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`; what is absent is zero. Without an inertia its moment has no
        derivatives.
    airframe
        The vehicle.
    speeds_m_s
        Of level flight in still air.
    free, covariance
        Numbers that were estimated, and their covariance, shape ``(p, p)``; by default all are exact.

    Raises
    ------
    ModelError
        The rotors cannot carry the vehicle at one of the speeds.

    Examples
    --------
    Drag of the rotors is 0.3 1/s in hover, four times the coefficient and the speed over the mass:

    >>> frame = Airframe(positions=np.array([[0.1, 0.1, 0], [-0.1, -0.1, 0], [0.1, -0.1, 0], [-0.1, 0.1, 0]]),
    ...                  spins=np.array([1.0, 1, -1, -1]), mass_kg=0.8, disc_m2=0.05)
    >>> numbers = {"c_2": 2e-6, "k_d": 6e-5}
    >>> found = flight_derivatives(numbers, frame, [0.0], free=["k_d"], covariance=np.array([[9e-12]]))
    >>> place = found.names.index("X_u")
    >>> round(float(found.values[0, place]), 3), round(float(found.std[0, place]), 3)
    (-0.297, 0.015)
    """
    moments = [name for name, inertia in MOMENTS.items() if values.get(inertia, 0.0) > 0.0]
    names = tuple(f"{row}_{motion}" for row in (*FORCES, *moments) for motion in MOTIONS)

    def table(numbers: Mapping[str, float]) -> tuple[list[FlightTrim], FloatArray]:
        trims = [flight_trim(numbers, airframe, speed) for speed in speeds_m_s]
        rows = [_slopes(numbers, airframe, trim, moments).ravel() for trim in trims]
        return trims, np.array(rows).reshape(len(trims), len(names))

    trims, found = table(values)
    moved = np.zeros((found.size, len(free)))
    for place, name in enumerate(free):
        spread = 0.0 if covariance is None else float(np.sqrt(max(covariance[place, place], 0.0)))
        step = max(_STEP * abs(values.get(name, 0.0)), 0.01 * spread)
        if step > 0.0:
            up, down = (table({**values, name: values.get(name, 0.0) + sign * step})[1] for sign in (1.0, -1.0))
            moved[:, place] = (up - down).ravel() / (2.0 * step)
    spread_of = np.zeros((found.size, found.size)) if covariance is None else moved @ covariance @ moved.T
    return FlightDerivatives(names=names, trims=tuple(trims), values=found, covariance=spread_of)


def _slopes(values: Mapping[str, float], airframe: Airframe, trim: FlightTrim, moments: Sequence[str]) -> FloatArray:
    """Accelerations by the motions, shape ``(3 + moments, 6)``."""
    steps = np.hstack([_STEP * np.eye(6), -_STEP * np.eye(6)])
    motion = np.concatenate([trim.velocity_m_s, np.zeros(3)])[:, None] + steps
    speeds = np.repeat(trim.rotors[:, None], motion.shape[1], axis=1)
    loads = flight_loads(values, airframe, speeds=speeds, velocity=motion[:3], rates=motion[3:])
    turning = [loads.moment[tuple(MOMENTS).index(name)] / values[MOMENTS[name]] for name in moments]
    rows = np.vstack([loads.force / airframe.mass_kg, *turning])
    return np.asarray((rows[:, :6] - rows[:, 6:]) / (2.0 * _STEP))


def _level(angles: FloatArray, speed_m_s: float) -> FloatArray:
    """Velocity in body axes of level flight to the north with a heading of zero, shape ``(3, n)``."""
    phi, theta = angles
    across = speed_m_s * np.sin(theta)
    return np.stack([speed_m_s * np.cos(theta), across * np.sin(phi), across * np.cos(phi)])


def _down(angles: FloatArray) -> FloatArray:
    """The direction of gravity in body axes, shape ``(3, n)``."""
    phi, theta = angles
    return np.stack([-np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])


def _no_trim(speed_m_s: float) -> ModelError:
    return ModelError(
        f"the rotors of these numbers do not carry the vehicle level at {speed_m_s:g} m/s", needed="a lower speed"
    )
