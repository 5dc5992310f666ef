"""Gains from freestyle: vehicles that fly with sticks, chopped throttle and gusts, and are tuned from that log alone.

Every vehicle is one of the library with other inertia, lag of the rotors and delay, and with mistuned gains. Half of
the flights are in angle mode, where the stick is the instrument, half in acro, where the set-points of the rates are
the stick; a pilot who brings the vehicle back slowly is part of both. ``tune`` sees the log alone; figures are those on
the simulator's exact plant.

Run ``python -m benchmarks.freestyle_fleet [FLIGHTS [PROCESSES]] [--first NUMBER] [--file FILE]``, 40 flights by
default. FILE keeps the results of each flight, so that a second run goes on where the first ended; flights from number
40 on were looked at by nobody while ``tune`` was written.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tests.twins.oscillating_flights import Case, fly, record_of, with_sticks

from benchmarks.kept import Task, run_tasks
from benchmarks.tuning_fleet import MOST_PEAK, RATE_OF, exact_plant
from rotorid.data import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.planning import aircraft_loop, rate_filters
from rotorid.proposing import tune
from rotorid.simulation import LostError, number_of
from rotorid.tuning import ControllerParts, judged
from rotorid.typing import Axis
from rotorid.vehicles import aircraft

VEHICLES = ("px4_quad", "ardupilot_quad", "betaflight_quad", "x500", "iris")
AXES: tuple[Axis, ...] = ("roll", "pitch")
LOG_HZ, DURATION_S = 400.0, 60.0
MILDER, MILDER_TIMES = 0.6, 6
HOT_PEAK, HOT_MARGIN_DEG = 2.0, 40.0
"""M_s of flown gains above which, and phase margin below which, more margin is bought with attitude error."""


@dataclass
class Row:
    """What became of one axis of one flight; figures are those of the exact plant.

    ``peaks`` are M_s of the flown and the proposed gains, infinite where unstable, ``phase_margin_deg`` the smaller one
    of both loops of the flown ones; ``better`` is the attitude error under a moment, proposed over flown, and
    ``tracking`` that of the attitude behind its set-point. ``gain`` is the plant over the exact one, and ``inside``
    whether its 95 % interval contains one.
    """

    flight: int
    vehicle: str
    axis: Axis
    acro: bool
    refused: str = ""
    changed: bool = False
    reasons: str = ""
    band_rad_s: tuple[float, float] = (np.nan, np.nan)
    gain: float = np.nan
    inside: bool = False
    peaks: tuple[float, float] = (np.nan, np.nan)
    phase_margin_deg: float = np.nan
    better: float = np.nan
    tracking: float = np.nan
    foretold: float = np.nan

    @property
    def fine(self) -> bool:
        """Whether the flown gains have enough margin."""
        return self.peaks[0] <= HOT_PEAK and self.phase_margin_deg >= HOT_MARGIN_DEG


def axis_of(number: int) -> Axis:
    """The axis of a flight that is tuned from its log."""
    return AXES[number // 2 % 2]


def case_of(number: int) -> Case:
    """The flight of a number."""
    rng = np.random.default_rng([number, 48])
    vehicle, axis = VEHICLES[number % len(VEHICLES)], axis_of(number)
    craft = aircraft(vehicle)
    middle = 0.45 if craft.autopilot.kind == "ardupilot" else 1.0
    factors = [middle * float(rng.uniform(0.5, 1.3)) for _ in range(3)]
    axes = AXES
    if craft.autopilot.kind == "betaflight":
        # Its gains are whole numbers, so that a factor fits one axis only.
        axes = (axis,)
        flown = [craft.autopilot.parameters[f"{axis}PID_{letter}"] for letter in "PID"]
        factors = [round(factor * value) / value for factor, value in zip(factors, flown, strict=True)]
    return Case(
        vehicle=vehicle,
        axes=axes,
        proportional=factors[0],
        integral=factors[1],
        derivative=factors[2],
        lag_s=number_of(craft, "T_motor") * float(rng.uniform(0.75, 1.25)),
        delay_s=number_of(craft, "tau") + float(rng.uniform(0.0, 0.006)),
        wind_m_s=float(rng.uniform(1.0, 6.0)),
        gusts_m_s=float(rng.uniform(0.2, 1.2)),
        stick=float(rng.uniform(0.4, 0.95)),
        chops=True,
        acro=number % 2 == 1,
        duration_s=DURATION_S,
        seed=4800 + number,
    )


def flown_case(number: int) -> Case:
    """The same, with sticks as small as the vehicle needs to stay in the air."""
    case = case_of(number)
    for _ in range(MILDER_TIMES):
        try:
            fly(case)
        except LostError:
            case = replace(case, stick=MILDER * case.stick)
        else:
            break
    return case


def log_of(case: Case) -> FlightRecord:
    """What the autopilot logs; in acro the set-points of the rates are the sticks, and no attitude is asked for."""
    if not case.acro:
        return with_sticks(case, log_hz=LOG_HZ)
    record = record_of(case, log_hz=LOG_HZ)
    (topic,) = record.topics
    asked = ("phi_setpoint", "theta_setpoint", "psi_setpoint")
    rows = [row for row, channel in enumerate(topic.channels) if channel.name not in asked]
    rates = replace(topic, channels=tuple(topic.channels[row] for row in rows), values=topic.values[rows])
    status = replace(record.status, direct_rates=record.status.in_air)
    return replace(record, topics=(rates,), status=status)


def one(task: Task) -> list[dict[str, Any]]:
    """The axis of a flight."""
    (number,) = task
    case, axis = flown_case(number), axis_of(number)
    row = Row(flight=number, vehicle=case.vehicle, axis=axis, acro=case.acro)
    try:
        # Roll and pitch of Betaflight share a gain, which stays where one of them is not tuned.
        found = tune(
            records=log_of(case), axes=AXES if "levelPID_P" in case.craft.autopilot.parameters else (axis,)
        ).axes
        if axis not in found:
            raise InsufficientDataError(f"no gains of {axis}")
    except InsufficientDataError as error:
        said = [finding.message for finding in error.findings if finding.kind == "not_tuned"]
        row.refused = said[0] if said else str(error)
    else:
        judge(row, case, found[axis])
    return [asdict(row)]


def judge(row: Row, case: Case, found: Any) -> None:
    """Figures of both sets of gains on the exact plant."""
    craft, omega = case.craft, found.omega_rad_s
    filters = rate_filters(craft, omega)[aircraft_loop(craft).outputs.index(RATE_OF[row.axis])]
    parts = ControllerParts(controller=found.parts.controller, omega_rad_s=omega, filters=filters, logged=filters)
    plant = exact_plant(craft, row.axis, omega)
    old, new = found.proposal.flown.gains, found.proposal.proposed.gains
    before, after = (judged(parts, plant[None], gains, from_rad_s=found.plant.known_from_rad_s) for gains in (old, new))
    row.changed, row.reasons = found.proposal.changed, "; ".join(found.proposal.reasons)
    row.band_rad_s = found.plant.band_rad_s
    inside = (omega > row.band_rad_s[0]) & (omega < row.band_rad_s[1])
    row.gain = float(np.median(np.abs(found.plant.response(omega)[inside] / plant[inside])))
    low, high = np.quantile(
        np.median(np.abs(found.plant.drawn(omega)[:, inside] / plant[inside]), axis=1), (0.025, 0.975)
    )
    row.inside = bool(low <= 1.0 <= high)
    peaks = [
        float(max(one.rate.sensitivity_peak[0], one.whole.sensitivity_peak[0]))
        if one.rate.stable[0] and one.whole.stable[0]
        else np.inf
        for one in (before, after)
    ]
    row.peaks = peaks[0], peaks[1]
    row.phase_margin_deg = float(np.degrees(min(one.phase_margin_rad[0] for one in (before.rate, before.whole))))
    row.better = float(after.attitude_rms[0] / before.attitude_rms[0])
    row.foretold = float(found.proposal.better)
    errors = [
        np.trapezoid(
            np.abs(1.0 - plant * parts.angle(gains) / (1.0 + plant * parts.whole(gains))) ** 2 / omega**2, omega
        )
        for gains in (new, old)
    ]
    row.tracking = float(np.sqrt(errors[0] / errors[1]))


def table(rows: Sequence[Row]) -> list[str]:
    """Proposals of both modes, and of all flights."""
    lines = [
        "| flights | proposals | kept | refused | destabilized | M_s ≤ 1.75 (largest) "
        "| less attitude error: moments, tracking, either | plant over the exact one (inside) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    groups = {
        "angle mode": [row for row in rows if not row.acro],
        "acro": [row for row in rows if row.acro],
        "all": list(rows),
    }
    for name, here in groups.items():
        flown = [row for row in here if row.changed]
        if not here:
            continue
        kept = sum(not row.changed and not row.refused for row in here)
        peaks = [row.peaks[1] for row in flown]
        inside = percent([row.inside for row in here if not row.refused])
        gains = np.quantile([row.gain for row in here if np.isfinite(row.gain)] or [np.nan], (0.1, 0.5, 0.9))
        lines.append(
            f"| {name} | {len(flown)} of {len(here)} | {kept} "
            f"| {sum(bool(row.refused) for row in here)} | {sum(not np.isfinite(peak) for peak in peaks)} "
            f"| {percent([peak <= MOST_PEAK for peak in peaks])} ({max(peaks, default=np.nan):.2f}) "
            f"| {percent([row.better < 1.0 for row in flown])}, {percent([row.tracking < 1.0 for row in flown])}, "
            f"{percent([min(row.better, row.tracking) < 1.0 for row in flown])} "
            f"| {'/'.join(f'{value:.2f}' for value in gains)} ({inside}) |"
        )
    return lines


def table_by_margin(rows: Sequence[Row]) -> list[str]:
    """Proposals for flown gains with enough margin, and for hotter ones, where margin may cost attitude error."""
    lines = [
        "| flown gains | proposals | less attitude error | its median | M_s flown: median, largest | M_s proposed |",
        "|---|---|---|---|---|---|",
    ]
    changed = [row for row in rows if row.changed]
    for name, here in {
        "fine": [row for row in changed if row.fine],
        "too hot": [row for row in changed if not row.fine],
    }.items():
        before, after = ([row.peaks[which] for row in here] or [np.nan] for which in (0, 1))
        error = np.median([row.better for row in here] or [np.nan])
        lines.append(
            f"| {name} | {len(here)} | {sum(row.better < 1.0 for row in here)} of {len(here)} | × {error:.2f} "
            f"| {np.median(before):.2f}, {max(before):.2f} | {np.median(after):.2f}, {max(after):.2f} |"
        )
    return lines


def percent(values: Sequence[bool]) -> str:
    """How many are true."""
    return f"{100.0 * float(np.mean(values)):.0f} %" if values else "–"


def main() -> None:
    """Print the tables, and each axis."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.freestyle_fleet")
    parser.add_argument("flights", nargs="?", type=int, default=40)
    parser.add_argument("processes", nargs="?", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first flight")
    parser.add_argument("--file", type=Path, help="where results are kept")
    asked = parser.parse_args()
    tasks: list[Task] = [(number,) for number in range(asked.first, asked.first + asked.flights)]
    rows = [Row(**row) for row in run_tasks(tasks, one, path=asked.file, processes=asked.processes)]
    print("\n".join([*table(rows), "", *table_by_margin(rows)]))
    for row in rows:
        print(
            f"{row.flight} {row.vehicle} {row.axis} {'acro' if row.acro else 'angle'}: M_s {row.peaks[0]:.2f} → "
            f"{row.peaks[1]:.2f}, better {row.better:.2f} ({row.foretold:.2f}), tracking {row.tracking:.2f}, gain "
            f"{row.gain:.3f}, band {row.band_rad_s[0]:.1f}–{row.band_rad_s[1]:.0f} {row.refused or row.reasons}"
        )


if __name__ == "__main__":
    main()
