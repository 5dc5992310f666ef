"""Rows of the report's tables: text for the page, and which cells deserve attention."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.data.maneuver import Maneuver
from rotorid.pipeline.document import FindingDocument, ManeuverDocument, ParameterDocument, PoleDocument, ResultDocument
from rotorid.plot.quantity import quantity
from rotorid.report.numbers import MISSING, significant, unit, with_error
from rotorid.report.wording import (
    Verdict,
    cost_verdict,
    finding_heading,
    held_out,
    parameter_words,
    pole_words,
    prediction_verdict,
)
from rotorid.verify.verification import Verification

CRAMER_RAO_GUIDELINE, INSENSITIVITY_GUIDELINE = 20.0, 10.0
FAR_SIGMAS = 3.0
"""A distance from the truth that random errors alone hardly explain."""

_SEVERITIES = ("error", "warning", "info")


@dataclass(frozen=True, slots=True)
class Cell:
    """A number of a table, marked when it is beyond its guideline."""

    text: str
    marked: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class ParameterRow:
    """A parameter with everything that is known about it."""

    name: str
    words: str
    value: str
    unit: str
    cramer_rao: Cell
    insensitivity: Cell
    status: str
    truth: str
    off: Cell


def parameter_rows(document: ResultDocument, truth: Mapping[str, float]) -> tuple[ParameterRow, ...]:
    """One row for each parameter; the truth is looked up as ``model.name`` first, then as ``name``."""
    return tuple(
        ParameterRow(
            name=name,
            words=parameter_words(name),
            value=MISSING if parameter.status == "dropped" else with_error(parameter.value, parameter.std),
            unit=unit(parameter.unit),
            cramer_rao=_percent(parameter.cramer_rao_percent, CRAMER_RAO_GUIDELINE),
            insensitivity=_percent(parameter.insensitivity_percent, INSENSITIVITY_GUIDELINE),
            status=parameter.status,
            truth=significant(known := truth.get(f"{document.model}.{name}", truth.get(name)), digits=4),
            off=_off(parameter, known),
        )
        for name, parameter in document.parameters.items()
    )


def _percent(value: float | None, guideline: float) -> Cell:
    return Cell(significant(value, digits=2), value is not None and value > guideline)


def _off(parameter: ParameterDocument, truth: float | None) -> Cell:
    if truth is None or not parameter.std:
        return Cell("")
    sigmas = abs(parameter.value - truth) / parameter.std
    return Cell(f"{sigmas:.1f} σ", sigmas > FAR_SIGMAS)


@dataclass(frozen=True, kw_only=True, slots=True)
class CostRow:
    """The cost of one response."""

    pair: str
    value: str
    verdict: Verdict
    band: str
    points: str


def cost_rows(document: ResultDocument) -> tuple[CostRow, ...]:
    """Cost of each fitted response, then of each response on unseen sweeps or on the maneuver that was held out."""
    fitted = document.cost.pairs if document.cost else {}
    rows = [
        CostRow(
            pair=pair,
            value=significant(cost.value),
            verdict=cost_verdict(cost.value),
            band=_interval(cost.band_rad_s, "rad/s"),
            points=str(cost.points),
        )
        for pair, cost in fitted.items()
    ]
    unseen = document.verification.frequency.items()
    of = "held-out maneuver" if held_out(document) else "unseen sweeps"
    rows += [
        CostRow(
            pair=f"{pair}, {of}",
            value=significant(value),
            verdict=cost_verdict(value),
            band=MISSING,
            points=MISSING,
        )
        for pair, value in unseen
    ]
    return tuple(rows)


@dataclass(frozen=True, kw_only=True, slots=True)
class ScoreRow:
    """How one output of an unseen maneuver was predicted."""

    output: str
    fit: str
    tic: str
    verdict: Verdict
    rms: str
    shift: str


def score_rows(check: Verification) -> tuple[ScoreRow, ...]:
    """Scores of each output of one verification, in the units of paper."""
    rows = []
    for name, scores in check.scores.items():
        paper = quantity(name)
        rows.append(
            ScoreRow(
                output=paper.words,
                fit=significant(scores.nrmse_fit_percent),
                tic=significant(scores.tic, digits=2),
                verdict=prediction_verdict(scores.tic, scores.nrmse_fit_percent),
                rms=f"{significant(paper.factor * scores.rms)} {paper.unit}",
                shift=f"{significant(paper.factor * scores.reference_shift, digits=2)} {paper.unit}",
            )
        )
    return tuple(rows)


@dataclass(frozen=True, kw_only=True, slots=True)
class ManeuverRow:
    """An excitation on the log's own clock."""

    record: str
    kind: str
    interval: str
    duration: str
    band: str
    origin: str


def maneuver_row(record: str, maneuver: Maneuver | ManeuverDocument) -> ManeuverRow:
    """One maneuver in words."""
    return ManeuverRow(
        record=record,
        kind=f"{maneuver.axis} {maneuver.kind.replace('_', ' ')}",
        interval=f"{maneuver.start_s:.2f} to {maneuver.stop_s:.2f} s",
        duration=f"{maneuver.stop_s - maneuver.start_s:.1f} s",
        band=_interval(maneuver.band_rad_s, "rad/s") if maneuver.band_rad_s else MISSING,
        origin=f"{maneuver.origin} in {maneuver.signal}" if maneuver.signal else maneuver.origin,
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class PoleRow:
    """A mode of the model; a conjugate pair is one."""

    value: str
    frequency: str
    damping: str
    words: str
    unstable: bool


def pole_rows(poles: list[PoleDocument]) -> tuple[PoleRow, ...]:
    """One row for each mode, slow ones first; the lower pole of a conjugate pair is left out."""
    upper = sorted((pole for pole in poles if pole.imag >= 0.0), key=lambda pole: pole.frequency_rad_s)
    return tuple(
        PoleRow(
            value=significant(pole.real) + (f" ± {significant(pole.imag)} j" if pole.imag else ""),
            frequency=significant(pole.frequency_rad_s),
            damping=significant(pole.damping, digits=2),
            words=pole_words(pole),
            unstable=pole.real > 0.0,
        )
        for pole in upper
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class FindingRow:
    """A finding with a heading, and its numbers as text."""

    severity: str
    heading: str
    where: str
    message: str
    numbers: str


def finding_rows(findings: list[FindingDocument]) -> tuple[FindingRow, ...]:
    """Findings, the grave ones first."""
    ordered = sorted(findings, key=lambda finding: _SEVERITIES.index(finding.severity))
    return tuple(
        FindingRow(
            severity=finding.severity,
            heading=finding_heading(finding.kind),
            where=finding.where,
            message=finding.message,
            numbers=", ".join(f"{name} {significant(value, digits=4)}" for name, value in finding.numbers.items()),
        )
        for finding in ordered
    )


def _interval(band: tuple[float, float], of: str) -> str:
    return f"{significant(band[0])} to {significant(band[1])} {of}"
