"""``rotorid fleet PATH...``: many logs into one table, and what the fleet says of its vehicles."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorid.cli.command import command_line, print_if_asked, require_printing
from rotorid.cli.console import error_console, output_console, say
from rotorid.cli.options import ForPaper, Only, Output
from rotorid.cli.preferences import results_folder
from rotorid.fleets.settings import FleetSettings

if TYPE_CHECKING:
    from rotorid.documents.fleet import FailedLogDocument, FleetDocument
    from rotorid.fleets.runs import Fleet

FILE, PAGE = "fleet.json", "fleet.html"
_MOST_LINES = 12


def fleet_command(
    paths: Annotated[
        list[str],
        typer.Argument(
            metavar="PATH...", help="Logs, folders, patterns, archives, or addresses such as s3://bucket/logs."
        ),
    ],
    *,
    settings: FleetSettings,
    output: Annotated[Output, Only("out", "json", "quiet", "verbose")],
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Read many logs once, identify each, and say what is normal, what differs and what changed."""
    from rotorid.documents.base import to_json
    from rotorid.documents.fleet import fleet_document
    from rotorid.fleets.analysis import analyze
    from rotorid.fleets.runs import Fleet
    from rotorid.io.files import write_atomically
    from rotorid.report.fleet import render_fleet

    require_printing(paper)
    folder = output.out or results_folder() / "fleet"
    run = Fleet(paths, settings, folder)
    try:
        _read(run, quiet=output.quiet)
        analysis = analyze(run.logged_rows(), groups=run.groups(), gains=run.gains())
        document = fleet_document(
            analysis,
            failed=run.failures(),
            counts=run.counts(),
            settings=settings.as_json(),
            command=command_line(),
        )
        run.write_tables()
        page = render_fleet(analysis, document)
        write_atomically(folder / PAGE, page)
        text = to_json(document)
        write_atomically(folder / FILE, text)
    finally:
        run.close()
    _print_page(folder, page, paper)
    if output.json:
        sys.stdout.write(text)
    elif not output.quiet:
        _print(document, folder)
    if not document.done:
        say(f"rotorid: no log gave an answer; the reasons are on {folder / PAGE}, and as a table beside it")
        raise typer.Exit(1)


def _read(run: Fleet, *, quiet: bool) -> None:
    """All logs; what is done where somebody ends it is in the tables, and the next run goes on from there."""
    with _bar(run, quiet=quiet) as count:
        try:
            for answer in run:
                count(bool(answer.rows))
        except KeyboardInterrupt:
            run.write_tables()
            say(f"rotorid: ended after {len(run.answers)} of {len(run.places)} logs; the same command goes on")
            raise


def _print_page(folder: Path, page: str, paper: ForPaper) -> None:
    """The page on paper where that was asked for; other pages of the folder are nobody's wish."""
    from rotorid.io.files import write_atomically
    from rotorid.io.folders import scratch_folder

    with scratch_folder() as scratch:
        write_atomically(scratch / PAGE, page)
        print_if_asked(scratch, paper)
        for printed in scratch.glob("*.pdf"):
            write_atomically(folder / printed.name, printed.read_bytes())


@contextmanager
def _bar(run: Fleet, *, quiet: bool) -> Iterator[Any]:
    """A line with rate, remaining time and failures so far on a terminal; every minute a sentence in a pipe."""
    total, failures, done = len(run.places), 0, 0
    console = error_console()
    if quiet or not console.is_terminal:
        last = time.monotonic()

        def tell(good: bool) -> None:
            nonlocal failures, done, last
            done, failures = done + 1, failures + (not good)
            if not quiet and time.monotonic() - last > 60.0:
                last = time.monotonic()
                say(f"rotorid: {done} of {total} logs, {failures} without an answer")

        yield tell
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


def _print(document: FleetDocument, folder: Path) -> None:
    console = output_console()

    def plain(text: str) -> None:
        console.print(text, markup=False, soft_wrap=True)

    for sentence in document.sentences:
        plain(sentence)
    _list(
        plain,
        "changed",
        [
            f"{cause.vehicle}, flight {cause.at_flight}: {cause.words}{_because(cause.usual)}"
            for cause in document.causes
        ],
    )
    _list(
        plain,
        "other gains",
        [
            f"{gains.vehicle}, flight {gains.at_flight} ({gains.log}): "
            + ", ".join(f"{name} {before:g} to {after:g}" for name, (before, after) in gains.gains.items())
            for gains in document.other_gains
        ],
    )
    _list(
        plain, "slowly changing", [f"{drift.vehicle}: {drift.parameter} of {drift.model}" for drift in document.drifts]
    )
    _list(
        plain,
        "differs from the rest",
        [f"{vehicle.vehicle}: {vehicle.parameter} of {vehicle.model}" for vehicle in document.outliers.vehicles],
    )
    _list(
        plain,
        "odd flights",
        [
            f"{flight.vehicle}, flight {flight.flight} ({flight.log}): {flight.parameter} {flight.value.value:.4g}, "
            f"expected {flight.expected:.4g}"
            for flight in document.outliers.flights
        ],
    )
    _list(
        plain,
        "groups that differ",
        [
            f"{difference.parameter} of {difference.model}: {difference.group} against {difference.against} "
            f"{difference.difference.value:+.4g} {difference.difference.unit}"
            for difference in document.groups
            if difference.found
        ],
    )
    _list(plain, "no answer", refusals(document.failed))
    plain(f"page: {folder / PAGE}")
    plain(f"table: {folder / document.table}")


def refusals(failed: Sequence[FailedLogDocument]) -> list[str]:
    """What gave no answer, each reason once: models and flights that share it are listed with it."""
    found: dict[tuple[str, str, str], int] = {}
    for failure in failed:
        # A reason that names its log has said so before.
        reason = failure.reason.removeprefix(f"{failure.log} ")
        key = (failure.log, failure.model, reason)
        found[key] = found.get(key, 0) + 1
    return [
        f"{log}{f' ({model})' if model else ''}: {reason}{f' ({count} flights)' if count > 1 else ''}"
        for (log, model, reason), count in found.items()
    ]


def _because(usual: str) -> str:
    return f" ({usual}?)" if usual else ""


def _list(plain: Any, title: str, lines: Sequence[str]) -> None:
    if not lines:
        return
    plain(f"\n{title}")
    for line in lines[:_MOST_LINES]:
        plain(f"  {line}")
    if len(lines) > _MOST_LINES:
        plain(f"  and {len(lines) - _MOST_LINES} more, which the page shows")
