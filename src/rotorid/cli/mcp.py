"""``rotorid mcp``: the commands as tools of programs that speak the Model Context Protocol."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rotorid.settings.option import Option


def mcp_command(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="Folders that the tools may read.")],
    *,
    out: Annotated[
        Path | None,
        Option("--out", "Folder for results, inside a named one. [default: rotorid-out in the first]"),
    ] = None,
) -> None:
    """Offer inspect, review, identify, tune, verify and export as tools to an assistant (stdio)."""
    from rotorid.io.confinement import can_confine_files
    from rotorid.mcp.folders import named_folders
    from rotorid.mcp.server import serve

    if not can_confine_files():
        # Standard output belongs to the protocol.
        typer.echo(
            "This system cannot keep commands inside folders (Linux 5.19 or later can); paths alone are checked.",
            err=True,
        )
    serve(named_folders(folders, out))
