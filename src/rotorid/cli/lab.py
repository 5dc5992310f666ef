"""``rotorid lab``: identification in the browser, by the commands of the command line."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rotorid.lab.settings import LabSettings


def lab_command(
    given: Annotated[
        Path | None,
        typer.Argument(metavar="[FOLDER|LOG|PROJECT]", help="A folder of logs, a log, or a rotorid.toml to repeat."),
    ] = None,
    *,
    settings: LabSettings,
) -> None:
    """Open a local web page to view logs, mark segments and identify models with the mouse."""
    from rotorid.cli.preferences import CHOICES, preferences
    from rotorid.lab.serving import serve

    defaults = asdict(preferences())
    serve(
        given,
        host=settings.host,
        port=settings.port,
        token=settings.token,
        show=lambda address: print(address, flush=True),
        launch=None if settings.no_browser else lambda door: typer.launch(str(door)),
        preferred={name: defaults[name] for name in CHOICES if defaults[name] is not None},
    )
