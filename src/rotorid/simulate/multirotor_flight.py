"""Nonlinear flights: a multirotor under an autopilot, with sensors, wind and a plan of test inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.flight_plan import Entry, FlightPlan
from rotorid.data.immutable import Immutable
from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.frames import euler_from_quaternion
from rotorid.simulate import logged
from rotorid.simulate.autopilot import Autopilot
from rotorid.simulate.multirotor import Multirotor
from rotorid.simulate.packed import STATES
from rotorid.simulate.sensors import Sensors
from rotorid.simulate.wind import CALM, Wind, blown
from rotorid.typing import Axis, FloatArray

GRID_RATE_HZ = 1000.0
"""Least rate of the grid to which delays are rounded."""

SETTLE_S = 5.0
"""Flown before the log begins, so that filters, integrals and the drift in wind have settled."""

_ENTRIES: tuple[Entry, ...] = ("command", "rate_setpoint", "attitude_setpoint", "stick")
_NOISES = 15
_STABLE_STEP = 0.5
_STEPS_PER_LAG = 8.0
"""A step of an eighth of a lag errs by 0.125^5/120 of the change of a speed, 3e-7."""


class LostError(UsageError):
    """A vehicle that did not stay in the air."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Aircraft(Immutable):
    """Everything that flies: vehicle, autopilot, sensors.

    Parameters
    ----------
    vehicle, autopilot, sensors
        See :class:`~rotorid.simulate.multirotor.Multirotor`, :class:`~rotorid.simulate.autopilot.Autopilot` and
        :class:`~rotorid.simulate.sensors.Sensors`.
    """

    vehicle: Multirotor
    autopilot: Autopilot
    sensors: Sensors = field(default_factory=Sensors)

    @property
    def name(self) -> str:
        return self.vehicle.name


class Desk:
    """Arrays that one flight after another is written to: fresh pages of memory cost a fifth of a flight."""

    def __init__(self) -> None:
        self._held: dict[str, FloatArray] = {}

    def table(self, name: str, rows: int, columns: int) -> FloatArray:
        """A table with whatever stands in it; good until the same name is asked for again."""
        held = self._held.get(name)
        if held is None or held.size < rows * columns:
            held = self._held[name] = np.empty(rows * columns)
        return held[: rows * columns].reshape(rows, columns)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightTables(Immutable):
    """What the kernel of a flight wrote, row by row, before anything is picked and copied; good until the next one.

    Parameters
    ----------
    aircraft, plan
        What flew.
    skipped
        Rows before the log begins.
    log, truth
        Columns as in `rotorid.simulate.logged`; state, its rates being the last but the rotors', and specific force.
    asked, winds
        Test inputs ``(rows, 16)`` and air ``(rows, 3)``.
    """

    aircraft: Aircraft
    plan: FlightPlan | None
    skipped: int
    log: FloatArray
    truth: FloatArray
    asked: FloatArray
    winds: FloatArray

    @cached_property
    def columns(self) -> Mapping[str, FloatArray]:
        """What the autopilot had, views by the names of the vocabulary."""
        return _columns(self.aircraft, self.log[self.skipped :], self.asked[self.skipped :], self.plan)

    def flight(self) -> SimulatedFlight:
        """Everything under its name."""
        kept, rate_hz = slice(self.skipped, None), self.aircraft.autopilot.rate_hz
        return SimulatedFlight(
            vehicle=self.aircraft.name,
            autopilot=self.aircraft.autopilot.kind,
            sample_rate_hz=rate_hz,
            time_s=np.arange(len(self.log) - self.skipped) / rate_hz,
            columns=self.columns,
            raw=_raw(self.aircraft, self.log, self.skipped),
            truth=_truth(self.truth[kept], self.winds[kept], self.aircraft.vehicle.rotors.layout.rotors),
            maneuvers=() if self.plan is None else self.plan.maneuvers,
            parameters=self.aircraft.autopilot.parameters,
            saturated=float(np.mean(self.log[kept, logged.SATURATED] > 0.0)),
        )


def fly_multirotor(
    aircraft: Aircraft,
    plan: FlightPlan | None = None,
    *,
    duration_s: float | None = None,
    wind: Wind = CALM,
    seed: int = 0,
    step_rate_hz: float | None = None,
    settle_s: float = SETTLE_S,
) -> SimulatedFlight:
    """Fly and log.

    The vehicle is integrated by Runge and Kutta's fourth order between ticks of the autopilot, with outputs held as the
    autopilot holds them, and each command arriving after its delay. Gusts are held for a tick.

    Parameters
    ----------
    aircraft
        What flies.
    plan
        Test inputs; none for a flight in which nothing is excited.
    duration_s
        Length of the log; that of the plan when none is given.
    wind
        Steady part and turbulence.
    seed
        Of turbulence and noise. Same seed, same flight, bit for bit.
    step_rate_hz
        Least rate of the integrator and of the grid to which delays are rounded; the next whole multiple of the
        autopilot's is taken. When none is given, delays are rounded to a grid of at least 1 kHz and a step is up to an
        eighth of the shortest lag of a rotor, or a turn of the autopilot; then the largest error of the rates in gusts
        and steps of a command is below 1e-5 of the largest rate.
    settle_s
        Flown before the log.

    Raises
    ------
    UsageError
        Neither plan nor duration came, or the lag of a rotor is shorter than the step can follow.
    LostError
        The vehicle did not stay in the air; the message says when.

    Examples
    --------
    >>> from rotorid.models.rotor_layout_library import library_layout
    >>> from rotorid.simulate.autopilot import RateLoop
    >>> from rotorid.simulate.multirotor import Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> vehicle = Multirotor(name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2), integral=(0.1, 0.1, 0.1))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> flown = fly_multirotor(Aircraft(vehicle=vehicle, autopilot=autopilot), duration_s=2.0)
    >>> flown.samples, round(float(flown.truth["az"].mean()), 2)
    (500, -9.81)
    """
    return flight_tables(
        aircraft,
        plan,
        Desk(),
        duration_s=duration_s,
        wind=wind,
        seed=seed,
        step_rate_hz=step_rate_hz,
        settle_s=settle_s,
    ).flight()


def flight_tables(
    aircraft: Aircraft,
    plan: FlightPlan | None,
    desk: Desk,
    *,
    duration_s: float | None,
    wind: Wind,
    seed: int,
    step_rate_hz: float | None,
    settle_s: float,
) -> FlightTables:
    """Fly as :func:`fly_multirotor` does, and leave it at tables, of which a few columns cost little."""
    from rotorid.simulate.flight_kernels import flight

    rate_hz, vehicle = aircraft.autopilot.rate_hz, aircraft.vehicle
    if plan is None and duration_s is None:
        raise UsageError("neither a plan nor a duration came", needed="one of the two")
    length_s = duration_s if duration_s is not None else plan.duration_s if plan is not None else 0.0
    skipped = round(settle_s * rate_hz)
    rows = skipped + round(length_s * rate_hz)
    substeps, stride = _steps(aircraft, step_rate_hz)
    rng = np.random.default_rng(seed)
    asked = _asked(plan, desk.table("asked", rows, len(_ENTRIES) * len(AXES)), skipped, rate_hz)
    winds = blown(wind, rows, sample_rate_hz=rate_hz, rng=rng)
    noise = desk.table("noise", rows, _NOISES)
    if aircraft.sensors.noisy:
        rng.standard_normal(out=noise)
    else:
        noise.fill(0.0)
    rotors = vehicle.rotors.layout.rotors
    log = desk.table("log", rows, logged.MOTORS + rotors)
    truth = desk.table("truth", rows, STATES + rotors + 3)
    flown = flight(
        vehicle.hovering(),
        asked,
        winds,
        noise,
        vehicle.body(),
        vehicle.supply(),
        aircraft.sensors.senses(),
        aircraft.autopilot.control(vehicle, substeps=substeps),
        log,
        truth,
        stride,
    )
    if flown < rows:
        raise LostError(
            f"{aircraft.name} turned over {_when(flown / rate_hz - settle_s)}",
            needed="a flight that stays within what the vehicle and its autopilot can do",
            remedy="lower the amplitude of the plan, the wind or the gains",
        )
    return FlightTables(aircraft=aircraft, plan=plan, skipped=skipped, log=log, truth=truth, asked=asked, winds=winds)


def _when(time_s: float) -> str:
    return f"{time_s:.1f} s into the log" if time_s >= 0.0 else f"{-time_s:.1f} s before the log began"


def _steps(aircraft: Aircraft, step_rate_hz: float | None) -> tuple[int, int]:
    """Steps of the grid in a turn of the autopilot, and how many of them the integrator takes at once at most."""
    rate_hz, rotors = aircraft.autopilot.rate_hz, aircraft.vehicle.rotors
    substeps = max(1, int(np.ceil((step_rate_hz or GRID_RATE_HZ) / rate_hz - 1e-9)))
    step_s = 1.0 / (rate_hz * substeps)
    lags = [lag for lag in (rotors.lag_up_s, rotors.lag_down_s) if lag]
    if lags and min(lags) < _STABLE_STEP * step_s:
        raise UsageError(
            f"a rotor's lag of {1e3 * min(lags):g} ms came for steps of {1e3 * step_s:g} ms",
            needed="steps of at most twice the lag",
            remedy="raise the rate of the steps, or set the lag to zero",
        )
    if step_rate_hz is not None:
        return substeps, 1
    longest_s = min(lags) / _STEPS_PER_LAG if lags else np.inf
    return substeps, int(min(substeps, max(1.0, longest_s / step_s)))


def _asked(plan: FlightPlan | None, asked: FloatArray, skipped: int, rate_hz: float) -> FloatArray:
    """Test inputs on the ticks, into a table of shape ``(rows, 16)``; none while the flight settles."""
    asked.fill(0.0)
    time_s = np.arange(len(asked) - skipped) / rate_hz
    for one in plan.inputs if plan else ():
        first, last = np.searchsorted(time_s, [one.start_s, one.stop_s])
        column = len(AXES) * _ENTRIES.index(one.entry) + AXES.index(one.axis)
        asked[skipped + first : skipped + last, column] += one.at(time_s[first:last])
    return asked


def _named(table: FloatArray, groups: Mapping[str, int]) -> dict[str, FloatArray]:
    """Columns of a table by names, for groups of names that begin at a column."""
    return {
        name: table[:, first + place] for names, first in groups.items() for place, name in enumerate(names.split())
    }


def _columns(aircraft: Aircraft, log: FloatArray, asked: FloatArray, plan: FlightPlan | None) -> dict[str, FloatArray]:
    """What the autopilot had, by the names of the vocabulary; sticks and excitations only where some were planned."""
    columns = _named(
        log,
        {
            "p q r": logged.RATE,
            "ax ay az": logged.ACCELERATION,
            "phi theta psi": logged.ANGLE,
            "velocity_north velocity_east velocity_down": logged.VELOCITY,
            "north east down": logged.POSITION,
            "phi_setpoint theta_setpoint psi_setpoint": logged.ANGLE_SETPOINT,
            "p_setpoint q_setpoint r_setpoint": logged.RATE_SETPOINT,
            "roll_command pitch_command yaw_command thrust_command": logged.COMMAND,
            " ".join(aircraft.vehicle.rotors.layout.motor_names): logged.MOTORS,
        },
    )
    if aircraft.vehicle.battery is not None:
        columns["battery_voltage"] = log[:, logged.VOLTAGE]
    if plan is not None:
        if any(one.entry == "stick" for one in plan.inputs):
            columns |= {f"{axis}_stick": asked[:, 12 + place] for place, axis in enumerate(AXES)}
        added = {(one.signal, one.axis): one.entry for one in plan.inputs if one.entry != "stick"}
        columns |= {signal: _added(asked, axis, entry) for (signal, axis), entry in added.items()}
    return columns


def _raw(aircraft: Aircraft, log: FloatArray, skipped: int) -> dict[str, FloatArray]:
    """Rates and accelerations before the filters: ArduPilot and PX4 log means over a turn of the loop."""
    groups = {"p q r": logged.RATE_RAW, "ax ay az": logged.ACCELERATION_RAW}
    samples = _named(log[skipped:], groups)
    if aircraft.autopilot.kind == "simple" or skipped < 1:
        return samples
    before = _named(log[skipped - 1 : -1], groups)
    # Rotors without lag push evenly for a turn, so that its last sample of their force is its mean already.
    even = ("ax", "ay", "az") if not aircraft.vehicle.rotors.lag_up_s else ()
    return {name: row if name in even else 0.5 * (row + before[name]) for name, row in samples.items()}


def _added(asked: FloatArray, axis: Axis, entry: Entry) -> FloatArray:
    """What was added on an axis to the command, or to its set-points in their units."""
    place = AXES.index(axis)
    if entry == "command":
        return asked[:, place]
    return np.asarray(asked[:, 4 + place] + asked[:, 8 + place])


def _truth(truth: FloatArray, winds: FloatArray, rotors: int) -> dict[str, FloatArray]:
    angles = euler_from_quaternion(truth[:, 6:10].T)
    columns = _named(
        truth,
        {
            "north east down velocity_north velocity_east velocity_down": 0,
            "p q r": 10,
            " ".join(f"motor_speed_{number + 1}" for number in range(rotors)): STATES,
            "ax ay az": STATES + rotors,
        },
    )
    columns |= dict(zip(("phi", "theta", "psi"), angles, strict=True))
    return columns | _named(winds, {"wind_north wind_east wind_down": 0})
