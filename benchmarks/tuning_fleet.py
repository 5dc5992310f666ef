"""Gains of a fleet: vehicles that fly with mistuned gains, are identified, tuned, and flown again.

Every vehicle is one of the library with other inertia, lag of the rotors and torque of yaw (each by up to 25 %), up to
8 ms more delay, P, I and D times 0.4 to 1.8, in wind up to 4 m/s with gusts of 0.2 to 1 m/s. It sweeps roll to 120 and
yaw to 60 rad/s. The hard ones have rotors that slow down up to twice as slowly as they speed up, twice the wind, and
30 s of a sweep. ``tune`` sees the log of the first flight; what it foretold is compared with the second one, that flies
the proposed gains in other wind, and may end unstable. Figures of gains are those on the simulator's exact plant, which
no identification knows; so is the plant of which the best gains under the same limits are taken, and that which the
published rules are given, without noise. Each rule is also compared with its own aim.

Run ``python -m benchmarks.tuning_fleet [VEHICLES [PROCESSES]]``, 60 vehicles of each kind by default.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.rules import amigo, integrating_plant, px4_angle, px4_autotune, quicktune, simc, with_angle
from rotorid.data import FlightPlan
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying import PlanSettings, SimulateSettings, fly_run, plan_for, write_run
from rotorid.planning import aircraft_loop, rate_filters
from rotorid.proposing import Foretold, check_tuning, tune
from rotorid.simulation import Aircraft, LostError, Wind, changed, number_of
from rotorid.tuning import (
    ControllerParts,
    Gains,
    Wishes,
    attitude_rms,
    foreseen,
    judged,
    loop_figures,
    quantities,
    ranges_of,
)
from rotorid.typing import Axis, ComplexArray, FloatArray
from rotorid.vehicles import VehicleEntry, aircraft, with_gains

VEHICLES = ("px4_quad", "x500", "iris", "ardupilot_quad")
SWEEPS = {"roll": (1.0, 120.0), "yaw": (0.6, 60.0)}
NAMES = {
    ("px4", "roll"): ("MC_ROLLRATE_P", "MC_ROLLRATE_I", "MC_ROLLRATE_D", "MC_ROLL_P"),
    ("px4", "yaw"): ("MC_YAWRATE_P", "MC_YAWRATE_I", "MC_YAWRATE_D", "MC_YAW_P"),
    ("ardupilot", "roll"): ("ATC_RAT_RLL_P", "ATC_RAT_RLL_I", "ATC_RAT_RLL_D", "ATC_ANG_RLL_P"),
    ("ardupilot", "yaw"): ("ATC_RAT_YAW_P", "ATC_RAT_YAW_I", "ATC_RAT_YAW_D", "ATC_ANG_YAW_P"),
}
AXES: tuple[Axis, ...] = ("roll", "yaw")
RATE_OF = {"roll": "p", "pitch": "q", "yaw": "r"}
SLUGGISH = 1.15
MOST_PEAK = 1.75
STABLE = 0.4
"""Share of the gains of the library's ArduPilot with which its changed vehicles hover: it flies near its limit."""


class Peer(NamedTuple):
    """Gains of one rule: largest M_s of both loops, stiffness over the best, and what they reach of the rule's aim."""

    peak: float
    stiffness: float
    reached: float


AIMS = {
    "rotorid tune": "M_s 1.7 at most: M_s over it",
    "SIMC, λ 1": "crossover 1/(2θ): ω_c over it",
    "SIMC, λ 1.5": "crossover 1/(2.5θ): ω_c over it",
    "AMIGO": "M_s 1.4: M_s of the rate loop over it",
    "PX4 autotune": "rise in 0.14 s, yaw 0.2 s: rise over it",
    "ArduPilot Quicktune": "gain margin 2.5: margin over it",
}
AIMED_PEAK, AMIGO_PEAK, QUICKTUNE_MARGIN = 1.7, 1.4, 2.5
RISE_S = {"roll": 0.14, "yaw": 0.2}
STEP_S = 1.5


@dataclass
class Row:
    """What became of one axis of one vehicle; figures of gains are those on the simulator's exact plant."""

    vehicle: str
    axis: Axis
    hard: bool
    refused: str = ""
    changed: bool = False
    capped: bool = False
    stable: bool = True
    peak: float = np.nan
    inside: dict[str, bool] = field(default_factory=dict)
    better: float = np.nan
    sluggish: bool = False
    stiffness: float = np.nan
    peers: dict[str, Peer] = field(default_factory=dict)


def made(number: int, *, hard: bool) -> tuple[Aircraft, dict[str, dict[str, float]], dict[str, float]]:
    """A vehicle, the mistuned gains of its axes, and its wind."""
    rng = np.random.default_rng([number, int(hard)])
    craft = aircraft(VEHICLES[number % len(VEHICLES)])
    near = {name: number_of(craft, name) * rng.uniform(0.75, 1.25) for name in ("I_xx", "I_yy", "I_zz", "T_motor")}
    near["tau"] = number_of(craft, "tau") + rng.uniform(0.0, 0.008)
    if hard:
        near["T_motor_down"] = near["T_motor"] * rng.uniform(1.0, 2.0)
    craft = calmed(craft)
    rates = craft.autopilot.rates
    gains: dict[str, dict[str, float]] = {}
    for axis, index in (("roll", 0), ("yaw", 2)):
        flown = (rates.proportional[index], rates.integral[index], rates.derivative[index])
        factors = rng.uniform(0.4, 1.8, 3)
        names = NAMES[craft.autopilot.kind, axis]
        gains[axis] = {name: float(f * one) for name, f, one in zip(names, factors, flown, strict=False) if one > 0.0}
    air = {"north": rng.uniform(0.0, 4.0) * (2.0 if hard else 1.0), "gusts": rng.uniform(0.2, 1.0)}
    return changed(craft, near), gains, air


def calmed(craft: Aircraft) -> Aircraft:
    """The vehicle with gains that are not near its limit, as those of the library's ArduPilot are.

    Else the axes that are not tuned oscillate, and no sweep of the third can be planned.
    """
    if craft.autopilot.kind != "ardupilot":
        return craft
    own = craft.autopilot.parameters
    names = [f"ATC_RAT_{axis}_{letter}" for axis in ("RLL", "PIT", "YAW") for letter in "PID"]
    return with_gains(craft, {name: STABLE * own[name] for name in names}, source="the fleet")


def fly(
    craft: Aircraft,
    gains: dict[str, float],
    axis: str,
    air: dict[str, float],
    folder: Path,
    seed: int,
    plan: FlightPlan | None = None,
    *,
    band_rad_s: tuple[float, float] | None = None,
) -> tuple[str, FlightPlan]:
    """A log and its plan: the one that fits the gains, or that of an earlier flight where none does in its wind."""
    # Parameters are known as an autopilot's by its gain of roll.
    name = NAMES[craft.autopilot.kind, "roll"][0]
    flown = with_gains(craft, {name: craft.autopilot.rates.proportional[0], **gains}, source="the fleet")
    wind = Wind(north_m_s=air["north"], turbulence_m_s=air["gusts"])
    wanted = PlanSettings(
        axes=(axis,),
        shape="logarithmic_sweep",
        band_rad_s=band_rad_s or SWEEPS[axis],
        duration_s=air["sweep_s"],
        seed=seed,
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


def one(task: tuple[int, Axis, bool]) -> Row:
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
        except UsageError as error:
            row.refused = str(error)
            return row
        axis_first = first.axes[axis]  # type: ignore[index]
        row.changed = axis_first.proposal.changed
        row.capped = any("in one flight" in reason for reason in axis_first.proposal.reasons)
        names = NAMES[craft.autopilot.kind, axis]
        held = {name: after for name, (_, after) in axis_first.parameters.items() if name in names}
        proposed = axis_first.proposal.proposed
        foretold = Foretold(
            flown={name: before for name, (before, _) in axis_first.parameters.items()},
            proposed={name: after for name, (_, after) in axis_first.parameters.items()},
            rate=quantities(proposed.rate),
            whole=quantities(proposed.whole),
        )
        row.stable = calm(lambda: fly(craft, held, axis, air, folder, 500 + number, plan)[0], axis, foretold)
        judge(row, craft, axis_first, foretold)
    return row


def calm(fly_again: Callable[[], str], axis: Axis, foretold: Foretold) -> bool:
    """Whether the second flight came back without an oscillation or saturated motors.

    What else it lacks is no sign of instability: the exact plant says of the gains what a short log cannot.
    """
    try:
        check_tuning({axis: foretold}, fly_again())
    except LostError:
        return False
    except InsufficientDataError as error:
        return not {"saturation", "oscillation"} & {one.kind for one in error.findings}
    return True


def exact_plant(craft: Aircraft, axis: Axis, omega_rad_s: FloatArray) -> ComplexArray:
    """Rate behind the filters by command, of the simulator itself, shape ``(f,)``.

    Rotors that slow down otherwise than they speed up show fast motion a lag below the mean of the two.
    """
    rotors = craft.vehicle.rotors
    if rotors.lag_down_s and rotors.lag_down_s != rotors.lag_up_s:
        apart = (rotors.lag_up_s - rotors.lag_down_s) / (rotors.lag_up_s + rotors.lag_down_s)
        lag = rotors.mean_lag_s * (1.0 - (1.0 - 8.0 / np.pi**2) * apart**2)
        craft = changed(craft, {"T_motor": lag, "T_motor_down": lag})
    loop = aircraft_loop(craft, filtered=True)
    row, column = loop.outputs.index(RATE_OF[axis]), loop.inputs.index(f"{axis}_command")
    return np.asarray(loop.plant.response(omega_rad_s)[row, column])


def judge(row: Row, craft: Aircraft, first: Any, foretold: Foretold) -> None:
    """Numbers of the proposed gains on the exact plant, and what that plant would have allowed."""
    controller, omega = first.controller, first.omega_rad_s
    filters = rate_filters(craft, omega)[aircraft_loop(craft).outputs.index(RATE_OF[row.axis])]
    old, new = first.proposal.flown.gains, first.proposal.proposed.gains
    start = new.on(first.parts.controller)
    parts = ControllerParts(controller=start, omega_rad_s=omega, filters=filters, logged=filters)

    def plant(omega_rad_s: FloatArray) -> ComplexArray:
        return exact_plant(craft, row.axis, omega_rad_s)

    true, known = plant(omega), first.plant.known_from_rad_s
    before, after = (judged(parts, true[None], gains, from_rad_s=known) for gains in (old, new))
    row.stable = row.stable and bool(after.rate.stable[0] and after.whole.stable[0])
    row.peak = float(max(after.rate.sensitivity_peak[0], after.whole.sensitivity_peak[0]))
    for loop, said, exact in (("rate", foretold.rate, after.rate), ("whole", foretold.whole, after.whole)):
        figures = quantities(exact)
        for name in ("crossover_rad_s", "phase_margin_deg", "sensitivity_peak"):
            if name in said and name in figures:
                row.inside[f"{loop} {name}"] = said[name].lower <= figures[name].value <= said[name].upper
    row.better = float(after.attitude_rms[0] / before.attitude_rms[0])
    wishes = Wishes(ranges=ranges_of(controller), noise=2.0)
    best = foreseen(row.axis, plant, start, parts, wishes=wishes).proposed
    row.stiffness = float(best.attitude_rms[0] / after.attitude_rms[0])
    row.sluggish = bool(before.attitude_rms[0] > SLUGGISH * best.attitude_rms[0])
    seen = true * parts.filters / parts.logged
    near = (omega > 4.0) & (omega < 60.0)
    simple = integrating_plant(omega[near], seen[near])
    late = controller.controller.derivative_cutoff_hz
    simple = simple._replace(
        delay_s=simple.delay_s + (1.0 / (2.0 * np.pi * late) if late and row.axis != "yaw" else 0.0)
    )
    if row.axis == "yaw":
        simple = simple._replace(delay_s=simple.delay_s + simple.lag_s, lag_s=0.0)
    slow = (omega > np.pi) & (omega < 2.0 * np.pi * 40.0)
    gmvc = px4_autotune(seen[slow], omega[slow], step_s=0.01, rise_time_s=RISE_S[row.axis])
    peers = {
        "SIMC, λ 1": with_angle(simc(simple, 1.0), parts, true),
        "SIMC, λ 1.5": with_angle(simc(simple, 1.5), parts, true),
        "AMIGO": with_angle(amigo(simple), parts, true),
        "PX4 autotune": Gains(P=gmvc[0], I=gmvc[1], D=gmvc[2], A=px4_angle(gmvc[0])) if gmvc[0] > 0.0 else None,
        "ArduPilot Quicktune": swung(parts, true, old, yaw=row.axis == "yaw"),
    }
    row.peers["rotorid tune"] = Peer(row.peak, row.stiffness, row.peak / AIMED_PEAK)
    for name, gains in peers.items():
        row.peers[name] = Peer(np.inf, 0.0, np.nan)
        if gains is None or min(gains.as_dict().values()) < 0.0:
            continue
        rate, whole = true * parts.rate(gains), true * parts.whole(gains)
        of_rate, of_whole = (loop_figures(omega, loop[None], from_rad_s=known) for loop in (rate, whole))
        if not (of_rate.stable[0] and of_whole.stable[0]):
            continue
        peak = float(max(of_rate.sensitivity_peak[0], of_whole.sensitivity_peak[0]))
        rms = float(attitude_rms(omega, true[None], whole[None])[0])
        aims = {
            "SIMC, λ 1": of_rate.crossover_rad_s[0] * 2.0 * simple.delay_s,
            "SIMC, λ 1.5": of_rate.crossover_rad_s[0] * 2.5 * simple.delay_s,
            "AMIGO": of_rate.sensitivity_peak[0] / AMIGO_PEAK,
            "PX4 autotune": rise_s(omega, rate / (1.0 + rate)) / RISE_S[row.axis],
            "ArduPilot Quicktune": of_rate.gain_margin[0] / QUICKTUNE_MARGIN,
        }
        row.peers[name] = Peer(peak, float(best.attitude_rms[0]) / rms, float(aims[name]))


def rise_s(omega_rad_s: FloatArray, closed: ComplexArray) -> float:
    """Seconds from 10 to 90 % of the end of a step, of a closed loop that follows slow set-points."""
    fine = np.linspace(omega_rad_s[0], omega_rad_s[-1], 20_000)
    real = np.interp(fine, omega_rad_s, closed.real)
    time_s = np.linspace(0.0, STEP_S, 600)
    step = 2.0 / np.pi * np.trapezoid(real * np.sin(np.multiply.outer(time_s, fine)) / fine, fine, axis=1)
    step += 2.0 / np.pi * fine[0] * time_s * real[0]
    first = [int(np.argmax(step >= level)) for level in (0.1, 0.9)]
    return float(time_s[first[1]] - time_s[first[0]]) if first[1] else np.nan


def swung(parts: ControllerParts, true: ComplexArray, old: Gains, *, yaw: bool) -> Gains | None:
    """Quicktune's gains; none where nothing swings."""
    try:
        return quicktune(parts, true, old, yaw=yaw)
    except UsageError:
        return None


def spread(values: Any) -> str:
    """Quantiles of 10, 50 and 90 %."""
    return "/".join(f"{value:.2f}" for value in np.quantile(values, (0.1, 0.5, 0.9))) if len(values) else "–"


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
        "| gains by, axis | knows | unstable | M_s of both loops, 10/50/90 % | M_s ≤ 1.75 | stiffness, median "
        "| its own aim | reached, 10/50/90 % |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for axis in AXES:
        flown = [one for one in rows if one.axis == axis and not one.refused]
        for name in flown[0].peers if flown else ():
            of = [one.peers[name] for one in flown]
            heights = np.array([peer.peak for peer in of])
            finite = heights[np.isfinite(heights)]
            known = "the first log" if name == "rotorid tune" else "the exact plant"
            lines.append(
                f"| {name}, {axis} | {known} | {int(np.sum(~np.isfinite(heights)))} | {spread(finite)} "
                f"| {share(list(heights <= MOST_PEAK))} | {np.median([peer.stiffness for peer in of]):.2f} "
                f"| {AIMS[name]} | {spread([peer.reached for peer in of if np.isfinite(peer.reached)])} |"
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
