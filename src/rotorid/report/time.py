"""A fit in time on the page: records measured and simulated, residuals, and the frequency domain beside.

A cross-validation is a table: the model of a row was identified on its records and is scored on that of each column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.quantity import MISSING, significant, unit, with_error
from rotorid.documents.result import ResultDocument
from rotorid.plot.figure import quantity
from rotorid.plot.time import residual_memory, simulated
from rotorid.report.frame import Picture
from rotorid.report.parts import Shown, points_of
from rotorid.report.words import percent_verdict
from rotorid.results.summary import CrossValidationSummary, FoldSummary, OrderChoice
from rotorid.results.verdicts import Verdict

_FAR_SIGMAS = 3.0
"""Standard deviations between the values of time and frequency from which they are marked."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordRow:
    """A fitted record: when, how long, and how much of each output the model explains."""

    record: str
    interval: str
    samples: str
    rate: str
    pieces: str
    fits: tuple[Verdict, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class BesideRow:
    """A parameter in time and in the frequency domain."""

    name: str
    time: str
    frequency: str
    unit: str
    distance: str
    far: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class EquationRow:
    """An equation of motion: how much of its left side is explained, and how well unseen rows are predicted."""

    name: str
    explained: str
    misfit: str
    press: str


@dataclass(frozen=True, kw_only=True, slots=True)
class MinimumRow:
    """Another minimum that the search met."""

    cost: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class OrderLine:
    """A black box of one order, as words."""

    order: int
    parameters: int
    fitted: str
    unseen: str
    behind: str
    aic: str
    bic: str
    color: str
    refused: str
    chosen: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class OrderTable:
    """The orders that were compared, and what was made of it."""

    lines: tuple[OrderLine, ...]
    words: str


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeFits:
    """What a page shows of a fit in time."""

    outputs: tuple[str, ...]
    rows: tuple[RecordRow, ...]
    pictures: tuple[Picture, ...]
    memory: Picture | None
    beside: tuple[BesideRow, ...]
    held: bool
    minima: tuple[MinimumRow, ...]
    equations: tuple[EquationRow, ...]
    free: tuple[str, ...]
    noise: str
    information: str
    orders: OrderTable | None = None

    @property
    def all_pictures(self) -> tuple[Picture, ...]:
        """All of its figures."""
        return (*self.pictures, *((self.memory,) if self.memory else ()))


def time_fits(shown: Shown, *, key: str) -> TimeFits | None:
    """What to show of a fit in time; nothing for one in the frequency domain.

    Parameters
    ----------
    shown
        The model with its document.
    key
        Prefix of the identifiers of its pictures.
    """
    document = shown.document
    if not shown.data.simulated:
        return None
    free = tuple(name for name, one in document.parameters.items() if one.status == "free")
    return TimeFits(
        outputs=tuple(quantity(name).words for name in document.outputs),
        rows=_record_rows(document),
        pictures=_pictures(shown, key),
        memory=_memory(document, f"{key}-memory"),
        beside=_beside(document),
        held=any(one.hold_s for one in (document.frequency_fit or {}).values()),
        minima=tuple(
            MinimumRow(cost=significant(one.cost), values=tuple(significant(one.parameters.get(name)) for name in free))
            for one in document.minima
        ),
        equations=_equations(document),
        free=free,
        noise=_noise(document),
        information=_information(document),
        orders=_orders(document),
    )


def _record_rows(document: ResultDocument) -> tuple[RecordRow, ...]:
    return tuple(
        RecordRow(
            record=one.record,
            interval=f"{one.start_s:.2f} to {one.stop_s:.2f} s",
            samples=str(one.samples),
            rate=f"{significant(one.sample_rate_hz, digits=4)} Hz",
            pieces=str(one.pieces),
            fits=tuple(percent_verdict(one.fit_percent[name]) for name in document.outputs if name in one.fit_percent),
        )
        for one in document.records
    )


def _pictures(shown: Shown, key: str) -> tuple[Picture, ...]:
    document = shown.document
    traces = sum(2 * len(one.measured) + len(one.inputs) for one in shown.data.simulated)
    return tuple(
        Picture(
            key=f"{key}-{number}",
            description=f"Outputs measured and simulated, and inputs, over time in {one.record}",
            figure=simulated(
                one.time_s,
                one.inputs,
                one.measured,
                one.simulated,
                input_names=document.inputs,
                output_names=document.outputs,
                held=document.hold == "zero",
                most=points_of(traces),
            ),
        )
        for number, one in enumerate(shown.data.simulated)
    )


def _memory(document: ResultDocument, key: str) -> Picture | None:
    if document.residuals is None:
        return None
    shown = document.residuals
    count = max((len(values) for values in shown.autocorrelation.values()), default=0)
    if count < 2:
        return None
    return Picture(
        key=key,
        description="Autocorrelation of the residuals of every output",
        figure=residual_memory(
            np.arange(count, dtype=np.float64) * shown.step_s,
            {name: np.array(values) for name, values in shown.autocorrelation.items()},
            chance=shown.chance,
        ),
    )


def _beside(document: ResultDocument) -> tuple[BesideRow, ...]:
    rows = []
    for name, other in (document.frequency_fit or {}).items():
        one = document.parameters[name]
        if one.status != "free":
            continue
        distance = None
        if one.std and other.std:
            distance = abs(one.value + other.hold_s - other.value) / float(np.hypot(one.std, other.std))
        rows.append(
            BesideRow(
                name=name,
                time=with_error(one.value, one.std),
                frequency=with_error(other.value, other.std),
                unit=unit(one.unit),
                distance=MISSING if distance is None else f"{distance:.1f} σ",
                far=distance is not None and distance > _FAR_SIGMAS,
            )
        )
    return tuple(rows)


def _equations(document: ResultDocument) -> tuple[EquationRow, ...]:
    return tuple(
        EquationRow(
            name=one.name.replace("'", "′"),
            explained=f"{100.0 * one.r_squared:.2f} %",
            misfit=f"{100.0 * one.misfit:.2g} %",
            press=significant(one.press),
        )
        for one in document.equations
    )


def _noise(document: ResultDocument) -> str:
    parts: Sequence[str] = [
        f"{quantity(name).words} {significant(value * quantity(name).factor)} {quantity(name).unit}".rstrip()
        for name, value in (document.noise or {}).items()
    ]
    return f"Standard deviation of the output errors: {', '.join(parts)}." if parts else ""


def _orders(document: ResultDocument) -> OrderTable | None:
    choice = document.orders
    if choice is None:
        return None

    def plain(value: float | None, digits: int) -> str:
        return "" if value is None else f"{value:.{digits}f}"

    lines = tuple(
        OrderLine(
            order=one.order,
            parameters=one.parameters,
            fitted=plain(one.fitted_percent, 1),
            unseen="" if one.refused else with_error(one.unseen_percent, one.unseen_std),
            behind="" if one.refused else with_error(one.behind_percent, one.behind_std),
            aic=plain(one.aic, 0),
            bic=plain(one.bic, 0),
            color=plain(one.color, 2),
            refused=one.refused,
            chosen=one.order == choice.order,
        )
        for one in choice.rows
    )
    return OrderTable(lines=lines, words=order_words(choice))


def order_words(choice: OrderChoice) -> str:
    """What was made of a comparison of orders, in a sentence."""
    if choice.best == choice.order:
        return (
            f"Order {choice.order} is proposed: no order does better on what it has not seen, and no smaller so well."
        )
    return (
        f"Order {choice.order} is proposed: order {choice.best} does best on what it has not seen, but by no more than "
        "the standard error of the difference, and no smaller order does as well."
    )


def _information(document: ResultDocument) -> str:
    if document.information is None:
        return ""
    one = document.information
    return (
        f"{one.numbers} numbers were estimated; Akaike's criterion is {significant(one.aic, digits=5)}, Schwarz's "
        f"{significant(one.bic, digits=5)}, for comparing models on the same records."
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class CrossedCell:
    """Mean fit over the outputs of one record; quiet where the record was seen."""

    verdict: Verdict | None
    seen: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class CrossedRow:
    """One identification."""

    name: str
    cells: tuple[CrossedCell, ...]
    mean: str
    cause: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Crossed:
    """What the page says of a cross-validation."""

    records: tuple[str, ...]
    rows: tuple[CrossedRow, ...]
    words: str


def crossed(document: CrossValidationSummary | None) -> Crossed | None:
    """The table of a cross-validation, and its sentence."""
    if document is None:
        return None
    return Crossed(
        records=tuple(document.records),
        rows=tuple(_row(fold, document.records) for fold in document.folds),
        words=_words(document),
    )


def _row(fold: FoldSummary, records: Sequence[str]) -> CrossedRow:
    return CrossedRow(
        name=", ".join(fold.identified) if len(fold.identified) == 1 else f"all but {', '.join(fold.unseen)}",
        cells=tuple(_cell(fold, name) for name in records),
        mean=_with_spread(fold.mean_percent, fold.spread_percent),
        cause=fold.cause,
    )


def _cell(fold: FoldSummary, record: str) -> CrossedCell:
    percents = [
        score.nrmse_fit_percent for score in fold.scores.get(record, {}).values() if score.nrmse_fit_percent is not None
    ]
    verdict = percent_verdict(sum(percents) / len(percents)) if percents else None
    return CrossedCell(verdict=verdict, seen=record in fold.identified)


def _with_spread(mean: float | None, spread: float | None) -> str:
    return MISSING if mean is None else f"{with_error(mean, spread, digits=3)} %"


def _words(document: CrossValidationSummary) -> str:
    how = (
        "Identified on each record alone and scored on all others."
        if document.kind == "each"
        else "Identified on all records but one and scored on that one."
    )
    ahead = (
        ""
        if document.horizon_s is None
        else f" The models are unstable: they predicted {document.horizon_s:.2g} s ahead, again and again."
    )
    within = (
        ""
        if document.band_rad_s is None
        else f" Only what lies within {' to '.join(significant(edge) for edge in document.band_rad_s)} rad/s counts."
    )
    looks = (
        ""
        if document.band_rad_s is None or document.horizon_s is None
        else " That filter has no phase and shows a prediction a little of what comes, so these scores are higher than "
        "those of a prediction in flight."
    )
    mean = f" Unseen records: {_with_spread(document.mean_percent, document.spread_percent)} on average."
    best = document.best
    chosen = (
        ""
        if best is None
        else f" Best to identify on is {best.record} with {best.mean_percent:.1f} %, which is optimistic: it was "
        "chosen by these very scores."
    )
    return f"{how}{ahead}{within}{looks}{mean}{chosen}"
