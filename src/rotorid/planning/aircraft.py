"""The loop of a nonlinear multirotor around hover: linearized vehicle, cascade, wind, sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotorid.autopilots.filters import butterworth_low_pass
from rotorid.autopilots.registry import named
from rotorid.data.base import Immutable
from rotorid.data.flight_plan import Entry
from rotorid.data.record import AXES
from rotorid.models.state_space import StateSpace
from rotorid.planning.loop import Dryden, LoopModel, Noise, Responds, White, loop_model
from rotorid.simulation.autopilot import Autopilot
from rotorid.simulation.hover_flight import ACCELERATIONS, OUTPUTS, VELOCITIES
from rotorid.simulation.linearization import MOTION, entry_of, feedback_of, hover_states, linearize
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.simulation.wind import CALM, Wind
from rotorid.typing import ComplexArray, FloatArray

_ENTRIES: tuple[Entry, ...] = ("rate_setpoint", "attitude_setpoint", "stick")
_LEAST = 1e-6


def aircraft_loop(
    aircraft: Aircraft, *, wind: Wind = CALM, log_rate_hz: float | None = None, filtered: bool | None = None
) -> LoopModel:
    """A multirotor around hover as :func:`rotorid.simulation.multirotor_flight.fly_multirotor` flies it.

    Gusts enter as the motion of the vehicle through still air does, about hover in calm air: what a steady wind does to
    trim, drag and derivatives is left out, and so are limits, sag, vibration and quantization. On a heading of zero.

    Parameters
    ----------
    aircraft
        Vehicle, autopilot and sensors.
    wind
        Its turbulence and the speed that carries it past.
    log_rate_hz
        Rate of the log; that of the autopilot when omitted.
    filtered
        Whether rates and accelerations are those behind the autopilot's filters, or those that the sensors gave. By
        default what an identification takes: behind the filters, and for ArduPilot, which logs sweeps before them, not.

    Examples
    --------
    >>> from rotorid.vehicles import px4 as px4_quad
    >>> loop = aircraft_loop(px4_quad.aircraft())
    >>> loop.outputs[:3], loop.at(np.array([10.0])).excited.shape
    (('p', 'q', 'r'), (4, 4, 1))
    """
    autopilot, sensors = aircraft.autopilot, aircraft.sensors
    adds_sweeps = named(autopilot.kind).adds_sweeps
    system = linearize(aircraft.vehicle, autopilot, accelerometer_m=sensors.accelerometer_place_m)
    plant = _Sampled(aircraft=aircraft, system=system)
    feedback = feedback_of(autopilot, gyro_lag_s=sensors.gyro_lag_s)
    filters = _sensor_filters(aircraft, filtered=not adds_sweeps if filtered is None else filtered)
    std = np.repeat(
        [
            sensors.gyro_noise_rad_s,
            sensors.attitude_noise_rad,
            sensors.velocity_noise_m_s,
            sensors.accelerometer_noise_m_s2,
        ],
        3,
    )
    return loop_model(
        _Behind(path=plant, filters=filters),
        _Before(feedback=feedback, filters=filters),
        [
            Noise(
                source=_gusts(wind),
                path=_Behind(path=_wind_path(system, hover_states(aircraft.vehicle)), filters=filters),
            ),
            Noise(
                source=White(std=tuple(std.tolist()), sample_rate_hz=autopilot.rate_hz),
                path=_FiltersOnly(filters=filters),
            ),
        ],
        name=aircraft.name,
        inputs=[f"{axis}_command" for axis in AXES],
        outputs=OUTPUTS,
        entries=_entries(autopilot),
        log_rate_hz=log_rate_hz or autopilot.rate_hz,
        loop_rate_hz=autopilot.rate_hz,
        declared=("command",) if adds_sweeps else (),
        alone=adds_sweeps,
    )


def rate_filters(aircraft: Aircraft, omega_rad_s: FloatArray) -> ComplexArray:
    """What stands between the motion and each output in front of the controllers, shape ``(y, f)``.

    Parameters
    ----------
    aircraft
        With its sensors and autopilot.
    omega_rad_s
        Frequencies, shape ``(f,)``.
    """
    return _sensor_filters(aircraft, filtered=True).factors(omega_rad_s)


def _entries(autopilot: Autopilot) -> dict[Entry, Responds]:
    """Commands by test inputs that enter at set-points and sticks, as they fly."""
    entries: dict[Entry, Responds] = {entry: entry_of(autopilot, entry) for entry in _ENTRIES}
    if autopilot.shaping:
        entries["attitude_setpoint"] = _Target(autopilot=autopilot, rate=entries["rate_setpoint"])
    return entries


@dataclass(frozen=True, kw_only=True, eq=False)
class _Target:
    """Commands by the attitudes that fly, which lead the rate controller where the autopilot shapes them.

    A plan is taken as it flies (:func:`rotorid.simulation.shaping.shaped_plan`), so that its limits count too.
    """

    autopilot: Autopilot
    rate: Responds

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        gains = np.array([*self.autopilot.angle_1_s, 0.0])
        led = np.array([axis in self.autopilot.shaping for axis in AXES])
        # The target moves by its rate in the tick that follows.
        slope = np.expm1(1j * omega_rad_s / self.autopilot.rate_hz) * self.autopilot.rate_hz
        by_angle = gains[:, None] + np.multiply.outer(led, slope)
        return np.asarray(self.rate.response(omega_rad_s) * by_angle[None, :, :])


def _sensor_filters(aircraft: Aircraft, *, filtered: bool) -> _Filters:
    autopilot, sensors = aircraft.autopilot, aircraft.sensors
    lags = [sensors.gyro_lag_s] * 3 + [0.0] * 6 + [sensors.accelerometer_lag_s] * 3
    cutoffs = [autopilot.gyro_cutoff_hz] * 3 + [0.0] * 6 + [autopilot.accelerometer_cutoff_hz] * 3
    # Unfiltered samples of both are means over a turn; the force of rotors without lag does not change in one.
    means = autopilot.kind != "simple" and not filtered
    forces = means and aircraft.vehicle.rotors.lag_up_s > 0.0
    return _Filters(
        lags_s=tuple(lags),
        cutoffs_hz=tuple(cutoffs if filtered else [0.0] * len(OUTPUTS)),
        means=(means,) * 3 + (False,) * 6 + (forces,) * 3,
        rate_hz=autopilot.rate_hz,
    )


@dataclass(frozen=True, kw_only=True)
class _Filters(Immutable):
    """From the motion to the log: lags of sensors, digital Butterworth filters, means of two samples; zero for none."""

    lags_s: tuple[float, ...]
    cutoffs_hz: tuple[float, ...]
    means: tuple[bool, ...]
    rate_hz: float

    def factors(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Shape ``(y, f)``."""
        factors = 1.0 / (1.0 + 1j * np.multiply.outer(np.array(self.lags_s), omega_rad_s))
        late = np.exp(-1j * omega_rad_s / self.rate_hz)
        factors[np.array(self.means)] *= 0.5 * (1.0 + late)
        for row, cutoff_hz in zip(factors, self.cutoffs_hz, strict=True):
            if cutoff_hz > 0.0:
                section = butterworth_low_pass(cutoff_hz, self.rate_hz)
                row *= np.polyval(section.numerator[::-1], late) / np.polyval(section.denominator[::-1], late)
        # They are zero at half of their rate, where feedback is found by dividing by them.
        return np.where(np.abs(factors) < _LEAST, _LEAST, factors)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sampled(Immutable):
    """A linear model as its samples show it: what a command does at once appears with the first tick after its delay.

    The half turn that stands for held commands in the linear model is right for what follows from an integral, which
    the force of rotors without lag does not.
    """

    aircraft: Aircraft
    system: StateSpace

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        answers = self.system.response(omega_rad_s)
        vehicle, autopilot = self.aircraft.vehicle, self.aircraft.autopilot
        if vehicle.rotors.lag_up_s > 0.0:
            return answers
        felt = slice(OUTPUTS.index(ACCELERATIONS[0]), None)
        speeds = slice(len(MOTION), None)
        at_once = self.system.H0[felt, speeds] @ self.system.G[speeds]
        first_s = (np.floor(np.array(autopilot.delay_s) * autopilot.rate_hz + 1e-9) + 1.0) / autopilot.rate_hz
        late = [np.exp(-1j * np.multiply.outer(delay, omega_rad_s)) for delay in (first_s, self.system.input_delays_s)]
        answers = answers.copy()
        answers[felt] += at_once[:, :, None] * (late[0] - late[1])[None, :, :]
        return np.asarray(answers)


@dataclass(frozen=True, kw_only=True)
class _Behind:
    """Outputs of a path as they are behind their filters."""

    path: Responds
    filters: _Filters

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(self.path.response(omega_rad_s) * self.filters.factors(omega_rad_s)[:, None, :])


@dataclass(frozen=True, kw_only=True)
class _Before:
    """A feedback of what is before the filters, by what is behind them."""

    feedback: Responds
    filters: _Filters

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(self.feedback.response(omega_rad_s) / self.filters.factors(omega_rad_s)[None, :, :])


@dataclass(frozen=True, kw_only=True)
class _FiltersOnly:
    """The filters themselves."""

    filters: _Filters

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        factors = self.filters.factors(omega_rad_s)
        return np.asarray(np.eye(len(factors))[:, :, None] * factors[:, None, :])


def _wind_path(plant: StateSpace, states: tuple[str, ...]) -> StateSpace:
    """Outputs by gusts along u, v and w: air that comes is speed that goes, for forces and for what is felt of them."""
    moved = [states.index(name) for name in VELOCITIES]
    size, gusts = len(plant.F), len(moved)
    # Gusts are algebraic states, 0 = g - x, for the accelerometer feels them at once.
    M, F = np.zeros((size + gusts, size + gusts)), np.zeros((size + gusts, size + gusts))
    M[:size, :size], F[:size, :size] = plant.M, plant.F
    F[:size, size:] = -plant.F[:, moved]
    F[size:, size:] = -np.eye(gusts)
    H0 = np.hstack([plant.H0, np.zeros((len(OUTPUTS), gusts))])
    felt = [OUTPUTS.index(name) for name in ACCELERATIONS]
    H0[felt, size:] = -plant.H0[np.ix_(felt, moved)]
    return StateSpace(
        M=M,
        F=F,
        G=np.vstack([np.zeros((size, gusts)), np.eye(gusts)]),
        H0=H0,
        H1=np.hstack([plant.H1, np.zeros((len(OUTPUTS), gusts))]),
        input_delays_s=np.zeros(gusts),
        output_delays_s=plant.output_delays_s,
    )


def _gusts(wind: Wind) -> Dryden:
    level_m, height_m = wind.lengths_m
    # In less than 1 m/s turbulence drifts on its own, as in rotorid.simulation.wind.blown.
    speed_m_s = max(wind.speed_m_s, 1.0)
    return Dryden(
        level_std=wind.turbulence_m_s,
        vertical_std=wind.vertical_share * wind.turbulence_m_s,
        level_s=level_m / speed_m_s,
        vertical_s=height_m / speed_m_s,
        heading_rad=math.atan2(wind.east_m_s, wind.north_m_s),
    )
