r"""The physics of flight: rotors in moving air, the body that they carry, and where the accelerometer is.

Rotor i at :math:`r_i` from the center of gravity turns at :math:`\Omega_i`. The body moves through the air at
:math:`V = v - R^T W`, with its velocity v over ground and the wind W; the hub at :math:`V_i = V + \omega \times r_i`,
of which :math:`(u_i, v_i)` is edgewise and :math:`h_i` its length; :math:`w_i = -V_{i,z}` is the climb rate of the hub.
Momentum theory (Glauert) gives the induced velocity, and with it the inflow :math:`\lambda_i`:

.. math::

    v_{ind} = \frac{T_{i0}}{2 \rho A \sqrt{h_i^2 + (v_{ind} + w_i)^2}}, \qquad \lambda_i = w_i + v_{ind}

    T_i = c_2 \Omega_i^2 - c_\lambda \Omega_i \lambda_i + c_h \Omega_i h_i + c_{hw} h_i w_i + c_{ha} h_i |w_i|
        + c_{wake} (r_i \cdot h_i) w_i

    H_i = -(k_d \Omega_i + k_w w_i) (u_i, v_i)

    F = \sum (H_i, -T_i) - d_z V_z |V| \hat z, \qquad
    f = F / m + \dot\omega \times a + \omega \times (\omega \times a)

    M = \sum (r_i - c) \times (H_i, -T_i) + m_f \sum \Omega_i v_{ind} \frac{\hat z \times V_i}{|\lambda_i| + L_i}
        + m_{fx} \sum \Omega_i v_{ind} \frac{u_i \hat y}{|\lambda_i| + L_i}
        + m_s \sum s_i \Omega_i (u_i, v_i) + N \hat z

    N = \sum s_i (\kappa T_{i,static} + \kappa_\lambda \lambda_i^2 + J_r \dot\Omega_i) - k_r r \sum \Omega_i, \qquad
    I \dot\omega + \omega \times I \omega = M

with :math:`L_i = \sqrt{h_i^2 + \lambda_i^2}`. The wake of a rotor that moves edgewise is skewed by :math:`\chi`, so
that the induced velocity grows from front to rear by :math:`v_{ind} \tan(\chi / 2)`,
:math:`\tan(\chi / 2) = h_i / (|\lambda_i| + L_i)` (Coleman): the front lifts more, which tilts the vehicle back. A
body is no disc: two quadrotors tilt back 1.3 to 1.8 times as much in forward flight as sideways, by :math:`m_{fx}`.

The center of gravity is off by c from where the layout has it. Where drag acts above it (:math:`z_{cg} > 0`), drag
tilts the vehicle back too: by speed, while the gradient of a skewed wake stops growing beyond the induced velocity.
Flight at both speeds separates them.

Axes are front, right, down; thrust :math:`T_i` is upward, and :math:`s_i` is +1 where a rotor turns the nose right.
Every force is linear in its coefficient once the inflow is known, and the inflow needs only a thrust that is about
right (:math:`T_{i0}`, from the mean specific force), so that coefficients come from regressions.

Where motors are known by outputs u instead of speeds, :math:`\Omega` is the share of the full speed that the thrust
curve gives, and the thrust at full speed stands for :math:`c_2` above (:func:`speeds_of_outputs`):

.. math::

    \Omega^2 = \frac{c_0 + c_1 u + c_2 u^2}{c_0 + c_1 + c_2} \left(\frac{V}{V_0}\right)^2

``c_2`` here is thrust without inflow. What ``physical.motors`` calls by that name is thrust in hover, where the induced
velocity takes a quarter: :math:`c_2 - c_\lambda v_{ind} / \Omega` (:func:`hover_thrust`).

Sources: Glauert, momentum theory of a rotor in oblique flow; Coleman, Feingold and Stempin, "Evaluation of the
induced-velocity field of an idealized helicopter rotor", NACA ARR L5E10, 1945; Bauersfeld, Kaufmann, Foehn, Sun and
Scaramuzza, NeuroBEM, on what is left when rotors are modeled by blade elements.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import ModelError
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

AIR_DENSITY_KG_M3 = 1.225

ALONG_BODY_BIAS_M_S2 = 0.2
"""Standard deviation of an accelerometer along the body: mostly its tilt against the plane of the rotors, 1.2°."""
QUARTER_TURN_RAD = 0.5 * np.pi
"""Turn of the heading from which wind, fixed to the earth, differs from a bias, fixed to the body."""

_NEWTON_STEPS = 12
_STILL_M_S = 1e-6
_LEAST_SLOPE = 0.3
"""Least slope of the Newton steps: in the vortex ring state momentum theory has none that leads anywhere."""


class FlightParameter(NamedTuple):
    """A number of the model.

    Parameters
    ----------
    unit
        With measured speeds in rad/s; with outputs a share of the full speed stands for rad/s.
    about
        What it is, in a few words.
    scatter
        Usual share by which it differs between flights of one vehicle, or in its unit where ``absolute``; ``None``
        where experience is missing.
    """

    unit: str
    about: str
    scatter: float | None = None
    absolute: bool = False


FLIGHT_PARAMETERS: Mapping[str, FlightParameter] = {
    "m": FlightParameter("kg", "mass"),
    "c_0": FlightParameter("N", "thrust of a rotor at rest", 0.08),
    "c_1": FlightParameter("N s/rad", "thrust by speed", 0.08),
    "c_2": FlightParameter("N s^2/rad^2", "thrust by speed squared, without inflow", 0.08),
    "c_lambda": FlightParameter("N s^2/(m rad)", "thrust lost to inflow", 0.20),
    "k_d": FlightParameter("N s^2/(m rad)", "rotor drag by speed and airspeed", 0.015),
    "k_w": FlightParameter("N s^2/m^2", "rotor drag that grows with climb"),
    "x_imu": FlightParameter("m", "accelerometer ahead of the center of gravity", 0.003, absolute=True),
    "y_imu": FlightParameter("m", "accelerometer right of the center of gravity", 0.003, absolute=True),
    "z_imu": FlightParameter("m", "accelerometer below the center of gravity", 0.003, absolute=True),
    "c_h": FlightParameter("N s^2/(m rad)", "thrust gained by edgewise flow"),
    "c_hw": FlightParameter("N s^2/m^2", "thrust by edgewise flow and climb"),
    "c_ha": FlightParameter("N s^2/m^2", "thrust by edgewise flow and the size of climb"),
    "d_z": FlightParameter("N s^2/m^2", "body drag along its vertical axis"),
    "c_wake": FlightParameter("N s^2/m^3", "thrust lost in the wake of rotors ahead"),
    "T_motor": FlightParameter("s", "motor lag", 0.07),
    "I_xx": FlightParameter("kg m^2", "inertia of roll", 0.07),
    "I_yy": FlightParameter("kg m^2", "inertia of pitch", 0.07),
    "I_zz": FlightParameter("kg m^2", "inertia of yaw", 0.07),
    "kappa": FlightParameter("m", "torque by thrust", 0.12),
    "J_r": FlightParameter("kg m^2", "inertia of a rotor", 0.35),
    "m_f": FlightParameter("N s^2/rad", "hub moment of uneven inflow, tilts back", 0.06),
    "m_fx": FlightParameter("N s^2/rad", "hub moment that forward flight adds to that of any direction", 0.25),
    "m_s": FlightParameter("N s^2/rad", "flapping to the side of the rotor's turn"),
    "kappa_lambda": FlightParameter("N s^2/m", "torque by inflow squared"),
    "k_r": FlightParameter("N m s^2/rad^2", "yaw damping by the speed of the rotors"),
    "x_cg": FlightParameter("m", "center of gravity ahead of the rotors' center", 0.003, absolute=True),
    "y_cg": FlightParameter("m", "center of gravity right of the rotors' center", 0.003, absolute=True),
    "z_cg": FlightParameter(
        "m", "height of drag over the center of gravity, beyond that of the layout", 0.003, absolute=True
    ),
}
"""Names, units and usual scatter, in the order of tables.

``I_zz``, ``kappa`` and ``J_r`` are known only together: one of ``kappa`` and ``I_zz`` has to be given, as for
``physical.motors``."""

INERTIA: Mapping[str, str] = {"p": "I_xx", "q": "I_yy", "r": "I_zz"}
"""Rate to the moment of inertia about its axis."""

THRUST_TERMS = ("c_2", "c_lambda", "c_h", "c_hw", "c_ha", "c_wake")
SIDE_TERMS = ("k_d", "k_w")
FORCE_TERMS = (*THRUST_TERMS, *SIDE_TERMS, "d_z")
"""Coefficients of which forces are linear."""
HUB_TERMS = ("m_f", "m_fx", "m_s", "kappa_lambda", "k_r")
"""Coefficients of moments that no force makes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Airframe(Immutable):
    """What is known of a vehicle before a fit.

    Parameters
    ----------
    positions
        Of the rotors from the center of gravity, front, right, down, m; shape ``(rotors, 3)``.
    spins
        +1 where the torque of a rotor turns the nose right, shape ``(rotors,)``.
    mass_kg
        Of the vehicle.
    disc_m2
        Area that one rotor sweeps.
    density_kg_m3
        Of the air.
    """

    positions: FloatArray
    spins: FloatArray
    mass_kg: float
    disc_m2: float
    density_kg_m3: float = AIR_DENSITY_KG_M3

    def __post_init__(self) -> None:
        positions, spins = read_only(self.positions, np.float64, ndim=2), read_only(self.spins, np.float64, ndim=1)
        if positions.shape != (spins.size, 3):
            raise ModelError(
                f"positions of {spins.size} rotors have the shape {positions.shape}", needed="three numbers for each"
            )
        if not (self.mass_kg > 0.0 and self.disc_m2 > 0.0 and self.density_kg_m3 > 0.0):
            raise ModelError("mass, disc and density of the air have to be positive")
        self._set(positions=positions, spins=spins)

    @property
    def rotors(self) -> int:
        return int(self.spins.size)


class Air(NamedTuple):
    """What each rotor meets, shape ``(rotors, n)`` each.

    Parameters
    ----------
    forward, right
        Edgewise components of the air velocity of the hub, m/s.
    edge
        Their length.
    climb
        Of the hub through the air along the rotor's axis, upward positive, m/s.
    inflow
        Climb and induced velocity, m/s.
    """

    forward: FloatArray
    right: FloatArray
    edge: FloatArray
    climb: FloatArray
    inflow: FloatArray


def induced_velocity(
    thrust_n: FloatArray, edge: FloatArray, climb: FloatArray, *, disc_m2: float, density_kg_m3: float
) -> FloatArray:
    r"""Induced velocity of momentum theory, m/s: positive, by damped Newton steps on all samples at once.

    Beyond hover it falls with speed and with climb. In descent faster than it, theory fails (vortex ring): it is held
    below three times that of hover and one more.

    Examples
    --------
    >>> zero = np.zeros(1)
    >>> induced_velocity(np.ones(1), zero, zero, disc_m2=0.05, density_kg_m3=1.225).round(2)
    array([2.86])
    """
    strength = np.maximum(thrust_n, 0.0) / (2.0 * density_kg_m3 * disc_m2)
    hover = np.sqrt(strength)
    largest = 3.0 * hover + 1.0
    found = hover.copy()
    for _ in range(_NEWTON_STEPS):
        through = found + climb
        length = np.sqrt(edge**2 + through**2) + 1e-9
        slope = np.maximum(1.0 + strength * through / length**3, _LEAST_SLOPE)
        found = np.clip(found - (found - strength / length) / slope, 0.0, largest)
    return found


def rotor_air(airframe: Airframe, velocity: FloatArray, rates: FloatArray, thrust_n: FloatArray) -> Air:
    """What each rotor meets.

    Parameters
    ----------
    velocity
        Through the air, body axes, m/s, shape ``(3, n)``.
    rates
        rad/s, shape ``(3, n)``.
    thrust_n
        About the thrust of each rotor, for the induced velocity, shape ``(rotors, n)``.
    """
    x, y, z = (column[:, None] for column in airframe.positions.T)
    (u, v, w), (p, q, r) = velocity, rates
    forward, right = u + q * z - r * y, v + r * x - p * z
    climb = -(w + p * y - q * x)
    edge = np.hypot(forward, right)
    induced = induced_velocity(thrust_n, edge, climb, disc_m2=airframe.disc_m2, density_kg_m3=airframe.density_kg_m3)
    return Air(forward, right, edge, climb, climb + induced)


class Columns(NamedTuple):
    """Forces and moments of one coefficient at one, N and N m per unit, shape ``(3, n)`` each."""

    force: FloatArray
    moment: FloatArray


def flight_columns(
    names: tuple[str, ...],
    airframe: Airframe,
    speeds: FloatArray,
    air: Air,
    velocity: FloatArray,
    rates: FloatArray,
) -> dict[str, Columns]:
    """Force and moment that each coefficient of :data:`FORCE_TERMS` and :data:`HUB_TERMS` makes at one.

    Parameters
    ----------
    names
        Coefficients that are wanted.
    speeds
        Of the rotors, shape ``(rotors, n)``.
    air
        Of :func:`rotor_air`.
    velocity, rates
        Through the air and about the axes, shape ``(3, n)``.

    Raises
    ------
    ModelError
        A name is not one of these.
    """
    x, y, z = (column[:, None] for column in airframe.positions.T)
    spins, none = airframe.spins[:, None], np.zeros(speeds.shape[1])
    thrusts = _thrust_terms(airframe, speeds, air)
    sides: dict[str, Callable[[], FloatArray]] = {"k_d": lambda: -speeds, "k_w": lambda: -air.climb}
    found = {}
    for name in names:
        if name in thrusts:
            up = thrusts[name]()
            force = np.stack([none, none, -up.sum(axis=0)])
            moment = np.stack([(-y * up).sum(axis=0), (x * up).sum(axis=0), none])
        elif name in sides:
            against = sides[name]()
            forward, right = against * air.forward, against * air.right
            force = np.stack([forward.sum(axis=0), right.sum(axis=0), none])
            moment = np.stack(
                [(-z * right).sum(axis=0), (z * forward).sum(axis=0), (x * right - y * forward).sum(axis=0)]
            )
        elif name == "d_z":
            force = np.stack([none, none, -velocity[2] * np.sqrt((velocity**2).sum(axis=0))])
            moment = np.zeros_like(force)
        elif name in HUB_TERMS:
            turns: dict[str, Callable[[], tuple[FloatArray, ...]]] = {
                "m_f": lambda: _tilting_back(speeds, air),
                "m_fx": lambda: (0.0 * speeds, _tilting_back(speeds, air)[1], 0.0 * speeds),
                "m_s": lambda: (spins * speeds * air.forward, spins * speeds * air.right, 0.0 * speeds),
                "kappa_lambda": lambda: (0.0 * speeds, 0.0 * speeds, spins * air.inflow**2),
                "k_r": lambda: (0.0 * speeds, 0.0 * speeds, -rates[2] * speeds),
            }
            force, moment = np.zeros((3, none.size)), np.stack([row.sum(axis=0) for row in turns[name]()])
        else:
            raise ModelError(
                f"there is no coefficient {name}", needed=f"one of {', '.join((*FORCE_TERMS, *HUB_TERMS))}"
            )
        found[name] = Columns(force, moment)
    return found


def _tilting_back(speeds: FloatArray, air: Air) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speed times the gradient of induced velocity over a disc in a skewed wake, as moments about the three axes."""
    through = np.abs(air.inflow)
    gradient = speeds * (air.inflow - air.climb) / (through + np.hypot(air.edge, through) + _STILL_M_S)
    return -gradient * air.right, gradient * air.forward, 0.0 * speeds


def _thrust_terms(airframe: Airframe, speeds: FloatArray, air: Air) -> dict[str, Callable[[], FloatArray]]:
    """Thrust of each rotor that each coefficient makes at one, shape ``(rotors, n)``."""
    x, y, _ = (column[:, None] for column in airframe.positions.T)
    return {
        "c_2": lambda: speeds**2,
        "c_lambda": lambda: -speeds * air.inflow,
        "c_h": lambda: speeds * air.edge,
        "c_hw": lambda: air.edge * air.climb,
        "c_ha": lambda: air.edge * np.abs(air.climb),
        "c_wake": lambda: (x * air.forward + y * air.right) * air.climb,
    }


def rotor_thrusts(values: Mapping[str, float], airframe: Airframe, speeds: FloatArray, air: Air) -> FloatArray:
    """Thrust of each rotor in moving air, N, shape ``(rotors, n)``.

    Parameters
    ----------
    values
        Of :data:`THRUST_TERMS`, and the curve; what is absent is zero.
    speeds
        Of the rotors, shape ``(rotors, n)``.
    air
        Of :func:`rotor_air`.
    """
    values = {**values, "c_2": full_thrust(values)}
    found = np.zeros_like(speeds)
    for name, made in _thrust_terms(airframe, speeds, air).items():
        if values.get(name, 0.0) != 0.0:
            found = found + values[name] * made()
    return found


CURVE_TERMS = ("c_0", "c_1", "c_2")
"""Coefficients of the thrust curve."""


def full_thrust(values: Mapping[str, float]) -> float:
    """Thrust of a rotor without inflow at a speed of one, N: ``c_2`` of measured speeds, the sum of a curve's terms."""
    return sum(values.get(name, 0.0) for name in CURVE_TERMS)


def static_thrust(values: Mapping[str, float], speeds: FloatArray) -> FloatArray:
    """Thrust of each rotor without inflow, N."""
    return full_thrust(values) * speeds**2


def speeds_of_outputs(values: Mapping[str, float], outputs: FloatArray) -> FloatArray:
    """Shares of the full speed by outputs, as the thrust curve gives them; outputs as they are where it is a square.

    Examples
    --------
    >>> speeds_of_outputs({"c_1": 3.0, "c_2": 1.0}, np.array([0.25, 1.0])).round(3).tolist()
    [0.451, 1.0]
    """
    linear, constant = values.get("c_1", 0.0), values.get("c_0", 0.0)
    if linear == 0.0 and constant == 0.0:
        return outputs
    curve = constant + outputs * (linear + outputs * values.get("c_2", 0.0))
    return np.sqrt(np.maximum(curve / full_thrust(values), 0.0))


def flight_loads(
    values: Mapping[str, float],
    airframe: Airframe,
    *,
    speeds: FloatArray,
    velocity: FloatArray,
    rates: FloatArray,
    spin_up: FloatArray | None = None,
) -> Columns:
    """Force (N) and moment about the center of gravity (N m) of a flight, shape ``(3, n)`` each.

    Parameters
    ----------
    values
        Of :data:`FLIGHT_PARAMETERS`, what is absent being zero; curve and lags have acted on the speeds already.
    speeds
        Of the rotors, shape ``(rotors, n)``.
    velocity
        Through the air, body axes, m/s, shape ``(3, n)``.
    rates
        rad/s, shape ``(3, n)``.
    spin_up
        Change of the speeds, shape ``(rotors, n)``, for ``J_r``.

    Examples
    --------
    >>> frame = Airframe(positions=np.array([[0.1, 0.1, 0], [-0.1, -0.1, 0], [0.1, -0.1, 0], [-0.1, 0.1, 0]]),
    ...                  spins=np.array([1.0, 1, -1, -1]), mass_kg=0.8, disc_m2=0.05)
    >>> still = np.zeros((3, 1))
    >>> flight_loads({"c_2": 2e-6}, frame, speeds=np.full((4, 1), 1000.0), velocity=still, rates=still).force[2]
    array([-8.])
    """
    air = rotor_air(airframe, velocity, rates, inflow_thrust(values, airframe, speeds))
    values = {**values, "c_2": full_thrust(values)}
    names = tuple(name for name in (*FORCE_TERMS, *HUB_TERMS) if values.get(name, 0.0) != 0.0)
    force, moment = np.zeros((3, speeds.shape[1])), np.zeros((3, speeds.shape[1]))
    of_rotors = np.zeros_like(force)
    for name, column in flight_columns(names, airframe, speeds, air, velocity, rates).items():
        force += values[name] * column.force
        moment += values[name] * column.moment
        if name in THRUST_TERMS or name in SIDE_TERMS:
            of_rotors += values[name] * column.force
    spins = airframe.spins[:, None]
    moment[2] += values.get("kappa", 0.0) * (spins * values["c_2"] * speeds**2).sum(axis=0)
    if spin_up is not None:
        moment[2] += values.get("J_r", 0.0) * (spins * spin_up).sum(axis=0)
    for name, turned in center_columns(of_rotors).items():
        moment += values.get(name, 0.0) * turned
    return Columns(force, moment)


def center_columns(of_rotors: FloatArray) -> dict[str, FloatArray]:
    """Moments of forces of the rotors for each meter that the center of gravity is off, N m/m, shape ``(3, n)`` each.

    Yaw, which rotor drag makes of ``x_cg`` and ``y_cg``, is left out: drag is a few percent of thrust.

    Parameters
    ----------
    of_rotors
        Thrust and drag of all rotors, N, shape ``(3, n)``.
    """
    ahead, right, down = of_rotors
    still = np.zeros_like(down)
    return {
        "x_cg": np.stack([still, down, still]),
        "y_cg": np.stack([-down, still, still]),
        "z_cg": np.stack([right, -ahead, still]),
    }


def inflow_thrust(values: Mapping[str, float], airframe: Airframe, speeds: FloatArray) -> FloatArray:
    """About the thrust of each rotor, for its induced velocity: what it makes in hover, by the square of its speed.

    The share of thrust that inflow takes in hover follows from the values and is the same for all speeds, because the
    induced velocity of hover grows with speed.
    """
    hovering = hover_thrust(values, airframe)
    return np.asarray(hovering.coefficient * speeds**2, dtype=np.float64)


class HoverThrust(NamedTuple):
    """Thrust about hover.

    Parameters
    ----------
    coefficient
        Thrust of a rotor by the square of its speed, inflow of hover included.
    speed
        Mean speed of the rotors in hover.
    induced_m_s
        Induced velocity there.
    slope_n
        Change of thrust of a rotor with its speed, the induced velocity held.
    """

    coefficient: float
    speed: float
    induced_m_s: float
    slope_n: float


def hover_thrust(values: Mapping[str, float], airframe: Airframe) -> HoverThrust:
    """Speed, thrust coefficient and slope of hover in still air; these do not trade as ``c_2`` and ``c_lambda`` do.

    Raises
    ------
    ModelError
        The rotors cannot carry the weight.
    """
    weight = airframe.mass_kg * STANDARD_GRAVITY_M_S2 / airframe.rotors
    induced = float(np.sqrt(weight / (2.0 * airframe.density_kg_m3 * airframe.disc_m2)))
    square, lost = full_thrust(values), values.get("c_lambda", 0.0) * induced
    if not square > 0.0:
        raise ModelError("the rotors of these values cannot carry the weight")
    speed = (lost + float(np.sqrt(lost**2 + 4.0 * square * weight))) / (2.0 * square)
    return HoverThrust(weight / speed**2, speed, induced, 2.0 * square * speed - lost)


def place_columns(rates: FloatArray, acceleration: FloatArray) -> dict[str, FloatArray]:
    """Specific force, m/s² for each meter that the accelerometer is away from the center of gravity, ``(3, n)`` each.

    Parameters
    ----------
    rates, acceleration
        About the axes, rad/s and rad/s², shape ``(3, n)``.
    """
    p, q, r = rates
    p_dot, q_dot, r_dot = acceleration
    return {
        "x_imu": np.stack([-(q**2) - r**2, p * q + r_dot, p * r - q_dot]),
        "y_imu": np.stack([p * q - r_dot, -(p**2) - r**2, q * r + p_dot]),
        "z_imu": np.stack([p * r + q_dot, q * r - p_dot, -(p**2) - q**2]),
    }


def felt(
    loads: Columns, values: Mapping[str, float], mass_kg: float, rates: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Specific force at the accelerometer, m/s², shape ``(3, n)``, with the angular ``acceleration`` in rad/s²."""
    places = place_columns(rates, acceleration)
    moved = sum((values.get(name, 0.0) * column for name, column in places.items()), start=np.zeros(rates.shape))
    return np.asarray(loads.force / mass_kg + moved)
