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
        str,
        typer.Option(
            "--host", metavar="ADDRESS", help="Of this machine, to listen at; others than its own need a token."
        ),
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", metavar="NUMBER", help="0 takes any free one.", min=0, max=65535)] = 0,
    token: Annotated[
        str | None,
        typer.Option(
            "--token",
            metavar="WORD|@FILE",
            envvar="ROTORID_LAB_TOKEN",
            help="Word that lets browsers in, or a file with it, which others on this machine do not see. "
            "[default: drawn at random, for one browser]",
        ),
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", "--no-open", help="Print the address, and open no browser.")
    ] = False,
) -> None:
    """Open a page on this machine where logs are seen, chosen and identified with the mouse."""
    from rotorid.cli.preferences import CHOICES, preferences
    from rotorid.lab.serving import serve

    told = asdict(preferences())
    serve(
        given,
        host=host,
        port=port,
        token=_word(token),
        show=lambda address: print(address, flush=True),
        launch=None if no_browser else lambda door: typer.launch(str(door)),
        preferred={name: told[name] for name in CHOICES if told[name] is not None},
    )


def _word(token: str | None) -> str | None:
    """The token itself, where it was said in which file it is."""
    from rotorid.errors import UsageError

    if token is None or not token.startswith("@"):
        return token
    try:
        return Path(token[1:]).read_text(encoding="utf-8").strip()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is no text"
        raise UsageError(
            f"the token in {token[1:]} cannot be read: {why}", needed="a file with the word alone"
        ) from None
