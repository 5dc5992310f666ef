"""Flights for the study of intervals: weathers, logs that are flown once and kept, and what is true of each flight.

True is the exact linearization about hover in the mean wind of the sweeps. Three numbers are moved to what a flight
shows of them:

- ``Z_thrust`` of rotors whose thrust is quadratic in what is commanded: the slope at the mean command of the sweep;
- ``T_motor`` of rotors that speed up and slow down differently: fast motion shows a lag below the mean of the two;
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
from rotorid.flying.designs import plan_for, sweep_of
from rotorid.flying.settings import PlanSettings, SimulateSettings
from rotorid.flying.simulation import fly_run, truth_of, write_run
from rotorid.planning.amplitude import Limits
from rotorid.settings.motors import MotorSettings
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray

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
DEV_SEEDS, FINAL_SEEDS = (101, 102, 103), (201, 202, 203)
"""Seeds for work on the methods, and seeds that nobody looks at before the work is done."""
S500_SPEED, S500_GUSTS = 0.25, 0.15
"""Share of a wind in which the linear S500 flies: M_w u turns it over in more, with no test input at all."""
ROOM_M = 60.0
LEANING_DEG: Mapping[str, float] = MappingProxyType({"px4_quad": 40.0})
"""Tilt limit in wind of a vehicle that leans by 25 degrees without a test input; 25 degrees elsewhere."""
BEHIND_SETPOINTS = "bebop"
"""Its log has set-points, attitudes, velocities at 20 Hz: what is true of it is the linear drag of its body."""
BINARY = PlanSettings(
    shape="random_binary",
    entry="attitude_setpoint",
    axes=("roll", "pitch"),
    duration_s=40.0,
    band_rad_s=(0.5, 6.0),
    limits=Limits(tilt_rad=0.4, position_m=ROOM_M),
)
QUADRATIC_THRUST = ("crazyflie", "hummingbird", "iris", "x500")
SMALLEST = 0.01
"""A slope that wind alone makes counts as zero below it, in SI units of a derivative."""
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
    """Sweeps on all axes, as large as the wind leaves room for."""
    craft, wind = SimulateSettings(vehicle=vehicle).aircraft, wind_of(vehicle, weather)
    if vehicle == BEHIND_SETPOINTS:
        return plan_for(craft, replace(BINARY, wind=wind)).plan
    tilt_deg = LEANING_DEG.get(vehicle, 25.0) if wind.speed_m_s > 2.5 else 25.0
    choices = PlanSettings(
        shape=sweep_of(craft),
        entry="stick" if craft.autopilot.kind == "px4" else None,
        wind=wind,
        duration_s=30.0,
        limits=Limits(tilt_rad=math.radians(tilt_deg), position_m=ROOM_M),
    )
    return plan_for(craft, choices).plan


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
    truth = flown_truth(vehicle, record, run.flown)
    motors = {} if vehicle == BEHIND_SETPOINTS else truth_of_motors(craft)
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


def flown_truth(vehicle: str, record: FlightRecord, flown: SimulatedFlight | None = None) -> dict[str, float]:
    """What one flight shows of its vehicle: hover in the mean wind of its sweeps, with the slope of thrust as flown.

    Parameters
    ----------
    flown
        What truly happened; still air without.
    """
    craft = SimulateSettings(vehicle=vehicle).aircraft
    truth = {name: true.value for name, true in truth_of(craft).items()}
    if flown is not None:
        ahead, aside = steady_airspeed(flown)
        in_wind = hover_derivatives_of(craft.vehicle, craft.autopilot, airspeed_m_s=ahead, aside_m_s=aside)
        # Rotors that drag turn and push by their own speeds in a wind: N_roll, X_thrust, L_yaw are no zeros there.
        truth |= {n: value for n, value in in_wind.items() if n in truth and (truth[n] or abs(value) > SMALLEST)}
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


def steady_airspeed(flown: SimulatedFlight) -> tuple[float, float]:
    """Mean velocity through the air over all sweeps, level: along the heading and to its right, m/s."""
    true = flown.truth
    north, east = (true[f"velocity_{way}"] - true[f"wind_{way}"] for way in ("north", "east"))
    cosine, sine = np.cos(true["psi"]), np.sin(true["psi"])
    inside = np.zeros(flown.samples, dtype=bool)
    for maneuver in flown.maneuvers:
        inside |= (flown.time_s >= maneuver.start_s) & (flown.time_s <= maneuver.stop_s)
    ahead, aside = cosine * north + sine * east, cosine * east - sine * north
    return float(ahead[inside].mean()), float(aside[inside].mean())


def slopes_as_flown(craft: Aircraft, flown: SimulatedFlight, wanted: Mapping[str, tuple[str, int]]) -> dict[str, float]:
    """Slopes of the air's force and moment by the vehicle's own true motion, during the sweeps of an axis.

    Least squares of one on the other, per mass or inertia, each less its mean: what a model with this one derivative
    can know of the air.
    """
    motion, pushed = motion_through_air(flown), air_of(craft, flown)
    slopes = {}
    for name, (axis, row) in wanted.items():
        inside = np.zeros(flown.samples, dtype=bool)
        for maneuver in flown.maneuvers:
            if maneuver.axis == axis:
                inside |= (flown.time_s >= maneuver.start_s) & (flown.time_s <= maneuver.stop_s)
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
