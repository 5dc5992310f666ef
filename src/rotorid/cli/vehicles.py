"""``rotorid vehicles``: what can fly in simulation, and where its numbers come from."""

from __future__ import annotations

import json as json_text
import sys
from typing import Annotated

import typer

SCHEMA = "rotorid.vehicles/1"


def vehicles_command(
    json: Annotated[bool, typer.Option("--json", help="Print the answer as JSON and nothing else.")] = False,
) -> None:
    """List the vehicles of the library: what they are, and where their numbers come from."""
    from rich.table import Table

    from rotorid.cli.console import output_console
    from rotorid.vehicles.catalog import VEHICLES, aircraft

    if json:
        listed = [
            {"name": one.name, "about": one.summary, "source": one.source, "flies": one.make is not None}
            for one in VEHICLES.values()
        ]
        sys.stdout.write(json_text.dumps({"schema": SCHEMA, "vehicles": listed}, indent=2) + "\n")
        return
    table = Table(box=None, pad_edge=False)
    for name in ("vehicle", "what it is", "source"):
        table.add_column(name, overflow="fold")
    for name in ("mass in kg", "loop in Hz"):
        table.add_column(name, justify="right")
    for one in VEHICLES.values():
        craft = None if one.make is None else aircraft(one.name)
        mass = "" if craft is None else f"{craft.vehicle.mass_kg:g}"
        rate = "" if craft is None else f"{craft.autopilot.rate_hz:g}"
        table.add_row(one.name, one.summary, one.source, mass, rate)
    output_console().print(table)
