"""``rotorid lab``: identification in the browser, by the commands of the command line."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rotorid.lab.settings import LabSettings


def lab_command(
    given: Annotated[
        Path | None, typer.Argument(metavar="[FOLDER|LOG|PROJECT]", help="Logs to choose from, a log, or rotorid.toml.")
    ] = None,
    *,
    settings: LabSettings,
) -> None:
    """Open a page on this machine where logs are seen, chosen and identified with the mouse."""
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
