"""The Bode plot for a paper: matplotlib, from the same arrays as the one for the screen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.plot.bode import COHERENCE_GUIDELINE, Curve, measured_curve
from rotorid.plot.curves import SIGMAS, runs
from rotorid.plot.phase import reference_deg, unwrapped_deg
from rotorid.plot.quantity import magnitude_label
from rotorid.plot.theme import BESIDE, MEASURED, MODEL
from rotorid.plot.ticks import frequency_ticks, magnitude_range_db, phase_step_deg
from rotorid.plot.view import Frequency, Magnitude, View, decibels
from rotorid.typing import BoolArray, ComplexArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

_WIDTH_IN, _HEIGHT_IN = 4.6, 5.6
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
    least_coherence: float = COHERENCE_GUIDELINE,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Canvas:
    r"""Magnitude, phase and coherence of one response as a matplotlib figure: ``.savefig("roll.pdf")``.

    The arguments, bands and phase branches are those of ``rotorid.plot.bode.bode``. The figure belongs to no window
    and to no global state.

    Parameters
    ----------
    response
        The response that was fitted.
    output, input
        Which of its pairs.
    model
        The model on the same grid, shape ``(y, u, f)``.
    fitted
        Points that entered the fit, shape ``(y, u, f)``; the others are faded. ``None`` emphasizes all.
    least_coherence
        Coherence below which points were left out, drawn as a line.
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
    used = np.isfinite(values) if fitted is None else fitted[row] & np.isfinite(values)
    exact = None if model is None else model[row]
    trusted = used & (coherence >= least_coherence)
    lean_deg = reference_deg(omega, values, trusted) if exact is None else unwrapped_deg(omega, exact)
    drawn = Drawn(
        view=view,
        measured=measured_curve(response, output=output, input=input, lean_deg=lean_deg),
        coherence=coherence,
        used=used,
        least_coherence=least_coherence,
    )
    words, _, unit = magnitude_label(output, input, in_db=magnitude == "dB").partition(" [")
    with mpl.rc_context(PAPER_STYLE):
        # The object instead of pyplot: no global state, no window system.
        canvas: Canvas = mpl.figure.Figure(figsize=(_WIDTH_IN, _HEIGHT_IN), layout="constrained")
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


def matplotlib_or_remedy() -> Any:
    """The module ``matplotlib`` with its figures, or an error that says how to get it."""
    try:
        import matplotlib as mpl
        import matplotlib.figure
    except ImportError as error:
        raise UsageError(
            "this picture needs matplotlib, which is not installed",
            needed="the extra 'figures'",
            remedy="pip install 'rotorid[figures]'",
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
            cell.semilogx(across, line, color=MODEL, linewidth=1.6, label="model")
    _dots(cells[2], across, drawn.coherence, used, None)
    cells[2].axhline(drawn.least_coherence, color=BESIDE, linewidth=0.9, linestyle=":")
    cells[2].set_ylim(0.0, 1.05)
    cells[2].set_xlabel(f"frequency [{view.frequency}]")
    _ticks(cells, across, view)


def _dots(cell: Axes, across: FloatArray, heights: FloatArray, used: BoolArray, label: str | None) -> None:
    cell.semilogx(across[used], heights[used], ".", color=MEASURED, markersize=4.5, label=label)
    cell.semilogx(across[~used], heights[~used], ".", color=MEASURED, markersize=3.0, alpha=0.3)


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
