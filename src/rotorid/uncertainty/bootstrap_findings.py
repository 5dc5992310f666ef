"""Remarks where a bootstrap and the stated errors do not agree."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import UsageError
from rotorid.typing import FloatArray
from rotorid.uncertainty.spread_table import SpreadTable

_CHANCE = 3.0
_WORTH_SAYING = 1.25
"""A standard deviation that is a quarter off changes no decision."""

_MOVED = 0.5
_MANY = 0.05


def judge_spread(table: SpreadTable, std: FloatArray) -> tuple[Finding, ...]:
    """Where the spread of many runs contradicts stated standard deviations by more than chance.

    Stated errors take the model as straight over its errors, and everything as normal. A parameter that runs against a
    bound, a cost with several minima or a strong curvature shows here.

    Parameters
    ----------
    table
        Of a bootstrap.
    std
        Stated standard deviations of its parameters, shape ``(p,)``, such as those of
        :class:`rotorid.uncertainty.bounds.Bounds`.

    Returns
    -------
    tuple of Finding
        ``bootstrap_disagrees`` for a parameter whose spread is a quarter off or whose mean has moved by half a standard
        deviation, three standard errors of the runs at least; ``bootstrap_incomplete`` where more than a twentieth of
        the runs had no answer. Standard errors are those of the larger of the two standard deviations: few runs that
        happen to lie close together are not as certain as they look.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((500, 1))
    >>> table = SpreadTable(names=("L_p",), estimate=np.zeros(1), draws=draws, seed=0)
    >>> judge_spread(table, np.ones(1)), [one.kind for one in judge_spread(table, 0.5 * np.ones(1))]
    ((), ['bootstrap_disagrees'])
    """
    if std.shape != table.estimate.shape:
        raise UsageError(f"{std.size} standard deviations came", needed=f"{len(table.names)}, one for each parameter")
    larger, smaller = np.maximum(table.std, std), np.minimum(table.std, std)
    runs = len(table.draws)
    chance = np.maximum(table.std_error, larger / np.sqrt(2.0 * (runs - 1)))
    other = (larger - smaller > _CHANCE * chance) & (larger > _WORTH_SAYING * smaller)
    moved = (np.abs(table.bias) > _CHANCE * larger / np.sqrt(runs)) & (np.abs(table.bias) > _MOVED * table.std)
    return (*_incomplete(table), *(_disagrees(table, std, one) for one in np.flatnonzero(other | moved).tolist()))


def _incomplete(table: SpreadTable) -> tuple[Finding, ...]:
    out = sum(table.left_out.values())
    if out <= _MANY * table.runs:
        return ()
    reasons = " ".join(f"{count} times: {reason}" for reason, count in table.left_out.items())
    message = f"{out} of {table.runs} runs of the bootstrap had no answer, so that the spread is understated. {reasons}"
    return (
        Finding(
            kind="bootstrap_incomplete",
            severity="warning",
            where="bootstrap",
            message=message,
            numbers={"runs": table.runs, "left_out": out},
        ),
    )


def _disagrees(table: SpreadTable, std: FloatArray, place: int) -> Finding:
    row = table.rows()[place]
    moved = row.mean - row.estimate
    ends = f"{row.low:.4g} to {row.high:.4g}"
    # A narrower spread may be that of a bound or of too few runs: it is no reason to claim more.
    wider = row.std > std[place]
    advice = f"Take the interval from {ends}." if wider else f"95 % of the runs lie from {ends}."
    return Finding(
        kind="bootstrap_disagrees",
        severity="warning",
        where=row.name,
        message=(
            f"Over {len(table.draws)} runs {row.name} scatters by {row.std:.3g} about {row.mean:.4g}; its value is "
            f"{row.estimate:.4g} and its stated standard deviation {std[place]:.3g}. {advice}"
        ),
        numbers={
            "std": row.std,
            "stated_std": float(std[place]),
            "bias": moved,
            "percentile_2_5": row.low,
            "percentile_97_5": row.high,
        },
    )
