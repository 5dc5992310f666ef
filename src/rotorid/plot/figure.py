"""What a picture is: panels above each other on one horizontal axis, arrays as numbers, colors, ticks and labels.

The trace colors follow Okabe and Ito (*Color Universal Design*, 2008), shifted until each has a contrast of at least
3 : 1 on white and on near-black, so that one figure serves light and dark pages; only the template changes. Labels
carry channel names in a reader's words, and the units of paper: degrees instead of radians.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, TypeAlias

import numpy as np

from rotorid.data.display import CHANNEL_WORDS, counted
from rotorid.data.record import STANDARD_UNITS
from rotorid.typing import FloatArray, IntArray

Trace: TypeAlias = dict[str, Any]

MOST_POINTS = 4000
"""Longer arrays are thinned for display: a screen has fewer columns than this."""

PLOTLY_JSON = "application/vnd.plotly.v1+json"

_PAGE = """<!DOCTYPE html><meta charset="utf-8"><body style="margin:0;background:#fff"><div id="picture"></div><script>
(async () => {
  const packed = Uint8Array.from(atob("%s"), (letter) => letter.charCodeAt(0));
  const script = document.createElement("script");
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  script.textContent = await new Response(unpacked).text();
  document.head.append(script);
  const { data, layout } = %s;
  Plotly.newPlot("picture", data, layout, { responsive: true, displaylogo: false });
})();
</script></body>"""
_FRAME = '<iframe srcdoc="%s" style="width:100%%;height:%dpx;border:0"></iframe>'


class Figure(dict[str, Any]):
    """A plotly figure as plain JSON: ``data`` and ``layout``.

    A notebook shows it as a picture, without a network and without plotly being installed: front ends that draw
    plotly's JSON by themselves take that, all others a page of its own.
    ``Path("roll.html").write_text(figure.to_html())`` keeps it, and ``plotly.graph_objects.Figure(figure)`` takes it
    for more.

    Examples
    --------
    >>> figure = Figure(data=[{"type": "scatter", "y": [1.0, 2.0]}], layout={})
    >>> sorted(figure._repr_mimebundle_())
    ['application/vnd.plotly.v1+json', 'text/html', 'text/plain']
    >>> figure
    Figure of 1 trace
    """

    def to_html(self) -> str:
        """A page that draws it, in one file that asks the network for nothing."""
        # A name in a label must not end the script.
        return _PAGE % (_packed_plotly(), json.dumps(self).replace("<", "\\u003c"))

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, Any]:  # noqa: ARG002
        """What a notebook asks for; it chooses from the three itself."""
        height = self.get("layout", {}).get("height", 450) + 16
        return {
            PLOTLY_JSON: dict(self),
            "text/html": _FRAME % (html.escape(self.to_html()), height),
            "text/plain": repr(self),
        }

    def __repr__(self) -> str:
        count = len(self.get("data", ()))
        return f"Figure of {counted(count, 'trace')}"


def plotly_script() -> str:
    """The plotly that ships with the package, for pages that draw figures without a network."""
    return files("rotorid.plot").joinpath("vendor/plotly-basic.min.js").read_text(encoding="utf-8")


@cache
def _packed_plotly() -> str:
    return base64.b64encode(gzip.compress(plotly_script().encode(), mtime=0)).decode()


def numbers(values: FloatArray) -> list[float | None]:
    """Values as JSON numbers with five significant digits; what is not finite becomes a gap.

    Examples
    --------
    >>> numbers(np.array([3.14159265, np.nan, 1e-9]))
    [3.1416, None, 1e-09]
    """
    if values.size > _LARGEST_KEPT:
        return _significant(values)
    return list(_kept_significant(np.asarray(values, dtype=np.float64).tobytes()))


_LARGEST_KEPT = 512


# One picture draws a grid of frequencies with each of its curves, and most of them again in its other units.
@lru_cache(maxsize=256)
def _kept_significant(values: bytes) -> tuple[float | None, ...]:
    return tuple(_significant(np.frombuffer(values)))


def _significant(values: FloatArray) -> list[float | None]:
    # Rounded before it is judged: the largest doubles round up to infinity.
    return _finite(_rounded(values, "%.5g"))


def stamps(time_s: FloatArray) -> list[float | None]:
    """Times as JSON numbers, to 0.1 ms: significant digits would coarsen late stamps of a long log."""
    return _finite(_rounded(time_s, "%.4f"))


def _rounded(values: FloatArray, form: str) -> list[float]:
    # One text of all of them: a page holds hundreds of thousands of numbers.
    written = f"{form} " * values.size % tuple(values.tolist())
    return [float(number) for number in written.split()]


def _finite(rounded: list[float]) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in rounded]


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
    finite = np.isfinite(values)
    lowest, highest = (_first_lowest(np.where(finite, side, np.inf), edges) for side in (values, -values))
    kept = np.sort(np.stack([lowest, highest], axis=1), axis=1).ravel()
    return time[kept], values[kept]


def _first_lowest(values: FloatArray, edges: IntArray) -> IntArray:
    """Index of the first lowest sample of each bucket, for all buckets in one sweep."""
    lowest = np.minimum.reduceat(values, edges[:-1])
    at = np.flatnonzero(values == np.repeat(lowest, np.diff(edges)))
    return np.asarray(at[np.searchsorted(at, edges[:-1])])


def text(label: str) -> str:
    """A label that plotly shows as it stands: its pseudo-HTML would turn ``<a href=…>`` of a channel name into a link.

    Examples
    --------
    >>> text("<b>p</b>")
    '&lt;b&gt;p&lt;/b&gt;'
    """
    return html.escape(label, quote=False)


MEASURED = "#2b7fc0"
MODEL = "#d55e00"
INPUT = "#0b8f6d"
SECONDARY = "#8a8f98"
SHADE = "rgba(213, 94, 0, 0.10)"

SERIES = (MEASURED, MODEL, INPUT, "#bf3993", "#8c624d", "#8149f2")
"""Colors of curves of equal rank, apart even for eyes that lack a kind of cone; dashes and symbols differ too."""

DASHES = ("solid", "7 3", "2 2", "9 3 2 3", "4 2", "12 3")
SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "cross")

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def translucent(color: str, opacity: float) -> str:
    """A color of this theme with an opacity, for bands and areas.

    Examples
    --------
    >>> translucent("#2b7fc0", 0.2)
    'rgba(43, 127, 192, 0.2)'
    """
    red, green, blue = (int(color[at : at + 2], 16) for at in (1, 3, 5))
    return f"rgba({red}, {green}, {blue}, {opacity:g})"


def template(*, dark: bool = False) -> dict[str, Any]:
    """The plotly template of light or dark pages; backgrounds are transparent, the page paints them."""
    ink, quiet, grid, panel = (
        ("#d7dae0", "#a3a9b4", "#2a2f37", "#20242b") if dark else ("#24292f", "#59616b", "#e4e7eb", "#ffffff")
    )
    axis = {
        "gridcolor": grid,
        "linecolor": grid,
        "zerolinecolor": grid,
        "zerolinewidth": 1,
        "tickcolor": grid,
        "tickfont": {"color": quiet, "size": 11},
        "title": {"font": {"color": quiet, "size": 12}},
        "automargin": True,
    }
    return {
        "layout": {
            "font": {"family": FONT, "color": ink, "size": 12},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "colorway": [MEASURED, MODEL, INPUT, SECONDARY],
            "xaxis": axis,
            "yaxis": axis,
            "hoverlabel": {"bgcolor": panel, "bordercolor": grid, "font": {"family": FONT, "color": ink, "size": 12}},
            "modebar": {"color": quiet, "activecolor": ink, "bgcolor": "rgba(0,0,0,0)"},
            "legend": {"bgcolor": "rgba(0,0,0,0)"},
        }
    }


_GAP_PX = 34.0
_LEAST_SPAN = 1e-3
"""Of a vertical axis, as a share of what is drawn: what differs by less is called the same."""
_ROUNDING = 1e-9
"""What is smaller all over, in the unit of its axis, is the rounding of a computer."""
# The tools of the page stand in the corner above the legend.
_TOP_PX, _BOTTOM_PX = 72.0, 46.0
_LEGEND_PX, _LEGEND_ROW_PX, _SYMBOL_PX, _LETTER_PX = 860.0, 30.0, 45.0, 6.5


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One panel of a picture.

    Parameters
    ----------
    label
        Written above the panel.
    traces
        Plotly traces, without their axes.
    height_px
        Height of the drawing area.
    axis
        What the vertical axis needs beyond the theme.
    shaded
        Intervals of the horizontal axis to shade.
    level
        A guideline to draw across, in units of the vertical axis.
    """

    label: str
    traces: Sequence[Trace]
    height_px: float
    axis: Mapping[str, Any] = field(default_factory=dict)
    shaded: Sequence[tuple[float, float]] = ()
    level: float | None = None


def stacked(panels: Sequence[Panel], *, x_axis: Mapping[str, Any]) -> Figure:
    """One figure with the panels from top to bottom, sharing a horizontal axis and one legend.

    Parameters
    ----------
    panels
        From top to bottom.
    x_axis
        Title and kind of the shared axis.
    """
    inner = sum(panel.height_px for panel in panels) + _GAP_PX * (len(panels) - 1)
    traces: list[Trace] = []
    shapes: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    over = _TOP_PX + _LEGEND_ROW_PX * (_legend_rows(panels) - 1)
    layout: dict[str, Any] = {
        "template": template(),
        "height": round(inner + over + _BOTTOM_PX),
        "margin": {"l": 56, "r": 16, "t": over, "b": _BOTTOM_PX},
        "legend": {
            "orientation": "h",
            "x": 0,
            "xanchor": "left",
            "y": 1 + 22 / inner,
            "yanchor": "bottom",
            # A curve that the reader hid stays hidden when the figure is drawn again in other units or colors.
            "uirevision": "kept",
        },
        "hovermode": "closest",
        "annotations": annotations,
        "shapes": shapes,
    }
    axis, top = "y", 1.0
    for number, panel in enumerate(panels, start=1):
        axis = "y" if number == 1 else f"y{number}"
        bottom = max(top - panel.height_px / inner, 0.0)
        own = {"domain": [round(bottom, 5), round(top, 5)], "anchor": "x"}
        layout[f"yaxis{axis[1:]}"] = {**own, **_least_span(panel), **panel.axis}
        annotations.append(_label(panel.label, top))
        traces += [{**trace, "xaxis": "x", "yaxis": axis} for trace in panel.traces]
        shapes += _shapes(panel, axis)
        top = bottom - _GAP_PX / inner
    layout["xaxis"] = {"anchor": axis, "domain": [0, 1], **x_axis}
    return Figure(data=traces, layout=layout)


def _least_span(panel: Panel) -> dict[str, Any]:
    """What keeps an axis from being spanned by the rounding of a computer, where values hardly differ."""
    if panel.axis.get("type") == "log" or "range" in panel.axis:
        return {}
    values = np.array([y for trace in panel.traces for y in trace.get("y") or () if isinstance(y, int | float)])
    if not values.size:
        return {}
    low, high = float(values.min()), float(values.max())
    least = max(_ROUNDING, _LEAST_SPAN * max(abs(low), abs(high)))
    if high - low >= least:
        return {}
    middle = 0.5 * (low + high)
    return {"autorangeoptions": {"include": [middle - 0.5 * least, middle + 0.5 * least]}}


def _legend_rows(panels: Sequence[Panel]) -> int:
    """About how many rows the legend takes on a wide page, so that its first stays clear of the page's tools."""
    names = [trace["name"] for panel in panels for trace in panel.traces if trace.get("showlegend")]
    return max(1, math.ceil(sum(_SYMBOL_PX + _LETTER_PX * len(name) for name in names) / _LEGEND_PX))


def _shapes(panel: Panel, axis: str) -> list[dict[str, Any]]:
    quiet = {"layer": "below", "line": {"width": 0}, "fillcolor": SHADE}
    shapes: list[dict[str, Any]] = [
        {"type": "rect", "x0": start, "x1": stop, "yref": f"{axis} domain", "y0": 0, "y1": 1, **quiet}
        for start, stop in panel.shaded
    ]
    if panel.level is not None:
        line = {"color": SECONDARY, "width": 1, "dash": "dot"}
        shapes.append(
            {
                "type": "line",
                "xref": "paper",
                "x0": 0,
                "x1": 1,
                "yref": axis,
                "line": line,
                "y0": panel.level,
                "y1": panel.level,
            }
        )
    return shapes


def _label(label: str, top: float) -> dict[str, Any]:
    # A line above each panel reads better than turned text, and fits panels of any height.
    return {
        "text": text(label),
        "xref": "paper",
        "yref": "paper",
        "x": 0,
        "y": round(top, 5),
        "xanchor": "left",
        "yanchor": "bottom",
        "yshift": 3,
        "showarrow": False,
        "font": {"size": 12},
    }


NARROWEST_DB = 10.0
"""A magnitude axis spans at least this much, so that a flat response looks flat."""

_WIDE_DECADES = 1.3
_PHASE_STEPS_DEG = ((60.0, 15), (130.0, 30), (300.0, 45), (600.0, 90), (1200.0, 180))
_LONGEST_STEP_DEG = 360


def frequency_ticks(omega_rad_s: FloatArray) -> list[float]:
    """Round frequencies around a grid: 1, 2, 5 of each decade, and more where the grid spans little over one.

    Examples
    --------
    >>> frequency_ticks(np.array([1.0, 100.0]))
    [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
    """
    low, high = float(omega_rad_s.min()), float(omega_rad_s.max())
    steps = (1.0, 2.0, 5.0) if high > low * 10.0**_WIDE_DECADES else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [float(f"{step * 10.0**power:.2g}") for power in powers for step in steps]
    return [tick for tick in ticks if 0.8 * low <= tick <= 1.25 * high]


def phase_step_deg(span_deg: float) -> int:
    """Distance of phase ticks: parts or multiples of a right angle, four to seven of them.

    Examples
    --------
    >>> phase_step_deg(80.0), phase_step_deg(400.0)
    (30, 90)
    """
    return next((step for limit, step in _PHASE_STEPS_DEG if span_deg < limit), _LONGEST_STEP_DEG)


def magnitude_range_db(shown_db: FloatArray) -> tuple[float, float] | None:
    """Range of a magnitude axis whose data span too little to fill it, otherwise ``None``.

    Examples
    --------
    >>> magnitude_range_db(np.array([22.0, 23.0, np.nan]))
    (17.5, 27.5)
    """
    finite = shown_db[np.isfinite(shown_db)]
    if not finite.size or np.ptp(finite) >= NARROWEST_DB:
        return None
    middle = float(finite.min() + finite.max()) / 2.0
    return middle - NARROWEST_DB / 2.0, middle + NARROWEST_DB / 2.0


_WHOLE = {
    "p_dot": "roll acceleration",
    "q_dot": "pitch acceleration",
    "r_dot": "yaw acceleration",
    "velocity_forward_dot": "forward acceleration",
    "velocity_right_dot": "acceleration to the right",
}

_SUFFIXES = {"_setpoint": "setpoint", "_dot": "derivative"}

_DEGREES = 180.0 / math.pi

_PAPER = {
    "rad": ("°", _DEGREES),
    "rad/s": ("°/s", _DEGREES),
    "rad/s^2": ("°/s²", _DEGREES),
    "m/s^2": ("m/s²", 1.0),
    "1": ("", 1.0),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Quantity:
    """How a channel is written on paper.

    Parameters
    ----------
    words
        ``roll rate p``.
    unit
        Unit of paper, empty for a plain number.
    factor
        ``value_on_paper = factor * value_si``.
    """

    words: str
    unit: str
    factor: float

    @property
    def label(self) -> str:
        return f"{self.words} [{self.unit}]" if self.unit else self.words


def quantity(name: str) -> Quantity:
    """Words, unit and factor of a channel; a name outside the vocabulary is shown as it stands, without a unit.

    Examples
    --------
    >>> quantity("p").label, quantity("pitch_command").label
    ('roll rate p [°/s]', 'pitch command')
    """
    unit = STANDARD_UNITS.get(name)
    if unit is None:
        return Quantity(words=name, unit="", factor=1.0)
    paper, factor = _PAPER.get(unit, (unit, 1.0))
    return Quantity(words=_words(name), unit=paper, factor=factor)


def magnitude_label(output: str, input: str, *, in_db: bool, units: Mapping[str, str] | None = None) -> str:
    """What the magnitude axis of a response ``output/input`` shows, in decibels or in SI units.

    ``units`` are those of channels that the log has in another one than the vocabulary.

    Examples
    --------
    >>> magnitude_label("p", "roll_command", in_db=True)
    'Magnitude of roll rate p over roll command [dB]'
    >>> magnitude_label("u", "theta", in_db=False)
    'Magnitude of forward speed u over pitch angle theta [(m/s)/rad]'
    >>> magnitude_label("phi", "motor_3", in_db=False, units={"motor_3": "V"})
    'Magnitude of roll angle phi over motor 3 [rad/V]'
    """
    known = {**STANDARD_UNITS, **(units or {})}
    above, below = known.get(output, ""), known.get(input, "")
    # A factor between equal or unknown units carries none.
    if above == below or "" in (above, below):
        plain = ""
    elif below == "1":
        plain = above
    else:
        plain = f"{f'({above})' if '/' in above else above}/{f'({below})' if '/' in below else below}"
    unit = "dB" if in_db else plain
    words = f"Magnitude of {quantity(output).words} over {quantity(input).words}"
    return f"{words} [{unit}]" if unit else words


def _words(name: str) -> str:
    if name in _WHOLE:
        return _WHOLE[name]
    for suffix, word in _SUFFIXES.items():
        symbol = name.removesuffix(suffix)
        if symbol != name and symbol in CHANNEL_WORDS:
            return f"{CHANNEL_WORDS[symbol]} {word}"
    return f"{CHANNEL_WORDS[name]} {name}" if name in CHANNEL_WORDS else name.replace("_", " ")
