"""``rotorid response``: logs in, frequency responses with coherence and error out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder, fold
from rotorid.cli.options import ForPaper, Logs, Map, Output
from rotorid.errors import UsageError
from rotorid.settings.measuring import ResponseSettings
from rotorid.settings.option import Option
from rotorid.settings.parsing import parse_channels

if TYPE_CHECKING:
    from rotorid.documents.response import LoopDocument, ResponseDocument


def response_command(
    logs: Logs,
    *,
    inputs: Annotated[
        str | None,
        Option(
            "--inputs",
            "Input channels, such as roll_command. [default: the excited set-points or commands]",
            "Channels",
            metavar="CHANNEL,...",
        ),
    ] = None,
    outputs: Annotated[
        str | None,
        Option(
            "--outputs",
            "Output channels, such as p,ay. [default: the controlled ones]",
            "Channels",
            metavar="CHANNEL,...",
        ),
    ] = None,
    settings: ResponseSettings,
    map: Map = None,
    output: Output,
    paper: ForPaper,
) -> None:
    """Estimate frequency responses with coherence and error, and loop margins."""
    from rotorid.documents.response import response_document
    from rotorid.loops.responses import refused_response, response
    from rotorid.report.files import write_responses
    from rotorid.report.publication import of_responses

    if (inputs is None) is not (outputs is None):
        raise UsageError(
            f"{'--outputs' if inputs is None else '--inputs'} needs {'--inputs' if inputs is None else '--outputs'}",
            remedy="give both, or neither for the excited channels",
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
    """Print what can be used of the responses, margins, findings and where the files are."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings, print_table
    from rotorid.documents.response import loops_of

    console = output_console()
    with_instrument = f" with {', '.join(document.instruments)}" if document.instruments else ""
    console.print(f"{document.estimate} estimate{with_instrument}", markup=False, highlight=False)
    table = Table(box=None, pad_edge=False)
    table.add_column("response", justify="left")
    for name in ("usable in rad/s", "points", "coherence", "error in %", "direct differs by dB", "unit"):
        table.add_column(name, justify="right" if name != "unit" else "left")
    rows, unusable = [], []
    for name, pair in document.pairs.items():
        if pair.band_rad_s is None:
            unusable.append(name)
            continue
        low, high = pair.band_rad_s
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
    if rows:
        print_table(table, rows, verbose=verbose, item="response", most=_MOST_RESPONSES)
    if unusable:
        shown = fold(unusable, verbose=verbose, most=_MOST_NAMES)
        more = f" and {len(unusable) - len(shown)} more" if len(unusable) > len(shown) else ""
        console.print(f"not usable: {', '.join(shown)}{more}", markup=False, highlight=False)
    if document.loops:
        loops = list(loops_of(document.loops))
        if verbose:
            for axis, _, loop in loops:
                _print_loop(axis, loop)
        else:
            _print_margins([(axis, loop) for axis, _, loop in loops])
        console.print("± is one standard deviation; review and tune print 95 % intervals.", style="dim", markup=False)
    print_findings(document.findings, verbose=verbose)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


_MOST_RESPONSES = 10
_MOST_NAMES = 4
_MARGINS = {
    "crossover_rad_s": "crossover",
    "phase_margin_rad": "phase margin",
    "gain_margin_up": "gain margin",
    "delay_margin_s": "delay margin",
    "disturbance_rejection_bandwidth_rad_s": "rejects up to",
}
"""What a normal run shows of a loop."""


def _print_margins(loops: Sequence[tuple[str, LoopDocument]]) -> None:
    """Print a table with a row for each loop."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_table
    from rotorid.data.quantities import QUANTITIES
    from rotorid.report.response import LOOP_SCOPES

    table = Table(box=None, pad_edge=False)
    table.add_column("loop")
    for name, head in _MARGINS.items():
        table.add_column(f"{head} in {QUANTITIES[name].unit}", justify="right")

    def cell(loop: LoopDocument, name: str) -> str:
        if name in loop.numbers:
            return QUANTITIES[name].with_error(loop.numbers[name].value, loop.numbers[name].std)
        if (bound := loop.bounds.get(name)) is not None:
            return f"{'≥' if bound.at_least else '≤'} {QUANTITIES[name].with_error(bound.value, bound.std)}"
        return ""

    rows = [(f"{axis} {LOOP_SCOPES[loop.scope]}", *(cell(loop, name) for name in _MARGINS)) for axis, loop in loops]
    print_table(table, rows, verbose=False, item="loop", most=_MOST_LOOPS)
    methods = dict.fromkeys(loop.method for _, loop in loops)
    output_console().print(f"margins from: {'; '.join(methods)}", style="dim", markup=False)


_MOST_LOOPS = 6


def _print_loop(axis: str, loop: LoopDocument) -> None:
    from rotorid.cli.console import output_console
    from rotorid.report.response import LOOP_SCOPES, loop_rows, unseen

    console = output_console()
    console.print(f"{axis} {LOOP_SCOPES[loop.scope]} ({loop.method})", markup=False, highlight=False, soft_wrap=True)
    for row in loop_rows(loop):
        console.print(f"  {row.words}: {row.value} {row.unit}".rstrip(), markup=False, highlight=False)
    for missing in unseen(loop):
        console.print(f"  {missing.words}: {missing.reason}", markup=False, highlight=False, soft_wrap=True)
