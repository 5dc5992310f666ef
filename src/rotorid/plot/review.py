"""Pictures of an ordinary flight: answers to a step, noise against throttle, spectra, motors side by side."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.curves import decibels
from rotorid.plot.figure import (
    MEASURED,
    MODEL,
    SECONDARY,
    SERIES,
    Figure,
    Panel,
    Trace,
    numbers,
    stacked,
    text,
    translucent,
)
from rotorid.typing import FloatArray

_STEP_PX, _SPECTRUM_PX, _MAP_PX, _BAR_PX = 280.0, 240.0, 300.0, 210.0
_BAND_OPACITY = 0.18
_MAP_ROWS = 160
"""Rows of the picture of a map: finer than what a page shows of it."""

_VIRIDIS = (
    "#440154",
    "#482878",
    "#3e4989",
    "#31688e",
    "#26828e",
    "#1f9e89",
    "#35b779",
    "#6ece58",
    "#b5de2b",
    "#fde725",
)
_UNFLOWN = (128, 128, 128, 40)
_SCALE_FROM_HZ = 50.0
"""Maneuvers are stronger than any noise: the scale of colors is taken above them."""


class Curve(Protocol):
    """A curve over time with its 95 % band, arrays of shape ``(t,)``."""

    @property
    def time_s(self) -> FloatArray:
        """Seconds after the step."""

    @property
    def value(self) -> FloatArray:
        """Answer to a step of one."""

    @property
    def lower(self) -> FloatArray:
        """Lower end of the band."""

    @property
    def upper(self) -> FloatArray:
        """Upper end of the band."""


class Map(Protocol):
    """A density over frequency, against how hard the motors worked."""

    @property
    def level(self) -> FloatArray:
        """Centers of the bins, shape ``(b,)``."""

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequencies, shape ``(f,)``."""

    @property
    def density(self) -> FloatArray:
        """Density, shape ``(b, f)``; not a number where the flight was not."""

    @property
    def average(self) -> FloatArray:
        """Mean over the flight, shape ``(f,)``."""


def step_answers(curves: Mapping[str, Curve], *, until_s: float | None = None) -> Figure:
    """Answers to a step of the set-point, each with its 95 % band, over the step itself.

    Parameters
    ----------
    curves
        By what the legend calls them.
    until_s
        End of the axis; the longest curve, when not given.

    Raises
    ------
    UsageError
        There is no curve.
    """
    if not curves:
        raise UsageError("a picture of no step response was asked for", needed="at least one")
    end = until_s or max(float(curve.time_s[-1]) for curve in curves.values())
    traces: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": [1e3 * -0.05 * end, 0.0, 0.0, 1e3 * end],
            "y": [0.0, 0.0, 1.0, 1.0],
            "line": {"color": SECONDARY, "width": 1, "dash": "dot"},
            "name": "set-point",
            "showlegend": True,
            "hoverinfo": "skip",
        }
    ]
    for number, (name, curve) in enumerate(curves.items()):
        color = SERIES[number % len(SERIES)]
        shown = curve.time_s <= end
        traces += _with_band(1e3 * curve.time_s[shown], [values[shown] for values in _three(curve)], name, color)
    panel = Panel(label="Answer to a step of 1", traces=traces, height_px=_STEP_PX)
    axis = {"title": {"text": "time after the step [ms]"}, "range": [-50.0 * end, 1e3 * end]}
    return stacked([panel], x_axis=axis)


def setpoint_traces(time_s: FloatArray, reference: FloatArray, answer: FloatArray, *, label: str) -> Figure:
    """A set-point and its answer over a part of a flight, as they were logged.

    Parameters
    ----------
    time_s, reference, answer
        On the log's own clock, shapes ``(t,)``.
    label
        Of the vertical axis, with its unit.
    """
    traces: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": numbers(time_s),
            "y": numbers(values),
            "line": line,
            "name": name,
            "showlegend": True,
            "hovertemplate": "%{x:.2f} s<br>%{y:.3~g}",
        }
        for name, values, line in (
            ("set-point", reference, {"color": SECONDARY, "width": 1.5, "dash": "dot"}),
            ("measured", answer, {"color": SERIES[0], "width": 2}),
        )
    ]
    axis = {"title": {"text": "time in the log [s]"}, "range": [float(time_s[0]), float(time_s[-1])]}
    return stacked([Panel(label=text(label), traces=traces, height_px=_STEP_PX)], x_axis=axis)


def _three(curve: Curve) -> tuple[FloatArray, FloatArray, FloatArray]:
    return curve.value, curve.lower, curve.upper


def _with_band(x: FloatArray, three: Sequence[FloatArray], name: str, color: str) -> list[Trace]:
    value, lower, upper = three
    area: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": [*numbers(x), *numbers(x[::-1])],
        "y": [*numbers(lower), *numbers(upper[::-1])],
        "fill": "toself",
        "fillcolor": translucent(color, _BAND_OPACITY),
        "line": {"width": 0},
        "hoverinfo": "skip",
        "name": text(name),
        "legendgroup": text(name),
        "showlegend": False,
    }
    line: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(x),
        "y": numbers(value),
        "line": {"color": color, "width": 2},
        "name": text(name),
        "legendgroup": text(name),
        "showlegend": True,
        "hovertemplate": "%{x:.4~g} ms<br>%{y:.3f}",
    }
    return [area, line]


def noise_maps(maps: Mapping[str, Map], *, against: str, unit: str) -> Figure:
    """Densities against throttle or motor speed, one panel each, on one scale of colors in decibels.

    Grey is where the flight was not. The scale ends at the 5 and the 99.7 percentile above 50 Hz, where maneuvers do
    not own it.

    Parameters
    ----------
    maps
        By what stands above each, such as ``before the filters``.
    against
        What the vertical axis shows.
    unit
        Of the density.

    Raises
    ------
    UsageError
        There is no map.
    """
    if not maps:
        raise UsageError("a picture of no noise was asked for", needed="at least one map")
    low, high = _color_range(list(maps.values()))
    top_hz = max(float(level_map.frequency_hz[-1]) for level_map in maps.values())
    flown = [level_map.level[np.isfinite(level_map.density).any(axis=1)] for level_map in maps.values()]
    reach = [
        float(np.min([one.min() for one in flown if one.size])),
        float(np.max([one.max() for one in flown if one.size])),
    ]
    panels = []
    images = []
    for number, (name, level_map) in enumerate(maps.items(), start=1):
        step = float(np.median(np.diff(level_map.level))) if level_map.level.size > 1 else 0.04
        bottom, top = reach[0] - 0.5 * step, reach[1] + 0.5 * step
        panels.append(
            Panel(
                label=f"{name}, against {against} [dB over 1 {unit}]" if number == 1 else name,
                traces=[_scale_of_colors(low, high, top_hz, bottom, shown=number == 1)],
                height_px=_MAP_PX if len(maps) == 1 else 0.8 * _MAP_PX,
                axis={"range": [bottom, top], "showgrid": False, "zeroline": False},
            )
        )
        images.append(
            _image(
                level_map,
                low=low,
                high=high,
                bottom=bottom,
                top=top,
                step=step,
                axis="y" if number == 1 else f"y{number}",
            )
        )
    figure = stacked(panels, x_axis={"title": {"text": "frequency [Hz]"}, "range": [0.0, top_hz], "showgrid": False})
    figure["layout"]["images"] = images
    figure["layout"]["margin"] = {**figure["layout"]["margin"], "r": 70}
    return figure


def _color_range(maps: Sequence[Map]) -> tuple[float, float]:
    levels = [
        decibels(level_map.density[:, level_map.frequency_hz >= _SCALE_FROM_HZ], of_power=True)
        for level_map in maps
        if (level_map.density > 0).any()
    ]
    finite = np.concatenate([level[np.isfinite(level)] for level in levels]) if levels else np.zeros(0)
    if not finite.size:
        return -40.0, 0.0
    low, high = (float(value) for value in np.percentile(finite, (5.0, 99.7)))
    return low, max(high, low + 1.0)


def _scale_of_colors(low: float, high: float, x: float, y: float, *, shown: bool) -> Trace:
    """A point that nobody sees, whose colors are those of the map."""
    scale = [[index / (len(_VIRIDIS) - 1), color] for index, color in enumerate(_VIRIDIS)]
    marker: dict[str, Any] = {
        "opacity": 0,
        "size": 1,
        "color": [low, high],
        "cmin": low,
        "cmax": high,
        "colorscale": scale,
    }
    if shown:
        marker |= {"showscale": True, "colorbar": {"title": {"text": "dB"}, "thickness": 12, "len": 0.9, "x": 1.01}}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [0.0, round(x, 3)],
        "y": [y, y],
        "marker": marker,
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _image(
    level_map: Map, *, low: float, high: float, bottom: float, top: float, step: float, axis: str
) -> dict[str, Any]:
    """The map as a picture that lies behind the axes."""
    with np.errstate(divide="ignore", invalid="ignore"):
        level = 10.0 * np.log10(level_map.density)
    share = np.clip((level - low) / (high - low), 0.0, 1.0)
    inside = (level_map.level >= bottom) & (level_map.level <= top)
    pixels = _colored(share[inside][::-1])
    return {
        "source": png(pixels),
        "xref": "x",
        "yref": axis,
        "x": float(level_map.frequency_hz[0]),
        "y": float(level_map.level[inside][-1] + 0.5 * step),
        "sizex": float(level_map.frequency_hz[-1] - level_map.frequency_hz[0]),
        "sizey": float(level_map.level[inside][-1] - level_map.level[inside][0] + step),
        "sizing": "stretch",
        "layer": "below",
    }


def _colored(share: FloatArray) -> np.ndarray:
    """Pixels of shares from 0 to 1, shape ``(rows, columns, 4)``, rows repeated so that bins keep their edges."""
    stops = np.array([[int(color[at : at + 2], 16) for at in (1, 3, 5)] for color in _VIRIDIS], dtype=np.float64)
    place = np.nan_to_num(share) * (len(_VIRIDIS) - 1)
    below = np.minimum(place.astype(np.int64), len(_VIRIDIS) - 2)
    part = (place - below)[..., None]
    pixels = np.empty((*share.shape, 4), dtype=np.uint8)
    pixels[..., :3] = np.round(stops[below] * (1.0 - part) + stops[below + 1] * part)
    pixels[..., 3] = 255
    pixels[~np.isfinite(share)] = _UNFLOWN
    return np.repeat(pixels, max(1, _MAP_ROWS // max(share.shape[0], 1)), axis=0)


def png(pixels: np.ndarray) -> str:
    """A picture as a PNG in a data address.

    Parameters
    ----------
    pixels
        Red, green, blue and opacity as bytes, shape ``(rows, columns, 4)``.

    Examples
    --------
    >>> png(np.zeros((2, 2, 4), dtype=np.uint8))[:30]
    'data:image/png;base64,iVBORw0K'
    """
    rows, columns, _ = pixels.shape
    raw = b"".join(b"\x00" + row.tobytes() for row in np.ascontiguousarray(pixels))

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", columns, rows, 8, 6, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw, 6)) + chunk(b"IEND", b"")
    return "data:image/png;base64," + base64.b64encode(b"\x89PNG\r\n\x1a\n" + body).decode()


def spectra(
    averages: Mapping[str, tuple[FloatArray, FloatArray]], *, peaks: Sequence[tuple[float, str]], unit: str
) -> Figure:
    """Mean spectra over the flight in decibels, peaks named.

    Parameters
    ----------
    averages
        Frequencies in Hz and densities of shape ``(f,)``, by what the legend calls them.
    peaks
        Frequency in Hz of each, and its words.
    unit
        Of the density.
    """
    colors = (MODEL, MEASURED, *SERIES[2:])
    traces: list[Trace] = []
    for number, (name, (frequency_hz, density)) in enumerate(averages.items()):
        level = decibels(density, of_power=True)
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": numbers(frequency_hz),
                "y": numbers(level),
                "line": {"color": colors[number % len(colors)], "width": 1.5},
                "name": text(name),
                "showlegend": True,
                "hovertemplate": "%{x:.4~g} Hz<br>%{y:.3~g} dB",
            }
        )
    figure = stacked(
        [
            Panel(
                label=f"Mean noise over the flight [dB over 1 {unit}]",
                traces=traces,
                height_px=_SPECTRUM_PX,
                axis=_room_above(traces),
            )
        ],
        x_axis={"title": {"text": "frequency [Hz]"}},
    )
    for frequency, words in peaks:
        figure["layout"]["annotations"].append(
            {
                "x": round(frequency, 2),
                "y": round(_height(averages, frequency), 2),
                "text": text(words),
                "showarrow": True,
                "arrowhead": 0,
                "ax": 0,
                "ay": -26,
                "font": {"size": 11},
            }
        )
    return figure


def _room_above(traces: Sequence[Trace]) -> dict[str, Any]:
    """An axis with room for words above the highest peak."""
    heights = np.array([value for trace in traces for value in trace["y"] if value is not None])
    if not heights.size:
        return {}
    span = max(float(np.ptp(heights)), 1.0)
    return {"range": [round(float(heights.min()) - 0.04 * span, 2), round(float(heights.max()) + 0.16 * span, 2)]}


def _height(averages: Mapping[str, tuple[FloatArray, FloatArray]], frequency: float) -> float:
    heights = [
        float(decibels(np.array([np.interp(frequency, frequency_hz, density)]), of_power=True)[0])
        for frequency_hz, density in averages.values()
        if frequency_hz[0] <= frequency <= frequency_hz[-1]
    ]
    return float(np.nanmax(heights)) if heights else 0.0


def motor_bars(means: Mapping[str, tuple[float, float]]) -> Figure:
    """Mean output of each motor in steady flight, with the mean of all as a line; bars of two standard deviations.

    Parameters
    ----------
    means
        Value and standard deviation by motor.
    """
    values = np.array([value for value, _ in means.values()])
    bars: Trace = {
        "type": "bar",
        "x": [text(name) for name in means],
        "y": numbers(values),
        "error_y": {
            "type": "data",
            "array": [round(2.0 * std, 6) for _, std in means.values()],
            "thickness": 1.4,
            "color": SECONDARY,
        },
        "marker": {"color": MEASURED},
        "showlegend": False,
        "hovertemplate": "%{x}: %{y:.3f}",
    }
    panel = Panel(
        label="Mean output in steady flight (0 to 1)",
        traces=[bars],
        height_px=_BAR_PX,
        axis={"rangemode": "tozero"},
        level=float(values.mean()),
    )
    return stacked([panel], x_axis={"type": "category"})
