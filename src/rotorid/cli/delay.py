"""``rotorid delay``: logs in, delays as fractions of a sample out."""

from __future__ import annotations

import sys
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
    from rotorid.documents.delay import DelayDocument, DelayEstimateDocument


def delay_command(
    logs: Logs,
    input: Annotated[
        str | None, typer.Option("--input", help="CHANNEL that drives. [default: every set-point that moves]")
    ] = None,
    output: Annotated[
        str | None, typer.Option("--output", help="CHANNEL that answers. [default: what the set-point is of]")
    ] = None,
    band: Band = None,
    windows: Windows = None,
    coherence: Coherence = None,
    estimate: Estimate = "auto",
    instrument: Instrument = None,
    segment: Segments = None,
    shift: Shifts = None,
    map: Map = None,
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate delays between channels as fractions of a sample, with an interval and what they mean."""
    from rotorid.errors import InsufficientDataError
    from rotorid.io.files import write_atomically
    from rotorid.io.registry import read
    from rotorid.pipeline.delays import delays, refused_delay
    from rotorid.pipeline.settings import MeasureSettings
    from rotorid.report.files import to_json, write_together

    settings = MeasureSettings(
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
    folder = out or default_folder(logs[0], "delay")
    command = ["rotorid", *sys.argv[1:]]
    records: list[FlightRecord] = []
    try:
        with progress(quiet=quiet) as tell:
            for log in logs:
                tell(f"reading {log.name}")
                records.append(read(log, mapping=map))
            result = delays(records, input=input, output=output, settings=settings, command=command)
            write_together(folder, {"delay.json": lambda path: write_atomically(path, to_json(result.document))})
    except InsufficientDataError as error:
        document = refused_delay(error, records, settings=settings, command=command)
        if json:
            sys.stdout.write(to_json(document))
        say_refused(error, document.findings, folder / "delay.json", quiet=quiet)
        raise typer.Exit(1) from None
    if json:
        sys.stdout.write(to_json(result.document))
    elif not quiet:
        _print(result.document, folder)


def _print(document: DelayDocument, folder: Path) -> None:
    """Delays for a person: the recommended one of each pair, the others below it, findings, where the file is."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings

    console = output_console()
    table = Table(box=None, pad_edge=False)
    for name in ("pair", "delay in ms", "95 % in ms", "samples", "what it is"):
        table.add_column(name, justify="left" if name in ("pair", "what it is") else "right")
    for name, pair in document.pairs.items():
        table.add_row(name, *_cells(pair.recommended))
        for other in pair.others:
            table.add_row("  compare", *_cells(other))
    console.print(table)
    print_findings(document.findings)
    console.print(f"result: {folder / 'delay.json'}", soft_wrap=True, markup=False)


def _cells(estimate: DelayEstimateDocument) -> tuple[str, str, str, str]:
    ends = estimate.interval_s
    interval = f"{1e3 * ends[0]:.1f} to {1e3 * ends[1]:.1f}" if ends else ""
    return f"{1e3 * estimate.delay_s:.1f}", interval, f"{estimate.delay_samples:.2f}", estimate.meaning
