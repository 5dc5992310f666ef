"""The report: one HTML file that holds everything it shows, and asks the network for nothing."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from rotorid.errors import UsageError
from rotorid.pipeline.identification import Identification
from rotorid.plot.figure import Figure
from rotorid.plot.theme import template
from rotorid.report.section import Picture, Section, section

if TYPE_CHECKING:
    from markupsafe import Markup

# Characters that could end a script element or start a comment; inside JSON strings they may be written as escapes.
_ESCAPES = {ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


def render_report(
    identifications: Sequence[Identification], *, title: str, truth: Mapping[str, float] | None = None
) -> str:
    """The whole report as one HTML document.

    Scripts and styles are embedded. A content security policy lets only these scripts run, by their hash, and forbids
    every request, so that no file name or message of a log can do anything but be read.

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
    import jinja2
    from markupsafe import Markup

    sections = [
        section(identified, anchor=f"s{number}", truth=truth or {})
        for number, identified in enumerate(identifications, start=1)
    ]
    library, script = asset("vendor/plotly-basic.min.js"), asset("page.js")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(asset("template.html")).render(
        title=title,
        sections=sections,
        has_truth=bool(truth),
        policy=policy(library, script),
        style=Markup(asset("style.css")),
        library=Markup(library),
        script=Markup(script),
        figures=_figures(sections),
    )


def json_for_script(value: Any) -> Markup:
    r"""JSON that may stand inside a script element: nothing in it can end the element.

    Raises
    ------
    ValueError
        A number is not finite; it would not be JSON.

    Examples
    --------
    >>> print(json_for_script({"name": "</script>"}))
    {"name":"\u003c/script\u003e"}
    """
    from markupsafe import Markup

    plain = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return Markup(plain.translate(_ESCAPES))


def _figures(sections: Sequence[Section]) -> Markup:
    pictures = {picture.key: _picture(picture) for one in sections for picture in one.pictures}
    return json_for_script({"pictures": pictures, "light": template(), "dark": template(dark=True)})


def _picture(picture: Picture) -> dict[str, Any]:
    """A picture as the page's script takes it.

    Of other views it gets only what is no plain conversion of numbers, which the script does itself: four copies of
    every response would make the file several times as long.
    """
    views = {
        units: {"layout": _layout(figure), "hover": [trace.get("hovertemplate") for trace in figure["data"]]}
        for units, figure in picture.views.items()
    }
    whole = {"data": picture.figure["data"], "layout": _layout(picture.figure)}
    return {**whole, "views": views} if views else whole


def _layout(figure: Figure) -> dict[str, Any]:
    # The template is the same for all figures, and the page picks the light or the dark one.
    return {key: value for key, value in figure["layout"].items() if key != "template"}


def policy(*scripts: str) -> str:
    """Content security policy that allows these scripts and no request at all."""
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    # Plotly styles its drawings through elements it makes itself, and saves pictures through blobs.
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"


def asset(name: str) -> str:
    """Text of a file that ships with this package."""
    return files("rotorid.report").joinpath(name).read_text(encoding="utf-8")
