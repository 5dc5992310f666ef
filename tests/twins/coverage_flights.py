"""Flights for the study of intervals: weathers, logs that are flown once and kept, and what is true of each flight.

True is the exact linearization in hover and still air. Four things are moved to what a flight shows of them:

- ``Z_thrust`` of rotors whose thrust is quadratic in what is commanded: the slope at the mean command of the sweep;
- ``T_motor`` of rotors that speed up and slow down differently: fast motion shows a lag below the mean of the two;
- derivatives of vehicles whose rotors drag or whose thrust falls with inflow, in wind: those of level flight at the
  mean velocity through the air during the sweep, since couplings that are zero in hover are none there;
- where nothing is true in hover, the slope as flown: the exact force of the air, by the simulator's true velocity
  through it, regressed on that velocity during the sweep. These are the speed derivatives of ``ardupilot_quad``, whose
  drag is quadratic, and the damping of the rate models of the S500, which leave out what else turns it.
"""

from __future__ import annotations

import json
import lzma
import math
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from tests.twins.motor_twins import truth_of as truth_of_motors
from tests.twins.motor_twins import write_layout

import rotorid
from rotorid.data.flight_plan import FlightPlan, SimulatedFlight
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.flying.designs import plan_for, sweep_of
from rotorid.flying.settings import PlanSettings, SimulateSettings
from rotorid.flying.simulation import fly_run, truth_of, write_run
from rotorid.planning.amplitude import Limits
from rotorid.settings.motors import MotorSettings
from rotorid.simulation.linearization import FORCES_AND_MOMENTS, hover_derivatives_of
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.simulation.wind import Wind
from rotorid.typing import BoolArray, FloatArray

DEV_WEATHERS: Mapping[str, Wind] = MappingProxyType(
    {
        "calm": Wind(),
        "tail2": Wind(north_m_s=2.0, turbulence_m_s=0.7),
        "side3": Wind(east_m_s=3.0, turbulence_m_s=0.5),
        "gusts1": Wind(turbulence_m_s=1.0),
        "head4": Wind(north_m_s=-3.2, east_m_s=-2.4, turbulence_m_s=0.8),
        "tail6": Wind(north_m_s=5.0, east_m_s=3.3, turbulence_m_s=1.0),
    }
)
FINAL_WEATHERS: Mapping[str, Wind] = MappingProxyType(
    {
        "calm": Wind(),
        "head1.5": Wind(north_m_s=-1.1, east_m_s=-1.0, turbulence_m_s=0.4),
        "side2.6": Wind(east_m_s=-2.6, turbulence_m_s=0.9),
        "head3.8": Wind(north_m_s=-2.7, east_m_s=2.7, turbulence_m_s=0.3),
        "gusts1.3": Wind(north_m_s=0.5, turbulence_m_s=1.3),
        "side6": Wind(north_m_s=1.9, east_m_s=-5.7, turbulence_m_s=1.2),
    }
)
WEATHERS: Mapping[str, Wind] = MappingProxyType({**DEV_WEATHERS, **FINAL_WEATHERS})
DEV_SEEDS, FINAL_SEEDS = (101, 102, 103), (201,)
"""Seeds for work on the methods, and seeds that nobody looks at before the work is done."""
S500_SPEED, S500_GUSTS = 0.25, 0.15
"""Share of a wind in which the linear S500 flies: M_w u turns it over in more, with no test input at all."""
ROOM_M, HEIGHT_M, TILT_RAD = 60.0, 5.0, math.radians(25.0)
WIDER = (1.0, 1.6, 2.4)
"""Factors on the limits of tilt and height, tried in turn: a vehicle may lean by 25 degrees without a test input."""
BEHIND_SETPOINTS = "bebop"
"""Its log has set-points, attitudes, velocities at 20 Hz: what is true of it is the linear drag of its body."""
BINARY = PlanSettings(
    shape="random_binary",
    entry="attitude_setpoint",
    axes=("roll", "pitch"),
    duration_s=40.0,
    band_rad_s=(0.5, 6.0),
)
QUADRATIC_THRUST = ("crazyflie", "hummingbird", "iris", "x500")
STILL_M_S = 0.3
NOTICED = 1e-6
COLUMNS = {"roll": ("v", "p", "roll"), "pitch": ("u", "q", "pitch"), "yaw": ("r", "yaw"), "thrust": ("w", "thrust")}
"""Columns of derivatives that the sweep of an axis shows."""
SLOPES_OF_DRAG = {"X_u": ("pitch", 0), "Y_v": ("roll", 1), "Z_w": ("thrust", 2)}
DAMPING = {"L_p": ("roll", 3), "M_q": ("pitch", 4), "N_r": ("yaw", 5), "Z_w": ("thrust", 2)}


class KeptFlight(NamedTuple):
    """A flight of the folder: its log, what its owner knows, and what is true of it.

    Parameters
    ----------
    record
        The log as its autopilot would have written it.
    choices
        Mass and rotors, for ``physical.motors``.
    truth
        Parameter to its value in this flight.
    motors
        The same for ``physical.motors``.
    rate_damping
        As flown, for one-axis rate models of a vehicle that more than one axis turns.
    moved
        Value of this flight over that of hover in still air, for the numbers that are moved.
    """

    record: FlightRecord
    choices: MotorSettings
    truth: Mapping[str, float]
    motors: Mapping[str, float]
    rate_damping: Mapping[str, float]
    moved: Mapping[str, float]


def wind_of(vehicle: str, weather: str) -> Wind:
    """The wind of a name, or of ``NORTH/EAST/GUSTS`` in m/s.

    Examples
    --------
    >>> wind_of("iris", "side3") == wind_of("iris", "0/3/0.5")
    True
    """
    if weather in WEATHERS:
        wind = WEATHERS[weather]
    else:
        north, east, gusts = (float(part) for part in weather.split("/"))
        wind = Wind(north_m_s=north, east_m_s=east, turbulence_m_s=gusts)
    if vehicle != "s500":
        return wind
    return replace(
        wind,
        north_m_s=S500_SPEED * wind.north_m_s,
        east_m_s=S500_SPEED * wind.east_m_s,
        turbulence_m_s=S500_GUSTS * wind.turbulence_m_s,
    )


@lru_cache
def plan_of(vehicle: str, weather: str) -> FlightPlan:
    """Test inputs as large as the wind leaves room for; where it leaves none, with wider limits, as the error says."""
    craft = SimulateSettings(vehicle=vehicle).aircraft
    choices = replace(
        BINARY
        if vehicle == BEHIND_SETPOINTS
        else PlanSettings(
            shape=sweep_of(craft), entry="stick" if craft.autopilot.kind == "px4" else None, duration_s=30.0
        ),
        wind=wind_of(vehicle, weather),
    )
    for wider in WIDER:
        limits = Limits(tilt_rad=wider * TILT_RAD, position_m=ROOM_M, height_m=wider * HEIGHT_M)
        try:
            return plan_for(craft, replace(choices, limits=limits)).plan
        except UsageError:
            if wider == WIDER[-1]:
                raise
    raise AssertionError("unreachable")


def fly(folder: Path, vehicle: str, weather: str, seed: int) -> Path:
    """Fly once and keep the log, compressed, and beside it what is true: returns where the truth is kept."""
    kept = folder / f"{vehicle}-{weather.replace('/', '_')}-{seed}.json"
    if kept.exists():
        return kept
    folder.mkdir(parents=True, exist_ok=True)
    options = SimulateSettings(
        vehicle=vehicle, wind=wind_of(vehicle, weather), seed=seed, plan=plan_of(vehicle, weather)
    )
    run = fly_run(options, 0)
    ending = options.file_names[0].rpartition(".")[2]
    log = kept.with_suffix(f".{ending}.xz")
    with tempfile.TemporaryDirectory() as scratch:
        plain = Path(scratch) / f"flight.{ending}"
        write_run(plain, run, options)
        log.write_bytes(lzma.compress(plain.read_bytes(), preset=0))
        record = rotorid.read(plain)
    craft = options.aircraft
    exact = {name: true.value for name, true in truth_of(craft).items()}
    truth = flown_truth(vehicle, record)
    in_wind = derivatives_as_flown(craft, run.flown)
    truth |= {name: value + truth[name] - exact[name] for name, value in in_wind.items() if name in truth}
    motors = {} if vehicle == BEHIND_SETPOINTS else truth_of_motors(craft)
    motors |= {name: in_wind[name] for name in in_wind.keys() & motors.keys()}
    if vehicle == "ardupilot_quad":
        drag = slopes_as_flown(craft, run.flown, SLOPES_OF_DRAG)
        truth |= drag
        motors["Z_w"] = drag["Z_w"]
    found = {
        "log": log.name,
        "exact": exact,
        "truth": truth,
        "motors": motors,
        "rate_damping": slopes_as_flown(craft, run.flown, DAMPING) if vehicle == "s500" else {},
    }
    part = kept.with_suffix(".part")
    part.write_text(json.dumps(found, indent=1), encoding="utf-8")
    part.replace(kept)
    return kept


def read_flight(kept: Path, vehicle: str) -> KeptFlight:
    """A flight that :func:`fly` kept."""
    found = json.loads(kept.read_text(encoding="utf-8"))
    craft = SimulateSettings(vehicle=vehicle).aircraft
    known = MotorSettings(
        known={"m": craft.vehicle.mass_kg}, layout=write_layout(craft.vehicle.rotors.layout, craft, kept.parent)
    )
    exact, truth = found["exact"], found["truth"]
    moved = {name: truth[name] / value for name, value in exact.items() if value and truth[name] != value}
    return KeptFlight(
        record=rotorid.read(kept.parent / found["log"]),
        choices=known,
        truth=truth,
        motors=found["motors"],
        rate_damping=found["rate_damping"],
        moved=moved,
    )


def flown_truth(vehicle: str, record: FlightRecord) -> dict[str, float]:
    """What one flight shows of its vehicle: hover in still air, but for the thrust slope and the lag of the rotors."""
    craft = SimulateSettings(vehicle=vehicle).aircraft
    truth = {name: true.value for name, true in truth_of(craft).items()}
    rotors = craft.vehicle.rotors
    if rotors.lag_down_s and rotors.lag_down_s != rotors.lag_up_s:
        apart = (rotors.lag_up_s - rotors.lag_down_s) / (rotors.lag_up_s + rotors.lag_down_s)
        truth["T_motor"] *= 1.0 - (1.0 - 8.0 / np.pi**2) * apart**2
    if vehicle in QUADRATIC_THRUST:
        thrust = record["thrust_command"]
        sweep = rotorid.find_excitations(record, "thrust")[0]
        inside = (thrust.time_s >= sweep.start_s) & (thrust.time_s <= sweep.stop_s)
        before = (thrust.time_s >= sweep.start_s - 2.0) & (thrust.time_s < sweep.start_s)
        truth["Z_thrust"] *= float(np.mean(thrust.values[inside]) / np.mean(thrust.values[before]))
    if vehicle == BEHIND_SETPOINTS:
        truth |= {"k_Dx": -truth["X_u"], "k_Dy": -truth["Y_v"]}
    return truth


def derivatives_as_flown(craft: Aircraft, flown: SimulatedFlight) -> dict[str, float]:
    """Exact derivatives of level flight at the mean velocity through the air in the sweep that shows their column.

    None below :data:`STILL_M_S`, and none of a vehicle of which forces in the air are linear: they are those of hover.
    """
    rotors = craft.vehicle.rotors
    if not (rotors.induced_drag_n_s_m or rotors.inflow_n_s_m):
        return {}
    found: dict[str, float] = {}
    for axis, columns in COLUMNS.items():
        inside = during(flown, axis)
        true = flown.truth
        north, east = (
            float(np.mean((true[f"velocity_{way}"] - true[f"wind_{way}"])[inside])) for way in ("north", "east")
        )
        speed, heading = math.hypot(north, east), math.atan2(east, north) - float(np.mean(true["psi"][inside]))
        if speed >= STILL_M_S:
            derivatives = derivatives_aside(craft, speed, heading)
            found |= {name: value for name, value in derivatives.items() if name.partition("_")[2] in columns}
    return found


def derivatives_aside(craft: Aircraft, airspeed_m_s: float, course_rad: float) -> dict[str, float]:
    """Derivatives in level flight to any side: those of the vehicle turned into the flight, turned back."""
    vehicle, rotors = craft.vehicle, craft.vehicle.rotors
    sine, cosine = math.sin(course_rad), math.cos(course_rad)
    ahead = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    both = np.kron(np.eye(2), ahead)
    assert vehicle.aerodynamics is not None
    turned = replace(
        vehicle,
        inertia_kg_m2=ahead @ vehicle.inertia_kg_m2 @ ahead.T,
        rotors=replace(rotors, layout=replace(rotors.layout, positions=(ahead @ rotors.layout.positions.T).T)),
        aerodynamics=both @ vehicle.aerodynamics @ both.T,
        center_of_gravity_m=tuple(ahead @ np.array(vehicle.center_of_gravity_m)),
    )
    autopilot = replace(craft.autopilot, mixer=craft.autopilot.mixer_for(vehicle))
    found = hover_derivatives_of(turned, autopilot, airspeed_m_s=airspeed_m_s)
    motion, inputs = ("u", "v", "w", "p", "q", "r"), ("roll", "pitch", "yaw", "thrust")
    stability = both.T @ [[found[f"{row}_{column}"] for column in motion] for row in FORCES_AND_MOMENTS] @ both
    control = both.T @ [[found[f"{row}_{column}"] for column in inputs] for row in FORCES_AND_MOMENTS]
    return {
        f"{row}_{column}": float(value) if abs(value) > NOTICED else 0.0
        for row, values in zip(FORCES_AND_MOMENTS, np.hstack([stability, control]), strict=True)
        for column, value in zip((*motion, *inputs), values, strict=True)
    }


def during(flown: SimulatedFlight, axis: str) -> BoolArray:
    """Samples in the sweeps of an axis."""
    inside = np.zeros(flown.samples, dtype=bool)
    for maneuver in flown.maneuvers:
        if maneuver.axis == axis:
            inside |= (flown.time_s >= maneuver.start_s) & (flown.time_s <= maneuver.stop_s)
    return inside


def slopes_as_flown(craft: Aircraft, flown: SimulatedFlight, wanted: Mapping[str, tuple[str, int]]) -> dict[str, float]:
    """Slopes of the air's force and moment by the vehicle's own true motion, during the sweeps of an axis.

    Least squares of one on the other, per mass or inertia, each less its mean: what a model with this one derivative
    can know of the air.
    """
    motion, pushed = motion_through_air(flown), air_of(craft, flown)
    slopes = {}
    for name, (axis, row) in wanted.items():
        inside = during(flown, axis)
        moved = motion[row, inside] - motion[row, inside].mean()
        slopes[name] = float(moved @ pushed[row, inside] / (moved @ moved))
    return slopes


def motion_through_air(flown: SimulatedFlight) -> FloatArray:
    """True u, v, w through the air in body axes and p, q, r, shape ``(6, samples)``."""
    true = flown.truth
    north, east, down = (true[f"velocity_{way}"] - true[f"wind_{way}"] for way in ("north", "east", "down"))
    (sf, st, sp), (cf, ct, cp) = (
        [function(true[name]) for name in ("phi", "theta", "psi")] for function in (np.sin, np.cos)
    )
    u = ct * cp * north + ct * sp * east - st * down
    v = (sf * st * cp - cf * sp) * north + (sf * st * sp + cf * cp) * east + sf * ct * down
    w = (cf * st * cp + sf * sp) * north + (cf * st * sp - sf * cp) * east + cf * ct * down
    return np.stack([u, v, w, true["p"], true["q"], true["r"]])


def air_of(craft: Aircraft, flown: SimulatedFlight) -> FloatArray:
    """Force per mass and moment per inertia of the body in the air, shape ``(6, samples)``; that of rotors is no part.

    The vehicles of which slopes as flown are taken have no drag of rotors.
    """
    vehicle, motion = craft.vehicle, motion_through_air(flown)
    assert vehicle.aerodynamics is not None
    wrench = vehicle.aerodynamics @ motion
    drag = np.array(vehicle.quadratic_drag_n_s2_m2)[:, None]
    wrench[:3] -= drag * motion[:3] * np.abs(motion[:3])
    return np.vstack([wrench[:3] / vehicle.mass_kg, np.linalg.solve(vehicle.inertia_kg_m2, wrench[3:])])
