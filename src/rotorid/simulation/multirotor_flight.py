"""Nonlinear flights: a multirotor under an autopilot, with sensors, wind and a plan of test inputs; one, or a batch.

A batch varies vehicle, plan, wind and seed on as many threads as are wanted, and each of its flights is the same as
alone. :func:`changed` makes the vehicles of a batch: other numbers under the names that an identification uses.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from types import MappingProxyType
from typing import Generic, TypeVar, cast

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.base import Immutable, read_only
from rotorid.data.flight_plan import Entry, FlightPlan, SimulatedFlight
from rotorid.data.record import AXES
from rotorid.errors import RotoridError, UsageError
from rotorid.frames import euler_from_quaternion
from rotorid.models.parameter import no_such
from rotorid.simulation import multirotor as logged
from rotorid.simulation.autopilot import Autopilot
from rotorid.simulation.linearization import trimmed
from rotorid.simulation.multirotor import AIR, STATES, Multirotor, Sensors
from rotorid.simulation.shaping import add_shaping
from rotorid.simulation.wind import CALM, Wind, blown
from rotorid.typing import Axis, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

GRID_RATE_HZ = 1000.0
"""Least rate of the grid to which delays are rounded."""

SETTLE_S = 5.0
"""Flown before the log begins, so that filters, integrals and the drift in wind have settled."""

CRUISE_SETTLE_S = 30.0
"""The same at speed, where integrals have to find the drag."""

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
        See :class:`~rotorid.simulation.multirotor.Multirotor`, :class:`~rotorid.simulation.autopilot.Autopilot` and
        :class:`~rotorid.simulation.multirotor.Sensors`.
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
        stored = self._held.get(name)
        if stored is None or stored.size < rows * columns:
            stored = self._held[name] = np.empty(rows * columns)
        return stored[: rows * columns].reshape(rows, columns)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightTables(Immutable):
    """What the kernel of a flight wrote, row by row, before anything is picked and copied; good until the next one.

    Parameters
    ----------
    skipped
        Rows before the log begins.
    log, truth
        Columns as in `rotorid.simulation.multirotor`; state, its rates being the last but the rotors', and specific
        force.
    asked, winds
        Test inputs and speed ``(rows, 17)``, and air ``(rows, 3)``.
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
    settle_s: float | None = None,
    speed_m_s: tuple[float, ...] = (0.0, 0.0),
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
        Flown before the log; 5 s in hover and 30 s at speed when none is given.
    speed_m_s
        Over ground along the heading at times that divide the log evenly, from its beginning to its end, backward if
        negative; straight in between. The flight begins in the trim of :func:`rotorid.simulation.trimmed` at the first.

    Raises
    ------
    UsageError
        Neither plan nor duration came, the lag of a rotor is shorter than the step can follow, or a speed came for an
        autopilot that holds none.
    ModelError
        The vehicle cannot fly level at the first speed.
    LostError
        The vehicle did not stay in the air; the message says when.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> from rotorid.simulation.autopilot import RateLoop
    >>> from rotorid.simulation.multirotor import Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> vehicle = Multirotor(name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2), integral=(0.1, 0.1, 0.1))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> flight = fly_multirotor(Aircraft(vehicle=vehicle, autopilot=autopilot), duration_s=2.0)
    >>> flight.samples, round(float(flight.truth["az"].mean()), 2)
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
        speed_m_s=speed_m_s,
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
    settle_s: float | None,
    speed_m_s: tuple[float, ...] = (0.0, 0.0),
) -> FlightTables:
    """Fly as :func:`fly_multirotor` does, and leave it at tables, of which a few columns cost little."""
    from rotorid.simulation.flight_kernels import flight

    cruising = any(speed_m_s)
    if cruising and not aircraft.autopilot.guidance.hold_velocity:
        raise UsageError(
            f"{aircraft.name} cannot fly at {max(speed_m_s, key=abs):g} m/s: its autopilot does not control velocity",
            remedy="leave --speed out, or choose a vehicle that does, such as x500",
        )
    if settle_s is None:
        settle_s = CRUISE_SETTLE_S if cruising else SETTLE_S

    rate_hz, vehicle = aircraft.autopilot.rate_hz, aircraft.vehicle
    if plan is None and duration_s is None:
        raise UsageError("neither a plan nor a duration was given", needed="one of the two")
    length_s = duration_s if duration_s is not None else plan.duration_s if plan is not None else 0.0
    skipped = round(settle_s * rate_hz)
    rows = skipped + round(length_s * rate_hz)
    substeps, stride = _steps(aircraft, step_rate_hz)
    rng = np.random.default_rng(seed)
    asked = _asked(plan, desk.table("asked", rows, len(_ENTRIES) * len(AXES) + 1), skipped, rate_hz)
    add_shaping(asked, aircraft.autopilot.shaping, rate_hz)
    asked[:skipped, -1] = speed_m_s[0]
    asked[skipped:, -1] = _straight(speed_m_s, rows - skipped)
    winds = blown(wind, rows, sample_rate_hz=rate_hz, rng=rng)
    noise = desk.table("noise", rows, _NOISES)
    if aircraft.sensors.noisy:
        rng.standard_normal(out=noise)
    else:
        noise.fill(0.0)
    rotors = vehicle.rotors.layout.rotors
    log = desk.table("log", rows, logged.MOTORS + rotors)
    truth = desk.table("truth", rows, STATES + rotors + 3)
    ticks = flight(
        _level_flight(vehicle, speed_m_s[0]),
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
    if ticks < rows:
        raise LostError(
            f"{aircraft.name} turned over {_when(ticks / rate_hz - settle_s)}{_blown(wind)}",
            needed="a flight that stays within what the vehicle and its autopilot can do",
            remedy="lower the amplitude of the plan, the wind or the gains",
        )
    return FlightTables(aircraft=aircraft, plan=plan, skipped=skipped, log=log, truth=truth, asked=asked, winds=winds)


def _straight(points: tuple[float, ...], count: int) -> FloatArray:
    """Samples along straight lines between evenly spaced points."""
    if len(points) == 2:
        return np.linspace(*points, count)
    return np.interp(np.linspace(0.0, len(points) - 1.0, count), np.arange(len(points)), points)


def _level_flight(vehicle: Multirotor, speed_m_s: float) -> FloatArray:
    """State in level flight to the north at a speed through calm air."""
    state = vehicle.hovering()
    if speed_m_s:
        trim = trimmed(vehicle, speed_m_s)
        state[3] = speed_m_s
        state[6:10] = trim.quaternion
        state[STATES:] = trim.shares
    return state


def _blown(wind: Wind) -> str:
    if wind == CALM:
        return ", in calm air"
    gusts = f" with gusts of {wind.turbulence_m_s:g} m/s" if wind.turbulence_m_s else ""
    return f", in a wind of {np.hypot(wind.north_m_s, wind.east_m_s):g} m/s{gusts}"


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
            f"steps of {1e3 * step_s:g} ms are too long for a rotor lag of {1e3 * min(lags):g} ms",
            needed="at most twice the lag",
            remedy="raise the rate of the steps, or set the lag to zero",
        )
    if step_rate_hz is not None:
        return substeps, 1
    longest_s = min(lags) / _STEPS_PER_LAG if lags else np.inf
    return substeps, int(min(substeps, max(1.0, longest_s / step_s)))


def _asked(plan: FlightPlan | None, asked: FloatArray, skipped: int, rate_hz: float) -> FloatArray:
    """Test inputs on the ticks, into a table of shape ``(rows, 17)``; none while the flight settles."""
    asked.fill(0.0)
    time_s = np.arange(len(asked) - skipped) / rate_hz
    for test_input in plan.inputs if plan else ():
        first, last = np.searchsorted(time_s, [test_input.start_s, test_input.stop_s])
        column = len(AXES) * _ENTRIES.index(test_input.entry) + AXES.index(test_input.axis)
        asked[skipped + first : skipped + last, column] += test_input.at(time_s[first:last])
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
        if any(test_input.entry == "stick" for test_input in plan.inputs):
            columns |= {f"{axis}_stick": asked[:, 12 + place] for place, axis in enumerate(AXES)}
        added = {(item.signal, item.axis): item.entry for item in plan.inputs if item.entry != "stick"}
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
    """What was added on an axis to the command or to one of its set-points, as it flew."""
    return asked[:, len(AXES) * _ENTRIES.index(entry) + AXES.index(axis)]


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
    columns |= dict(zip(ATTITUDE, angles, strict=True))
    return columns | _named(winds, {"wind_north wind_east wind_down": 0})


HOLD_1_S, HOLD_1_S2, HOLD_PLACE_1_S = 1.0, 0.2, 0.3
"""Acceleration for a drift, for its integral, and speed asked for by a distance: what :func:`piloted` adds. The scripts
that fly a plan hold with the same numbers, so that a flight may be what its prediction was."""


def changed(aircraft: Aircraft, values: Mapping[str, float]) -> Aircraft:
    """The same aircraft with other numbers.

    The autopilot stays as it is but for the thrust command at which it hovers: what changes is the vehicle that it
    meets.

    Parameters
    ----------
    aircraft
        What to change.
    values
        ``m`` (kg), ``I_xx I_yy I_zz`` (kg m²), ``T_motor`` (both lags of the rotors, s), ``T_motor_up T_motor_down``,
        ``thrust`` (factor on the thrust curve), ``kappa`` (torque over thrust, m), ``drag`` (factor on everything that
        the air does), ``tau`` (delay of all commands, s).

    Raises
    ------
    ModelError
        There is no such number, or the vehicle cannot be.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> from rotorid.simulation.autopilot import Autopilot, RateLoop
    >>> from rotorid.simulation.multirotor import Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> vehicle = Multirotor(name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> changed(Aircraft(vehicle=vehicle, autopilot=autopilot), {"m": 1.5}).vehicle.mass_kg
    1.5
    """
    for name, value in values.items():
        if name == "tau":
            aircraft = replace(aircraft, autopilot=replace(aircraft.autopilot, delay_s=(value,) * 4))
        elif name in _CHANGES:
            aircraft = replace(aircraft, vehicle=_CHANGES[name](aircraft.vehicle, value))
        else:
            raise no_such("number of a vehicle", name, (*_CHANGES, "tau"))
    return aircraft


def piloted(aircraft: Aircraft) -> Aircraft:
    """The same aircraft with slow loops that hold its place and height, where its autopilot has none.

    They stand for a pilot who brings it back: 1 m/s² of acceleration for each m/s of drift, 0.3 m/s for each meter, and
    the same in height. What the sticks ask for comes on top.
    """
    guidance, vehicle = aircraft.autopilot.guidance, aircraft.vehicle
    if not guidance.hold_velocity:
        guidance = replace(
            guidance,
            hold_velocity=True,
            velocity_p_1_s=HOLD_1_S,
            velocity_i_1_s2=HOLD_1_S2,
            position_p_1_s=HOLD_PLACE_1_S,
        )
    if not guidance.hold_height:
        hover = float(aircraft.autopilot.hover_commands(vehicle)[AXES.index("thrust")])
        climb = HOLD_1_S * hover / STANDARD_GRAVITY_M_S2
        guidance = replace(
            guidance, hold_height=True, climb_p=climb, climb_i=HOLD_PLACE_1_S * climb, height_p_1_s=HOLD_PLACE_1_S
        )
    return replace(aircraft, autopilot=replace(aircraft.autopilot, guidance=guidance))


def number_of(aircraft: Aircraft, name: str) -> float:
    """What :func:`changed` would change; one for a factor.

    Parameters
    ----------
    aircraft
        Whose number it is.
    name
        Of the number.
    """
    vehicle, rotors = aircraft.vehicle, aircraft.vehicle.rotors
    diagonal = np.diag(vehicle.inertia_kg_m2)
    numbers = {
        "m": vehicle.mass_kg,
        "I_xx": float(diagonal[0]),
        "I_yy": float(diagonal[1]),
        "I_zz": float(diagonal[2]),
        "T_motor": rotors.lag_up_s,
        "T_motor_up": rotors.lag_up_s,
        "T_motor_down": rotors.lag_down_s or 0.0,
        "thrust": 1.0,
        "kappa": rotors.torque_per_thrust_m,
        "drag": 1.0,
        "tau": float(np.mean(aircraft.autopilot.delay_s)),
    }
    if name not in numbers:
        raise no_such("number of a vehicle", name, tuple(numbers))
    return numbers[name]


def _inertia(axis: int) -> Callable[[Multirotor, float], Multirotor]:
    def change(vehicle: Multirotor, value: float) -> Multirotor:
        inertia = np.array(vehicle.inertia_kg_m2)
        inertia[axis, axis] = value
        return replace(vehicle, inertia_kg_m2=inertia)

    return change


def _lags(vehicle: Multirotor, up_s: float, down_s: float) -> Multirotor:
    return replace(vehicle, rotors=replace(vehicle.rotors, lag_up_s=up_s, lag_down_s=down_s))


def _thrust(vehicle: Multirotor, factor: float) -> Multirotor:
    rotors = vehicle.rotors
    c_0, c_1, c_2 = (factor * coefficient for coefficient in rotors.thrust)
    # A torque curve of its own goes along, so that torque over thrust stays.
    q_0, q_1, q_2 = (factor * coefficient for coefficient in rotors.torque_curve)
    torque = None if rotors.torque is None else (q_0, q_1, q_2)
    return replace(vehicle, rotors=replace(rotors, thrust=(c_0, c_1, c_2), torque=torque))


def _drag(vehicle: Multirotor, factor: float) -> Multirotor:
    rotors = vehicle.rotors
    assert vehicle.aerodynamics is not None
    x, y, z = (factor * drag for drag in vehicle.quadratic_drag_n_s2_m2)
    flow = rotors.flow
    if flow is not None:
        flow = replace(flow, **{name: factor * value for name, value in vars(flow).items() if name not in AIR})
    return replace(
        vehicle,
        aerodynamics=factor * vehicle.aerodynamics,
        quadratic_drag_n_s2_m2=(x, y, z),
        vertical_drag_n_s2_m2=factor * vehicle.vertical_drag_n_s2_m2,
        rotors=replace(
            rotors,
            induced_drag_n_s_m=factor * rotors.induced_drag_n_s_m,
            inflow_n_s_m=factor * rotors.inflow_n_s_m,
            flow=flow,
        ),
    )


_CHANGES: Mapping[str, Callable[[Multirotor, float], Multirotor]] = MappingProxyType(
    {
        "m": lambda vehicle, value: replace(vehicle, mass_kg=value),
        "I_xx": _inertia(0),
        "I_yy": _inertia(1),
        "I_zz": _inertia(2),
        "T_motor": lambda vehicle, value: _lags(vehicle, value, value),
        "T_motor_up": lambda vehicle, value: _lags(vehicle, value, vehicle.rotors.lag_down_s or value),
        "T_motor_down": lambda vehicle, value: _lags(vehicle, vehicle.rotors.lag_up_s, value),
        "thrust": _thrust,
        "kappa": lambda vehicle, value: replace(vehicle, rotors=replace(vehicle.rotors, torque_per_thrust_m=value)),
        "drag": _drag,
    }
)

Kept = TypeVar("Kept")

_WAITING = 4
"""Flights that are flown ahead of the one that is asked for, per thread."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sortie(Immutable):
    """One of many flights.

    Parameters
    ----------
    aircraft, plan, duration_s, wind
        See :func:`fly_multirotor`.
    seed
        Of turbulence and noise; by its place among the flights when none is given, see :func:`seed_of`.
    """

    aircraft: Aircraft
    plan: FlightPlan | None = None
    duration_s: float | None = None
    wind: Wind = CALM
    seed: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome(Immutable, Generic[Kept]):
    """The result of a flight.

    Parameters
    ----------
    index
        Its place among the flights, from zero.
    seed
        With which it was flown: ``fly_multirotor`` with it is the same flight.
    kept
        What was kept of it; ``None`` when it failed.
    error
        Why it failed.
    """

    index: int
    seed: int
    kept: Kept | None = None
    error: RotoridError | None = None

    @property
    def result(self) -> Kept:
        """The samples that were kept of the flight.

        Raises
        ------
        RotoridError
            It failed.
        """
        if self.error is not None or self.kept is None:
            raise self.error or UsageError(f"no samples of flight {self.index} were kept")
        return self.kept


def seed_of(seed: int, index: int) -> int:
    """Seed of one of many flights: independent of all others, whatever their number.

    Parameters
    ----------
    index
        Place of the flight, from zero.

    Examples
    --------
    >>> seed_of(1, 0) == seed_of(1, 0), seed_of(1, 0) == seed_of(0, 1)
    (True, False)
    """
    words = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(2, np.uint64)
    return (int(words[0]) << 64) | int(words[1])


def whole(flight: SimulatedFlight) -> SimulatedFlight:
    """Keep everything. A minute at 400 Hz takes about 13 MB."""
    return flight


@dataclass(frozen=True)
class Columns(Immutable):
    """Keeps some channels. :func:`fly_batch` makes no more of a flight than these."""

    names: tuple[str, ...]

    def __call__(self, flight: SimulatedFlight | FlightTables) -> Mapping[str, FloatArray]:
        if missing := [name for name in self.names if name not in flight.columns]:
            raise UsageError(
                f"the flight has no column {', '.join(missing)}",
                needed=f"some of {', '.join(flight.columns)}",
            )
        return {name: read_only(flight.columns[name], np.float64, ndim=1) for name in self.names}


def columns(*names: str) -> Columns:
    """Keep some channels, as the autopilot had them; quicker than anything that takes the whole flight.

    Parameters
    ----------
    names
        Of the channels, such as ``p`` and ``roll_command``.

    Raises
    ------
    UsageError
        From what is returned: the flight has no such channel.
    """
    return Columns(names)


def fly_batch(
    sorties: Iterable[Sortie],
    keep: Callable[[SimulatedFlight], Kept],
    *,
    seed: int = 0,
    workers: int | None = None,
    step_rate_hz: float | None = None,
    settle_s: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> Iterator[Outcome[Kept]]:
    """Fly many times; outcomes come in the order of the flights, as soon as they are there.

    Flights are taken from ``sorties`` as they are flown and forgotten once ``keep`` has made of them what is wanted, so
    that thousands need no more memory than a few. The answer does not depend on the number of threads.

    Parameters
    ----------
    sorties
        What to fly, each as a value; may be a generator of any length.
    keep
        What to keep of a flight: :func:`whole`, :func:`columns`, or any function of it, which is called in the threads.
    seed
        Of all flights that have none of their own.
    workers
        Threads; as many as the machine has cores when none is given. The compiled part of a flight runs beside others,
        the rest does not.
    step_rate_hz, settle_s
        See :func:`fly_multirotor`.
    progress
        Called with the number of flights done, after each.

    Yields
    ------
    Outcome
        A flight that cannot be flown, or of which ``keep`` raises a
        :class:`~rotorid.errors.RotoridError`, is an outcome with its error; the others go on.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> from rotorid.simulation.autopilot import Autopilot, RateLoop
    >>> from rotorid.simulation.multirotor import Multirotor, Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> heavy = [Multirotor(name="demo", mass_kg=mass, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    ...          for mass in (1.0, 1.2)]
    >>> sorties = (Sortie(aircraft=Aircraft(vehicle=vehicle, autopilot=autopilot), duration_s=0.5) for vehicle in heavy)
    >>> found = fly_batch(sorties, lambda flight: float(flight.columns["thrust_command"].mean()))
    >>> [round(outcome.result, 3) for outcome in found]
    [0.522, 0.572]
    """
    threads = max(1, workers or os.cpu_count() or 1)
    own_desk = threading.local()

    def desk() -> Desk:
        if not hasattr(own_desk, "desk"):
            own_desk.desk = Desk()
        held: Desk = own_desk.desk
        return held

    def flight(index: int, sortie: Sortie) -> Outcome[Kept]:
        own = seed_of(seed, index) if sortie.seed is None else sortie.seed
        try:
            tables = flight_tables(
                sortie.aircraft,
                sortie.plan,
                desk(),
                duration_s=sortie.duration_s,
                wind=sortie.wind,
                seed=own,
                step_rate_hz=step_rate_hz,
                settle_s=settle_s,
            )
            kept = cast("Kept", keep(tables)) if isinstance(keep, Columns) else keep(tables.flight())
            return Outcome(index=index, seed=own, kept=kept)
        except RotoridError as error:
            return Outcome(index=index, seed=own, error=error)

    with ThreadPoolExecutor(threads) as pool:
        coming = enumerate(sorties)
        started: deque[Future[Outcome[Kept]]] = deque()

        def start(count: int) -> None:
            started.extend(pool.submit(flight, index, sortie) for index, sortie in islice(coming, count))

        try:
            start(_WAITING * threads)
            while started:
                outcome = started.popleft().result()
                start(1)
                if progress is not None:
                    progress(outcome.index + 1)
                yield outcome
        finally:
            # Nobody may want the rest.
            for waiting in started:
                waiting.cancel()
