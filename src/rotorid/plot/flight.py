"""Air of a vehicle: the thrust of a rotor by its speed in several flows, and drag by airspeed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.figure import MEASURED, MODEL, SECONDARY, SERIES, Figure, Panel, Trace, numbers, stacked
from rotorid.typing import FloatArray

_HEIGHT_PX = 300.0


def thrust_in_air(
    speeds: FloatArray,
    thrust_n: Mapping[str, FloatArray],
    *,
    flown: tuple[float, float],
    weight_n: float,
    axis: str = "Motor speed [rad/s]",
) -> Figure:
    """Thrust of a rotor by its speed, a line for each flow through it.

    Parameters
    ----------
    speeds
        Ascending, shape ``(n,)``.
    thrust_n
        Words for a flow to the thrust in it, shape ``(n,)``.
    flown
        Lowest and highest speed of the flights, shaded.
    weight_n
        Share of the weight that a rotor carries.
    axis
        Title of the horizontal axis.

    Raises
    ------
    UsageError
        Shapes differ.

    Examples
    --------
    >>> speeds = np.linspace(0.0, 1000.0, 3)
    >>> figure = thrust_in_air(speeds, {"hover": 2e-6 * speeds**2}, flown=(600.0, 900.0), weight_n=1.2)
    >>> [trace["name"] for trace in figure["data"]]
    ['hover']
    """
    if any(row.shape != speeds.shape for row in thrust_n.values()):
        raise UsageError("rows of thrust have other lengths than the speeds", needed="rows of equal length")
    traces: list[Trace] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": numbers(speeds),
            "y": numbers(row),
            "line": {"color": SERIES[number % len(SERIES)], "width": 2.0},
            "hovertemplate": "%{x:.3~g}<br>%{y:.4~g} N",
            "name": words,
            "showlegend": True,
        }
        for number, (words, row) in enumerate(thrust_n.items())
    ]
    panel = Panel(
        label="Thrust of a rotor [N]; dotted line: its share of the weight",
        traces=traces,
        height_px=_HEIGHT_PX,
        axis={"rangemode": "tozero"},
        shaded=(flown,),
        level=weight_n,
    )
    return stacked([panel], x_axis={"title": {"text": axis}, "rangemode": "tozero"})


def drag_by_airspeed(
    airspeed_m_s: FloatArray, measured_n: FloatArray, modeled_n: FloatArray, seconds: FloatArray
) -> Figure:
    """Mean force against the airspeed along the discs, measured and modeled.

    Parameters
    ----------
    airspeed_m_s, measured_n, modeled_n, seconds
        Of each bin, ascending airspeed, shape ``(bins,)``; the seconds that a bin was flown are the size of its point.

    Raises
    ------
    UsageError
        Shapes differ.
    """
    if len({row.shape for row in (airspeed_m_s, measured_n, modeled_n, seconds)}) > 1:
        raise UsageError("airspeeds, forces and seconds have different lengths", needed="rows of equal length")
    sizes = 6.0 + 10.0 * np.sqrt(seconds / max(float(seconds.max(initial=0.0)), 1e-9))
    traces: list[Trace] = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": numbers(airspeed_m_s),
            "y": numbers(measured_n),
            "marker": {"color": MEASURED, "size": numbers(sizes), "line": {"color": SECONDARY, "width": 0.5}},
            "hovertemplate": "%{x:.3~g} m/s<br>%{y:.3~g} N",
            "name": "measured",
            "showlegend": True,
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": numbers(airspeed_m_s),
            "y": numbers(modeled_n),
            "line": {"color": MODEL, "width": 2.0},
            "hovertemplate": "%{x:.3~g} m/s<br>%{y:.3~g} N",
            "name": "model",
            "showlegend": True,
        },
    ]
    panel = Panel(label="Drag along the discs [N]", traces=traces, height_px=_HEIGHT_PX, axis={"rangemode": "tozero"})
    return stacked([panel], x_axis={"title": {"text": "Airspeed along the discs [m/s]"}, "rangemode": "tozero"})
