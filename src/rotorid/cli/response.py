"""``rotorid response``: logs in, frequency responses with coherence and error out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.console import default_folder, progress, say_refused
from rotorid.cli.options import (
    Band,
    Coherence,
    Estimate,
    Instrument,
    Json,
    Logs,
    Map,
    Out,
    Quiet,
    Seed,
    Segments,
    Shifts,
    Windows,
    measure_choices,
)

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord
    from rotorid.documents.response import LoopDocument, ResponseDocument
    from rotorid.pipeline.settings import ResponseSettings


def response_command(
    logs: Logs,
    inputs: Annotated[str, typer.Option("--inputs", help="CHANNEL,... that drive, such as roll_command.")],
    outputs: Annotated[str, typer.Option("--outputs", help="CHANNEL,... that answer, such as p,ay.")],
    band: Band = None,
    windows: Windows = None,
    coherence: Coherence = None,
    estimate: Estimate = "auto",
    instrument: Instrument = None,
    correct_filters: Annotated[
        bool, typer.Option("--correct-filters", help="Take known filters of the autopilot off the outputs.")
    ] = False,
    segment: Segments = None,
    shift: Shifts = None,
    map: Map = None,
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate frequency responses with coherence and random error, and the margins of the loop."""
    from rotorid.errors import InsufficientDataError
    from rotorid.io.registry import read
    from rotorid.pipeline.responses import refused_response, response
    from rotorid.report.files import to_json, write_responses

    settings = _settings(band, windows, coherence, estimate, instrument, correct_filters, segment, shift, seed)
    drivers, answers = _channels(inputs, "--inputs"), _channels(outputs, "--outputs")
    folder = out or default_folder(logs[0], "response")
    command = ["rotorid", *sys.argv[1:]]
    records: list[FlightRecord] = []
    try:
        with progress(quiet=quiet) as tell:
            for log in logs:
                tell(f"reading {log.name}")
                records.append(read(log, mapping=map))
            result = response(records, inputs=drivers, outputs=answers, settings=settings, command=command)
            tell("writing the report")
            write_responses(folder, result, title=f"Responses from {', '.join(log.name for log in logs)}")
    except InsufficientDataError as error:
        document = refused_response(error, records, inputs=drivers, outputs=answers, settings=settings, command=command)
        if json:
            sys.stdout.write(to_json(document))
        say_refused(error, document.findings, folder / "response.json", quiet=quiet)
        raise typer.Exit(1) from None
    if json:
        sys.stdout.write(to_json(result.document))
    elif not quiet:
        _print(result.document, folder)


def _channels(text: str, option: str) -> tuple[str, ...]:
    from rotorid.errors import UsageError

    names = tuple(part.strip() for part in text.split(","))
    if not all(names) or len(set(names)) < len(names):
        raise UsageError(
            f"{option} {text!r} came", needed="channel names, each once, with commas between them: roll_command,p"
        )
    return names


def _settings(
    band: str | None,
    windows: str | None,
    coherence: float | None,
    estimate: str,
    instrument: str | None,
    correct_filters: bool,
    segment: Sequence[str] | None,
    shift: Sequence[str] | None,
    seed: int,
) -> ResponseSettings:
    from rotorid.pipeline.settings import ResponseSettings

    return ResponseSettings(
        correct_filters=correct_filters,
        **measure_choices(
            band=band,
            windows=windows,
            coherence=coherence,
            estimate=estimate,
            instrument=instrument,
            segment=segment,
            shift=shift,
            seed=seed,
        ),
    )


def _print(document: ResponseDocument, folder: Path) -> None:
    """Responses for a person: what can be used, margins, findings, where the files are."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings

    console = output_console()
    with_instrument = f" with {', '.join(document.instruments)}" if document.instruments else ""
    console.print(f"{document.estimate} estimate{with_instrument}", markup=False, highlight=False)
    table = Table(box=None, pad_edge=False)
    table.add_column("response", justify="left")
    for name in ("usable in rad/s", "points", "coherence", "error in %", "direct differs by dB", "unit"):
        table.add_column(name, justify="right" if name != "unit" else "left")
    for name, pair in document.pairs.items():
        if pair.band_rad_s is None:
            table.add_row(name, "nothing", "", "", "", "", pair.unit)
            continue
        low, high = pair.band_rad_s
        difference = pair.direct_difference_db
        table.add_row(
            name,
            f"{low:.2g} to {high:.3g}",
            str(pair.points),
            f"{pair.mean_coherence:.2f}",
            f"{100.0 * (pair.mean_random_error or 0.0):.1f}",
            "" if difference is None else f"{difference:.1f}",
            pair.unit,
        )
    console.print(table)
    for axis, loop in document.loops.items():
        _print_loop(axis, loop)
    print_findings(document.findings)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


def _print_loop(axis: str, loop: LoopDocument) -> None:
    from rotorid.cli.console import output_console
    from rotorid.report.response import loop_rows, unseen

    console = output_console()
    console.print(f"{axis} loop ({loop.method})", markup=False, highlight=False, soft_wrap=True)
    for row in loop_rows(loop):
        console.print(f"  {row.words}: {row.value} {row.unit}".rstrip(), markup=False, highlight=False)
    for missing in unseen(loop):
        console.print(f"  {missing.words}: {missing.reason}", markup=False, highlight=False, soft_wrap=True)
