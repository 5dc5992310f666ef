"""The page of a design: what to fly, what it reaches in the simulator, and how well it will measure parameters.

Every plan has its tables, sentences and pictures: its flight, the spectra of its inputs, and the response that is
expected. Several plans are compared by the standard deviations of their parameters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np

from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.display import counted, listed
from rotorid.data.findings import worst_first
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape, SimulatedFlight
from rotorid.data.quantity import percent, significant, unit, with_error
from rotorid.data.trust import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT
from rotorid.documents.design import DesignDocument
from rotorid.errors import UsageError
from rotorid.flying.designs import STEPS, Designed, Planned, PlanPrediction, as_flown
from rotorid.flying.settings import DesignSettings
from rotorid.planning.amplitude import Amplitude, Limits, Reached
from rotorid.planning.duration import Shortest
from rotorid.planning.prediction import PredictedParameter, Prediction
from rotorid.plans.files import file_use
from rotorid.plot.design import (
    Excited,
    Signal,
    Strip,
    excited_bands,
    percent_dots,
    percent_over_duration,
    planned_flight,
    predicted_bode,
)
from rotorid.plot.figure import quantity
from rotorid.report.findings import FindingRow, finding_rows
from rotorid.report.flight_card import FILE as CARD
from rotorid.report.flight_card import WHOLE_ERROR, amplitude_words
from rotorid.report.frame import Picture, drawn, in_all_units, render
from rotorid.report.parts import FAR_SIGMAS, Cell, by_axis, leading_pairs
from rotorid.report.words import parameter_words
from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from markupsafe import Markup

_KINDS: Mapping[Shape, str] = MappingProxyType({"two_one_one": "2-1-1", "three_two_one_one": "3-2-1-1"})
_ENTRIES: Mapping[Entry, str] = MappingProxyType(
    {
        "command": "mixer input",
        "rate_setpoint": "rate setpoint",
        "attitude_setpoint": "attitude setpoint",
        "stick": "pilot's stick",
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
"""Factor on standard deviations from which model error is reported."""

_MOST_NAMED = 6
"""Number of parameters that are named; more are counted."""


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
    return tuple(_input_row(planned, planned_input) for planned_input in planned.plan.inputs)


def _input_row(planned: Planned, planned_input: PlannedInput) -> InputRow:
    found = planned.amplitudes.get(f"{planned_input.shape} of {planned_input.axis}")
    symbol = unit(planned_input.unit)
    limit = "" if found is None else found.limited_by
    low, high = planned_input.band_rad_s or (math.nan, math.nan)
    return InputRow(
        axis=planned_input.axis,
        shape=kind_words(planned_input.shape),
        entry=_ENTRIES[planned_input.entry],
        interval=f"{planned_input.start_s:.1f} to {planned_input.stop_s:.1f}",
        band=f"{significant(low)} to {significant(high)}" if planned_input.band_rad_s else "",
        amplitude=f"{significant(planned_input.amplitude)} {symbol}".strip(),
        words=amplitude_words(planned_input),
        limited="given" if found is None else _LIMITS.get(limit, limit) if limit else "no limit up to 1",
        alone=_own_amplitude(found, symbol) if found is not None and limit else "",
    )


def _own_amplitude(found: Amplitude, symbol: str) -> str:
    """The largest amplitude of an axis alone, and of single flights where they differ."""
    low, high = found.spread
    differ = f" ({significant(low)} to {significant(high)} in single flights)" if high > _DIFFER * low > 0.0 else ""
    return f"on this axis alone, up to {significant(found.value)} {symbol}".strip() + differ


@dataclass(frozen=True, kw_only=True, slots=True)
class ReachedRow:
    """An extreme of a flight, and its limit."""

    words: str
    unit: str
    reached: Cell
    limit: str


def reached_rows(reached: Reached, limits: Limits) -> tuple[ReachedRow, ...]:
    """Extremes of the simulated flight with their limits; those beyond are marked."""
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
    """Predicted estimate of a parameter; percents are of its value."""

    name: str
    words: str
    unit: str
    value: str
    expected: str
    off: Cell
    percent: str
    random: str
    scatter: str
    least: str
    cramer_rao: Cell
    insensitivity: Cell


def predicted_rows(prediction: Prediction) -> tuple[PredictedRow, ...]:
    """One row for each parameter of the fit."""
    return tuple(_predicted_row(parameter) for parameter in prediction.parameters)


def _predicted_row(parameter: PredictedParameter) -> PredictedRow:
    sigmas = parameter.off_sigmas
    bound, insensitivity = parameter.cramer_rao_percent, parameter.insensitivity_percent
    return PredictedRow(
        name=parameter.name,
        words=parameter_words(parameter.name),
        unit=unit(parameter.unit),
        value=significant(parameter.value, digits=4),
        expected=with_error(parameter.expected, parameter.std),
        off=Cell(f"{sigmas:.1f} σ off", sigmas > FAR_SIGMAS),
        percent=percent(parameter.percent),
        random=percent(parameter.in_percent(parameter.std_random)),
        scatter=percent(parameter.in_percent(parameter.scatter)),
        least=percent(parameter.in_percent(parameter.lowest_std)),
        cramer_rao=Cell(percent(bound), CRAMER_RAO_GUIDELINE_PERCENT < bound < math.inf),
        insensitivity=Cell(percent(insensitivity), INSENSITIVITY_GUIDELINE_PERCENT < insensitivity < math.inf),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class UsableRow:
    """Usable part of a response."""

    name: str
    words: str
    band: str
    hertz: str
    points: str
    coherence: str
    error: str

    @property
    def usable(self) -> bool:
        """Whether any point is usable."""
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
    """How much model error widens the standard deviations, in a sentence; empty where it adds nothing."""
    if prediction.inflation < _INFLATED:
        return ""
    return (
        f"With model error and clocks, errors are {significant(prediction.inflation)} times larger than random error "
        "alone. A longer flight reduces only random error."
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class ComparedRow:
    """A parameter of a model in all plans: percents, infinite where a plan does not measure it, and their texts.

    ``minutes`` has the same for one minute of each plan.
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
    """A comparison of plans; ``durations`` are those of the whole flights."""

    plans: tuple[str, ...]
    durations: tuple[str, ...]
    rows: tuple[ComparedRow, ...]


def compared(designed: Sequence[Designed]) -> Compared:
    """Predicted percents of every parameter of every model, by plan; equal numbers are equally good."""
    known = [_percents(design) for design in designed]
    pairs = list(dict.fromkeys(pair for each in known for pair in each))
    names = [name for _, name in pairs]
    durations_s = [design.planned.plan.duration_s for design in designed]
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
        plans=tuple(kind_words(design.kind) for design in designed),
        durations=tuple(f"{duration_s:.0f} s" for duration_s in durations_s),
        rows=tuple(rows),
    )


def _percents(design: Designed) -> dict[tuple[str, str], float]:
    """Percents of the parameters that are not zero."""
    return {
        (predicted.model, parameter.name): parameter.percent
        for predicted in design.told
        for parameter in (predicted.prediction.parameters if predicted.prediction is not None else ())
        if math.isfinite(parameter.percent)
    }


def design_summary(designed: Sequence[Designed], choices: DesignSettings) -> tuple[str, ...]:
    """What to fly and how well it will measure, which plan is best, and the shortest duration where requested."""
    most = _best_sentences(compared(designed)) if len(designed) > 1 else []
    each = [_plan_sentence(design) for design in designed]
    reach = _shared_answers(designed) if len(designed) > 1 else list(reach_sentences(designed[0]))
    predicted = any(each.prediction is not None for design in designed for each in design.told)
    errors = [f"Expected errors are {WHOLE_ERROR}."] if predicted else []
    return (*most, *each, *errors, *reach, f"Planned for {choices.entry.name} in {wind_words(choices.plan.wind)}.")


def _plan_sentence(design: Designed) -> str:
    plan = design.planned.plan
    found = compared([design])
    lead = f"{kind_words(design.kind).capitalize()} on {listed(plan.axes)}, {plan.duration_s:.0f} s in all: "
    refused = [predicted.model for predicted in design.told if predicted.prediction is None]
    zero = sum(
        len(predicted.prediction.parameters) for predicted in design.told if predicted.prediction is not None
    ) - len(found.rows)
    parts = []
    if found.rows:
        worst = max(found.rows, key=lambda row: row.percent[0])
        low, high = percent(min(row.percent[0] for row in found.rows)), worst.texts[0]
        spread = low if low == high else f"{low} to {high}"
        count = "1 parameter" if len(found.rows) == 1 else f"{len(found.rows)} parameters"
        least = f" ({worst.label} is the least accurate)" if low != high else ""
        parts.append(f"expected error of {count}: {spread} %{least}")
    off = [
        f"{parameter.name} {significant(parameter.expected, digits=3)} instead of "
        f"{significant(parameter.value, digits=3)}, {parameter.off_sigmas:.0f} σ off"
        for predicted in design.told
        for parameter in (predicted.prediction.parameters if predicted.prediction is not None else ())
        if parameter.off_sigmas > FAR_SIGMAS
    ]
    if off:
        parts.append(f"biased estimates: {'; '.join(off)}")
    if zero:
        parts.append(f"{counted(zero, 'parameter')} with the value zero {'has' if zero == 1 else 'have'} no percentage")
    if refused:
        parts.append(f"not enough data for {listed(refused)}")
    return f"{lead}{'; '.join(parts)}."


def _best_sentences(found: Compared) -> list[str]:
    """Which plan is best for which parameters, apart from ties."""
    single_best = [row for row in found.rows if sum(row.best) == 1]
    best = {plan: [row.label for row in single_best if row.best[number]] for number, plan in enumerate(found.plans)}
    best_words = {plan: _named(labels, len(found.rows)) for plan, labels in best.items() if labels}
    return [f"{plan.capitalize()} is best for {words}." for plan, words in best_words.items()]


def _named(labels: Sequence[str], of: int) -> str:
    if len(labels) == of:
        return "every parameter"
    return listed(labels) if len(labels) <= _MOST_NAMED else f"{len(labels)} of {of} parameters"


def reach_sentences(design: Designed) -> tuple[str, ...]:
    """The shortest test input that is accurate enough, for each model."""
    return tuple(
        f"{_wanted(design.wanted[model])} in {model}: {found.words}{_least_tried(found)}"
        for model, found in design.shortest.items()
    )


def _least_tried(found: Shortest) -> str:
    return " Shorter ones were not tried." if found.duration_s == found.tried[0].duration_s else ""


def _shared_answers(designed: Sequence[Designed]) -> list[str]:
    """The shortest test inputs of all plans, one sentence for each model; misses have a sentence of their own."""
    sentences = []
    for model in dict.fromkeys(model for design in designed for model in design.shortest):
        asked = [design for design in designed if model in design.shortest]
        enough = [
            f"{found.duration_s:.0f} s of {kind_words(design.kind)}"
            for design in asked
            if (found := design.shortest[model]).duration_s is not None
        ]
        lead = f"{_wanted(asked[0].wanted[model])} in {model}: "
        if enough:
            sentences.append(f"{lead}{listed(enough)} are enough.")
        sentences += [
            f"{lead}{kind_words(design.kind)}: {design.shortest[model].words}"
            for design in asked
            if design.shortest[model].duration_s is None
        ]
    return sentences


def _wanted(wanted: Mapping[str, float]) -> str:
    return listed([f"{name} to {value:g} %" for name, value in wanted.items()])


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


_BINS_PER_DECADE = 25
_LEAST_LINES = 4
_DIFFER = 1.05
"""Largest over smallest amplitude of single flights, above which both are stated."""

_LONG_S = 60.0
_STEP_TURNS = 6.0
_LEAST_SHARE = 0.1


@dataclass(frozen=True, kw_only=True, slots=True)
class ExpectedPictures:
    """Bode pictures of a prediction: on the axis of their input, and cross-axis ones, which fold."""

    leading: tuple[Picture, ...]
    folded: tuple[Picture, ...]


def flown(design: Designed, choices: DesignSettings) -> SimulatedFlight:
    """The simulated flight of a plan with the first draw of wind and noise."""
    from rotorid.simulation.multirotor_flight import fly_multirotor

    return fly_multirotor(choices.aircraft, design.planned.plan, wind=choices.plan.wind, seed=choices.plan.seed)


def flight_picture(plan: FlightPlan, flight: SimulatedFlight, limits: Limits, *, key: str) -> Picture:
    """Test inputs over time, with tilt, rates, motors and position of the simulated flight."""
    time_s, truth = flight.time_s, flight.truth
    upright = np.clip(np.cos(truth["phi"]) * np.cos(truth["theta"]), -1.0, 1.0)
    motors = np.stack([values for name, values in flight.columns.items() if name.startswith("motor_")])
    away = np.hypot(truth["north"] - truth["north"][0], truth["east"] - truth["east"][0])
    strips = [
        *_input_strips(plan),
        Strip(
            label="Rates",
            signals=[Signal(axis, name, time_s, truth[name]) for axis, name in RATE_OF.items()],
            limits=(-limits.rate_rad_s, limits.rate_rad_s),
            height_px=130.0,
        ),
        Strip(
            label="Tilt",
            signals=[Signal("tilt", "phi", time_s, np.arccos(upright))],
            limits=(limits.tilt_rad,),
            height_px=100.0,
        ),
        Strip(
            label="Lowest and highest motor output",
            signals=[
                Signal("motors", "motor_1", time_s, motors.min(axis=0)),
                Signal("motors", "motor_1", time_s, motors.max(axis=0)),
            ],
            limits=(limits.motor_low, limits.motor_high),
        ),
        Strip(
            label="Distance and height from the start",
            signals=[
                Signal("distance", "north", time_s, away),
                Signal("height", "north", time_s, truth["down"][0] - truth["down"]),
            ],
            height_px=100.0,
        ),
    ]
    return Picture(
        key=key,
        description=(
            f"Test inputs of {plan.name} over time, and rates, tilt, motors and position of the simulated flight"
        ),
        figure=drawn(planned_flight, strips),
    )


def _input_strips(plan: FlightPlan) -> list[Strip]:
    """Test inputs, those of one unit in one panel."""
    groups: dict[str, list[Signal]] = {}
    for planned in plan.inputs:
        time_s = planned.start_s + np.arange(planned.values.size) / planned.sample_rate_hz
        signal = Signal(planned.axis, input_channel(planned), time_s, planned.values)
        groups.setdefault(quantity(signal.channel).unit, []).append(signal)
    return [Strip(label="Test inputs", signals=signals, height_px=110.0) for signals in groups.values()]


def input_channel(planned: PlannedInput) -> str:
    """The channel of the vocabulary that has the unit of a test input."""
    if planned.axis == "thrust" or planned.entry == "command":
        return f"{planned.axis}_excitation"
    if planned.entry == "stick":
        return f"{planned.axis}_stick"
    return f"{(RATE_OF if planned.entry == 'rate_setpoint' else ANGLE_OF)[planned.axis]}_setpoint"


def spectrum_picture(plan: FlightPlan, flies: FlightPlan, *, key: str) -> Picture:
    """Spectra of the test inputs as flown; of repeated ones the first."""
    first: dict[tuple[str, str], tuple[PlannedInput, bool]] = {}
    for sent, planned in zip(plan.inputs, flies.inputs, strict=True):
        # An input shaped by the autopilot has no lines.
        first.setdefault((planned.axis, planned.shape), (planned, planned.shape == "multisine" and planned is sent))
    shapes = {planned.shape for planned in plan.inputs}
    inputs = []
    for planned, lines in first.values():
        omega, values = density(planned, lines=lines)
        words = f"{planned.axis} {kind_words(planned.shape)}" if len(shapes) > 1 else planned.axis
        inputs.append(
            Excited(
                words=words,
                channel=input_channel(planned),
                omega_rad_s=omega,
                density=values,
                band_rad_s=planned.band_rad_s,
                lines=lines,
            )
        )
    return in_all_units(
        partial(excited_bands, inputs),
        key=key,
        description=f"Spectral densities of the test inputs of {plan.name}, their bands shaded",
    )


def density(planned: PlannedInput, *, lines: bool = False) -> tuple[FloatArray, FloatArray]:
    """One-sided spectral density of a test input in rad/s and SI units squared per hertz, each shape ``(f,)``.

    For the lines of a multisine, from a tenth of the largest amplitude, it is their power over the distance to their
    neighbors. Others are averaged in bins of a tenth of their frequency or four lines,
    whichever is wider.
    """
    rate_hz = planned.sample_rate_hz
    # The last sample of a multisine is a zero after its period.
    values = planned.values[:-1] if lines else planned.values
    size = values.size
    length = size if lines else max(size, round(_LONG_S * rate_hz))
    power = np.abs(np.fft.rfft(values, length)) ** 2
    frequency_hz: FloatArray = np.asarray(np.fft.rfftfreq(length, 1.0 / rate_hz), dtype=np.float64)
    if lines:
        there = np.flatnonzero(power > _LEAST_SHARE**2 * power[1:].max())
        there = there[there > 0]
        apart_hz = np.gradient(frequency_hz[there]) if there.size > 1 else np.full(there.size, rate_hz / size)
        return 2.0 * np.pi * frequency_hz[there], 2.0 * power[there] / size**2 / apart_hz
    # Half and twice the band, or the main band of steps.
    low, high = planned.band_rad_s or (0.4, _STEP_TURNS * 2.0 * np.pi * rate_hz / size)
    low_hz, high_hz = low / (4.0 * np.pi), min(high / np.pi, 0.5 * rate_hz)
    return _averaged(frequency_hz, 2.0 * power / (size * rate_hz), low_hz, high_hz)


def _averaged(
    frequency_hz: FloatArray, values: FloatArray, low_hz: float, high_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Means over bins that grow with frequency; rad/s and means."""
    ratio, least_hz = 10.0 ** (1.0 / _BINS_PER_DECADE), _LEAST_LINES * frequency_hz[1]
    edges = [max(low_hz, 0.5 * frequency_hz[1])]
    while edges[-1] < high_hz:
        edges.append(max(ratio * edges[-1], edges[-1] + least_hz))
    starts = np.unique(np.searchsorted(frequency_hz, edges[:-1]))
    starts = starts[starts < frequency_hz.size]
    stop = min(int(np.searchsorted(frequency_hz, edges[-1])), frequency_hz.size)
    counts = np.diff([*starts, stop])
    means = np.add.reduceat(values[:stop], starts) / counts
    centers_hz = np.add.reduceat(frequency_hz[:stop], starts) / counts
    return 2.0 * np.pi * centers_hz, means


def expected_pictures(prediction: Prediction, *, least_coherence: float, key: str) -> ExpectedPictures:
    """A Bode picture of each response with usable points."""
    response, used = prediction.response, prediction.used
    pairs = by_axis([(response.outputs[y], response.inputs[u]) for y, u in np.argwhere(used.any(axis=-1))])
    leading = leading_pairs(pairs)
    pictures = [
        in_all_units(
            partial(predicted_bode, response, output=output, input=input, used=used, least_coherence=least_coherence),
            key=f"{key}-{number}",
            description=f"Expected Bode plot of {quantity(output).words} over {quantity(input).words}",
            converted=True,
        )
        for number, (output, input) in enumerate(pairs)
    ]
    return ExpectedPictures(leading=tuple(pictures[:leading]), folded=tuple(pictures[leading:]))


def comparison_picture(compared: Compared, *, key: str) -> Picture:
    """Predicted percent by parameter and plan."""
    return Picture(
        key=key,
        description=f"Predicted standard deviations of every parameter: {', '.join(compared.plans)}",
        figure=drawn(
            percent_dots,
            [row.label for row in compared.rows],
            {plan: [row.percent[number] for row in compared.rows] for number, plan in enumerate(compared.plans)},
        ),
    )


def duration_picture(found: Shortest, wanted: Mapping[str, float], *, key: str) -> Picture | None:
    """Percent over the tried durations; ``None`` where fewer than two support the model."""
    tried = [attempt for attempt in found.tried if attempt.prediction is not None]
    if len(tried) < 2:
        return None
    known = [_percent(attempt.prediction) for attempt in tried if attempt.prediction is not None]
    return Picture(
        key=key,
        description=f"Predicted standard deviation of {', '.join(wanted)} over the duration of the test input",
        figure=drawn(
            percent_over_duration,
            np.array([attempt.duration_s for attempt in tried]),
            {name: np.array([each.get(name, np.inf) for each in known]) for name in wanted},
            wanted=wanted,
            found_s=found.duration_s,
        ),
    )


def _percent(prediction: Prediction) -> dict[str, float]:
    return {parameter.name: parameter.percent for parameter in prediction.parameters}


@dataclass(frozen=True, kw_only=True)
class ModelSection:
    """A model in a plan: its predicted accuracy, or why the data do not support it."""

    anchor: str
    name: str
    refused: str
    rows: tuple[PredictedRow, ...]
    usable: tuple[UsableRow, ...]
    inflation: str
    pictures: ExpectedPictures
    findings: tuple[FindingRow, ...]


@dataclass(frozen=True, kw_only=True)
class PlanSection:
    """A plan on the page."""

    anchor: str
    title: str
    name: str
    duration: str
    inputs: tuple[InputRow, ...]
    reached: tuple[ReachedRow, ...]
    flight: Picture
    spectrum: Picture
    models: tuple[ModelSection, ...]
    answers: tuple[str, ...]
    durations: tuple[Picture, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All pictures of the section."""
        of_models = [picture for model in self.models for picture in (*model.pictures.leading, *model.pictures.folded)]
        return (self.flight, self.spectrum, *of_models, *self.durations)


def render_design(
    designed: Sequence[Designed], choices: DesignSettings, *, title: str, document: DesignDocument | None = None
) -> str:
    """The page as one self-contained HTML document.

    Every plan is simulated once more for its picture: a tenth of a second for two minutes.

    Parameters
    ----------
    designed
        At least one plan with its predictions.
    document
        ``design.json``: adds provenance, and findings on files.

    Raises
    ------
    UsageError
        There is no plan.
    """
    if not designed:
        raise UsageError("the page has no plan", needed="at least one plan")
    plans = [_plan_section(design, choices, anchor=f"plan-{number}") for number, design in enumerate(designed, start=1)]
    side_by_side = compared(designed) if len(designed) > 1 else None
    if side_by_side is not None and not side_by_side.rows:
        side_by_side = None
    dots = comparison_picture(side_by_side, key="comparison") if side_by_side is not None else None
    return render(
        "design.html",
        logs=[choices.aircraft.autopilot.kind],
        title=title,
        sentences=design_summary(designed, choices),
        compared=side_by_side,
        dots=dots,
        plans=plans,
        grave={
            plan.title: grave for plan in plans if (grave := [section for section in plan.models if _grave(section)])
        },
        least_coherence=choices.fit.least_coherence,
        repeats=choices.plan.repeats,
        document=document,
        files=_plan_files(document),
        remarks=finding_rows(document.findings) if document is not None else (),
        pictures=[*([dots] if dots is not None else []), *(picture for plan in plans for picture in plan.pictures)],
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class PlanFiles:
    """The card of a plan, relative to the page, and what to do with its other files, as HTML with links."""

    title: str
    card: str
    before: Markup
    after: Markup


def _plan_files(document: DesignDocument | None) -> list[PlanFiles]:
    """The files of each plan and when each is loaded."""
    if document is None:
        return []
    found = []
    for plan in document.plans:
        place = f"{plan.folder}/" if plan.folder and plan.folder != "." else ""
        use = file_use(plan.files)
        found.append(
            PlanFiles(
                title=kind_words(plan.kind),
                card=f"{place}{CARD}",
                before=_linked(use.before, plan.files, place),
                after=_linked(use.after, plan.files, place),
            )
        )
    return found


def _linked(sentence: str, names: Sequence[str], place: str) -> Markup:
    """A sentence in which each name of a file is a link."""
    from markupsafe import Markup

    parts = re.split(f"({'|'.join(re.escape(name) for name in names)})", sentence) if names else [sentence]
    link = Markup('<a href="{}">{}</a>')
    return Markup("").join(link.format(quote(place + part), part) if part in names else part for part in parts)


def _plan_section(design: Designed, choices: DesignSettings, *, anchor: str) -> PlanSection:
    plan = design.planned.plan
    durations = [
        duration_picture(found, design.wanted[model], key=f"{anchor}-duration-{number}")
        for number, (model, found) in enumerate(design.shortest.items())
    ]
    asked = any(design.wanted.values())
    steps = ("The duration of steps follows from their band.",) if asked and design.kind in STEPS else ()
    return PlanSection(
        anchor=anchor,
        title=kind_words(design.kind).capitalize(),
        name=plan.name,
        duration=f"{plan.duration_s:.0f} s",
        inputs=input_rows(design.planned),
        reached=reached_rows(design.planned.reached, choices.plan.limits),
        flight=flight_picture(plan, flown(design, choices), choices.plan.limits, key=f"{anchor}-flight"),
        spectrum=spectrum_picture(plan, as_flown(choices.aircraft, plan), key=f"{anchor}-spectrum"),
        models=tuple(
            _model_section(predicted, choices, anchor=f"{anchor}-model-{number}")
            for number, predicted in enumerate(design.told)
        ),
        answers=(*reach_sentences(design), *steps),
        durations=tuple(picture for picture in durations if picture is not None),
    )


def _model_section(predicted: PlanPrediction, choices: DesignSettings, *, anchor: str) -> ModelSection:
    prediction = predicted.prediction
    if prediction is None:
        return ModelSection(
            anchor=anchor,
            name=predicted.model,
            refused=predicted.refused,
            rows=(),
            usable=(),
            inflation="",
            pictures=ExpectedPictures(leading=(), folded=()),
            findings=(),
        )
    return ModelSection(
        anchor=anchor,
        name=predicted.model,
        refused="",
        rows=predicted_rows(prediction),
        usable=usable_rows(prediction),
        inflation=inflation_words(prediction),
        pictures=expected_pictures(prediction, least_coherence=choices.fit.least_coherence, key=anchor),
        findings=finding_rows(worst_first(prediction.findings)),
    )


def _grave(model: ModelSection) -> bool:
    """Whether a finding limits the trust in the predictions of a model."""
    return bool(model.refused) or any(row.severity != "info" for row in model.findings)
