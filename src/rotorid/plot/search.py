"""The cost over a search, and the measured accelerations that its answer explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.figure import (
    DASHES,
    MEASURED,
    MODEL,
    MOST_POINTS,
    SECONDARY,
    SERIES,
    Figure,
    Panel,
    Trace,
    numbers,
    stacked,
    text,
)
from rotorid.plot.time import TIME_AXIS, line
from rotorid.search.result import Progress
from rotorid.typing import BoolArray, FloatArray, IntArray

_DEGREES = 180.0 / np.pi
_MOST_MARKERS = 150
_MARKER_OFFSET = 0.1
_FEW_DECADES = 3.0
_FINE_TICKS, _COARSE_TICKS, _DECADES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0), (1.0, 2.0, 5.0), (1.0,)

ACCELERATIONS = (
    ("vertical acceleration, upward [m/s²]", 1.0),
    ("roll acceleration [°/s²]", _DEGREES),
    ("pitch acceleration [°/s²]", _DEGREES),
    ("yaw acceleration [°/s²]", _DEGREES),
)
"""Panels of :func:`accelerations`, and their units of paper over SI."""


def convergence(traces: Mapping[str, Sequence[Progress]], *, levels: Mapping[str, float] | None = None) -> Figure:
    """Lowest cost so far over the evaluations of one search or several; each generation is a point.

    Parameters
    ----------
    traces
        What to call a search, and ``SearchResult.trace``. Entries before any finite cost are left out.
    levels
        Costs to compare with, such as that at known parameters or after the local search, by their names.

    Raises
    ------
    UsageError
        There is no search.

    Examples
    --------
    >>> figure = convergence({"genetic": [Progress(15, 0.9), Progress(30, 0.5)]}, levels={"at the truth": 0.4})
    >>> [trace["name"] for trace in figure["data"]]
    ['genetic', 'at the truth']
    """
    if not traces:
        raise UsageError("there is no search to draw", needed="the trace of at least one")
    falls = [_fall(name, trace, number) for number, (name, trace) in enumerate(traces.items())]
    last = max((x for fall in falls for x in fall["x"]), default=1.0)
    drawn = [*falls, *(_level(name, cost, last) for name, cost in (levels or {}).items())]
    costs = np.array([y for trace in drawn for y in trace["y"]])
    panel = Panel(label="Lowest cost so far", traces=drawn, height_px=300, axis=_cost_axis(costs))
    return stacked([panel], x_axis={"title": {"text": "Evaluations of the cost"}})


def clusters(
    costs: FloatArray, owners: IntArray, *, places: FloatArray, place: str = "", logarithmic: bool = True
) -> Figure:
    """Candidates of a K-means search over its iterations: which points of the data each owns, and what each costs.

    Parameters
    ----------
    costs
        Of each candidate over all points, shape ``(iterations, k)``; no number where it has none.
    owners
        Number of the candidate that owns each point, shape ``(iterations, n)``.
    places
        Where each point lies on the vertical axis, such as its frequency, shape ``(n,)``.
    place
        What that is.
    logarithmic
        Whether that axis is.

    Raises
    ------
    UsageError
        The shapes do not belong together.

    Examples
    --------
    >>> figure = clusters(np.array([[9.0, 7.0], [3.0, 4.0]]), np.array([[0, 1, 1], [0, 0, 1]]), places=np.ones(3))
    >>> [trace["name"] for trace in figure["data"]]
    ['candidate 1', 'candidate 2', 'candidate 1', 'candidate 2']
    """
    if costs.ndim != 2 or owners.shape != (len(costs), places.size) or not owners.size:
        raise UsageError(
            f"costs have the shape {costs.shape}, owners {owners.shape}, for {places.size} places",
            needed="as many iterations of costs and owners, an owner for each place",
        )
    numbered = range(costs.shape[1])
    owned = [_owned(owners == index, places, index) for index in numbered]
    fallen = [_of_candidate(costs[:, index], index) for index in numbered]
    axis = {"type": "log"} if logarithmic else {}
    panels = [
        Panel(label=f"Points of each candidate, {place}" if place else "Points of each candidate", traces=owned,
              height_px=300, axis=axis),
        Panel(label="Cost of each candidate over all points", traces=fallen, height_px=180,
              axis=_cost_axis(costs[np.isfinite(costs)])),
    ]  # fmt: skip
    return stacked(panels, x_axis={"title": {"text": "Iteration"}, "dtick": 1})


def _owned(mine: BoolArray, places: FloatArray, number: int) -> Trace:
    """Points of one candidate, a little next to those of the next, so that responses of one frequency do not hide."""
    iteration, point = np.nonzero(mine)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(np.asarray(iteration + (1.0 + _MARKER_OFFSET * number), dtype=np.float64)),
        "y": numbers(places[point]),
        "marker": {"size": 5, "color": SERIES[number % len(SERIES)]},
        "hovertemplate": "%{y:.4~g}",
        "name": f"candidate {number + 1}",
        "showlegend": True,
    }


def _of_candidate(costs: FloatArray, number: int) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": numbers(np.arange(1.0, costs.size + 1.0)),
        "y": numbers(costs),
        "line": {"color": SERIES[number % len(SERIES)], "width": 1.8, "dash": DASHES[number % len(DASHES)]},
        "marker": {"size": 5},
        "hovertemplate": "iteration %{x:d}<br>%{y:.5~g}",
        "name": f"candidate {number + 1}",
        "showlegend": False,
    }


def _fall(name: str, trace: Sequence[Progress], number: int) -> Trace:
    found = [progress for progress in trace if np.isfinite(progress.best)]
    return {
        "type": "scatter",
        "mode": "lines+markers" if len(found) <= _MOST_MARKERS else "lines",
        "x": [float(progress.evaluations) for progress in found],
        "y": numbers(np.array([progress.best for progress in found])),
        "line": {
            "color": SERIES[number % len(SERIES)],
            "width": 1.8,
            "shape": "hv",
            "dash": DASHES[number % len(DASHES)],
        },
        "marker": {"size": 3.5},
        "hovertemplate": "%{x:d} evaluations<br>%{y:.5~g}",
        "name": text(name),
        "showlegend": True,
    }


def _level(name: str, cost: float, last: float) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [0.0, last],
        "y": numbers(np.array([cost, cost])),
        "line": {"color": SECONDARY, "width": 1.4, "dash": "2 3"},
        "hovertemplate": "%{y:.5~g}",
        "name": text(name),
        "showlegend": True,
    }


def _cost_axis(costs: FloatArray) -> dict[str, Any]:
    """Logarithmic, with plain numbers at it, where all costs are positive."""
    if not costs.size or costs.min() <= 0.0:
        return {}
    low, high = np.log10(costs.min()), np.log10(costs.max())
    room = 0.04 * max(high - low, 0.1)
    decades = 10.0 ** np.arange(np.floor(low), np.ceil(high) + 1.0)
    steps = _FINE_TICKS if high - low <= 1.0 else _COARSE_TICKS if high - low <= _FEW_DECADES else _DECADES
    ticks = np.outer(decades, steps).ravel()
    return {"type": "log", "range": [low - room, high + room], "tickvals": numbers(ticks)}


def noise_spread(draws: Mapping[str, FloatArray], *, values: Mapping[str, float], stds: Mapping[str, float]) -> Figure:
    """Parameters of runs with artificial noise, in stated standard deviations from the value without noise.

    Parameters
    ----------
    draws
        Parameter to its value in every run ``(n,)``.
    values, stds
        What was identified without noise, with the stated standard deviation.

    Raises
    ------
    UsageError
        No parameter can be drawn.

    Examples
    --------
    >>> figure = noise_spread({"L_p": np.array([-2.0, -1.8])}, values={"L_p": -2.0}, stds={"L_p": 0.1})
    >>> [trace["name"] for trace in figure["data"]]
    ['runs', 'mean ± standard deviation']
    """
    if not draws:
        raise UsageError("there is no parameter with a stated error", needed="at least one")
    names = list(draws)
    off = [(np.asarray(draws[name]) - values[name]) / stds[name] for name in names]
    # Rows from the top, as those of the table.
    runs: Trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(np.concatenate(off)),
        "y": [-row for row, values in enumerate(off) for _ in values],
        "marker": {"color": MEASURED, "size": 5, "opacity": 0.5},
        "name": "runs",
        "hovertemplate": "%{x:.3~g} stated std",
        "showlegend": True,
    }
    means: Trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(np.array([row.mean() for row in off])),
        "y": [-row for row in range(len(names))],
        "error_x": {"type": "data", "array": numbers(np.array([row.std(ddof=1) for row in off])), "color": MODEL},
        "marker": {"color": MODEL, "size": 8},
        "name": "mean ± standard deviation",
        "hovertemplate": "mean %{x:.3~g} stated std",
        "showlegend": True,
    }
    axis = {"tickvals": [-row for row in range(len(names))], "ticktext": [text(name) for name in names]}
    panel = Panel(label="", traces=(runs, means), height_px=60 + 26 * len(names), axis=axis)
    return stacked([panel], x_axis={"title": {"text": "Deviation from the value without noise [stated std]"}})


_BINS = 31
_BARS_PX = 84
_WIDEST = 2.0
"""The axis reaches so many times as far as the runs of the usual parameter do."""


def run_histogram(
    alone: Mapping[str, FloatArray], polished: Mapping[str, FloatArray], *, centers: Mapping[str, float]
) -> Figure:
    """How often the runs of a search from different seeds ended where, one panel for each parameter.

    Parameters
    ----------
    alone, polished
        Parameter to its value in every run ``(n,)``: before and after the local searches.
    centers
        Values that deviations are counted from, in percent of them; a parameter without one, or with zero, is left out.

    Raises
    ------
    UsageError
        No parameter can be drawn.

    Examples
    --------
    >>> ends = {"I_xx": np.array([0.02, 0.021, 0.019])}
    >>> figure = run_histogram(ends, {"I_xx": np.full(3, 0.02)}, centers={"I_xx": 0.02})
    >>> [trace["name"] for trace in figure["data"]]
    ['by the search alone', 'with local searches']
    """
    drawn = [name for name in alone if centers.get(name, 0.0) != 0.0]
    if not drawn:
        raise UsageError("there is no parameter with a value", needed="at least one")
    off = {name: [100.0 * (np.asarray(of[name]) / centers[name] - 1.0) for of in (alone, polished)] for name in drawn}
    # A run that ended on another side of the box must not squeeze all others into one bar, nor a parameter that is
    # hardly known those that are: what lies beyond is counted in the outermost bars.
    reaches = [max(float(np.percentile(np.abs(row), 95.0)) for row in rows) for rows in off.values()]
    reach = min(max(reaches), _WIDEST * float(np.median(reaches)))
    edges = np.linspace(-1.0, 1.0, _BINS + 1) * (1.15 * reach or 1.0)
    panels = [
        Panel(
            label=f"{text(name)}, runs",
            traces=[_bars(edges, row, first=not number, polished=bool(kind)) for kind, row in enumerate(off[name])],
            height_px=_BARS_PX,
            axis={"rangemode": "tozero", "nticks": 3},
        )
        for number, name in enumerate(drawn)
    ]
    x_axis = {
        "title": {"text": "Deviation from the result [%]; the outermost bars hold what lies beyond"},
        "range": [float(edges[0]), float(edges[-1])],
    }
    figure = stacked(panels, x_axis=x_axis)
    figure["layout"]["barmode"] = "overlay"
    return figure


def _bars(edges: FloatArray, values: FloatArray, *, first: bool, polished: bool) -> Trace:
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    wide = float(edges[1] - edges[0])
    return {
        "type": "bar",
        "x": numbers(0.5 * (edges[1:] + edges[:-1])),
        "y": counts.tolist(),
        "width": (0.35 if polished else 0.95) * wide,
        "marker": {"color": MODEL if polished else MEASURED},
        "hovertemplate": "%{x:.3~g} %: %{y} runs",
        "name": "with local searches" if polished else "by the search alone",
        "showlegend": first,
    }


def accelerations(time_s: FloatArray, measured: FloatArray, modeled: FloatArray, *, most: int = MOST_POINTS) -> Figure:
    """Measured against modeled accelerations: vertical, roll, pitch, yaw.

    Parameters
    ----------
    time_s
        Shape ``(samples,)``.
    measured, modeled
        In the order of :data:`ACCELERATIONS`, SI units, shape ``(4, samples)``.
    most
        Points of a trace, from which it is thinned.

    Raises
    ------
    UsageError
        The shapes do not belong together.
    """
    shape = (len(ACCELERATIONS), time_s.size)
    if not measured.shape == modeled.shape == shape:
        raise UsageError(f"accelerations have the shapes {measured.shape} and {modeled.shape}", needed=f"shape {shape}")
    panels = [
        Panel(
            label=label,
            traces=(
                _against_time(time_s, measured[row] * factor, row, words="measured", most=most),
                _against_time(time_s, modeled[row] * factor, row, words="modeled", most=most),
            ),
            height_px=150,
        )
        for row, (label, factor) in enumerate(ACCELERATIONS)
    ]
    return stacked(panels, x_axis=TIME_AXIS)


def _against_time(time_s: FloatArray, values: FloatArray, row: int, *, words: str, most: int) -> Trace:
    model = words == "modeled"
    return line(
        time_s,
        values,
        ACCELERATIONS[row][0],
        words=words,
        color=MODEL if model else MEASURED,
        legend=row == 0,
        width=1.8 if model else 1.0,
        most=most,
    )
