"""Climb gains of a fleet: vehicles that fly with mistuned climb loops, are identified, tuned, and judged exactly.

The vehicles and their air are those of :mod:`benchmarks.tuning_fleet`, with climb gains of PX4's and ArduPilot's
defaults times 0.4 to 1.8, ArduPilot's in the names of 4.6 and 4.7 by turns. Each sweeps the thrust from 0.5 to 40
rad/s, and ``tune`` sees this log. Figures are those of the simulator's exact plant. PX4's vehicles then hold their
height with the proposed gains in other gusts, and may not be lost; the simulator has no loop around the acceleration,
so ArduPilot's gains are judged by the exact plant alone.

Run ``python -m benchmarks.climb_fleet [VEHICLES [PROCESSES]] [--file FILE]``, 60 vehicles of each kind by default.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.outer_fleet import HELD_S, MOST_SATURATED, SHOWN, Row, main
from benchmarks.tuning_fleet import made
from rotorid import read
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying import PlanSettings, SimulateSettings, fly_run, plan_for, write_run
from rotorid.models import acceleration_loop
from rotorid.planning import aircraft_loop
from rotorid.proposing import AxisTuning, tune
from rotorid.simulation import Aircraft, LostError, Wind, changed, fly_multirotor
from rotorid.tuning import Gains, Judged, judged, quantities
from rotorid.typing import ComplexArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles import VehicleEntry

SWEPT_RAD_S = (0.5, 40.0)
USUAL: dict[str, dict[str, float]] = {
    "px4": {"MPC_Z_VEL_P_ACC": 4.0, "MPC_Z_VEL_I_ACC": 2.0, "MPC_Z_P": 1.0},
    "ardupilot": {"PSC_VELZ_P": 5.0, "PSC_POSZ_P": 1.0, "PSC_ACCZ_P": 0.5, "PSC_ACCZ_I": 1.0},
    "ardupilot 4.7": {"PSC_D_VEL_P": 5.0, "PSC_D_POS_P": 1.0, "PSC_D_ACC_P": 0.05, "PSC_D_ACC_I": 0.1},
}
FILTERS = {"PSC_VELZ_FLTE": 5.0, "PSC_ACCZ_FLTE": 20.0}
FILTERS_SINCE = {"PSC_D_VEL_FLTE": 5.0, "PSC_D_ACC_FLTE": 20.0}


def with_climb(craft: Aircraft, number: int, *, hard: bool) -> Aircraft:
    """The vehicle with mistuned climb gains among its parameters."""
    rng = np.random.default_rng([number, int(hard), 11])
    own, kind = craft.autopilot, craft.autopilot.kind
    new = kind != "px4" and number % 8 >= 4
    gains = {
        name: value * float(rng.uniform(0.4, 1.8)) for name, value in USUAL[f"{kind} 4.7" if new else kind].items()
    }
    rest = {"px4": {"EKF2_PREDICT_US": 1e6 / own.rate_hz}, "ardupilot": FILTERS_SINCE if new else FILTERS}[kind]
    return replace(craft, autopilot=replace(own, parameters={**own.parameters, **gains, **rest}))


def sweep(craft: Aircraft, air: Mapping[str, float], folder: Path, seed: int) -> Path:
    """The log of a sweep of the thrust."""
    wanted = PlanSettings(
        axes=("thrust",), shape="logarithmic_sweep", band_rad_s=SWEPT_RAD_S, duration_s=air["sweep_s"], seed=seed
    )
    entry = VehicleEntry(name=craft.name, summary="", source="", make=lambda: craft)
    wind = Wind(north_m_s=air["north"], turbulence_m_s=air["gusts"])
    choices = SimulateSettings(vehicle=entry, plan=plan_for(craft, wanted).plan, seed=seed, wind=wind)
    log = folder / f"thrust{'.ulg' if craft.autopilot.kind == 'px4' else '.BIN'}"
    write_run(log, fly_run(choices, 0), choices)
    return log


def exact_velocity(craft: Aircraft, omega_rad_s: FloatArray) -> ComplexArray:
    """Upward velocity by the throttle, of the simulator itself, shape ``(f,)``."""
    rotors = craft.vehicle.rotors
    if rotors.lag_down_s and rotors.lag_down_s != rotors.lag_up_s:
        apart = (rotors.lag_up_s - rotors.lag_down_s) / (rotors.lag_up_s + rotors.lag_down_s)
        lag = rotors.mean_lag_s * (1.0 - (1.0 - 8.0 / np.pi**2) * apart**2)
        craft = changed(craft, {"T_motor": lag, "T_motor_down": lag})
    loop = aircraft_loop(craft)
    row, column = loop.outputs.index("w"), loop.inputs.index("thrust_command")
    return np.asarray(-loop.plant.response(omega_rad_s)[row, column])


def hover_thrust(craft: Aircraft) -> float:
    """The throttle at which it hovers."""
    return float(craft.autopilot.hover_commands(craft.vehicle)[-1])


def exact(craft: Aircraft, climb: AxisTuning, gains: Gains) -> Judged:
    """The climb loops on the exact plant."""
    omega = climb.omega_rad_s
    plant = exact_velocity(craft, omega)
    inner = acceleration_loop(craft.autopilot.parameters)
    scaled = plant * hover_thrust(craft) / STANDARD_GRAVITY_M_S2
    plant = scaled if inner is None else inner.closed(plant, omega)
    return judged(climb.parts, plant[None], gains, from_rad_s=climb.plant.known_from_rad_s)


def holds(craft: Aircraft, gains: Gains, air: Mapping[str, float], seed: int) -> bool:
    """Whether a vehicle of PX4 holds its height with some gains in gusts, without motors at their limits."""
    own = craft.autopilot
    if own.kind != "px4":
        return True
    share = hover_thrust(craft) / STANDARD_GRAVITY_M_S2
    hold = replace(
        own.guidance,
        hold_height=True,
        stick_climb_m_s=3.0,
        climb_p=share * gains.P,
        climb_i=share * gains.I,
        height_p_1_s=gains.A,
    )
    flown = replace(craft, autopilot=replace(own, guidance=hold))
    wind = Wind(north_m_s=0.0, turbulence_m_s=air["gusts"])
    try:
        return fly_multirotor(flown, duration_s=HELD_S, seed=seed, wind=wind).saturated < MOST_SATURATED
    except LostError:
        return False


def one(task: tuple[int, bool]) -> Row:
    """One vehicle: sweep, proposal, exact figures, second flight."""
    number, hard = task
    craft, _, air = made(number, hard=hard)
    air["sweep_s"] = 30.0 if hard else 45.0
    craft = with_climb(craft, number, hard=hard)
    row = Row(vehicle=craft.name, hard=hard)
    with tempfile.TemporaryDirectory() as place:
        try:
            found = tune(records=read(sweep(craft, air, Path(place), 10 + number)), axes=("climb",))
        except (InsufficientDataError, UsageError) as error:
            own = next((one.message for one in getattr(error, "findings", ()) if one.where == "climb"), "")
            row.refused = own or str(error)
            return row
    climb = found.axes["climb"]
    proposed = climb.proposal.proposed
    row.changed = climb.proposal.changed
    before, after = (exact(craft, climb, gains) for gains in (climb.proposal.flown.gains, proposed.gains))
    row.stable = bool(after.rate.stable[0] and after.whole.stable[0])
    row.peak, row.before = (
        float(max(one.rate.sensitivity_peak[0], one.whole.sensitivity_peak[0])) for one in (after, before)
    )
    row.better = float(after.attitude_rms[0] / before.attitude_rms[0])
    for loop, said, true in (("rate", proposed.rate, after.rate), ("whole", proposed.whole, after.whole)):
        predicted, truth = quantities(said), quantities(true)
        for name in SHOWN:
            if name in predicted and name in truth:
                row.inside[f"{loop} {name}"] = predicted[name].lower <= truth[name].value <= predicted[name].upper
    row.stable = row.stable and holds(craft, proposed.gains, air, 500 + number)
    return row


if __name__ == "__main__":
    main(one, "climb")
