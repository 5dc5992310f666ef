"""``rotorid stitch``: models of several speeds in, one model over speed out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import carry_out
from rotorid.cli.options import ForPaper, Map, Only, Output
from rotorid.cli.preferences import results_folder
from rotorid.flying.settings import StitchSettings
from rotorid.settings.option import Option
from rotorid.settings.parsing import PATHS

if TYPE_CHECKING:
    from rotorid.documents.stitched import StitchedDocument


def stitch_command(
    results: Annotated[
        list[Path],
        typer.Argument(
            help="Folders that identify wrote, or their result.json: hover.longitudinal, hover.lateral or both, each "
            "at two and more speeds."
        ),
    ],
    *,
    log: Annotated[
        tuple[Path, ...],
        Option("--log", "A flight through the speeds, to judge the stitched model on. Repeatable.", text=PATHS),
    ] = (),
    settings: StitchSettings,
    map: Map = None,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Stitch models that were identified at several speeds into one over speed."""
    from rotorid.documents.stitched import read_models, stitched_document
    from rotorid.flying.stitching import refused_flight, stitch
    from rotorid.report.stitched import JSON, write_stitched

    models = read_models(results)
    # Wrong results are told before any log is read.
    stitched = stitch(models, settings=settings)
    carry_out(
        log,
        mapping=map,
        output=output,
        paper=paper,
        folder=results_folder() / "stitch",
        file=JSON,
        compute=lambda records: stitch(models, records, settings=settings),
        write=lambda folder, found: write_stitched(folder, found, title=f"{len(models)} models over speed"),
        refused=lambda error, records: stitched_document(refused_flight(error, stitched, records)),
        document=stitched_document,
        show=_print,
    )


def _print(document: StitchedDocument, folder: Path, *, verbose: bool = False) -> None:
    """Parameters over speed, scores of flights, findings, where the files are."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings
    from rotorid.report.stitched import JSON, PAGE, flight_tables, speed_tables, stitched_summary

    console = output_console()
    for of_model in speed_tables(document):
        table = Table(title=of_model.model, title_justify="left", box=None, pad_edge=False)
        table.add_column("parameter")
        table.add_column("unit")
        for speed in of_model.speeds:
            table.add_column(f"{speed} m/s", justify="right")
        for row in of_model.rows:
            table.add_row(row.name, row.unit, *row.values)
        console.print(table)
    for flown in flight_tables(document):
        table = Table(title=flown.title, title_justify="left", box=None, pad_edge=False)
        table.add_column("channel")
        table.add_column("TIC", justify="right")
        table.add_column("fit %", justify="right")
        for line in flown.rows:
            table.add_row(*line)
        console.print(table)
    for sentence in stitched_summary(document):
        console.print(sentence, markup=False)
    print_findings(document.findings, verbose=verbose)
    console.print(f"report: {folder / PAGE}", soft_wrap=True, markup=False)
    console.print(f"file: {folder / JSON}", soft_wrap=True, markup=False)
