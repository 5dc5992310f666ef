r"""Choice of the order of a black box: models of rising order are scored on unseen data.

Each order is fitted to all records, and again to all but one of them, which it then simulates with every parameter
frozen. Records that are seen always prefer the higher order; records that are not seen prefer the one that will serve.
Several orders mostly do about as well, and then the smallest of them is proposed,

.. math:: n = \min \{ k : \bar s_{best} - \bar s_k \le \mathrm{SE}(s_{best} - s_k) \}

with the mean score of unseen records and the standard error of the difference over records. Records differ in how hard
they are to predict, and do so for all orders alike: differences are taken record by record, and this does not count.
Criteria of information and the color of the residuals stand beside it: both are for white residuals, which those of a
simulation hardly ever are, and then criteria prefer too high an order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.black_box.fit import BlackBoxFit, StartPlan, fit_black_box
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.time.output_error import InitialCondition, TimeData, fit_output_error
from rotorid.models.parameter import ParameterSet
from rotorid.simulation.linear import Hold
from rotorid.typing import FloatArray
from rotorid.verification.fixed_parameters import FixedParameterScores, cross_validate, score_frozen

HIGHEST_ORDER = 4
"""Orders beyond are those of a fit to noise or of a delay, for the vehicles and rates that this is made for."""

_PIECES = 5
"""Number of parts of few records, each scored by a model that has not seen it."""

_FEWEST_LOGS = 3
"""Number of records from which each is left out as a whole."""

_SHORTEST_PIECE = 60
"""Samples of such a part; half as many are the least."""

_LAGS = 20
"""Samples over which errors are compared with themselves."""

_WORSE = 2
"""So many last orders, all clearly behind the best, end the comparison."""

_SEARCH = LevenbergMarquardt(iterations=60, tolerance=1e-7)
"""A fold begins where all records ended, and its score needs no more digits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderScore(Immutable):
    """How well a black box of one order does.

    Parameters
    ----------
    order
        Number of states, of each response where they stand side by side.
    parameters
        Free numbers, initial states and shifts of records apart.
    fitted_percent
        Mean share of the motion of outputs that it explains in the records that it was fitted to.
    unseen_percent
        The same in records that it has not seen, their mean.
    unseen_error
        Standard error of that mean over records.
    behind_percent, behind_error
        How far its unseen score lies behind the best one, and the standard error of this difference.
    aic, bic
        Criteria of Akaike and of Schwarz, Rissanen's description length, of the fit to all records.
    color
        Largest autocorrelation of the residuals of an output at lags of 1 to 20 samples, without sign.
    unseen
        Score of each record while it was not seen, shape ``(records,)``.
    refused
        Why there is no model of this order; empty where there is one.
    """

    order: int
    parameters: int = 0
    fitted_percent: float = math.nan
    unseen_percent: float = math.nan
    unseen_error: float = math.nan
    behind_percent: float = math.nan
    behind_error: float = math.nan
    aic: float = math.nan
    bic: float = math.nan
    color: float = math.nan
    unseen: FloatArray = field(default_factory=lambda: np.zeros(0))
    refused: str = ""

    def __post_init__(self) -> None:
        self._set(unseen=read_only(self.unseen, np.float64, ndim=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderComparison(Immutable):
    """Orders side by side, and the one that is proposed.

    Parameters
    ----------
    scores
        One for each order that was tried, in their order.
    order
        The smallest order whose score lies behind the best by no more than the standard error of the difference.
    best
        The order with the highest score.
    records
        Names of what was held out in its turn.
    chance
        What the autocorrelation of white residuals stays within, two standard deviations.
    """

    scores: tuple[OrderScore, ...]
    order: int
    best: int
    records: tuple[str, ...]
    chance: float

    def __post_init__(self) -> None:
        self._set(scores=tuple(self.scores), records=tuple(self.records))

    def __getitem__(self, order: int) -> OrderScore:
        for score in self.scores:
            if score.order == order:
                return score
        raise KeyError(f"no order {order}; there are {', '.join(str(score.order) for score in self.scores)}")


def held_out(records: Sequence[TimeData]) -> tuple[TimeData, ...]:
    """Parts to leave out in turn: records if there are three or more, else five pieces.

    Pieces of one flight share its battery, wind and trim, and are the weaker test.

    Raises
    ------
    InsufficientDataError
        Less than two pieces of sixty samples come of the records.

    Examples
    --------
    >>> record = TimeData(name="flight", inputs=np.ones((1, 400)), outputs=np.ones((1, 400)), sample_rate_hz=20.0)
    >>> [(one.name, one.samples) for one in held_out([record])][:2]
    [('flight, 0 to 4 s', 80), ('flight, 4 to 8 s', 80)]
    """
    if len(records) >= _FEWEST_LOGS:
        names = [f"{record.name} {number + 1}" for number, record in enumerate(records)]
        once = len({record.name for record in records}) == len(records)
        return tuple(
            record if once else replace(record, name=name) for record, name in zip(records, names, strict=True)
        )
    total = sum(record.samples for record in records)
    length = max(total // _PIECES, _SHORTEST_PIECE)
    pieces = [piece for record in records for piece in _pieces(record, max(1, round(record.samples / length)))]
    if len(pieces) < 2 or min(record.samples for record in pieces) < _SHORTEST_PIECE // 2:
        raise InsufficientDataError(
            f"{total} samples are too few to compare orders on unseen parts",
            needed=f"at least two pieces of {_SHORTEST_PIECE} samples",
            remedy="give longer or more records, or set the order with black_box:N",
        )
    return tuple(pieces)


def _pieces(record: TimeData, count: int) -> list[TimeData]:
    edges = np.linspace(0, record.samples, count + 1).round().astype(int)
    rate_hz = record.sample_rate_hz
    return [
        TimeData(
            name=f"{record.name}, {first / rate_hz:.3g} to {last / rate_hz:.3g} s",
            inputs=record.inputs[:, first:last],
            outputs=record.outputs[:, first:last],
            sample_rate_hz=rate_hz,
            before=record.until(first),
        )
        for first, last in pairwise(edges.tolist())
    ]


def compare_orders(
    records: Sequence[TimeData],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    decoupled: bool = False,
    delays: bool = False,
    hold: Hold = "zero",
    unknowns: tuple[InitialCondition, ...] = ("initial_state", "output_shift"),
    highest: int = HIGHEST_ORDER,
    plan: StartPlan | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> OrderComparison:
    r"""Fit black boxes of rising order, score each on unseen data, and propose one.

    Orders are tried from one up; after two in a row that lie behind the best by more than their standard error no
    higher one is. Starts of every order come from subspaces and drawn poles on all records; a fold begins where all
    records ended, and is fitted to its own records alone until it rests.

    Parameters
    ----------
    records
        Inputs and outputs, of one sample rate.
    inputs, outputs
        Names of their rows.
    decoupled
        Whether each input has a black box to its own output, all of one order.
    delays, hold, unknowns, plan
        As for :func:`rotorid.fitting.fit_black_box`.
    highest
        Highest order to try.
    progress
        Called with each order before it is fitted.

    Raises
    ------
    InsufficientDataError
        The records are too short to hold anything out, or no order has a model.
    UsageError
        The records do not go with the names or with each other.

    Notes
    -----
    The initial state and shifts of a record that is scored are estimated there, as nothing else shows them, and take
    from its errors what k numbers of N take from noise: errors are enlarged by :math:`\sqrt{N / (N - k)}`, or higher
    orders would seem the better. Of errors with a memory they take more than that.
    With a handful of records a standard error is itself known to a half.

    References
    ----------
    Breiman, Friedman, Olshen and Stone, *Classification and Regression Trees*, 1984, section 3.4.3, for the rule of one
    standard error.

    Examples
    --------
    >>> from rotorid.models.library import response_model
    >>> from rotorid.simulation.linear import simulate_linear
    >>> model = response_model("response.second_order", [("u", "y")])
    >>> system = model.matrices({"K_y": 1.0, "omega_y": 6.0, "zeta_y": 0.4})
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.choice([-1.0, 1.0], size=60), 10)[None]
    >>> y = simulate_linear(system, u, sample_rate_hz=20.0) + 0.05 * rng.standard_normal(u.shape)
    >>> found = compare_orders([TimeData(name="flight", inputs=u, outputs=y, sample_rate_hz=20.0)],
    ...                        inputs=["u"], outputs=["y"], highest=3)
    >>> found.order, [one.parameters for one in found.scores]
    (2, [2, 4, 6])
    """
    if not 1 <= highest <= 20:
        raise UsageError(f"a highest order of {highest} is not possible", needed="one from 1 to 20")
    parts = held_out(records)
    whole = _Posed(tuple(inputs), tuple(outputs), delays, hold, unknowns, plan or StartPlan())
    posed = whole.single_pairs() if decoupled else [(slice(None), whole)]
    scores: list[OrderScore] = []
    for order in range(1, highest + 1):
        progress(order)
        scores.append(_scored(order, records, parts, posed))
        if _falls(scores):
            break
    known = [score for score in scores if not score.refused]
    if not known:
        raise InsufficientDataError(
            "no black box of any order could be scored: " + "; ".join(dict.fromkeys(s.refused for s in scores)),
            needed="longer or more records",
        )
    best = max(known, key=lambda score: score.unseen_percent)
    compared = [score if score.refused else _difference_from(score, best) for score in scores]
    order = min(score.order for score in compared if not score.refused and score.behind_percent <= score.behind_error)
    samples = sum(record.samples for record in records)
    return OrderComparison(
        scores=tuple(compared),
        order=order,
        best=best.order,
        records=tuple(record.name for record in parts),
        chance=2.0 / math.sqrt(samples),
    )


@dataclass(frozen=True)
class _Posed:
    """Problem common to all orders."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    delays: bool
    hold: Hold
    unknowns: tuple[InitialCondition, ...]
    plan: StartPlan

    def fitted(self, records: Sequence[TimeData], order: int) -> BlackBoxFit:
        return fit_black_box(
            records,
            order,
            inputs=self.inputs,
            outputs=self.outputs,
            delays=self.delays,
            hold=self.hold,
            unknowns=self.unknowns,
            plan=self.plan,
        )

    def single_pairs(self) -> list[tuple[slice, _Posed]]:
        """Every input with its output, and their rows."""
        return [
            (slice(row, row + 1), replace(self, inputs=(u,), outputs=(y,)))
            for row, (u, y) in enumerate(zip(self.inputs, self.outputs, strict=True))
        ]


def _rows(records: Sequence[TimeData], rows: slice) -> list[TimeData]:
    return [
        replace(record, inputs=record.inputs[rows], outputs=record.outputs[rows], before=record.before[rows])
        for record in records
    ]


def _scored(
    order: int, records: Sequence[TimeData], parts: Sequence[TimeData], posed: Sequence[tuple[slice, _Posed]]
) -> OrderScore:
    """Black boxes of one order, each on its own rows, with the sum or mean over all."""
    try:
        fits = [(item, rows, item.fitted(_rows(records, rows), order)) for rows, item in posed]
        unseen = np.mean([_unseen(fit, _rows(parts, rows), posed) for posed, rows, fit in fits], axis=0)
    except (InsufficientDataError, ModelError) as error:
        return OrderScore(order=order, refused=error.came.rstrip("."))
    numbers, twice, explained, color = 0, 0.0, [], 0.0
    for item, rows, found in fits:
        fit = found.fit
        errors = [kept.record.outputs - kept.predicted for kept in fit.problem.predicted(fit.solution.theta)]
        outputs = len(item.outputs)
        estimated = sum(part.unknown.shape[2] for part in fit.problem.parts(fit.solution.theta))
        numbers += len(found.parameters.free) + estimated + outputs * (outputs + 1) // 2
        twice -= 2.0 * fit.log_likelihood
        explained.append(_explained(_rows(records, rows), errors))
        color = max(color, _color(errors))
    count = sum(record.samples for record in records) * len(records[0].outputs)
    return OrderScore(
        order=order,
        parameters=sum(len(found.parameters.free) for _, _, found in fits),
        fitted_percent=float(np.mean(explained)),
        unseen_percent=float(unseen.mean()),
        unseen_error=_error(unseen),
        aic=2.0 * numbers + twice,
        bic=math.log(count) * numbers + twice,
        color=color,
        unseen=unseen,
    )


def _unseen(whole: BlackBoxFit, parts: Sequence[TimeData], posed: _Posed) -> FloatArray:
    """Score of each part by the model that was fitted to all others, shape ``(parts,)``."""
    base = whole.fit.problem.with_parameters(whole.parameters)

    def fit(training: tuple[TimeData, ...]) -> ParameterSet:
        problem = replace(base, records=training)
        return fit_output_error(problem, starts=[problem.parameters.pack()], solver=_SEARCH).parameters

    def score(parameters: ParameterSet, part: TimeData) -> list[FixedParameterScores]:
        values, unknowns = parameters.values, posed.unknowns
        return [score_frozen(whole.structure, values, part, horizon_s=math.inf, hold=posed.hold, unknowns=unknowns)]

    names = [record.name for record in parts]
    found = cross_validate(parts, names=names, kind="leave_one_out", fit=fit, score=score)
    means = np.asarray(found.fold_means, dtype=np.float64)
    if not np.isfinite(means).all():
        causes = "; ".join(dict.fromkeys(fold.cause for fold in found.folds if fold.cause))
        raise InsufficientDataError(causes or "an unseen part has no score")
    size = np.array([record.samples * len(posed.outputs) for record in parts], dtype=np.float64)
    states = len(whole.structure.states) if "initial_state" in posed.unknowns else 0
    shifts = len(posed.outputs) if "output_shift" in posed.unknowns else 0
    # What is estimated on the part itself takes its share of the noise.
    return np.asarray(100.0 - (100.0 - means) * np.sqrt(size / (size - states - shifts)))


def _falls(scores: Sequence[OrderScore]) -> bool:
    """Whether the last orders lie clearly behind the best."""
    known = [score for score in scores if not score.refused]
    if len(known) <= _WORSE:
        return False
    best = max(known, key=lambda score: score.unseen_percent)
    last = [_difference_from(score, best) for score in known[-_WORSE:]]
    return all(score.behind_percent > score.behind_error for score in last)


def _difference_from(score: OrderScore, best: OrderScore) -> OrderScore:
    difference = best.unseen - score.unseen
    return replace(score, behind_percent=float(difference.mean()), behind_error=_error(difference))


def _error(values: FloatArray) -> float:
    """Standard error of a mean."""
    return float(np.std(values, ddof=1) / math.sqrt(values.size)) if values.size > 1 else 0.0


def _explained(records: Sequence[TimeData], errors: Sequence[FloatArray]) -> float:
    """Share of the motion of each output that is explained, all records together, in percent; the mean of them."""
    missed = sum((np.sum(error**2, axis=1) for error in errors), start=np.zeros(len(errors[0])))
    centered = [record.outputs - record.outputs.mean(axis=1, keepdims=True) for record in records]
    moved = sum((np.sum(values**2, axis=1) for values in centered), start=np.zeros(len(errors[0])))
    return float(np.mean(100.0 * (1.0 - np.sqrt(missed / moved))))


def _color(errors: Sequence[FloatArray]) -> float:
    """Largest autocorrelation of any output beyond lag zero, without sign."""
    centered = [error - error.mean(axis=1, keepdims=True) for error in errors]
    power = sum((np.sum(values**2, axis=1) for values in centered), start=np.zeros(len(errors[0])))
    largest = 0.0
    for lag in range(1, min(_LAGS, min(values.shape[1] for values in centered) - 1) + 1):
        product = sum(
            (np.sum(values[:, lag:] * values[:, :-lag], axis=1) for values in centered), start=np.zeros_like(power)
        )
        largest = max(largest, float(np.max(np.abs(product) / power)))
    return largest
