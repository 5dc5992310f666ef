"""Which estimates go together: the correlation of parameters as a map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.figure import Figure, Trace, text
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, MEASURED, MODEL, translucent
from rotorid.typing import FloatArray, IntArray

TOLD = 0.5
"""From this correlation on its number stands in the cell."""

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
            f"{len(names)} names came with a correlation of shape {correlation.shape}",
            needed="two names and more, and a row and a column for each",
        )
    rows, columns = np.tril_indices(len(names), k=-1)
    values = correlation[rows, columns]
    words = [
        f"{names[row]} and {names[column]}: {_number(value, '.2f')}"
        for row, column, value in zip(rows.tolist(), columns.tolist(), values.tolist(), strict=True)
    ]
    strong = np.abs(values) >= TOLD
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
        "text": [text(one) for one in words],
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
        return translucent(BESIDE, _FAINTEST)
    strength = max(_STRONGEST * min(abs(value), 1.0) ** 1.5, _FAINTEST)
    return translucent(MEASURED if value >= 0.0 else MODEL, round(strength, 3))


def _number(value: float, form: str) -> str:
    return f"{value:{form}}".replace("-", "−") if np.isfinite(value) else "unknown"
