r"""The linear model of a nonlinear multirotor at hover or in level flight, and that of the autopilot around it.

The slopes of the vehicle are exact, each by a complex step and none by finite differences. Around level hover in calm
air, at the rated voltage, with everything as a difference from it,

.. math::

    M \dot x = F x + G u(t - \tau), \qquad x = (u, v, w, p, q, r, \phi, \theta, \psi, x_1 \dots x_n)

where :math:`u` are the commands of roll, pitch, yaw and thrust, brought to the rotors by the slope of the mixer and of
the linearization of thrust, and :math:`x_i` the speeds of the rotors as shares of the largest. A slope is the imaginary
part of the equations at a point displaced by :math:`j \epsilon`, which loses no digit to a difference.

What is no slope at hover, and what is taken in its place:

- An inclined side force (:attr:`rotorid.simulation.multirotor.Rotors.inclined`) is positively homogeneous: it has a
  slope along each single motion and none for several at once. The step is taken next to hover along that motion.
- A rotor that speeds up with one lag and slows down with another has no linear model. The mean of the two is taken:
  what a slow sine sees on average, rising late by the one and falling by the other. A fast one sees a lag that is
  shorter, by the share :math:`(1 - 8/\pi^2) e^2` with the half difference over the mean :math:`e`.
- Quadratic drag has the slope zero.

In steady level flight the same slopes are taken around the trim of :func:`trimmed`, where side forces are smooth along
the flight and quadratic drag has a slope.

Left out: the sag of the battery under load, limits of commands and motors.

The autopilot is the cascade of :mod:`rotorid.simulation.autopilot` without its limits, in continuous time: what its
commands make of what is measured, and of test inputs. Each part that it computes once a turn :math:`T` is replaced by
the continuous one with the same gain and the same delay at low frequencies:

.. math::

    \frac{1 - a}{1 - a z^{-1}} \to \frac{1}{1 + s\,T a/(1 - a)}, \qquad
    \frac{1 - z^{-1}}{T} \to \frac{s}{1 + s T/2}, \qquad
    \frac{T z^{-1}}{1 - z^{-1}} \to \frac{1}{s} - \frac{T}{2}

and the Butterworth filter by that of the cutoff :math:`2 \tan(\omega_c T/2)/T`. What is left is of second order in
:math:`\omega T`: it holds up to about a tenth of the rate of the loop. That commands are late and held for a turn
belongs to the vehicle (:func:`linearize`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias, cast

import numpy as np

from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.base import Immutable, read_only
from rotorid.data.flight_plan import Entry
from rotorid.data.record import AXES
from rotorid.errors import ModelError
from rotorid.frames import quaternion_from_euler
from rotorid.models.state_space import StateSpace
from rotorid.models.thrust_curve import ExpoCurve
from rotorid.simulation.autopilot import Autopilot
from rotorid.simulation.hover_flight import ACCELERATIONS, OUTPUTS
from rotorid.simulation.multirotor import STATES, Body, Multirotor
from rotorid.typing import AnyArray, ComplexArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

Place: TypeAlias = tuple[float, float, float]

MOTION = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")
"""The states that every hover model has; the speeds of the rotors come after them."""

FORCES_AND_MOMENTS = ("X", "Y", "Z", "L", "M", "N")
"""First letters of the derivatives: of u, v, w, p, q, r in this order."""

_ASIDE = 1e-30
"""How far next to hover a slope is taken: a share of nothing but of motions, which are zero there."""
_STEP = 1e-60
_MOST_TURNS = 30
_BALANCE = 1e-11
"""Largest acceleration left in a trim, m/s² and rad/s²."""
_MOST_TILT_RAD = math.radians(60.0)


def hover_states(vehicle: Multirotor) -> tuple[str, ...]:
    """Names of the states of a vehicle's hover model: those of :data:`MOTION`, then the speed of each rotor."""
    return MOTION + tuple(f"motor_speed_{number + 1}" for number in range(vehicle.rotors.layout.rotors))


@dataclass(frozen=True)
class Trim(Immutable):
    """Steady level flight to the north in calm air, with a heading of zero.

    Parameters
    ----------
    airspeed_m_s
        Along the horizon; the same as from the north in a head wind at standstill.
    velocity_m_s
        u, v, w in body axes.
    angles_rad
        phi, theta, psi.
    shares
        Speeds of the rotors, of the largest.
    """

    airspeed_m_s: float
    velocity_m_s: FloatArray
    angles_rad: FloatArray
    shares: FloatArray

    def __post_init__(self) -> None:
        for name in ("velocity_m_s", "angles_rad", "shares"):
            self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1)})

    @property
    def quaternion(self) -> FloatArray:
        """From body to earth: w, x, y, z."""
        return np.asarray(quaternion_from_euler(self.angles_rad))


def trimmed(vehicle: Multirotor, airspeed_m_s: float, aside_m_s: float = 0.0) -> Trim:
    r"""Attitude and rotor speeds of steady level flight at an airspeed.

    Solves :math:`\dot u = \dot v = \dot w = \dot p = \dot q = \dot r = 0` at zero rates for roll, pitch and the speeds
    of the rotors, by Newton's method with exact slopes. With more than four rotors the solution next to the speeds of
    hover is taken, which need not be the one that an autopilot's mixer makes.

    Parameters
    ----------
    vehicle
        What flies.
    airspeed_m_s
        Forward, or backward if negative; zero gives hover.
    aside_m_s
        To the right: with ``airspeed_m_s`` minus a steady wind, in which the vehicle hovers.

    Raises
    ------
    ModelError
        No such flight within the speeds of the rotors and 60 degrees of tilt.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> from rotorid.simulation.multirotor import Rotors
    >>> layout = library_layout("quad.x").scaled(0.25)
    >>> rotors = Rotors(layout=layout, thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> drag = np.diag([-0.3, -0.3, 0.0, 0.0, 0.0, 0.0])
    >>> vehicle = Multirotor(
    ...     name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors, aerodynamics=drag
    ... )
    >>> [round(float(angle), 4) + 0.0 for angle in trimmed(vehicle, 4.0).angles_rad]
    [0.0, -0.1016, 0.0]
    """
    shares = vehicle.hover_shares
    still = Trim(float(airspeed_m_s), np.zeros(3), np.zeros(3), shares)
    if airspeed_m_s == 0.0 and aside_m_s == 0.0:
        return still
    body = vehicle.body()
    unknown = np.concatenate([np.zeros(2), shares])
    along = np.array([float(airspeed_m_s), float(aside_m_s), 0.0])

    def point_at(values: AnyArray) -> ComplexArray:
        angles = np.array([values[0], values[1], 0.0], dtype=np.complex128)
        speeds = values[2:].astype(np.complex128)
        return np.concatenate([_to_earth(angles).T @ along, np.zeros(3), angles, speeds, speeds])

    for _ in range(_MOST_TURNS if np.isfinite(along).all() else 0):
        left = _rates(point_at(unknown), body).real[:6]
        if np.abs(left).max() < _BALANCE:
            break
        steps = np.eye(unknown.size) * (1j * _STEP)
        slopes = np.stack([_rates(point_at(unknown + step), body).imag[:6] / _STEP for step in steps], axis=1)
        unknown = unknown - np.linalg.lstsq(slopes, left, rcond=None)[0]
        if np.abs(unknown[:2]).max() > _MOST_TILT_RAD or unknown[2:].min() < 0.0 or unknown[2:].max() > 1.0:
            raise _no_trim(vehicle, airspeed_m_s)
    else:
        raise _no_trim(vehicle, airspeed_m_s)
    point = point_at(unknown).real
    return Trim(float(airspeed_m_s), point[:3], point[6:9], unknown[2:])


def _no_trim(vehicle: Multirotor, airspeed_m_s: float) -> ModelError:
    return ModelError(
        f"{vehicle.name} cannot fly level at {airspeed_m_s:g} m/s within 60 degrees of tilt and its rotors' limits",
        needed="a lower airspeed",
    )


def linearize(
    vehicle: Multirotor,
    autopilot: Autopilot,
    *,
    accelerometer_m: Place = (0.0, 0.0, 0.0),
    airspeed_m_s: float = 0.0,
    aside_m_s: float = 0.0,
) -> StateSpace:
    r"""The vehicle around hover or steady level flight, from commands to what is measured.

    Inputs are the commands of roll, pitch, yaw and thrust; outputs ``p q r phi theta psi u v w ax ay az``; states those
    of :func:`hover_states`. A rotor without lag is an algebraic state. The inputs are late by the delays of the
    autopilot and by half a turn of its loop: a logged command is held for a turn, so that this is the delay which a
    frequency response of the log shows.

    Parameters
    ----------
    vehicle
        What flies.
    autopilot
        Its mixer, linearization, delays and rate are used; its gains are not.
    accelerometer_m
        Where the accelerometer sits, from the center of gravity.
    airspeed_m_s, aside_m_s
        Of the level flight around which it is linear (:func:`trimmed`). States are differences from that trim; the
        terms of :math:`\omega \times v`, as :math:`-w_0 q` in :math:`\dot u`, are part of ``F``.

    Raises
    ------
    ModelError
        The rotors cannot carry the vehicle, or not at this airspeed.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> from rotorid.simulation.autopilot import RateLoop
    >>> from rotorid.simulation.multirotor import Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> vehicle = Multirotor(name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> system = linearize(vehicle, autopilot)
    >>> round(float(system.F[MOTION.index("u"), MOTION.index("theta")]), 5), system.G.shape
    (-9.80665, (13, 4))
    """
    body = vehicle.body()
    trim = trimmed(vehicle, airspeed_m_s, aside_m_s)
    slopes = _slopes(trim, body)
    count, rotors = len(MOTION), vehicle.rotors.layout.rotors
    size = count + rotors
    states, outputs = slopes[:, :size], slopes[:, size:]
    allotted = rotor_slopes(vehicle, autopilot, trim.shares)
    M, H0, H1 = np.eye(size), np.zeros((len(OUTPUTS), size)), np.zeros((len(OUTPUTS), size))
    if body.has_lag:
        F, G, felt = states[:size], outputs[:size] @ allotted, states[size:]
    else:
        # The speeds are the outputs: 0 = u - x, and what the outputs do, the speeds do.
        M[count:, count:] = 0.0
        F = np.zeros((size, size))
        F[:count] = np.hstack([states[:count, :count], outputs[:count]])
        F[count:, count:] = -np.eye(rotors)
        G = np.vstack([np.zeros((count, len(AXES))), allotted])
        felt = np.hstack([states[size:, :count], outputs[size:]])
    for row, name in enumerate(OUTPUTS):
        if name in MOTION:
            H0[row, MOTION.index(name)] = 1.0
    accelerations = slice(OUTPUTS.index(ACCELERATIONS[0]), None)
    H0[accelerations] = felt
    x, y, z = accelerometer_m
    # Away from the center of gravity it feels the angular acceleration too; the centripetal part has the slope zero.
    H1[accelerations, 3:6] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return StateSpace(
        M=M,
        F=F,
        G=G,
        H0=H0,
        H1=H1,
        input_delays_s=np.array(autopilot.delay_s) + 0.5 / autopilot.rate_hz,
        output_delays_s=np.zeros(len(OUTPUTS)),
    )


def rotor_slopes(vehicle: Multirotor, autopilot: Autopilot, shares: FloatArray) -> FloatArray:
    """Steady change of each rotor's speed per unit of each command, shape ``(rotors, 4)``.

    Parameters
    ----------
    vehicle, autopilot
        See :func:`linearize`.
    shares
        Speeds of the rotors about which this holds, shares of the largest one, as the change is.
    """
    line = autopilot.linearization
    curve = ExpoCurve(expo=line.expo, low=line.low, high=line.high)
    return np.asarray(autopilot.mixer_for(vehicle) / curve.slope(shares)[:, None])


def hover_derivatives_of(
    vehicle: Multirotor, autopilot: Autopilot, *, airspeed_m_s: float = 0.0, aside_m_s: float = 0.0
) -> dict[str, float]:
    r"""Stability and control derivatives in hover or level flight, by the names of the hover models, ``X_u`` and so on.

    Per mass and inertia, in SI units and radians, commands of one. The control derivatives are those of steady rotors:
    lag and delay come on top. All sixty are given, those that symmetry makes zero too, and ``N_spin``, by which the
    vehicle turns when its rotors have followed a step of the yaw command. They are of the forces alone:
    the terms of :math:`\omega \times v_0` that :func:`linearize` holds at speed are taken off, as the hover models hold
    them by their constants ``U0`` and ``W0``.

    Parameters
    ----------
    vehicle, autopilot, airspeed_m_s, aside_m_s
        See :func:`linearize`. In a steady wind rotors that drag have derivatives that are zero in calm air, such as
        ``N_roll``: the speed of each rotor sets how much it drags.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> from rotorid.simulation.autopilot import RateLoop
    >>> from rotorid.simulation.multirotor import Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> vehicle = Multirotor(name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> found = hover_derivatives_of(vehicle, autopilot)
    >>> round(found["Z_thrust"], 3), found["M_u"]
    (-34.304, 0.0)
    """
    system = linearize(vehicle, autopilot, airspeed_m_s=airspeed_m_s, aside_m_s=aside_m_s)
    rows = len(FORCES_AND_MOMENTS)
    motion = len(MOTION)
    followed = np.linalg.solve(system.F[motion:, motion:], system.G[motion:])
    control = system.G[:rows] - system.F[:rows, motion:] @ followed
    u, v, w = trimmed(vehicle, airspeed_m_s, aside_m_s).velocity_m_s
    turned = np.zeros((rows, rows))
    turned[:3, 3:] = [[0.0, -w, v], [w, 0.0, -u], [-v, u, 0.0]]
    table = np.hstack([system.F[:rows, :rows] - turned, control])
    columns = MOTION[:rows] + AXES
    spin = vehicle.rotors.mean_lag_s * float(system.G[FORCES_AND_MOMENTS.index("N"), AXES.index("yaw")])
    return {
        f"{letter}_{column}": float(table[row, place])
        for row, letter in enumerate(FORCES_AND_MOMENTS)
        for place, column in enumerate(columns)
    } | {"N_spin": spin}


def hover_slopes(vehicle: Multirotor) -> FloatArray:
    """Accelerations of a hovering vehicle by ``u v w p q r``, rotors and body together, shape ``(6, 6)``.

    Examples
    --------
    >>> from rotorid.vehicles.catalog import aircraft
    >>> round(float(hover_slopes(aircraft("forward_quad").vehicle)[0, 0]), 3)
    -0.235
    """
    motion = len(FORCES_AND_MOMENTS)
    return np.array(_slopes(trimmed(vehicle, 0.0), vehicle.body())[:motion, :motion])


def _slopes(trim: Trim, body: Body) -> FloatArray:
    """Slopes of the rates of all states and of the specific force, by states and by outputs to the motors.

    Shape ``(9 + rotors + 3, 9 + 2 rotors)``.
    """
    lag_s = 0.5 * (body.lag_up + body.lag_down)
    body = body._replace(lag_up=lag_s, lag_down=lag_s)
    point = np.concatenate([trim.velocity_m_s, np.zeros(3), trim.angles_rad, trim.shares, trim.shares])
    steps = np.eye(point.size) * (_ASIDE + 1j * _STEP)
    return np.stack([_rates(point + step, body).imag / _STEP for step in steps], axis=1)


def _rates(point: ComplexArray, body: Body) -> ComplexArray:
    """Rates of motion and rotors, and the specific force, at velocities in body axes and Euler angles."""
    from rotorid.simulation.flight_kernels import derivative

    rotors = (point.size - len(MOTION)) // 2
    velocity, rates, angles = point[:3], point[3:6], point[6:9]
    speeds, outputs = np.split(point[9:], 2)
    turn = _to_earth(angles)
    state = np.concatenate([np.zeros(3), turn @ velocity, quaternion_from_euler(angles), rates, speeds])
    out = np.zeros(STATES + rotors + 3, dtype=np.complex128)
    cast(Any, derivative).py_func(state, outputs, np.zeros(3), 1.0, body, out)
    phi, theta = angles[0], angles[1]
    p, q, r = rates
    swing = q * np.sin(phi) + r * np.cos(phi)
    motor_speed = np.array(
        [p + swing * np.tan(theta), q * np.cos(phi) - r * np.sin(phi), swing / np.cos(theta)], dtype=np.complex128
    )
    moving = turn.T @ out[3:6] - np.cross(rates, velocity)
    return np.concatenate([moving, out[10:13], motor_speed, out[STATES:]])


def _to_earth(angles: AnyArray) -> ComplexArray:
    """Rotation from body to earth axes, analytic in the angles."""
    (cf, ct, cp), (sf, st, sp) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp],
            [ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp],
            [-st, sf * ct, cf * ct],
        ]
    )


_MOST_STATES = 64


def feedback_of(autopilot: Autopilot, *, gyro_lag_s: float = 0.0) -> StateSpace:
    """Commands of roll, pitch, yaw and thrust by the measured ``p q r phi theta psi u v w ax ay az``, with their signs.

    Closes the loop around :func:`linearize`: ``u = feedback(y) + test input``. North
    and east are the integrals of u and v, height that of w, which holds near hover on a heading of zero.

    Parameters
    ----------
    autopilot
        Gains, filters, guidance and rate.
    gyro_lag_s
        Lag of the gyroscope in front of the filters.

    Examples
    --------
    >>> from rotorid.simulation.autopilot import RateLoop
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> response = feedback_of(autopilot).response(np.array([1.0]))
    >>> response[0, OUTPUTS.index("p"), 0].real.round(6), response[0, OUTPUTS.index("phi"), 0].real.round(6)
    (np.float64(-0.1), np.float64(-0.4))
    """
    return _cascade(autopilot, OUTPUTS, gyro_lag_s)


def entry_of(autopilot: Autopilot, entry: Entry) -> StateSpace:
    """Commands by test inputs of the four axes at an entry of the cascade, with nothing fed back.

    Parameters
    ----------
    autopilot
        See :func:`feedback_of`.
    entry
        ``command``, ``rate_setpoint``, ``attitude_setpoint`` or ``stick``; thrust has no set-point of rate or attitude,
        and nothing comes of it there.
    """
    return _cascade(autopilot, tuple(f"{axis}_{entry}" for axis in AXES))


@dataclass(frozen=True)
class _Wiring:
    """A growing linear system. A signal is a row: what it takes of each input, and after them of each state."""

    turn_s: float
    inputs: tuple[str, ...]
    slopes: list[FloatArray] = field(default_factory=list)
    """Of each state, a signal."""

    def input(self, name: str) -> FloatArray:
        """An input; nothing when the system is made for others."""
        row = np.zeros(len(self.inputs) + _MOST_STATES)
        if name in self.inputs:
            row[self.inputs.index(name)] = 1.0
        return row

    def state(self) -> FloatArray:
        """A new one, whose slope is still to be set."""
        row = np.zeros(len(self.inputs) + _MOST_STATES)
        row[len(self.inputs) + len(self.slopes)] = 1.0
        self.slopes.append(np.zeros_like(row))
        return row

    def low_pass(self, signal: FloatArray, lag_s: float) -> FloatArray:
        if lag_s <= 0.0 or not signal.any():
            return signal
        passed = self.state()
        self.slopes[-1][:] = (signal - passed) / lag_s
        return passed

    def butterworth(self, signal: FloatArray, cutoff_hz: float) -> FloatArray:
        if cutoff_hz <= 0.0 or not signal.any():
            return signal
        omega = 2.0 / self.turn_s * math.tan(math.pi * cutoff_hz * self.turn_s)
        passed, slope = self.state(), self.state()
        self.slopes[-2][:] = slope
        self.slopes[-1][:] = omega**2 * (signal - passed) - math.sqrt(2.0) * omega * slope
        return passed

    def slope(self, signal: FloatArray) -> FloatArray:
        """Difference to the turn before, over its length."""
        return (signal - self.low_pass(signal, 0.5 * self.turn_s)) / (0.5 * self.turn_s)

    def moved(self, signal: FloatArray, gain: float) -> FloatArray:
        """A gain times the integral."""
        if gain == 0.0 or not signal.any():
            return np.zeros_like(signal)
        integral = self.state()
        self.slopes[-1][:] = signal
        return gain * integral

    def summed(self, signal: FloatArray, gain: float) -> FloatArray:
        """A gain times the sum of all turns before this one, and times their length."""
        return self.moved(signal, gain) - 0.5 * gain * self.turn_s * signal


def _cascade(autopilot: Autopilot, inputs: tuple[str, ...], gyro_lag_s: float = 0.0) -> StateSpace:
    """All commands by inputs of the cascade."""
    wires = _Wiring(1.0 / autopilot.rate_hz, inputs)
    asked = [_shaped(autopilot, wires, axis) for axis in range(3)]
    *attitude, thrust = _outer(autopilot, wires, [angle for angle, _ in asked])
    commands = [
        _inner(autopilot, wires, gyro_lag_s, axis, wanted, asked[axis][1]) for axis, wanted in enumerate(attitude)
    ]
    commands.append(thrust)
    added = [wires.input(f"{axis}_command") for axis in AXES]
    taken, size = len(inputs), len(inputs) + len(wires.slopes)
    # Inputs are algebraic states, 0 = u - x, for they pass to the commands at once.
    M, F, G = np.eye(size), np.zeros((size, size)), np.zeros((size, taken))
    M[:taken] = 0.0
    F[:taken, :taken] = -np.eye(taken)
    F[taken:] = np.reshape(wires.slopes, (size - taken, taken + _MOST_STATES))[:, :size]
    G[:taken] = np.eye(taken)
    return StateSpace(
        M=M,
        F=F,
        G=G,
        H0=np.stack([command + extra for command, extra in zip(commands, added, strict=True)])[:, :size],
        H1=np.zeros((len(AXES), size)),
        input_delays_s=np.zeros(taken),
        output_delays_s=np.zeros(len(AXES)),
    )


def _shaped(autopilot: Autopilot, wires: _Wiring, axis: int) -> tuple[FloatArray, FloatArray]:
    """The attitude set-point of an axis that flies, and the rate set-point that goes with it.

    Small ones: the limits of :mod:`rotorid.simulation.shaping` are left out.
    """
    asked = wires.input(f"{AXES[axis]}_attitude_setpoint")
    shaping = {str(name): own for name, own in autopilot.shaping.items()}.get(AXES[axis])
    if shaping is None or not asked.any():
        return asked, np.zeros_like(asked)
    target = wires.low_pass(asked, shaping.lag_s)
    # The target moves by its rate in the turn that follows.
    return wires.low_pass(target, 0.5 * wires.turn_s), (asked - target) / shaping.lag_s


def _outer(autopilot: Autopilot, wires: _Wiring, asked: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
    """Set-points of roll, pitch and heading, and the command of thrust."""
    own, put = autopilot.guidance, wires.input
    phi = asked[0] + own.stick_tilt_rad * put("roll_stick")
    theta = asked[1] - own.stick_tilt_rad * put("pitch_stick")
    if own.hold_velocity:
        right = -put("v") - wires.moved(put("v"), own.position_p_1_s)
        ahead = -put("u") - wires.moved(put("u"), own.position_p_1_s)
        right = own.velocity_p_1_s * right + wires.summed(right, own.velocity_i_1_s2)
        ahead = own.velocity_p_1_s * ahead + wires.summed(ahead, own.velocity_i_1_s2)
        phi, theta = phi + right / STANDARD_GRAVITY_M_S2, theta - ahead / STANDARD_GRAVITY_M_S2
    # Where the heading follows while the stick is out, there is nothing that the stick leads to.
    led = 0.0 if own.heading_follows else own.stick_yaw_rate_rad_s
    psi = asked[2] + wires.moved(put("yaw_stick"), led)
    direct = 0.0 if own.stick_climb_m_s else own.stick_thrust
    if not own.hold_height:
        return phi, theta, psi, direct * put("thrust_stick")
    sink = put("w") + own.stick_climb_m_s * put("thrust_stick")
    sink = sink + wires.moved(sink, own.height_p_1_s)
    climb_demand = own.climb_p * sink + wires.summed(sink, own.climb_i)
    return phi, theta, psi, climb_demand + direct * put("thrust_stick")


def _inner(
    autopilot: Autopilot, wires: _Wiring, gyro_lag_s: float, axis: int, wanted: FloatArray, led: FloatArray
) -> FloatArray:
    """Command of an axis by the set-point of its angle and the rate set-point that goes with it."""
    own, put = autopilot.rates, wires.input
    name = AXES[axis]
    rate = wires.butterworth(wires.low_pass(put(RATES[axis]), gyro_lag_s), autopilot.gyro_cutoff_hz)
    target = autopilot.angle_1_s[axis] * (wanted - put(ATTITUDE[axis])) + put(f"{name}_rate_setpoint") + led
    if name == "yaw":
        target = target + autopilot.guidance.stick_yaw_rate_rad_s * put("yaw_stick")
    target = wires.low_pass(target, _lag(own.target_cutoff_hz[axis]))
    error = wires.low_pass(target - rate, _lag(own.error_cutoff_hz[axis]))
    command = own.proportional[axis] * error + own.feedforward[axis] * target
    command = command + wires.summed(error, own.integral[axis])
    if own.derivative[axis]:
        slope = wires.slope(error if own.derivative_of_error else -rate)
        command = command + own.derivative[axis] * wires.low_pass(slope, _lag(own.derivative_cutoff_hz[axis]))
    return wires.low_pass(command, _lag(own.command_cutoff_hz[axis]))


def _lag(cutoff_hz: float) -> float:
    return 0.5 / (math.pi * cutoff_hz) if cutoff_hz > 0.0 else 0.0
