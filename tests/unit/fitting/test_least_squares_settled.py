"""A search that was stopped counts as ended where nothing is left that residuals can tell."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.fitting.least_squares import Outcome, Solution

SLOPES = np.random.default_rng(3).normal(size=(40, 2))
NOISE = np.random.default_rng(4).normal(size=40)
REST = NOISE - SLOPES @ np.linalg.lstsq(SLOPES, NOISE, rcond=None)[0]


def stopped(deviations: float, outcome: Outcome, *, at_bound: bool = False) -> Solution:
    """A search that is some standard deviations of its first parameter from the minimum."""
    deviation = np.sqrt(np.linalg.inv(SLOPES.T @ SLOPES)[0, 0] * (REST @ REST) / REST.size)
    residual = REST + deviations * deviation * SLOPES[:, 0]
    return Solution(
        theta=np.zeros(2),
        cost=float(residual @ residual),
        outcome=outcome,
        residual=residual,
        jacobian=SLOPES,
        evaluations=1,
        trace=(1.0,),
        at_bound=(at_bound, at_bound),
    )


@pytest.mark.parametrize("outcome", [Outcome.OUT_OF_ITERATIONS, Outcome.STALLED])
def test_what_is_left_to_move_decides(outcome: Outcome) -> None:
    assert stopped(0.01, outcome).settled
    assert not stopped(0.2, outcome).settled
    assert stopped(0.2, outcome, at_bound=True).settled


def test_a_search_that_converged_has_ended() -> None:
    assert stopped(5.0, Outcome.CONVERGED).settled
