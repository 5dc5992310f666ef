"""How commands speak: results to standard output, everything else to standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


_PIPE_WIDTH = 240


def error_console() -> Console:
    """Console on standard error."""
    from rich.console import Console

    return Console(stderr=True, highlight=False)


def output_console() -> Console:
    """Console on standard output; in a pipe wide enough that no table wraps."""
    from rich.console import Console

    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=_PIPE_WIDTH)


def say(text: str) -> None:
    """A plain sentence to standard error."""
    print(text, file=sys.stderr)


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """A line on a terminal that says what is being done; nothing in a pipe."""
    console = error_console()
    if quiet or not console.is_terminal:
        yield lambda _: None
        return
    with console.status("reading") as status:
        yield lambda text: status.update(text)
