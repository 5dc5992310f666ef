"""Where the responses of several inputs and outputs can be used: a table of bands as a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.figure import Figure, Trace, numbers, text
from rotorid.plot.quantity import quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, MEASURED
from rotorid.plot.view import Frequency, View

_ROW_PX, _BAR_PX = 36.0, 9.0
_BAR_BELOW, _WORDS_ABOVE = 0.16, 0.22
_ROOM_LEFT, _ROOM_RIGHT = 0.85, 1.5
_WORDS_SHARE = 0.12
"""About how much of the axis the numbers of one band take on a wide page."""

_NONE = "no usable band"


def coherence_map(
    usable: Mapping[tuple[str, str], Sequence[tuple[float, float]]],
    *,
    asked: tuple[float, float] | None = None,
    frequency: Frequency = "rad/s",
) -> Figure:
    """Usable bands of all responses: a panel for each output, a row for each input, bars over frequency.

    Parameters
    ----------
    usable
        ``(output, input)`` to bands ``(low, high)`` in rad/s in which the response is trusted, by its coherence for
        instance; an empty sequence says so in words. Of bands so close that their numbers would cover each other the
        widest gets its numbers, and all of them show theirs to who points at them.
    asked
        The band that was asked for, shaded.
    frequency
        Unit of the picture.

    Raises
    ------
    UsageError
        There is no pair, no band to fit the axis to, or a band that does not rise from a positive frequency.

    Examples
    --------
    >>> figure = coherence_map({("p", "roll_command"): [(1.5, 40.0)], ("p", "yaw_command"): []})
    >>> [(trace["x"][:2], trace.get("text")) for trace in figure["data"]]
    [([1.5, 40.0], None), ([1.5], ['1.5 – 40']), ([1.5], ['no usable band'])]
    """
    view = View(frequency=frequency)
    every = [*(span for spans in usable.values() for span in spans), *([asked] if asked else [])]
    if not every:
        raise UsageError("a map of usable bands came without any band", needed="one band, or the band asked for")
    for low, high in every:
        if not 0.0 < low < high:
            raise UsageError(f"the band {low:g} to {high:g} rad/s came", needed="0 < low < high")
    edges = np.array(every)
    low, high = view.across(np.array([edges.min(), edges.max()])).tolist()
    outputs = list(dict.fromkeys(output for output, _ in usable))
    room = _WORDS_SHARE * math.log(high * _ROOM_RIGHT / (low * _ROOM_LEFT))
    panels = [
        _panel(view, output, {u: spans for (y, u), spans in usable.items() if y == output}, low, room, asked)
        for output in outputs
    ]
    axis = {**view.axis(edges.ravel()), "range": [math.log10(low * _ROOM_LEFT), math.log10(high * _ROOM_RIGHT)]}
    return stacked(panels, x_axis=axis)


def _panel(
    view: View,
    output: str,
    rows: Mapping[str, Sequence[tuple[float, float]]],
    low: float,
    room: float,
    asked: tuple[float, float] | None,
) -> Panel:
    names = [text(quantity(input).words) for input in rows]
    # Numbers instead of categories, since the words stand a little above their bars; the first row belongs on top.
    places = list(range(len(names)))[::-1]
    traces: list[Trace] = []
    for name, place, spans in zip(names, places, rows.values(), strict=True):
        traces += _bars(view, name, place, spans, room) if spans else [_words([low], [_NONE], place, BESIDE)]
    axis: dict[str, Any] = {
        "tickvals": places,
        "ticktext": names,
        "range": [-0.5, len(names) - 0.5],
        "showgrid": False,
        "zeroline": False,
        "fixedrange": True,
    }
    shaded = view.bands([asked] if asked else [])
    return Panel(
        label=f"{quantity(output).words} over", traces=traces, height_px=_ROW_PX * len(names), axis=axis, shaded=shaded
    )


def _bars(view: View, name: str, place: int, spans: Sequence[tuple[float, float]], room: float) -> list[Trace]:
    """All bars of one row, lines of two points with a gap after each, and the numbers above where they start."""
    ends = [(float(low), float(high)) for low, high in view.bands(spans)]
    height = place - _BAR_BELOW
    bars: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": [end for low, high in ends for end in (*numbers(np.array([low, high])), None)],
        "y": [height, height, None] * len(ends),
        "line": {"color": MEASURED, "width": _BAR_PX},
        "hovertemplate": f"{name}: %{{x:.3~g}} {view.frequency}<extra></extra>",
        "showlegend": False,
    }
    told = _legible(ends, room)
    words = [f"{low:.3g} – {high:.3g}" for low, high in told]
    return [bars, _words([low for low, _ in told], words, place + _WORDS_ABOVE, None)]


def _legible(bands: Sequence[tuple[float, float]], room: float) -> list[tuple[float, float]]:
    """The bands whose numbers find room, the widest first; ``room`` is in the logarithm of frequency.

    Examples
    --------
    >>> _legible([(1.0, 1.1), (1.2, 4.0), (8.0, 9.0)], room=0.5)
    [(1.2, 4.0), (8.0, 9.0)]
    """
    told: list[tuple[float, float]] = []
    for band in sorted(bands, key=lambda ends: ends[0] / ends[1]):
        if all(abs(math.log(band[0] / other[0])) >= room for other in told):
            told.append(band)
    return sorted(told)


def _words(across: Sequence[float], words: Sequence[str], height: float, color: str | None) -> Trace:
    return {
        "type": "scatter",
        "mode": "text",
        "x": numbers(np.array(across)),
        "y": [height] * len(across),
        "text": list(words),
        "textposition": "middle right",
        "textfont": {"size": 11, **({"color": color} if color else {})},
        "hoverinfo": "skip",
        "showlegend": False,
    }
