"""``rotorid doctor``: whether this installation is sound."""

from __future__ import annotations

from typing import Annotated

import typer

from rotorid.cli.installation import examine
from rotorid.cli.options import Json, Verbose
from rotorid.settings.option import Option


def doctor_command(
    *,
    skip: Annotated[bool, Option("--no-self-test", "Leave out the flight that is made and identified.")] = False,
    json: Json = False,
    verbose: Verbose = False,
) -> None:
    """Say whether this installation is sound: versions, extras, cache, sandbox, and a flight made and identified."""
    if not examine(self_test=not skip, json=json, verbose=verbose):
        raise typer.Exit(1)
