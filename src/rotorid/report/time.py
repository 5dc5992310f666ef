"""A fit in time on the page: records measured and simulated, residuals, and a comparison with the frequency domain.

A cross-validation is a table: the model of a row was identified on its records and is scored on that of each column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.display import counted, listed
from rotorid.data.quantity import MISSING, significant, unit, with_error
from rotorid.documents.result import ResultDocument
from rotorid.plot.figure import quantity
from rotorid.plot.time import residual_memory, simulated
from rotorid.report.frame import Picture, drawn
from rotorid.report.parts import Shown, points_of
from rotorid.report.words import percent_verdict
from rotorid.results.summary import CrossValidationSummary, FoldSummary, OrderChoice
from rotorid.results.verdicts import Verdict

_FAR_SIGMAS = 3.0
"""Difference of the values in time and frequency, in standard deviations, from which it is marked."""


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
class AloneRow:
    """What one record alone says of the free parameters, and why it does not of some."""

    record: str
    interval: str
    values: tuple[str, ...]
    reasons: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class DomainRow:
    """A parameter in time and in the frequency domain."""

    name: str
    time: str
    frequency: str
    unit: str
    distance: str
    far: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class EquationRow:
    """An equation of motion: the explained share of its left side, and the error on held-out rows."""

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
    """The orders that were compared, and the proposed one in words."""

    lines: tuple[OrderLine, ...]
    words: str


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeFits:
    """What a page shows of a fit in time."""

    outputs: tuple[str, ...]
    rows: tuple[RecordRow, ...]
    alone: tuple[AloneRow, ...]
    alone_names: tuple[str, ...]
    pictures: tuple[Picture, ...]
    memory: Picture | None
    beside: tuple[DomainRow, ...]
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
    key
        Prefix of the identifiers of its pictures.
    """
    document = shown.document
    if not shown.data.simulated:
        return None
    free = tuple(name for name, estimate in document.parameters.items() if estimate.status == "free")
    return TimeFits(
        outputs=tuple(quantity(name).words for name in document.outputs),
        rows=_record_rows(document),
        alone=_alone_rows(document, free),
        alone_names=free,
        pictures=_pictures(shown, key),
        memory=_memory(document, f"{key}-memory"),
        beside=_domain_rows(document),
        held=any(compared.hold_s for compared in (document.frequency_fit or {}).values()),
        minima=tuple(
            MinimumRow(
                cost=significant(minimum.cost), values=tuple(significant(minimum.parameters.get(name)) for name in free)
            )
            for minimum in document.minima
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
            record=fit.record,
            interval=f"{fit.start_s:.2f} to {fit.stop_s:.2f} s",
            samples=str(fit.samples),
            rate=f"{significant(fit.sample_rate_hz, digits=4)} Hz",
            pieces=str(fit.pieces),
            fits=tuple(
                percent_verdict(fit.fit_percent[name]) if name in fit.fit_percent else Verdict("", "not judged")
                for name in document.outputs
            ),
        )
        for fit in document.records
    )


def _alone_rows(document: ResultDocument, names: Sequence[str]) -> tuple[AloneRow, ...]:
    """What each record alone says of the free parameters; empty where none was fitted alone."""
    if not any(fit.parameters or fit.missing for fit in document.records):
        return ()
    return tuple(
        AloneRow(
            record=fit.record,
            interval=f"{fit.start_s:.2f} to {fit.stop_s:.2f} s",
            values=tuple(
                with_error(fit.parameters[name].value, fit.parameters[name].std) if name in fit.parameters else MISSING
                for name in names
            ),
            reasons=tuple(
                f"{listed([name for name, own in fit.missing.items() if own == reason])}: {reason}."
                for reason in dict.fromkeys(fit.missing.values())
            ),
        )
        for fit in document.records
    )


def _pictures(shown: Shown, key: str) -> tuple[Picture, ...]:
    document = shown.document
    traces = sum(2 * len(simulated.measured) + len(simulated.inputs) for simulated in shown.data.simulated)
    return tuple(
        Picture(
            key=f"{key}-{number}",
            description=f"Outputs measured and simulated, and inputs, over time in {item.record}",
            figure=drawn(
                simulated,
                item.time_s,
                item.inputs,
                item.measured,
                item.simulated,
                input_names=document.inputs,
                output_names=document.outputs,
                held=document.hold == "zero",
                most=points_of(traces),
            ),
        )
        for number, item in enumerate(shown.data.simulated)
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
        figure=drawn(
            residual_memory,
            np.arange(count, dtype=np.float64) * shown.step_s,
            {name: np.array(values) for name, values in shown.autocorrelation.items()},
            chance=shown.chance,
        ),
    )


def _domain_rows(document: ResultDocument) -> tuple[DomainRow, ...]:
    rows = []
    for name, other in (document.frequency_fit or {}).items():
        estimate = document.parameters[name]
        if estimate.status != "free":
            continue
        distance = None
        if estimate.std and other.std:
            distance = abs(estimate.value + other.hold_s - other.value) / float(np.hypot(estimate.std, other.std))
        rows.append(
            DomainRow(
                name=name,
                time=with_error(estimate.value, estimate.std),
                frequency=with_error(other.value, other.std),
                unit=unit(estimate.unit),
                distance=MISSING if distance is None else f"{distance:.1f} σ",
                far=distance is not None and distance > _FAR_SIGMAS,
            )
        )
    return tuple(rows)


def _equations(document: ResultDocument) -> tuple[EquationRow, ...]:
    return tuple(
        EquationRow(
            name=fit.name.replace("'", "′"),
            explained=f"{100.0 * fit.r_squared:.2f} %",
            misfit=f"{100.0 * fit.misfit:.2g} %",
            press=significant(fit.press),
        )
        for fit in document.equations
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
            order=row.order,
            parameters=row.parameters,
            fitted=plain(row.fitted_percent, 1),
            unseen="" if row.refused else with_error(row.unseen_percent, row.unseen_std),
            behind="" if row.refused else with_error(row.behind_percent, row.behind_std),
            aic=plain(row.aic, 0),
            bic=plain(row.bic, 0),
            color=plain(row.color, 2),
            refused=row.refused,
            chosen=row.order == choice.order,
        )
        for row in choice.rows
    )
    return OrderTable(lines=lines, words=order_words(choice))


def order_words(choice: OrderChoice) -> str:
    """The proposed order and the reason, in a sentence."""
    if choice.best == choice.order:
        return f"Order {choice.order} is proposed: it predicts unseen data best, and no smaller order is as good."
    return (
        f"Order {choice.order} is proposed: order {choice.best} predicts unseen data best, but by less than the "
        "standard error of the difference, and no smaller order is as good."
    )


def _information(document: ResultDocument) -> str:
    if document.information is None:
        return ""
    information = document.information
    return (
        f"{counted(information.numbers, 'estimated number')}. To compare models on the same records: Akaike "
        f"{significant(information.aic, digits=5)}, Schwarz {significant(information.bic, digits=5)}."
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
    """A cross-validation on the page."""

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
        "Identified on each record alone, scored on all others."
        if document.kind == "each"
        else "Identified on all records but one, scored on that one."
    )
    ahead = (
        ""
        if document.horizon_s is None
        else f" The models are unstable, so they predict {document.horizon_s:.2g} s ahead from every sample."
    )
    within = (
        ""
        if document.band_rad_s is None
        else f" Only {' to '.join(significant(edge) for edge in document.band_rad_s)} rad/s counts."
    )
    looks = (
        ""
        if document.band_rad_s is None or document.horizon_s is None
        else " The zero-phase filter looks slightly ahead, so these scores are higher than those of a prediction in "
        "flight."
    )
    mean = f" Unseen records: {_with_spread(document.mean_percent, document.spread_percent)} on average."
    best = document.best
    chosen = (
        ""
        if best is None
        else f" Best record for identification: {best.record} with {best.mean_percent:.1f} % (optimistic, because it "
        "was chosen by these scores)."
    )
    return f"{how}{ahead}{within}{looks}{mean}{chosen}"
