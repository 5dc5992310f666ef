"""``rotorid simulate``: a vehicle of the library flies, and its log is written as its autopilot would have."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.console import print_findings, progress
from rotorid.cli.options import Changes, Height, Json, Out, Quiet, Seed, Turbulence, WindOption, named_numbers, wind_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rotorid.data.flight_plan import Entry, FlightPlan
    from rotorid.documents.design import SimulationDocument
    from rotorid.simulation.multirotor_flight import Aircraft
    from rotorid.simulation.wind import Wind

_NO_PLAN = "none"
RIG = "rig"


def simulate_command(
    vehicle: Annotated[str, typer.Argument(help="A vehicle of the library: see rotorid vehicles.")],
    plan: Annotated[
        str | None,
        typer.Option(
            "--plan",
            help="plan.json of rotorid design, or none for a hover. [default: a sweep and two doublets on every axis]",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option("--duration", help="Seconds to fly. [default: as long as the plan]")
    ] = None,
    wind: WindOption = None,
    turbulence: Turbulence = 0.0,
    height: Height = 10.0,
    set: Changes = None,
    runs: Annotated[int, typer.Option("--runs", help="Flights, each with its own wind, noise and draws.")] = 1,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="NAME=PERCENT", help="Draw a number of --set anew for every run. Repeatable."),
    ] = None,
    format: Annotated[
        str | None, typer.Option("--format", help="ulg, bin or csv. [default: that of the vehicle's autopilot]")
    ] = None,
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Fly a vehicle of the library in simulation, and write its log as its autopilot would have."""
    from rotorid.pipeline.simulation import SimulateChoices
    from rotorid.report.files import write_simulation
    from rotorid.simulation.multirotor_flight import changed, piloted
    from rotorid.vehicles.catalog import aircraft

    command = ["rotorid", *sys.argv[1:]]
    if vehicle == RIG:
        asked = {
            "--plan": plan,
            "--duration": duration,
            "--wind": wind,
            "--turbulence": turbulence or None,
            "--runs": runs if runs != 1 else None,
            "--set": set,
            "--vary": vary,
            "--format": format,
        }
        document = _rig(asked, out or Path("rotorid-out") / vehicle, seed=seed, command=command)
        _tell(document, out or Path("rotorid-out") / vehicle, json=json, quiet=quiet)
        return
    air = wind_of(wind, turbulence, height)
    changes = named_numbers(set, "--set")
    craft = piloted(changed(aircraft(vehicle), changes))
    folder = out or Path("rotorid-out") / vehicle
    # Checked before the plan is made, which takes a while.
    choices = SimulateChoices(
        vehicle=vehicle,
        duration_s=duration if duration is not None or plan != _NO_PLAN else 60.0,
        wind=air,
        changes=changes,
        vary=named_numbers(vary, "--vary"),
        runs=runs,
        format=format,  # type: ignore[arg-type]
        seed=seed,
    )
    with progress(quiet=quiet):
        choices = replace(choices, plan=_plan(plan, craft, air, seed))
        document = write_simulation(folder, choices, command=command)
    _tell(document, folder, json=json, quiet=quiet)


def _tell(document: SimulationDocument, folder: Path, *, json: bool, quiet: bool) -> None:
    from rotorid.report.files import to_json

    if json:
        sys.stdout.write(to_json(document))
    elif not quiet:
        _print(document, folder)


def _rig(asked: Mapping[str, object], folder: Path, *, seed: int, command: list[str]) -> SimulationDocument:
    """The rig has one experiment of its own."""
    from rotorid.errors import UsageError
    from rotorid.report.files import write_rig_simulation

    if given := [name for name, value in asked.items() if value is not None]:
        raise UsageError(
            f"{', '.join(given)} came for the rig, which does not fly",
            needed="no more than --seed and --out: two motors are swept for 120 s, and the log is CSV",
        )
    return write_rig_simulation(folder, seed=seed, command=command)


def _plan(given: str | None, craft: Aircraft, air: Wind, seed: int) -> FlightPlan | None:
    """The plan that the user named, none, or a sweep and two doublets of each axis."""
    from rotorid.documents.design import read_plan
    from rotorid.pipeline.designs import PlanChoices, plan_for, sweep_of

    if given == _NO_PLAN:
        return None
    if given is not None:
        return read_plan(Path(given))
    # A pilot flies what PX4 cannot be told: sticks are its instrument.
    entry: Entry | None = "stick" if craft.autopilot.kind == "px4" else None
    choices = PlanChoices(shape=sweep_of(craft), doublets=True, entry=entry, wind=air, seed=seed)
    return plan_for(craft, choices).plan


def _print(document: SimulationDocument, folder: Path) -> None:
    """What flew, what it reached, where the logs are."""
    from rich.table import Table

    from rotorid.cli.console import output_console

    console = output_console()
    flew = document.vehicle
    console.print(f"{flew.name}: {flew.description}", markup=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False)
    for name in (
        "log",
        "seconds",
        "tilt in deg",
        "rate in deg/s",
        "moved in m",
        "climbed in m",
        "motors",
        "limited in %",
    ):
        table.add_column(name, justify="left" if name == "log" else "right")
    for log in document.logs:
        reached = log.reached
        if reached is None:
            table.add_row(log.file, f"{log.duration_s:.1f}")
            continue
        table.add_row(
            log.file,
            f"{log.duration_s:.1f}",
            f"{57.29578 * reached.tilt_rad:.1f}",
            f"{57.29578 * reached.rate_rad_s:.0f}",
            f"{reached.position_m:.1f}",
            f"{reached.height_m:.1f}",
            f"{reached.motor_low:.2f} to {reached.motor_high:.2f}",
            f"{100.0 * reached.saturated:.1f}",
        )
    console.print(table)
    print_findings(document.findings)
    console.print(f"log:   {folder / document.logs[0].file}", soft_wrap=True, markup=False)
    console.print(f"truth: {folder / 'simulation.json'}", soft_wrap=True, markup=False)
