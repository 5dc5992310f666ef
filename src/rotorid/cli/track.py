"""``rotorid track LOG``: whether a gain changed in a flight, and when."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder, print_findings, print_lines
from rotorid.cli.options import ForPaper, Log, Map, Only, Output
from rotorid.identifying.settings import TrackSettings
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rotorid.documents.track import TrackDocument
    from rotorid.identifying.tracking import FlightTracking
    from rotorid.results.model import IdentifiedModel

FILE = "track.json"


def track_command(
    log: Log,
    *,
    model: Annotated[
        str,
        Option(
            "--model",
            "rate.roll, rate.pitch, rate.yaw, or a result of the same vehicle (rate.*, axis.*, hover.*).",
            metavar="NAME|RESULT",
            words=("rate.roll", "rate.pitch", "rate.yaw"),
        ),
    ] = "rate.roll",
    settings: TrackSettings,
    map: Map = None,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Find when a gain changed in flight: payload dropped, propellers damaged, battery sagging."""
    from rotorid.data.findings import refusal
    from rotorid.documents.track import track_document
    from rotorid.identifying.tracking import track
    from rotorid.results.provenance import refused

    name = Path(model).name if Path(model).exists() else model
    carry_out(
        [log],
        mapping=map,
        output=output,
        paper=paper,
        folder=default_folder(log, f"track-{name}"),
        file=FILE,
        compute=lambda records: track(records[0], _model(model), settings=settings),
        write=_write,
        refused=lambda error, records: track_document(
            refused(error, records, settings, otherwise=refusal("not_identifiable", model, str(error)))
        ),
        document=track_document,
        show=_print,
    )


def _write(folder: Path, found: FlightTracking) -> None:
    from rotorid.documents.track import track_arrays, track_document
    from rotorid.io.files import write_atomically, write_npz
    from rotorid.report.files import to_json, write_together
    from rotorid.report.track import render_track

    write_together(
        folder,
        {
            FILE: lambda path: write_atomically(path, to_json(track_document(found))),
            "track.npz": lambda path: write_npz(path, track_arrays(found)),
            "report.html": lambda path: write_atomically(path, render_track(found)),
        },
    )


def _model(model: str) -> str | IdentifiedModel:
    """A name, or the model of a result."""
    if not Path(model).exists():
        return model
    from rotorid.documents.result import load

    return load(model)


def _print(document: TrackDocument, folder: Path, *, verbose: bool = False) -> None:
    from rotorid.report.track import sentences

    print_lines(sentences(document), verbose=verbose)
    print_findings(document.findings, verbose=verbose)
    print_lines([f"report: {folder / 'report.html'}"], verbose=True)
