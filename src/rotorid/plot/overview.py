"""One picture of a whole identification, for a README or a slide."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.plot.bode import SIGMAS, measured_curve, runs
from rotorid.plot.phase import unwrapped_deg
from rotorid.plot.quantity import quantity
from rotorid.plot.theme import BESIDE, MEASURED, MODEL
from rotorid.plot.ticks import frequency_ticks, magnitude_range_db, phase_step_deg
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.verify.verification import Verification

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLUMN_IN, _HEIGHT_IN = 4.2, 8.4
_STYLE: dict[Any, Any] = {
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


class Identified(Protocol):
    """What the picture needs of an identification; ``rotorid.pipeline.identification.Identification`` has it."""

    @property
    def response(self) -> FrequencyResponse: ...

    @property
    def model_response(self) -> ComplexArray: ...

    @property
    def fitted(self) -> BoolArray: ...

    @property
    def verifications(self) -> Sequence[Verification]: ...

    @property
    def least_coherence(self) -> float: ...


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
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure as Canvas
    except ImportError as error:
        raise UsageError(
            "the overview picture needs matplotlib, which is not installed",
            needed="the extra 'figures'",
            remedy="pip install 'rotorid[figures]'",
        ) from error
    columns = len(identifications)
    with mpl.rc_context(_STYLE):
        # The object instead of pyplot: no global state, no window system.
        canvas = Canvas(figsize=(_COLUMN_IN * columns + 0.4, _HEIGHT_IN), layout="constrained")
        grid = canvas.subplots(4, columns, squeeze=False, gridspec_kw={"height_ratios": [3.0, 2.2, 1.2, 2.4]})
        for column, identified in enumerate(identifications):
            _column(list(grid[:, column]), identified, first=column == 0)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="outside upper left", ncols=len(labels))
        buffer = io.BytesIO()
        canvas.savefig(buffer, format="png", dpi=dots_per_inch)
    return buffer.getvalue()


def _column(cells: Sequence[Axes], identified: Identified, *, first: bool) -> None:
    response = identified.response
    y, u = np.unravel_index(int(identified.fitted.sum(axis=2).argmax()), identified.fitted.shape[:2])
    output, input = response.outputs[y], response.inputs[u]
    for cell in cells[1:3]:
        cell.sharex(cells[0])
    _bode(cells[:3], identified, int(y), int(u))
    cells[0].set_title(f"{quantity(output).words}\nover {quantity(input).words}", loc="left")
    for cell in cells[:2]:
        cell.tick_params(labelbottom=False)
    check = next((check for check in identified.verifications if output in check.output_names), None)
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


def _bode(cells: Sequence[Axes], identified: Identified, y: int, u: int) -> None:
    response, used = identified.response, identified.fitted[y, u]
    omega, coherence, model = response.omega_rad_s, response.coherence[y, u], identified.model_response[y, u]
    exact_deg = unwrapped_deg(model)
    output, input = response.outputs[y], response.inputs[u]
    measured = measured_curve(response, output=output, input=input, lean_deg=exact_deg)
    with np.errstate(divide="ignore"):
        exact_db = 20.0 * np.log10(np.abs(model))
    drawn = (
        (cells[0], measured.magnitude_db, measured.magnitude_error_db, exact_db),
        (cells[1], measured.phase_deg, measured.phase_error_deg, exact_deg),
    )
    for cell, points, error, exact in drawn:
        for number, run in enumerate(runs(used)):
            low, high = (points - error)[run], (points + error)[run]
            label = f"± {SIGMAS:g} σ" if number == 0 else None
            cell.fill_between(omega[run], low, high, label=label, color=MEASURED, alpha=0.2, linewidth=0.0)
        cell.semilogx(omega[used], points[used], ".", color=MEASURED, markersize=4.5, label="measured")
        cell.semilogx(omega[~used], points[~used], ".", color=MEASURED, markersize=3.0, alpha=0.3)
        cell.semilogx(omega, exact, color=MODEL, linewidth=1.6, label="model")
    cells[2].semilogx(omega[used], coherence[used], ".", color=MEASURED, markersize=4.5)
    cells[2].semilogx(omega[~used], coherence[~used], ".", color=MEASURED, markersize=3.0, alpha=0.3)
    cells[2].axhline(identified.least_coherence, color=BESIDE, linewidth=0.9, linestyle=":")
    cells[2].set_ylim(0.0, 1.05)
    cells[2].set_xlabel("frequency [rad/s]")
    _ticks(cells, omega)


def _ticks(cells: Sequence[Axes], omega: FloatArray) -> None:
    from matplotlib.ticker import FixedLocator, MultipleLocator, NullLocator, StrMethodFormatter

    narrow = magnitude_range_db(np.array(cells[0].get_ylim()))
    if narrow:
        cells[0].set_ylim(narrow)
    cells[1].yaxis.set_major_locator(MultipleLocator(phase_step_deg(float(np.ptp(cells[1].get_ylim())))))
    cells[2].xaxis.set_major_locator(FixedLocator(frequency_ticks(omega)))
    cells[2].xaxis.set_minor_locator(NullLocator())
    # Plain numbers: the powers of ten would be mathematics, which is switched off for the names.
    cells[2].xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


def _trace(cell: Axes, check: Verification, output: str) -> None:
    row, paper = check.output_names.index(output), quantity(output)
    time_s = check.time_s - check.time_s[0]
    cell.plot(time_s, paper.factor * check.measured[row], color=MEASURED, linewidth=1.6, label="measured")
    cell.plot(time_s, paper.factor * check.predicted[row], color=MODEL, linewidth=1.4, linestyle=(0, (4, 2)))
    cell.set_xlabel("time into an unseen maneuver [s]")
    cell.set_ylabel(f"{output} [{paper.unit}]" if paper.unit else output)
