"""The shortest flight that reaches a wanted accuracy."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rotorid.data.flight_plan import FlightPlan
from rotorid.data.immutable import Immutable
from rotorid.design.choices import FitChoices
from rotorid.design.loop import LoopModel
from rotorid.design.prediction import Prediction, predict
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.structure import LinearStructure

_MISFIT = 1.5
"""Bounds inflated by more than that are those of a structure that does not fit."""

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
        self._set(tried=tuple(sorted(self.tried, key=lambda one: one.duration_s)))


def shortest(
    structure: LinearStructure,
    values: Mapping[str, float],
    loop: LoopModel,
    plan_of_duration: Callable[[float], FlightPlan],
    wanted: Mapping[str, float],
    *,
    shortest_s: float = 20.0,
    longest_s: float = 600.0,
    choices: FitChoices | None = None,
) -> Shortest:
    """Find the shortest flight after which every wanted parameter is known well enough.

    The interval is halved in the logarithm of the duration, down to 2 %. More time is taken to help; where window
    rules make a longer flight a little worse, the answer is one of the durations at which it becomes good enough. A
    structure that does not fit shows that the more the longer the flight is, and may be inflated beyond what is wanted:
    then halves of the longest duration are tried, too.

    Parameters
    ----------
    structure, values, loop, choices
        As for :func:`rotorid.design.prediction.predict`.
    plan_of_duration
        The plan for a duration in seconds, such as the length of each sweep.
    wanted
        Parameter to the largest standard deviation, in percent of its value.
    shortest_s, longest_s
        The durations to look between.

    Raises
    ------
    UsageError
        A wanted parameter is not among the free ones, a percent is not positive, or the limits are none.

    Examples
    --------
    >>> from rotorid.design.known_loops import axis_loop
    >>> from rotorid.design.spectrum import White
    >>> from rotorid.excitation.planned import planned, sequence
    >>> from rotorid.models.rate import rate_model
    >>> roll, truth = rate_model("rate.roll"), {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
    >>> loop = axis_loop(roll, truth, None, White(std=(0.1,), sample_rate_hz=200.0))
    >>> def sweep(duration_s: float) -> FlightPlan:
    ...     one = planned("roll", "pilot_sweep", start_s=0.0, amplitude=0.1, duration_s=duration_s,
    ...                   sample_rate_hz=200.0, band_rad_s=(1.0, 50.0))
    ...     return sequence("sweep", [one])
    >>> shortest(roll, truth, loop, sweep, {"L_roll": 3.0, "tau_roll": 20.0}).words
    '21 s are enough; tau_roll asks for the most.'
    """
    _require_wanted(structure, wanted, shortest_s, longest_s)

    def attempt(duration_s: float) -> Attempt:
        try:
            prediction = predict(structure, values, loop, plan_of_duration(duration_s), choices=choices)
        except InsufficientDataError:
            return Attempt(duration_s, math.inf, "", None)
        known = {one.name: one.percent for one in prediction.parameters}
        excess = {name: known.get(name, math.inf) / percent for name, percent in wanted.items()}
        limiting = max(excess, key=lambda name: excess[name])
        return Attempt(duration_s, excess[limiting], limiting, prediction)

    tried = [attempt(longest_s)]
    while tried[-1].excess > 1.0 and _misfits(tried[-1]) and 0.5 * tried[-1].duration_s > shortest_s:
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
        words=f"{high.duration_s:.0f} s are enough; {high.limiting} asks for the most.",
    )


def _misfits(one: Attempt) -> bool:
    """Whether bounds are inflated by a structure that does not fit."""
    return one.prediction is not None and one.prediction.inflation > _MISFIT


def _unreached(tried: Sequence[Attempt], wanted: Mapping[str, float]) -> Shortest:
    best = min(tried, key=lambda one: one.excess)
    prediction, name = best.prediction, best.limiting
    if prediction is None:
        words = f"No flight up to {best.duration_s:.0f} s could support the model."
    elif math.isinf(best.excess):
        words = f"No flight up to {best.duration_s:.0f} s shows {name} beside the other parameters."
    else:
        reached = best.excess * wanted[name]
        words = f"{best.duration_s:.0f} s bring {name} to {reached:.2g} %, and {wanted[name]:g} % are wanted."
        if _misfits(tried[0]):
            words += " The structure does not fit what will fly, and more time does not help against that."
    return Shortest(duration_s=None, limiting=name, prediction=prediction, tried=tuple(tried), words=words)


def _require_wanted(
    structure: LinearStructure, wanted: Mapping[str, float], shortest_s: float, longest_s: float
) -> None:
    free = structure.parameters.free
    for name, percent in wanted.items():
        if name not in free:
            near = difflib.get_close_matches(name, free, n=1)
            raise UsageError(
                f"{name} is no free parameter of {structure.name}",
                needed=f"one of {', '.join(free)}",
                remedy=f"did you mean {near[0]}?" if near else "",
            )
        if not 0.0 < percent < math.inf:
            raise UsageError(f"{percent:g} % of {name} came", needed="a positive number")
    if not wanted or not 0.0 < shortest_s < longest_s < math.inf:
        raise UsageError(
            f"{len(wanted)} wanted parameters and durations from {shortest_s:g} to {longest_s:g} s came",
            needed="at least one parameter, and a shortest duration below the longest",
        )
