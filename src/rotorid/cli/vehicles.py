"""``rotorid vehicles``: what can fly in simulation, and where its numbers come from."""

from __future__ import annotations

import json as json_text
import sys

from rotorid.cli.options import Json

SCHEMA = "rotorid.vehicles/1"


def vehicles_command(json: Json = False) -> None:
    """List the vehicles of the library: what they are, and where their numbers come from."""
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
    for name in ("vehicle", "what it is", "source"):
        table.add_column(name, overflow="fold")
    for name in ("mass in kg", "loop in Hz"):
        table.add_column(name, justify="right")
    for entry in VEHICLES.values():
        craft = None if entry.make is None else aircraft(entry.name)
        mass = "" if craft is None else f"{craft.vehicle.mass_kg:g}"
        rate = "" if craft is None else f"{craft.autopilot.rate_hz:g}"
        table.add_row(entry.name, entry.summary, entry.source, mass, rate)
    output_console().print(table)
