"""The page of ``simulate RESULT --log``: a model simulated with the inputs of a flight, and the measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from rotorid.data.quantity import significant
from rotorid.documents.flown import FlownDocument, flown_document
from rotorid.flying.flown_models import FlownModel, FlownStretch
from rotorid.plot.figure import quantity
from rotorid.plot.time import flown as flown_figure
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, drawn, render
from rotorid.report.tables import Column, Table
from rotorid.report.words import prediction_verdict
from rotorid.results.verdicts import Verdict

_POSITIONS = ("north", "east", "down")
_VELOCITIES = ("velocity_north", "velocity_east", "velocity_down", "velocity_forward", "velocity_right", "u", "v", "w")


@dataclass(frozen=True, kw_only=True, slots=True)
class FlownScore:
    """Scores of one output, as a row."""

    output: str
    tic: str
    fit: str
    rms: str
    verdict: Verdict | None


@dataclass(frozen=True, kw_only=True, slots=True)
class FlownFlight:
    """One flight on the page."""

    name: str
    interval: str
    pieces: int
    scores: tuple[FlownScore, ...]
    pictures: tuple[Picture, ...]


def render_flown(flown: FlownModel, *, title: str) -> str:
    """The report as one HTML document, which needs no other file and in which no text of a log can act."""
    document = flown_document(flown)
    flights = [_flight(stretch, number) for number, stretch in enumerate(flown.stretches)]
    return render(
        "flown.html",
        logs=document.provenance.inputs,
        title=title,
        document=document,
        sentences=flown_sentences(document),
        flights=flights,
        remarks=finding_rows(document.findings),
        pictures=[picture for flight in flights for picture in flight.pictures],
    )


def pictures_of(flown: FlownModel) -> list[Picture]:
    """All pictures of the page."""
    return [picture for number, stretch in enumerate(flown.stretches) for picture in _flight(stretch, number).pictures]


def flown_sentences(document: FlownDocument) -> tuple[str, ...]:
    """What was found, in sentences."""
    sentences = []
    for flight in document.flights:
        if not flight.scores:
            words = f"{document.model} flew {flight.record} for {significant(flight.stop_s - flight.start_s)} s."
            sentences.append(f"{words} No output was measured for comparison.")
            continue
        best = ", ".join(
            f"{quantity(name).words} {significant(scores.nrmse_fit_percent, digits=2)} %"
            for name, scores in flight.scores.items()
        )
        how = "from the first sample" if flight.pieces == 1 else f"in {flight.pieces} pieces"
        sentences.append(
            f"{document.model} predicts {significant(flight.stop_s - flight.start_s)} s of {flight.record} {how}; "
            f"fit: {best}."
        )
    return tuple(sentences)


def flown_table(document: FlownDocument) -> Table:
    """Scores of each flight and output."""
    rows = [
        (flight.record, flight.start_s, flight.stop_s, name, scores.nrmse_fit_percent, scores.tic, scores.rms)
        for flight in document.flights
        for name, scores in flight.scores.items()
    ]
    return Table(
        name="flown",
        caption="Fit of each output when the model is simulated with the inputs of the log; 100 % is perfect.",
        columns=(
            Column("record", "Record"),
            Column("start_s", "From [s]"),
            Column("stop_s", "To [s]"),
            Column("output", "Output"),
            Column("fit_percent", "Fit [%]"),
            Column("tic", "TIC"),
            Column("rms", "RMS of the error"),
        ),
        rows=tuple(rows),
    )


def _flight(stretch: FlownStretch, number: int) -> FlownFlight:
    return FlownFlight(
        name=stretch.record,
        interval=f"{stretch.maneuver.start_s:.1f} to {stretch.maneuver.stop_s:.1f} s",
        pieces=len(stretch.starts),
        scores=tuple(_scores(stretch)),
        pictures=tuple(_pictures(stretch, number)),
    )


def _scores(stretch: FlownStretch) -> Sequence[FlownScore]:
    return [
        FlownScore(
            output=quantity(name).words,
            tic=significant(scores.tic, digits=2),
            fit=significant(scores.nrmse_fit_percent),
            rms=f"{significant(quantity(name).factor * scores.rms)} {quantity(name).unit}",
            verdict=prediction_verdict(scores.tic, scores.nrmse_fit_percent),
        )
        for name, scores in stretch.scores.items()
    ]


def _kind(name: str) -> str:
    if name in _POSITIONS:
        return "positions"
    return "velocities" if name in _VELOCITIES else "attitude and rates"


def _pictures(stretch: FlownStretch, number: int) -> Sequence[Picture]:
    """A picture of each kind of output: positions, velocities, attitude; the inputs stand below the last."""
    ordered = sorted(stretch.output_names, key=lambda name: ("positions", "velocities").count(_kind(name)) == 0)
    groups = [(kind, list(names)) for kind, names in groupby(ordered, key=_kind)]
    found = []
    for place, (kind, names) in enumerate(groups):
        rows = [stretch.output_names.index(name) for name in names]
        last = place == len(groups) - 1
        found.append(
            Picture(
                key=f"flown-{number}-{kind.partition(' ')[0]}",
                description=(
                    f"{kind.capitalize()} over time in {stretch.record}, measured and of the model with its band"
                ),
                figure=drawn(
                    flown_figure,
                    stretch.time_s,
                    stretch.inputs,
                    stretch.measured[rows],
                    stretch.simulated[rows],
                    (stretch.lower[rows], stretch.upper[rows]),
                    input_names=stretch.input_names if last else (),
                    output_names=names,
                    held=stretch.held,
                ),
            )
        )
    return found
