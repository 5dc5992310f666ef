"""``rotorid track LOG``: whether a model holds through a flight, and when it changed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder, output_console, print_findings
from rotorid.cli.options import ForPaper, Log, Map, Only, Output, measured, one_of
from rotorid.data.quantity import with_error

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord
    from rotorid.documents.track import TrackDocument
    from rotorid.identifying.tracking import FlightTracking
    from rotorid.results.model import IdentifiedModel

FILE = "track.json"


def track_command(
    log: Log,
    *,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="NAME|RESULT",
            autocompletion=one_of(["rate.roll", "rate.pitch", "rate.yaw"]),
            help="rate.roll, rate.pitch or rate.yaw; or a result of identify of the same vehicle.",
        ),
    ] = "rate.roll",
    first: Annotated[float, measured("--first", "s", "The part of the flight that all else is compared with.")] = 60.0,
    step: Annotated[float, typer.Option("--step", help="Change of the gain that is looked for, as a share.")] = 0.13,
    thrust_exponent: Annotated[
        float | None,
        typer.Option(
            "--thrust-exponent",
            help="Power of the thrust command by which the gain grows: 0 for linear thrust, 0.8 for quadratic. "
            "[default: from the first seconds]",
        ),
    ] = None,
    map: Map = None,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Follow a model through a flight: payload dropped, propellers damaged, battery sagging."""
    from rotorid.data.findings import refusal
    from rotorid.documents.track import track_arrays, track_document
    from rotorid.identifying.tracking import TrackChoices, track
    from rotorid.io.files import write_atomically, write_npz
    from rotorid.report.files import to_json, write_together
    from rotorid.report.track import render_track
    from rotorid.results.provenance import refused

    choices = TrackChoices(first_s=first, step_share=step, thrust_exponent=thrust_exponent)

    def compute(records: Sequence[FlightRecord]) -> FlightTracking:
        return track(records[0], _model(model), first_s=first, thrust_exponent=thrust_exponent, step_share=step)

    def write(folder: Path, found: FlightTracking) -> None:
        write_together(
            folder,
            {
                FILE: lambda path: write_atomically(path, to_json(track_document(found))),
                "track.npz": lambda path: write_npz(path, track_arrays(found)),
                "report.html": lambda path: write_atomically(path, render_track(found)),
            },
        )

    name = Path(model).name if Path(model).exists() else model
    carry_out(
        [log],
        mapping=map,
        output=output,
        paper=paper,
        folder=default_folder(log, f"track-{name}"),
        file=FILE,
        compute=compute,
        write=write,
        refused=lambda error, records: track_document(
            refused(error, records, choices, otherwise=refusal("not_identifiable", model, str(error)))
        ),
        document=track_document,
        show=_print,
    )


def _model(model: str) -> str | IdentifiedModel:
    """A name, or the model of a result."""
    if not Path(model).exists():
        return model
    from rotorid.documents.result import load

    return load(model)


def _print(document: TrackDocument, folder: Path) -> None:
    from rotorid.report.track import sentences

    console = output_console()
    for sentence in sentences(document):
        console.print(sentence, markup=False, soft_wrap=True)
    if document.gain is not None:
        console.print(
            f"gain at the end over the reference: {with_error(document.gain.value, document.gain.std)}", markup=False
        )
    print_findings(document.findings)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)
