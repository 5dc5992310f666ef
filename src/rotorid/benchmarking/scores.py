r"""Scores of a benchmark with their errors: root mean squares and ratios over the flights of a test.

A score is a function of two sums over flights, :math:`s = (A / B)^k` with :math:`k = 1/2` for a root mean square and 1
for a ratio. Its standard deviation is that of the jackknife over flights: how far the score would move with other
flights of the same kind,

.. math:: \sigma^2 = \frac{n - 1}{n} \sum_i (s_{-i} - \bar s)^2,

which few flights leave uncertain, and one flight unknown.

Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 11.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.benchmarking.catalog import Metric
from rotorid.typing import FloatArray
from rotorid.verification.multistep import StepErrors


class Part(NamedTuple):
    """Sums over one flight: a score is ``above`` over ``below``."""

    above: float
    below: float


@dataclass(frozen=True, kw_only=True, slots=True)
class BenchRow:
    """One error of one model.

    Parameters
    ----------
    model
        What predicted.
    source
        Where the number comes from; of published rows also on which flights it was had.
    metric
        Name of the metric.
    value, std
        The error and its standard deviation between flights; ``None`` where that is not known.
    parameters
        Free numbers of the model; ``None`` where that is not known.
    """

    model: str
    source: str
    metric: str
    value: float
    std: float | None
    parameters: int | None


def jackknife(parts: Sequence[Part], *, power: float = 1.0) -> tuple[float, float | None]:
    """A score over flights, and its standard deviation; ``None`` for one flight.

    Examples
    --------
    >>> jackknife([Part(1.0, 2.0), Part(3.0, 2.0)])
    (1.0, 0.5)
    >>> jackknife([Part(8.0, 2.0)], power=0.5)
    (2.0, None)
    """
    above, below = (np.array(column) for column in zip(*parts, strict=True))

    def score(keep: FloatArray) -> float:
        total = float(below @ keep)
        return (float(above @ keep) / total) ** power if total > 0.0 else np.inf

    count = len(parts)
    value = score(np.ones(count))
    if count < 2:
        return value, None
    without = np.array([score(1.0 - np.eye(count)[place]) for place in range(count)])
    return value, float(np.sqrt((count - 1.0) / count * ((without - without.mean()) ** 2).sum()))


class LoadErrorsOf(NamedTuple):
    """Errors of one flight, N and N m, shape ``(3, n)`` and ``(3, k)``."""

    force: FloatArray
    moment: FloatArray


_LOAD_ROWS: Mapping[str, tuple[str, slice]] = {
    "force": ("force", slice(0, 3)),
    "force_xy": ("force", slice(0, 2)),
    "force_z": ("force", slice(2, 3)),
    "moment": ("moment", slice(0, 3)),
    "moment_xy": ("moment", slice(0, 2)),
    "moment_z": ("moment", slice(2, 3)),
}


def load_rows(
    model: str, source: str, metrics: Sequence[Metric], errors: Sequence[LoadErrorsOf], parameters: int | None
) -> list[BenchRow]:
    """Root mean squares of force and moment, pooled over the samples of all flights."""
    rows = []
    for metric in metrics:
        which, part = _LOAD_ROWS[metric.name]
        left = [getattr(error, which)[part] for error in errors]
        value, std = jackknife([Part(float((rows**2).sum()), rows.shape[1]) for rows in left], power=0.5)
        rows.append(
            BenchRow(model=model, source=source, metric=metric.name, value=value, std=std, parameters=parameters)
        )
    return rows


class StepErrorsOf(NamedTuple):
    """Errors of one flight: against the logged position, and with the integral of the logged velocity in its place."""

    logged: StepErrors
    integrated: StepErrors


def step_rows(
    model: str, source: str, errors: Sequence[StepErrorsOf], parameters: int | None, *, naive: bool = False
) -> list[BenchRow]:
    """Ratios to a state that is kept, and sums in units, over all steps; each start counts once.

    Parameters
    ----------
    naive
        Whether the row is that of the kept state itself.
    """
    rows = []
    for name in ("position", "displacement", "velocity", "attitude", "rates"):
        quantity = "position" if name == "displacement" else name
        found = [error.integrated if name == "displacement" else error.logged for error in errors]
        sums = [
            (
                error.starts * float((error.naive if naive else error.model)[quantity].sum()),
                error.starts * float(error.naive[quantity].sum()),
                float(error.starts),
            )
            for error in found
        ]
        for metric, parts in (
            (name, [Part(own, kept) for own, kept, _ in sums]),
            (f"{name}_sum", [Part(own, starts) for own, _, starts in sums]),
        ):
            value, std = jackknife(parts)
            rows.append(
                BenchRow(model=model, source=source, metric=metric, value=value, std=std, parameters=parameters)
            )
    return rows
