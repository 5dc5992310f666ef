"""The page and the tables of ``bench``: all models side by side, and what makes rows less comparable than they look."""

from __future__ import annotations

from itertools import groupby
from typing import NamedTuple

from rotorid.benchmarking.benchmark import Benchmarked
from rotorid.benchmarking.catalog import BENCHMARKS, METRICS, SHOWN, Metric
from rotorid.benchmarking.steps import OURS
from rotorid.data.display import listed
from rotorid.data.quantity import MISSING, significant, with_error
from rotorid.documents.benchmark import BenchDocument, BenchRowDocument, bench_document
from rotorid.report.findings import finding_rows
from rotorid.report.frame import render
from rotorid.report.tables import Column, Entry, Table


class ModelRow(NamedTuple):
    """All errors of one model.

    Parameters
    ----------
    cells
        In the order of the metrics.
    """

    model: str
    source: str
    parameters: str
    cells: tuple[str, ...]


def metrics_of(document: BenchDocument, *, every: bool = False) -> tuple[Metric, ...]:
    """Columns of the table: the few that a terminal shows, or every one."""
    kind = BENCHMARKS[document.benchmark].kind
    return METRICS[kind] if every else SHOWN[kind]


def by_model(document: BenchDocument) -> list[tuple[str, list[BenchRowDocument]]]:
    """Rows of each model, in the order of the document."""
    return [(model, list(rows)) for model, rows in groupby(document.rows, key=lambda row: row.model)]


def model_rows(document: BenchDocument, *, every: bool = False) -> list[ModelRow]:
    """One row for each model, numbers with their errors."""
    made = []
    for model, rows in by_model(document):
        values = {row.metric: row for row in rows}
        cells = [_cell(values.get(metric.name), metric) for metric in metrics_of(document, every=every)]
        parameters = rows[0].parameters
        made.append(ModelRow(model, rows[0].source, MISSING if parameters is None else str(parameters), tuple(cells)))
    return made


def _cell(row: BenchRowDocument | None, metric: Metric) -> str:
    if row is None or row.value is None:
        return MISSING
    return with_error(metric.scale * row.value, None if row.std is None else metric.scale * row.std)


def heading(metric: Metric) -> str:
    """A metric with its unit.

    Examples
    --------
    >>> from rotorid.benchmarking.catalog import LOADS, RATIOS
    >>> heading(LOADS[3]), heading(RATIOS[0])
    ('moment [mN m]', 'position')
    """
    return f"{metric.words} [{metric.shown}]" if metric.shown else metric.words


def bench_summary(document: BenchDocument) -> list[str]:
    """How the model of rotorid compares: with the naive one, and with the best other."""
    if not document.rows:
        return []
    kind = BENCHMARKS[document.benchmark].kind
    table = {(row.model, row.metric): row.value for row in document.rows if row.value is not None}
    split = f"{document.split[0].upper()}{document.split[1:]}."
    if kind == "loads":
        own, naive = "physical.flight", next(row.model for row in document.rows if row.source == "naive")
        missed, shares = [], []
        for metric in SHOWN[kind]:
            value = table[own, metric.name]
            missed.append(f"{metric.words} by {significant(metric.scale * value, digits=3)} {metric.shown}")
            shares.append(significant(value / table[naive, metric.name], digits=2))
        return [f"{own} misses {listed(missed)}, {listed(shares)} times as much as {naive}.", split]
    own = max((name for name in OURS if (name, "position") in table), key=OURS.index)
    shares = [f"{metric.name} {significant(table[own, metric.name], digits=2)}" for metric in SHOWN[kind]]
    return [f"Errors of {own} over those of a kept state: {', '.join(shares)}.", split]


def bench_table(document: BenchDocument) -> Table:
    """All errors as a table of a paper, with the source of each row."""
    metrics = metrics_of(document, every=True)
    columns = [Column("model", "Model"), Column("source", "Source"), Column("parameters", "Numbers", _whole)]
    for metric in metrics:
        unit = f" [{metric.unit}]" if metric.unit != "1" else ""
        columns += [Column(f"{metric.name}{unit}", f"{metric.words.capitalize()}{unit}")]
        columns += [Column(f"{metric.name}_std{unit}", "±", _two)]
    rows = []
    for model, found in by_model(document):
        values = {row.metric: row for row in found}
        entries: list[Entry] = [model, found[0].source, found[0].parameters]
        for metric in metrics:
            row = values.get(metric.name)
            entries += [None, None] if row is None else [row.value, row.std]
        rows.append(tuple(entries))
    names = [column.name for column in columns]
    return Table(
        name="bench",
        caption=f"{document.title}. {document.split}. Source: {document.citation}. "
        "± one standard deviation between flights.",
        columns=tuple(columns),
        rows=tuple(rows),
        errors={names[place]: names[place + 1] for place in range(3, len(names), 2)},
    )


def _whole(value: float | None) -> str:
    return MISSING if value is None else f"{value:.0f}"


def _two(value: float | None) -> str:
    return MISSING if value is None else significant(value, digits=2)


def render_bench(found: Benchmarked) -> str:
    """The page as one HTML file."""
    document = bench_document(found)
    return render(
        "bench.html",
        logs=document.provenance.inputs,
        pictures=[],
        title=document.title,
        sentences=bench_summary(document),
        document=document,
        headings=[heading(metric) for metric in metrics_of(document)],
        rows=model_rows(document),
        all_headings=[heading(metric) for metric in metrics_of(document, every=True)],
        all_rows=model_rows(document, every=True),
        remarks=finding_rows(document.findings),
    )
