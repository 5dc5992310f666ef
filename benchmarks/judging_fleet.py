"""Gains that nobody flew, judged after one flight: how many bad ones are called safe, and how many good ones refused.

The vehicles, flights and logs are those of :mod:`benchmarks.tuning_fleet`; every fifth is a quadrotor under
Betaflight's cascade, with other inertia and lag of the rotors. Around each axis that a flight shows, gains are changed
that its vehicle never flew with: P, I, D and A times 0.2 to 5, each alone and all together, D without, filters moved by
the same factors, a notch on the crossover, and under Betaflight a D that moves between ``d_min`` and D. Every third
vehicle has a noisy gyro, with sets of a larger D behind low-passes four times as high, every third other one a loop
gain that grows and falls over the flown throttle. ``judge_axis`` sees the log alone; the truth is the simulator's exact
plant, at both ends of all that moves, and its gyro's noise.

Run ``python -m benchmarks.judging_fleet [VEHICLES [PROCESSES]] [--band whole|short] [--first NUMBER] [--file FILE]``,
60 vehicles of each kind by default. FILE keeps the results of each axis, so that a second run goes on where the first
ended, and vehicles can be run in parts.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from benchmarks import tuning_fleet
from benchmarks.kept import Task, run_tasks
from benchmarks.tuning_fleet import RATE_OF, exact_plant, fly, made
from rotorid import read
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying import PlanSettings, SimulateSettings, fly_run, plan_for, write_run
from rotorid.planning import aircraft_loop, rate_filters
from rotorid.proposing import KnownAxis, judge_axis, known_axis
from rotorid.simulation import Aircraft, Wind, changed, number_of
from rotorid.tuning import ControllerParts, judged
from rotorid.typing import Axis
from rotorid.vehicles import VehicleEntry, aircraft

Kind: TypeAlias = Literal["plain", "noisy", "throttle"]

KINDS: tuple[Kind, ...] = ("plain", "noisy", "throttle")
AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")
NAMES = {
    **tuning_fleet.NAMES,
    ("px4", "pitch"): ("MC_PITCHRATE_P", "MC_PITCHRATE_I", "MC_PITCHRATE_D", "MC_PITCH_P"),
    ("ardupilot", "pitch"): ("ATC_RAT_PIT_P", "ATC_RAT_PIT_I", "ATC_RAT_PIT_D", "ATC_ANG_PIT_P"),
}
DRAWS, SETS = 50, 32
EVERY = 5
"""One vehicle in so many flies Betaflight's cascade."""

BANDS = {
    "whole": {"roll": (1.0, 120.0), "pitch": (1.0, 120.0), "yaw": (0.6, 60.0)},
    "short": {"roll": (1.0, 40.0), "pitch": (1.0, 40.0), "yaw": (0.6, 15.0)},
}
"""Bands of the sweeps, rad/s: the short ones end below or near the crossover."""

FASTER = {"roll": 5.0 / 3.0, "pitch": 5.0 / 3.0, "yaw": 1.0}
"""How much higher a racing quadrotor is swept."""

BAD_PEAK, GOOD_PEAK = 3.0, 1.7
BAD_NOISE, GOOD_NOISE = 0.12, 0.08
"""Noise of the command over its range: what is too much for any motor, and what is surely not."""

NOISE_RAD_S, LOWEST_GAIN, HIGHEST_GAIN = (0.02, 0.4), (0.65, 1.0), (1.0, 1.45)
"""Of a noisy gyro, each sample, and of the loop at both ends of the throttle relative to hover."""

LOUD_D, LOUD_FILTERS = (1.0, 2.0, 3.0, 4.0, 5.0), 4.0
"""Factors on D and on low-passes of sets that let the noise of a gyro through."""

FILTERS = {
    "px4": ("IMU_DGYRO_CUTOFF", "IMU_GYRO_CUTOFF", "MC_YAW_TQ_CUTOFF"),
    "ardupilot": ("ATC_RAT_{}_FLTD", "ATC_RAT_{}_FLTE", "INS_GYRO_FILTER"),
    "betaflight": ("dterm_lpf1_static_hz", "gyro_lpf1_static_hz"),
}
SHORT_NAMES = {"roll": "RLL", "pitch": "PIT", "yaw": "YAW"}


@dataclass
class Judgment:
    """One set of gains, and the verdict.

    ``truth`` is its M_s, infinite where it is unstable, the largest of both ends of all that moves; ``noise`` the root
    mean square of the command by the gyro's noise; ``moving`` tells whether D moves.
    """

    number: int
    vehicle: str
    axis: Axis
    hard: bool
    kind: Kind
    moving: bool
    truth: float
    noise: float
    verdict: str

    @property
    def bad(self) -> bool:
        return self.truth > BAD_PEAK or self.noise > BAD_NOISE

    @property
    def loud(self) -> bool:
        """Whether noise alone makes it bad."""
        return self.truth <= BAD_PEAK and self.noise > BAD_NOISE

    @property
    def good(self) -> bool:
        return self.truth < GOOD_PEAK and self.noise < GOOD_NOISE

    @property
    def flies(self) -> bool:
        return self.verdict in ("fly", "gently")


def kind_of(number: int) -> Kind:
    """What is special about a vehicle: five vehicles in a row are of one kind, since every fifth is Betaflight's."""
    return KINDS[number // EVERY % len(KINDS)]


def gain_range_of(number: int) -> tuple[float, float]:
    """Least and largest gain of the loops over the throttle that a vehicle flew, relative to hover."""
    if kind_of(number) != "throttle":
        return 1.0, 1.0
    rng = np.random.default_rng([number, 5])
    return float(rng.uniform(*LOWEST_GAIN)), float(rng.uniform(*HIGHEST_GAIN))


def sets_of(known: KnownAxis, kind: str, rng: np.random.Generator, *, noisy: bool) -> list[dict[str, float]]:
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
            if kind == "betaflight" and f"{axis}PID_D" in names and number % 8 == 3:
                values[f"{axis}PID_D"] *= float(rng.uniform(1.0, 3.0))
                least = rng.uniform(0.2, 0.9) * values[f"{axis}PID_D"]
                values[f"d_min_{AXES.index(axis)}"] = float(np.round(least))
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
    if noisy:
        higher = {name: LOUD_FILTERS * flown[name] for name in filters}
        derivative = [name for name in names if name.endswith("_D")]
        found += [{**higher, **{name: factor * flown[name] for name in derivative}} for factor in LOUD_D]
    return found


def names_of(kind: str, axis: Axis) -> Sequence[str]:
    """P, I, D and A of an axis in a log."""
    if kind == "betaflight":
        return (*(f"{axis}PID_{letter}" for letter in "PID"), *(("levelPID_P",) if axis != "yaw" else ()))
    return NAMES[kind, axis]


def truth_of(
    known: KnownAxis, craft: Aircraft, parts: ControllerParts, values: Mapping[str, float], gains: Sequence[float]
) -> tuple[float, float]:
    """M_s on the exact plant, infinite where a loop is unstable, and noise of the command; of all ends the largest.

    Parameters
    ----------
    known, craft
        What was flown.
    parts, values
        Of the set.
    gains
        Of the loops over the flown throttle, relative to hover.
    """
    omega, axis = parts.omega_rad_s, known.flown.axis
    plant = exact_plant(craft, axis, omega)
    row = aircraft_loop(craft).outputs.index(RATE_OF[axis])
    own = rate_filters(craft, omega)[row]
    # The plant is seen behind the vehicle's own filters; what the log says of them changes by the foreign ones alone.
    flown = known.flown.parts(omega)
    exact = ControllerParts(
        controller=parts.controller, omega_rad_s=omega, filters=own * parts.filters / flown.filters, logged=own
    )
    record = known.flown.record
    controller = known.flown.with_parameters(replace(record, parameters={**record.parameters, **values}))
    peaks, noises = [], []
    for end in controller.ends.values() or [parts.controller]:
        here, own_gains = replace(exact, controller=end), type(known.gains).of(end)
        noises.append(command_noise(here, own_gains, craft))
        for gain in gains:
            found = judged(here, gain * plant[None], own_gains, from_rad_s=known.plant.known_from_rad_s)
            stable = found.rate.stable[0] and found.whole.stable[0]
            peak = float(max(found.rate.sensitivity_peak[0], found.whole.sensitivity_peak[0]))
            peaks.append(peak if stable else float("inf"))
    return max(peaks), max(noises)


def command_noise(parts: ControllerParts, gains: Any, craft: Aircraft) -> float:
    """Root mean square of the command by the white noise of the gyro."""
    density = craft.sensors.gyro_noise_rad_s**2 / (np.pi * craft.autopilot.rate_hz)
    command = density * np.abs(parts.rate(gains) * parts.logged) ** 2
    return float(np.sqrt(np.trapezoid(command, parts.omega_rad_s)))


def vehicle_of(number: int, axis: Axis, *, hard: bool) -> tuple[Aircraft, dict[str, float], dict[str, float]]:
    """A vehicle, the mistuned gains of an axis, and its wind."""
    if number % EVERY != EVERY - 1:
        craft, gains, air = made(number, hard=hard)
        if axis == "pitch":
            kind, rates = craft.autopilot.kind, craft.autopilot.rates
            factors = [
                pitch / (roll or 1.0) for roll, pitch, _ in (rates.proportional, rates.integral, rates.derivative)
            ]
            names = zip(NAMES[kind, "roll"], NAMES[kind, "pitch"], factors, strict=False)
            chosen = {to: factor * gains["roll"][name] for name, to, factor in names if name in gains["roll"]}
        else:
            chosen = gains[axis]
    else:
        rng = np.random.default_rng([number, int(hard)])
        craft = aircraft("betaflight_quad")
        near = ("I_xx", "I_yy", "I_zz", "T_motor")
        craft = changed(craft, {name: number_of(craft, name) * rng.uniform(0.75, 1.25) for name in near})
        chosen = {}
        air = {"north": rng.uniform(0.0, 4.0) * (2.0 if hard else 1.0), "gusts": rng.uniform(0.2, 1.0)}
    if kind_of(number) == "noisy":
        low, high = NOISE_RAD_S
        noise = low * (high / low) ** np.random.default_rng([number, 6]).uniform()
        craft = replace(craft, sensors=replace(craft.sensors, gyro_noise_rad_s=float(noise)))
    return craft, chosen, air


def flight(number: int, axis: Axis, folder: Path, *, hard: bool, band: str) -> tuple[Aircraft, str]:
    """A vehicle and the log of its sweep.

    Raises
    ------
    UsageError
        No sweep can be planned for it.
    """
    sweep_s = 30.0 if hard else 45.0
    low, high = BANDS[band][axis]
    craft, gains, air = vehicle_of(number, axis, hard=hard)
    if gains:
        log, _ = fly(craft, gains, axis, {**air, "sweep_s": sweep_s}, folder, 10 + number, band_rad_s=(low, high))
        return craft, log
    wanted = PlanSettings(
        axes=(axis,),
        shape="logarithmic_sweep",
        band_rad_s=(low, high * FASTER[axis]),
        duration_s=sweep_s,
        seed=number,
    )
    wind = Wind(north_m_s=air["north"], turbulence_m_s=air["gusts"])
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
        gains = gain_range_of(number)
        rows = []
        rng = np.random.default_rng([number, hard, AXES.index(axis)])
        for values in sets_of(known, craft.autopilot.kind, rng, noisy=kind_of(number) == "noisy"):
            try:
                found = judge_axis(axis, known, values, gain_range=gains, advise=False)
            except UsageError:
                continue
            truth, noise = truth_of(known, craft, found.parts, values, (1.0, *gains))
            moving = any(name.startswith("d_min") for name in values)
            rows.append(Judgment(number, craft.name, axis, hard, kind_of(number), moving, truth, noise, found.verdict))
    return rows


def as_rows(task: Task, band: str) -> list[dict[str, Any]]:
    """The same as plain data."""
    number, axis, hard = task
    return [asdict(row) for row in one((number, axis, hard), band)]


def share(verdicts: Sequence[str], wanted: Sequence[str]) -> str:
    """How many verdicts are among the wanted, in percent."""
    if not verdicts:
        return "–"
    return f"{100.0 * sum(verdict in wanted for verdict in verdicts) / len(verdicts):.1f} %"


def table(rows: Sequence[Judgment]) -> list[str]:
    """Verdicts of bad, middle and good sets, by fleet and axis, by what is special, and of all."""
    lines = [
        "| sets of | sets | bad → do not fly | good → do not fly | good → fly (or gently) | unstable → fly, gently "
        "| middle → do not fly |",
        "|---|---|---|---|---|---|---|",
    ]
    groups: dict[str, list[Judgment]] = {}
    for axis in AXES:
        for hard in (False, True):
            groups[f"{'hard' if hard else 'plain'}, {axis}"] = [r for r in rows if (r.axis, r.hard) == (axis, hard)]
    groups["noisy gyro"] = [row for row in rows if row.kind == "noisy"]
    groups["bad by noise alone"] = [row for row in rows if row.loud]
    groups["throttle"] = [row for row in rows if row.kind == "throttle"]
    groups["Betaflight"] = [row for row in rows if row.vehicle == "betaflight_quad"]
    groups["moving D"] = [row for row in rows if row.moving]
    groups["all"] = list(rows)
    for name, here in groups.items():
        bad = [row.verdict for row in here if row.bad]
        good = [row.verdict for row in here if row.good]
        middle = [row.verdict for row in here if not row.bad and not row.good]
        unstable = [row for row in here if not np.isfinite(row.truth)]
        lines.append(
            f"| {name} | {len(here)} | {share(bad, ('do_not_fly',))} of {len(bad)} "
            f"| {share(good, ('do_not_fly',))} of {len(good)} | {share(good, ('fly',))} "
            f"({share(good, ('fly', 'gently'))}) | {sum(row.flies for row in unstable)} of {len(unstable)} "
            f"| {share(middle, ('do_not_fly',))} of {len(middle)} |"
        )
    return lines


def by_vehicle(rows: Sequence[Judgment]) -> Mapping[str, int]:
    """Number of sets for each vehicle of the library."""
    names = sorted({row.vehicle for row in rows})
    return {name: sum(row.vehicle == name for row in rows) for name in names}


def main() -> None:
    """Print the table, and the sets that miss a bar."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.judging_fleet")
    parser.add_argument("vehicles", nargs="?", type=int, default=60, help="vehicles of each kind")
    parser.add_argument("processes", nargs="?", type=int, default=1)
    parser.add_argument("--band", choices=list(BANDS), default="whole")
    parser.add_argument("--first", type=int, default=0, help="number of the first vehicle")
    parser.add_argument("--file", type=Path, help="where results are kept")
    asked = parser.parse_args()
    numbers = range(asked.first, asked.first + asked.vehicles)
    tasks: list[Task] = [(number, axis, hard) for number in numbers for hard in (False, True) for axis in AXES]
    work = partial(as_rows, band=asked.band)
    rows = [Judgment(**row) for row in run_tasks(tasks, work, path=asked.file, processes=asked.processes)]
    print("\n".join(table(rows)))
    print(by_vehicle(rows))
    for row in rows:
        if (row.bad and row.verdict != "do_not_fly") or (row.good and not row.flies):
            place = f"{row.number} {row.vehicle} {row.axis} {'hard' if row.hard else ''} {row.kind}"
            print(f"{place}{' moving D' if row.moving else ''}: M_s {row.truth:.2f}, {row.noise:.3f}, {row.verdict}")


if __name__ == "__main__":
    main()
