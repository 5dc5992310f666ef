"""``rotorid demo``: fly the built-in vehicle, identify it, verify it, report."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rotorid.cli.command import print_if_asked, target_of, with_command
from rotorid.cli.console import log_progress, progress, say
from rotorid.cli.options import ForPaper, Only, Output
from rotorid.cli.preferences import results_folder
from rotorid.data.quantity import TWO_SIDED_95, error_columns, significant
from rotorid.settings.option import Option, Seed

if TYPE_CHECKING:
    from rotorid.flying.demo import Demonstration


_MOST_PARAMETERS = 24


def demo_command(
    *,
    seed: Seed = 0,
    keep_log: Annotated[bool, Option("--keep-log", "Keep the log of the flight (56 MB).")] = False,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Fly the built-in vehicle, identify it and write the report. Needs no data and no network."""
    from rotorid.flying.demo import LOG_NAME, fly_demo, identify_demo
    from rotorid.io.files import write_atomically
    from rotorid.io.folders import making
    from rotorid.io.registry import read
    from rotorid.report.files import write_overview_report, write_results

    target = target_of(output, results_folder() / "demo", "demo", paper)
    with progress(quiet=output.quiet), making(target) as made:
        folder = made.place
        log = folder / LOG_NAME
        log_progress("flying the S500 in gusts")
        fly_demo(log, seed=seed)
        demo = identify_demo(read(log), seed=seed)
        demo = replace(demo, identifications=tuple(with_command(result) for result in demo.identifications))
        log_progress("writing the report")
        title = "S500 in hover: a simulated flight, identified"
        for result in demo.identifications:
            write_results(folder / result.name, result, title=result.name, truth=demo.truth)
        write_overview_report(folder / "report.html", demo.identifications, title=title, truth=demo.truth)
        if find_spec("matplotlib") is not None:
            from rotorid.plot.paper import overview_png

            write_atomically(folder / "overview.png", overview_png(demo.identifications))
        print_if_asked(folder, paper)
        if not keep_log:
            log.unlink()
    if output.json:
        from rotorid.documents.result import result_document

        documents = ",\n".join(
            result_document(result).model_dump_json(by_alias=True) for result in demo.identifications
        )
        sys.stdout.write(f"[{documents}]\n")
    elif not output.quiet:
        _print(demo, made.folder, verbose=output.verbose)


def _print(demo: Demonstration, folder: Path, *, verbose: bool) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console, print_table
    from rotorid.flying.demo import LOG_NAME

    console = output_console()
    table = Table(title="identified and true values", title_justify="left", box=None, pad_edge=False)
    distances = demo.distances()
    for name in ("model", "parameter", "identified", "± std", "true", "unit", "error"):
        table.add_column(name, justify="left" if name in ("model", "parameter", "unit") else "right")
    rows = []
    for result in demo.identifications:
        for name, parameter in result.parameters.items():
            truth = demo.truth.get(name)
            if parameter.status == "dropped" and not truth:
                continue
            value, std = error_columns(parameter.value, parameter.std, digits=5)
            rows.append(
                (
                    result.name,
                    name,
                    "dropped" if parameter.status == "dropped" else value,
                    std,
                    "" if truth is None else significant(truth, digits=5),
                    parameter.unit,
                    f"{distances[name]:+.1f} σ" if name in distances else "",
                )
            )
    print_table(table, rows, verbose=verbose, item="parameter", most=_MOST_PARAMETERS)
    contained = sum(abs(distance) <= TWO_SIDED_95 for distance in distances.values())
    console.print(
        f"± is one standard deviation. {contained} of {len(distances)} 95 % intervals contain the true value:\n"
        "the exact linearization at hover in still air."
    )
    if (folder / LOG_NAME).exists():
        console.print(f"log:    {folder / LOG_NAME}", soft_wrap=True, markup=False)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)
    if not (folder / "overview.png").exists():
        say("For a figure as well: pip install 'rotorid[figures]'.")
