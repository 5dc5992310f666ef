"""``rotorid fleet PATH...``: many logs into one table, and which vehicles to look at."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorid.cli.command import command_line, print_if_asked, require_printing
from rotorid.cli.console import error_console, print_lines, say
from rotorid.cli.options import ForPaper, Only, Output
from rotorid.cli.preferences import results_folder
from rotorid.data.quantity import with_error, with_unit
from rotorid.fleets.settings import FleetSettings

if TYPE_CHECKING:
    from rotorid.documents.fleet import DifferenceDocument, FleetDocument
    from rotorid.fleets.runs import Fleet

_PIPE_S = 10.0
"""Between lines of progress in a pipe."""
_MOST_LINES = 8


def fleet_command(
    paths: Annotated[
        list[str],
        typer.Argument(
            metavar="PATH...", help="Logs, folders, patterns, archives, or addresses such as s3://bucket/logs."
        ),
    ],
    *,
    settings: FleetSettings,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Identify many logs and find which vehicles changed, which differ, and what is normal."""
    from rotorid.documents.base import to_json
    from rotorid.documents.fleet import fleet_document
    from rotorid.fleets.analysis import analyze
    from rotorid.fleets.runs import Fleet
    from rotorid.fleets.table import FILE, PAGE
    from rotorid.io.files import write_atomically
    from rotorid.report.fleet import render_fleet

    require_printing(paper)
    folder = output.out or results_folder() / "fleet"
    run = Fleet(paths, settings, folder, force=output.force)
    try:
        _read(run, quiet=output.quiet)
        analysis = analyze(run.logged_rows(), groups=run.groups(), gains=run.gains(), patterns=run.patterns())
        document = fleet_document(
            analysis,
            failed=run.failures(),
            counts=run.counts(),
            settings=settings.as_json(),
            command=command_line(),
        )
        page, text = render_fleet(analysis, document), to_json(document)
        with run.writing() as place:
            write_atomically(place / PAGE, page)
            print_if_asked(place, paper)
            write_atomically(place / FILE, text)
    finally:
        run.close()
    if output.json:
        sys.stdout.write(text)
    elif not output.quiet:
        _print(document, folder, verbose=output.verbose)
    if not document.done:
        say(f"rotorid: no log gave an answer; for the reasons see {folder / PAGE}")
        raise typer.Exit(1)


def _read(run: Fleet, *, quiet: bool) -> None:
    """Read all logs. After an interrupt, the tables contain what is done, and the next run continues from there."""
    with _bar(run, quiet=quiet) as count:
        try:
            for answer in run:
                count(bool(answer.rows))
        except KeyboardInterrupt:
            run.write_tables()
            say(
                f"rotorid: stopped after {len(run.answers)} of {len(run.places)} logs; run the same command to continue"
            )
            raise


@contextmanager
def _bar(run: Fleet, *, quiet: bool) -> Iterator[Any]:
    """A progress bar on a terminal; a line every ten seconds in a pipe."""
    total, failures, done = len(run.places), 0, 0
    console = error_console()
    if quiet or not console.is_terminal:
        last = time.monotonic()

        def report(good: bool) -> None:
            nonlocal failures, done, last
            done, failures = done + 1, failures + (not good)
            if not quiet and time.monotonic() - last > _PIPE_S:
                last = time.monotonic()
                say(f"rotorid: {done} of {total} logs, {failures} without an answer")

        yield report
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("logs"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[failed]}"),
    )
    started_s = time.monotonic()
    with Progress(*columns, console=console, transient=True) as shown:
        task = shown.add_task("logs", total=total, rate="", failed="")

        def count(good: bool) -> None:
            nonlocal failures, done
            done, failures = done + 1, failures + (not good)
            rate = done / max(time.monotonic() - started_s, 1e-6)
            words = f"{failures} without an answer" if failures else ""
            shown.update(task, completed=done, rate=f"{rate:.2g} a second", failed=words)

        yield count


def _print(document: FleetDocument, folder: Path, *, verbose: bool) -> None:
    """The answer, what to look at and why, what has no answer, where the files are."""
    from rotorid.fleets.table import PAGE
    from rotorid.report.fleet import notable, refusals

    found = notable(document)
    print_lines(document.sentences[:1], verbose=True)
    _list("Look at", [row.line for row in found], verbose=verbose)
    false_alarms = ["At most 5 % of the listed changes are expected to be false alarms."] if found else []
    print_lines([*false_alarms, *document.sentences[1:]], verbose=True)
    groups = [difference for difference in document.groups if difference.found]
    _list("Groups that differ", [_difference(difference) for difference in groups], verbose=verbose)
    _list("No answer", [row.line for row in refusals(document.failed)], verbose=verbose)
    print_lines([f"page: {folder / PAGE}", f"table: {folder / document.table}"], verbose=True)


def _difference(difference: DifferenceDocument) -> str:
    from rotorid.fleets.names import words_of
    from rotorid.report.fleet import quantity_of_paper

    found = difference.difference
    quantity = quantity_of_paper(difference.model, difference.parameter, found.unit)
    std = None if found.std is None else quantity.factor * found.std
    number = with_unit(with_error(quantity.factor * found.value, std), quantity.unit)
    words = words_of(difference.model, difference.parameter)
    return f"{words}: {difference.group} minus {difference.against} is {number}"


def _list(title: str, lines: Sequence[str], *, verbose: bool) -> None:
    from rotorid.fleets.table import PAGE

    if lines:
        print_lines([title], verbose=True)
        print_lines([f"  {line}" for line in lines], verbose=verbose, item="line", most=_MOST_LINES, page=PAGE)
