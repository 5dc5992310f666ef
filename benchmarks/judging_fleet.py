"""Gains that nobody flew, judged after one flight: how many bad ones are called safe, and how many good ones refused.

The vehicles, flights and logs are those of :mod:`benchmarks.tuning_fleet`; every fifth is a quadrotor under
Betaflight's cascade, with other inertia and lag of the rotors. Around each axis that a flight shows, gains are changed
that its vehicle never flew with: P, I, D and A times 0.2 to 5, each alone and all together, D without, filters moved by
the same factors, and a notch on the crossover. ``judge_axis`` sees the log alone; the truth is the simulator's exact
plant.

Run ``python -m benchmarks.judging_fleet [VEHICLES [PROCESSES [whole|short]]]``, 60 vehicles of each kind by default.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.tuning_fleet import AXES, NAMES, exact_plant, fly, made
from rotorid import read
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying import PlanSettings, SimulateSettings, fly_run, plan_for, write_run
from rotorid.planning import aircraft_loop, rate_filters
from rotorid.proposing import KnownAxis, judge_axis, known_axis
from rotorid.simulation import Aircraft, Wind, changed, number_of
from rotorid.tuning import ControllerParts, judged
from rotorid.typing import Axis
from rotorid.vehicles import VehicleEntry, aircraft

DRAWS, SETS = 50, 32
EVERY = 5
"""One vehicle in so many flies Betaflight's cascade."""

BANDS = {
    "whole": {"roll": (1.0, 120.0), "yaw": (0.6, 60.0)},
    "short": {"roll": (1.0, 40.0), "yaw": (0.6, 15.0)},
}
"""Bands of the sweeps, rad/s: the short ones end below or near the crossover."""

FASTER = {"roll": 5.0 / 3.0, "yaw": 1.0}
"""How much higher a racing quadrotor is swept."""

BAD_PEAK, GOOD_PEAK = 3.0, 1.7
FILTERS = {
    "px4": ("IMU_DGYRO_CUTOFF", "IMU_GYRO_CUTOFF", "MC_YAW_TQ_CUTOFF"),
    "ardupilot": ("ATC_RAT_{}_FLTD", "ATC_RAT_{}_FLTE", "INS_GYRO_FILTER"),
    "betaflight": ("dterm_lpf1_static_hz", "gyro_lpf1_static_hz"),
}
SHORT_NAMES = {"roll": "RLL", "yaw": "YAW"}
RATE_OF = {"roll": "p", "yaw": "r"}


@dataclass
class Judgment:
    """One set of gains: its true M_s, infinite where it is unstable, and the verdict."""

    vehicle: str
    axis: Axis
    hard: bool
    truth: float
    verdict: str


def sets_of(known: KnownAxis, kind: str, rng: np.random.Generator) -> list[dict[str, float]]:
    """Parameters that were not flown, by the names of the log."""
    axis = known.flown.axis
    flown = known.flown.record.parameters
    names = [name for name in names_of(kind, axis) if flown.get(name, 0.0) > 0.0]
    filters = [name.format(SHORT_NAMES[axis]) for name in FILTERS[kind]]
    filters = [name for name in filters if flown.get(name, 0.0) > 0.0]
    found: list[dict[str, float]] = []
    for number in range(SETS):
        way = number % 4
        factors = np.exp(rng.uniform(np.log(0.2), np.log(5.0), len(names)))
        if way == 1:
            factors[:] = factors[0]
        if way == 2:
            alone = rng.integers(len(names))
            factors = np.where(np.arange(len(names)) == alone, factors, 1.0)
        values = {name: float(factor * flown[name]) for name, factor in zip(names, factors, strict=True)}
        if way == 3:
            # Gains near those that flew, around filters that did not.
            values = {name: float(flown[name] * rng.uniform(0.6, 1.6)) for name in names}
            if filters:
                name = filters[rng.integers(len(filters))]
                values[name] = float(flown[name] * np.exp(rng.uniform(np.log(0.2), np.log(4.0))))
            if kind == "px4" and number % 8 == 7:
                crossover = np.nanmedian(
                    judged(
                        known.flown_parts, known.drawn()[:5], known.gains, from_rad_s=known.plant.known_from_rad_s
                    ).rate.crossover_rad_s
                )
                values |= {"IMU_GYRO_NF0_FRQ": float(crossover / (2.0 * np.pi)), "IMU_GYRO_NF0_BW": 5.0}
        if number % 7 == 6:
            values |= {name: 0.0 for name in names if name.endswith("_D")}
        found.append(values)
    return found


def names_of(kind: str, axis: Axis) -> Sequence[str]:
    """P, I, D and A of an axis in a log."""
    if kind == "betaflight":
        return (*(f"{axis}PID_{letter}" for letter in "PID"), *(("levelPID_P",) if axis != "yaw" else ()))
    return NAMES[kind, axis]


def truth_of(known: KnownAxis, craft: Aircraft, parts: ControllerParts) -> float:
    """Larger M_s of both loops on the exact plant; infinite where one is unstable."""
    omega, axis = parts.omega_rad_s, known.flown.axis
    plant = exact_plant(craft, axis, omega)
    own = rate_filters(craft, omega)[aircraft_loop(craft).outputs.index(RATE_OF[axis])]
    # The plant is seen behind the vehicle's own filters; what the log says of them changes by the foreign ones alone.
    flown = known.flown.parts(omega)
    exact = ControllerParts(
        controller=parts.controller, omega_rad_s=omega, filters=own * parts.filters / flown.filters, logged=own
    )
    gains = type(known.gains).of(parts.controller)
    found = judged(exact, plant[None], gains, from_rad_s=known.plant.known_from_rad_s)
    if not (found.rate.stable[0] and found.whole.stable[0]):
        return float("inf")
    return float(max(found.rate.sensitivity_peak[0], found.whole.sensitivity_peak[0]))


def flight(number: int, axis: Axis, folder: Path, *, hard: bool, band: str) -> tuple[Aircraft, str]:
    """A vehicle and the log of its sweep.

    Raises
    ------
    UsageError
        No sweep can be planned for it.
    """
    sweep_s = 30.0 if hard else 45.0
    low, high = BANDS[band][axis]
    if number % EVERY != EVERY - 1:
        craft, gains, air = made(number, hard=hard)
        air["sweep_s"] = sweep_s
        log, _ = fly(craft, gains[axis], axis, air, folder, 10 + number, band_rad_s=(low, high))
        return craft, log
    rng = np.random.default_rng([number, int(hard)])
    craft = aircraft("betaflight_quad")
    near = ("I_xx", "I_yy", "I_zz", "T_motor")
    craft = changed(craft, {name: number_of(craft, name) * rng.uniform(0.75, 1.25) for name in near})
    wanted = PlanSettings(
        axes=(axis,),
        shape="logarithmic_sweep",
        band_rad_s=(low, high * FASTER[axis]),
        duration_s=sweep_s,
        seed=number,
    )
    wind = Wind(north_m_s=rng.uniform(0.0, 4.0) * (2.0 if hard else 1.0), turbulence_m_s=rng.uniform(0.2, 1.0))
    entry = VehicleEntry(name=craft.name, summary="", source="", make=lambda: craft)
    choices = SimulateSettings(vehicle=entry, plan=plan_for(craft, wanted).plan, seed=number, wind=wind)
    path = folder / f"{axis}.bbl"
    write_run(path, fly_run(choices, 0), choices)
    return craft, str(path)


def one(task: tuple[int, Axis, bool], band: str = "whole") -> list[Judgment]:
    """All sets around one axis of one vehicle."""
    number, axis, hard = task
    with tempfile.TemporaryDirectory() as place:
        try:
            craft, log = flight(number, axis, Path(place), hard=hard, band=band)
            record = read(log)
            known = known_axis(axis, (), [record], filters={}, draws=DRAWS, seed=0, findings=[])
        except (InsufficientDataError, UsageError):
            return []
        rows = []
        for values in sets_of(known, craft.autopilot.kind, np.random.default_rng([number, hard, axis == "yaw"])):
            try:
                found = judge_axis(axis, known, values, advise=False)
            except UsageError:
                continue
            rows.append(Judgment(craft.name, axis, hard, truth_of(known, craft, found.parts), found.verdict))
    return rows


def share(verdicts: Sequence[str], wanted: Sequence[str]) -> str:
    """How many verdicts are among the wanted, in percent."""
    if not verdicts:
        return "–"
    return f"{100.0 * sum(verdict in wanted for verdict in verdicts) / len(verdicts):.1f} %"


def table(rows: Sequence[Judgment]) -> list[str]:
    """Verdicts of bad, middle and good sets, by axis and fleet."""
    lines = [
        "| fleet, axis | sets | bad → do not fly | good → do not fly | good → fly (or gently) | unstable → fly, gently "
        "| middle → do not fly |",
        "|---|---|---|---|---|---|---|",
    ]
    groups: dict[str, list[Judgment]] = {}
    for row in rows:
        groups.setdefault(f"{'hard' if row.hard else 'plain'}, {row.axis}", []).append(row)
    for name, here in (*groups.items(), ("all", list(rows))):
        bad = [row.verdict for row in here if row.truth > BAD_PEAK]
        good = [row.verdict for row in here if row.truth < GOOD_PEAK]
        unstable = [row.verdict for row in here if not np.isfinite(row.truth)]
        middle = [row.verdict for row in here if GOOD_PEAK <= row.truth <= BAD_PEAK]
        flown = sum(verdict in ("fly", "gently") for verdict in unstable)
        lines.append(
            f"| {name} | {len(here)} | {share(bad, ('do_not_fly',))} of {len(bad)} "
            f"| {share(good, ('do_not_fly',))} of {len(good)} | {share(good, ('fly',))} "
            f"({share(good, ('fly', 'gently'))}) | {flown} of {len(unstable)} | {share(middle, ('do_not_fly',))} |"
        )
    return lines


def by_vehicle(rows: Sequence[Judgment]) -> Mapping[str, int]:
    """Number of sets for each vehicle of the library."""
    names = sorted({row.vehicle for row in rows})
    return {name: sum(row.vehicle == name for row in rows) for name in names}


def run(vehicles: int, processes: int = 1, band: str = "whole") -> list[Judgment]:
    """All sets of a fleet."""
    tasks = [(number, axis, hard) for number in range(vehicles) for hard in (False, True) for axis in AXES]
    if processes == 1:
        return [row for task in tasks for row in one(task, band)]
    with ProcessPoolExecutor(processes) as pool:
        return [row for rows in pool.map(partial(one, band=band), tasks) for row in rows]


def main(arguments: list[str]) -> None:
    """Print the table, and the sets that miss a bar."""
    vehicles = int(arguments[0]) if arguments else 60
    rows = run(vehicles, int(arguments[1]) if len(arguments) > 1 else 1, *arguments[2:3])
    print("\n".join(table(rows)))
    print(by_vehicle(rows))
    for row in rows:
        safe = row.verdict in ("fly", "gently")
        if (row.truth > BAD_PEAK and row.verdict != "do_not_fly") or (row.truth < GOOD_PEAK and not safe):
            print(f"{row.vehicle} {row.axis} {'hard' if row.hard else ''}: M_s {row.truth:.2f}, {row.verdict}")


if __name__ == "__main__":
    main(sys.argv[1:])
