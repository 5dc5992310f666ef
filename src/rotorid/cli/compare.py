"""``rotorid compare``: which of several results is best, and by how much, on the same logs where given."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder
from rotorid.cli.options import ForPaper, Map, Only, Output
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.option import Option
from rotorid.settings.parsing import PATHS

if TYPE_CHECKING:
    from rotorid.documents.compare import CompareDocument


_MOST_ROWS = 6
"""Maneuvers and parameters that a normal run prints."""


def compare_command(
    results: Annotated[list[Path], typer.Argument(help="Folders that identify wrote, or their result.json.")],
    *,
    log: Annotated[
        tuple[Path, ...],
        Option("--log", "Log to score every model on, best one that no model has used. Repeatable.", text=PATHS),
    ] = (),
    settings: Annotated[IdentifySettings, Only("segments", "shifts", "hold")],
    map: Map = None,
    output: Output,
    paper: ForPaper,
) -> None:
    """Compare models and methods: which is best and by how much."""
    from rotorid.documents.compare import compare_document, read_results
    from rotorid.identifying.comparison import compare, refused_comparison
    from rotorid.report.compare import JSON, write_comparison
    from rotorid.report.publication import of_comparison

    entries = read_results(results)
    carry_out(
        log,
        mapping=map,
        output=output,
        folder=default_folder([_named(path) for path in results], "compare"),
        file=JSON,
        compute=lambda records: compare(entries, records, settings=settings),
        write=lambda folder, compared: write_comparison(folder, compared, title=f"{len(entries)} models compared"),
        refused=lambda error, records: compare_document(refused_comparison(error, entries, records, settings=settings)),
        document=compare_document,
        show=_print,
        paper=paper,
        publication=of_comparison,
    )


def _named(result: Path) -> Path:
    """The folder of a result, by whatever name it was given, as the name of a log would be taken."""
    folder = result.parent if result.suffix == ".json" else result
    return Path(f"{folder.resolve().name}.json")


def _print(document: CompareDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print which model is best, then models, maneuvers, shared parameters, findings and files."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings, print_table
    from rotorid.report.compare import (
        JSON,
        PAGE,
        comparison_summary,
        maneuver_rows,
        model_rows,
        scored_words,
        shared_rows,
    )

    console = output_console()
    for sentence in comparison_summary(document):
        console.print(sentence, markup=False, highlight=False)
    console.print()
    labels = [model.label for model in document.models]

    def table(title: str, words: list[str], numbers: list[str]) -> Table:
        made = Table(title=title, title_justify="left", box=None, pad_edge=False)
        for name in words:
            made.add_column(name, justify="left")
        for name in numbers:
            made.add_column(name, justify="right")
        return made

    models = table(
        "models",
        ["result", "model", "method", "fit"],
        ["free", "own data %", "cross-validated %", "logs %", "cost", "AIC", "BIC"],
    )
    for row in model_rows(document):
        models.add_row(
            *(row.label, row.model, row.method, row.fit.words if row.fit else ""),
            *(row.parameters, row.own, row.validated, row.on_logs),
            *(row.cost, row.aic, row.bic),
        )
    console.print(models)
    if document.maneuvers:
        fits = table(
            f"fit in percent on the logs{scored_words(document)}; * used for the fit", ["log", "maneuver"], labels
        )
        rows = [
            (row.record, row.what, *(f"{cell.text}{'*' if cell.marked else ''}" for cell in row.fits))
            for row in maneuver_rows(document)
        ]
        print_table(fits, rows, verbose=verbose, item="maneuver", most=_MOST_ROWS)
    if shared := shared_rows(document):
        parameters = table("parameters (distance from the first)", ["parameter", "unit"], labels)
        rows = []
        for pair in shared:
            cells = zip(pair.values, pair.distances, strict=True)
            shown = (f"{value.text} ({far.text})" if far.text else value.text for value, far in cells)
            rows.append((pair.name, pair.unit, *shown))
        print_table(parameters, rows, verbose=verbose, item="parameter", most=_MOST_ROWS)
    print_findings(document.findings, verbose=verbose)
    console.print(f"report: {folder / PAGE}", soft_wrap=True, markup=False)
    console.print(f"file: {folder / JSON}", soft_wrap=True, markup=False)
