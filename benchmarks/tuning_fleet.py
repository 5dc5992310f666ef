"""Gains of a fleet: vehicles that fly with mistuned gains, are identified, tuned, and flown again.

Every vehicle is one of the library with other inertia, lag of the rotors and torque of yaw (each by up to 25 %), up to
8 ms more delay, P, I and D times 0.4 to 1.8, in wind up to 4 m/s with gusts of 0.2 to 1 m/s. It sweeps roll to 120 and
yaw to 60 rad/s. The hard ones have rotors that slow down up to twice as slowly as they speed up, twice the wind, and
30 s of a sweep. ``tune`` sees the log of the first flight; what it foretold is compared with the second one, that flies
the proposed gains in other wind. The plant that the second flight measured stands for the true one where another
choice of gains is judged: the best under the same limits, and those of published rules, which are given that very plant
without noise.

Run ``python -m benchmarks.tuning_fleet [VEHICLES [PROCESSES]]``, 60 vehicles of each kind by default.
"""

from __future__ import annotations

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rules import amigo, integrating_plant, px4_angle, px4_autotune, quicktune, simc, with_angle
from rotorid.data import FlightPlan
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying import PlanSettings, SimulateSettings, fly_run, plan_for, write_run
from rotorid.proposing import Foretold, check_tuning, tune
from rotorid.simulation import Aircraft, Wind, changed, number_of
from rotorid.tuning import (
    ControllerParts,
    Gains,
    UncertainPlant,
    Wishes,
    attitude_rms,
    judged,
    loop_figures,
    propose,
    quantities,
    ranges_of,
)
from rotorid.typing import ComplexArray
from rotorid.vehicles import VehicleEntry, aircraft, with_gains

VEHICLES = ("px4_quad", "x500", "iris", "ardupilot_quad")
SWEEPS = {"roll": (1.0, 120.0), "yaw": (0.6, 60.0)}
NAMES = {
    ("px4", "roll"): ("MC_ROLLRATE_P", "MC_ROLLRATE_I", "MC_ROLLRATE_D", "MC_ROLL_P"),
    ("px4", "yaw"): ("MC_YAWRATE_P", "MC_YAWRATE_I", "MC_YAWRATE_D", "MC_YAW_P"),
    ("ardupilot", "roll"): ("ATC_RAT_RLL_P", "ATC_RAT_RLL_I", "ATC_RAT_RLL_D", "ATC_ANG_RLL_P"),
    ("ardupilot", "yaw"): ("ATC_RAT_YAW_P", "ATC_RAT_YAW_I", "ATC_RAT_YAW_D", "ATC_ANG_YAW_P"),
}
AXES = ("roll", "yaw")
SLUGGISH = 1.15
MOST_PEAK = 1.75


@dataclass
class Row:
    """What became of one axis of one vehicle; numbers are those of the second flight."""

    vehicle: str
    axis: str
    hard: bool
    refused: str = ""
    changed: bool = False
    stable: bool = True
    peak: float = np.nan
    inside: dict[str, bool] = field(default_factory=dict)
    better: float = np.nan
    sluggish: bool = False
    stiffness: float = np.nan
    peers: dict[str, tuple[float, float]] = field(default_factory=dict)


def made(number: int, *, hard: bool) -> tuple[Aircraft, dict[str, dict[str, float]], dict[str, float]]:
    """A vehicle, the mistuned gains of its axes, and its wind."""
    rng = np.random.default_rng([number, int(hard)])
    craft = aircraft(VEHICLES[number % len(VEHICLES)])
    near = {name: number_of(craft, name) * rng.uniform(0.75, 1.25) for name in ("I_xx", "I_yy", "I_zz", "T_motor")}
    near["tau"] = number_of(craft, "tau") + rng.uniform(0.0, 0.008)
    if hard:
        near["T_motor_down"] = near["T_motor"] * rng.uniform(1.0, 2.0)
    rates = craft.autopilot.rates
    gains: dict[str, dict[str, float]] = {}
    for axis, index in (("roll", 0), ("yaw", 2)):
        flown = (rates.proportional[index], rates.integral[index], rates.derivative[index])
        # The library's ArduPilot flies near its limit of stability; with it as the middle half of them would not hover.
        factors = rng.uniform(0.4, 1.8, 3) * (0.4 if craft.autopilot.kind == "ardupilot" else 1.0)
        names = NAMES[craft.autopilot.kind, axis]
        gains[axis] = {name: float(f * one) for name, f, one in zip(names, factors, flown, strict=False) if one > 0.0}
    air = {"north": rng.uniform(0.0, 4.0) * (2.0 if hard else 1.0), "gusts": rng.uniform(0.2, 1.0)}
    return changed(craft, near), gains, air


def fly(
    craft: Aircraft,
    gains: dict[str, float],
    axis: str,
    air: dict[str, float],
    folder: Path,
    seed: int,
    plan: FlightPlan | None = None,
) -> tuple[str, FlightPlan]:
    """A log and its plan: the one that fits the gains, or that of an earlier flight where none does in its wind."""
    # Parameters are known as an autopilot's by its gain of roll.
    name = NAMES[craft.autopilot.kind, "roll"][0]
    flown = with_gains(craft, {name: craft.autopilot.rates.proportional[0], **gains}, source="the fleet")
    wind = Wind(north_m_s=air["north"], turbulence_m_s=air["gusts"])
    wanted = PlanSettings(
        axes=(axis,), shape="logarithmic_sweep", band_rad_s=SWEEPS[axis], duration_s=air["sweep_s"], seed=seed
    )
    try:
        plan = plan_for(flown, wanted).plan
    except UsageError:
        if plan is None:
            raise
    entry = VehicleEntry(name=craft.name, summary="", source="", make=lambda: flown)
    choices = SimulateSettings(vehicle=entry, plan=plan, seed=seed, wind=wind)
    log = folder / f"{axis}-{seed}{'.ulg' if craft.autopilot.kind == 'px4' else '.BIN'}"
    write_run(log, fly_run(choices, 0), choices)
    return str(log), plan


def one(task: tuple[int, str, bool]) -> Row:
    """One axis of one vehicle: both flights."""
    number, axis, hard = task
    craft, gains, air = made(number, hard=hard)
    air["sweep_s"] = 30.0 if hard else 45.0
    row = Row(vehicle=craft.name, axis=axis, hard=hard)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        try:
            log, plan = fly(craft, gains[axis], axis, air, folder, 10 + number)
            first = tune(records=log, axes=(axis,))
        except InsufficientDataError as error:
            row.refused = next((one.kind for one in error.findings if one.severity == "error"), "other")
            return row
        except UsageError:
            row.refused = "cannot hover with its gains"
            return row
        axis_first = first.axes[axis]  # type: ignore[index]
        row.changed = axis_first.proposal.changed
        names = NAMES[craft.autopilot.kind, axis]
        held = {name: after for name, (_, after) in axis_first.parameters.items() if name in names}
        again, _ = fly(craft, held, axis, air, folder, 500 + number, plan)
        proposed = axis_first.proposal.proposed
        foretold = Foretold(
            flown={name: before for name, (before, _) in axis_first.parameters.items()},
            proposed={name: after for name, (_, after) in axis_first.parameters.items()},
            rate=quantities(proposed.rate),
            whole=quantities(proposed.whole),
        )
        try:
            checked = check_tuning({axis: foretold}, again).axes[axis]  # type: ignore[index]
        except InsufficientDataError as error:
            row.stable = "saturation" not in {one.kind for one in error.findings}
            row.refused = "second flight: " + next((one.kind for one in error.findings), "other")
            return row
        row.inside = {f"{one.loop} {one.name}": one.inside for one in checked.figures}
        second = checked.tuning
        judge(row, axis_first, second)
    return row


def judge(row: Row, first: Any, second: Any) -> None:
    """Numbers of the second flight: its loops, and what its plant would have allowed."""
    flown = second.proposal.flown
    row.stable = bool(np.median(flown.rate.stable) and np.median(flown.whole.stable))
    row.peak = float(max(np.median(flown.rate.sensitivity_peak), np.median(flown.whole.sensitivity_peak)))
    plant, parts, controller = second.plant, second.parts, second.controller
    omega = second.omega_rad_s
    exact = UncertainPlant(
        model=plant.model, band_rad_s=plant.band_rad_s, knots=plant.knots, mean=plant.mean, misfits=plant.mean[None]
    )
    true = exact.response(omega)
    old, new = first.proposal.flown.gains, first.proposal.proposed.gains
    before, after = (judged(parts, true[None], gains, from_rad_s=exact.known_from_rad_s) for gains in (old, new))
    row.better = float(after.attitude_rms[0] / before.attitude_rms[0])
    start = old.on(parts.controller)
    best = propose(
        row.axis,
        exact,
        start,
        parts=ControllerParts(controller=start, omega_rad_s=omega, filters=parts.filters, logged=parts.logged),
        wishes=Wishes(ranges=ranges_of(controller), noise=2.0),
    ).proposed
    row.stiffness = float(best.attitude_rms[0] / after.attitude_rms[0])
    row.sluggish = bool(before.attitude_rms[0] > SLUGGISH * best.attitude_rms[0])
    seen = true * parts.filters
    near = (omega > 4.0) & (omega < 60.0)
    simple = integrating_plant(omega[near], seen[near])
    late = controller.controller.derivative_cutoff_hz
    simple = simple._replace(
        delay_s=simple.delay_s + (1.0 / (2.0 * np.pi * late) if late and row.axis != "yaw" else 0.0)
    )
    if row.axis == "yaw":
        simple = simple._replace(delay_s=simple.delay_s + simple.lag_s, lag_s=0.0)
    slow = (omega > np.pi) & (omega < 2.0 * np.pi * 40.0)
    gmvc = px4_autotune(seen[slow], omega[slow], step_s=0.01, rise_time_s=0.2 if row.axis == "yaw" else 0.14)
    peers = {
        "SIMC, λ 1": with_angle(simc(simple, 1.0), parts, true),
        "SIMC, λ 1.5": with_angle(simc(simple, 1.5), parts, true),
        "AMIGO": with_angle(amigo(simple), parts, true),
        "PX4 autotune": Gains(P=gmvc[0], I=gmvc[1], D=gmvc[2], A=px4_angle(gmvc[0])) if gmvc[0] > 0.0 else None,
        "ArduPilot Quicktune": swung(parts, true, old, yaw=row.axis == "yaw"),
    }
    for name, gains in peers.items():
        if gains is None or min(gains.as_dict().values()) < 0.0:
            row.peers[name] = (np.inf, 0.0)
            continue
        rate, whole = true * parts.rate(gains), true * parts.whole(gains)
        figures = [loop_figures(omega, loop[None], from_rad_s=exact.known_from_rad_s) for loop in (rate, whole)]
        stable = all(bool(one.stable[0]) for one in figures)
        peak = max(float(one.sensitivity_peak[0]) for one in figures) if stable else np.inf
        rms = float(attitude_rms(omega, true[None], whole[None])[0])
        row.peers[name] = (peak, float(best.attitude_rms[0]) / rms if stable else 0.0)


def swung(parts: ControllerParts, true: ComplexArray, old: Gains, *, yaw: bool) -> Gains | None:
    """Quicktune's gains; none where nothing swings."""
    try:
        return quicktune(parts, true, old, yaw=yaw)
    except UsageError:
        return None


def share(values: list[bool]) -> str:
    return f"{100.0 * np.mean(values):.0f} %" if values else "–"


def table(rows: list[Row]) -> list[str]:
    lines = [
        "| fleet, axis | proposals | kept | refused | unstable | M_s ≤ 1.75 (largest) | inside: ω_c, PM, M_s "
        "| better of the sluggish (stiffness ×) | stiffness over what its plant allows, 10/50/90 % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for hard in (False, True):
        for axis in AXES:
            here = [one for one in rows if (one.hard, one.axis) == (hard, axis)]
            flown = [one for one in here if not one.refused]
            if not flown:
                continue
            figures = [
                share([value for one in flown for key, value in one.inside.items() if key.endswith(name)])
                for name in ("crossover_rad_s", "phase_margin_deg", "sensitivity_peak")
            ]
            sluggish = [one for one in flown if one.sluggish]
            stiff = np.quantile([one.stiffness for one in flown], (0.1, 0.5, 0.9))
            peaks = [one.peak for one in flown]
            lines.append(
                f"| {'hard' if hard else 'plain'}, {axis} | {sum(one.changed for one in flown)} of {len(here)} "
                f"| {sum(not one.changed for one in flown)} | {sum(bool(one.refused) for one in here)} "
                f"| {sum(not one.stable for one in here)} "
                f"| {share([peak <= MOST_PEAK for peak in peaks])} ({max(peaks):.2f}) | {', '.join(figures)} "
                f"| {len(sluggish)}: {share([one.better < 1.0 for one in sluggish])} "
                f"({np.median([1.0 / one.better for one in sluggish]) if sluggish else np.nan:.1f}) "
                f"| {stiff[0]:.2f}/{stiff[1]:.2f}/{stiff[2]:.2f} |"
            )
    lines += [
        "",
        "| gains by, axis | knows | unstable | M_s of both loops, 10/50/90 % | M_s ≤ 1.75 | stiffness, median |",
    ]
    lines.append("|---|---|---|---|---|---|")
    for axis in AXES:
        flown = [one for one in rows if one.axis == axis and not one.refused]
        own = np.quantile([one.peak for one in flown], (0.1, 0.5, 0.9))
        lines.append(
            f"| rotorid tune, {axis} | the first flight's log | {sum(not one.stable for one in flown)} "
            f"| {own[0]:.2f}/{own[1]:.2f}/{own[2]:.2f} | {share([one.peak <= MOST_PEAK for one in flown])} "
            f"| {np.median([one.stiffness for one in flown]):.2f} |"
        )
        for name in flown[0].peers:
            heights = np.array([one.peers[name][0] for one in flown])
            finite = heights[np.isfinite(heights)]
            told = "/".join(f"{value:.2f}" for value in np.quantile(finite, (0.1, 0.5, 0.9))) if finite.size else "–"
            known = "the plant of the second flight, without noise"
            lines.append(
                f"| {name}, {axis} | {known} | {int(np.sum(~np.isfinite(peaks)))} "
                f"| {told} | {share(list(peaks <= MOST_PEAK))} "
                f"| {np.median([one.peers[name][1] for one in flown]):.2f} |"
            )
    return lines


def run(vehicles: int, processes: int = 1) -> list[Row]:
    tasks = [(number, axis, hard) for hard in (False, True) for number in range(vehicles) for axis in AXES]
    if processes == 1:
        return [one(task) for task in tasks]
    with ProcessPoolExecutor(processes) as pool:
        return list(pool.map(one, tasks))


def main(arguments: list[str]) -> None:
    vehicles = int(arguments[0]) if arguments else 60
    rows = run(vehicles, int(arguments[1]) if len(arguments) > 1 else 1)
    print("\n".join(table(rows)))
    for row in rows:
        if row.refused or not row.stable or row.peak > MOST_PEAK or not all(row.inside.values()):
            missed = [name for name, inside in row.inside.items() if not inside]
            print(f"{row.vehicle} {row.axis} {'hard' if row.hard else ''}: {row.refused} M_s {row.peak:.2f} {missed}")


if __name__ == "__main__":
    main(sys.argv[1:])
