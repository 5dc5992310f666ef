"""The report on measured frequency responses: what can be used, the responses, and the loops."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.pipeline.response import Responses
from rotorid.report.frame import render
from rotorid.report.numbers import significant
from rotorid.report.picture import Picture
from rotorid.report.response_pictures import (
    bands_picture,
    loop_pictures,
    response_pictures,
    timeline_pictures,
    window_pictures,
)
from rotorid.report.response_rows import LoopRow, Unseen, loop_rows, pair_rows, record_rows, split_rows, unseen
from rotorid.report.response_wording import response_summary
from rotorid.report.tables import finding_rows


@dataclass(frozen=True, kw_only=True)
class Loop:
    """The loop of one axis on the page."""

    axis: str
    method: str
    rows: tuple[LoopRow, ...]
    unseen: tuple[Unseen, ...]
    pictures: tuple[Picture, ...]


def render_responses(result: Responses, *, title: str) -> str:
    """The report as one HTML document, which holds everything it shows and lets no text of a log act.

    Parameters
    ----------
    result
        What ``respond`` found.
    title
        Heading of the page.
    """
    document = result.document
    bands, responses, windows = bands_picture(result), response_pictures(result), window_pictures(result)
    timelines, loops = timeline_pictures(result), _loops(result)
    of_loops = [picture for loop in loops for picture in loop.pictures]
    return render(
        "response.html",
        title=title,
        document=document,
        sentences=response_summary(document),
        least_coherence=result.least_coherence,
        pairs=pair_rows(document),
        bands=bands,
        responses=responses,
        loops=loops,
        splits=split_rows(document),
        condition=significant(document.largest_condition),
        windows=windows,
        records=record_rows(document),
        timelines=timelines,
        remarks=finding_rows(document.findings),
        pictures=[bands, *responses, *of_loops, *windows, *timelines],
    )


def _loops(result: Responses) -> tuple[Loop, ...]:
    documents = result.document.loops
    return tuple(
        Loop(
            axis=axis,
            method=documents[axis].method,
            rows=loop_rows(documents[axis]),
            unseen=unseen(documents[axis]),
            pictures=loop_pictures(axis, loop),
        )
        for axis, loop in result.loops.items()
    )
