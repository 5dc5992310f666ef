"""How long to fly: the shortest flight that reaches a requested accuracy, and the best of several plans."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import InsufficientDataError, UsageError, nearest_name
from rotorid.models.structure import LinearStructure
from rotorid.planning.expected import FitSettings
from rotorid.planning.loop import LoopModel
from rotorid.planning.prediction import Prediction, predict
from rotorid.typing import FloatArray

_TOLERANCE = 0.02
"""Relative width of the interval at which the search for a duration ends."""


class Attempt(NamedTuple):
    """A duration that was tried.

    Parameters
    ----------
    duration_s
        What the plan was made for.
    excess
        Largest ratio of a predicted percent to the wanted one; up to one is good enough.
    limiting
        The parameter of that ratio; empty where the flight could not support the model at all.
    prediction
        What was predicted, if anything.
    """

    duration_s: float
    excess: float
    limiting: str
    prediction: Prediction | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Shortest(Immutable):
    """The answer to a question for a duration.

    Parameters
    ----------
    duration_s
        The shortest that is good enough, or ``None``.
    limiting
        The parameter that asks for it, or that no duration brings to what is wanted; empty where the longest flight
        could not support the model at all.
    prediction
        At that duration, or at the best one that was tried.
    tried
        Everything that was tried, in the order of durations.
    words
        The answer as a sentence.
    """

    duration_s: float | None
    limiting: str
    prediction: Prediction | None
    tried: tuple[Attempt, ...]
    words: str

    def __post_init__(self) -> None:
        self._set(tried=tuple(sorted(self.tried, key=lambda attempt: attempt.duration_s)))


def shortest(
    structure: LinearStructure,
    values: Mapping[str, float],
    loop: LoopModel,
    plan_of_duration: Callable[[float], FlightPlan],
    wanted: Mapping[str, float],
    *,
    shortest_s: float = 20.0,
    longest_s: float = 600.0,
    choices: FitSettings | None = None,
    foretell: Callable[..., Prediction] = predict,
) -> Shortest:
    """Find the shortest flight after which every wanted parameter is known well enough.

    The interval is halved in the logarithm of the duration, down to 2 %. More time is taken to help; where window
    rules make a longer flight a little worse, the answer is one of the durations at which it becomes good enough. Model
    error does not fall with the duration, and of a structure that does not fit it may grow: where it alone is beyond
    what is wanted, halves of the longest duration are tried, too.

    Parameters
    ----------
    structure, values, loop, choices
        As for :func:`rotorid.planning.prediction.predict`.
    plan_of_duration
        The plan for a duration in seconds, such as the length of each sweep.
    wanted
        Parameter to the largest standard deviation, in percent of its value.
    shortest_s, longest_s
        The durations to look between.
    foretell
        What says how well a plan will know the parameters, such as
        :func:`rotorid.planning.responses.predict_responses`.

    Raises
    ------
    UsageError
        A wanted parameter is not among the free ones, a percent is not positive, or the limits are none.

    Examples
    --------
    >>> from rotorid.planning.loop import axis_loop
    >>> from rotorid.planning.loop import White
    >>> from rotorid.excitation.plan import planned, sequence
    >>> from rotorid.models.library import rate_model
    >>> roll, truth = rate_model("rate.roll"), {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
    >>> loop = axis_loop(roll, truth, None, White(std=(0.1,), sample_rate_hz=200.0))
    >>> def sweep(duration_s: float) -> FlightPlan:
    ...     one = planned("roll", "pilot_sweep", start_s=0.0, amplitude=0.1, duration_s=duration_s,
    ...                   sample_rate_hz=200.0, band_rad_s=(1.0, 50.0))
    ...     return sequence("sweep", [one])
    >>> shortest(roll, truth, loop, sweep, {"L_roll": 2.5, "T_motor": 8.0}).words
    '20 s are enough (L_roll needs the longest).'
    """
    _require_wanted(structure, wanted, shortest_s, longest_s)

    def attempt(duration_s: float) -> Attempt:
        try:
            prediction = foretell(structure, values, loop, plan_of_duration(duration_s), choices=choices)
        except InsufficientDataError:
            return Attempt(duration_s, math.inf, "", None)
        known = {parameter.name: parameter.percent for parameter in prediction.parameters}
        excess = {name: known.get(name, math.inf) / percent for name, percent in wanted.items()}
        limiting = max(excess, key=lambda name: excess[name])
        return Attempt(duration_s, excess[limiting], limiting, prediction)

    tried = [attempt(longest_s)]
    while tried[-1].excess > 1.0 and _limit_of_model(tried[-1], wanted) and 0.5 * tried[-1].duration_s > shortest_s:
        tried.append(attempt(0.5 * tried[-1].duration_s))
    high = tried[-1]
    if high.excess > 1.0:
        return _unreached(tried, wanted)
    low = attempt(shortest_s)
    tried.append(low)
    if low.excess <= 1.0:
        high = low
    while high.duration_s > low.duration_s * (1.0 + _TOLERANCE):
        middle = attempt(math.sqrt(low.duration_s * high.duration_s))
        tried.append(middle)
        low, high = (low, middle) if middle.excess <= 1.0 else (middle, high)
    return Shortest(
        duration_s=high.duration_s,
        limiting=high.limiting,
        prediction=high.prediction,
        tried=tuple(tried),
        words=f"{high.duration_s:.0f} s are enough ({high.limiting} needs the longest).",
    )


def _limit_of_model(attempt: Attempt, wanted: Mapping[str, float]) -> float:
    """Model error of the limiting parameter in percent, where it alone is beyond what is wanted; else zero."""
    if attempt.prediction is None or math.isinf(attempt.excess):
        return 0.0
    limiting = attempt.prediction[attempt.limiting]
    percent = limiting.in_percent(limiting.std_model)
    return percent if percent > wanted[attempt.limiting] else 0.0


def _unreached(tried: Sequence[Attempt], wanted: Mapping[str, float]) -> Shortest:
    best = min(tried, key=lambda attempt: attempt.excess)
    prediction, name = best.prediction, best.limiting
    if prediction is None:
        words = f"Not enough data for this model even with {best.duration_s:.0f} s."
    elif math.isinf(best.excess):
        words = f"{name} cannot be separated from the other parameters even with {best.duration_s:.0f} s."
    else:
        reached = best.excess * wanted[name]
        asked = f"{wanted[name]:g} % requested"
        words = f"Not accurate enough: {best.duration_s:.0f} s measure {name} to {reached:.2g} %, {asked}."
        if missed := _limit_of_model(best, wanted):
            words += f" Model error alone is {missed:.2g} %, and a longer flight does not reduce it."
    return Shortest(duration_s=None, limiting=name, prediction=prediction, tried=tuple(tried), words=words)


def _require_wanted(
    structure: LinearStructure, wanted: Mapping[str, float], shortest_s: float, longest_s: float
) -> None:
    free = structure.parameters.free
    for name, percent in wanted.items():
        if name not in free:
            near = nearest_name(name, free)
            raise UsageError(
                f"{name} is no free parameter of {structure.name}",
                needed=f"one of {', '.join(free)}",
                remedy=f"did you mean {near}?" if near else "",
            )
        if not 0.0 < percent < math.inf:
            raise UsageError(f"the accuracy {percent:g} % of {name} is not positive", needed="a positive percentage")
    if not wanted or not 0.0 < shortest_s < longest_s < math.inf:
        raise UsageError(
            f"no requested parameter, or the durations {shortest_s:g} to {longest_s:g} s are empty",
            needed="at least one parameter, and a shortest duration below the longest",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison(Immutable):
    """A comparison of several plans for the same parameters.

    Parameters
    ----------
    plans
        Their names.
    duration_s
        Their lengths, shape ``(plans,)``.
    parameters
        Free parameters of the structure.
    percent
        Standard deviations in percent of the values, shape ``(plans, parameters)``; infinite where a plan does not
        show a parameter.
    predictions
        What stands behind it; ``None`` for a plan that could not support the model.
    refused
        Why not, by the name of the plan.
    """

    plans: tuple[str, ...]
    duration_s: FloatArray
    parameters: tuple[str, ...]
    percent: FloatArray
    predictions: tuple[Prediction | None, ...]
    refused: Mapping[str, str]

    def __post_init__(self) -> None:
        self._set(
            duration_s=read_only(self.duration_s, np.float64, ndim=1),
            percent=read_only(self.percent, np.float64, ndim=2),
            refused=self.refused,
        )

    @property
    def best(self) -> Mapping[str, str]:
        """The best plan for each parameter that any of them measures."""
        least = self.percent.argmin(axis=0)
        return {
            name: self.plans[row]
            for p, (name, row) in enumerate(zip(self.parameters, least, strict=True))
            if np.isfinite(self.percent[row, p])
        }

    @property
    def percent_of_a_minute(self) -> FloatArray:
        r"""What a minute of each plan is worth, :math:`p \sqrt{T / 60}`, as if errors fell with the root of time."""
        return np.asarray(self.percent * np.sqrt(self.duration_s / 60.0)[:, None])


def compare_plans(
    structure: LinearStructure,
    values: Mapping[str, float],
    loop: LoopModel,
    plans: Sequence[FlightPlan],
    *,
    choices: FitSettings | None = None,
) -> Comparison:
    """Predict several plans for the same vehicle and model.

    Parameters
    ----------
    structure, values, loop, choices
        As for :func:`rotorid.planning.prediction.predict`.
    plans
        At least one, each of its own name.

    Raises
    ------
    UsageError
        There is no plan, or two have one name.

    Examples
    --------
    >>> from rotorid.planning.loop import axis_loop
    >>> from rotorid.planning.loop import White
    >>> from rotorid.excitation.plan import planned, sequence
    >>> from rotorid.models.library import rate_model
    >>> roll, truth = rate_model("rate.roll"), {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
    >>> loop = axis_loop(roll, truth, None, White(std=(0.1,), sample_rate_hz=200.0))
    >>> def sweeps(name: str, amplitude: float) -> FlightPlan:
    ...     one = planned("roll", "pilot_sweep", start_s=0.0, amplitude=amplitude, duration_s=40.0,
    ...                   sample_rate_hz=200.0, band_rad_s=(1.0, 50.0))
    ...     return sequence(name, [one])
    >>> compare_plans(roll, truth, loop, [sweeps("soft", 0.05), sweeps("hard", 0.1)]).best["L_roll"]
    'hard'
    """
    names = tuple(plan.name for plan in plans)
    if not plans or len(set(names)) < len(names):
        raise UsageError(
            f"cannot compare the plans {', '.join(names) or '(none)'}",
            needed="at least one plan, each with its own name",
        )
    predictions: list[Prediction | None] = []
    refused = {}
    for plan in plans:
        try:
            predictions.append(predict(structure, values, loop, plan, choices=choices))
        except InsufficientDataError as error:
            predictions.append(None)
            refused[plan.name] = str(error)
    free = structure.parameters.free
    percent = np.full((len(plans), len(free)), np.inf)
    for row, prediction in zip(percent, predictions, strict=True):
        for parameter in prediction.parameters if prediction is not None else ():
            row[free.index(parameter.name)] = parameter.percent
    return Comparison(
        plans=names,
        duration_s=np.array([plan.duration_s for plan in plans]),
        parameters=free,
        percent=percent,
        predictions=tuple(predictions),
        refused=refused,
    )
