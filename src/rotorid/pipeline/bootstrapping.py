"""A bootstrap of what was fitted: run, and judged against the stated standard deviations."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.errors import UsageError
from rotorid.pipeline.frequency_fit import Fitted
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.time_fit import TimeFitted
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.resampling import SpreadTable

_PROGRESS = logging.getLogger("rotorid.progress")


Source: TypeAlias = Literal["responses", "outputs"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Bootstrapped(Immutable):
    """Spread of refits to noise that was drawn anew.

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


def bootstrap(fitted: Fitted | TimeFitted, settings: IdentifySettings) -> Bootstrapped | None:
    """Refit noise drawn anew as often as the settings ask; nothing where they ask for none.

    Parameters
    ----------
    fitted
        In the frequency domain, or in time by output error.
    settings
        ``bootstrap`` runs from ``seed``.

    Raises
    ------
    InsufficientDataError
        Parameters cannot be told apart, or fewer than two runs came to rest.
    UsageError
        The method has no bootstrap.
    """
    runs = settings.bootstrap
    if runs is None:
        return None
    if isinstance(fitted, Fitted):
        from rotorid.uncertainty.bootstrapping import bootstrap as drawn_anew

        table = drawn_anew(
            fitted.problem, fitted.final, runs=runs, seed=settings.seed, weights=fitted.weights, progress=_say
        )
        return _judged("responses", table, fitted.bounds)
    require_bootstrap(settings, fitted.method)
    from rotorid.uncertainty.bootstrapping import bootstrap as drawn_anew

    table = drawn_anew(fitted.problem, fitted.solution, runs=runs, seed=settings.seed, progress=_say)
    return _judged("outputs", table, fitted.bounds)


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
            f"--bootstrap came with {method.replace('_', ' ')}, which has none",
            needed="--method frequency or --method output_error",
        )


def _say(done: int, runs: int) -> None:
    _PROGRESS.info(f"bootstrap: {done} of {runs} runs", extra={"done": done, "total": runs})


@np.errstate(divide="ignore", invalid="ignore")  # a parameter on its bound may not scatter at all
def _judged(source: Source, table: SpreadTable, bounds: Bounds) -> Bootstrapped:
    from rotorid.uncertainty.bootstrapping import judge_spread

    return Bootstrapped(source=source, table=table, findings=judge_spread(table, bounds.std))
