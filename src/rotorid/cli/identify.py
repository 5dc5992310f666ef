"""``rotorid identify``: logs in, a model with bounds, verified, out."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.console import progress, say
from rotorid.cli.options import Json, Logs, Map, Out, Quiet, Seed, Segments, Shifts

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord
    from rotorid.errors import RotoridError
    from rotorid.pipeline.document import ResultDocument
    from rotorid.pipeline.settings import IdentifySettings


def identify_command(
    logs: Logs,
    model: Annotated[str, typer.Option("--model", help="rate.roll, rate.pitch, rate.yaw, rate.vertical or FILE.toml.")],
    band: Annotated[str | None, typer.Option("--band", help="LO:HI in rad/s. [default: what was excited]")] = None,
    windows: Annotated[str | None, typer.Option("--windows", help="S,S,... window lengths in seconds.")] = None,
    coherence: Annotated[
        float | None, typer.Option("--coherence", help="Least coherence of a point. [default: 0.6 direct, 0.4 joint]")
    ] = None,
    estimate: Annotated[str, typer.Option("--estimate", help="auto, direct or joint.")] = "auto",
    instrument: Annotated[
        str | None, typer.Option("--instrument", help="CHANNEL,... to use as instruments, one for each input.")
    ] = None,
    fix: Annotated[list[str] | None, typer.Option("--fix", help="NAME=VALUE to hold. Repeatable.")] = None,
    segment: Segments = None,
    shift: Shifts = None,
    verify: Annotated[
        list[Path] | None, typer.Option("--verify", help="A log kept unseen, to judge the model on. Repeatable.")
    ] = None,
    map: Map = None,
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Identify a model from flight logs: responses, bounds, verification, report."""
    from rotorid.errors import InsufficientDataError
    from rotorid.io.registry import read
    from rotorid.pipeline.identify import identify, refused
    from rotorid.pipeline.resolve import resolve_model
    from rotorid.report.output import to_json, write_results

    settings = _settings(band, windows, coherence, estimate, instrument, fix, segment, shift, seed)
    structure = resolve_model(model)
    folder = out or Path("rotorid-out") / _file_name(f"{_stem(logs[0])}-{structure.name}")
    command = ["rotorid", *sys.argv[1:]]
    records: list[FlightRecord] = []
    try:
        with progress(quiet=quiet) as tell:
            for log in logs:
                tell(f"reading {log.name}")
                records.append(read(log, mapping=map))
            others = [read(log, mapping=map) for log in verify or ()]
            result = identify(records, structure, settings=settings, verify=others, command=command, progress=tell)
            tell("writing the report")
            write_results(folder, result, title=f"{structure.name} from {', '.join(log.name for log in logs)}")
    except InsufficientDataError as error:
        document = refused(error, records, structure, settings=settings, command=command)
        if json:
            sys.stdout.write(to_json(document))
        _say_refused(error, document, folder, quiet=quiet)
        raise typer.Exit(1) from None
    if json:
        sys.stdout.write(to_json(result.document))
    elif not quiet:
        print_result(result.document, folder)


def _settings(
    band: str | None,
    windows: str | None,
    coherence: float | None,
    estimate: str,
    instrument: str | None,
    fix: Sequence[str] | None,
    segment: Sequence[str] | None,
    shift: Sequence[str] | None,
    seed: int,
) -> IdentifySettings:
    from rotorid.pipeline.settings import (
        IdentifySettings,
        parse_band,
        parse_fix,
        parse_numbers,
        parse_segment,
        parse_shifts,
    )

    return IdentifySettings(
        band_rad_s=parse_band(band) if band else None,
        windows_s=parse_numbers(windows) if windows else (),
        coherence=coherence,
        estimate=estimate,  # type: ignore[arg-type]
        instruments=tuple(instrument.split(",")) if instrument else (),
        fix=parse_fix(tuple(fix or ())),
        segments=tuple(parse_segment(text) for text in segment or ()),
        shifts=parse_shifts(tuple(shift or ())),
        seed=seed,
    )


def _say_refused(error: RotoridError, document: ResultDocument, folder: Path, *, quiet: bool) -> None:
    say(f"rotorid: {error}")
    for finding in document.findings:
        if not quiet and finding.severity != "info":
            say(f"  {finding.kind}: {finding.message}")
    if (folder / "result.json").exists():
        say(f"rotorid: the results in {folder} are those of an earlier run")


def _file_name(text: str) -> str:
    """Text as the name of a folder: a model file may call itself anything."""
    return re.sub(r"[^\w.+-]+", "_", text).lstrip(".") or "result"


def _stem(log: Path) -> str:
    """Name of a log without the extensions of its compression and its format."""
    packed = log.suffix.lower() in (".gz", ".xz", ".bz2", ".zip")
    return Path(log.stem if packed else log.name).stem


def print_result(document: ResultDocument, folder: Path) -> None:
    """A result for a person: parameters, cost, checks, findings, where the files are."""
    from rich.table import Table

    from rotorid.cli.console import output_console

    console = output_console()
    table = Table(title=document.model, title_justify="left", box=None, pad_edge=False)
    for name, justify in (("parameter", "left"), ("value", "right"), ("± std", "right"), ("unit", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name, justify in (("CR %", "right"), ("I %", "right"), ("", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name, parameter in document.parameters.items():
        table.add_row(
            name,
            f"{parameter.value:.5g}",
            "" if parameter.std is None else f"{parameter.std:.2g}",
            parameter.unit,
            "" if parameter.cramer_rao_percent is None else f"{parameter.cramer_rao_percent:.0f}",
            "" if parameter.insensitivity_percent is None else f"{parameter.insensitivity_percent:.0f}",
            parameter.status,
        )
    console.print(table)
    if document.cost is not None:
        for pair, cost in document.cost.pairs.items():
            low, high = cost.band_rad_s
            console.print(f"cost of {pair} {cost.value:.1f} over {low:.2g} to {high:.3g} rad/s (up to 50 is excellent)")
    for record, outputs in document.verification.records.items():
        scores = ", ".join(f"{name} TIC {s.tic:.2f}, fit {s.nrmse_fit_percent:.0f} %" for name, s in outputs.items())
        console.print(f"unseen {record}: {scores}")
    for record, cost_value in document.verification.frequency.items():
        console.print(f"unseen {record}: cost {cost_value:.1f}")
    for finding in document.findings:
        if finding.severity != "info":
            console.print(f"[bold]{finding.severity}[/bold] {finding.kind}: ", end="")
            console.print(finding.message, markup=False)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)
