"""Outer gains of a fleet: vehicles that fly with mistuned velocity loops, are identified, tuned, and judged exactly.

The vehicles, their rate gains and their air are those of :mod:`benchmarks.tuning_fleet`, holding velocity and position
with gains of PX4's and ArduPilot's defaults times 0.4 to 1.8. Each sweeps roll and pitch to 120 rad/s, and ``tune``
sees these two logs: attitude loops come from the sweeps, drag from both flights. It proposes gains of all three at
once. Figures of the velocity and position loops are those of the simulator's exact plant with the proposed gains in
*all* loops; a second flight holds its place in other gusts, and may not be lost.

Run ``python -m benchmarks.outer_fleet [VEHICLES [PROCESSES]] [--file FILE]``, 60 vehicles of each kind by default. FILE
keeps the results of each vehicle, so that a second run goes on where the first ended.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kept import Task, run_tasks
from benchmarks.tuning_fleet import MOST_PEAK, NAMES, SWEEPS, fly, made, share, spread
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models import RateController
from rotorid.planning import aircraft_loop, rate_filters
from rotorid.proposing import AxisTuning, tune
from rotorid.simulation import Aircraft, LostError, Wind, changed, fly_multirotor
from rotorid.tuning import ControllerParts, Gains, Judged, judged, quantities
from rotorid.typing import Axis, ComplexArray, FloatArray, LoopName
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles import with_gains
from rotorid.vehicles.px4 import PX4_PARAMETERS, hover_guidance

TILT: dict[Axis, tuple[str, str, str, float]] = {"roll": ("p", "phi", "v", 1.0), "pitch": ("q", "theta", "u", -1.0)}
PITCH = {"RLL": "PIT", "ROLL": "PITCH"}
SHOWN = ("crossover_rad_s", "phase_margin_deg", "sensitivity_peak")
HELD_S, MOST_SATURATED = 40.0, 0.02

OUTER: dict[str, tuple[str, ...]] = {
    "px4": ("MPC_XY_VEL_P_ACC", "MPC_XY_VEL_I_ACC", "MPC_XY_P"),
    "ardupilot": ("PSC_VELXY_P", "PSC_VELXY_I", "PSC_POSXY_P"),
    "ardupilot 4.7": ("PSC_NE_VEL_P", "PSC_NE_VEL_I", "PSC_NE_POS_P"),
}
USUAL: dict[str, tuple[float, ...]] = {"px4": (1.8, 0.4, 0.95), "ardupilot": (2.0, 1.0, 1.0)}


@dataclass
class Row:
    """What became of the velocity loop of one vehicle, by the exact plant."""

    vehicle: str
    hard: bool
    refused: str = ""
    changed: bool = False
    stable: bool = True
    peak: float = np.nan
    before: float = np.nan
    better: float = np.nan
    inside: dict[str, bool] = field(default_factory=dict)


def holding(craft: Aircraft, gains: dict[str, float]) -> Aircraft:
    """The vehicle with a hold of velocity, position and height, and the parameters of these loops."""
    own = craft.autopilot
    P, I, A = gains.values()  # noqa: E741 - as everybody calls it
    parameters = {**own.parameters, **gains}
    if own.kind == "px4":
        # The simulated position controller steps with all others.
        parameters |= {"EKF2_PREDICT_US": 1e6 / own.rate_hz, "MPC_XY_VEL_D_ACC": 0.0, "MPC_VELD_LP": 0.0}
    hover = hover_guidance({**PX4_PARAMETERS, **own.parameters})
    hold = replace(hover, velocity_p_1_s=P, velocity_i_1_s2=I, position_p_1_s=A)
    return replace(craft, autopilot=replace(own, parameters=parameters, guidance=hold))


def outer_gains(craft: Aircraft, number: int, *, hard: bool) -> dict[str, float]:
    """Mistuned gains, by the names of a generation of the firmware."""
    rng = np.random.default_rng([number, int(hard), 7])
    kind = craft.autopilot.kind
    names = OUTER[kind if kind == "px4" or number % 8 < 4 else f"{kind} 4.7"]
    return {name: float(one * rng.uniform(0.4, 1.8)) for name, one in zip(names, USUAL[kind], strict=True)}


def one(task: tuple[int, bool]) -> Row:
    """One vehicle: sweeps, proposal, exact figures, second flight."""
    number, hard = task
    craft, inner, air = made(number, hard=hard)
    air["sweep_s"] = 30.0 if hard else 45.0
    row = Row(vehicle=craft.name, hard=hard)
    craft = holding(craft, outer_gains(craft, number, hard=hard))
    rates = inner["roll"] | {
        name.replace(old, new): value
        for name, value in inner["roll"].items()
        for old, new in PITCH.items()
        if old in name
    }
    with tempfile.TemporaryDirectory() as place:
        try:
            logs = [
                fly(craft, rates, axis, air, Path(place), 10 + number, band_rad_s=SWEEPS["roll"])[0] for axis in TILT
            ]
            found = tune(records=logs, axes=("roll", "pitch", "velocity"))
        except InsufficientDataError as error:
            row.refused = next((one.kind for one in error.findings if one.severity == "error"), str(error))
            return row
        except UsageError:
            row.refused = "cannot hover with its gains"
            return row
    if "velocity" not in found.axes:
        row.refused = next((one.message for one in found.findings if one.where == "velocity"), "other")
        return row
    velocity = found.axes["velocity"]
    row.changed = velocity.proposal.changed
    flown = with_gains(craft, rates, source="the fleet")
    figures = {
        axis: exact(flown, axis, found.axes.get(axis), velocity, velocity.proposal.proposed.gains) for axis in TILT
    }
    # The axis with less reserve is the one that tune speaks of.
    worst = max(figures.values(), key=lambda scores: float(scores.whole.sensitivity_peak[0]))
    row.stable = all(bool(each.rate.stable[0] and each.whole.stable[0]) for each in figures.values())
    row.peak = max(
        float(max(each.rate.sensitivity_peak[0], each.whole.sensitivity_peak[0])) for each in figures.values()
    )
    before = exact(flown, "roll", None, velocity, velocity.proposal.flown.gains)
    row.before = _peak(before)
    row.better = float(figures["roll"].attitude_rms[0] / before.attitude_rms[0])
    proposed = velocity.proposal.proposed
    for loop, said, true in (("rate", proposed.rate, worst.rate), ("whole", proposed.whole, worst.whole)):
        predicted, truth = quantities(said), quantities(true)
        for name in SHOWN:
            if name in predicted and name in truth:
                row.inside[f"{loop} {name}"] = predicted[name].lower <= truth[name].value <= predicted[name].upper
    row.stable = row.stable and holds(craft, rates, found.axes, air, 500 + number)
    return row


def _of_pitch(gains: dict[str, float]) -> dict[str, float]:
    """The same gains for pitch."""
    return {name.replace(old, new): value for name, value in gains.items() for old, new in PITCH.items() if old in name}


def _peak(scores: Judged) -> float:
    return float(max(scores.rate.sensitivity_peak[0], scores.whole.sensitivity_peak[0]))


def exact(craft: Aircraft, axis: Axis, tuned: AxisTuning | None, velocity: AxisTuning, gains: Gains) -> Judged:
    """The outer loops on the exact plant, around an attitude loop with its proposed gains, or the flown ones."""
    rotors, own = craft.vehicle.rotors, craft.autopilot
    if rotors.lag_down_s and rotors.lag_down_s != rotors.lag_up_s:
        apart = (rotors.lag_up_s - rotors.lag_down_s) / (rotors.lag_up_s + rotors.lag_down_s)
        lag = rotors.mean_lag_s * (1.0 - (1.0 - 8.0 / np.pi**2) * apart**2)
        craft = changed(craft, {"T_motor": lag, "T_motor_down": lag})
    omega, index = velocity.omega_rad_s, list(TILT).index(axis)
    inner = _attitude(craft, axis, omega, tuned, index)
    loop = aircraft_loop(craft, filtered=True)
    _, angle, speed, sign = TILT[axis]
    response = loop.plant.response(omega)
    column = loop.inputs.index(f"{axis}_command")
    by_angle = response[loop.outputs.index(speed), column] / response[loop.outputs.index(angle), column]
    plant = sign * inner * by_angle / STANDARD_GRAVITY_M_S2
    hold = own.guidance
    controller = RateController(
        proportional_s=hold.velocity_p_1_s,
        integral=hold.velocity_i_1_s2,
        angle_1_s=hold.position_p_1_s,
        step_s=1.0 / own.rate_hz,
        late_integral=True,
    )
    ones = np.ones(omega.size, dtype=np.complex128)
    parts = ControllerParts(
        controller=controller,
        omega_rad_s=omega,
        filters=ones,
        logged=ones,
        disturbance_rad_s=velocity.parts.disturbance_rad_s,
    )
    return judged(parts, plant[None], gains, from_rad_s=velocity.plant.known_from_rad_s)


def _attitude(craft: Aircraft, axis: Axis, omega: FloatArray, tuned: AxisTuning | None, index: int) -> ComplexArray:
    """The attitude over its set-point, of the simulator's own loops, shape ``(f,)``."""
    rates = craft.autopilot.rates
    loop = aircraft_loop(craft, filtered=True)
    row = loop.outputs.index(TILT[axis][0])
    plant = loop.plant.response(omega)[row, loop.inputs.index(f"{axis}_command")]
    filters = rate_filters(craft, omega)[row]
    controller = RateController(
        proportional_s=rates.proportional[index],
        integral=rates.integral[index],
        derivative_s2=rates.derivative[index],
        angle_1_s=craft.autopilot.angle_1_s[index],
        derivative_of_error=rates.derivative_of_error,
        derivative_cutoff_hz=rates.derivative_cutoff_hz[index],
        error_cutoff_hz=rates.error_cutoff_hz[index],
        target_cutoff_hz=rates.target_cutoff_hz[index],
        command_cutoff_hz=rates.command_cutoff_hz[index],
        feedforward=rates.feedforward[index],
        step_s=1.0 / craft.autopilot.rate_hz,
        late_integral=True,
    )
    gains = Gains.of(controller) if tuned is None else tuned.proposal.proposed.gains
    parts = ControllerParts(controller=controller, omega_rad_s=omega, filters=filters, logged=filters)
    return np.asarray(plant * parts.angle(gains) / (1.0 + plant * parts.whole(gains)))


def holds(
    craft: Aircraft, rates: dict[str, float], axes: Mapping[LoopName, AxisTuning], air: dict[str, float], seed: int
) -> bool:
    """Whether the vehicle holds its place with all proposed gains, in other gusts, without motors at their limits."""
    roll = NAMES[craft.autopilot.kind, "roll"]
    names = {*roll, *_of_pitch(dict.fromkeys(roll, 0.0))}
    new = {name: after for one in axes.values() for name, (_, after) in one.parameters.items() if name in names}
    gains = axes["velocity"].proposal.proposed.gains
    own = craft.autopilot.guidance
    hold = replace(own, velocity_p_1_s=gains.P, velocity_i_1_s2=gains.I, position_p_1_s=gains.A)
    flown = with_gains(craft, rates | new, source="the fleet")
    flown = replace(flown, autopilot=replace(flown.autopilot, guidance=hold))
    wind = Wind(north_m_s=air["north"], turbulence_m_s=air["gusts"])
    try:
        return fly_multirotor(flown, duration_s=HELD_S, seed=seed, wind=wind).saturated < MOST_SATURATED
    except LostError:
        return False


def table(rows: list[Row], loop: str) -> list[str]:
    lines = [
        "| fleet | proposals | kept | refused | unstable | M_s ≤ 1.75 (largest) | inside: ω_c, PM, M_s "
        "| place error under gusts, over flown, 10/50/90 % |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for hard in (False, True):
        here = [row for row in rows if row.hard == hard]
        flown = [row for row in here if not row.refused]
        if not flown:
            continue
        figures = [
            share([value for row in flown for key, value in row.inside.items() if key.endswith(name)]) for name in SHOWN
        ]
        peaks = [row.peak for row in flown]
        lines.append(
            f"| {'hard' if hard else 'plain'}, {loop} | {sum(row.changed for row in flown)} of {len(here)} "
            f"| {sum(not row.changed for row in flown)} | {sum(bool(row.refused) for row in here)} "
            f"| {sum(not row.stable for row in here)} "
            f"| {share([peak <= MOST_PEAK for peak in peaks])} ({max(peaks):.2f}) | {', '.join(figures)} "
            f"| {spread([row.better for row in flown])} |"
        )
    return lines


def main(flight: Callable[[tuple[int, bool]], Row] = one, loop: str = "velocity") -> None:
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{'outer' if loop == 'velocity' else loop}_fleet")
    parser.add_argument("vehicles", nargs="?", type=int, default=60, help="vehicles of each kind")
    parser.add_argument("processes", nargs="?", type=int, default=1)
    parser.add_argument("--file", type=Path, help="where results are kept")
    asked = parser.parse_args()
    tasks: list[Task] = [(number, hard) for hard in (False, True) for number in range(asked.vehicles)]
    work = partial(as_rows, flight)
    rows = [Row(**row) for row in run_tasks(tasks, work, path=asked.file, processes=asked.processes)]
    print("\n".join(table(rows, loop)))
    for row in rows:
        if row.refused or not row.stable or row.peak > MOST_PEAK or not all(row.inside.values()):
            missed = [name for name, inside in row.inside.items() if not inside]
            print(f"{row.vehicle} {'hard' if row.hard else ''}: {row.refused} M_s {row.peak:.2f} {missed}")


def as_rows(flight: Callable[[tuple[int, bool]], Row], task: Task) -> list[dict[str, Any]]:
    """The row of a vehicle, as a file keeps it."""
    number, hard = task
    return [asdict(flight((number, hard)))]


if __name__ == "__main__":
    main()
