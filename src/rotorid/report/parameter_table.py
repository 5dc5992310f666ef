"""The table of parameters: rows by force and moment, and the dropped ones in a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.pipeline.document import ParameterDocument, ResultDocument
from rotorid.report.numbers import percent, significant, unit, with_error
from rotorid.report.wording import parameter_group, parameter_words

CRAMER_RAO_GUIDELINE, INSENSITIVITY_GUIDELINE = 20.0, 10.0
FAR_SIGMAS = 3.0
"""A distance from the truth that random errors alone hardly explain."""

_MOST_UNGROUPED = 6


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


@dataclass(frozen=True, kw_only=True, slots=True)
class ParameterGroup:
    """Parameters of one force or moment; a short table is one group without a title."""

    title: str
    rows: tuple[ParameterRow, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Dropped:
    """A dropped parameter, and the identifier of where the page says why."""

    name: str
    target: str


def parameter_rows(document: ResultDocument, truth: Mapping[str, float]) -> tuple[ParameterRow, ...]:
    """One row for each parameter that was not dropped; truth is looked up as ``model.name`` first, then as ``name``."""
    return tuple(
        ParameterRow(
            name=name,
            words=parameter_words(name),
            value=with_error(parameter.value, parameter.std),
            unit=unit(parameter.unit),
            cramer_rao=_percent(parameter.cramer_rao_percent, CRAMER_RAO_GUIDELINE),
            insensitivity=_percent(parameter.insensitivity_percent, INSENSITIVITY_GUIDELINE),
            status=parameter.status,
            truth=significant(known := truth.get(f"{document.model}.{name}", truth.get(name)), digits=4),
            off=_off(parameter, known),
        )
        for name, parameter in document.parameters.items()
        if parameter.status != "dropped"
    )


def parameter_groups(document: ResultDocument, truth: Mapping[str, float]) -> tuple[ParameterGroup, ...]:
    """The rows by force and moment in the order in which these come up, delays and lags behind them, others last."""
    rows = parameter_rows(document, truth)
    groups: dict[str, list[ParameterRow]] = {}
    for row in rows:
        groups.setdefault(parameter_group(row.name, document.parameters[row.name].unit), []).append(row)
    if len(rows) <= _MOST_UNGROUPED or len(groups) < 2:
        return (ParameterGroup(title="", rows=rows),)
    others = groups.pop("", [])
    ordered = [ParameterGroup(title=title, rows=tuple(members)) for title, members in groups.items()]
    return (*ordered, ParameterGroup(title="Others", rows=tuple(others))) if others else tuple(ordered)


def dropped_parameters(document: ResultDocument, *, anchor: str) -> tuple[Dropped, ...]:
    """The dropped ones, in the order of the model.

    Parameters
    ----------
    document
        The result.
    anchor
        Prefix of the identifiers of the section: a step of the reduction is ``ANCHOR-step-N``, the findings are
        ``ANCHOR-findings``.
    """
    steps = {step.parameter: number for number, step in enumerate(document.reduction) if step.action == "dropped"}
    return tuple(
        Dropped(name=name, target=f"{anchor}-step-{steps[name]}" if name in steps else f"{anchor}-findings")
        for name, parameter in document.parameters.items()
        if parameter.status == "dropped"
    )


def truth_of_dropped(document: ResultDocument, truth: Mapping[str, float]) -> str:
    """Known true values of what was dropped, as words; empty where none is known."""
    known = {
        name: value
        for name, parameter in document.parameters.items()
        if parameter.status == "dropped"
        and (value := truth.get(f"{document.model}.{name}", truth.get(name))) is not None
    }
    return ", ".join(f"{name} {significant(value)}" for name, value in known.items())


def _percent(value: float | None, guideline: float) -> Cell:
    return Cell(percent(value), value is not None and value > guideline)


def _off(parameter: ParameterDocument, truth: float | None) -> Cell:
    if truth is None or not parameter.std:
        return Cell("")
    sigmas = abs(parameter.value - truth) / parameter.std
    return Cell(f"{sigmas:.1f} σ", sigmas > FAR_SIGMAS)
