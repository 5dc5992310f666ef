"""How far the answers of many runs lie apart, parameter by parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import FloatArray

LOW_PERCENT, HIGH_PERCENT = 2.5, 97.5
FEWEST_RUNS = 2


class SpreadRow(NamedTuple):
    """One parameter of a spread table, in its unit unless it says percent.

    Parameters
    ----------
    name, unit
        Of the parameter.
    estimate
        The value about which the runs were drawn.
    mean, std
        Of the runs.
    relative_percent
        Standard deviation in percent of the mean; infinite where the mean is zero.
    low, median, high
        Percentiles 2.5, 50 and 97.5.
    """

    name: str
    unit: str
    estimate: float
    mean: float
    std: float
    relative_percent: float
    low: float
    median: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SpreadTable(Immutable):
    r"""Parameters of many runs: mean, standard deviation and percentiles of each.

    A run is a fit to other noise, other records or from another start. Runs that came to no rest are no answers: they
    are left out and counted, and where there are many of them the spread is understated.

    Percentiles of n runs are themselves uncertain: with 1000 runs the standard deviation is known to 2 % and the end of
    a 95 % interval to some 4 % of a standard deviation, with 100 runs to 7 % and 15 %.

    Parameters
    ----------
    names
        Parameters.
    units
        Of the parameters; empty strings where nothing is said.
    estimate
        The values about which the runs were drawn, shape ``(p,)``.
    draws
        What the runs that count ended at, in their order, shape ``(n, p)``.
    left_out
        How many runs do not count, by the sentence that says why.
    seed
        From which the runs were drawn; the same seed gives the same table on any number of workers.

    Raises
    ------
    InsufficientDataError
        Fewer than two runs count.

    Examples
    --------
    >>> draws = np.array([[1.0], [2.0], [3.0], [4.0], [5.0]])
    >>> table = SpreadTable(names=("L_p",), estimate=np.array([3.0]), draws=draws, seed=0)
    >>> [round(value, 2) for value in table.rows()[0][2:]]
    [3.0, 3.0, 1.58, 52.7, 1.1, 3.0, 4.9]
    """

    names: tuple[str, ...]
    estimate: FloatArray
    draws: FloatArray
    seed: int
    units: tuple[str, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        estimate, draws = read_only(self.estimate, np.float64, ndim=1), read_only(self.draws, np.float64, ndim=2)
        units = tuple(self.units) or ("",) * len(self.names)
        if not len(self.names) == len(units) == estimate.size == draws.shape[1]:
            raise UsageError(
                f"{len(self.names)} names, {len(units)} units, {estimate.size} values, draws of {draws.shape[1]} came",
                needed="one of each for each parameter",
            )
        if len(draws) < FEWEST_RUNS:
            reasons = "; ".join(f"{count} times: {reason}" for reason, count in self.left_out.items())
            raise InsufficientDataError(
                f"{len(draws)} of {len(draws) + sum(self.left_out.values())} runs came to rest"
                + f" ({reasons})" * bool(reasons),
                needed="at least two",
                remedy="ask for more runs, or free fewer parameters",
            )
        self._set(names=tuple(self.names), units=units, estimate=estimate, draws=draws, left_out=self.left_out)

    @property
    def runs(self) -> int:
        """All runs, those left out included."""
        return len(self.draws) + sum(self.left_out.values())

    @property
    def mean(self) -> FloatArray:
        """Mean of each parameter, shape ``(p,)``."""
        return np.asarray(self.draws.mean(axis=0))

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each parameter, shape ``(p,)``."""
        return np.asarray(self.draws.std(axis=0, ddof=1))

    @property
    def std_error(self) -> FloatArray:
        r"""What chance makes of the standard deviations, because the runs are not infinitely many, shape ``(p,)``.

        .. math:: \sigma_s = s \sqrt{(\kappa - 1) / (4 n)}

        with the kurtosis :math:`\kappa` of the runs, which is three for normal ones; rare runs far out make it large.
        """
        off = self.draws - self.mean
        second, fourth = (off**2).mean(axis=0), (off**4).mean(axis=0)
        kurtosis = fourth / np.where(second > 0.0, second, 1.0) ** 2
        return np.asarray(self.std * np.sqrt(np.maximum(kurtosis - 1.0, 0.0) / (4.0 * len(self.draws))))

    @property
    def relative(self) -> FloatArray:
        """Standard deviation over the size of the mean, shape ``(p,)``; infinite where the mean is zero."""
        size = np.abs(self.mean)
        return np.asarray(np.divide(self.std, size, out=np.full(size.shape, np.inf), where=size > 0.0))

    @property
    def bias(self) -> FloatArray:
        """Mean minus estimate, shape ``(p,)``: how far a curved model moves the mean of its estimates."""
        return self.mean - self.estimate

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the parameters, shape ``(p, p)``."""
        return np.atleast_2d(np.cov(self.draws, rowvar=False))

    @property
    def percentiles(self) -> FloatArray:
        """Percentiles 2.5, 50 and 97.5, shape ``(3, p)``."""
        return np.asarray(np.percentile(self.draws, [LOW_PERCENT, 50.0, HIGH_PERCENT], axis=0))

    def rows(self) -> tuple[SpreadRow, ...]:
        """The table, one row for each parameter."""
        columns = (self.estimate, self.mean, self.std, 100.0 * self.relative, *self.percentiles)
        numbers = np.stack(columns, axis=1).tolist()
        return tuple(
            SpreadRow(name, unit, *row) for name, unit, row in zip(self.names, self.units, numbers, strict=True)
        )
