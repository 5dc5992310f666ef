"""Pictures of gains: what a vehicle does with those that were flown and with those that are proposed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotorid.plot.figure import MEASURED, MODEL, Figure, Panel, Trace, numbers, stacked, translucent
from rotorid.typing import FloatArray

_COLORS = {"flown": MEASURED, "proposed": MODEL}
_DASHES = {"flown": "solid", "proposed": "5 3"}
_OPACITY = 0.2

Band = tuple[FloatArray, FloatArray, FloatArray]
"""Lower edge, middle and upper edge."""


def steps(time_s: FloatArray, answers: Mapping[str, Band], *, axis: str) -> Figure:
    """Answers to a step of the set-point.

    Parameters
    ----------
    time_s
        Shape ``(n,)``.
    answers
        ``flown`` and ``proposed`` to their bands, each edge of shape ``(n,)``.
    axis
        For the label.
    """
    traces = [trace for name, band in answers.items() for trace in _traces(time_s, band, name, "%{x:.2f} s")]
    panel = Panel(label=f"{axis} over its set-point", traces=traces, height_px=260)
    return stacked([panel], x_axis={"title": {"text": "Time [s]"}})


def sensitivities(omega_rad_s: FloatArray, found: Mapping[str, Band], *, seen_rad_s: tuple[float, float]) -> Figure:
    """Sensitivity to disturbances over frequency, in decibels.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    found
        ``flown`` and ``proposed`` to the bands of abs(S).
    seen_rad_s
        Where the plant was measured.
    """
    decibels = {name: tuple(20.0 * np.log10(edge) for edge in band) for name, band in found.items()}
    traces = [
        trace
        for name, band in decibels.items()
        for trace in _traces(omega_rad_s, band, name, "%{x:.3~g} rad/s")  # type: ignore[arg-type]
    ]
    panel = Panel(label="Sensitivity [dB]", traces=traces, height_px=260, shaded=[seen_rad_s])
    return stacked(
        [panel], x_axis={"title": {"text": "Frequency [rad/s]; shaded where the plant was seen"}, "type": "log"}
    )


def responses(
    omega_rad_s: FloatArray, found: Mapping[str, Band], *, label: str, seen_rad_s: tuple[float, float]
) -> Figure:
    """Sizes of a response over frequency, in decibels.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    found
        ``flown`` and ``proposed`` to the bands of its size.
    label
        Of the vertical axis.
    seen_rad_s
        Where the plant was measured.
    """
    # An axis without an angle loop answers its set-point by nothing, which has no place in decibels.
    with np.errstate(divide="ignore"):
        bands = {name: tuple(20.0 * np.log10(edge) for edge in band) for name, band in found.items()}
    traces = [
        trace
        for name, band in bands.items()
        for trace in _traces(omega_rad_s, band, name, "%{x:.3~g} rad/s")  # type: ignore[arg-type]
    ]
    panel = Panel(label=label, traces=traces, height_px=260, shaded=[seen_rad_s])
    return stacked(
        [panel], x_axis={"title": {"text": "Frequency [rad/s]; shaded where the plant was seen"}, "type": "log"}
    )


LEAST_REJECTION_RAD_S: Mapping[str, float] = {"roll": 0.9, "pitch": 0.5, "yaw": 0.7}
MOST_PEAK_DB = 5.0
"""Guidelines for disturbance rejection of helicopters of full scale, of the design standard's later additions."""


def rejection(axis: str, found: Mapping[str, tuple[Band, Band]], *, scale: float | None) -> Figure:
    """Bandwidth of the rejection of disturbances over its peak, with the guideline for helicopters as a line.

    Frequencies of a vehicle that is N times smaller go with the root of N (Froude).

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    found
        ``flown`` and ``proposed`` to bandwidth in rad/s and peak in dB, each with its interval.
    scale
        N; without it no guideline is drawn.
    """
    traces: list[Trace] = []
    for name, (bandwidth, peak) in found.items():
        x, y = float(bandwidth[1]), float(peak[1])
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": name,
                "x": [x],
                "y": [y],
                "error_x": _error(bandwidth),
                "error_y": _error(peak),
                "marker": {"color": _COLORS[name], "size": 9, "symbol": "circle" if name == "flown" else "diamond"},
                "hovertemplate": "%{x:.3~g} rad/s<br>%{y:.3~g} dB",
                "showlegend": True,
            }
        )
    if scale is not None:
        least = LEAST_REJECTION_RAD_S[axis] * float(np.sqrt(scale))
        widest = max([least, *(float(bandwidth[2]) for bandwidth, _ in found.values())])
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "guideline: right of and below",
                "x": [least, least, 1.3 * widest],
                "y": [0.0, MOST_PEAK_DB, MOST_PEAK_DB],
                "line": {"dash": "dot", "width": 1.5},
                "hoverinfo": "skip",
                "showlegend": True,
            }
        )
    panel = Panel(label="Peak of the sensitivity [dB]", traces=traces, height_px=260)
    return stacked([panel], x_axis={"title": {"text": "Disturbance rejection bandwidth [rad/s]"}})


def _error(band: Band) -> dict[str, object]:
    low, middle, high = (float(edge) for edge in band)
    return {"type": "data", "symmetric": False, "array": [high - middle], "arrayminus": [middle - low]}


def sensitivity_check(omega_rad_s: FloatArray, foretold: Band, measured: Band) -> Figure:
    """Foretold sensitivity to disturbances, and that of the flight afterwards, in decibels.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    foretold, measured
        Bands of abs(S).
    """
    both = {"proposed": ("foretold", foretold), "flown": ("measured", measured)}
    traces = [
        trace
        for color, (name, band) in both.items()
        for trace in _traces(
            omega_rad_s,
            (20.0 * np.log10(band[0]), 20.0 * np.log10(band[1]), 20.0 * np.log10(band[2])),
            name,
            "%{x:.3~g} rad/s",
            color=color,
        )
    ]
    panel = Panel(label="Sensitivity [dB]", traces=traces, height_px=260)
    return stacked([panel], x_axis={"title": {"text": "Frequency [rad/s]"}, "type": "log"})


def _traces(x: FloatArray, band: Band, name: str, at: str, *, color: str = "") -> list[Trace]:
    low, middle, high = band
    dash, color = _DASHES[color or name], _COLORS[color or name]
    edge: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(x),
        "line": {"color": color, "width": 0.0},
        "hoverinfo": "skip",
        "showlegend": False,
    }
    filled: Trace = {**edge, "y": numbers(high), "fill": "tonexty", "fillcolor": translucent(color, _OPACITY)}
    line: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(x),
        "y": numbers(middle),
        "line": {"color": color, "width": 1.8, "dash": dash},
        "hovertemplate": f"{at}<br>%{{y:.3~g}}",
        "name": name,
        "showlegend": True,
    }
    return [{**edge, "y": numbers(low)}, filled, line]
