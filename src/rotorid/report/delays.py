"""The delay budget on the page: where the time between a command and a sensor goes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rotorid.pipeline.document import DelayDocument, ResultDocument
from rotorid.plot.quantity import quantity
from rotorid.report.numbers import MISSING, milliseconds


@dataclass(frozen=True, kw_only=True, slots=True)
class DelayRow:
    """The way from one input to all outputs that share its delays, in milliseconds."""

    input: str
    outputs: str
    before: str
    motor: str
    after: str
    total: str
    known: str


def delay_rows(document: ResultDocument) -> tuple[DelayRow, ...]:
    """One row for each input and each budget of its own; outputs that share one stand together."""
    return tuple(
        DelayRow(
            input=name,
            outputs=", ".join(outputs),
            before=milliseconds(budget.input_delay_s),
            motor=milliseconds(budget.motor_lag_s),
            after=milliseconds(budget.output_delay_s),
            total=milliseconds(budget.total_s, budget.total_std_s),
            known=MISSING if budget.known_filters_s is None else milliseconds(budget.known_filters_s),
        )
        for name, outputs, budget in _ways(document)
    )


def delay_sentence(document: ResultDocument) -> str:
    """How late each input is answered; of outputs with a budget of their own, the first counts.

    Examples
    --------
    >>> budget = DelayDocument(
    ...     input_delay_s=0.03, motor_lag_s=0.01, output_delay_s=0.0, total_s=0.04, total_std_s=0.0004)
    >>> delay_sentence(ResultDocument.model_construct(delays={"q/pitch_command": budget}))
    'The vehicle answers the pitch command after 40.0 ± 0.4 ms.'
    """
    told: dict[str, str] = {}
    for name, _, budget in _ways(document):
        if name not in told:
            told[name] = f"the {quantity(name).words} after {milliseconds(budget.total_s, budget.total_std_s)} ms"
    return f"The vehicle answers {', '.join(told.values())}." if told else ""


def _ways(document: ResultDocument) -> list[tuple[str, list[str], DelayDocument]]:
    """Input, outputs and what they share, inputs together."""
    ways: dict[tuple[str, DelayDocument], list[str]] = {}
    names = _inputs(document.delays)
    for name in names:
        for pair, budget in document.delays.items():
            output, _, input = pair.partition("/")
            if input == name:
                ways.setdefault((name, budget), []).append(output)
    return [(name, outputs, budget) for (name, budget), outputs in ways.items()]


def _inputs(pairs: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(pair.partition("/")[2] for pair in pairs))
