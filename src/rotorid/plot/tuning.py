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


def _traces(x: FloatArray, band: Band, name: str, at: str) -> list[Trace]:
    low, middle, high = band
    color = _COLORS[name]
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
        "line": {"color": color, "width": 1.8, "dash": _DASHES[name]},
        "hovertemplate": f"{at}<br>%{{y:.3~g}}",
        "name": name,
        "showlegend": True,
    }
    return [{**edge, "y": numbers(low)}, filled, line]
