"""How commands speak: results to standard output, everything else to standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rotorid.cli.interrupt import check

if TYPE_CHECKING:
    from rich.console import Console

    from rotorid.errors import RotoridError
    from rotorid.pipeline.document import FindingDocument


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


def say_refused(error: RotoridError, findings: Sequence[FindingDocument], results: Path, *, quiet: bool) -> None:
    """Why there is no result, to standard error; results of an earlier run are not mistaken for those of this one."""
    say(f"rotorid: {error}")
    for finding in findings:
        if not quiet and finding.severity != "info":
            say(f"  {finding.kind}: {finding.message}")
    if results.exists():
        say(f"rotorid: the results in {results.parent} are those of an earlier run")


def print_findings(findings: Sequence[FindingDocument]) -> None:
    """Warnings and errors to standard output, what several places have in common once; remarks stand in the files."""
    console = output_console()
    said = dict.fromkeys((one.severity, one.kind, one.message) for one in findings if one.severity != "info")
    for severity, kind, message in said:
        console.print(f"[bold]{severity}[/bold] {kind}: ", end="")
        console.print(message, markup=False)


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """A line on a terminal that says what is being done; nothing in a pipe. A lost interrupt is raised here."""
    console = error_console()
    if quiet or not console.is_terminal:
        yield lambda _: check()
        return
    with console.status("reading") as status:

        def tell(text: str) -> None:
            check()
            status.update(text)

        yield tell
