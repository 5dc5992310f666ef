"""``rotorid stitch``: one model over speed, from models of several speeds."""

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
            help="Results of identify: hover.longitudinal, hover.lateral or both, each at two or more speeds; or at "
            "one, with a result of physical.flight."
        ),
    ],
    *,
    log: Annotated[
        tuple[Path, ...],
        Option("--log", "A flight through these speeds, to check the stitched model on. Repeatable.", text=PATHS),
    ] = (),
    settings: StitchSettings,
    map: Map = None,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Stitch models of several speeds into one model over speed."""
    from rotorid.documents.stitched import read_models, stitched_document
    from rotorid.flying.stitching import refused_flight, stitch
    from rotorid.report.stitched import JSON, write_stitched

    models = read_models(results)
    # Wrong results are refused before any log is read.
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
    """Print the answer, scores of flights, parameters over speed, findings, and where the files are."""
    from rich.table import Table

    from rotorid.cli.console import print_findings, print_lines, print_table
    from rotorid.report.stitched import JSON, PAGE, flight_tables, speed_tables, stitched_summary

    print_lines(stitched_summary(document), verbose=True)
    for flown in flight_tables(document):
        table = Table(title=flown.title, title_justify="left", box=None, pad_edge=False)
        table.add_column("channel")
        table.add_column("TIC", justify="right")
        table.add_column("fit %", justify="right")
        print_table(table, flown.rows, verbose=verbose, item="channel", most=6)
    for of_model in speed_tables(document):
        table = Table(title=of_model.model, title_justify="left", box=None, pad_edge=False)
        table.add_column("parameter")
        table.add_column("unit")
        for speed in of_model.speeds:
            table.add_column(f"{speed} m/s", justify="right")
        rows = [(row.name, row.unit, *row.values) for row in of_model.rows]
        print_table(table, rows, verbose=verbose, item="parameter", most=6)
    print_findings(document.findings, verbose=verbose)
    print_lines([f"report: {folder / PAGE}", f"file: {folder / JSON}"], verbose=True)
