"""The report on identifications."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rotorid.errors import UsageError
from rotorid.pipeline.identification import Identification
from rotorid.report.frame import render
from rotorid.report.section import section


def render_report(
    identifications: Sequence[Identification], *, title: str, truth: Mapping[str, float] | None = None
) -> str:
    """The whole report as one HTML document, which holds everything it shows and lets no text of a log act.

    Parameters
    ----------
    identifications
        At least one; each becomes a section.
    title
        Heading of the page.
    truth
        True parameter values where they are known, as ``model.name`` or ``name``: adds a column to the tables.

    Raises
    ------
    UsageError
        There is nothing to report.
    """
    if not identifications:
        raise UsageError("a report on no identification was asked for", needed="at least one identification")
    sections = [
        section(identified, anchor=f"s{number}", truth=truth or {})
        for number, identified in enumerate(identifications, start=1)
    ]
    return render(
        "identification.html",
        title=title,
        sections=sections,
        has_truth=bool(truth),
        pictures=[picture for one in sections for picture in one.pictures],
    )
