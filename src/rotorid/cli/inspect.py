"""``rotorid inspect``: what is in a log, and what it can support."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rotorid.cli.options import Json, Log, Map, Quiet

if TYPE_CHECKING:
    from rotorid.pipeline.inspection import InspectDocument


def inspect_command(log: Log, map: Map = None, json: Json = False, quiet: Quiet = False) -> None:
    """Say what is in a log and what it can support: channels, rates, gaps, excitations."""
    from rotorid.io.registry import read
    from rotorid.pipeline.inspection import inspect
    from rotorid.report.output import to_json

    document = inspect(read(log, mapping=map))
    if json:
        sys.stdout.write(to_json(document))
    elif not quiet:
        _print(document)


def _print(document: InspectDocument) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console

    console = output_console()
    firmware = f", {document.firmware}" if document.firmware else ""
    console.print(f"[bold]{document.name}[/bold]  {document.format}{firmware}")
    console.print(
        f"{document.start_s:.2f} to {document.stop_s:.2f} s on the log's clock, {document.parameters} parameters\n"
    )
    topics = Table(box=None, pad_edge=False)
    for name in ("topic", "rate", "from", "to", "gaps", "channels"):
        topics.add_column(name, justify="right" if name in ("rate", "from", "to", "gaps") else "left")
    for topic in dict.fromkeys(channel.topic for channel in document.channels):
        rows = [channel for channel in document.channels if channel.topic == topic]
        first = rows[0]
        topics.add_row(
            topic,
            f"{first.rate_hz:.0f} Hz",
            "" if first.start_s is None else f"{first.start_s:.1f}",
            "" if first.stop_s is None else f"{first.stop_s:.1f}",
            f"{first.gaps} (longest {first.longest_gap_s:.2f} s)" if first.gaps else "0",
            " ".join(row.name for row in rows),
        )
    console.print(topics)
    console.print("\n[bold]excitations[/bold]")
    for item in document.excitations:
        band = f"{item.band_rad_s[0]:.2g} to {item.band_rad_s[1]:.3g} rad/s" if item.band_rad_s else ""
        console.print(
            f"  {item.axis:<7}{item.kind:<14}{item.start_s:9.2f} to {item.stop_s:9.2f} s  {band:<20} {item.origin} in "
            f"{item.signal}"
        )
    if not document.excitations:
        console.print("  none found")
    console.print("\n[bold]what it can support[/bold]")
    for model, support in document.supports.items():
        mark = "[green]yes[/green]" if support.possible else "[red]no[/red] "
        remedy = f"; {support.remedy}" if support.remedy else ""
        console.print(f"  {model:<14} {mark}  {support.because}{remedy}")
    for finding in document.findings:
        console.print(f"\n{finding.severity} {finding.kind} ({finding.where}): {finding.message}", markup=False)
