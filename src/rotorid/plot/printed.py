"""Any picture of a page as a file for paper and slides: the same panels, curves, bands and marks, by matplotlib."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.figure import SECONDARY, Figure, Trace
from rotorid.plot.paper import PAPER_STYLE, matplotlib_or_remedy
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

PrintedAs: TypeAlias = Literal["svg", "pdf", "png"]
PRINTED: tuple[PrintedAs, ...] = ("svg", "pdf", "png")

_WIDTH_IN, _PX_PER_IN, _DOTS_PER_INCH = 7.0, 110.0, 160
_SYMBOLS = {"circle": "o", "diamond": "D", "square": "s", "triangle-up": "^", "x": "x", "cross": "P", "x-thin": "x"}
_DASHES: Mapping[str, Any] = {"solid": "-", "dot": ":", "dash": "--", "dashdot": "-."}
_RGBA = re.compile(r"rgba\((\d{1,3}), ?(\d{1,3}), ?(\d{1,3}), ?([\d.]{1,8})\)")
_TAGS = re.compile(r"<[^<>]{0,40}>")
_MARKER_TO_POINTS = 0.55


def require_format(name: str) -> PrintedAs:
    """Refuse a kind of file that is not known, before any work is done for it.

    Examples
    --------
    >>> require_format("svg")
    'svg'
    """
    if name not in PRINTED:
        raise UsageError(f"figures as {name} were asked for", needed=f"one of {', '.join(PRINTED)}")
    matplotlib_or_remedy("a figure as a file")
    return name


def printed(figure: Figure, kind: PrintedAs) -> bytes:
    """A picture of a page as SVG, PDF or PNG, in light colors.

    Parameters
    ----------
    figure
        As :mod:`rotorid.plot` draws them: panels over a shared axis.
    kind
        Of the file.

    Raises
    ------
    UsageError
        matplotlib is not installed.

    Examples
    --------
    >>> from rotorid.plot.figure import Panel, stacked
    >>> line = {"type": "scatter", "mode": "lines", "x": [0.0, 1.0], "y": [0.0, 2.0], "name": "p", "showlegend": True}
    >>> drawn = stacked([Panel(label="rate", traces=[line], height_px=150)], x_axis={"title": {"text": "s"}})
    >>> printed(drawn, "svg")[:5]
    b'<?xml'
    """
    matplotlib = matplotlib_or_remedy("a figure as a file")
    layout = figure["layout"]
    names = [name for name in layout if name.startswith("yaxis")]
    with matplotlib.rc_context(PAPER_STYLE):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as NewCanvas

        canvas: Canvas = NewCanvas(figsize=(_WIDTH_IN, layout["height"] / _PX_PER_IN), layout="constrained")
        FigureCanvasAgg(canvas)
        domains = [layout[name].get("domain", [0.0, 1.0]) for name in names]
        grid = canvas.subplots(
            len(names), 1, squeeze=False, sharex=True, height_ratios=[max(top - low, 0.02) for low, top in domains]
        )
        rows: list[Axes] = list(grid[:, 0])
        cells = {f"y{name.removeprefix('yaxis')}": cell for name, cell in zip(names, rows, strict=True)}
        for trace in figure["data"]:
            _draw(cells[trace.get("yaxis", "y")], trace)
        for image in layout.get("images", ()):
            _show(cells[image["yref"]], image)
        for name, cell in zip(names, rows, strict=True):
            _vertical(cell, layout[name])
        _shapes(cells, layout.get("shapes", ()))
        _horizontal(rows, layout["xaxis"])
        _labels(rows, domains, layout.get("annotations", ()))
        _legend(canvas, rows)
    return saved(canvas, kind)


def saved(canvas: Canvas, kind: PrintedAs) -> bytes:
    """A matplotlib figure as SVG, PDF with fonts that journals take, or PNG; the same figure is the same file."""
    matplotlib = matplotlib_or_remedy("a figure as a file")
    file = io.BytesIO()
    # No date, so that the same picture is the same file.
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[kind]
    with matplotlib.rc_context({**PAPER_STYLE, "svg.hashsalt": "rotorid", "svg.fonttype": "path", "pdf.fonttype": 42}):
        canvas.savefig(file, format=kind, dpi=_DOTS_PER_INCH, metadata=metadata)
    return file.getvalue()


_INK = "#343a40"
"""Of numbers in cells, dark enough for every color of a map."""


def _draw(cell: Axes, trace: Trace) -> None:
    if trace.get("opacity") == 0 or trace.get("marker", {}).get("opacity") == 0:
        return
    x, y = _column(trace.get("x", ())), _numbers(trace.get("y", ()))
    label = _plain(trace["name"]) if trace.get("showlegend") and trace.get("name") else None
    if trace["type"] == "bar":
        _bar(cell, trace, x, y, label)
        return
    mode = trace.get("mode", "lines")
    line = trace.get("line", {})
    if trace.get("fill") == "toself":
        for part in _unbroken(x, y):
            cell.fill(x[part], y[part], color=_color(trace.get("fillcolor")), linewidth=0, label=label)
            label = None
    if "lines" in mode and line.get("width", 1.5) > 0:
        drawn = "steps-post" if line.get("shape") == "hv" else "default"
        dash = line.get("dash", "solid")
        style = _DASHES.get(dash) or (0, tuple(float(part) for part in str(dash).split()))
        width = 0.75 * line.get("width", 1.5)
        color = _color(line.get("color"))
        cell.plot(x, y, color=color, linewidth=width, linestyle=style, drawstyle=drawn, label=label)
        label = None
    if "markers" in mode:
        _dots(cell, trace, x, y, label)
    if "text" in mode:
        words = trace.get("text", ())
        for across, up, word in zip(x, y, [words] * len(x) if isinstance(words, str) else words, strict=False):
            cell.text(across, up, _plain(str(word)), fontsize=7, ha="center", va="center", color=_INK)


def _dots(cell: Axes, trace: Trace, x: Any, y: FloatArray, label: str | None) -> None:
    marker = trace.get("marker", {})
    colors, sizes, symbols = marker.get("color"), marker.get("size", 6), marker.get("symbol", "circle")
    color = (
        [_color(color) for color in colors]
        if isinstance(colors, Sequence) and not isinstance(colors, str)
        else _color(colors)
    )
    size = (_MARKER_TO_POINTS * np.asarray(sizes, dtype=np.float64)) ** 2
    shape = _SYMBOLS.get(str(symbols if isinstance(symbols, str) else symbols[0]).removesuffix("-open"), "o")
    opacity = marker.get("opacity", 1.0)
    faded: Any = opacity if isinstance(opacity, int | float) else np.asarray(opacity, dtype=np.float64)
    cell.scatter(x, y, s=size, c=color, marker=shape, alpha=faded, linewidths=0.8 if shape in "xP" else 0, label=label)
    for name in ("error_y", "error_x"):
        if "array" not in trace.get(name, {}):
            continue
        half = _numbers(trace[name]["array"])
        both = {"yerr": half, "xerr": None} if name == "error_y" else {"yerr": None, "xerr": half}
        cell.errorbar(x, y, yerr=both["yerr"], xerr=both["xerr"], fmt="none", ecolor=_color(trace[name].get("color")))


def _bar(cell: Axes, trace: Trace, x: Any, y: FloatArray, label: str | None) -> None:
    colors = trace.get("marker", {}).get("color")
    color = [_color(each) for each in colors] if isinstance(colors, list) else _color(colors) if colors else None
    base = _numbers(trace["base"]) if isinstance(trace.get("base"), list) else trace.get("base", 0.0)
    if trace.get("orientation") == "h":
        cell.barh(list(trace["y"]), _numbers(trace["x"]), left=base, color=color, label=label)
        return
    half = _numbers(trace["error_y"]["array"]) if "array" in trace.get("error_y", {}) else None
    cell.bar(x, y, width=trace.get("width", 0.8), bottom=base, yerr=half, color=color, label=label, ecolor=SECONDARY)


def _show(cell: Axes, image: Mapping[str, Any]) -> None:
    from matplotlib.image import imread

    data = base64.b64decode(image["source"].partition(",")[2])
    pixels = imread(io.BytesIO(data), format="png")
    left, top = image["x"], image["y"]
    extent = (left, left + image["sizex"], top - image["sizey"], top)
    cell.imshow(pixels, extent=extent, aspect="auto", origin="upper", zorder=0)


def _vertical(cell: Axes, axis: Mapping[str, Any]) -> None:
    cell.set_axisbelow(True)
    if axis.get("type") == "log":
        cell.set_yscale("log")
    if "range" in axis:
        low, high = axis["range"]
        cell.set_ylim(*((10.0**low, 10.0**high) if axis.get("type") == "log" else (low, high)))
    elif axis.get("rangemode") == "tozero":
        cell.set_ylim(bottom=min(0.0, cell.get_ylim()[0]))
    if axis.get("showgrid") is False:
        cell.grid(visible=False)
    if "tickvals" in axis:
        cell.set_yticks(axis["tickvals"], _ticks(axis))
    title = axis.get("title", {})
    words = title.get("text", "") if isinstance(title, Mapping) else title
    if words:
        cell.set_ylabel(_plain(words))


def _horizontal(rows: Sequence[Axes], axis: Mapping[str, Any]) -> None:
    last = rows[-1]
    if axis.get("type") == "log":
        last.set_xscale("log")
    if "tickvals" in axis:
        last.set_xticks(axis["tickvals"], _ticks(axis), minor=False)
        last.set_xticks([], minor=True)
    if "range" in axis:
        low, high = axis["range"]
        last.set_xlim(*((10.0**low, 10.0**high) if axis.get("type") == "log" else (low, high)))
    title = axis.get("title", {})
    last.set_xlabel(_plain(title.get("text", "") if isinstance(title, Mapping) else title))


def _ticks(axis: Mapping[str, Any]) -> list[str]:
    """Words of the ticks, or their numbers as a person writes them: 10, not 10.0."""
    ticks = axis.get("ticktext", axis["tickvals"])
    return [_plain(tick) if isinstance(tick, str) else f"{tick:g}".replace("-", "−") for tick in ticks]


def _shapes(cells: Mapping[str, Axes], shapes: Sequence[Mapping[str, Any]]) -> None:
    for shape in shapes:
        cell = cells.get(str(shape.get("yref", "y")).partition(" ")[0])
        if cell is None:
            continue
        if shape["type"] == "rect" and shape.get("xref", "x") == "x":
            cell.axvspan(shape["x0"], shape["x1"], color=_color(shape.get("fillcolor")), linewidth=0, zorder=0)
        elif shape["type"] == "line" and shape.get("xref") == "paper":
            cell.axhline(shape["y0"], color=SECONDARY, linewidth=0.8, linestyle=":")
        elif shape["type"] == "line":
            cell.plot([shape["x0"], shape["x1"]], [shape["y0"], shape["y1"]], color=SECONDARY, linewidth=0.8)


def _labels(rows: Sequence[Axes], domains: Sequence[Sequence[float]], notes: Sequence[Mapping[str, Any]]) -> None:
    """Labels above panels, and what is pointed at inside of the first."""
    for note in notes:
        if note.get("xref") == "paper":
            row = int(np.argmin([abs(note["y"] - top) for _, top in domains]))
            rows[row].set_title(_plain(note["text"]), loc="left", fontsize=9, fontweight="normal")
        elif note.get("showarrow"):
            arrow = {"arrowstyle": "-", "color": SECONDARY, "linewidth": 0.8}
            rows[0].annotate(
                _plain(note["text"]),
                (note["x"], note["y"]),
                xytext=(0.6 * note.get("ax", 0), -0.6 * note.get("ay", 0)),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                arrowprops=arrow,
            )


def _legend(canvas: Canvas, rows: Sequence[Axes]) -> None:
    found = {label: handle for cell in rows for handle, label in zip(*cell.get_legend_handles_labels(), strict=True)}
    if found:
        canvas.legend(list(found.values()), list(found), loc="outside upper left", ncols=3)


def _unbroken(x: FloatArray, y: FloatArray) -> Iterator[slice]:
    """Stretches of an outline between its gaps."""
    gaps = np.flatnonzero(~(np.isfinite(x) & np.isfinite(y)))
    edges = [-1, *gaps.tolist(), x.size]
    for start, stop in pairwise(edges):
        if stop - start > 2:
            yield slice(start + 1, stop)


def _column(values: Sequence[Any]) -> Any:
    """Numbers, or the names of categories."""
    return [_plain(value) for value in values] if any(isinstance(value, str) for value in values) else _numbers(values)


def _numbers(values: Sequence[Any]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _color(color: Any) -> Any:
    """A color of the page as matplotlib takes it."""
    if not isinstance(color, str):
        return SECONDARY
    found = _RGBA.fullmatch(color)
    if found is None:
        return color
    red, green, blue, opacity = found.groups()
    return int(red) / 255.0, int(green) / 255.0, int(blue) / 255.0, float(opacity)


def _plain(text: str) -> str:
    """Text of a page without its marks."""
    return html.unescape(_TAGS.sub(" ", text))
