"""The page of an inspection, which needs no other file, and its picture as a PNG."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from rotorid.data.quantity import milliseconds, with_error
from rotorid.data.record import AXES, FlightRecord
from rotorid.errors import UsageError
from rotorid.io.files import write_atomically
from rotorid.models.library import RATE_AXES
from rotorid.plot.figure import MOST_POINTS, envelope
from rotorid.plot.inspection import Bar, LogPicture, Trend, log_figure
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, drawn, render
from rotorid.report.inspection_words import further_findings, good_for, good_with_options, not_for
from rotorid.reviewing.inspection import Inspection, coverage
from rotorid.signal.airborne import evidence_words
from rotorid.signal.excitations import excitation_signals
from rotorid.typing import FloatArray

SUFFIXES = (".html", ".png")


def write_inspection(path: Path, record: FlightRecord, inspection: Inspection) -> None:
    """Write the picture of a log; the ending of ``path`` says as what.

    Parameters
    ----------
    path
        An ``.html`` or a ``.png``; replaced when it is there.
    inspection
        Its inspection.

    Raises
    ------
    UsageError
        The ending is another one, the folder cannot be written, or a PNG is asked for without matplotlib.
    """
    require_suffix(path)
    if path.suffix.lower() == ".html":
        content: str | bytes = render_inspection(record, inspection)
    else:
        from rotorid.plot.paper import log_png

        content = log_png(log_picture(record, inspection), title=inspection.name)
    write_atomically(path, content)


def require_suffix(path: Path) -> None:
    """Refuse a picture of another kind before a long log is read.

    Examples
    --------
    >>> require_suffix(Path("flight.html"))
    >>> require_suffix(Path("flight.pdf"))
    Traceback (most recent call last):
    rotorid.errors.UsageError: a picture called flight.pdf was asked for; expected .html or .png; change its ending.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"a picture called {path.name} was asked for", needed=" or ".join(SUFFIXES), remedy="change its ending"
        )


def render_inspection(record: FlightRecord, inspection: Inspection) -> str:
    """The inspection of a log as one HTML document.

    Scripts and styles are embedded, under the same content security policy as the report.
    """
    picture = Picture(
        key="log",
        description="Bars of excitations, traces of inputs and outputs, and bars of logged topics over time",
        figure=drawn(log_figure, log_picture(record, inspection)),
    )
    return render(
        "inspection.html",
        logs=[inspection.name, inspection.format],
        log=inspection,
        good_for=good_for(inspection),
        good_with_options=good_with_options(inspection),
        not_for=not_for(inspection),
        topics=[list(rows) for _, rows in groupby(inspection.channels, key=lambda channel: channel.topic)],
        remarks=finding_rows(further_findings(inspection)),
        log_picture=picture,
        pictures=[picture],
        with_error=with_error,
        milliseconds=milliseconds,
    )


def log_picture(record: FlightRecord, inspection: Inspection) -> LogPicture:
    """Flights, excitations, candidates, the signals of each axis, and all topics of a log, for its picture."""
    shown = (("excitation", inspection.excitations), ("candidate", inspection.candidates))
    excitations = [
        Bar(
            row=axis,
            group=group,
            spans=[(item.start_s, item.stop_s) for item in items if item.axis == axis],
            words=[f"{item.kind.replace('_', ' ')} in {item.signal}" for item in items if item.axis == axis],
        )
        for axis in AXES
        for group, items in shown
    ]
    flights = Bar(
        row="in the air",
        group="flight",
        spans=[(flight.start_s, flight.stop_s) for flight in inspection.flights],
        words=[evidence_words(flight.seen_in) for flight in inspection.flights],
    )
    topics = [_topic_bar(topic.name, topic.sample_rate_hz, coverage(topic.time_s)) for topic in record.topics]
    trends = [trend for axis in RATE_AXES.values() for trend in _trends(record, inspection, axis.input, axis.output)]
    return LogPicture(excitations=[bar for bar in (flights, *excitations) if bar.spans], trends=trends, topics=topics)


def _topic_bar(name: str, rate_hz: float, spans: Sequence[tuple[float, float]]) -> Bar:
    return Bar(row=name, group="logged", spans=spans, words=[f"{rate_hz:.4g} Hz"] * len(spans))


def _trends(record: FlightRecord, inspection: Inspection, command: str, output: str) -> list[Trend]:
    """The signal that excites an axis, or would, and the output that answers, as far as they are logged."""
    axis = next(axis for axis in AXES if command == f"{axis}_command")
    excitations = [item for item in inspection.excitations if item.axis == axis]
    tried = [item for item in inspection.candidates if item.axis == axis]
    known = (*(item.signal for item in (*excitations, *tried)), *excitation_signals(record, axis))  # type: ignore[arg-type]
    shaded = [(item.start_s, item.stop_s) for item in excitations]
    shown = ((next(iter(known), command), True), (output, False))
    return [
        Trend(channel=name, is_input=is_input, time_s=time_s, values=values, shaded=shaded)
        for name, is_input in shown
        for time_s, values in [_whole(record, name)]
        if time_s.size
    ]


def _whole(record: FlightRecord, name: str) -> tuple[FloatArray, FloatArray]:
    """A channel over the whole log: its longest topic, and those that lie beside it, such as a second run.

    Shapes ``(samples,)``, thinned for display; a sample that is not a number breaks the trace between two topics.
    """
    holding = [(topic, row) for topic, row in record.holding(name) if topic.time_s.size]
    parts: list[tuple[FloatArray, FloatArray]] = []
    for topic, row in sorted(holding, key=lambda item: item[0].time_s[0] - item[0].time_s[-1]):
        first, last = topic.time_s[0], topic.time_s[-1]
        if all(last < time_s[0] or first > time_s[-1] for time_s, _ in parts):
            parts.append((topic.time_s, topic.values[row]))
    if not parts:
        return np.empty(0), np.empty(0)
    parts.sort(key=lambda part: float(part[0][0]))
    # Thinned before they are joined: thinning takes the lowest and highest numbers, and would lose the break.
    each = max(MOST_POINTS // len(parts) - 1, 2)
    thinned = [envelope(time_s, values, most=each) for time_s, values in parts]
    time_s = np.concatenate([np.append(stamps, stamps[-1]) for stamps, _ in thinned])
    return time_s, np.concatenate([np.append(values, np.nan) for _, values in thinned])
