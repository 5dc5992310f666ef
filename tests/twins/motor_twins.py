"""Flights of vehicles of the library under their autopilots, and what is true of their motors as they flew."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import rotorid
from rotorid.data.flight_plan import FlightPlan
from rotorid.data.record import FlightRecord
from rotorid.flying.designs import plan_for, sweep_of
from rotorid.flying.settings import PlanSettings, SimulateSettings
from rotorid.flying.simulation import fly_run, write_run
from rotorid.models.rotors import RotorLayout
from rotorid.models.thrust_curve import ExpoCurve
from rotorid.planning.amplitude import Limits
from rotorid.settings.motors import MotorSettings
from rotorid.simulation.linearization import MOTION, hover_derivatives_of, linearize, rotor_slopes
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.simulation.wind import Wind
from rotorid.vehicles.ardupilot import LARGEST_THRUST_N, THRUST_PER_DEMAND_N

VEHICLES = ("px4_quad", "ardupilot_quad", "x500", "iris", "s500", "crazyflie", "hummingbird")
CALM = Wind()
WINDS: Mapping[str, Wind] = {"calm": CALM, "wind": Wind(north_m_s=2.0, turbulence_m_s=0.7)}
GENTLE = Wind(north_m_s=0.5, turbulence_m_s=0.1)
"""The linear S500 leaves its limits in more, with no test input at all."""


class Twin(NamedTuple):
    """A flight and what is true of it.

    Parameters
    ----------
    record
        The log as its autopilot would have written it.
    choices
        What its owner knows: mass, and the rotors where the log does not tell them.
    truth
        Parameter, or derived number, to its true value, slopes as flown at hover.
    step_s
        Time between samples of the motors.
    """

    record: FlightRecord
    choices: MotorSettings
    truth: Mapping[str, float]
    step_s: float


def twin(vehicle: str, weather: str, seed: int, folder: Path, *, sweep_s: float = 30.0) -> Twin:
    """One flight of sweeps on all axes, written and read as a user would."""
    wind = GENTLE if (vehicle, weather) == ("s500", "wind") else WINDS[weather]
    options = SimulateSettings(vehicle=vehicle, wind=wind, seed=seed, plan=_plan(vehicle, wind, sweep_s))
    path = folder / f"{vehicle}-{weather}-{seed}.{options.file_names[0].rpartition('.')[2]}"
    run = fly_run(options, 0)
    write_run(path, run, options)
    craft = options.aircraft
    rotors = craft.vehicle.rotors.layout
    known = MotorSettings(known={"m": craft.vehicle.mass_kg}, layout=write_layout(rotors, craft, folder))
    return Twin(rotorid.read(path), known, truth_of(craft), 1.0 / craft.autopilot.rate_hz)


@lru_cache
def _plan(vehicle: str, wind: Wind, sweep_s: float) -> FlightPlan:
    craft = SimulateSettings(vehicle=vehicle).aircraft
    choices = PlanSettings(
        shape=sweep_of(craft),
        entry="stick" if craft.autopilot.kind == "px4" else None,
        wind=wind,
        duration_s=sweep_s,
        # The linear S500 drifts further than others in any wind.
        limits=Limits(position_m=60.0) if vehicle == "s500" else Limits(),
    )
    return plan_for(craft, choices).plan


def write_layout(layout: RotorLayout, craft: Aircraft, folder: Path) -> str:
    """The rotors about the center of gravity, as a file that a user measured."""
    path = folder / f"{craft.vehicle.name}.toml"
    rows = [
        f'[[rotor]]\nposition_m = {np.round(place, 9).tolist()}\nspin = "{"ccw" if spin > 0 else "cw"}"'
        for place, spin in zip(craft.vehicle.hubs_m, layout.spins, strict=True)
    ]
    path.write_text("\n".join(rows), encoding="utf-8")
    return str(path)


def truth_of(craft: Aircraft) -> dict[str, float]:
    """Slopes about hover, in terms of what is logged of the motors.

    Thrust of a rotor is what lifts; an inertia is what that thrust at the lever of the layout makes of it.
    """
    vehicle, autopilot = craft.vehicle, craft.autopilot
    system = linearize(vehicle, autopilot)
    derivatives = hover_derivatives_of(vehicle, autopilot)
    rows = {name: MOTION.index(name) for name in ("w", "p", "q", "r")}
    # A rotor that turns steadily: what its acceleration does to the vehicle is in the slope by the output.
    spread = np.linalg.pinv(rotor_slopes(vehicle, autopilot, vehicle.hover_shares))
    per_share = system.F[: len(MOTION), len(MOTION) :] + system.G[: len(MOTION)] @ spread
    # Logged is the demand where the autopilot straightens the curve, else the speed that is asked for.
    slope = 1.0
    if autopilot.kind in ("px4", "ardupilot"):
        line = autopilot.linearization
        curve = ExpoCurve(expo=line.expo, low=line.low, high=line.high)
        slope = 1.0 / float(curve.slope(vehicle.hover_shares)[0])
    if vehicle.name == "ardupilot_quad":
        # Its log has the demand before what compensates voltage and density scales it.
        slope *= THRUST_PER_DEMAND_N / LARGEST_THRUST_N
    levers = np.stack([-vehicle.hubs_m[:, 1], vehicle.hubs_m[:, 0], vehicle.rotors.layout.spins])
    thrust = float(np.mean(-vehicle.mass_kg * per_share[rows["w"]])) * slope
    turned = {
        axis: float(lever @ per_share[rows[axis]] / (lever @ lever)) * slope
        for axis, lever in zip("pqr", levers, strict=True)
    }
    rotors = vehicle.rotors
    truth = {
        "thrust_slope": thrust,
        "I_xx": thrust / turned["p"],
        "I_yy": thrust / turned["q"],
        "kappa_per_I_zz": turned["r"] / thrust,
        "L_p": derivatives["L_p"],
        "M_q": derivatives["M_q"],
        "N_r": derivatives["N_r"],
        "Z_w": derivatives["Z_w"],
    }
    momentum = rotors.inertia_kg_m2 * rotors.full_speed_rad_s
    truth["h_per_I_zz"] = momentum / float(vehicle.inertia_kg_m2[2, 2]) * slope
    if vehicle.name != "crazyflie":
        # Filters of which its log says nothing are late too.
        truth |= {"tau_gyro": autopilot.delay_s[0], "tau_accel": autopilot.delay_s[3]}
        truth |= {"tau_gyro_yaw": autopilot.delay_s[2]}
    if rotors.lag_up_s:
        up_s, down_s = rotors.lag_up_s, rotors.lag_down_s or rotors.lag_up_s
        mean_s, apart = 0.5 * (up_s + down_s), (up_s - down_s) / (up_s + down_s)
        # Fast motion sees a rotor that is quicker one way than the other with a shorter lag than the mean.
        truth["T_motor"] = mean_s * (1.0 - (1.0 - 8.0 / np.pi**2) * apart**2)
    return truth
