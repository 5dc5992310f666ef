"""Pictures of a loop and of a model: margins of a broken loop, a sensitivity, poles, correlation of parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rotorid.data.quantity import in_decibels, minus, with_error
from rotorid.errors import UsageError
from rotorid.plot.curves import (
    SIGMAS,
    Frequency,
    Magnitude,
    Style,
    View,
    decibels,
    line,
    magnitude_axis,
    phase_axis,
    reference_deg,
)
from rotorid.plot.figure import (
    INPUT,
    MEASURED,
    MODEL,
    SECONDARY,
    Figure,
    Panel,
    Trace,
    numbers,
    stacked,
    text,
    translucent,
)
from rotorid.plot.frequency import Curve, bands, curve
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray

MINUS_3_DB = -3.0

_BAND_OPACITY = 0.22


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A frequency of a loop and what was read there.

    Parameters
    ----------
    omega_rad_s, omega_std_rad_s
        Where, and one standard deviation.
    value, value_std
        What, and one standard deviation: the phase margin in radians at a gain crossover, the gain margin as a factor
        at a phase crossover, the magnitude as a factor at a peak.

    Raises
    ------
    UsageError
        The frequency is not positive, or a deviation is negative.
    """

    omega_rad_s: float
    value: float
    omega_std_rad_s: float = 0.0
    value_std: float = 0.0

    def __post_init__(self) -> None:
        if not (self.omega_rad_s > 0.0 and self.omega_std_rad_s >= 0.0 and self.value_std >= 0.0):
            raise UsageError(
                f"{self} is no crossing", needed="a positive frequency, and deviations that are not negative"
            )


def broken_loop(
    omega_rad_s: FloatArray,
    values: ComplexArray,
    *,
    random_error: FloatArray | None = None,
    used: BoolArray | None = None,
    gain_crossovers: Sequence[Crossing] = (),
    phase_crossovers: Sequence[Crossing] = (),
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Magnitude and phase of a broken loop, with the gain and phase margins where they were read.

    At a gain crossover the phase margin stands on the line of −180° (or a whole turn from it), at a phase crossover
    the gain margin hangs from the line of 0 dB. Bars and band are :math:`\pm 2\sigma`; the numbers in the legend
    are :math:`\pm\sigma`. Nothing is computed here: crossovers that are not given are not marked.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    values
        The broken loop, whose critical point is −1, shape ``(f,)``.
    random_error
        Relative standard deviation of the magnitude, which is that of the phase in radians, shape ``(f,)``.
    used
        Points from which numbers are read, shape ``(f,)``; the others are gray and dashed. All by default.
    gain_crossovers
        Where the magnitude passes one, with the phase margin in radians.
    phase_crossovers
        Where the phase passes −180°, with the gain margin as a factor: above one the gain may rise by it.
    frequency, magnitude
        Units of the picture.

    Raises
    ------
    UsageError
        A shape does not fit, a gain margin is not positive, or a unit is unknown.

    Examples
    --------
    >>> omega = np.geomspace(1.0, 100.0, 50)
    >>> loop = 10.0 * np.exp(-0.05j * omega) / (1j * omega)
    >>> margin = Crossing(omega_rad_s=10.0, value=np.pi / 2 - 0.5, value_std=0.02)
    >>> figure = broken_loop(omega, loop, gain_crossovers=[margin])
    >>> figure["data"][-1]["name"], figure["data"][-1]["y"]
    ('phase margin 61.4 ± 1.1° at 10 rad/s', [-180.0, -118.65])
    """
    view = View(frequency=frequency, magnitude=magnitude)
    counted = np.isfinite(values) if used is None else used
    drawn = _curve(omega_rad_s, values, random_error, counted)
    if any(crossing.value <= 0.0 for crossing in phase_crossovers):
        raise UsageError("the gain margin is not positive", needed="a factor: 2 for 6 dB")
    level, turn = _with_band(view, drawn, random_error, "broken loop", counted)
    hung = [_gain_margin(view, crossing) for crossing in phase_crossovers]
    stood = [_phase_margin(view, crossing, drawn) for crossing in gain_crossovers]
    unity = float(view.height(np.zeros(1))[0])
    panels = (
        Panel(
            label=f"Magnitude of the broken loop{' [dB]' if magnitude == 'dB' else ''}",
            traces=[*level, *hung],
            height_px=230,
            axis=magnitude_axis(view, [*level, *hung]),
            level=unity,
        ),
        Panel(label="Phase [°]", traces=[*turn, *stood], height_px=190, axis=phase_axis(turn), level=-180.0),
    )
    return stacked(panels, x_axis=view.axis(omega_rad_s))


def disturbance_rejection(
    omega_rad_s: FloatArray,
    sensitivity: ComplexArray,
    *,
    random_error: FloatArray | None = None,
    used: BoolArray | None = None,
    bandwidth: Crossing | None = None,
    peak: Crossing | None = None,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Magnitude of a sensitivity :math:`S = 1/(1 + L)`, with the disturbance-rejection bandwidth and the peak.

    Below the bandwidth, where :math:`|S|` rises through −3 dB, the loop holds disturbances down (shaded); around the
    peak it amplifies them. Bars and band are :math:`\pm 2\sigma`, the numbers in the legend :math:`\pm\sigma`.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    sensitivity
        Output over disturbance at that output, shape ``(f,)``.
    random_error
        Relative standard deviation of the magnitude, shape ``(f,)``.
    used
        Points from which numbers are read, shape ``(f,)``; the others are gray and dashed. All by default.
    bandwidth
        Where the magnitude rises through −3 dB; ``value`` is the magnitude there as a factor.
    peak
        Where the magnitude is largest, and how large, as a factor.
    frequency, magnitude
        Units of the picture.

    Raises
    ------
    UsageError
        A shape does not fit, or a unit is unknown.

    Examples
    --------
    >>> omega = np.geomspace(0.1, 10.0, 30)
    >>> figure = disturbance_rejection(omega, 1j * omega / (1j * omega + 1.0),
    ...     bandwidth=Crossing(omega_rad_s=1.0, omega_std_rad_s=0.04, value=0.708))
    >>> figure["data"][-1]["name"]
    'bandwidth 1.00 ± 0.04 rad/s'
    """
    view = View(frequency=frequency, magnitude=magnitude)
    counted = np.isfinite(sensitivity) if used is None else used
    drawn = _curve(omega_rad_s, sensitivity, random_error, counted)
    traces, _ = _with_band(view, drawn, random_error, "sensitivity", counted)
    if peak is not None:
        words = f"peak {_level_words(view, peak)} at {_where(view, peak)}"
        traces.append(_mark(view, peak, words, MODEL, [_factor(view, peak.value)], _reach(view, peak, peak.value)))
    bands: list[tuple[float, float]] = []
    if bandwidth is not None:
        bands = view.bands([(float(omega_rad_s[0]), bandwidth.omega_rad_s)])
        words, height = f"bandwidth {_where(view, bandwidth)}", [_factor(view, bandwidth.value)]
        traces.append(_mark(view, bandwidth, words, INPUT, height, _reach(view, bandwidth, bandwidth.value)))
    panel = Panel(
        label=f"Magnitude of the sensitivity{' [dB]' if magnitude == 'dB' else ''}",
        traces=traces,
        height_px=250,
        axis=magnitude_axis(view, traces),
        shaded=bands,
        level=float(view.height(np.array([MINUS_3_DB]))[0]),
    )
    return stacked([panel], x_axis=view.axis(omega_rad_s))


def _curve(omega_rad_s: FloatArray, values: ComplexArray, random_error: FloatArray | None, used: BoolArray) -> Curve:
    error = np.zeros(omega_rad_s.size) if random_error is None else random_error
    for name, came in (("the response", values.shape), ("random_error", error.shape), ("used", used.shape)):
        if came != omega_rad_s.shape:
            raise UsageError(f"{name} has the shape {came}", needed=f"the shape {omega_rad_s.shape}")
    return curve(omega_rad_s, values, error, reference_deg(omega_rad_s, values, used & np.isfinite(values)))


def _with_band(
    view: View, drawn: Curve, random_error: FloatArray | None, name: str, used: BoolArray
) -> tuple[list[Trace], list[Trace]]:
    """The curve of magnitude and that of phase, over their bands where there is an error.

    Beyond the used points it is gray and dashed, without a band: no number is read there.
    """
    shade = Style(name=name, color=translucent(MEASURED, _BAND_OPACITY))
    level, turn = ([], []) if random_error is None else bands(view, drawn, used, shade)
    unit = "dB" if view.magnitude == "dB" else ""
    inked = Style(name=name, color=MEASURED, width=1.8, legend=True, unit=unit)
    faint = Style(name=f"{name}, not used", color=SECONDARY, width=1.1, dash="3 3", legend=True, unit=unit)
    beyond = _beyond(used)
    for traces, heights, of in ((level, view.height(drawn.magnitude_db), unit), (turn, drawn.phase_deg, "°")):
        first = traces is level
        if beyond.any():
            at_gaps = np.where(beyond, heights, np.nan)
            traces.append(line(view, drawn.omega_rad_s, at_gaps, replace(faint, unit=of, legend=first)))
        if used.any():
            kept = np.where(used, heights, np.nan)
            traces.append(line(view, drawn.omega_rad_s, kept, replace(inked, unit=of, legend=first)))
    return level, turn


def _beyond(used: BoolArray) -> BoolArray:
    """Points that do not count, and the used ones next to them, so that a dashed line meets the solid one."""
    outside = np.zeros(used.size, dtype=bool)
    outside[1:] |= ~used[:-1]
    outside[:-1] |= ~used[1:]
    return np.asarray(~used | (used & outside))


def _gain_margin(view: View, crossing: Crossing) -> Trace:
    words = f"gain margin {_level_words(view, crossing)} at {_where(view, crossing)}"
    ends = [_factor(view, 1.0), _factor(view, 1.0 / crossing.value)]
    return _mark(view, crossing, words, MODEL, ends, _reach(view, crossing, 1.0 / crossing.value))


def _phase_margin(view: View, crossing: Crossing, drawn: Curve) -> Trace:
    margin, std = math.degrees(crossing.value), math.degrees(crossing.value_std)
    finite = np.isfinite(drawn.phase_deg)
    there = np.interp(math.log(crossing.omega_rad_s), np.log(drawn.omega_rad_s[finite]), drawn.phase_deg[finite])
    # The loop may be a whole turn further down than the −180° that the margin counts from.
    foot = -180.0 + 360.0 * round((float(there) - margin + 180.0) / 360.0)
    words = f"phase margin {with_error(margin, std, digits=3)}° at {_where(view, crossing)}"
    return _mark(view, crossing, words, INPUT, [foot, foot + margin], (SIGMAS * std, SIGMAS * std))


def _mark(
    view: View, crossing: Crossing, words: str, color: str, heights: Sequence[float], reach: tuple[float, float]
) -> Trace:
    """A bar between the heights, a marker with its uncertainty at the last of them."""
    ((low, high),) = view.bands([(SIGMAS * crossing.omega_std_rad_s, crossing.omega_rad_s)])
    bare = [0.0] * (len(heights) - 1)
    error = {"type": "data", "color": color, "thickness": 1.4, "width": 4}
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": numbers(np.full(len(heights), high)),
        "y": numbers(np.array(heights)),
        "error_x": {**error, "array": [*bare, low]},
        "error_y": {**error, "symmetric": False, "array": [*bare, reach[1]], "arrayminus": [*bare, reach[0]]},
        "line": {"color": color, "width": 2.2},
        "marker": {"color": color, "size": [*bare, 8], "symbol": "diamond", "opacity": 1.0, "line": {"width": 0}},
        "hovertemplate": f"{words}<extra></extra>",
        "name": words,
        "legendgroup": words,
        "showlegend": True,
    }


def _factor(view: View, factor: float) -> float:
    """A factor on the magnitude axis."""
    return float(view.height(decibels(np.array([factor])))[0])


def _reach(view: View, crossing: Crossing, middle: float) -> tuple[float, float]:
    """How far the error bar of a factor goes down and up, as the band does: by a factor to both sides."""
    spread = 1.0 + SIGMAS * crossing.value_std / crossing.value
    here = _factor(view, middle)
    return here - _factor(view, middle / spread), _factor(view, middle * spread) - here


def _level_words(view: View, crossing: Crossing) -> str:
    if view.magnitude == "linear":
        return with_error(crossing.value, crossing.value_std, digits=3)
    return f"{in_decibels(crossing.value, crossing.value_std, digits=3)} dB"


def _where(view: View, crossing: Crossing) -> str:
    ((std, omega),) = view.bands([(crossing.omega_std_rad_s, crossing.omega_rad_s)])
    return f"{with_error(omega, std, digits=3)} {view.frequency}"


DAMPING_RATIOS = (0.2, 0.4, 0.6, 0.8)

_HEIGHT_PX = 330.0
_CORNERS = 48
_ROOM = 1.18
_LABELED = 0.9
_FAR = 20.0
"""So many times further than the poles reach lines go on, since equal scales may show more of the plane than asked."""
_LEAST_REACH = 0.1
"""In 1/s: a pole at rest is drawn at rest, and not on the rounding of a computer."""


def s_plane(
    poles: ComplexArray, *, std: ComplexArray | None = None, words: Sequence[str] = (), unit: str = "1/s"
) -> Figure:
    r"""Poles as crosses, each in an ellipse of two standard deviations, over lines of equal damping.

    Real and imaginary part have one scale, so that the distance from the origin is the natural frequency and the angle
    to the negative real axis is :math:`\cos^{-1}\zeta`. The half plane in which motions grow is shaded. The axes of the
    ellipses are those of the plane: how real and imaginary part vary together is not drawn.

    Parameters
    ----------
    poles
        Both of a complex pair, shape ``(n,)``, 1/s.
    std
        Standard deviations of real and imaginary part as a complex number, same shape; not finite where there is none.
    words
        What each pole says to who points at it; its value by default.
    unit
        Of the imaginary axis.

    Raises
    ------
    UsageError
        A shape does not fit, or a pole is not finite.

    Examples
    --------
    >>> figure = s_plane(np.array([-4.6, 2.6 + 4.3j, 2.6 - 4.3j]), std=np.array([0.1, 0.1 + 0.2j, 0.1 + 0.2j]))
    >>> [(trace["name"], trace["x"]) for trace in figure["data"] if trace["mode"] == "markers"]
    [('decays', [-4.6]), ('grows', [2.6, 2.6])]
    """
    spread = np.full(poles.shape, complex(np.nan, np.nan)) if std is None else std
    _require(poles, spread, words)
    labels = list(words) or [minus(f"{pole.real:.4g} {pole.imag:+.4g}j") for pole in poles.tolist()]
    reach = max(float(np.abs(poles).max(initial=0.0)), _LEAST_REACH)
    grows = poles.real > 0.0
    across, up = _ranges(poles, reach)
    traces = [*_damping_lines(reach, left=-across[0], top=up[1]), *_ellipses(poles, spread)]
    for name, color, chosen in (("decays", MEASURED, ~grows), ("grows", MODEL, grows)):
        if chosen.any():
            shown = [text(label) for label, inside in zip(labels, chosen, strict=True) if inside]
            traces.append(_crosses(poles[chosen], shown, name, color))
    panel = Panel(
        label=f"Imaginary part [{unit}]",
        traces=traces,
        height_px=_HEIGHT_PX,
        axis={"range": up, "scaleanchor": "x", "scaleratio": 1, "zeroline": True},
        shaded=[(0.0, _FAR * reach)],
    )
    return stacked([panel], x_axis={"title": {"text": "Real part [1/s]"}, "range": across, "zeroline": True})


def _require(poles: ComplexArray, std: ComplexArray, words: Sequence[str]) -> None:
    if poles.ndim != 1 or std.shape != poles.shape or (words and len(words) != poles.size):
        raise UsageError(
            f"poles have the shape {poles.shape}, deviations {std.shape}, and there are {len(words)} texts",
            needed="one row of poles, and one of each for every pole",
        )
    if not np.isfinite(poles).all():
        raise UsageError("a pole is not finite", needed="finite poles")


def _ranges(poles: ComplexArray, reach: float) -> tuple[list[float], list[float]]:
    """What both axes show at least: the poles, and the origin with a piece of the growing half plane."""
    low = min(float(poles.real.min(initial=0.0)), -0.25 * reach)
    high = max(float(poles.real.max(initial=0.0)), 0.15 * reach)
    pad = (_ROOM - 1.0) * (high - low) / 2.0
    top = max(_ROOM * float(np.abs(poles.imag).max(initial=0.0)), 0.35 * reach)
    across, up = numbers(np.array([low - pad, high + pad])), numbers(np.array([-top, top]))
    return [float(end or 0.0) for end in across], [float(end or 0.0) for end in up]


def _damping_lines(reach: float, *, left: float, top: float) -> list[Trace]:
    """Rays of equal damping in the decaying half plane, above and below, each with its ratio."""
    angles = np.arccos(np.array(DAMPING_RATIOS))
    rays = np.concatenate([np.exp(1j * (np.pi - angles)), np.exp(-1j * (np.pi - angles))])
    ends = np.array([point for ray in rays for point in (0.0, _FAR * reach * ray, np.nan)])
    lines: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(np.where(np.isnan(ends), np.nan, ends.real)),
        "y": numbers(np.where(np.isnan(ends), np.nan, ends.imag)),
        "line": {"color": translucent(SECONDARY, 0.55), "width": 1, "dash": "dot"},
        "hoverinfo": "skip",
        "name": "equal damping",
        "legendgroup": "equal damping",
        "showlegend": True,
    }
    # Where a ray leaves the part of the plane that is shown for sure.
    within = np.minimum(left / np.cos(angles), top / np.sin(angles))
    labeled = _LABELED * within * np.exp(1j * (np.pi - angles))
    labels: Trace = {
        "type": "scatter",
        "mode": "text",
        "x": numbers(labeled.real),
        "y": numbers(labeled.imag),
        "text": [f"{ratio:g}" for ratio in DAMPING_RATIOS],
        "textfont": {"size": 10, "color": SECONDARY},
        "hoverinfo": "skip",
        "name": "equal damping",
        "legendgroup": "equal damping",
        "showlegend": False,
    }
    return [lines, labels]


def _ellipses(poles: ComplexArray, std: ComplexArray) -> list[Trace]:
    known = np.isfinite(std.real) & np.isfinite(std.imag)
    if not known.any():
        return []
    turn = np.linspace(0.0, 2.0 * np.pi, _CORNERS)
    outlines = [_outline(pole, spread, turn) for pole, spread in zip(poles[known], std[known], strict=True)]
    along = np.concatenate(outlines)
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": numbers(along[:, 0]),
            "y": numbers(along[:, 1]),
            "fill": "toself",
            "fillcolor": translucent(SECONDARY, 0.35),
            "line": {"color": SECONDARY, "width": 1},
            "hoverinfo": "skip",
            "name": f"± {SIGMAS:g} σ",
            "showlegend": True,
        }
    ]


def _outline(pole: complex, std: complex, turn: FloatArray) -> FloatArray:
    """Corners of one ellipse with a gap behind the last, shape ``(corners + 1, 2)``."""
    across = pole.real + SIGMAS * std.real * np.cos(turn)
    up = pole.imag + SIGMAS * std.imag * np.sin(turn)
    return np.vstack([np.column_stack([across, up]), [np.nan, np.nan]])


def _crosses(poles: ComplexArray, words: Sequence[str], name: str, color: str) -> Trace:
    marker: dict[str, Any] = {"symbol": "x-thin", "size": 10, "color": color, "line": {"color": color, "width": 2.4}}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(poles.real),
        "y": numbers(poles.imag),
        "marker": marker,
        "text": list(words),
        "hovertemplate": "%{text}<extra></extra>",
        "name": name,
        "showlegend": True,
    }


LABELED = 0.5
"""Correlation from which a cell shows its number."""

_CELL_PX, _LEAST_PX = 24.0, 150.0
_STRONGEST, _FAINTEST = 0.75, 0.05


def correlation_map(names: Sequence[str], correlation: FloatArray) -> Figure:
    """Correlation of every two parameters as a triangle of cells, the stronger the fuller.

    One color raises with the other parameter, the other falls. Cells from 0.5 on carry their number in percent, and
    every cell says its own to who points at it.

    Parameters
    ----------
    names
        At least two parameters.
    correlation
        Shape ``(n, n)``, from -1 to 1; not finite where there is none.

    Raises
    ------
    UsageError
        There are fewer than two names, or the shape does not fit them.

    Examples
    --------
    >>> figure = correlation_map(["M_q", "M_u"], np.array([[1.0, -0.93], [-0.93, 1.0]]))
    >>> [trace["text"] for trace in figure["data"]]
    [['M_u and M_q: −0.93'], ['−93']]
    """
    if len(names) < 2 or correlation.shape != (len(names), len(names)):
        raise UsageError(
            f"there are {len(names)} names for a correlation of shape {correlation.shape}",
            needed="two names and more, and a row and a column for each",
        )
    rows, columns = np.tril_indices(len(names), k=-1)
    values = correlation[rows, columns]
    words = [
        f"{names[row]} and {names[column]}: {_number(value, '.2f')}"
        for row, column, value in zip(rows.tolist(), columns.tolist(), values.tolist(), strict=True)
    ]
    strong = np.abs(values) >= LABELED
    traces = [_cells(rows, columns, values, words), _numbers(rows[strong], columns[strong], values[strong])]
    shown = [text(name) for name in names]
    # The first row and the last column of a triangle without its diagonal are empty.
    axis = {"tickvals": list(range(1, len(names))), "ticktext": shown[1:], "range": [len(names) - 0.5, 0.5]}
    height = max(_CELL_PX * (len(names) - 1), _LEAST_PX)
    quiet = {"showgrid": False, "zeroline": False, "fixedrange": True, "ticks": ""}
    panel = Panel(label="Correlation of the estimates [%]", traces=traces, height_px=height, axis={**axis, **quiet})
    bottom = {"tickvals": list(range(len(names) - 1)), "ticktext": shown[:-1], "range": [-0.5, len(names) - 1.5]}
    return stacked([panel], x_axis={**bottom, **quiet, "tickangle": -60})


def _cells(rows: IntArray, columns: IntArray, values: FloatArray, words: Sequence[str]) -> Trace:
    """Bars of height one, each on a base of its own: the small plotly has no map of cells."""
    return {
        "type": "bar",
        "x": columns.tolist(),
        "y": [0.94] * len(words),
        "base": [row - 0.47 for row in rows.tolist()],
        "width": 0.94,
        "marker": {"color": [_color(value) for value in values.tolist()], "line": {"width": 0}},
        "text": [text(word) for word in words],
        "textposition": "none",
        "hovertemplate": "%{text}<extra></extra>",
        "showlegend": False,
    }


def _numbers(rows: IntArray, columns: IntArray, values: FloatArray) -> Trace:
    return {
        "type": "scatter",
        "mode": "text",
        "x": columns.tolist(),
        "y": rows.tolist(),
        "text": [_number(100.0 * value, ".0f") for value in values.tolist()],
        "textfont": {"size": 10},
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _color(value: float) -> str:
    if not np.isfinite(value):
        return translucent(SECONDARY, _FAINTEST)
    strength = max(_STRONGEST * min(abs(value), 1.0) ** 1.5, _FAINTEST)
    return translucent(MEASURED if value >= 0.0 else MODEL, round(strength, 3))


def _number(value: float, form: str) -> str:
    return minus(f"{value:{form}}") if np.isfinite(value) else "unknown"
