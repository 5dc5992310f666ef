"""``rotorid lab``: identification in the browser, by the commands of the command line."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer


def lab_command(
    given: Annotated[
        Path | None, typer.Argument(metavar="[FOLDER|LOG|PROJECT]", help="Logs to choose from, a log, or rotorid.toml.")
    ] = None,
    *,
    host: Annotated[
        str, typer.Option("--host", help="Address of this machine to listen at; others than its own need --token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", help="0 takes any free one.", min=0, max=65535)] = 0,
    token: Annotated[
        str | None, typer.Option("--token", help="Word that lets a browser in. [default: drawn at random]")
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", "--no-open", help="Print the address, and open no browser.")
    ] = False,
) -> None:
    """Open a page on this machine where logs are seen, chosen and identified with the mouse."""
    from rotorid.cli.preferences import CHOICES, preferences
    from rotorid.lab.server import serve

    def show(address: str) -> None:
        print(address, flush=True)
        if not no_browser:
            typer.launch(address)

    told = asdict(preferences())
    looks = {name: told[name] for name in CHOICES if told[name] is not None}
    serve(given, host=host, port=port, token=token, show=show, preferred=looks)
