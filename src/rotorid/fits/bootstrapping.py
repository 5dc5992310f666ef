"""A bootstrap of what was fitted: run, and judged against the stated standard deviations."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.errors import UsageError
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import Problem
from rotorid.io.pool import pool
from rotorid.results.summary import BootstrapSummary, Correlation, Spread, finite
from rotorid.settings.identifying import IdentifySettings
from rotorid.uncertainty.cramer_rao import Bounds, Weights
from rotorid.uncertainty.resampling import SpreadTable

_PROGRESS = logging.getLogger("rotorid.progress")


Source: TypeAlias = Literal["responses", "outputs"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Bootstrap(Immutable):
    """Spread of refits to simulated noise.

    Parameters
    ----------
    source
        Where the noise was drawn: errors of the responses as they are stated, or noise of the outputs colored as the
        residuals are.
    table
        What the runs ended at.
    findings
        Where it contradicts the stated standard deviations.
    """

    source: Source
    table: SpreadTable
    findings: tuple[Finding, ...]

    @property
    def summary(self) -> BootstrapSummary:
        """Its table and the correlation of its runs."""
        table = self.table
        return BootstrapSummary(
            source=self.source,
            runs=table.runs,
            seed=table.seed,
            left_out=dict(table.left_out),
            parameters={
                row.name: Spread(
                    mean=row.mean,
                    std=row.std,
                    relative_percent=finite(row.relative_percent),
                    low=row.low,
                    median=row.median,
                    high=row.high,
                )
                for row in table.rows()
            },
            correlation=Correlation(names=tuple(table.names), matrix=_correlation(table)),
        )


def _correlation(table: SpreadTable) -> tuple[tuple[float, ...], ...]:
    """Correlation of the runs; zero for parameters that did not scatter."""
    scale = np.where(table.std > 0.0, table.std, np.inf)
    matrix = table.covariance / np.outer(scale, scale)
    np.fill_diagonal(matrix, 1.0)
    return tuple(tuple(float(value) for value in row) for row in matrix)


class Draws(Protocol):
    """Number of simulated data sets."""

    @property
    def bootstrap(self) -> int | None:
        """Runs, ``None`` for none."""
        ...

    @property
    def seed(self) -> int:
        """Of the draws."""
        ...

    @property
    def workers(self) -> int | None:
        """Processes that share them out, ``None`` for none."""
        ...


def bootstrap(
    problem: Problem, solution: Solution, bounds: Bounds, settings: Draws, *, weights: Weights = "cifer"
) -> Bootstrap | None:
    """Refit simulated noise as often as the settings ask.

    Parameters
    ----------
    problem, solution, weights
        What was fitted, and how it ended; see :func:`rotorid.uncertainty.bootstrapping.bootstrap`.
    bounds
        What was stated. Draws of responses have the errors of the structure too, and are compared with all that is
        stated; draws of outputs have random errors alone, and are compared with these.
    settings
        ``bootstrap`` runs from ``seed``.

    Raises
    ------
    InsufficientDataError
        Parameters cannot be separated, or fewer than two runs came to rest.
    """
    if settings.bootstrap is None:
        return None
    from rotorid.uncertainty.bootstrapping import bootstrap as drawn_anew
    from rotorid.uncertainty.bootstrapping import judge_spread

    with pool(settings.workers) as workers:
        table = drawn_anew(
            problem,
            solution,
            runs=settings.bootstrap,
            seed=settings.seed,
            weights=weights,
            executor=workers.executor,
            progress=_log_runs,
        )
    source: Source = "responses" if problem.method == "frequency" else "outputs"
    # A parameter on its bound may not scatter at all.
    with np.errstate(divide="ignore", invalid="ignore"):
        findings = judge_spread(table, bounds.std if source == "responses" else bounds.random_std)
    return Bootstrap(source=source, table=table, findings=findings)


def require_bootstrap(settings: IdentifySettings, method: str) -> None:
    """Refuse a bootstrap of a method that has none.

    Raises
    ------
    UsageError
        Noise at the outputs of a simulation is no flight under feedback, which prediction error is for, and leaves
        regressors as clean as they are, of which equation error suffers.
    """
    if settings.bootstrap is not None and method in ("prediction_error", "equation_error"):
        raise UsageError(
            f"--bootstrap does not work with {method.replace('_', ' ')}",
            remedy="use --method frequency or --method output_error",
        )


def _log_runs(done: int, runs: int) -> None:
    _PROGRESS.info(f"bootstrap: {done} of {runs} runs", extra={"done": done, "total": runs})
