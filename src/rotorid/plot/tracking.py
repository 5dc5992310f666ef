"""A gain over a flight, with its band, its steps, and the parts without a verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.plot.figure import MEASURED, MODEL, Figure, Panel, numbers, stacked, translucent
from rotorid.typing import FloatArray

_OPACITY = 0.2
_SHOWN = (0.4, 1.6)


def followed_gain(
    time_s: FloatArray,
    ratio: FloatArray,
    std: FloatArray,
    *,
    steps: Sequence[float] = (),
    silent: Sequence[tuple[float, float]] = (),
    rougher: FloatArray,
    level: FloatArray,
) -> Figure:
    """Gain relative to the reference, with air and stick below it.

    Parameters
    ----------
    time_s
        Shape ``(blocks,)``.
    ratio, std
        Gain and its standard deviation.
    steps
        When steps were found.
    silent
        Times without a verdict, which are shaded.
    rougher, level
        Unexplained power over that of the reference, and the largest stick.
    """
    low, high = (np.clip(ratio + sign * 2.0 * std, *_SHOWN) for sign in (-1.0, 1.0))
    band = {"x": numbers(time_s), "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
    line = {"mode": "lines", "showlegend": False}
    gain = [
        {**band, "y": numbers(low)},
        {**band, "y": numbers(high), "fill": "tonexty", "fillcolor": translucent(MEASURED, _OPACITY)},
        {
            **line,
            "x": numbers(time_s),
            "y": numbers(np.clip(ratio, *_SHOWN)),
            "line": {"color": MEASURED, "width": 2},
            "hovertemplate": "%{x:.0f} s: %{y:.3f}<extra></extra>",
        },
    ]
    gain += [
        {
            **line,
            "x": [at_s, at_s],
            "y": [float(low.min()), float(high.max())],
            "line": {"color": MODEL, "width": 2, "dash": "5 3"},
            "hovertemplate": f"step found at {at_s:.0f} s<extra></extra>",
        }
        for at_s in steps
    ]
    judged = [
        {
            **line,
            "x": numbers(time_s),
            "y": numbers(values),
            "name": name,
            "line": {"color": color, "width": 1.5},
            "showlegend": True,
            "hovertemplate": f"{name} %{{y:.2f}}<extra></extra>",
        }
        for name, values, color in (
            ("unexplained motion relative to the reference", np.clip(rougher, 0.0, 10.0), MODEL),
            ("largest stick in 15 s", level, MEASURED),
        )
    ]
    panels = [
        Panel(label="Gain relative to the reference", traces=gain, height_px=300, shaded=list(silent)),
        Panel(label="Air and stick", traces=judged, height_px=160),
    ]
    return stacked(panels, x_axis={"title": {"text": "Time [s]; shaded: reference, or no verdict"}})
