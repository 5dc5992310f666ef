"""What a picture is, and how arrays become the numbers in it."""

from __future__ import annotations

import html
import itertools
import math
from typing import Any, TypeAlias

import numpy as np

from rotorid.typing import FloatArray

Trace: TypeAlias = dict[str, Any]

MOST_POINTS = 4000
"""Longer arrays are thinned for display: a screen has fewer columns than this."""


PLOTLY_JSON = "application/vnd.plotly.v1+json"


class Figure(dict[str, Any]):
    """A plotly figure as plain JSON: ``data`` and ``layout``.

    A notebook shows it where the front end draws plotly's JSON: VS Code and nteract do so by themselves, JupyterLab
    does with plotly's extension. Everywhere else ``plotly.graph_objects.Figure(figure)`` shows it.

    Examples
    --------
    >>> figure = Figure(data=[{"type": "scatter", "y": [1.0, 2.0]}], layout={})
    >>> sorted(figure._repr_mimebundle_())
    ['application/vnd.plotly.v1+json', 'text/plain']
    """

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, Any]:  # noqa: ARG002
        """What a notebook asks for; it chooses from the two itself."""
        said = f"Figure of {len(self['data'])} traces: plotly.graph_objects.Figure(figure) draws it."
        return {PLOTLY_JSON: dict(self), "text/plain": said}


def numbers(values: FloatArray, *, digits: int = 5) -> list[float | None]:
    """Values as JSON numbers with ``digits`` significant digits; what is not finite becomes a gap.

    Examples
    --------
    >>> numbers(np.array([3.14159265, np.nan, 1e-9]))
    [3.1416, None, 1e-09]
    """
    # Rounded before it is judged: the largest doubles round up to infinity.
    rounded = (float(f"{value:.{digits}g}") for value in values.tolist())
    return [value if math.isfinite(value) else None for value in rounded]


def stamps(time_s: FloatArray) -> list[float | None]:
    """Times as JSON numbers, to 0.1 ms: significant digits would coarsen late stamps of a long log."""
    return [round(value, 4) if math.isfinite(value) else None for value in time_s.tolist()]


def envelope(time: FloatArray, values: FloatArray, *, most: int = MOST_POINTS) -> tuple[FloatArray, FloatArray]:
    """Thin a long trace so that it looks the same: lowest and highest sample of each bucket, in their order.

    Display only; no number of a result comes from thinned data. Samples that are not finite are left out of a bucket
    that holds others.

    Parameters
    ----------
    time, values
        Shape ``(samples,)``.
    most
        Arrays up to this length come back unchanged.

    Examples
    --------
    >>> time, values = envelope(np.arange(100.0), np.eye(100)[42], most=10)
    >>> time.size, values.max()
    (10, np.float64(1.0))
    """
    if values.size <= most:
        return time, values
    edges = np.linspace(0, values.size, most // 2 + 1).astype(np.int64)
    low = np.where(np.isfinite(values), values, np.inf)
    high = np.where(np.isfinite(values), values, -np.inf)
    spans = itertools.pairwise(edges.tolist())
    extremes = [(lo + int(np.argmin(low[lo:hi])), lo + int(np.argmax(high[lo:hi]))) for lo, hi in spans]
    kept = np.sort(np.array(extremes), axis=1).ravel()
    return time[kept], values[kept]


def text(label: str) -> str:
    """A label that plotly shows as it stands: its pseudo-HTML would turn ``<a href=…>`` of a channel name into a link.

    Examples
    --------
    >>> text("<b>p</b>")
    '&lt;b&gt;p&lt;/b&gt;'
    """
    return html.escape(label, quote=False)
