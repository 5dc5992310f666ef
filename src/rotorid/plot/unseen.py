"""An unseen maneuver beyond its open loop: predicted a little ahead, and flown in closed loop."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.plot.figure import Figure
from rotorid.plot.quantity import quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import MEASURED, MODEL, SERIES
from rotorid.plot.time import TIME_AXIS, line
from rotorid.verify.closed_loop import ClosedLoop
from rotorid.verify.prediction import Prediction

_HEIGHT_PX = 150.0
_AHEAD = (MODEL, *SERIES[3:])
_DASHES = ("5 3", "2 2", "9 3 2 3")


def ahead(prediction: Prediction, names: Sequence[str], *, of: Sequence[str]) -> Figure:
    """Measured outputs about their mean, and what was predicted for each instant some time before it.

    Parameters
    ----------
    prediction
        At least one horizon.
    names
        Outputs to show.
    of
        All outputs, in the order of the rows.
    """
    panels = []
    for number, name in enumerate(names):
        row, first = list(of).index(name), prediction.horizons[0]
        legend = number == 0
        traces = [line(first.time_s, first.measured[row], name, words="measured", color=MEASURED, legend=legend)]
        traces += [
            line(
                one.time_s,
                one.predicted[row],
                name,
                words=f"predicted {one.horizon_s:.2g} s ahead",
                color=color,
                dash=dash,
                legend=legend,
            )
            for one, color, dash in zip(prediction.horizons, _AHEAD, _DASHES, strict=False)
        ]
        panels.append(Panel(label=quantity(name).label, traces=traces, height_px=_HEIGHT_PX))
    return stacked(panels, x_axis=TIME_AXIS)


def closed_loop(flown: ClosedLoop, names: Sequence[str]) -> Figure:
    """Measured outputs and commands, and those of the model under the same controller.

    Parameters
    ----------
    flown
        The flight.
    names
        Outputs to show; the commands come below them.
    """
    panels: list[Panel] = []
    for row, name in enumerate(flown.names):
        command = row >= flown.outputs
        if not command and name not in names:
            continue
        first = not panels
        traces = (
            line(flown.time_s, flown.measured[row], name, words="measured", color=MEASURED, legend=first),
            line(flown.time_s, flown.predicted[row], name, words="model", color=MODEL, legend=first, dash="5 3"),
        )
        panels.append(Panel(label=quantity(name).label, traces=traces, height_px=_HEIGHT_PX))
    return stacked(panels, x_axis=TIME_AXIS)
