"""``rotorid example``: a small log to try every command on."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import command_line
from rotorid.cli.console import output_console, progress
from rotorid.cli.options import Output, complete_from
from rotorid.settings.option import Seed

if TYPE_CHECKING:
    from rotorid.flying.examples import Example


def _names() -> Iterable[str]:
    from rotorid.flying.examples import EXAMPLES

    return EXAMPLES


def example_command(
    name: Annotated[
        str | None,
        typer.Argument(
            autocompletion=complete_from(_names),
            help="px4, ardupilot, betaflight, rig or bebop. [default: list them]",
        ),
    ] = None,
    *,
    seed: Seed = 0,
    output: Output,
) -> None:
    """Write a small simulated log, and print commands to try on it."""
    from rotorid.errors import UsageError, listed
    from rotorid.flying.examples import EXAMPLES, example_named

    if name is None:
        if output.json or output.out is not None:
            raise UsageError(
                f"{'--json' if output.json else '--out'} needs the name of an example",
                needed=listed(list(EXAMPLES)),
            )
        _list(tuple(EXAMPLES.values()))
        return
    example = example_named(name)
    from rotorid.io.folders import making, target_folder
    from rotorid.report.files import result_kind, to_json, write_rig_simulation, write_simulation

    folder = Path(f"example-{example.name}")
    target = target_folder(output.out, folder, result_kind("simulation.json"), force=output.force)
    with progress(quiet=output.quiet), making(target) as made:
        if example.sweeps:
            document = write_simulation(made.place, example.choices(seed=seed), command=command_line())
        else:
            document = write_rig_simulation(made.place, seed=seed, command=command_line())
    if output.json:
        sys.stdout.write(to_json(document))
    elif not output.quiet:
        _print(example, made.folder)


def _print(example: Example, folder: Path) -> None:
    """Print where the log is, and commands to try on it."""
    console = output_console()

    def say(text: str) -> None:
        console.print(text, soft_wrap=True, markup=False)

    log = folder / example.file
    say(f"{example.name}: {example.about}")
    say(f"log:   {log}")
    say(f"truth: {folder / 'simulation.json'}")
    say("try:")
    for command in example.next:
        say("  " + command.format(log=shlex.quote(str(log)), folder=shlex.quote(str(folder))))


def _list(examples: tuple[Example, ...]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for column in ("example", "what it is"):
        table.add_column(column, overflow="fold")
    for example in examples:
        table.add_row(example.name, example.about)
    output_console().print(table)
