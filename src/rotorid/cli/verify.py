"""``rotorid verify``: an identified model and other logs in, a judgment out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.console import default_folder, progress, say_refused
from rotorid.cli.options import (
    Band,
    Coherence,
    Estimate,
    Instrument,
    Json,
    Logs,
    Map,
    Out,
    Quiet,
    Segments,
    Shifts,
    Windows,
    measure_choices,
)

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord
    from rotorid.pipeline.settings import VerifySettings
    from rotorid.pipeline.verify_document import VerifyDocument
    from rotorid.verification.sampled import LowPass

FILE, REPORT = "verification.json", "report.html"


def verify_command(
    result: Annotated[Path, typer.Argument(help="What identify wrote: its folder, result.json or model.toml.")],
    logs: Logs,
    band: Band = None,
    windows: Windows = None,
    coherence: Coherence = None,
    estimate: Estimate = "auto",
    instrument: Instrument = None,
    segment: Segments = None,
    shift: Shifts = None,
    low_pass: Annotated[
        str, typer.Option("--low-pass", help="First-order low-pass on both sides in rad/s, auto or none.")
    ] = "auto",
    scale: Annotated[
        float | None, typer.Option("--scale", help="Full-scale rotor diameter over the size of the vehicle.")
    ] = None,
    controller: Annotated[
        Path | None, typer.Option("--controller", help="TOML file with the gains of each axis, to fly in closed loop.")
    ] = None,
    map: Map = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Judge an identified model on data that it has not seen."""
    from rotorid.errors import InsufficientDataError
    from rotorid.io.files import write_atomically
    from rotorid.io.registry import read
    from rotorid.pipeline.candidate import read_candidate
    from rotorid.pipeline.verification import refused_verification, verify
    from rotorid.report.files import to_json, write_together
    from rotorid.report.verification import render_verification

    settings = _settings(band, windows, coherence, estimate, instrument, segment, shift, low_pass, scale, controller)
    candidate = read_candidate(result)
    folder = out or default_folder(logs[0], f"verify-{candidate.structure.name}")
    command = ["rotorid", *sys.argv[1:]]
    records: list[FlightRecord] = []
    try:
        with progress(quiet=quiet) as tell:
            for log in logs:
                tell(f"reading {log.name}")
                records.append(read(log, mapping=map))
            verified = verify(candidate, records, settings=settings, command=command)
            text = to_json(verified.document)
            tell("drawing the report")
            page = render_verification(verified, title=f"{candidate.structure.name} on unseen flight")
            write_together(
                folder,
                {
                    FILE: lambda path: write_atomically(path, text),
                    REPORT: lambda path: write_atomically(path, page),
                },
            )
    except InsufficientDataError as error:
        document = refused_verification(error, records, candidate, settings=settings, command=command)
        if json:
            sys.stdout.write(to_json(document))
        say_refused(error, document.findings, folder / FILE, quiet=quiet)
        raise typer.Exit(1) from None
    if json:
        sys.stdout.write(text)
    elif not quiet:
        _print(verified.document, folder)


def _settings(
    band: str | None,
    windows: str | None,
    coherence: float | None,
    estimate: str,
    instrument: str | None,
    segment: Sequence[str] | None,
    shift: Sequence[str] | None,
    low_pass: str,
    scale: float | None,
    controller: Path | None,
) -> VerifySettings:
    from rotorid.pipeline.candidate import read_controllers
    from rotorid.pipeline.settings import VerifySettings

    return VerifySettings(
        **measure_choices(
            band=band,
            windows=windows,
            coherence=coherence,
            estimate=estimate,
            instrument=instrument,
            segment=segment,
            shift=shift,
        ),
        scale=scale,
        vibration_filter=_low_pass(low_pass),
        controllers=read_controllers(controller) if controller else {},
    )


def _low_pass(text: str) -> LowPass:
    from rotorid.errors import UsageError

    if text in ("auto", "none"):
        return None if text == "none" else "auto"
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"the low-pass {text!r} came", needed="a cutoff in rad/s, auto or none") from None


def _print(document: VerifyDocument, folder: Path) -> None:
    """A judgment for a person: scores of each maneuver, costs of each response, findings, where the file is."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings

    console = output_console()
    table = Table(title=f"{document.model} on unseen maneuvers", title_justify="left", box=None, pad_edge=False)
    for name in ("maneuver", "output"):
        table.add_column(name, justify="left")
    ahead = sorted({horizon.horizon_s for one in document.maneuvers for horizon in one.ahead})
    over = [f"TIC {horizon_s:.2g} s ahead" for horizon_s in ahead]
    for name in ("TIC", "fit %", *over, "holds s", "TIC closed loop", "verdict"):
        table.add_column(name, justify="left" if name == "verdict" else "right")
    for one in document.maneuvers:
        by_horizon = {horizon.horizon_s: horizon.outputs for horizon in one.ahead}
        for output, scores in one.scores.items():
            seen = [by_horizon.get(horizon_s, {}).get(output) for horizon_s in ahead]
            table.add_row(
                f"{one.record}: {one.axis} {one.kind} at {one.start_s:.1f} s",
                output if output in one.moved else f"({output})",
                f"{scores.tic:.2f}",
                f"{scores.nrmse_fit_percent:.0f}",
                *("" if item is None else f"{item.tic:.2f}" for item in seen),
                f"{one.holds_s[output]:.2g}" if output in one.holds_s else "",
                f"{one.closed_loop.scores[output].tic:.2f}" if one.closed_loop else "",
                one.verdict,
            )
    if document.maneuvers:
        console.print(table)
        console.print("an output in parentheses hardly moved in that maneuver and is not judged")
        worst = max(one.j_rms for one in document.maneuvers)
        console.print(f"J_rms up to {worst:.2f} (degrees and feet){_guideline(document)}", highlight=False)
    for sweep in document.frequency:
        for pair, cost in sweep.pairs.items():
            low, high = cost.band_rad_s
            console.print(
                f"{', '.join(sweep.records)}: {pair} cost {cost.value:.1f} over {low:.2g} to {high:.3g} rad/s "
                "(up to 100 is acceptable)",
                markup=False,
                highlight=False,
            )
    print_findings(document.findings)
    console.print(f"report: {folder / REPORT}", soft_wrap=True, markup=False)
    console.print(f"file: {folder / FILE}", soft_wrap=True, markup=False)


def _guideline(document: VerifyDocument) -> str:
    guideline = document.j_rms_guideline
    if guideline is None:
        return "; 1 to 2 is acceptable at full scale"
    return (
        f"; acceptable up to {guideline.root[0]:.3g} to {guideline.root[1]:.3g} for N = {guideline.scale:g} by its "
        f"root, {guideline.printed[0]:.3g} to {guideline.printed[1]:.3g} as it is found in print"
    )
