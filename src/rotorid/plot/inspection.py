"""A whole log in one picture: what was excited when, what the vehicle did, and where which topic was logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rotorid.plot.figure import INPUT, MEASURED, MODEL, SECONDARY, Figure, Panel, Trace, quantity, stacked, text
from rotorid.plot.time import TIME_AXIS, line
from rotorid.typing import FloatArray

BAR_COLORS = {"flight": INPUT, "excitation": MODEL, "candidate": SECONDARY, "logged": MEASURED}
"""Colors of the bars by their group, for a screen and for paper alike."""

_ROW_PX, _BAR_PX = 24.0, 11.0


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One row of bars.

    Parameters
    ----------
    row
        Name of the row: an axis, or a topic.
    group
        A key of ``BAR_COLORS``.
    spans
        Intervals in seconds on the log's own clock.
    words
        What each interval is, one text for each.
    """

    row: str
    group: str
    spans: Sequence[tuple[float, float]]
    words: Sequence[str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trend:
    """One channel over the log.

    Parameters
    ----------
    is_input
        Whether it drives the vehicle.
    time_s, values
        Shape ``(samples,)``, seconds on the log's own clock and SI units.
    shaded
        Intervals to shade: the excitations seen in it.
    """

    channel: str
    is_input: bool
    time_s: FloatArray
    values: FloatArray
    shaded: Sequence[tuple[float, float]] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class LogPicture:
    """What the picture shows, from top to bottom.

    Parameters
    ----------
    excitations
        When the vehicle flew, and one or two rows of bars for each axis: what was found, and candidates.
    trends
        Inputs and outputs.
    topics
        Where each topic was logged.
    """

    excitations: Sequence[Bar]
    trends: Sequence[Trend]
    topics: Sequence[Bar]


def log_figure(picture: LogPicture) -> Figure:
    """Bars of excitations, channels, and bars of topics over one time axis, so that zooming one zooms all.

    Parameters
    ----------
    picture
        What a log contains, over time.

    Examples
    --------
    >>> bar = Bar(row="roll", group="excitation", spans=[(3.0, 63.0)], words=["sweep"])
    >>> figure = log_figure(LogPicture(excitations=[bar], trends=[], topics=[]))
    >>> figure["data"][0]["x"], figure["data"][0]["y"]
    ([3.0, 63.0, None], ['roll', 'roll', None])
    """
    trends = [
        Panel(
            label=quantity(trend.channel).label,
            traces=(_trend(trend, legend=trend in _first_of_each(picture.trends)),),
            height_px=74,
            shaded=trend.shaded,
        )
        for trend in picture.trends
    ]
    panels = [_bars("flights and excitations", picture.excitations), *trends, _bars("logged topics", picture.topics)]
    return stacked([panel for panel in panels if panel.traces], x_axis=TIME_AXIS)


def _first_of_each(trends: Sequence[Trend]) -> list[Trend]:
    """The first input and the first output, which stand for all in the legend."""
    return [trend for is_input in (True, False) for trend in [t for t in trends if t.is_input is is_input][:1]]


def _trend(trend: Trend, *, legend: bool) -> Trace:
    words, color = ("input", INPUT) if trend.is_input else ("output", MEASURED)
    return line(trend.time_s, trend.values, trend.channel, words=words, color=color, legend=legend, width=1.0)


def _bars(label: str, bars: Sequence[Bar]) -> Panel:
    rows = list(dict.fromkeys(text(bar.row) for bar in bars))
    groups = list(dict.fromkeys(bar.group for bar in bars))
    axis: dict[str, Any] = {
        "type": "category",
        # Categories rise from below; the first row belongs on top.
        "categoryorder": "array",
        "categoryarray": rows[::-1],
        "range": [-0.5, len(rows) - 0.5],
        "showgrid": False,
        "fixedrange": True,
    }
    traces = tuple(_group(group, [bar for bar in bars if bar.group == group]) for group in groups)
    return Panel(label=label, traces=traces, height_px=max(_ROW_PX * len(rows), 1.0), axis=axis)


def _group(group: str, bars: Sequence[Bar]) -> Trace:
    """All bars of one color as one trace: a line of two points each, and a gap after it."""
    x: list[float | None] = []
    y: list[str | None] = []
    words: list[str] = []
    for bar in bars:
        for (start_s, stop_s), label in zip(bar.spans, bar.words, strict=True):
            x += [round(start_s, 4), round(stop_s, 4), None]
            y += [text(bar.row), text(bar.row), None]
            words += [text(label), text(label), ""]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "text": words,
        "line": {"color": BAR_COLORS[group], "width": _BAR_PX},
        "hovertemplate": "%{y}: %{text}<br>%{x:.2f} s<extra></extra>",
        "name": group,
        "showlegend": group != "logged",
    }
