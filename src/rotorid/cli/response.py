"""``rotorid response``: frequency responses of logs, and the margins of their loops."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder
from rotorid.cli.options import ForPaper, Logs, Map, Output
from rotorid.errors import UsageError
from rotorid.settings.measuring import ResponseSettings
from rotorid.settings.option import Option
from rotorid.settings.parsing import parse_channels

if TYPE_CHECKING:
    from rotorid.documents.response import LoopDocument, ResponseDocument
    from rotorid.plot.curves import Frequency


def response_command(
    logs: Logs,
    *,
    inputs: Annotated[
        str | None,
        Option(
            "--inputs",
            "Input channels, such as roll_command. [default: the excited set-points, else commands]",
            "Channels",
            metavar="CHANNEL,...",
        ),
    ] = None,
    outputs: Annotated[
        str | None,
        Option(
            "--outputs",
            "Output channels, such as p,ay. [default: those of the set-points]",
            "Channels",
            metavar="CHANNEL,...",
        ),
    ] = None,
    settings: ResponseSettings,
    map: Map = None,
    output: Output,
    paper: ForPaper,
) -> None:
    """Measure frequency responses, and the crossover, margins and bandwidth of each loop."""
    from rotorid.documents.response import response_document
    from rotorid.loops.responses import refused_response, response
    from rotorid.report.files import write_responses
    from rotorid.report.publication import of_responses

    if (inputs is None) is not (outputs is None):
        raise UsageError(
            f"{'--outputs' if inputs is None else '--inputs'} is used alone",
            needed="--inputs and --outputs, or neither of them for what was excited",
        )
    drivers = () if inputs is None else parse_channels(inputs, option="--inputs")
    answers = () if outputs is None else parse_channels(outputs, option="--outputs")
    title = f"Responses from {', '.join(log.name for log in logs)}"
    carry_out(
        logs,
        mapping=map,
        output=output,
        folder=default_folder(logs, "-".join(["response", *drivers, *answers])),
        file="response.json",
        compute=lambda records: response(records, inputs=drivers, outputs=answers, settings=settings),
        write=lambda folder, result: write_responses(folder, result, title=title),
        refused=lambda error, records: response_document(
            refused_response(error, records, inputs=drivers, outputs=answers, settings=settings)
        ),
        document=response_document,
        show=_print,
        paper=paper,
        publication=of_responses,
    )


def _print(document: ResponseDocument, folder: Path, *, verbose: bool = False) -> None:
    """The answer on each loop, usable bands and findings; with ``verbose`` all numbers of the loops."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings, print_table
    from rotorid.documents.response import loops_of
    from rotorid.report.frame import frequency_of
    from rotorid.report.response import loop_answer

    console, frequency = output_console(), frequency_of(document.provenance.inputs)
    for axis, _, loop in loops_of(document.loops):
        answer = loop_answer(axis, loop, frequency=frequency)
        console.print(f"{answer.headline} {answer.sentence}", markup=False, highlight=False, soft_wrap=True)
        if verbose:
            _print_loop(axis, loop, frequency)
    if document.loops:
        console.print("± is one standard deviation; review and tune print 95 % intervals.\n", style="dim", markup=False)
    with_instrument = f" with {', '.join(document.instruments)}" if document.instruments else ""
    console.print(f"{document.estimate} estimate{with_instrument}", markup=False, highlight=False)
    table = Table(box=None, pad_edge=False)
    table.add_column("response", justify="left")
    for name in (f"usable [{frequency}]", "points", "coherence", "error [%]", "direct differs by dB", "unit"):
        table.add_column(name, justify="right" if name != "unit" else "left")
    rows = []
    for name, pair in document.pairs.items():
        if pair.band_rad_s is None:
            rows.append((name, "nothing", "", "", "", "", pair.unit))
            continue
        low, high = (end / (2.0 * math.pi) if frequency == "Hz" else end for end in pair.band_rad_s)
        difference = pair.direct_difference_db
        rows.append(
            (
                name,
                f"{low:.2g} to {high:.3g}",
                str(pair.points),
                f"{pair.mean_coherence:.2f}",
                f"{100.0 * (pair.mean_random_error or 0.0):.1f}",
                "" if difference is None else f"{difference:.1f}",
                pair.unit,
            )
        )
    print_table(table, rows, verbose=verbose, item="response")
    for name, removed in document.filters_removed.items():
        console.print(f"removed from {name}: {removed.words}", markup=False, highlight=False, soft_wrap=True)
    print_findings(document.findings, verbose=verbose)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


def _print_loop(axis: str, loop: LoopDocument, frequency: Frequency) -> None:
    from rotorid.cli.console import output_console
    from rotorid.report.response import LOOP_SCOPES, loop_rows, unseen

    console = output_console()
    console.print(f"{axis} {LOOP_SCOPES[loop.scope]} ({loop.method})", markup=False, highlight=False, soft_wrap=True)
    for row in loop_rows(loop, frequency=frequency):
        console.print(f"  {row.words}: {row.value} {row.unit}".rstrip(), markup=False, highlight=False)
    for missing in unseen(loop):
        console.print(f"  {missing.words}: {missing.reason}", markup=False, highlight=False, soft_wrap=True)
