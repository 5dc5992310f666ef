"""Pictures of planned flights: test inputs and what they move, what they excite, and the expected parameter errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.plot.curves import Frequency, Magnitude, Style, View, decibels, magnitude_axis, points, shown
from rotorid.plot.curves import line as over_frequency
from rotorid.plot.figure import (
    DASHES,
    SECONDARY,
    SERIES,
    SYMBOLS,
    Figure,
    Panel,
    Trace,
    frequency_ticks,
    numbers,
    quantity,
    stacked,
    stamps,
    text,
)
from rotorid.plot.frequency import LEFT_OUT, LEFT_OUT_BAND, bode
from rotorid.plot.time import line
from rotorid.typing import BoolArray, FloatArray

_TIME_AXIS = {"title": {"text": "Time on the plan's clock [s]"}}
_MOST_POINTS = 1500
_ROW_PX, _LEAST_PX = 30.0, 90.0
_BAR_SPACING = 0.56
_DEEPEST_DB = 60.0
_EXPECTED = {"measured": "expected", LEFT_OUT: "expected, not usable", LEFT_OUT_BAND: "± 2 σ, not usable"}


class Signal(NamedTuple):
    """A signal over time.

    Parameters
    ----------
    words
        Name in the legend; signals of one name have one color. Those of a panel with one name need none.
    channel
        Name of the vocabulary, which decides the unit of paper.
    time_s, values
        Shape ``(n,)``, SI.
    """

    words: str
    channel: str
    time_s: FloatArray
    values: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Strip:
    """One panel of a flight over time.

    Parameters
    ----------
    label
        Written above it, without the unit.
    signals
        At least one, all of one unit.
    limits
        Values that the flight is not to pass, SI.
    """

    label: str
    signals: Sequence[Signal]
    limits: Sequence[float] = ()
    height_px: float = 120.0


def planned_flight(strips: Sequence[Strip]) -> Figure:
    """Test inputs over time and what the simulated flight does, with its limits.

    Parameters
    ----------
    strips
        Panels from top to bottom.

    Examples
    --------
    >>> time_s = np.array([0.0, 1.0])
    >>> tilt = Strip(label="Tilt", signals=[Signal("tilt", "phi", time_s, np.array([0.0, 0.1]))], limits=[0.5])
    >>> [trace["name"] for trace in planned_flight([tilt])["data"]]
    ['tilt', 'limit']
    """
    named = [strip for strip in strips if len({signal.words for signal in strip.signals}) > 1]
    names = list(dict.fromkeys(signal.words for strip in named for signal in strip.signals))
    shown: set[str] = set()
    panels = [_strip(strip, names, shown) for strip in strips]
    return stacked(panels, x_axis=_TIME_AXIS)


def _strip(strip: Strip, names: Sequence[str], shown: set[str]) -> Panel:
    """One panel; ``shown`` holds what is already in the legend."""
    traces: list[Trace] = []
    for signal in strip.signals:
        known = signal.words in names
        color = SERIES[names.index(signal.words) % len(SERIES)] if known else SERIES[-1]
        drawn = line(*signal[2:], signal.channel, words=text(signal.words), color=color, width=1.0, most=_MOST_POINTS)
        traces.append({**drawn, "showlegend": known and signal.words not in shown})
        shown.add(signal.words)
    channel = strip.signals[0].channel
    edges = [min(signal.time_s[0] for signal in strip.signals), max(signal.time_s[-1] for signal in strip.signals)]
    for limit in strip.limits:
        flat = line(np.array(edges), np.full(2, limit), channel, words="limit", color=SECONDARY, width=1.4, dash="2 3")
        traces.append({**flat, "showlegend": "limit" not in shown})
        shown.add("limit")
    unit = quantity(channel).unit
    return Panel(
        label=f"{strip.label} [{unit}]" if unit else strip.label,
        traces=traces,
        height_px=strip.height_px,
        axis={"zeroline": False},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Excited:
    """What a test input excites.

    Parameters
    ----------
    words
        Name in the legend; inputs of one first word, an axis, have one color.
    channel
        Name of the vocabulary, which decides the unit of paper.
    omega_rad_s, density
        One-sided density in SI units squared per hertz, shape ``(f,)``.
    band_rad_s
        The band that was asked for, which is shaded.
    lines
        Whether it excites single frequencies, which are drawn as points.
    """

    words: str
    channel: str
    omega_rad_s: FloatArray
    density: FloatArray
    band_rad_s: tuple[float, float] | None = None
    lines: bool = False


def excited_bands(inputs: Sequence[Excited], *, frequency: Frequency = "rad/s", magnitude: Magnitude = "dB") -> Figure:
    """Densities of test inputs over frequency, those of one unit in one panel, their bands shaded.

    Parameters
    ----------
    inputs
        At least one.
    frequency, magnitude
        Units of the picture; decibels are :math:`10 log_{10}` of the density in units of paper.

    Examples
    --------
    >>> step = Excited(words="roll", channel="roll_excitation", omega_rad_s=np.array([1.0, 10.0]),
    ...                density=np.array([0.1, 0.001]))
    >>> figure = excited_bands([step])
    >>> figure["data"][0]["y"], figure["layout"]["annotations"][0]["text"]
    ([-10.0, -30.0], 'Density [dB re 1/Hz]')
    """
    view = View(frequency=frequency, magnitude=magnitude)
    units = list(dict.fromkeys(quantity(excited.channel).unit for excited in inputs))
    axes = list(dict.fromkeys(_axis(excited) for excited in inputs))
    panels = []
    for unit in units:
        density = f"({unit})²/Hz" if unit else "1/Hz"
        drawn = f"dB re {density}" if magnitude == "dB" else density
        members = [(number, excited) for number, excited in enumerate(inputs) if quantity(excited.channel).unit == unit]
        bands = list(dict.fromkeys(excited.band_rad_s for _, excited in members if excited.band_rad_s is not None))
        traces = [_density(view, excited, number, axes.index(_axis(excited)), drawn) for number, excited in members]
        panels.append(
            Panel(
                label=f"Density [{drawn}]",
                traces=traces,
                height_px=210,
                axis=_level_axis(view, traces),
                shaded=view.bands(bands),
            )
        )
    return stacked(panels, x_axis=view.axis(np.concatenate([excited.omega_rad_s for excited in inputs])))


def _axis(excited: Excited) -> str:
    return excited.words.partition(" ")[0]


def _level_axis(view: View, traces: list[Trace]) -> dict[str, Any]:
    """A vertical axis that does not follow what is hardly there far down."""
    heights = shown(traces)
    if view.magnitude == "linear" or not heights.size or np.ptp(heights) < _DEEPEST_DB:
        return magnitude_axis(view, traces)
    return {"range": [float(heights.max()) - _DEEPEST_DB, float(heights.max()) + 0.05 * _DEEPEST_DB]}


def _density(view: View, excited: Excited, number: int, color: int, unit: str) -> Trace:
    level = decibels(quantity(excited.channel).factor ** 2 * excited.density, of_power=True)
    style = Style(
        name=excited.words,
        color=SERIES[color % len(SERIES)],
        dash=DASHES[number % len(DASHES)],
        symbol=SYMBOLS[number % len(SYMBOLS)],
        size=4.0,
        legend=True,
        unit=unit,
    )
    draw = points if excited.lines else over_frequency
    return draw(view, excited.omega_rad_s, view.height(level, decibels=10.0), style)


def predicted_bode(
    response: FrequencyResponse,
    *,
    output: str,
    input: str,
    used: BoolArray,
    least_coherence: float,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    """A response as a flight is expected to show it.

    The parameters are those of :func:`rotorid.plot.frequency.bode`.
    """
    figure = bode(
        response,
        output=output,
        input=input,
        fitted=used,
        least_coherence=least_coherence,
        frequency=frequency,
        magnitude=magnitude,
    )
    names = [_EXPECTED.get(trace["name"], trace["name"]) for trace in figure["data"]]
    traces = [{**trace, "name": name, "legendgroup": name} for trace, name in zip(figure["data"], names, strict=True)]
    return Figure(data=traces, layout=figure["layout"])


def percent_dots(labels: Sequence[str], percent: Mapping[str, Sequence[float]]) -> Figure:
    """Standard deviations in percent by parameter and plan, on a logarithmic axis.

    Parameters
    ----------
    labels
        Of the parameters, from top to bottom.
    percent
        Plan to one number for each parameter; what is not finite is left out.

    Examples
    --------
    >>> figure = percent_dots(["L_roll", "L_p"], {"sweep": [0.4, 2.0], "multisine": [0.5, math.inf]})
    >>> [trace["x"] for trace in figure["data"]]
    [[0.4, 2.0], [0.5, None]]
    """
    rows = np.arange(len(labels), dtype=np.float64)
    offsets = _BAR_SPACING * (np.arange(len(percent)) - (len(percent) - 1) / 2.0) / max(len(percent), 2)
    traces = [
        _dots(rows + offset, name, np.asarray(found), labels, number)
        for number, (offset, (name, found)) in enumerate(zip(offsets, percent.items(), strict=True))
    ]
    axis: dict[str, Any] = {
        "tickmode": "array",
        "tickvals": numbers(rows),
        "ticktext": [text(label) for label in labels],
        "range": [len(labels) - 0.5, -0.5],
        "zeroline": False,
    }
    panel = Panel(
        label="Predicted standard deviation by parameter",
        traces=traces,
        height_px=max(_LEAST_PX, _ROW_PX * len(labels)),
        axis=axis,
    )
    return stacked([panel], x_axis=_percent_axis([value for found in percent.values() for value in found]))


def _dots(rows: FloatArray, name: str, found: FloatArray, labels: Sequence[str], number: int) -> Trace:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(found),
        "y": numbers(rows),
        "marker": {"color": SERIES[number % len(SERIES)], "symbol": SYMBOLS[number % len(SYMBOLS)], "size": 9},
        "text": [text(label) for label in labels],
        "hovertemplate": "%{text}<br>%{x:.3~g} %",
        "name": text(name),
        "legendgroup": text(name),
        "showlegend": True,
    }


def _percent_axis(percent: Sequence[float]) -> dict[str, Any]:
    return {"type": "log", "title": {"text": "Standard deviation [% of the value]"}, "tickvals": _ticks(percent)}


def _ticks(values: Sequence[float]) -> list[float]:
    positive = np.array([value for value in values if 0.0 < value < math.inf])
    return frequency_ticks(positive) if positive.size else [1.0]


def percent_over_duration(
    duration_s: FloatArray,
    percent: Mapping[str, FloatArray],
    *,
    wanted: Mapping[str, float],
    found_s: float | None = None,
) -> Figure:
    """How well parameters will be known after test inputs of several durations, and how well they should be.

    Parameters
    ----------
    duration_s
        Those that were tried, rising, shape ``(n,)``.
    percent
        Parameter to its standard deviation in percent, shape ``(n,)``.
    wanted
        Parameter to what was asked for, in percent.
    found_s
        The duration that is enough, which is shaded from there on.

    Examples
    --------
    >>> figure = percent_over_duration(np.array([15.0, 60.0]), {"L_roll": np.array([2.0, 1.0])},
    ...                                wanted={"L_roll": 1.5}, found_s=27.0)
    >>> [trace["name"] for trace in figure["data"]], figure["layout"]["shapes"][0]["x0"]
    (['L_roll', 'L_roll wanted'], 27.0)
    """
    traces: list[Trace] = []
    for number, (name, found) in enumerate(percent.items()):
        color = SERIES[number % len(SERIES)]
        traces.append(_over(duration_s, found, name, color, mode="lines+markers", dash="solid"))
        if name in wanted:
            level = np.full(2, wanted[name])
            traces.append(_over(duration_s[[0, -1]], level, f"{name} wanted", color, mode="lines", dash="2 3"))
    heights = [value for trace in traces for value in trace["y"] if value is not None]
    axis = {"type": "log", "tickvals": _ticks(heights)}
    enough = [] if found_s is None else [(found_s, float(duration_s[-1]))]
    panel = Panel(label="Standard deviation [% of the value]", traces=traces, height_px=220, axis=axis, shaded=enough)
    ticks = frequency_ticks(duration_s)
    return stacked([panel], x_axis={"type": "log", "title": {"text": "Duration [s]"}, "tickvals": ticks})


def _over(duration_s: FloatArray, values: FloatArray, name: str, color: str, *, mode: str, dash: str) -> Trace:
    return {
        "type": "scatter",
        "mode": mode,
        "x": stamps(duration_s),
        "y": numbers(values),
        "line": {"color": color, "width": 1.6, "dash": dash},
        "marker": {"color": color, "size": 7},
        "hovertemplate": "%{x:.1f} s<br>%{y:.3~g} %",
        "name": text(name),
        "legendgroup": text(name),
        "showlegend": True,
    }
