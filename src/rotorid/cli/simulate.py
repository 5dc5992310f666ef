"""``rotorid simulate``: a vehicle flies, and its log is written as its autopilot would have."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorid.cli.command import command_line
from rotorid.cli.console import print_findings, progress
from rotorid.cli.options import Output
from rotorid.cli.vehicles import LIKE_HELP, say_taken
from rotorid.pipeline.flight_settings import Air, PlanChoices, SimulateChoices, plan_choices

if TYPE_CHECKING:
    from rotorid.data.flight_plan import Entry, FlightPlan
    from rotorid.documents.design import SimulationDocument

_NO_PLAN = "none"
EVERYDAY = "everyday"
_HOVER_S = 60.0
RIG = "rig"


def simulate_command(
    vehicle: Annotated[
        list[str],
        typer.Argument(
            metavar="VEHICLE...",
            help="A vehicle of the library (see rotorid vehicles), a vehicle file .toml, or results of identify.",
        ),
    ],
    *,
    like: Annotated[str | None, typer.Option("--like", help=LIKE_HELP)] = None,
    plan: Annotated[
        str | None,
        typer.Option(
            "--plan",
            help="plan.json of rotorid design, everyday for ordinary flying by stick, or none for a hover. [default: a "
            "sweep and two doublets on every axis; of a vehicle behind set-points random binary signals on all]",
        ),
    ] = None,
    flight: Annotated[dict[str, Any], SimulateChoices],
    air: Air,
    output: Output,
) -> None:
    """Fly a vehicle in simulation, and write its log as its autopilot would have."""
    from rotorid.documents.vehicle import named_vehicle
    from rotorid.io.folders import making, target_folder
    from rotorid.report.files import result_kind, to_json, write_rig_simulation, write_simulation

    named = named_vehicle(vehicle, like=like, given=flight.get("changes"))
    default = Path("rotorid-out") / named.entry.name
    target = target_folder(output.out, default, result_kind("simulation.json"), force=output.force)
    if named.entry.name == RIG and named.entry.make is None:
        _refuse_of_the_rig(plan, air, flight)
        with making(target) as made:
            document = write_rig_simulation(made.place, seed=flight["seed"], command=command_line())
    else:
        if plan == _NO_PLAN and flight["duration_s"] is None:
            flight["duration_s"] = _HOVER_S
        # Checked before the plan is made, which takes a while.
        choices = SimulateChoices(vehicle=named.entry, wind=air.wind, **{**flight, "changes": named.changes})
        if not output.quiet:
            say_taken(named)
        with progress(quiet=output.quiet):
            choices = replace(choices, plan=_plan(plan, choices))
            with making(target) as made:
                document = write_simulation(made.place, choices, command=command_line())
    if output.json:
        sys.stdout.write(to_json(document))
    elif not output.quiet:
        _print(document, made.folder)


def _refuse_of_the_rig(plan: str | None, air: Air, flight: dict[str, Any]) -> None:
    """The rig has one experiment of its own.

    Raises
    ------
    UsageError
        An option of flights was given.
    """
    from rotorid.errors import UsageError

    usual = SimulateChoices(vehicle=RIG)
    asked = {
        "--plan": plan is not None,
        "--duration": flight["duration_s"] is not None,
        "--wind": air.mean_m_s != Air().mean_m_s,
        "--turbulence": air.turbulence_m_s != Air().turbulence_m_s,
        "--runs": flight["runs"] != usual.runs,
        "--set": "changes" in flight,
        "--vary": "vary" in flight,
        "--format": flight["format"] is not None,
        "--stick": flight["stick"] != usual.stick,
    }
    if given := [name for name, value in asked.items() if value]:
        raise UsageError(
            f"{', '.join(given)} came for the rig, which does not fly",
            needed="no more than --seed and --out: two motors are swept for 120 s, and the log is CSV",
        )


def _plan(given: str | None, flight: SimulateChoices) -> FlightPlan | None:
    """The plan that the user named, ordinary sticks, none, or test inputs and two doublets of each axis."""
    from rotorid.documents.design import read_plan
    from rotorid.pipeline.designs import plan_for, sweep_of
    from rotorid.pipeline.simulation import EVERYDAY_S, everyday_plan
    from rotorid.simulation.multirotor_flight import changed

    craft = flight.aircraft

    if given == _NO_PLAN:
        return None
    if given == EVERYDAY:
        return everyday_plan(craft, duration_s=flight.duration_s or EVERYDAY_S, level=flight.stick, seed=flight.seed)
    if given is not None:
        return read_plan(Path(given))
    if flight.entry.interface is not None:
        wishes = plan_choices(flight.entry, shape="random_binary", doublets=True, wind=flight.wind, seed=flight.seed)
        return plan_for(changed(flight.entry.aircraft, flight.changes), wishes).plan
    # A pilot flies what PX4 cannot be told: sticks are its instrument.
    entry: Entry | None = "stick" if craft.autopilot.kind == "px4" else None
    choices = PlanChoices(shape=sweep_of(craft), doublets=True, entry=entry, wind=flight.wind, seed=flight.seed)
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
