"""One picture of a whole identification, for a README or a slide."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.plot.bode import measured_curve
from rotorid.plot.paper import PAPER_STYLE, Drawn, draw, matplotlib_or_remedy
from rotorid.plot.phase import unwrapped_deg
from rotorid.plot.quantity import quantity
from rotorid.plot.theme import MEASURED, MODEL
from rotorid.plot.view import View
from rotorid.typing import BoolArray, ComplexArray
from rotorid.verify.verification import Verification

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLUMN_IN, _HEIGHT_IN = 4.2, 8.4


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
    mpl = matplotlib_or_remedy()
    columns = len(identifications)
    with mpl.rc_context(PAPER_STYLE):
        # The object instead of pyplot: no global state, no window system.
        canvas = mpl.figure.Figure(figsize=(_COLUMN_IN * columns + 0.4, _HEIGHT_IN), layout="constrained")
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
    response, model = identified.response, identified.model_response[y, u]
    drawn = Drawn(
        view=View(),
        measured=measured_curve(
            response,
            output=response.outputs[y],
            input=response.inputs[u],
            lean_deg=unwrapped_deg(response.omega_rad_s, model),
        ),
        coherence=response.coherence[y, u],
        used=identified.fitted[y, u],
        least_coherence=identified.least_coherence,
    )
    draw(cells, drawn, model)


def _trace(cell: Axes, check: Verification, output: str) -> None:
    row, paper = check.output_names.index(output), quantity(output)
    time_s = check.time_s - check.time_s[0]
    cell.plot(time_s, paper.factor * check.measured[row], color=MEASURED, linewidth=1.6, label="measured")
    cell.plot(time_s, paper.factor * check.predicted[row], color=MODEL, linewidth=1.4, linestyle=(0, (4, 2)))
    cell.set_xlabel("time into an unseen maneuver [s]")
    cell.set_ylabel(f"{output} [{paper.unit}]" if paper.unit else output)
