"""The excitations of a flight: where they are, what was commanded and what the vehicle answered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.plot.figure import Figure, Trace
from rotorid.plot.quantity import quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import INPUT, MEASURED
from rotorid.plot.time import TIME_AXIS, line


class Excited(Protocol):
    """A maneuver with the data around it; ``rotorid.pipeline.identification.Segment`` is one."""

    @property
    def maneuver(self) -> Maneuver: ...

    @property
    def history(self) -> TimeHistory: ...


def timeline(
    segments: Sequence[Excited],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    shaded: Sequence[tuple[float, float]] | None = None,
) -> Figure:
    """Inputs and outputs of one record over time, its maneuvers shaded.

    Parameters
    ----------
    segments
        Data on one clock: those of one record.
    inputs, outputs
        Channels to draw, one panel each; a segment that lacks one leaves a gap.
    shaded
        Maneuvers ``(start, stop)`` in seconds on the log's own clock, where they are not those of the segments: data
        may be cut wide around several of them.
    """
    if shaded is None:
        shaded = [(segment.maneuver.start_s, segment.maneuver.stop_s) for segment in segments]
    panels = [
        Panel(
            label=quantity(name).label,
            traces=_traces(segments, name, words=words, color=color, legend=name == names[0]),
            height_px=height_px,
            shaded=shaded,
        )
        for words, names, color, height_px in (("input", inputs, INPUT, 110), ("output", outputs, MEASURED, 130))
        for name in names
    ]
    return stacked(panels, x_axis=TIME_AXIS)


def _traces(segments: Sequence[Excited], name: str, *, words: str, color: str, legend: bool) -> list[Trace]:
    histories = [segment.history for segment in segments if name in segment.history.names]
    return [
        line(
            history.time_s,
            history[name],
            name,
            words=words,
            color=color,
            legend=legend and index == 0,
            width=1.0,
        )
        for index, history in enumerate(histories)
    ]
