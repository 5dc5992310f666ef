"""Step responses of identified models, each pair of an input and an output that at least two of them have.

A log seldom holds a step, and how a delay, an order or a zero changes an answer shows best in one. So every model is
simulated from rest with an input that steps by one unit at zero, its delay included and linear about trim; vehicles
drawn from the covariance of its parameters give the band.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.quantity import Quantity
from rotorid.errors import RotoridError
from rotorid.flying.flown_models import band_of, drawn_values, with_values
from rotorid.models.structure import answers
from rotorid.results.model import IdentifiedModel
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray

_SAMPLES = 400
_LONGEST_S, _SHORTEST_S = 5.0, 0.5
_TIME_CONSTANTS, _GROWTHS = 8.0, 2.0
"""So many of the slowest time constant are shown, and so many e-foldings of what grows."""

_SLOWEST_1_S = 0.5
"""Slower modes than this are trends within the time that is shown."""

_SETTLED = 0.02
"""Share by which the last tenth may still change of a response whose rise is measured."""

_MOST_PAIRS = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelStep(Immutable):
    """The answer of one model to a unit step.

    Parameters
    ----------
    response, lower, upper
        Output in its unit for each unit of the input, and the band of 95 % of its parameters, shape ``(samples,)``.
    rise_s, rise_std_s
        Time from 10 to 90 % of the final value, and its standard deviation; ``None`` of one that does not settle.
    start_s
        Time to 10 %: the delay and the first part of the rise.
    """

    response: FloatArray
    lower: FloatArray
    upper: FloatArray
    rise_s: float | None
    rise_std_s: float | None
    start_s: float | None

    def __post_init__(self) -> None:
        self._set(
            **{name: read_only(getattr(self, name), np.float64, ndim=1) for name in ("response", "lower", "upper")}
        )


def _none() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredStep(Immutable):
    """The answer to a unit step as a log shows it, or why it does not.

    Parameters
    ----------
    log
        Its name.
    time_s, response, lower, upper
        Answer with its pointwise band of 95 %, shape ``(samples,)``; empty where there is none.
    rise
        Time from 10 to 90 %; ``None`` where it was not measured.
    why
        What the log lacks; empty where it lacks nothing.
    """

    log: str
    time_s: FloatArray = field(default_factory=_none)
    response: FloatArray = field(default_factory=_none)
    lower: FloatArray = field(default_factory=_none)
    upper: FloatArray = field(default_factory=_none)
    rise: Quantity | None = None
    why: str = ""

    def __post_init__(self) -> None:
        names = ("time_s", "response", "lower", "upper")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1) for name in names})


@dataclass(frozen=True, kw_only=True, eq=False)
class StepPair(Immutable):
    """One pair of an input and an output under several models.

    Parameters
    ----------
    time_s
        Shape ``(samples,)``; the input steps at zero.
    models
        Label to its answer.
    measured
        What logs show of it; empty without logs, and for inputs that are no set-point of a loop.
    """

    input: str
    output: str
    time_s: FloatArray
    models: Mapping[str, ModelStep]
    measured: tuple[MeasuredStep, ...] = ()

    def __post_init__(self) -> None:
        self._set(time_s=read_only(self.time_s, np.float64, ndim=1), models=self.models)


def compared_steps(models: Mapping[str, IdentifiedModel], *, seed: int = 0) -> tuple[StepPair, ...]:
    """Step responses of several models, pair by pair.

    Parameters
    ----------
    models
        Label to the model.
    seed
        For the vehicles of the bands.

    Returns
    -------
    tuple of StepPair
        At most six, those of most models first; empty where the models share no pair.
    """
    pairs: dict[tuple[str, str], list[str]] = {}
    for label, model in models.items():
        for output, row in zip(model.structure.outputs, answers(model.structure), strict=True):
            for name, acts in zip(model.structure.inputs, row, strict=True):
                if acts:
                    pairs.setdefault((name, output), []).append(label)
    shared = sorted((pair for pair, labels in pairs.items() if len(labels) > 1), key=lambda pair: -len(pairs[pair]))
    if not shared:
        return ()
    shown = list(dict.fromkeys(shared))[:_MOST_PAIRS]
    used = {label: models[label] for label in models if any(label in pairs[pair] for pair in shown)}
    time_s = _times(used)
    found = {label: _steps(model, time_s, seed) for label, model in used.items()}
    return tuple(
        StepPair(
            input=name,
            output=output,
            time_s=time_s,
            models={
                label: found[label][name, output] for label in pairs[name, output] if (name, output) in found[label]
            },
        )
        for name, output in shown
    )


def _times(models: Mapping[str, IdentifiedModel]) -> FloatArray:
    """Long enough for the slowest mode that settles, and too short for what grows to hide it."""
    longest, shown = _SHORTEST_S, _LONGEST_S
    for model in models.values():
        rates = model.system.poles().real
        slow = [1.0 / -rate for rate in rates if rate < -_SLOWEST_1_S]
        delay_s = float(np.max(model.system.input_delays_s, initial=0.0))
        longest = max(longest, _TIME_CONSTANTS * max(slow, default=_LONGEST_S) + 2.0 * delay_s)
        grows = float(rates.max(initial=0.0))
        shown = min(shown, _GROWTHS / grows if grows > _SLOWEST_1_S else math.inf)
    return np.linspace(0.0, min(longest, shown), _SAMPLES)


def _steps(model: IdentifiedModel, time_s: FloatArray, seed: int) -> dict[tuple[str, str], ModelStep]:
    """Answers of all outputs of a model to a step of each input."""
    linear = replace(model, nonlinear=None)
    parameters = model.structure.parameters
    draws = [with_values(linear, values) for values in drawn_values(linear, parameters, seed=seed)]
    found: dict[tuple[str, str], ModelStep] = {}
    for row, name in enumerate(model.structure.inputs):
        whole = _answer(linear, row, time_s)
        if whole is None:
            continue
        others = [rows for one in draws if (rows := _answer(one, row, time_s)) is not None]
        lower, upper = band_of(whole, others)
        for place, output in enumerate(model.structure.outputs):
            start_s, rise_s = _rise(time_s, whole[place])
            rises = [rise for one in others if (rise := _rise(time_s, one[place])[1]) is not None]
            spread = float(np.std(rises)) if rise_s is not None and len(rises) > 0.9 * len(others) > 0 else None
            found[name, output] = ModelStep(
                response=whole[place],
                lower=lower[place],
                upper=upper[place],
                rise_s=rise_s,
                rise_std_s=spread,
                start_s=start_s,
            )
    return found


def _answer(model: IdentifiedModel, row: int, time_s: FloatArray) -> FloatArray | None:
    """Outputs after a step of one input, shape ``(y, samples)``; ``None`` of values that cannot be simulated."""
    inputs = np.zeros((len(model.structure.inputs), time_s.size))
    inputs[row] = 1.0
    try:
        rows = simulate_linear(model.system, inputs, sample_rate_hz=1.0 / (time_s[1] - time_s[0]), hold="zero")
    except RotoridError:
        return None
    return rows if np.isfinite(rows).all() else None


def _rise(time_s: FloatArray, response: FloatArray) -> tuple[float | None, float | None]:
    """Time to 10 % and from there to 90 % of the final value; ``None`` where the response does not settle."""
    final = float(response[-1])
    late = response[-time_s.size // 10 :]
    if final == 0.0 or float(np.ptp(late)) > _SETTLED * abs(final):
        return None, None
    share = response / final
    first, last = (_passed(time_s, share, level) for level in (0.1, 0.9))
    return first, last - first


def _passed(time_s: FloatArray, share: FloatArray, level: float) -> float:
    place = int(np.argmax(share >= level))
    if place == 0:
        return float(time_s[0])
    before, after = share[place - 1], share[place]
    return float(time_s[place - 1] + (level - before) / (after - before) * (time_s[place] - time_s[place - 1]))
