"""``rotorid doctor``: whether this installation is sound."""

from __future__ import annotations

from typing import Annotated

import typer

from rotorid.cli.installation import examine
from rotorid.cli.options import Json, Verbose
from rotorid.settings.option import Option


def doctor_command(
    *,
    skip: Annotated[bool, Option("--no-self-test", "Skip the test flight.")] = False,
    json: Json = False,
    verbose: Verbose = False,
) -> None:
    """Check this installation: versions, extras, cache, sandbox, and a small flight simulated and identified."""
    if not examine(self_test=not skip, json=json, verbose=verbose):
        raise typer.Exit(1)
