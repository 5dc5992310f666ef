"""``bench``: one table of a public benchmark, with models of rotorid, anybody's predictions and published errors."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from rotorid.benchmarking.catalog import Benchmark, benchmark_named
from rotorid.benchmarking.flights import folds, read_flights, vehicle_of
from rotorid.benchmarking.foreign import foreign_predictions
from rotorid.benchmarking.loads import load_table
from rotorid.benchmarking.scores import BenchRow
from rotorid.benchmarking.settings import BenchSettings
from rotorid.benchmarking.steps import step_table
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, worst_first
from rotorid.errors import UsageError
from rotorid.results.provenance import Provenance, provenance
from rotorid.settings.option import as_settings
from rotorid.verification.multistep import StepErrors

if TYPE_CHECKING:
    from rotorid.settings.option_types import BenchOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class Benchmarked(Immutable):
    """A finished benchmark.

    Parameters
    ----------
    benchmark
        Which one.
    split
        How flights were split, in words.
    flights
        Their names.
    rows
        One error of one model each.
    steps
        Model to its errors after 1 to 50 steps; empty where force and moment are compared.
    findings
        What was left out, and files that are not the published ones.
    provenance
        Hashes of the files, and choices.
    """

    benchmark: Benchmark
    split: str
    flights: tuple[str, ...]
    rows: tuple[BenchRow, ...]
    steps: Mapping[str, StepErrors] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    provenance: Provenance

    def __post_init__(self) -> None:
        self._set(steps=self.steps, rows=tuple(self.rows), flights=tuple(self.flights))


def bench(
    name: str,
    data: str | os.PathLike[str] | None = None,
    *,
    settings: BenchSettings | None = None,
    **options: Unpack[BenchOptions],
) -> Benchmarked:
    """Errors of all models on a public benchmark.

    Every flight is predicted by a fit of others. A standard deviation is that between flights (jackknife), so it says
    how far a score would move with other flights of the same kind; it assumes that flights are independent.

    Parameters
    ----------
    name
        ``neurobem``, ``idsia`` or ``nanobench``.
    data
        Folder of the downloaded files.
    settings
        Choices.
    **options
        Fields of :class:`~rotorid.benchmarking.settings.BenchSettings`, one by one.

    Raises
    ------
    UsageError
        There is no such benchmark or folder, it holds no flight of the benchmark, or the predictions do not fit it.
    InsufficientDataError
        Fewer than two flights can be used, or they do not support a fit.
    """
    chosen = as_settings(BenchSettings, settings, options)
    benchmark = benchmark_named(name)
    if data is None:
        raise UsageError(
            f"{name} needs its data, which are not shipped (license: {benchmark.license})",
            remedy=f"download {benchmark.address}, then add --data FOLDER",
        )
    foreign = foreign_predictions(chosen.predictions, chosen.label) if chosen.predictions else None
    found = read_flights(benchmark, Path(data))
    split, parts = folds(benchmark, found.flights)
    vehicle = vehicle_of(name)
    steps: Mapping[str, StepErrors] = {}
    if benchmark.kind == "loads":
        rows = load_table(found.flights, parts, vehicle, foreign)
    else:
        rows, steps = step_table(benchmark, found.flights, parts, vehicle, foreign)
    if foreign and len({row.source for row in rows if row.model == foreign.label}) > 1:
        raise UsageError(f"the table has a row {foreign.label!r} already", remedy="add --label NAME with another name")
    return Benchmarked(
        benchmark=benchmark,
        split=split,
        flights=tuple(flight.name for flight in found.flights),
        rows=tuple(rows),
        steps=steps,
        findings=worst_first(found.findings),
        provenance=provenance([flight.log for flight in found.flights], chosen),
    )
