"""The pictures of the page of a design: the flight of each plan, what it excites, what its data will tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.design.amplitude import Limits
from rotorid.design.prediction import Prediction
from rotorid.design.shortest import Shortest
from rotorid.pipeline.design import DesignChoices, Designed
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
from rotorid.plot.quantity import quantity
from rotorid.report.design_rows import Compared, kind_words
from rotorid.report.model_pictures import by_axis, on_axis
from rotorid.report.picture import Picture, in_all_units
from rotorid.typing import Axis, FloatArray

_RATES: Mapping[Axis, str] = MappingProxyType({"roll": "p", "pitch": "q", "yaw": "r"})
_ANGLES: Mapping[Axis, str] = MappingProxyType({"roll": "phi", "pitch": "theta", "yaw": "psi"})
_BINS_PER_DECADE = 25
_LEAST_LINES = 4
_LONG_S = 60.0
_STEP_TURNS = 6.0
_LEAST_SHARE = 0.1
_MOST_UNFOLDED = 4


@dataclass(frozen=True, kw_only=True, slots=True)
class ExpectedPictures:
    """Bode pictures of a prediction in sight, and those that fold away: what one axis does to another."""

    leading: tuple[Picture, ...]
    folded: tuple[Picture, ...]


def flown(one: Designed, choices: DesignChoices) -> SimulatedFlight:
    """The flight whose extremes the plan holds, once more: the same wind and the same noise."""
    from rotorid.simulate.multirotor_flight import fly_multirotor

    return fly_multirotor(choices.aircraft, one.planned.plan, wind=choices.plan.wind, seed=choices.plan.seed)


def flight_picture(plan: FlightPlan, flight: SimulatedFlight, limits: Limits, *, key: str) -> Picture:
    """Test inputs over time, and tilt, rates, motors and place of the simulated flight."""
    time_s, truth = flight.time_s, flight.truth
    upright = np.clip(np.cos(truth["phi"]) * np.cos(truth["theta"]), -1.0, 1.0)
    motors = np.stack([values for name, values in flight.columns.items() if name.startswith("motor_")])
    away = np.hypot(truth["north"] - truth["north"][0], truth["east"] - truth["east"][0])
    strips = [
        *_input_strips(plan),
        Strip(
            label="Rates",
            signals=[Signal(axis, name, time_s, truth[name]) for axis, name in _RATES.items()],
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
            label="Distance from the start, and height above it",
            signals=[
                Signal("distance", "north", time_s, away),
                Signal("height", "north", time_s, truth["down"][0] - truth["down"]),
            ],
            height_px=100.0,
        ),
    ]
    return Picture(
        key=key,
        description=f"Test inputs of {plan.name} over time, and rates, tilt, motors and place of the simulated flight",
        figure=planned_flight(strips),
    )


def _input_strips(plan: FlightPlan) -> list[Strip]:
    """Test inputs, those of one unit in one panel."""
    groups: dict[str, list[Signal]] = {}
    for one in plan.inputs:
        time_s = one.start_s + np.arange(one.values.size) / one.sample_rate_hz
        signal = Signal(one.axis, input_channel(one), time_s, one.values)
        groups.setdefault(quantity(signal.channel).unit, []).append(signal)
    return [Strip(label="Test inputs", signals=signals, height_px=110.0) for signals in groups.values()]


def input_channel(one: PlannedInput) -> str:
    """The channel of the vocabulary that has the unit of a test input."""
    if one.axis == "thrust" or one.entry == "command":
        return f"{one.axis}_excitation"
    if one.entry == "stick":
        return f"{one.axis}_stick"
    return f"{(_RATES if one.entry == 'rate_setpoint' else _ANGLES)[one.axis]}_setpoint"


def spectrum_picture(plan: FlightPlan, *, key: str) -> Picture:
    """What the test inputs excite; of those that are repeated the first."""
    first: dict[tuple[str, str], PlannedInput] = {}
    for one in plan.inputs:
        first.setdefault((one.axis, one.shape), one)
    shapes = {one.shape for one in plan.inputs}
    inputs = []
    for one in first.values():
        omega, values = density(one)
        words = f"{one.axis} {kind_words(one.shape)}" if len(shapes) > 1 else one.axis
        inputs.append(
            Excited(
                words=words,
                channel=input_channel(one),
                omega_rad_s=omega,
                density=values,
                band_rad_s=one.band_rad_s,
                lines=one.shape == "multisine",
            )
        )
    return in_all_units(
        partial(excited_bands, inputs),
        key=key,
        description=f"Spectral densities of the test inputs of {plan.name}, their bands shaded",
    )


def density(one: PlannedInput) -> tuple[FloatArray, FloatArray]:
    """One-sided spectral density of a test input in rad/s and SI units squared per hertz, each shape ``(f,)``.

    That of a multisine stands at its lines, those from a tenth of the largest amplitude: it is their power over the
    distance to their neighbors. Others are averaged in bins of a tenth of their frequency or four lines, whichever is
    wider.
    """
    lines, rate_hz = one.shape == "multisine", one.sample_rate_hz
    # Behind the last period of a multisine stands a zero.
    values = one.values[:-1] if lines else one.values
    size = values.size
    length = size if lines else max(size, round(_LONG_S * rate_hz))
    power = np.abs(np.fft.rfft(values, length)) ** 2
    frequency_hz: FloatArray = np.asarray(np.fft.rfftfreq(length, 1.0 / rate_hz), dtype=np.float64)
    if lines:
        there = np.flatnonzero(power > _LEAST_SHARE**2 * power[1:].max())
        there = there[there > 0]
        apart_hz = np.gradient(frequency_hz[there]) if there.size > 1 else np.full(there.size, rate_hz / size)
        return 2.0 * np.pi * frequency_hz[there], 2.0 * power[there] / size**2 / apart_hz
    # Half and twice the band, or where steps excite most of what they do.
    low, high = one.band_rad_s or (0.4, _STEP_TURNS * 2.0 * np.pi * rate_hz / size)
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
    """A Bode picture of each response of which something will be usable."""
    response, used = prediction.response, prediction.used
    pairs = by_axis([(response.outputs[y], response.inputs[u]) for y, u in np.argwhere(used.any(axis=-1))])
    main = sum(on_axis(*pair) for pair in pairs)
    leading = main if main and len(pairs) > _MOST_UNFOLDED else len(pairs)
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
        figure=percent_dots(
            [row.label for row in compared.rows],
            {plan: [row.percent[number] for row in compared.rows] for number, plan in enumerate(compared.plans)},
        ),
    )


def duration_picture(found: Shortest, wanted: Mapping[str, float], *, key: str) -> Picture | None:
    """Percent over the durations that were tried; nothing where fewer than two could support the model."""
    tried = [one for one in found.tried if one.prediction is not None]
    if len(tried) < 2:
        return None
    known = [_percent(one.prediction) for one in tried if one.prediction is not None]
    return Picture(
        key=key,
        description=f"Predicted standard deviation of {', '.join(wanted)} over the duration of the test input",
        figure=percent_over_duration(
            np.array([one.duration_s for one in tried]),
            {name: np.array([each.get(name, np.inf) for each in known]) for name in wanted},
            wanted=wanted,
            found_s=found.duration_s,
        ),
    )


def _percent(prediction: Prediction) -> dict[str, float]:
    return {one.name: one.percent for one in prediction.parameters}
