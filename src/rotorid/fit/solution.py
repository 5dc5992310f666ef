"""What a solver answers: where it ended, how, and how it came there."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError
from rotorid.typing import FloatArray


class Outcome(Enum):
    """How a solver ended. The values are sentences."""

    CONVERGED = "The cost no longer falls and the parameters no longer move."
    STALLED = "No step lowers the cost any more, although the gradient is not zero."
    OUT_OF_ITERATIONS = "The allowed number of iterations was used up before the parameters settled."


class Minimum(NamedTuple):
    """A place where a local search came to rest.

    Parameters
    ----------
    cost
        Sum of squared residuals there.
    theta
        Free parameters, shape ``(p,)``.
    """

    cost: float
    theta: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(Immutable):
    """End of a fit.

    Parameters
    ----------
    theta
        Free parameters, shape ``(p,)``.
    cost
        Sum of squared residuals.
    outcome
        How it ended.
    residual, jacobian
        At ``theta``, shapes ``(n,)`` and ``(n, p)``.
    evaluations
        How often residuals and Jacobian were computed.
    trace
        Cost after each accepted step.
    at_bound
        Which parameters ended on a bound, shape ``(p,)``.
    others
        Other minima that the search met, best first.
    """

    theta: FloatArray
    cost: float
    outcome: Outcome
    residual: FloatArray
    jacobian: FloatArray
    evaluations: int
    trace: tuple[float, ...]
    at_bound: tuple[bool, ...]
    others: tuple[Minimum, ...] = ()

    def __post_init__(self) -> None:
        self._set(
            theta=read_only(self.theta, np.float64, ndim=1),
            residual=read_only(self.residual, np.float64, ndim=1),
            jacobian=read_only(self.jacobian, np.float64, ndim=2),
            others=tuple(Minimum(cost, read_only(theta, np.float64, ndim=1)) for cost, theta in self.others),
        )

    def or_raise(self) -> Solution:
        """Return this solution if it converged; raise an error that says how it ended otherwise."""
        if self.outcome is Outcome.CONVERGED:
            return self
        raise InsufficientDataError(self.outcome.value, remedy="free fewer parameters or give other start values")
