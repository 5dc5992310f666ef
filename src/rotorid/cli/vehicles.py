"""``rotorid vehicles``: vehicles for simulation, where their numbers are from, and vehicle files."""

from __future__ import annotations

import json as json_text
import sys
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from rotorid.cli.console import say
from rotorid.cli.options import Json, Verbose, complete_from
from rotorid.flying.settings import LIKE_HELP, VehicleFileSettings, vehicle_names
from rotorid.settings.option import Option, options_given

if TYPE_CHECKING:
    from rotorid.documents.vehicle import NamedVehicle

SCHEMA = "rotorid.vehicles/1"
Like: TypeAlias = Annotated[
    str | None,
    Option("--like", LIKE_HELP, "Vehicle and autopilot", metavar="NAME", words=vehicle_names),
]


def vehicles_command(
    vehicles: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[VEHICLE]...",
            autocompletion=complete_from(vehicle_names),
            help="A vehicle, or results of one, to print with --toml.",
        ),
    ] = None,
    *,
    file: VehicleFileSettings,
    json: Json = False,
    verbose: Verbose = False,
) -> None:
    """List the vehicles of the library, or print one (or one made from results) as a file."""
    from rotorid.errors import UsageError

    words = [*map(str, file.results), *(vehicles or [])]
    if words:
        if json or not (file.toml or file.results):
            raise UsageError(
                "--json lists the library and takes no vehicle"
                if json
                else f"{' and '.join(words)} is printed as a file only",
                remedy="add --toml to print a vehicle file",
            )
        _print_file(words, file)
    elif wrong := options_given(file):
        raise UsageError(f"{', '.join(wrong.values())} needs a vehicle", remedy="name one, or add results with --from")
    else:
        _list(json=json, verbose=verbose)


def _print_file(words: list[str], file: VehicleFileSettings) -> None:
    """Print the vehicle file to standard output, and what was not identified to standard error."""
    from rotorid.documents.vehicle import named_vehicle
    from rotorid.errors import UsageError

    named = named_vehicle(words, like=file.like, given=file.known, name=file.name)
    if named.changes:
        raise UsageError(
            f"--set {', '.join(named.changes)} cannot be written to a vehicle file", needed="numbers of results"
        )
    text = named.toml
    print_vehicle_remarks(named)
    sys.stdout.write(text)


def print_vehicle_remarks(named: NamedVehicle) -> None:
    """Print what was taken from a similar vehicle, and remarks, to standard error."""
    if named.own is not None:
        say(f"not identified, so taken from {named.own.like}: {'; '.join(named.own.taken)}")
        for finding in named.own.joined.findings:
            say(f"{finding.kind}: {finding.message}")


def _list(*, json: bool, verbose: bool) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console
    from rotorid.vehicles.catalog import VEHICLES, aircraft

    if json:
        listed = [
            {"name": entry.name, "about": entry.summary, "source": entry.source, "flies": entry.make is not None}
            for entry in VEHICLES.values()
        ]
        sys.stdout.write(json_text.dumps({"schema": SCHEMA, "vehicles": listed}, indent=2) + "\n")
        return
    table = Table(box=None, pad_edge=False)
    table.add_column("vehicle", no_wrap=True)
    for column in ("mass in kg", "loop in Hz"):
        table.add_column(column, justify="right")
    table.add_column("what it is", overflow="fold" if verbose else "ellipsis", no_wrap=not verbose)
    if verbose:
        table.add_column("source", overflow="fold")
    for entry in VEHICLES.values():
        craft = None if entry.make is None else aircraft(entry.name)
        mass = "" if craft is None else f"{craft.vehicle.mass_kg:g}"
        rate = "" if craft is None else f"{craft.autopilot.rate_hz:g}"
        table.add_row(entry.name, mass, rate, entry.summary, *([entry.source] if verbose else []))
    output_console().print(table)
    if not verbose:
        output_console().print("-v shows where the numbers are from", style="dim")
