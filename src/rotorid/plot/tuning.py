"""Pictures of gains: what a vehicle does with those that were flown and with those that are proposed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rotorid.plot.curves import Frequency, Magnitude, Style, View, band, decibels, line, magnitude_axis, spanned
from rotorid.plot.figure import MEASURED, MODEL, Figure, Panel, Trace, stacked, translucent
from rotorid.typing import FloatArray

_COLORS = {
    "flown": MEASURED,
    "proposed": MODEL,
    "chosen": MODEL,
    "judged": MODEL,
    "measured": MEASURED,
    "predicted": MODEL,
}
_DASHES = dict.fromkeys(("flown", "measured"), "solid")
_OPACITY = 0.2
_HEIGHT_PX = 260.0

Band = tuple[FloatArray, FloatArray, FloatArray]
"""Lower edge, middle and upper edge."""


def steps(time_s: FloatArray, answers: Mapping[str, Band], *, axis: str) -> Figure:
    """Answers to a step of the set-point.

    Parameters
    ----------
    time_s
        Shape ``(n,)``.
    answers
        ``flown`` and ``proposed`` or ``judged`` to their bands, each edge of shape ``(n,)``.
    axis
        For the label.
    """
    traces: list[Trace] = []
    for name, (low, middle, high) in answers.items():
        shade, inked = _styles(name)
        traces += band(View(), time_s, low, high, np.ones(time_s.size, dtype=bool), shade)
        traces.append({**line(View(), time_s, middle, inked), "hovertemplate": "%{x:.2f} s<br>%{y:.3~g}"})
    return _over_time(axis, traces)


def by_hand(axis: str) -> Figure:
    """The picture for gains that are chosen on the page, whose script brings the curves ``flown`` and ``chosen``."""
    empty = np.empty(0)
    return _over_time(axis, [line(View(), empty, empty, _styles(name)[1]) for name in ("flown", "chosen")])


def _over_time(axis: str, traces: list[Trace]) -> Figure:
    label = f"{axis.capitalize()} over its set-point"
    panel = Panel(label=label, traces=traces, height_px=_HEIGHT_PX)
    return stacked([panel], x_axis={"title": {"text": "Time [s]"}})


def responses(
    omega_rad_s: FloatArray,
    found: Mapping[str, Band],
    *,
    label: str,
    seen_rad_s: tuple[float, float] | None = None,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    """Sizes of a response or a sensitivity over frequency.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    found
        ``flown`` and ``proposed``, or ``measured`` and ``foretold``, to the bands of its size, each edge of shape
        ``(f,)``.
    label
        Of the vertical axis, without its unit.
    seen_rad_s
        Where the plant was measured, to be shaded; beyond it curves are dotted, for a model alone says them.
    frequency, magnitude
        Units of the picture.
    """
    view = View(frequency=frequency, magnitude=magnitude)
    in_db = magnitude == "dB"
    traces: list[Trace] = []
    for name, edges in found.items():
        # An axis without an angle loop answers its set-point by nothing, which has no place in decibels.
        low, middle, high = (view.height(decibels(edge)) for edge in edges)
        shade, inked = _styles(name, "dB" if in_db else "")
        traces += band(view, omega_rad_s, low, high, np.ones(omega_rad_s.size, dtype=bool), shade)
        traces += _beyond_dotted(view, omega_rad_s, middle, inked, seen_rad_s)
    shaded = view.bands([seen_rad_s] if seen_rad_s else [])
    panel = Panel(
        label=f"{label} [dB]" if in_db else label,
        traces=traces,
        height_px=_HEIGHT_PX,
        axis=magnitude_axis(view, traces),
        shaded=shaded,
    )
    axis = view.axis(omega_rad_s)
    if shaded:
        axis["title"] = {"text": f"{axis['title']['text']}; shaded where the plant was seen"}
    return stacked([panel], x_axis=axis)


def _beyond_dotted(
    view: View, omega_rad_s: FloatArray, values: FloatArray, style: Style, seen_rad_s: tuple[float, float] | None
) -> list[Trace]:
    """A line that is dotted where the plant was not measured."""
    if seen_rad_s is None:
        return [line(view, omega_rad_s, values, style)]
    inside = (omega_rad_s >= seen_rad_s[0]) & (omega_rad_s <= seen_rad_s[1])
    dotted = replace(style, dash="dot", width=1.2, legend=False)
    parts = (
        ((inside, style), (~spanned(inside), dotted)) if inside.any() else ((~inside, replace(dotted, legend=True)),)
    )
    return [line(view, omega_rad_s, np.where(part, values, np.nan), ink) for part, ink in parts if part.any()]


def _styles(name: str, unit: str = "") -> tuple[Style, Style]:
    """How the band and the line of one set of gains are drawn."""
    color = _COLORS[name]
    return (
        Style(name=name, color=translucent(color, _OPACITY)),
        Style(name=name, color=color, width=1.8, dash=_DASHES.get(name, "5 3"), unit=unit, legend=True),
    )


LEAST_REJECTION_RAD_S: Mapping[str, float] = {"roll": 0.9, "pitch": 0.5, "yaw": 0.7}
MOST_PEAK_DB = 5.0
"""Guidelines for disturbance rejection of helicopters of full scale, of the design standard's later additions."""


def rejection(
    axis: str, found: Mapping[str, tuple[Band, Band]], *, scale: float | None, frequency: Frequency = "rad/s"
) -> Figure:
    """Peak of the sensitivity over the disturbance-rejection bandwidth, with the guideline for helicopters as a line.

    Frequencies of a vehicle that is N times smaller are larger by the root of N (Froude).

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    found
        ``flown`` and ``proposed`` to bandwidth in rad/s and peak in dB, each with its interval.
    scale
        N; without it no guideline is drawn.
    frequency
        Unit of the picture.
    """
    view = View(frequency=frequency)
    traces: list[Trace] = []
    for name, (bandwidth_rad_s, peak) in found.items():
        bandwidth = view.across(np.asarray(bandwidth_rad_s, dtype=np.float64))
        x, y = float(bandwidth[1]), float(peak[1])
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": name,
                "x": [x],
                "y": [y],
                "error_x": _error((bandwidth[0], bandwidth[1], bandwidth[2])),
                "error_y": _error(peak),
                "marker": {"color": _COLORS[name], "size": 9, "symbol": "circle" if name == "flown" else "diamond"},
                "hovertemplate": f"%{{x:.3~g}} {frequency}<br>%{{y:.3~g}} dB",
                "showlegend": True,
            }
        )
    if scale is not None:
        least_rad_s = LEAST_REJECTION_RAD_S[axis] * float(np.sqrt(scale))
        widest_rad_s = max([least_rad_s, *(float(bandwidth[2]) for bandwidth, _ in found.values())])
        least, widest = view.across(np.array([least_rad_s, 1.3 * widest_rad_s])).tolist()
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "guideline: right of and below",
                "x": [least, least, widest],
                "y": [0.0, MOST_PEAK_DB, MOST_PEAK_DB],
                "line": {"dash": "dot", "width": 1.5},
                "hoverinfo": "skip",
                "showlegend": True,
            }
        )
    panel = Panel(label="Peak of the sensitivity [dB]", traces=traces, height_px=_HEIGHT_PX)
    return stacked([panel], x_axis={"title": {"text": f"Disturbance-rejection bandwidth [{frequency}]"}})


def _error(band: Band) -> dict[str, object]:
    low, middle, high = (float(edge) for edge in band)
    return {"type": "data", "symmetric": False, "array": [high - middle], "arrayminus": [middle - low]}
