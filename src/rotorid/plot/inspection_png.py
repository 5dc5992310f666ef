"""The picture of a whole log on paper, by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rotorid.errors import UsageError
from rotorid.plot.figure import envelope
from rotorid.plot.inspection import BAR_COLORS, Bar, LogPicture, Trend
from rotorid.plot.quantity import quantity
from rotorid.plot.theme import INPUT, MEASURED, MODEL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN, _ROW_IN, _TREND_IN, _MARGIN_IN = 11.0, 0.22, 0.85, 1.1
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#c4c9d0",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e9ebee",
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 3.0,
    "figure.facecolor": "#ffffff",
    # A channel name with a dollar sign is a name, not mathematics.
    "text.parse_math": False,
}


def log_png(picture: LogPicture, *, title: str, dots_per_inch: int = 130) -> bytes:
    """A PNG of what ``log_figure`` shows: excitations, channels and topics over one time axis.

    Parameters
    ----------
    picture
        What to show.
    title
        Heading.
    dots_per_inch
        Resolution of the picture.

    Raises
    ------
    UsageError
        matplotlib is not installed, or there is nothing to draw.
    """
    if not picture.topics:
        raise UsageError(
            "the log holds no channel to draw", needed="a log with channels", remedy="name them with --map"
        )
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure as Canvas
    except ImportError as error:
        raise UsageError(
            "a PNG needs matplotlib, which is not installed",
            needed="the extra 'figures'",
            remedy="pip install 'rotorid[figures]', or write an .html",
        ) from error
    tables = [(label, bars) for label, bars in _tables(picture) if bars]
    heights = [_ROW_IN * len({bar.row for bar in bars}) + 0.15 for _, bars in tables]
    ratios = [*heights[:-1], *(_TREND_IN for _ in picture.trends), heights[-1]]
    with mpl.rc_context(_STYLE):
        # The object instead of pyplot: no global state, no window system.
        canvas = Canvas(figsize=(_WIDTH_IN, sum(ratios) + _MARGIN_IN + 0.2 * len(ratios)), layout="constrained")
        canvas.suptitle(title, x=0.01, ha="left", fontweight="bold")
        cells = list(
            canvas.subplots(len(ratios), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})[:, 0]
        )
        for (label, bars), cell in zip(tables, (*cells[: len(tables) - 1], cells[-1]), strict=True):
            _bars(cell, label, bars)
        for trend, cell in zip(picture.trends, cells[len(tables) - 1 : -1], strict=True):
            _trend(cell, trend)
        cells[-1].set_xlabel("time on the log's clock [s]")
        buffer = io.BytesIO()
        canvas.savefig(buffer, format="png", dpi=dots_per_inch)
    return buffer.getvalue()


def _tables(picture: LogPicture) -> tuple[tuple[str, Sequence[Bar]], ...]:
    return ("flights and excitations (candidates in gray)", picture.excitations), ("logged topics", picture.topics)


def _bars(cell: Axes, label: str, bars: Sequence[Bar]) -> None:
    rows = list(dict.fromkeys(bar.row for bar in bars))
    for bar in bars:
        widths = [(start_s, stop_s - start_s) for start_s, stop_s in bar.spans]
        cell.broken_barh(widths, (rows.index(bar.row) - 0.3, 0.6), color=BAR_COLORS[bar.group])
    cell.set_yticks(range(len(rows)), rows)
    cell.set_ylim(len(rows) - 0.5, -0.5)
    cell.grid(visible=False, axis="y")
    cell.set_title(label)


def _trend(cell: Axes, trend: Trend) -> None:
    paper = quantity(trend.channel)
    time_s, values = envelope(trend.time_s, paper.factor * trend.values)
    cell.plot(time_s, values, color=INPUT if trend.is_input else MEASURED, linewidth=0.8)
    for start_s, stop_s in trend.shaded:
        cell.axvspan(start_s, stop_s, color=MODEL, alpha=0.1, linewidth=0.0)
    cell.set_title(paper.label)
