"""Rotors from above, the thrust of one by its output, and accelerations that motors make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.figure import (
    INPUT,
    MEASURED,
    MODEL,
    MOST_POINTS,
    SECONDARY,
    Figure,
    Panel,
    Trace,
    numbers,
    quantity,
    stacked,
    translucent,
)
from rotorid.plot.time import TIME_AXIS, line
from rotorid.typing import FloatArray

_LAYOUT_PX, _CURVE_PX = 300.0, 300.0
_CORNERS = 60
_TOUCHING = 0.45
"""Radius of a drawn rotor over the distance to its neighbor, a little less than what would touch it."""
_WIDEST = 1.3
"""Distance over the size of the vehicle from which rotors are drawn no larger."""
_WITHIN = 0.72
"""Radius of a rotor that shares its place with another, over the radius of that."""
_ARC = (0.15 * np.pi, 1.75 * np.pi)
_SPINS = ((1.0, "counterclockwise", MEASURED), (-1.0, "clockwise", MODEL))
_MOTION_PX, _MOTOR_PX = 170.0, 60.0


def rotor_layout(positions: FloatArray, spins: FloatArray, *, in_meters: bool) -> Figure:
    """Rotors from above, nose up: numbers of the motors, and arrows in the direction in which each turns.

    Parameters
    ----------
    positions
        Forward, right and down of the center of gravity, shape ``(rotors, 3)``.
    spins
        +1 for a rotor that turns counterclockwise seen from above, -1 for a clockwise one, shape ``(rotors,)``.
    in_meters
        Whether positions are meters, and not units of the arm.

    Raises
    ------
    UsageError
        There is no rotor, or shapes do not fit.

    Examples
    --------
    >>> figure = rotor_layout(np.array([[0.2, 0.2, 0.0], [-0.2, -0.2, 0.0]]), np.array([1.0, -1.0]), in_meters=True)
    >>> [trace["name"] for trace in figure["data"] if trace["showlegend"]]
    ['counterclockwise', 'clockwise']
    """
    if positions.ndim != 2 or positions.shape[1:] != (3,) or spins.shape != positions.shape[:1] or not spins.size:
        raise UsageError(
            f"positions have the shape {positions.shape}, spins {spins.shape}",
            needed="three coordinates and a spin for each rotor",
        )
    places = positions[:, 1] + 1j * positions[:, 0]
    radii, labels = _radii(places)
    reach = 1.08 * float(np.max(np.abs(places) + radii))
    traces: list[Trace] = [_frame(places, radii, reach)]
    for spin, words, color in _SPINS:
        motor_speed = spins == spin
        if motor_speed.any():
            traces.append(_circles(places[motor_speed], radii[motor_speed], spin, words, color))
    traces.append(_numbers(labels))
    unit = "m" if in_meters else "arms"
    panel = Panel(
        label=f"Forward [{unit}]; from above, nose up",
        traces=traces,
        height_px=_LAYOUT_PX,
        axis={"range": [-reach, reach], "scaleanchor": "x", "scaleratio": 1, "zeroline": True},
    )
    return stacked([panel], x_axis={"title": {"text": f"Right [{unit}]"}, "range": [-reach, reach], "zeroline": True})


def _radii(places: Any) -> tuple[FloatArray, dict[complex, str]]:
    """Radius of each rotor, and the numbers at each place: coaxial rotors lie within each other."""
    distances = np.abs(places[:, None] - places[None, :])
    far = distances[distances > 1e-6]
    size = float(np.abs(places).max()) or 1.0
    base = _TOUCHING * float(far.min(initial=_WIDEST * size))
    above = np.array([int(np.sum(distances[row, :row] <= 1e-6)) for row in range(places.size)])
    labels: dict[complex, str] = {}
    for row, count in enumerate(above.tolist()):
        place = complex(places[row])
        met = next((known for known in labels if abs(known - place) <= 1e-6), place)
        labels[met] = f"{labels[met]} + {row + 1}" if count else f"{row + 1}"
    return base * _WITHIN**above, labels


def _frame(places: Any, radii: FloatArray, reach: float) -> Trace:
    """Arms from the center to the circles, and an arrow toward the nose."""
    tip, side = 0.24 * reach, 0.06 * reach
    arrow = [0.0, 1j * tip, np.nan, 1j * (tip - side) - side, 1j * tip, 1j * (tip - side) + side, np.nan]
    ends = places * np.maximum(1.0 - radii / np.maximum(np.abs(places), 1e-9), 0.0)
    points = np.array([point for end in ends.tolist() for point in (0.0, end, np.nan)] + arrow)
    return _outline(points, {"color": SECONDARY, "width": 1.6}, "arms and nose")


def _circles(places: Any, radii: FloatArray, spin: float, words: str, color: str) -> Trace:
    """A disk for each rotor, with an arc inside that ends in an arrow."""
    turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, _CORNERS))
    swept = np.exp(1j * spin * np.linspace(*_ARC, _CORNERS))
    tip = swept[-1]
    # Backward along the circle from the tip, opened to both sides.
    back = -1j * spin * tip * 0.28
    head = [tip + back * np.exp(0.5j), tip, tip + back * np.exp(-0.5j)]
    shape = np.concatenate([turn, [np.nan], 0.78 * swept, [np.nan], 0.78 * np.array(head), [np.nan]])
    points = np.concatenate([place + radius * shape for place, radius in zip(places, radii, strict=True)])
    return _outline(points, {"color": color, "width": 2.0}, words, legend=True)


def _outline(points: Any, drawn: dict[str, Any], words: str, *, legend: bool = False) -> Trace:
    points = np.asarray(points, dtype=np.complex128)
    gap = np.isnan(points)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(np.where(gap, np.nan, points.real)),
        "y": numbers(np.where(gap, np.nan, points.imag)),
        "line": drawn,
        "hoverinfo": "skip",
        "name": words,
        "showlegend": legend,
    }


def _numbers(labels: dict[complex, str]) -> Trace:
    places = np.array(list(labels))
    return {
        "type": "scatter",
        "mode": "text",
        "x": numbers(places.real),
        "y": numbers(places.imag),
        "text": list(labels.values()),
        "textfont": {"size": 15},
        "hovertemplate": "motor %{text}<br>%{y:.3~g} forward, %{x:.3~g} right<extra></extra>",
        "name": "motors",
        "showlegend": False,
    }


def thrust_curve(
    outputs: FloatArray,
    thrust_n: FloatArray,
    std_n: FloatArray,
    *,
    flown: tuple[float, float],
    hover: float,
    weight_n: float,
    axis: str = "Output of the motor",
) -> Figure:
    """Thrust of a rotor by its output with one standard deviation, dotted beyond what was flown.

    Parameters
    ----------
    outputs
        Ascending, shape ``(n,)``.
    thrust_n, std_n
        Thrust and its standard deviation, shape ``(n,)``.
    flown
        Lowest and highest output of the flights.
    hover
        Mean output of the flights.
    weight_n
        Share of the weight that a rotor carries.
    axis
        Title of the horizontal axis.

    Raises
    ------
    UsageError
        Shapes differ.
    """
    if outputs.ndim != 1 or not outputs.shape == thrust_n.shape == std_n.shape:
        raise UsageError(
            f"outputs have the shape {outputs.shape}, thrust {thrust_n.shape}, deviations {std_n.shape}",
            needed="three rows of equal length",
        )
    inside = (outputs >= flown[0]) & (outputs <= flown[1])
    # The neighbors join the pieces.
    beyond = ~inside | ~np.roll(inside, 1) | ~np.roll(inside, -1)
    at_hover = float(np.interp(hover, outputs, thrust_n))
    traces = [
        _band(outputs, thrust_n, std_n),
        _curve(outputs, np.where(inside, thrust_n, np.nan), "flown", "solid"),
        _curve(outputs, np.where(beyond, thrust_n, np.nan), "extrapolated", "dot"),
        _mark(hover, at_hover),
    ]
    panel = Panel(
        label="Thrust of a rotor [N]; dotted line: its share of the weight",
        traces=traces,
        height_px=_CURVE_PX,
        axis={"rangemode": "tozero"},
        shaded=(flown,),
        level=weight_n,
    )
    return stacked([panel], x_axis={"title": {"text": axis}, "rangemode": "tozero"})


def thrust_over_inflow(
    advance_ratio: FloatArray, c_T: FloatArray, std: FloatArray, *, flown: tuple[float, float] | None
) -> Figure:
    """Thrust coefficient of a rotor over its advance ratio with one standard deviation, shaded where it was flown.

    Parameters
    ----------
    advance_ratio
        Ascending, positive in climb, shape ``(n,)``.
    c_T, std
        Coefficient and its standard deviation, shape ``(n,)``.
    flown
        Lowest and highest ratio of the flights, where that is known.

    Raises
    ------
    UsageError
        Shapes differ.
    """
    if advance_ratio.ndim != 1 or not advance_ratio.shape == c_T.shape == std.shape:
        raise UsageError(
            f"ratios have the shape {advance_ratio.shape}, values {c_T.shape}, deviations {std.shape}",
            needed="three rows of equal length",
        )
    line: Trace = {
        **_curve(advance_ratio, c_T, "thrust coefficient", "solid"),
        "hovertemplate": "%{x:.3~g}<br>%{y:.4~g}",
    }
    panel = Panel(
        label="Thrust coefficient of a rotor" + ("; shaded: flown" if flown else ""),
        traces=[_band(advance_ratio, c_T, std), line],
        height_px=_CURVE_PX,
        shaded=(flown,) if flown else (),
    )
    return stacked([panel], x_axis={"title": {"text": "Advance ratio J = −w/(nD), positive in climb"}})


def _band(x: FloatArray, y: FloatArray, std: FloatArray) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(np.concatenate([x, x[::-1]])),
        "y": numbers(np.concatenate([y + std, (y - std)[::-1]])),
        "fill": "toself",
        "fillcolor": translucent(MODEL, 0.22),
        "line": {"width": 0, "color": MODEL},
        "hoverinfo": "skip",
        "name": "± 1 σ",
        "showlegend": True,
    }


def _curve(outputs: FloatArray, thrust_n: FloatArray, words: str, dash: str) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(outputs),
        "y": numbers(thrust_n),
        "line": {"color": MODEL, "width": 2.0, "dash": dash},
        "hovertemplate": "%{x:.3~g}<br>%{y:.4~g} N",
        "name": words,
        "showlegend": True,
    }


def _mark(hover: float, thrust_n: float) -> Trace:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(np.array([hover])),
        "y": numbers(np.array([thrust_n])),
        "marker": {"color": MEASURED, "size": 10, "symbol": "diamond"},
        "hovertemplate": "%{x:.3~g}<br>%{y:.4~g} N",
        "name": "mean of the flight",
        "showlegend": True,
    }


def made_by_motors(
    time_s: FloatArray,
    outputs: FloatArray,
    measured: FloatArray,
    modeled: FloatArray,
    *,
    motor_names: Sequence[str],
    channels: Sequence[str],
    held: bool = True,
    most: int = MOST_POINTS,
) -> Figure:
    """Slow accelerations measured and as the motors make them, the motors below.

    Parameters
    ----------
    time_s
        Shape ``(samples,)``.
    outputs
        Of the motors about their mean, shape ``(motors, samples)``.
    measured, modeled
        Shape ``(channels, samples)``, SI units; angles are drawn in degrees.
    motor_names, channels
        Names of the rows.
    held
        Whether outputs are drawn as steps.
    most
        Points of a trace, from which it is thinned.
    """
    pairs = (("measured", MEASURED, "solid", measured), ("made by the motors", MODEL, "5 3", modeled))
    panels = [
        Panel(
            label=quantity(name).label,
            traces=[
                line(time_s, rows[row], name, words=words, color=color, dash=dash, legend=row == 0, most=most)
                for words, color, dash, rows in pairs
            ],
            height_px=_MOTION_PX,
        )
        for row, name in enumerate(channels)
    ]
    for row, name in enumerate(motor_names):
        trace = line(time_s, outputs[row], name, words="output about its mean", color=INPUT, legend=row == 0, most=most)
        drawn = {**trace["line"], "width": 1.0, **({"shape": "hv"} if held else {})}
        panels.append(Panel(label=quantity(name).words, traces=[{**trace, "line": drawn}], height_px=_MOTOR_PX))
    return stacked(panels, x_axis=TIME_AXIS)
