r"""Repeated estimates on simulated data: one loop for every Monte Carlo study and every bootstrap.

Run k draws from a generator of its own, child k of the seed. What a run draws therefore depends neither on the other
runs nor on how they are shared out, and a study of 100 runs is the first part of one of 1000.

A table shows how far the answers differ, parameter by parameter.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.display import counted
from rotorid.errors import InsufficientDataError, UsageError, reason_of
from rotorid.typing import FloatArray, IntArray

LOW_PERCENT, HIGH_PERCENT = 2.5, 97.5
FEWEST_RUNS = 2


class SpreadRow(NamedTuple):
    """One parameter of a spread table, in its unit unless the name ends in percent.

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
                f"{len(self.names)} names, {len(units)} units, {estimate.size} values and draws of "
                f"{draws.shape[1]} do not match",
                needed="one of each for each parameter",
            )
        if len(draws) < FEWEST_RUNS:
            reasons = "; ".join(f"{count} times: {reason}" for reason, count in self.left_out.items())
            raise InsufficientDataError(
                f"only {len(draws)} of {len(draws) + sum(self.left_out.values())} runs converged"
                + f" ({reasons})" * bool(reasons),
                needed="at least two",
                remedy="request more runs, or free fewer parameters",
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
        r"""Standard error of the standard deviations from the finite number of runs, shape ``(p,)``.

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


RunProgress: TypeAlias = Callable[[int, int], None]
"""Called with the number of runs that are done, and of all."""

Refit: TypeAlias = Callable[[np.random.Generator], FloatArray]
"""From the generator of a run to its parameters ``(p,)``; a :class:`RotoridError` leaves the run out."""

Estimator: TypeAlias = Callable[[IntArray], FloatArray]
"""From the indices of records, with repeats, to parameters ``(p,)``."""

_TOGETHER = 125
"""Runs that are fitted in one sweep; it must not depend on the workers, or sums would be rounded otherwise."""

FEWEST_RECORDS = 5
"""Of fewer records there are too few different draws: of four only 20."""


class LeftOut(NamedTuple):
    """A run without an answer, with its reason in a sentence, and whether the user stopped the runs before it."""

    reason: str
    stopped: bool = False


_STOPPED = LeftOut("The runs were stopped before this one.", stopped=True)
_LOST = LeftOut("The worker process of this run ended unexpectedly, for instance for lack of memory.")


RefitMany: TypeAlias = Callable[[Sequence[np.random.Generator]], Sequence[FloatArray | LeftOut]]
"""The same for several runs in one sweep."""

Value = TypeVar("Value")


def generator(seed: int, run: int) -> np.random.Generator:
    """The generator of one run: child ``run`` of the seed, whatever other runs there are.

    Examples
    --------
    >>> child = np.random.SeedSequence(7).spawn(3)[2]
    >>> generator(7, 2).random() == np.random.default_rng(child).random()
    True
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(run,)))


def resample(
    refit: Refit,
    *,
    names: Sequence[str],
    estimate: FloatArray,
    runs: int,
    seed: int,
    units: Sequence[str] = (),
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SpreadTable:
    """Spread of an estimate over runs that draw their own data.

    Parameters
    ----------
    refit
        One run. For workers in other processes it must pickle: a function of a module, or a frozen value with
        ``__call__``.
    estimate
        The values about which data are drawn, shape ``(p,)``.
    runs
        How many.
    seed
        The same seed gives the same table on any number of workers.
    executor
        Shares out the runs, for instance ``concurrent.futures.ProcessPoolExecutor()``; by default they follow one
        another here.
    progress
        Told how far it is.

    Raises
    ------
    UsageError
        Fewer than two runs were asked for.
    InsufficientDataError
        Fewer than two runs came to rest.

    Examples
    --------
    The mean of 25 numbers scatters by a fifth of what they do:

    >>> def mean(rng):
    ...     return np.array([rng.standard_normal(25).mean()])
    >>> table = resample(mean, names=["mean"], estimate=np.zeros(1), runs=4000, seed=1)
    >>> round(float(table.std[0]), 2)
    0.2
    """
    done = each_run(refit, runs=runs, seed=seed, executor=executor, progress=progress)
    return spread_of(done, names=names, units=units, estimate=estimate, seed=seed)


def resample_together(
    refit: RefitMany,
    *,
    names: Sequence[str],
    estimate: FloatArray,
    runs: int,
    seed: int,
    units: Sequence[str] = (),
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SpreadTable:
    """The same as :func:`resample` for a refit that takes many runs in one sweep."""
    done = _gathered(_Chunk(refit, seed), _TOGETHER, runs, executor, progress)
    return spread_of(done, names=names, units=units, estimate=estimate, seed=seed)


def resample_records(
    estimator: Estimator,
    count: int,
    *,
    names: Sequence[str],
    estimate: FloatArray,
    runs: int,
    seed: int,
    units: Sequence[str] = (),
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> SpreadTable:
    r"""Spread of an estimate over whole records drawn with replacement.

    Nothing is assumed of noise, disturbances or the structure: what differs from flight to flight shows, the errors of
    a wrong model included. Of R records R − 1 are drawn each time. Draws of R would have variances too small by
    :math:`(R-1)/R`, which matters as flights are few (Rao and Wu 1988). Records count as independent and alike; a
    maneuver that no other repeats makes draws without it hardly comparable. Few records do not know their own scatter
    well: of a normal mean the interval of 95 % holds the truth in 86 % of all cases with five records, in 91 % with
    eight and in 94 % with forty.

    Parameters
    ----------
    estimator
        From the indices of the records drawn, with repeats, to parameters. It may do anything, for instance estimate
        frequency responses anew from these records and fit them.
    count
        How many records there are.
    names, units, estimate, runs, seed, executor, progress
        As in :func:`resample`.

    Raises
    ------
    UsageError
        There are fewer than five records.

    References
    ----------
    J. N. K. Rao and C. F. J. Wu, *Resampling Inference with Complex Survey Data*, Journal of the American Statistical
    Association 83(401), 1988.
    """
    if count < FEWEST_RECORDS:
        raise UsageError(
            f"{counted(count, 'record')} to draw from",
            needed=f"{FEWEST_RECORDS} or more",
            remedy="cut records into pieces that are long compared with the slowest motion of the model, or draw new "
            "noise instead",
        )
    return resample(
        _DrawnRecords(estimator, count),
        names=names,
        estimate=estimate,
        runs=runs,
        seed=seed,
        units=units,
        executor=executor,
        progress=progress,
    )


@dataclass(frozen=True)
class _DrawnRecords:
    estimator: Estimator
    count: int

    def __call__(self, rng: np.random.Generator) -> FloatArray:
        return self.estimator(rng.integers(0, self.count, self.count - 1))


def each_run(
    work: Callable[[np.random.Generator], Value],
    *,
    runs: int,
    seed: int,
    executor: Executor | None = None,
    progress: RunProgress | None = None,
) -> list[Value | LeftOut]:
    """Results of every run, in order: the common loop of this module.

    Parameters
    ----------
    work
        One run. A :class:`RotoridError` leaves it out.
    runs, seed, executor, progress
        As in :func:`resample`.

    Raises
    ------
    UsageError
        Fewer than two runs were asked for.
    """
    return _gathered(_Chunk(_InSequence(work), seed), 1, runs, executor, progress)


def spread_of(
    done: Sequence[FloatArray | LeftOut],
    *,
    names: Sequence[str],
    estimate: FloatArray,
    seed: int,
    units: Sequence[str] = (),
) -> SpreadTable:
    """The table of what runs gave.

    Parameters
    ----------
    done
        Estimates of each run, or why it has none.
    names
        Of the parameters.
    estimate
        Of the data as they are, shape ``(p,)``.
    seed
        From which all runs were drawn.
    units
        Of the parameters.
    """
    reasons = [draw.reason for draw in done if isinstance(draw, LeftOut)]
    draws = [draw for draw in done if not isinstance(draw, LeftOut)]
    return SpreadTable(
        names=tuple(names),
        units=tuple(units),
        estimate=estimate,
        draws=np.array(draws).reshape(-1, len(names)),
        left_out=Counter(reasons),
        seed=seed,
    )


@dataclass(frozen=True)
class _InSequence(Generic[Value]):
    work: Callable[[np.random.Generator], Value]

    def __call__(self, generators: Sequence[np.random.Generator]) -> list[Value | LeftOut]:
        return [self._result_of(rng) for rng in generators]

    def _result_of(self, rng: np.random.Generator) -> Value | LeftOut:
        try:
            return self.work(rng)
        # A fault costs its run alone, and is named there.
        except Exception as error:
            return LeftOut(str(reason_of(error, "this run")))


@dataclass(frozen=True)
class _Chunk(Generic[Value]):
    """Consecutive runs, as one piece of work."""

    work: Callable[[Sequence[np.random.Generator]], Sequence[Value | LeftOut]]
    seed: int

    def __call__(self, runs: range) -> Sequence[Value | LeftOut]:
        return self.work([generator(self.seed, run) for run in runs])


def _gathered(
    chunk: _Chunk[Value], size: int, runs: int, executor: Executor | None, progress: RunProgress | None
) -> list[Value | LeftOut]:
    if runs < FEWEST_RUNS:
        raise UsageError(counted(runs, "run"), needed="two or more, some hundred for percentiles")
    pieces = [range(first, min(first + size, runs)) for first in range(0, runs, size)]
    done: list[Value | LeftOut] = []
    try:
        if progress is not None:
            progress(0, runs)
        for piece, found in zip(pieces, (map if executor is None else executor.map)(chunk, pieces), strict=True):
            done.extend(found)
            if progress is not None:
                progress(piece.stop, runs)
    except KeyboardInterrupt:
        if _answers(done) < FEWEST_RUNS:
            raise
        _stopped(len(done), runs)
        return [*done, *[_STOPPED] * (runs - len(done))]
    except BrokenExecutor:
        if _answers(done) < FEWEST_RUNS:
            raise
        return [*done, *[_LOST] * (runs - len(done))]
    return done


def _answers(done: Sequence[object]) -> int:
    return sum(not isinstance(run, LeftOut) for run in done)


def _stopped(done: int, runs: int) -> None:
    """Say that an interrupt was understood: what is done counts, and the work goes on with it."""
    words = f"stopped after {done} of {runs} runs"
    logging.getLogger("rotorid.progress").info(words, extra={"understood": True})
