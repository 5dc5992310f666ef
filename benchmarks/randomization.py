"""Domain randomization by the covariance: whether drawn vehicles track as the true one does, in MuJoCo.

Every vehicle is PX4's own quadrotor with other mass and thrust (each by up to 15 and 10 %), inertia, lag of the motors,
torque of the rotors and drag (by up to 30 %). It flies two logs in gusts of 0.3 m/s: 20 s of a multisine on all axes,
of which ``physical.motors`` is identified, and 30 s each of sweeps in roll and pitch, for ``hover.lateral`` and
``hover.longitudinal``. Its owner knows mass and arm; the torque of the rotors is taken from the library, since flights
show its ratio to the yaw inertia only.

The exporter draws vehicles from the covariance and writes them for MuJoCo, as ``rotorid export --draws`` does. One
fixed controller, designed for the library's vehicle, flies a figure of eight with each of them, with the true vehicle,
and with as many whose numbers are all within 20 % of the identified ones, uniformly and independently. The controller
has the true state, so that nothing but the vehicle differs. Errors are the root mean squares of position and of tilt
over the flight. A range is between the 2.5 and 97.5 % quantiles of the draws, with the ranks that make it right on
average for any number of draws (Weibull's): of 40 draws these are nearly the extremes.

Run ``python -m benchmarks.randomization [VEHICLES [PROCESSES [KEPT.jsonl]]]``, 20 vehicles by default.
"""

from __future__ import annotations

import importlib.util
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kept import Task, run_tasks
from rotorid import identify
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.exports import Exported, ExportSettings, export, export_draws
from rotorid.flying import PlanSettings, SimulateSettings, fly_run, joined_vehicle, plan_for, plan_with, write_run
from rotorid.identifying import identify_motors
from rotorid.models import library_layout
from rotorid.results import IdentifiedModel
from rotorid.settings import MotorSettings
from rotorid.simulation import Aircraft, Wind, hover_derivatives_of
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

DRAWS, WIDE = 40, 0.2
NEAR = {"m": 0.15, "thrust": 0.1, **dict.fromkeys(("I_xx", "I_yy", "I_zz", "T_motor", "kappa", "drag"), 0.3)}
LIBRARY = {"m": 1.0, "I_xx": 0.025, "I_yy": 0.025, "I_zz": 0.03, "T_motor": 0.048, "kappa": 0.02, "thrust": 1.0}
LIBRARY |= {"drag": 1.0}
FACTORS = frozenset({"thrust", "drag"})
ARM_M, FULL_N = 0.2 * math.sqrt(2.0), 5.0
AIR = Wind(turbulence_m_s=0.3)
MOTION = ("X_u", "Y_v", "Z_w", "L_p", "M_q", "N_r")
CURVE = ("c_0", "c_1", "c_2")
ERRORS = {"position": "cm", "tilt": "deg"}

FLIGHT_S, CONTROL_STEPS = 4.0, 4
"""Duration, and steps of MuJoCo (1 ms) for each of the controller."""


# The vehicles and their logs


def changes_of(number: int) -> dict[str, float]:
    """What is true of a vehicle, by the names of ``simulate --set``."""
    rng = np.random.default_rng(number)
    return {name: value * rng.uniform(1.0 - NEAR[name], 1.0 + NEAR[name]) for name, value in LIBRARY.items()}


def truth_of(craft: Aircraft) -> dict[str, float]:
    """The same by the names of ``export --set``."""
    body, slopes = craft.vehicle, hover_derivatives_of(craft.vehicle, craft.autopilot)
    inertia = dict(zip(("I_xx", "I_yy", "I_zz"), np.diag(body.inertia_kg_m2), strict=True))
    return {
        "m": body.mass_kg,
        **{name: float(value) for name, value in inertia.items()},
        **dict(zip(CURVE, body.rotors.thrust, strict=True)),
        "kappa": body.rotors.torque_per_thrust_m,
        "T_motor": body.rotors.mean_lag_s,
        "arm": ARM_M,
        **{name: slopes[name] for name in MOTION},
    }


def identified(number: int, folder: Path) -> tuple[list[IdentifiedModel], Aircraft]:
    """Results of the two flights of a vehicle."""
    yours = {"vehicle": "px4_quad", "changes": changes_of(number), "wind": AIR}
    craft = SimulateSettings(**yours).aircraft
    multisine = PlanSettings(shape="multisine", entry="command", band_rad_s=(1.0, 60.0), duration_s=20.0)
    sweeps = PlanSettings(
        shape="logarithmic_sweep", axes=("roll", "pitch"), band_rad_s=(0.6, 50.0), duration_s=30.0, wind=AIR
    )
    sizes = {"roll": 0.07, "pitch": 0.07, "yaw": 0.12, "thrust": 0.08}
    plans = {"motors": plan_with(craft, multisine, sizes), "hover": plan_for(craft, sweeps).plan}
    logs = {name: folder / f"{name}.ulg" for name in plans}
    for seed, (name, plan) in enumerate(plans.items()):
        choices = SimulateSettings(**yours, plan=plan, seed=2 * number + seed)
        write_run(logs[name], fly_run(choices, 0), choices)
    weighed = MotorSettings(known={"m": craft.vehicle.mass_kg}, arm_m=ARM_M)
    motors = identify_motors([logs["motors"]], weighed)
    return [motors, *(identify(logs["hover"], f"hover.{half}", reduce=True) for half in HALVES)], craft


HALVES = ("lateral", "longitudinal")


# The flight in MuJoCo


def loop_of(exported: Exported, folder: Path) -> Any:
    """The loop that the export writes, imported."""
    exported.write(folder)
    spec = importlib.util.spec_from_file_location("vehicle_fly", folder / "vehicle_fly.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def reference(time_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity, acceleration of a figure of eight that begins at rest; forward, left, up."""
    sizes, frequencies = np.array([1.2, 0.6, 0.0]), np.array([1.5, 3.0, 0.0])
    phase = frequencies * time_s
    grown, rate, bend = 1.0, 0.0, 0.0
    if time_s < GROWS_S:
        angle = math.pi * time_s / GROWS_S
        grown, rate = 0.5 * (1.0 - math.cos(angle)), 0.5 * math.pi / GROWS_S * math.sin(angle)
        bend = 0.5 * (math.pi / GROWS_S) ** 2 * math.cos(angle)
    sine, cosine = sizes * np.sin(phase), sizes * frequencies * np.cos(phase)
    return (
        grown * sine,
        grown * cosine + rate * sine,
        -grown * frequencies**2 * sine + 2.0 * rate * cosine + bend * sine,
    )


GROWS_S = 1.5

SIGNS = np.array([np.sign(position) for position in library_layout("quad.x").positions])
MIX = np.stack([-SIGNS[:, 1], -SIGNS[:, 0], -np.asarray(library_layout("quad.x").spins)], axis=1)
"""Outputs by roll, pitch, yaw: forward, left, up."""

HOVER = LIBRARY["m"] * STANDARD_GRAVITY_M_S2 / (4.0 * FULL_N)
RATE_P, RATE_I = np.array([0.15, 0.15, 0.2]), np.array([0.2, 0.2, 0.1])
RATE_D, ANGLE_P = np.array([0.003, 0.003, 0.0]), np.array([4.0, 4.0, 2.8])
"""Those of the library's vehicle."""
POSITION_P, VELOCITY_P, CLIMB_I = 1.5, np.array([2.5, 2.5, 4.0]), 2.0


def tracking(loop: Any) -> dict[str, float]:
    """Errors of the figure of eight: of position in cm, of tilt in degrees."""
    model, data = loop.load()
    on_the_way, start = loop.late(model), data.qpos[:3].copy()
    step_s = CONTROL_STEPS * model.opt.timestep
    kept_rate, turned, climbed = np.zeros(3), np.zeros(3), 0.0
    away, tilted = [], []
    for k in range(round(FLIGHT_S / step_s)):
        place, speed, acceleration = reference(k * step_s)
        offset = place - (data.qpos[:3] - start)
        late_m_s = speed + POSITION_P * offset - data.qvel[:3]
        climbed += CLIMB_I * float(late_m_s[2]) * step_s
        push = acceleration + VELOCITY_P * late_m_s + [0.0, 0.0, climbed + STANDARD_GRAVITY_M_S2]
        axes = _axes(data.qpos[3:7])
        # The body's own up should point along the push, its nose to the north.
        wanted = axes.T @ (push / np.linalg.norm(push))
        error = np.array([-wanted[1], wanted[0], -math.atan2(axes[1, 0], axes[0, 0])])
        rate = data.qvel[3:6].copy()
        late_rad_s = ANGLE_P * error - rate
        turned = np.clip(turned + RATE_I * late_rad_s * step_s, -0.3, 0.3)
        command = RATE_P * late_rad_s + turned - RATE_D * (rate - kept_rate) / step_s
        kept_rate = rate
        throttle = HOVER * max(float(push @ axes[:, 2]), 0.0) / STANDARD_GRAVITY_M_S2
        outputs = np.clip(throttle + MIX @ command, 0.0, 1.0)
        for _ in range(CONTROL_STEPS):
            loop.step(model, data, outputs, on_the_way)
        away.append(float(offset @ offset))
        tilted.append(math.acos(min(max(float(wanted[2]), -1.0), 1.0)) ** 2)
    return {"position": 100.0 * math.sqrt(np.mean(away)), "tilt": math.degrees(math.sqrt(np.mean(tilted)))}


def _axes(quaternion: FloatArray) -> FloatArray:
    """Body to world."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


# Draws


def within(models: Sequence[IdentifiedModel], given: Mapping[str, float], seed: int) -> Iterator[Exported]:
    """Vehicles with every number within :data:`WIDE` of the identified one."""
    rng = np.random.default_rng(seed)
    numbers = joined_vehicle(models, given=given).numbers
    values = {name: numbers[name].value for name in ("m", "I_xx", "I_yy", "I_zz", "kappa", "T_motor", *MOTION, *CURVE)}
    made = 0
    while made < DRAWS:
        factors = {name: rng.uniform(1.0 - WIDE, 1.0 + WIDE) for name in values}
        # Thrust as a whole: its terms are one number for a curve of one form.
        factors |= dict.fromkeys(CURVE, factors["c_1"])
        drawn = {name: value * factors[name] for name, value in values.items()} | {"arm": ARM_M}
        try:
            yield export([], "mujoco", given=drawn, layout=library_layout("quad.x"))
        except (ModelError, UsageError):
            continue
        made += 1


def one(task: Task) -> list[dict[str, Any]]:
    """Errors of one vehicle: the true one, and the ranges of both kinds of draws."""
    number = int(task[0])
    given = {"kappa": LIBRARY["kappa"]}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        try:
            models, craft = identified(number, folder)
            drawn, _ = export_draws(models, "mujoco", ExportSettings(), DRAWS, seed=number, given=given)
        except (InsufficientDataError, ModelError, UsageError) as error:
            return [{"vehicle": number, "refused": str(error)}]
        exact = export([], "mujoco", given=truth_of(craft), layout=library_layout("quad.x"))
        (true,) = errors_of([exact], folder)
        kinds = {"covariance": drawn, "20 %": within(models, given, number)}
        found = {kind: list(errors_of(vehicles, folder)) for kind, vehicles in kinds.items()}
    rows = []
    for name in ERRORS:
        row: dict[str, Any] = {"vehicle": number, "error": name, "true": true[name]}
        for kind, errors in found.items():
            row[kind] = np.quantile([error[name] for error in errors], [0.025, 0.5, 0.975], method="weibull").tolist()
        rows.append(row)
    return rows


def errors_of(vehicles: Iterable[Exported], folder: Path) -> Iterator[dict[str, float]]:
    for vehicle in vehicles:
        yield tracking(loop_of(vehicle, folder))


# The table


def table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    lines = [
        "| tracking error | true, 10/50/90 % | draws | true error inside | width over true, median | at most |",
        "|---|---|---|---|---|---|",
    ]
    for name, unit in ERRORS.items():
        here = [row for row in rows if row.get("error") == name]
        true = np.quantile([row["true"] for row in here], [0.1, 0.5, 0.9])
        spread = "/".join(f"{value:.1f}" for value in true)
        for kind in ("covariance", "20 %"):
            inside = sum(row[kind][0] <= row["true"] <= row[kind][2] for row in here)
            widths = [100.0 * (row[kind][2] - row[kind][0]) / row["true"] for row in here]
            lines.append(
                f"| {name} | {spread} {unit} | {kind} | {inside} of {len(here)} "
                f"| {np.median(widths):.0f} % | {max(widths):.0f} % |"
            )
    refused = [row for row in rows if "refused" in row]
    return [*lines, *(f"vehicle {row['vehicle']} refused: {row['refused']}" for row in refused)]


def main(arguments: list[str]) -> None:
    vehicles = int(arguments[0]) if arguments else 20
    processes = int(arguments[1]) if len(arguments) > 1 else 1
    kept = Path(arguments[2]) if len(arguments) > 2 else None
    rows = list(run_tasks([(number,) for number in range(vehicles)], one, path=kept, processes=processes))
    print("\n".join(table(rows)))
    for row in rows:
        if "error" in row and not row["covariance"][0] <= row["true"] <= row["covariance"][2]:
            print(f"vehicle {row['vehicle']}, {row['error']}: {row['true']:.2f} outside {row['covariance']}")


if __name__ == "__main__":
    main(sys.argv[1:])
