"""The report of ``stitch``: parameters over speed with their bands, and flights through the speeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rotorid.data.quantity import MISSING, significant, unit, with_error
from rotorid.documents.stitched import StitchedDocument, stitched_document
from rotorid.flying.stitching import SpeedCurve, Stitched, ThroughSpeeds
from rotorid.plot.stitched import OverSpeed, over_speed, speed_grid
from rotorid.plot.time import Curve, predictions
from rotorid.report.files import write_together
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, drawn, render
from rotorid.verification.scores import GOOD_TIC

JSON, PAGE = "stitched.json", "report.html"

_DRAWN = ("u", "w", "theta", "q", "pitch_command", "v", "phi", "p")


@dataclass(frozen=True, kw_only=True, slots=True)
class SpeedRow:
    """A parameter: its numbers at each speed as text."""

    name: str
    unit: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class SpeedTable:
    """The parameters of one model over speed."""

    model: str
    speeds: tuple[str, ...]
    rows: tuple[SpeedRow, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class FlightTable:
    """A flight through the speeds: scores as text."""

    title: str
    rows: tuple[tuple[str, str, str], ...]


def speed_tables(document: StitchedDocument) -> tuple[SpeedTable, ...]:
    """A table for each model."""
    tables = []
    for model, curves in document.parameters.items():
        rows = tuple(
            SpeedRow(
                name=name,
                unit=unit(curve.unit),
                values=tuple(
                    "0, dropped" if std is None else with_error(value, std)
                    for value, std in zip(curve.value, curve.std, strict=True)
                ),
            )
            for name, curve in curves.items()
        )
        speeds = tuple(f"{point.speed_m_s:.2f}" for point in document.points if point.model == model)
        tables.append(SpeedTable(model=model, speeds=speeds, rows=rows))
    return tuple(tables)


def flight_tables(document: StitchedDocument) -> tuple[FlightTable, ...]:
    """A table for each flight."""
    return tuple(
        FlightTable(
            title=f"{flown.record}: {flown.speed_m_s[0]:.1f} to {flown.speed_m_s[1]:.1f} m/s in "
            f"{flown.stop_s - flown.start_s:.0f} s",
            rows=tuple(
                (
                    name,
                    MISSING if score.tic is None else f"{score.tic:.3f}",
                    MISSING if score.nrmse_fit_percent is None else significant(score.nrmse_fit_percent),
                )
                for name, score in flown.scores.items()
            ),
        )
        for flown in document.flights
    )


def stitched_summary(document: StitchedDocument) -> tuple[str, ...]:
    """How well the stitched model predicts flights through the speeds, then which models it is made of."""
    lines = []
    for flown in document.flights:
        tics = {name: flown.scores[name].tic or 0.0 for name in ("u", "theta", "q")}
        word = "well" if max(tics.values()) <= GOOD_TIC else "fairly" if min(tics.values()) <= GOOD_TIC else "poorly"
        scores = ", ".join(f"{name} {significant(tic, digits=2)}" for name, tic in tics.items())
        lines.append(
            f"The stitched model predicts {flown.record} {word} from {flown.speed_m_s[0]:.1f} to "
            f"{flown.speed_m_s[1]:.1f} m/s: TIC of {scores} ({GOOD_TIC:g} or less is good)."
        )
    for model in document.parameters:
        speeds = [f"{point.speed_m_s:.1f}" for point in document.points if point.model == model]
        lines.append(f"{model} at {', '.join(speeds[:-1])} and {speeds[-1]} m/s, linearly interpolated.")
    if not document.flights:
        lines.append("Not checked on a flight; add --log LOG with a flight through these speeds.")
    return tuple(lines)


def write_stitched(folder: Path, found: Stitched, *, title: str) -> None:
    """Write ``stitched.json`` and ``report.html``, both or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    """
    document = stitched_document(found)
    write_together(folder, {JSON: document, PAGE: render_stitched(found, document, title=title)})


def render_stitched(found: Stitched, document: StitchedDocument, *, title: str) -> str:
    """The report as one HTML document.

    Parameters
    ----------
    found, document
        The stitched model, and what its file holds.
    """
    curves = [
        Picture(
            key=f"speeds-{number}",
            description=f"Parameters of {model} over forward speed, with bands of 95 %",
            figure=drawn(over_speed, {name: _drawn(curve) for name, curve in parameters.items()}),
        )
        for number, (model, parameters) in enumerate(found.curves.items())
    ]
    flights = [
        Picture(
            key=f"flight-{number}",
            description=f"{flown.record}, measured and predicted by the stitched model",
            figure=drawn(predictions, *_signals(flown)),
        )
        for number, flown in enumerate(found.flights)
    ]
    return render(
        "stitched.html",
        logs=document.provenance.inputs,
        title=title,
        document=document,
        sentences=stitched_summary(document),
        tables=list(zip(speed_tables(document), curves, strict=True)),
        flights=list(zip(flight_tables(document), flights, strict=True)),
        remarks=finding_rows(document.findings),
        pictures=[*curves, *flights],
    )


def _drawn(curve: SpeedCurve) -> OverSpeed:
    grid = speed_grid(curve.speed_m_s)
    value, std = curve.at(grid)
    return OverSpeed(curve.unit, curve.speed_m_s, curve.value, grid, value, std)


def _signals(flown: ThroughSpeeds) -> tuple[list[str], Mapping[str, Curve], Mapping[str, Mapping[str, Curve]]]:
    names = [name for name in _DRAWN if name in flown.measured]
    measured = {name: Curve(flown.time_s, flown.measured[name]) for name in names}
    return names, measured, {"stitched": {name: Curve(flown.time_s, flown.simulated[name]) for name in names}}
