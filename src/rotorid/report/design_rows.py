"""What the page of a design says of plans: text for its tables, and sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rotorid.data.flight_plan import Entry, PlannedInput, Shape
from rotorid.design.amplitude import Limits, Reached
from rotorid.design.prediction import PredictedParameter, Prediction
from rotorid.design.shortest import Shortest
from rotorid.pipeline.design import DesignChoices, Designed
from rotorid.pipeline.planning import Planned
from rotorid.plot.quantity import quantity
from rotorid.report.flight_facts import unit_of
from rotorid.report.flight_words import amplitude_words
from rotorid.report.model_pictures import by_axis
from rotorid.report.numbers import percent, significant, unit, with_error
from rotorid.report.parameter_table import CRAMER_RAO_GUIDELINE, FAR_SIGMAS, INSENSITIVITY_GUIDELINE, Cell
from rotorid.report.wording import parameter_words
from rotorid.simulate.wind import Wind

_KINDS: Mapping[Shape, str] = MappingProxyType({"two_one_one": "2-1-1", "three_two_one_one": "3-2-1-1"})
_ENTRIES: Mapping[Entry, str] = MappingProxyType(
    {
        "command": "what the mixer receives",
        "rate_setpoint": "rate setpoint",
        "attitude_setpoint": "attitude setpoint",
        "stick": "stick of the pilot",
    }
)
_LIMITS: Mapping[str, str] = MappingProxyType(
    {
        "tilt_rad": "tilt",
        "rate_rad_s": "rates",
        "position_m": "distance from the start",
        "height_m": "height",
        "motor_low": "lowest motor output",
        "motor_high": "highest motor output",
        "saturated": "saturated motors",
        "control": "loss of control",
    }
)
_TURN = 2.0 * math.pi
_INFLATED = 1.05
_MOST_NAMED = 6


def kind_words(kind: Shape) -> str:
    """A shape in words.

    Examples
    --------
    >>> kind_words("random_binary"), kind_words("two_one_one")
    ('random binary', '2-1-1')
    """
    return _KINDS.get(kind, kind.replace("_", " "))


@dataclass(frozen=True, kw_only=True, slots=True)
class InputRow:
    """A test input."""

    axis: str
    shape: str
    entry: str
    interval: str
    band: str
    amplitude: str
    words: str
    limited: str
    alone: str


def input_rows(planned: Planned) -> tuple[InputRow, ...]:
    """One row for each test input of a plan."""
    return tuple(_input_row(planned, one) for one in planned.plan.inputs)


def _input_row(planned: Planned, one: PlannedInput) -> InputRow:
    found = planned.amplitudes.get(f"{one.shape} of {one.axis}")
    symbol = unit(unit_of(one))
    limit = "" if found is None else found.limited_by
    low, high = one.band_rad_s or (math.nan, math.nan)
    return InputRow(
        axis=one.axis,
        shape=kind_words(one.shape),
        entry=_ENTRIES[one.entry],
        interval=f"{one.start_s:.1f} to {one.stop_s:.1f}",
        band=f"{significant(low)} to {significant(high)}" if one.band_rad_s else "",
        amplitude=f"{significant(one.amplitude)} {symbol}".strip(),
        words=amplitude_words(one),
        limited="given" if found is None else _LIMITS.get(limit, limit) if limit else "no limit up to 1",
        alone=f"alone up to {significant(found.value)} {symbol}".strip() if found is not None and limit else "",
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class ReachedRow:
    """What a flight reaches of something, and its limit."""

    words: str
    unit: str
    reached: Cell
    limit: str


def reached_rows(reached: Reached, limits: Limits) -> tuple[ReachedRow, ...]:
    """Extremes of the simulated flight against the limits; what is beyond one is marked."""
    beyond = reached.beyond(limits)
    rows = (
        ("Largest tilt", "tilt_rad", "°", math.degrees(1.0), "at most"),
        ("Largest rate", "rate_rad_s", "°/s", math.degrees(1.0), "at most"),
        ("Distance from the start", "position_m", "m", 1.0, "at most"),
        ("Height above or below the start", "height_m", "m", 1.0, "at most"),
        ("Lowest motor output", "motor_low", "", 1.0, "at least"),
        ("Highest motor output", "motor_high", "", 1.0, "at most"),
        ("Time with saturated motors", "saturated", "%", 100.0, "at most"),
    )
    return tuple(
        ReachedRow(
            words=words,
            unit=symbol,
            reached=Cell(significant(factor * getattr(reached, name)), name in beyond),
            limit=f"{side} {significant(factor * getattr(limits, name))}",
        )
        for words, name, symbol, factor, side in rows
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class PredictedRow:
    """What the data will tell about a parameter; percents are of its value."""

    name: str
    words: str
    unit: str
    value: str
    expected: str
    off: Cell
    percent: str
    scatter: str
    least: str
    cramer_rao: Cell
    insensitivity: Cell


def predicted_rows(prediction: Prediction) -> tuple[PredictedRow, ...]:
    """One row for each parameter that the fit will keep."""
    return tuple(_predicted_row(one) for one in prediction.parameters)


def _predicted_row(one: PredictedParameter) -> PredictedRow:
    sigmas = abs(one.expected - one.value) / one.std if one.std > 0.0 else 0.0
    bound, insensitivity = one.in_percent(one.cramer_rao), one.in_percent(one.insensitivity)
    return PredictedRow(
        name=one.name,
        words=parameter_words(one.name),
        unit=unit(one.unit),
        value=significant(one.value, digits=4),
        expected=with_error(one.expected, one.std),
        off=Cell(f"{sigmas:.1f} σ off", sigmas > FAR_SIGMAS),
        percent=percent(one.percent),
        scatter=percent(one.in_percent(one.scatter)),
        least=percent(one.in_percent(one.lowest_std)),
        cramer_rao=Cell(percent(bound), CRAMER_RAO_GUIDELINE < bound < math.inf),
        insensitivity=Cell(percent(insensitivity), INSENSITIVITY_GUIDELINE < insensitivity < math.inf),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class UsableRow:
    """What will be usable of a response."""

    name: str
    words: str
    band: str
    hertz: str
    points: str
    coherence: str
    error: str

    @property
    def usable(self) -> bool:
        """Whether there is anything to use."""
        return self.points != "0"


def usable_rows(prediction: Prediction) -> tuple[UsableRow, ...]:
    """One row for each response ``output/input``, those on axis first; coherence and error are medians."""
    response = prediction.response
    pairs = by_axis([(output, input) for output in response.outputs for input in response.inputs])
    return tuple(_usable_row(prediction, output, input) for output, input in pairs)


def _usable_row(prediction: Prediction, output: str, input: str) -> UsableRow:
    response = prediction.response
    row = response.pair(output, input)
    used = prediction.used[row]
    omega = response.omega_rad_s[used]
    ends = (float(omega[0]), float(omega[-1])) if omega.size else (math.nan, math.nan)
    return UsableRow(
        name=f"{output}/{input}",
        words=f"{quantity(output).words} over {quantity(input).words}",
        band=f"{significant(ends[0])} to {significant(ends[1])}",
        hertz=f"{significant(ends[0] / _TURN)} to {significant(ends[1] / _TURN)} Hz",
        points=str(omega.size),
        coherence=f"{np.median(response.coherence[row][used]):.2f}" if omega.size else "",
        error=significant(100.0 * float(np.median(response.random_error[row][used])), digits=2) if omega.size else "",
    )


def inflation_words(prediction: Prediction) -> str:
    """What a structure that does not fit does to the standard deviations; empty where it fits."""
    if prediction.inflation < _INFLATED:
        return ""
    return (
        f"The structure does not fit what will fly: standard deviations hold a factor of "
        f"{significant(prediction.inflation)} for it, which more time does not lessen."
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class ComparedRow:
    """A parameter of a model in all plans: percents, infinite where a plan does not show it, and what is written.

    ``minutes`` holds what a minute of each plan is worth.
    """

    model: str
    name: str
    label: str
    percent: tuple[float, ...]
    texts: tuple[str, ...]
    minutes: tuple[str, ...]
    best: tuple[bool, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Compared:
    """Plans side by side; ``durations`` are those of the whole flights."""

    plans: tuple[str, ...]
    durations: tuple[str, ...]
    rows: tuple[ComparedRow, ...]


def compared(designed: Sequence[Designed]) -> Compared:
    """Predicted percents of every parameter of every model, plan by plan; equal numbers are equally good."""
    known = [_percents(one) for one in designed]
    pairs = list(dict.fromkeys(pair for each in known for pair in each))
    names = [name for _, name in pairs]
    durations_s = [one.planned.plan.duration_s for one in designed]
    rows = []
    for model, name in pairs:
        values = tuple(each.get((model, name), math.inf) for each in known)
        texts = tuple(percent(value) for value in values)
        best = percent(min(values))
        rows.append(
            ComparedRow(
                model=model,
                name=name,
                label=f"{name} of {model}" if names.count(name) > 1 else name,
                percent=values,
                texts=texts,
                minutes=tuple(
                    f"{percent(value * math.sqrt(duration_s / 60.0))} of a minute" if math.isfinite(value) else ""
                    for value, duration_s in zip(values, durations_s, strict=True)
                ),
                best=tuple(written == best for written in texts),
            )
        )
    return Compared(
        plans=tuple(kind_words(one.kind) for one in designed),
        durations=tuple(f"{duration_s:.0f} s" for duration_s in durations_s),
        rows=tuple(rows),
    )


def _percents(one: Designed) -> dict[tuple[str, str], float]:
    """Those that there are: a parameter of the value zero has none."""
    return {
        (told.model, parameter.name): parameter.percent
        for told in one.told
        for parameter in (told.prediction.parameters if told.prediction is not None else ())
        if math.isfinite(parameter.percent)
    }


def design_summary(designed: Sequence[Designed], choices: DesignChoices) -> tuple[str, ...]:
    """Which plan tells most, what each will tell, and the answers to what was asked for."""
    most = _best_sentences(compared(designed)) if len(designed) > 1 else []
    each = [_plan_sentence(one) for one in designed]
    reach = _shared_answers(designed) if len(designed) > 1 else list(reach_sentences(designed[0]))
    return (*most, *each, *reach, f"All of it is for {choices.vehicle} in {wind_words(choices.plan.wind)}.")


def _plan_sentence(one: Designed) -> str:
    plan = one.planned.plan
    found = compared([one])
    lead = f"{kind_words(one.kind).capitalize()} on {_listed(plan.axes)}, {plan.duration_s:.0f} s in all: "
    refused = [told.model for told in one.told if told.prediction is None]
    zero = sum(len(told.prediction.parameters) for told in one.told if told.prediction is not None) - len(found.rows)
    parts = []
    if found.rows:
        worst = max(found.rows, key=lambda row: row.percent[0])
        low, high = percent(min(row.percent[0] for row in found.rows)), worst.texts[0]
        spread = low if low == high else f"{low} to {high}"
        count = "1 parameter" if len(found.rows) == 1 else f"{len(found.rows)} parameters"
        least = f", {worst.label} worst" if low != high else ""
        parts.append(f"it will tell {count} with standard deviations of {spread} %{least}")
    if zero:
        parts.append(f"{zero} more {'is' if zero == 1 else 'are'} zero, of which there is no percent")
    if refused:
        parts.append(f"it cannot support {_listed(refused)}")
    return f"{lead}{'; '.join(parts)}."


def _best_sentences(found: Compared) -> list[str]:
    """Which plan tells most about what, but for those parameters that several tell equally well."""
    alone = [row for row in found.rows if sum(row.best) == 1]
    best = {plan: [row.label for row in alone if row.best[number]] for number, plan in enumerate(found.plans)}
    told = {plan: _named(labels, len(found.rows)) for plan, labels in best.items() if labels}
    return [f"{plan.capitalize()} tells most about {words}." for plan, words in told.items()]


def _named(labels: Sequence[str], of: int) -> str:
    if len(labels) == of:
        return "every parameter"
    return _listed(labels) if len(labels) <= _MOST_NAMED else f"{len(labels)} of {of} parameters"


def reach_sentences(one: Designed) -> tuple[str, ...]:
    """The answer to a question for the shortest test input, for each model."""
    return tuple(
        f"{_wanted(one.wanted[model])} in {model}: {found.words}{_least_tried(found)}"
        for model, found in one.shortest.items()
    )


def _least_tried(found: Shortest) -> str:
    return " Nothing shorter was tried." if found.duration_s == found.tried[0].duration_s else ""


def _shared_answers(designed: Sequence[Designed]) -> list[str]:
    """The answers of all plans, one sentence for each model; what is not reached in the words of its own."""
    sentences = []
    for model in dict.fromkeys(model for one in designed for model in one.shortest):
        asked = [one for one in designed if model in one.shortest]
        enough = [
            f"{found.duration_s:.0f} s of {kind_words(one.kind)}"
            for one in asked
            if (found := one.shortest[model]).duration_s is not None
        ]
        lead = f"{_wanted(asked[0].wanted[model])} in {model}: "
        if enough:
            sentences.append(f"{lead}{_listed(enough)} are enough.")
        sentences += [
            f"{lead}{kind_words(one.kind)}: {one.shortest[model].words}"
            for one in asked
            if one.shortest[model].duration_s is None
        ]
    return sentences


def _wanted(wanted: Mapping[str, float]) -> str:
    return _listed([f"{name} to {value:g} %" for name, value in wanted.items()])


def wind_words(wind: Wind) -> str:
    """A wind in words.

    Examples
    --------
    >>> wind_words(Wind()), wind_words(Wind(north_m_s=3.0, turbulence_m_s=0.5))
    ('still air', 'wind of 3 m/s with turbulence of 0.5 m/s')
    """
    steady_m_s = math.hypot(wind.north_m_s, wind.east_m_s)
    turbulence = f"turbulence of {significant(wind.turbulence_m_s)} m/s" if wind.turbulence_m_s else ""
    steady = f"wind of {significant(steady_m_s)} m/s" if steady_m_s else ""
    return " with ".join(part for part in (steady, turbulence) if part) or "still air"


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
