"""``rotorid delay``: delays between channels of logs, to a fraction of a sample."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder
from rotorid.cli.options import Logs, Map, Output
from rotorid.data.quantity import significant, with_interval
from rotorid.settings.measuring import MeasureSettings
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord
    from rotorid.documents.delay import DelayDocument, DelayEstimateDocument
    from rotorid.identifying.delays import Delays

FILE = "delay.json"
_METHODS = {
    "records": "fitted to the records",
    "response": "fitted to the frequency response",
    "samples": "in whole samples",
}


def delay_command(
    logs: Logs,
    *,
    input: Annotated[
        str | None,
        Option("--input", "Input channel. [default: every set-point that moves]", "Channels", metavar="CHANNEL"),
    ] = None,
    answer: Annotated[
        str | None,
        Option(
            "--output",
            "Output channel. [default: the channel that follows the set-point]",
            "Channels",
            metavar="CHANNEL",
        ),
    ] = None,
    order: Annotated[
        int | None,
        Option("--order", "Order of the lag, 1 to 4. [default: what the data show]", "Channels", metavar="N"),
    ] = None,
    settings: MeasureSettings,
    map: Map = None,
    output: Output,
) -> None:
    """Estimate delays between channels to a fraction of a sample, with intervals.

    Exit code 1 where the data contradict a delay; that pair is left out, with the reason.
    """
    from rotorid.documents.delay import delay_document
    from rotorid.identifying.delays import delay, refused_delay
    from rotorid.report.files import write_together

    results: list[Delays] = []

    def compute(records: Sequence[FlightRecord]) -> Delays:
        results.append(delay(records, input=input, output=answer, order=order, settings=settings))
        return results[-1]

    carry_out(
        logs,
        mapping=map,
        output=output,
        folder=default_folder(logs, "-".join(["delay", *filter(None, (input, answer))])),
        file=FILE,
        compute=compute,
        write=lambda folder, result: write_together(folder, {FILE: delay_document(result)}),
        refused=lambda error, records: delay_document(refused_delay(error, records, settings=settings)),
        document=delay_document,
        show=_print,
    )
    if any(finding.severity == "error" for result in results for finding in result.findings):
        raise typer.Exit(1)


def _print(document: DelayDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print the delay of each pair, those of other methods, findings, and where the file is."""
    from rich.table import Table

    from rotorid.cli.console import print_findings, print_lines, print_table

    table = Table(box=None, pad_edge=False)
    for name in ("output behind input", "delay in ms", "95 % in ms", "samples", "what it is"):
        table.add_column(name, justify="left" if name in ("output behind input", "what it is") else "right")
    rows = []
    sent = {(rate.record, f"{rate.output}/{rate.input}"): rate.rate_hz for rate in document.rates}
    for name, pair in document.pairs.items():
        rows.append((name.replace("/", " behind "), *_cells(pair.recommended)))
        for log, estimate in pair.records.items():
            shown = _cells(estimate)[:3] if estimate else ("not determined", "", "")
            rate = f", commands at {significant(sent[log, name], digits=2)} Hz" if (log, name) in sent else ""
            rows.append((f"  {log}{rate}", *shown, "lag of the same order"))
    if rows:
        print_table(table, rows, verbose=verbose, item="pair", page="")
    others = [
        f"{name.replace('/', ' behind ')} by other methods: "
        + ", ".join(f"{significant(1e3 * other.delay_s)} ms {_METHODS[other.method]}" for other in pair.others)
        for name, pair in document.pairs.items()
        if pair.others
    ]
    print_lines(others, verbose=verbose, page="")
    print_findings(document.findings, verbose=verbose, page="")
    print_lines([f"result: {folder / FILE}"], verbose=True)


def _cells(estimate: DelayEstimateDocument) -> tuple[str, str, str, str]:
    ends = (None, None) if estimate.interval_s is None else estimate.interval_s
    delay, interval = with_interval(*(None if value is None else 1e3 * value for value in (estimate.delay_s, *ends)))
    return delay, interval, f"{estimate.delay_samples:.2f}", estimate.meaning
