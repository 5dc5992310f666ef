"""A hover flight in closed loop of a linear vehicle, with test inputs, gusts and sensor noise, as an autopilot logs it.

The autopilot is a cascade of velocity, angle and rate with constant gains. Gusts are air velocities, each a first-order
Gauss–Markov process, the shape of Dryden's longitudinal spectrum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import AXES, Maneuver
from rotorid.errors import ModelError, UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import Discretized, discretize
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

MEASURED = ("p", "q", "r", "phi", "theta", "psi", "u", "v", "w")
"""What the autopilot measures, in the order of its error matrix."""

VELOCITIES = ("u", "v", "w")
ACCELERATIONS = ("ax", "ay", "az")
OUTPUTS = MEASURED + ACCELERATIONS


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


@dataclass(frozen=True, kw_only=True, eq=False)
class HoverVehicle(Immutable):
    r"""A vehicle around hover.

    Parameters
    ----------
    name
        What it is called.
    system
        Four inputs, the commands of roll, pitch, yaw and thrust as differences from hover; twelve outputs,
        ``p q r phi theta psi u v w ax ay az``, the last three as differences from hover too. No output is late.
    states
        Names of the states of ``system``; ``u``, ``v`` and ``w`` are among them. Their columns in F hold nothing but
        aerodynamics (true around hover, where no trim velocity turns), so that gusts enter with the opposite sign.
    hover_thrust
        Thrust command that carries the weight, 0 to 1.
    controller
        The autopilot.
    """

    name: str
    system: StateSpace
    states: tuple[str, ...]
    hover_thrust: float
    controller: HoverController

    def __post_init__(self) -> None:
        outputs, inputs = self.system.H0.shape[0], self.system.G.shape[1]
        if (outputs, inputs) != (len(OUTPUTS), len(AXES)) or len(self.states) != self.system.F.shape[0]:
            raise ModelError(
                f"{self.name} has {inputs} inputs, {outputs} outputs and {len(self.states)} state names",
                needed=f"the inputs {', '.join(AXES)}, the outputs {' '.join(OUTPUTS)}, and a name for each state",
            )
        if missing := set(VELOCITIES) - set(self.states):
            raise ModelError(f"{self.name} lacks the states {', '.join(sorted(missing))}", needed="u, v and w")
        if np.any(self.system.output_delays_s):
            raise ModelError(f"{self.name} has delays at its outputs", remedy="delay the inputs instead")
        self._set(states=tuple(self.states))

    @property
    def gust_input(self) -> FloatArray:
        """Columns of G for gusts along u, v and w, shape ``(x, 3)``: air that comes is speed that goes."""
        columns: FloatArray = -self.system.F[:, [self.states.index(name) for name in VELOCITIES]]
        return columns


STEP_RATE_HZ = 1000.0
"""Rate of the autopilot and of the simulation."""

TRIM_S = 5.0
GUST_CORRELATION_S = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation(Immutable):
    """A test input at its time in the flight, added to the command after the controller.

    Parameters
    ----------
    maneuver
        Axis, kind and interval on the clock of the flight.
    values
        Samples from ``maneuver.start_s`` on, shape ``(samples,)``, in units of the command.
    sample_rate_hz
        Rate of ``values``; in between they are interpolated linearly.
    """

    maneuver: Maneuver
    values: FloatArray
    sample_rate_hz: float

    def __post_init__(self) -> None:
        self._set(values=read_only(self.values, np.float64, ndim=1))


@dataclass(frozen=True, kw_only=True, slots=True)
class SensorNoise:
    """Standard deviations of white noise, per sample. The autopilot flies on the noisy values, as a real one does."""

    gyro_rad_s: float = 0.01
    attitude_rad: float = 0.002
    velocity_m_s: float = 0.03
    accelerometer_m_s2: float = 0.1

    @property
    def of_measured(self) -> FloatArray:
        """One for each of the measured outputs."""
        return np.repeat([self.gyro_rad_s, self.attitude_rad, self.velocity_m_s], 3)


SILENT = SensorNoise(gyro_rad_s=0.0, attitude_rad=0.0, velocity_m_s=0.0, accelerometer_m_s2=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight(Immutable):
    """What the autopilot logged.

    Parameters
    ----------
    vehicle
        Name of what flew.
    time_s
        Stamps, shape ``(samples,)``.
    sample_rate_hz
        Their rate.
    columns
        Channel name to samples, SI units, FRD: commands, excitations, set-points, rates, attitude, velocity over
        ground, specific force.
    maneuvers
        The excited intervals, in order.
    """

    vehicle: str
    time_s: FloatArray
    sample_rate_hz: float
    columns: Mapping[str, FloatArray]
    maneuvers: tuple[Maneuver, ...]

    def __post_init__(self) -> None:
        columns = {name: read_only(values, np.float64, ndim=1) for name, values in self.columns.items()}
        self._set(time_s=read_only(self.time_s, np.float64, ndim=1), columns=columns, maneuvers=tuple(self.maneuvers))


def fly(
    vehicle: HoverVehicle,
    plan: Sequence[Excitation],
    *,
    sample_rate_hz: float = 200.0,
    turbulence_m_s: float = 0.08,
    noise: SensorNoise | None = None,
    rng: np.random.Generator,
) -> Flight:
    r"""Fly a plan in closed loop and log it.

    Autopilot and vehicle advance at 1 kHz. The vehicle is integrated exactly for commands that go linearly from one
    step to the next, with their fractional delays; the logged samples of the commands therefore show the model's own
    delay, to :math:`(\omega h)^2 / 12` in gain, and not half a step more. Gusts act on the velocity through the air,
    :math:`M \dot x = F x + G u(t - \tau) - F_{uvw} \, g`, while the logged velocity is over ground.

    Everything is linear around hover: angles of more than about 0.4 rad would in truth lose lift, and a command beyond
    its limits would in truth be cut.

    Parameters
    ----------
    vehicle
        The airframe with its autopilot.
    plan
        Test inputs; those that overlap add up. The flight ends 5 s after the last one.
    sample_rate_hz
        Rate of the log, 1 kHz divided by a whole number. Samples are picked, not averaged.
    turbulence_m_s
        Standard deviation of the gusts along each axis, correlated over 1 s.
    noise
        Sensor noise; the standard one when omitted, :data:`SILENT` for none.
    rng
        Random generator of gusts and noise. Same generator state, same flight, bit for bit.

    Raises
    ------
    UsageError
        The rate does not divide 1 kHz, an input is less than one step late, or the flight does not stay within the
        limits of the commands.

    Examples
    --------
    >>> from rotorid.vehicles import s500
    >>> calm = fly(s500.vehicle(), (), turbulence_m_s=0.0, noise=SILENT, rng=np.random.default_rng(0))
    >>> float(calm.columns["az"][0]), float(calm.columns["thrust_command"][-1]), calm.time_s.size
    (-9.80665, 0.5, 1000)
    """
    stride = stride_of(sample_rate_hz)
    noise = noise or SensorNoise()
    duration_s = max((excitation.maneuver.stop_s for excitation in plan), default=0.0) + TRIM_S
    steps = round(duration_s * STEP_RATE_HZ)
    gusts = np.stack([_gust(steps, turbulence_m_s, rng) for _ in VELOCITIES])
    excitation = _excitation(plan, steps)
    measured, accelerations, commands = _advance(vehicle, excitation, gusts, noise, rng)
    _within_limits(vehicle, commands)
    signals = np.vstack([commands, excitation, measured, accelerations])[:, ::stride]
    signals[-len(ACCELERATIONS) :] += noise.accelerometer_m_s2 * rng.standard_normal(
        (len(ACCELERATIONS), signals.shape[1])
    )
    return Flight(
        vehicle=vehicle.name,
        time_s=np.arange(signals.shape[1]) / sample_rate_hz,
        sample_rate_hz=sample_rate_hz,
        columns=_columns(vehicle, signals),
        maneuvers=tuple(sorted((part.maneuver for part in plan), key=lambda maneuver: maneuver.start_s)),
    )


def _advance(
    vehicle: HoverVehicle, excitation: FloatArray, gusts: FloatArray, noise: SensorNoise, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measured outputs with noise, accelerations without, and commands, each ``(rows, steps)``."""
    from rotorid.simulation.linear_kernels import closed_loop

    step, C, D = _discrete(vehicle)
    inputs, sensors = len(AXES), len(MEASURED)
    calm = np.zeros(inputs)
    errors = noise.of_measured * rng.standard_normal((excitation.shape[1], sensors))
    # Gusts are known beforehand; only the commands depend on the flight.
    disturbance = step.forcing(np.vstack([np.zeros_like(excitation), gusts]), np.append(calm, gusts[:, 0]))
    states, commands = closed_loop(
        step.transition,
        np.ascontiguousarray(step.taps[:, :inputs]),
        step.lags[:inputs],
        disturbance,
        np.ascontiguousarray(C[:sensors]),
        errors,
        vehicle.controller.error,
        vehicle.controller.proportional,
        vehicle.controller.integral / STEP_RATE_HZ,
        np.ascontiguousarray(excitation.T),
    )
    late = step.delayed(np.vstack([commands.T, gusts]), np.append(calm, gusts[:, 0]))
    return C[:sensors] @ states.T + errors.T, C[sensors:] @ states.T + D[sensors:] @ late, commands.T


def _discrete(vehicle: HoverVehicle) -> tuple[Discretized, FloatArray, FloatArray]:
    """A step of the vehicle for commands and gusts, and its output matrices."""
    system = vehicle.system
    if system.input_delays_s.min() < 1.0 / STEP_RATE_HZ:
        raise UsageError(
            f"the input delay of {vehicle.name} is {1e3 * system.input_delays_s.min():g} ms",
            needed=f"at least one step of {1e3 / STEP_RATE_HZ:g} ms",
            remedy="use the delay of the real path",
        )
    gusty = replace(
        system,
        G=np.hstack([system.G, vehicle.gust_input]),
        input_delays_s=np.append(system.input_delays_s, np.zeros(len(VELOCITIES))),
    )
    A, B, C, D = gusty.proper()
    return discretize(A, B, delays_s=gusty.input_delays_s, step_s=1.0 / STEP_RATE_HZ, hold="first"), C, D


def _excitation(plan: Sequence[Excitation], steps: int) -> FloatArray:
    """All test inputs on the clock of the simulation, shape ``(4, steps)``."""
    total = np.zeros((len(AXES), steps))
    time_s = np.arange(steps) / STEP_RATE_HZ
    for excitation in plan:
        stamps = excitation.maneuver.start_s + np.arange(excitation.values.size) / excitation.sample_rate_hz
        row = AXES.index(excitation.maneuver.axis)
        active = slice(*np.searchsorted(time_s, [stamps[0], stamps[-1] + 0.5 / STEP_RATE_HZ]))
        total[row, active] += np.interp(time_s[active], stamps, excitation.values)
    return total


def _columns(vehicle: HoverVehicle, signals: FloatArray) -> dict[str, FloatArray]:
    """Names for the signals, trim added, and the set-points that follow from what was measured."""
    names = (*(f"{axis}_command" for axis in AXES), *(f"{axis}_excitation" for axis in AXES), *OUTPUTS)
    columns = dict(zip(names, signals, strict=True))
    columns["thrust_command"] = columns["thrust_command"] + vehicle.hover_thrust
    columns["az"] = columns["az"] - STANDARD_GRAVITY_M_S2
    controller = vehicle.controller
    return columns | {
        "phi_setpoint": -controller.lean_rad_per_m_s * columns["v"],
        "theta_setpoint": controller.lean_rad_per_m_s * columns["u"],
        "r_setpoint": -controller.angle_p[2] * columns["psi"],
    }


def _gust(steps: int, intensity: float, rng: np.random.Generator) -> FloatArray:
    return gauss_markov(
        steps, intensity=intensity, correlation_s=GUST_CORRELATION_S, sample_rate_hz=STEP_RATE_HZ, rng=rng
    )


def stride_of(sample_rate_hz: float) -> int:
    """Steps of the simulation from one sample of the log to the next; a whole number of them."""
    stride = round(STEP_RATE_HZ / sample_rate_hz) if sample_rate_hz > 0.0 else 0
    if stride < 1 or abs(stride * sample_rate_hz - STEP_RATE_HZ) > 1e-9 * STEP_RATE_HZ:
        raise UsageError(
            f"a log at {sample_rate_hz:g} Hz cannot be simulated",
            needed=f"{STEP_RATE_HZ:g} Hz divided by a whole number",
            remedy="use 100, 125, 200, 250, 500 or 1000 Hz",
        )
    return stride


def _within_limits(vehicle: HoverVehicle, commands: FloatArray) -> None:
    hover = vehicle.hover_thrust
    for axis, command in zip(AXES, commands, strict=True):
        low, high = (-hover, 1.0 - hover) if axis == "thrust" else (-1.0, 1.0)
        # Written so that a number that is none is beyond the limits too.
        if not (low <= command.min() and command.max() <= high):
            raise UsageError(
                f"{axis}_command of {vehicle.name} reaches {np.abs(command).max():.3g} from trim",
                needed=f"{low:g} to {high:g}",
                remedy="lower the amplitude of the plan or the turbulence",
            )


def gauss_markov(
    samples: int, *, intensity: float, correlation_s: float, sample_rate_hz: float, rng: np.random.Generator
) -> FloatArray:
    r"""Stationary noise with the autocorrelation :math:`\sigma^2 e^{-|t|/T}`.

    .. math:: g_{k+1} = a g_k + \sigma \sqrt{1 - a^2} \, n_k, \qquad a = e^{-h/T}, \qquad
        S(\omega) = \frac{4 \sigma^2 T}{1 + \omega^2 T^2} \text{ per Hz}

    It is Dryden's longitudinal gust for T = scale length over airspeed. In hover the airspeed is the wind itself, so T
    is given directly; the transverse components of Dryden fall off a little differently.

    Parameters
    ----------
    samples
        Number of samples.
    intensity
        Standard deviation :math:`\sigma`, in the unit of the result.
    correlation_s
        T, the time after which the correlation has fallen to 1/e.
    sample_rate_hz
        Rate of the samples; the recursion is exact at any rate.
    rng
        Random generator; ``samples`` numbers are drawn from it.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``; already stationary at its first sample.

    Examples
    --------
    >>> gust = gauss_markov(9, intensity=0.5, correlation_s=2.0, sample_rate_hz=100.0, rng=np.random.default_rng(0))
    >>> gust.shape
    (9,)
    """
    from scipy.signal import lfilter

    decay = math.exp(-1.0 / (correlation_s * sample_rate_hz))
    innovation = rng.standard_normal(samples)
    # The first sample is drawn from the stationary distribution, all others bring what the decay took away.
    innovation[1:] *= math.sqrt(1.0 - decay**2)
    gust: FloatArray = intensity * lfilter([1.0], [1.0, -decay], innovation)
    return gust
