"""Small drawings of test inputs, as SVG inside a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.flight_plan import PlannedInput
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from markupsafe import Markup

_WIDTH, _HEIGHT = 300.0, 54.0
_COLUMNS = 300
_SAMPLES = 32
"""Columns of the drawing, and samples in each: an oscillation faster than a column is drawn as the area it fills."""

# Attributes and not classes: what makes PDF of the page applies its style sheet to HTML only.
_INPUT = 'fill="#000" stroke="#000" stroke-width="1.3" stroke-linejoin="round"'
_ZERO = 'fill="none" stroke="#999" stroke-width="0.8"'


def input_picture(
    strips: Sequence[Sequence[PlannedInput]], edges_s: tuple[float, float], *, description: str
) -> Markup:
    """Test inputs over time, in strips with the same time, each with its own height.

    Parameters
    ----------
    strips
        The inputs of each strip, at least one.
    edges_s
        Time at the left and the right edge, on the clock of the plan.
    description
        What it shows, for those who cannot see it.
    """
    from markupsafe import Markup, escape

    strip = _HEIGHT / len(strips)
    lines = [
        _path(planned, edges_s, center=(index + 0.5) * strip, reach=0.44 * strip)
        for index, planned in enumerate(strips)
    ]
    return Markup(
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(description)}">{"".join(lines)}</svg>'
    )


def _path(inputs: Sequence[PlannedInput], edges_s: tuple[float, float], *, center: float, reach: float) -> str:
    time_s = np.linspace(*edges_s, _COLUMNS * _SAMPLES + 1)
    values = np.sum([planned.at(time_s) for planned in inputs], axis=0)
    values /= max(float(np.abs(planned.values).max()) for planned in inputs)
    points = [f"{x:.1f},{center - reach * y:.2f}" for x, y in _outline(values).tolist()]
    zero = f'<path d="M0,{center:g} H{_WIDTH:g}" {_ZERO}/>'
    return f'{zero}<path d="M{" L".join(points)} Z" {_INPUT}/>'


def _outline(values: FloatArray) -> FloatArray:
    """The highest values of the columns from left to right, then the lowest back again, shape ``(points, 2)``.

    Columns share their borders, so that a slow curve closes to a line.
    """
    borders = values[::_SAMPLES]
    columns = values[:-1].reshape(_COLUMNS, _SAMPLES)
    highest = np.maximum(columns.max(axis=1), borders[1:])
    lowest = np.minimum(columns.min(axis=1), borders[1:])
    across = (np.arange(_COLUMNS) + 0.5) * (_WIDTH / _COLUMNS)
    outline: FloatArray = np.column_stack(
        [np.concatenate([across, across[::-1]]), np.concatenate([highest, lowest[::-1]])]
    )
    return outline
