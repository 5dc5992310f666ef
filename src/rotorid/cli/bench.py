"""``rotorid bench``: models of rotorid, anybody's predictions and published errors on a public benchmark."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.benchmarking.settings import BenchSettings
from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder
from rotorid.cli.options import ForPaper, Only, Output
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rotorid.benchmarking.benchmark import Benchmarked
    from rotorid.documents.benchmark import BenchDocument

FILE = "bench.json"


def bench_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="neurobem, idsia or nanobench.")],
    *,
    data: Annotated[
        Path | None, Option("--data", "Folder of the downloaded data. Without it, the address is shown.")
    ] = None,
    settings: BenchSettings,
    output: Output,
    paper: Annotated[ForPaper, Only("tables", "pdf")],
) -> None:
    """Score models on a public benchmark, next to published errors."""
    from rotorid.benchmarking.benchmark import bench
    from rotorid.data.findings import refusal
    from rotorid.documents.benchmark import bench_document
    from rotorid.report.publication import of_benchmark
    from rotorid.results.provenance import refused

    carry_out(
        [],
        output=output,
        paper=paper,
        folder=default_folder(Path(name), "bench"),
        file=FILE,
        compute=lambda _: bench(name, data, settings=settings),
        write=_write,
        refused=lambda error, records: bench_document(
            refused(error, records, settings, otherwise=refusal("not_verified", name, str(error)))
        ),
        document=bench_document,
        show=_print,
        publication=of_benchmark,
    )


def _write(folder: Path, found: Benchmarked) -> None:
    from rotorid.documents.benchmark import bench_document
    from rotorid.report.benchmark import render_bench
    from rotorid.report.files import write_together

    write_together(folder, {FILE: bench_document(found), "report.html": render_bench(found)})


def _print(document: BenchDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print the answer, the table, what is unfair, findings and files."""
    from rich.table import Table
    from rich.text import Text

    from rotorid.cli.console import output_console, print_findings
    from rotorid.report.benchmark import bench_summary, heading, metrics_of, model_rows

    console = output_console()
    for sentence in bench_summary(document):
        console.print(sentence, markup=False, highlight=False)
    console.print()
    made = Table(
        title="errors, ± one standard deviation between flights", title_justify="left", box=None, pad_edge=False
    )
    made.add_column("model", justify="left")
    for metric in metrics_of(document, every=verbose):
        made.add_column(Text(heading(metric)), justify="right")
    made.add_column("numbers", justify="right")
    rows = model_rows(document, every=verbose)
    for row in rows:
        made.add_row(row.model, *row.cells, row.parameters)
    console.print(made)
    console.print()
    for row in rows:
        console.print(f"{row.model}: {row.source}", markup=False, highlight=False, soft_wrap=True)
    console.print()
    for sentence in document.unfair:
        console.print(f"Unfair: {sentence}", markup=False, highlight=False)
    print_findings(document.findings, verbose=verbose)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)
    console.print(f"file: {folder / FILE}", soft_wrap=True, markup=False)
