"""Pictures for paper and slides, by matplotlib, from the same arrays as those for the screen.

A Bode plot, a whole log, a whole identification. Nothing else of the package imports matplotlib.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import least_coherence as coherence_needed
from rotorid.errors import UsageError
from rotorid.plot.curves import (
    SIGMAS,
    Frequency,
    Magnitude,
    View,
    decibels,
    reference_deg,
    runs,
    spanned,
    unwrapped_deg,
)
from rotorid.plot.figure import (
    INPUT,
    MEASURED,
    MODEL,
    SECONDARY,
    envelope,
    frequency_ticks,
    magnitude_label,
    magnitude_range_db,
    phase_step_deg,
    quantity,
)
from rotorid.plot.frequency import Curve, measured_curve, used_points
from rotorid.plot.inspection import BAR_COLORS, Bar, LogPicture, Trend
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.verification.verification import Verification

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

_PAPER_WIDTH_IN, _PAPER_HEIGHT_IN = 4.6, 5.6
PAPER_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#c4c9d0",
    "axes.labelcolor": "#59616b",
    "axes.grid": True,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "grid.color": "#e9ebee",
    "grid.linewidth": 0.7,
    "xtick.color": "#59616b",
    "ytick.color": "#59616b",
    "xtick.major.size": 0.0,
    "ytick.major.size": 0.0,
    "xtick.minor.size": 0.0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "#ffffff",
    # A channel name with a dollar sign is a name, not mathematics.
    "text.parse_math": False,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """What is drawn of one measured response.

    Parameters
    ----------
    view
        Units of the picture.
    measured
        The response on paper.
    coherence, used
        Its coherence, and which points are emphasized, each of shape ``(f,)``.
    least_coherence
        Guideline.
    """

    view: View
    measured: Curve
    coherence: FloatArray
    used: BoolArray
    least_coherence: float


def bode_figure(
    response: FrequencyResponse,
    *,
    output: str,
    input: str,
    model: ComplexArray | None = None,
    fitted: BoolArray | None = None,
    least_coherence: float | None = None,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Canvas:
    r"""Magnitude, phase and coherence of one response as a matplotlib figure: ``.savefig("roll.pdf")``.

    The arguments, bands and phase branches are those of ``rotorid.plot.frequency.bode``. The figure belongs to no
    window and to no global state.

    Parameters
    ----------
    response
        The response that was fitted.
    output, input
        Which of its pairs.
    model
        The model on the same grid, shape ``(y, u, f)``.
    fitted
        Points that entered the fit, shape ``(y, u, f)``; the others are gray. ``None`` takes those that can be trusted.
    least_coherence
        Coherence below which points were left out, drawn as a line; that of the kind of estimate by default.
    frequency, magnitude
        Units of the picture.

    Raises
    ------
    ValueError
        The response does not hold the pair.
    UsageError
        matplotlib is not installed, or a unit is unknown.

    Examples
    --------
    >>> omega, ones = np.geomspace(1.0, 10.0, 9), np.ones((1, 1, 9))
    >>> rate = FrequencyResponse(omega_rad_s=omega, values=10.0 / (1j * omega).reshape(1, 1, 9), coherence=ones,
    ...     random_error=0.01 * ones, covariance=np.zeros((1, 1, 9, 9), complex), inputs=("roll_command",),
    ...     outputs=("p",), estimate="direct")
    >>> [cell.get_ylabel() for cell in bode_figure(rate, output="p", input="roll_command").axes]
    ['magnitude [dB]', 'phase [°]', 'coherence']
    """
    view = View(frequency=frequency, magnitude=magnitude)
    mpl = matplotlib_or_remedy()
    row = response.pair(output, input)
    omega, values, coherence = response.omega_rad_s, response.values[row], response.coherence[row]
    least = coherence_needed(least_coherence, joint=response.estimate == "joint")
    used = used_points(response, row, fitted, least)
    exact = None if model is None else model[row]
    trusted = used & (coherence >= least)
    lean_deg = reference_deg(omega, values, trusted) if exact is None else unwrapped_deg(omega, exact)
    drawn = Drawn(
        view=view,
        measured=measured_curve(response, output=output, input=input, lean_deg=lean_deg),
        coherence=coherence,
        used=used,
        least_coherence=least,
    )
    words, _, unit = magnitude_label(output, input, in_db=magnitude == "dB", units=response.units).partition(" [")
    with mpl.rc_context(PAPER_STYLE):
        # The object instead of pyplot: no global state, no window system.
        canvas: Canvas = mpl.figure.Figure(figsize=(_PAPER_WIDTH_IN, _PAPER_HEIGHT_IN), layout="constrained")
        cells = list(canvas.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": [3.0, 2.2, 1.2]}))
        draw(cells, drawn, exact)
        cells[0].set_title(words.removeprefix("Magnitude of "), loc="left")
        for cell, label in zip(
            cells, (f"magnitude [{unit}" if unit else "magnitude", "phase [°]", "coherence"), strict=True
        ):
            cell.set_ylabel(label)
        canvas.align_ylabels(cells)
        handles, labels = cells[0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return canvas


def matplotlib_or_remedy(what: str = "this picture", *, instead: str = "") -> Any:
    """The module ``matplotlib`` with its figures, or an error that says how to get it.

    Parameters
    ----------
    what
        What is drawn, as the error names it.
    instead
        What the user may do without it.
    """
    try:
        import matplotlib as mpl
        import matplotlib.figure
    except ImportError as error:
        raise UsageError(
            f"{what} needs matplotlib, which is not installed",
            needed="the extra 'figures'",
            remedy=f"pip install 'rotorid[figures]'{instead}",
        ) from error
    return mpl


def draw(cells: Sequence[Axes], drawn: Drawn, model: ComplexArray | None) -> None:
    """Magnitude, phase and coherence into three axes, from top to bottom; the model has the shape ``(f,)``."""
    view, measured, used = drawn.view, drawn.measured, drawn.used
    omega, level, half = measured.omega_rad_s, measured.magnitude_db, measured.magnitude_error_db
    turn, sway = measured.phase_deg, measured.phase_error_deg
    across = view.across(omega)
    heights = (
        (cells[0], view.height(level), view.height(level - half), view.height(level + half)),
        (cells[1], turn, turn - sway, turn + sway),
    )
    for cell, middle, low, high in heights:
        for number, run in enumerate(runs(used)):
            label = f"± {SIGMAS:g} σ" if number == 0 else None
            cell.fill_between(across[run], low[run], high[run], label=label, color=MEASURED, alpha=0.2, linewidth=0.0)
        _dots(cell, across, middle, used, "measured")
    if model is not None:
        for cell, line in zip(cells, (view.height(decibels(np.abs(model))), unwrapped_deg(omega, model)), strict=False):
            inside = spanned(used)
            cell.semilogx(across, line, color=MODEL, linewidth=1.0, linestyle=":")
            cell.semilogx(across[inside], line[inside], color=MODEL, linewidth=1.6, label="model")
    _dots(cells[2], across, drawn.coherence, used, None)
    cells[2].axhline(drawn.least_coherence, color=SECONDARY, linewidth=0.9, linestyle=":")
    cells[2].set_ylim(0.0, 1.05)
    cells[2].set_xlabel(f"frequency [{view.frequency}]")
    _ticks(cells, across, view)


def _dots(cell: Axes, across: FloatArray, heights: FloatArray, used: BoolArray, label: str | None) -> None:
    cell.semilogx(across[used], heights[used], ".", color=MEASURED, markersize=4.5, label=label)
    cell.semilogx(across[~used], heights[~used], ".", color=SECONDARY, markersize=3.0, alpha=0.45)


def _ticks(cells: Sequence[Axes], across: FloatArray, view: View) -> None:
    from matplotlib.ticker import FixedLocator, MultipleLocator, NullLocator, StrMethodFormatter

    if view.magnitude == "linear":
        cells[0].set_ylim(bottom=0.0)
    elif narrow := magnitude_range_db(np.array(cells[0].get_ylim())):
        cells[0].set_ylim(narrow)
    cells[1].yaxis.set_major_locator(MultipleLocator(phase_step_deg(float(np.ptp(cells[1].get_ylim())))))
    cells[2].xaxis.set_major_locator(FixedLocator(frequency_ticks(across)))
    cells[2].xaxis.set_minor_locator(NullLocator())
    # Plain numbers: the powers of ten would be mathematics, which is switched off for the names.
    cells[2].xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


_LOG_WIDTH_IN, _ROW_IN, _TREND_IN, _MARGIN_IN = 11.0, 0.22, 0.85, 1.1
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
        raise UsageError("the log has no channel to draw", needed="a log with channels", remedy="name them with --map")
    mpl = matplotlib_or_remedy("a PNG", instead=", or write an .html")
    tables = [(label, bars) for label, bars in _tables(picture) if bars]
    heights = [_ROW_IN * len({bar.row for bar in bars}) + 0.15 for _, bars in tables]
    ratios = [*heights[:-1], *(_TREND_IN for _ in picture.trends), heights[-1]]
    with mpl.rc_context(_STYLE):
        # The object instead of pyplot: no global state, no window system.
        size = (_LOG_WIDTH_IN, sum(ratios) + _MARGIN_IN + 0.2 * len(ratios))
        canvas = mpl.figure.Figure(figsize=size, layout="constrained")
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
        canvas.savefig(buffer, format="png", dpi=dots_per_inch, metadata={"Software": "rotorid"})
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


_COLUMN_IN, _OVERVIEW_HEIGHT_IN = 4.2, 8.4
_BESIDE_IN, _BESIDE_WIDTH_IN, _BESIDE_HEIGHT_IN = 2.4, 3.5, 5.2


class Fitted(Protocol):
    """Data that a model was fitted to, as :class:`rotorid.results.model.FittedData` has them."""

    @property
    def response(self) -> FrequencyResponse: ...

    @property
    def model_response(self) -> ComplexArray | None: ...

    @property
    def used(self) -> BoolArray: ...

    @property
    def least_coherence(self) -> float: ...


class Unseen(Protocol):
    """Unseen maneuvers, as :class:`rotorid.results.model.Verifications` has them."""

    @property
    def maneuvers(self) -> Sequence[Verification]: ...


class Identified(Protocol):
    """What the picture needs of a model; :class:`rotorid.results.model.IdentifiedModel` has it."""

    @property
    def data(self) -> Fitted: ...

    @property
    def verifications(self) -> Unseen: ...


def overview_png(identifications: Sequence[Identified], *, dots_per_inch: int = 130) -> bytes:
    """A PNG with one column per identification: magnitude, phase, coherence, and a flight it had not seen.

    Of a model with several responses the one with most fitted points is shown, and the first verification of its
    output. Bands are ± 2 σ of the random error.

    Parameters
    ----------
    identifications
        At least one.
    dots_per_inch
        Resolution of the picture.

    Raises
    ------
    UsageError
        matplotlib is not installed, or there is nothing to draw.
    """
    if not identifications:
        raise UsageError("an overview of no identification was asked for", needed="at least one identification")
    mpl = matplotlib_or_remedy()
    columns = len(identifications)
    with mpl.rc_context(PAPER_STYLE):
        # The object instead of pyplot: no global state, no window system.
        canvas = mpl.figure.Figure(figsize=(_COLUMN_IN * columns + 0.4, _OVERVIEW_HEIGHT_IN), layout="constrained")
        grid = canvas.subplots(4, columns, squeeze=False, gridspec_kw={"height_ratios": [3.0, 2.2, 1.2, 2.4]})
        for column, identified in enumerate(identifications):
            _column(list(grid[:, column]), identified, first=column == 0)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="outside upper left", ncols=len(labels))
        buffer = io.BytesIO()
        canvas.savefig(buffer, format="png", dpi=dots_per_inch)
    return buffer.getvalue()


def _column(cells: Sequence[Axes], identified: Identified, *, first: bool) -> None:
    response = identified.data.response
    y, u = np.unravel_index(int(identified.data.used.sum(axis=2).argmax()), identified.data.used.shape[:2])
    output, input = response.outputs[y], response.inputs[u]
    for cell in cells[1:3]:
        cell.sharex(cells[0])
    _bode(cells[:3], identified.data, int(y), int(u))
    cells[0].set_title(f"{quantity(output).words}\nover {quantity(input).words}", loc="left")
    for cell in cells[:2]:
        cell.tick_params(labelbottom=False)
    check = next((check for check in identified.verifications.maneuvers if output in check.output_names), None)
    if check is None:
        cells[3].set_axis_off()
    else:
        _trace(cells[3], check, output)
    if first:
        for cell, label in zip(cells, ("magnitude [dB]", "phase [°]", "coherence"), strict=False):
            cell.set_ylabel(label)
        canvas = cells[0].get_figure()
        assert canvas is not None
        canvas.align_ylabels(list(cells))


def _bode(cells: Sequence[Axes], fitted: Fitted, y: int, u: int) -> None:
    response = fitted.response
    model = None if fitted.model_response is None else fitted.model_response[y, u]
    omega, used, coherence = response.omega_rad_s, fitted.used[y, u], response.coherence[y, u]
    if model is None:
        lean_deg = reference_deg(omega, response.values[y, u], used & (coherence >= fitted.least_coherence))
    else:
        lean_deg = unwrapped_deg(omega, model)
    drawn = Drawn(
        view=View(),
        measured=measured_curve(response, output=response.outputs[y], input=response.inputs[u], lean_deg=lean_deg),
        coherence=coherence,
        used=used,
        least_coherence=fitted.least_coherence,
    )
    draw(cells, drawn, model)


def side_by_side(fitted: Fitted, pairs: Sequence[tuple[str, str]]) -> Canvas:
    """Responses as papers show them: one column each, magnitude, phase and coherence below each other.

    Bands are ± 2 σ of the random error. Points that did not enter the fit are faded.

    Parameters
    ----------
    fitted
        Measured responses with what was used of them and, where there is one, the model.
    pairs
        Output and input of each column; three or four are readable over the width of a page.

    Raises
    ------
    UsageError
        matplotlib is not installed.
    ValueError
        A pair is not among the responses, or there is none.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> omega, ones = np.geomspace(1.0, 10.0, 9), np.ones((2, 1, 9))
    >>> both = FrequencyResponse(omega_rad_s=omega, values=ones * 10.0 / (1j * omega), coherence=ones,
    ...     random_error=0.01 * ones, covariance=np.zeros((2, 1, 9, 9), complex), inputs=("roll_command",),
    ...     outputs=("p", "ay"), estimate="direct")
    >>> fitted = SimpleNamespace(response=both, model_response=None, used=ones > 0.0, least_coherence=0.6)
    >>> canvas = side_by_side(fitted, [("p", "roll_command"), ("ay", "roll_command")])
    >>> len(canvas.axes)
    6
    """
    if not pairs:
        raise ValueError("no response was to be drawn")
    mpl = matplotlib_or_remedy()
    response = fitted.response
    with mpl.rc_context(PAPER_STYLE):
        # The object instead of pyplot: no global state, no window system.
        size = (max(_BESIDE_WIDTH_IN, _BESIDE_IN * len(pairs)), _BESIDE_HEIGHT_IN)
        canvas: Canvas = mpl.figure.Figure(figsize=size, layout="constrained")
        ratios = {"height_ratios": [3.0, 2.2, 1.2]}
        grid = canvas.subplots(3, len(pairs), squeeze=False, sharex="col", gridspec_kw=ratios)
        for column, (output, input) in enumerate(pairs):
            cells = list(grid[:, column])
            y, u = response.pair(output, input)
            _bode(cells, fitted, y, u)
            cells[0].set_title(f"{output} / {input}", loc="left", fontsize=9)
        for cell, label in zip(grid[:, 0], ("magnitude [dB]", "phase [°]", "coherence"), strict=True):
            cell.set_ylabel(label)
        canvas.align_ylabels(list(grid[:, 0]))
        handles, labels = grid[0, 0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="outside upper left", ncols=max(len(labels), 1))
    return canvas


def _trace(cell: Axes, check: Verification, output: str) -> None:
    row, paper = check.output_names.index(output), quantity(output)
    time_s = check.time_s - check.time_s[0]
    cell.plot(time_s, paper.factor * check.measured[row], color=MEASURED, linewidth=1.6, label="measured")
    cell.plot(time_s, paper.factor * check.predicted[row], color=MODEL, linewidth=1.4, linestyle=(0, (4, 2)))
    cell.set_xlabel("time into an unseen maneuver [s]")
    cell.set_ylabel(f"{output} [{paper.unit}]" if paper.unit else output)
