"""``rotorid run``: the steps of a project file, one after the other, without the page."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.console import say
from rotorid.cli.options import Verbose
from rotorid.cli.preferences import results_folder
from rotorid.settings.option import Option


def run_command(
    project: Annotated[Path, typer.Argument(metavar="FILE.toml", help="Project file that rotorid lab saved.")],
    *,
    out: Annotated[Path | None, Option("--out", "Folder for the steps. [default: rotorid-out/NAME]")] = None,
    quiet: Annotated[bool, Option("--quiet", "Print errors only.")] = False,
    verbose: Verbose = False,
) -> None:
    """Repeat the steps of a project file, each in its own folder step-N."""
    from rotorid.errors import UsageError
    from rotorid.lab.steps import arguments, read_project

    read = read_project(project)
    logs = [str(project.parent / name) for name in read.logs]
    if missing := [name for name, path in zip(read.logs, logs, strict=True) if not Path(path).exists()]:
        raise UsageError(
            f"{missing[0]} of {project.name} is missing", remedy="put the logs in the folder of the project file"
        )
    place = out or results_folder() / project.stem
    results: list[str] = []
    worst = 0
    for number, step in enumerate(read.steps, start=1):
        folder = place / f"step-{number}"
        words = [*arguments(step, logs, results), "--out", str(folder)]
        if not quiet:
            say(f"step {number}: {shlex.join(['rotorid', *words])}")
        flags = [*(["--quiet"] if quiet else []), *(["--verbose"] if verbose else [])]
        code = subprocess.run([sys.executable, "-m", "rotorid", *words, *flags], check=False).returncode
        results.append(str(folder) if code == 0 else "")
        worst = max(worst, abs(code))
    if worst:
        raise typer.Exit(min(worst, 2))
