"""Pictures of a few lines beside a number: SVG that takes its colors from the page and needs no script.

All are 260 wide and 64 high in units of their own, and scale with the page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Literal

import numpy as np

from rotorid.typing import FloatArray

WIDTH, HEIGHT = 260.0, 64.0
_MOST_POINTS = 120
_LABEL = 44.0
"""Width of the names of rows."""


def _svg(description: str, body: str) -> str:
    box = f"0 0 {WIDTH:g} {HEIGHT:g}"
    return f'<svg class="mini" role="img" aria-label="{escape(description)}" viewBox="{box}">{body}</svg>'


def _line(x: Sequence[float] | FloatArray, y: Sequence[float] | FloatArray, style: str) -> str:
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline class="{style}" points="{points}"/>'


def _text(x: float, y: float, words: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(words)}</text>'


def curves(drawn: Mapping[str, tuple[FloatArray, FloatArray]], *, description: str, level: float | None = None) -> str:
    """Lines that share both axes, over a dashed level.

    Parameters
    ----------
    drawn
        Name to abscissas and ordinates, both of shape ``(n,)``.
    description
        What the picture shows, for those who cannot see it.
    level
        Ordinate of the dashed line.
    """
    finite = {
        name: (x[kept], y[kept]) for name, (x, y) in drawn.items() if (kept := np.isfinite(x) & np.isfinite(y)).any()
    }
    if not finite:
        return ""
    across = np.concatenate([x for x, _ in finite.values()])
    heights = np.concatenate([y for _, y in finite.values()] + ([] if level is None else [np.array([level])]))
    left, wide = float(across.min()), max(float(np.ptp(across)), 1e-12)
    low, tall = float(heights.min()), max(float(np.ptp(heights)), 1e-12)

    def down(y: FloatArray | float) -> FloatArray:
        return np.asarray(HEIGHT - 16.0 - (HEIGHT - 22.0) * (np.asarray(y) - low) / tall)

    parts = []
    if level is not None:
        parts.append(_line([0.0, WIDTH], [float(down(level))] * 2, "limit"))
    for number, (name, (x, y)) in enumerate(finite.items()):
        kept = np.unique(np.linspace(0, x.size - 1, min(x.size, _MOST_POINTS)).astype(int))
        parts.append(_line(WIDTH * (x[kept] - left) / wide, down(y[kept]), f"line-{number % 2 + 1}"))
        parts.append(f'<g class="line-{number % 2 + 1}">{_text(96.0 * number, HEIGHT - 2.0, name)}</g>')
    return _svg(description, "".join(parts))


def intervals(
    rows: Mapping[str, tuple[float, float, float]], *, limit: float, good: Literal["above", "below"], description: str
) -> str:
    """Numbers with their intervals, one below the other, over the side of a limit that is good.

    Parameters
    ----------
    rows
        Name to value and both ends of its interval; the first three are drawn.
    limit
        In the unit of the numbers.
    good
        Which side of the limit is good.
    description
        What the picture shows, for those who cannot see it.
    """
    shown = dict(list(rows.items())[:3])
    if not shown:
        return ""
    ends = [end for row in shown.values() for end in row if math.isfinite(end)]
    low, high = min(0.0, *ends), max(*ends, 1.5 * limit)

    def across(value: float) -> float:
        inside = min(max(value, low), high)
        return _LABEL + (WIDTH - _LABEL - 6.0) * (inside - low) / max(high - low, 1e-12)

    at = across(limit)
    start, stop = (at, WIDTH) if good == "above" else (_LABEL, at)
    parts = [f'<rect class="fine" x="{start:.1f}" y="2" width="{stop - start:.1f}" height="{HEIGHT - 4.0:g}"/>']
    for number, (name, (value, lower, upper)) in enumerate(shown.items()):
        y = HEIGHT * (number + 1.0) / (len(shown) + 1.0)
        parts.append(_text(0.0, y + 4.0, name))
        parts.append(_line([across(lower), across(upper)], [y, y], "line-1"))
        parts.append(f'<circle class="dot" cx="{across(value):.1f}" cy="{y:.1f}" r="4"/>')
    return _svg(description, "".join(parts))


def bars(values: Sequence[float], *, description: str) -> str:
    """Bars from 0 to 1 side by side, over their dashed mean.

    Parameters
    ----------
    values
        Heights, in the order of the bars; each carries its number, from 1.
    description
        What the picture shows, for those who cannot see it.
    """
    if not values:
        return ""
    step, most = WIDTH / len(values), HEIGHT - 18.0
    parts = []
    for number, value in enumerate(values):
        height = most * min(max(value, 0.0), 1.0)
        left = step * (number + 0.15)
        parts.append(
            f'<rect class="bar" x="{left:.1f}" y="{most - height + 2.0:.1f}" width="{0.7 * step:.1f}" '
            f'height="{height:.1f}"/>{_text(step * (number + 0.5), HEIGHT - 2.0, str(number + 1), "middle")}'
        )
    mean = most - most * float(np.mean(values)) + 2.0
    return _svg(description, "".join([*parts, _line([0.0, WIDTH], [mean, mean], "limit")]))


def marks(states: Mapping[str, str], *, description: str) -> str:
    """A mark for each name in the color of its state, with the name beside it.

    Parameters
    ----------
    states
        Name to ``good``, ``fair``, ``poor`` or ``unknown``.
    description
        What the picture shows, for those who cannot see it.
    """
    if not states:
        return ""
    rows = -(-len(states) // 2)
    parts = []
    for number, (name, state) in enumerate(states.items()):
        x = 0.5 * WIDTH * (number // rows)
        y = HEIGHT * (number % rows + 0.5) / rows
        parts.append(f'<circle class="{escape(state)}" cx="{x + 6.0:.1f}" cy="{y:.1f}" r="4"/>')
        parts.append(_text(x + 16.0, y + 4.0, name))
    return _svg(description, "".join(parts))
