"""A closed-loop hover flight with test inputs, gusts and sensor noise, as an autopilot would log it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.immutable import Immutable, read_only
from rotorid.data.maneuver import Maneuver
from rotorid.errors import UsageError
from rotorid.simulate.controller import MEASURED
from rotorid.simulate.hold import Discretized, discretize
from rotorid.simulate.turbulence import gauss_markov
from rotorid.simulate.vehicle import ACCELERATIONS, OUTPUTS, VELOCITIES, HoverVehicle
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

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
    stride = _stride(sample_rate_hz)
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
    from rotorid.simulate.kernels import closed_loop

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
            f"an input of {vehicle.name} is {1e3 * system.input_delays_s.min():g} ms late",
            needed=f"at least one step of {1e3 / STEP_RATE_HZ:g} ms",
            remedy="put the delay of the real path in",
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


def _stride(sample_rate_hz: float) -> int:
    stride = round(STEP_RATE_HZ / sample_rate_hz) if sample_rate_hz > 0.0 else 0
    if stride < 1 or abs(stride * sample_rate_hz - STEP_RATE_HZ) > 1e-9 * STEP_RATE_HZ:
        raise UsageError(
            f"a log at {sample_rate_hz:g} Hz",
            needed=f"{STEP_RATE_HZ:g} Hz divided by a whole number",
            remedy="take 100, 125, 200, 250, 500 or 1000 Hz",
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
