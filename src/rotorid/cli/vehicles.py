"""``rotorid vehicles``: what can fly in simulation, and where its numbers come from; files of vehicles of one's own."""

from __future__ import annotations

import json as json_text
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from rotorid.cli.console import say
from rotorid.cli.options import Json, one_of, vehicle_names
from rotorid.flying.settings import parse_changes

if TYPE_CHECKING:
    from rotorid.documents.vehicle import NamedVehicle

SCHEMA = "rotorid.vehicles/1"
LIKE_HELP = "For results: a vehicle whose autopilot, sensors and missing numbers it has."
Like: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--like",
        metavar="NAME",
        autocompletion=one_of(vehicle_names),
        rich_help_panel="Vehicle and autopilot",
        help=LIKE_HELP,
    ),
]


def vehicles_command(
    vehicles: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[VEHICLE]...",
            autocompletion=one_of(vehicle_names),
            help="With --toml: a name, or results of one vehicle.",
        ),
    ] = None,
    *,
    results: Annotated[
        list[Path] | None,
        typer.Option("--from", help="Folder or result.json of identify: print a vehicle file. Repeatable."),
    ] = None,
    like: Annotated[
        str | None, typer.Option("--like", metavar="NAME", autocompletion=one_of(vehicle_names), help=LIKE_HELP)
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="A number that was measured otherwise, such as m=1.4. Repeatable."
        ),
    ] = None,
    name: Annotated[str | None, typer.Option("--name", metavar="NAME", help="Of the vehicle in the file.")] = None,
    toml: Annotated[bool, typer.Option("--toml", help="Print the vehicle as a file.")] = False,
    json: Json = False,
) -> None:
    """List the vehicles of the library, or print one, or one from results, as a file."""
    from rotorid.errors import UsageError

    words = [*map(str, results or []), *(vehicles or [])]
    if words:
        if json or not (toml or results):
            raise UsageError(
                f"{' and '.join(words)} came{' with --json' if json else ''}", needed="--toml, which prints a file"
            )
        _print_file(words, like, parse_changes(known or []), name)
        return
    given = {"--like": like, "--set": known, "--name": name, "--toml": toml or None}
    if wrong := [option for option, value in given.items() if value is not None]:
        raise UsageError(f"{', '.join(wrong)} came alone", needed="a vehicle, or results with --from")
    _list(json=json)


def _print_file(words: list[str], like: str | None, given: dict[str, float], name: str | None) -> None:
    """The vehicle file on standard output; what the results do not hold also on standard error."""
    from rotorid.documents.vehicle import named_vehicle
    from rotorid.errors import UsageError

    named = named_vehicle(words, like=like, given=given, name=name)
    if named.changes:
        raise UsageError(
            f"--set {', '.join(named.changes)} came for a file", needed="numbers that results hold, or none"
        )
    text = named.toml
    say_taken(named)
    sys.stdout.write(text)


def say_taken(named: NamedVehicle) -> None:
    """What a vehicle from results has of another one, and what there is to remark, to standard error."""
    if named.own is not None:
        say(f"taken from {named.own.like}: {'; '.join(named.own.taken)}")
        for finding in named.own.joined.findings:
            say(f"{finding.kind}: {finding.message}")


def _list(*, json: bool) -> None:
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
    for column in ("vehicle", "what it is", "source"):
        table.add_column(column, overflow="fold")
    for column in ("mass in kg", "loop in Hz"):
        table.add_column(column, justify="right")
    for entry in VEHICLES.values():
        craft = None if entry.make is None else aircraft(entry.name)
        mass = "" if craft is None else f"{craft.vehicle.mass_kg:g}"
        rate = "" if craft is None else f"{craft.autopilot.rate_hz:g}"
        table.add_row(entry.name, entry.summary, entry.source, mass, rate)
    output_console().print(table)
