"""The frame of every page: one HTML file that holds everything it shows, and asks the network for nothing.

A :class:`Picture` brings a figure in every unit that the buttons of the page offer. Numbers are written with no more
digits than their standard deviation supports (:mod:`rotorid.data.quantity`).
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
import shlex
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from itertools import product
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, Protocol, get_args
from urllib.parse import quote

from rotorid import __version__
from rotorid.autopilots.registry import by_file, named
from rotorid.data.display import capital, counted
from rotorid.data.findings import severity_count
from rotorid.data.quantity import superscript
from rotorid.errors import reason_of
from rotorid.plot.curves import Frequency, Magnitude
from rotorid.plot.figure import Figure, plotly_script, template

if TYPE_CHECKING:
    import jinja2
    from markupsafe import Markup


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure, and what it shows for those who cannot see it.

    Parameters
    ----------
    key
        Identifier on the page.
    description
        What it shows, in words.
    figure
        The picture as it is drawn first.
    views
        The same picture in other units, by frequency and magnitude (``"Hz linear"``) or by frequency alone (``"Hz"``).
        Empty where there is one view.
    converted
        Whether the page's script makes the numbers of the other views: frequencies by a factor and, where there is a
        view for each magnitude, heights in the first panel from decibels. Else each view brings its own.
    """

    key: str
    description: str
    figure: Figure
    views: Mapping[str, Figure] = field(default_factory=dict)
    converted: bool = False

    def for_script(self) -> dict[str, Any]:
        """The picture as the page's script takes it.

        Of other views a converted picture brings only what is no plain conversion of numbers: four copies of every
        response would make the file several times as long.
        """
        if not self.views:
            return {"data": self.figure["data"], "layout": _layout(self.figure)}
        if not self.converted:
            own = {units: {"data": view["data"], "layout": _layout(view)} for units, view in self.views.items()}
            return {"views": own}
        views = {
            units: {"layout": _layout(view), "hover": [trace.get("hovertemplate") for trace in view["data"]]}
            for units, view in self.views.items()
        }
        return {"data": self.figure["data"], "views": views}


Given = ParamSpec("Given")

_SENTENCE_PX, _MARGIN = 90, dict.fromkeys("lrtb", 16)
"""Height and margins of a sentence in place of a picture."""


def drawn(draw: Callable[Given, Figure], *given: Given.args, **named: Given.kwargs) -> Figure:
    """A figure; where it cannot be drawn, one that says why, and all else on the page stands.

    Parameters
    ----------
    draw
        Draws it, of what follows.

    Raises
    ------
    Exception
        See :func:`rotorid.errors.reason_of`.
    """
    try:
        return draw(*given, **named)
    except Exception as failure:
        words = html.escape(f"{capital(str(reason_of(failure, 'this picture'))).rstrip('.')}.")
        said = {"text": words, "xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5, "showarrow": False}
        hidden = {"visible": False}
        layout = {"template": template(), "height": _SENTENCE_PX, "margin": _MARGIN, "annotations": [said]}
        return Figure(data=[], layout=layout | {"xaxis": hidden, "yaxis": hidden})


class Drawn(Protocol):
    """A picture that can be drawn in all units of frequency and magnitude."""

    def __call__(self, *, frequency: Frequency, magnitude: Magnitude) -> Figure: ...


class Spread(Protocol):
    """A picture over frequency without a magnitude."""

    def __call__(self, *, frequency: Frequency) -> Figure: ...


def in_all_units(draw: Drawn, *, key: str, description: str, converted: bool = False) -> Picture:
    """A picture with a view for each unit of frequency and magnitude.

    Parameters
    ----------
    draw
        Draws one view.
    key, description, converted
        As in :class:`Picture`.
    """
    units: list[tuple[Frequency, Magnitude]] = list(product(get_args(Frequency), get_args(Magnitude)))
    views = {
        f"{frequency} {magnitude}": drawn(draw, frequency=frequency, magnitude=magnitude)
        for frequency, magnitude in units
    }
    return Picture(key=key, description=description, figure=views["rad/s dB"], views=views, converted=converted)


def over_frequency(draw: Spread, *, key: str, description: str, converted: bool = False) -> Picture:
    """A picture with a view for each unit of frequency; the other parameters are those of :class:`Picture`."""
    views = {frequency: drawn(draw, frequency=frequency) for frequency in get_args(Frequency)}
    return Picture(key=key, description=description, figure=views["rad/s"], views=views, converted=converted)


def _layout(figure: Figure) -> dict[str, Any]:
    # The template is the same for all figures, and the page picks the light or the dark one.
    return {key: value for key, value in figure["layout"].items() if key != "template"}


class Appearance(NamedTuple):
    """How a page looks first: a person's preference, where there is one."""

    frequency: str | None = None
    magnitude: str | None = None
    theme: str | None = None

    def attributes(self) -> dict[str, str]:
        """Of the page's root, where style and script look."""
        return {f"data-{name}": value for name, value in self._asdict().items() if value is not None}


appearance: ContextVar[Appearance] = ContextVar("appearance", default=Appearance())  # noqa: B039 - it is a tuple


def frequency_of(logs: Iterable[str]) -> Frequency:
    """The unit of frequency of a page: what the reader prefers, else that of the autopilots of its logs.

    Parameters
    ----------
    logs
        Names of log files, of autopilots or of firmware. Pilots of PX4, ArduPilot and Betaflight think in Hz; tables
        of engineers are in rad/s, and so is a page without a log of an autopilot.

    Examples
    --------
    >>> frequency_of(["roll.ulg"]), frequency_of(["ArduCopter V4.6.2"]), frequency_of(["rig.csv"]), frequency_of([])
    ('Hz', 'Hz', 'rad/s', 'rad/s')
    """
    preferred = appearance.get().frequency
    if preferred is not None:
        return "Hz" if preferred == "Hz" else "rad/s"
    return "Hz" if any("Hz" in (named(log).frequency, by_file(log).frequency) for log in logs) else "rad/s"


# Characters that could end a script element or start a comment; inside JSON strings they may be written as escapes.
_ESCAPES = {character: f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


def render(
    name: str,
    *,
    pictures: Iterable[Picture],
    logs: Iterable[str] = (),
    further_script: str = "",
    further: Any = None,
    **values: Any,
) -> str:
    """A page from a template that extends ``base.html``.

    Scripts and styles are embedded. A content security policy lets only these scripts run, by their hash, and forbids
    every request, so that no file name or message of a log can do anything but be read.

    Parameters
    ----------
    pictures
        All pictures that the page places.
    logs
        Names of log files, or of autopilots, that the page is about: they decide the unit of frequency
        (:func:`frequency_of`). All texts and tables are written in rad/s, with the unit behind the number or in the
        heading; where the page is read in Hz, its script shows them so.
    further_script, further
        Name of a script of this page alone, and what it reads: JSON in an element of the name ``loops``.
    values
        What the template shows.
    """
    from markupsafe import Markup

    library, script = plotly_script(), asset("page.js")
    own = asset(further_script) if further_script else ""
    page_template = _templates().get_template(name)
    page = page_template.render(
        **values,
        version=__version__,
        root=appearance.get()._replace(frequency=frequency_of(logs)).attributes(),
        policy=policy(library, script, *([own] if own else [])),
        style=Markup(asset("style.css")),
        library=Markup(library),
        script=Markup(script),
        own=Markup(own),
        further=json_for_script(further) if own else "",
        figures=json_for_script(
            {
                "pictures": {picture.key: picture.for_script() for picture in pictures},
                "light": template(),
                "dark": template(dark=True),
            }
        ),
    )
    # Only headings of the page change; its scripts stay as they are.
    body, scripts, rest = page.partition('<script type="application/json"')
    return without_gaps(body) + scripts + rest


@cache
def _templates() -> jinja2.Environment:
    """Templates of pages, each compiled once."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda wanted: asset(f"templates/{wanted}")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "shell": shlex.join,
        "capital": capital,
        "typeset": typeset,
        "counted": counted,
        "severity_count": severity_count,
    }
    return environment


_HEADING = re.compile(r"<(/?)h([1-6])(?=[\s>])")


def without_gaps(page: str) -> str:
    """A page whose headings follow each other without a gap, for those who go from one to the next.

    The same part has another depth on a page of one result and on one of several. A heading that is lifted keeps its
    look by a class of its written name.

    Examples
    --------
    >>> without_gaps("<h1>A</h1><h3>B</h3><h4>C</h4><h3>D</h3>")
    '<h1>A</h1><h2 class="h3">B</h2><h3 class="h4">C</h3><h2 class="h3">D</h2>'
    """
    above: list[int] = []

    def lifted(found: re.Match[str]) -> str:
        written = int(found[2])
        if not found[1]:
            while above and above[-1] >= written:
                above.pop()
            above.append(written)
        level = len(above)
        return f"<{found[1]}h{level}" + ("" if found[1] or level == written else f' class="h{written}"')

    return _HEADING.sub(lifted, page)


_MORE_FILES = "<!-- more files -->"
_FILE_WORDS = {
    "model.toml": "the model, as commands take it",
    "plan.json": "the flight plan",
    ".json": "all results, for programs",
    ".npz": "signals and responses, as arrays",
    ".html": "a page of its own",
}


def with_files(page: str, names: Iterable[str]) -> str:
    """A page with links to other files of its folder, after those that it has.

    Parameters
    ----------
    page
        As :func:`render` made it; one without a place for links comes back as it is.
    names
        Relative to the folder of the page.

    Examples
    --------
    >>> with_files("<ul><!-- more files --></ul>", ["a b.csv"])
    '<ul><li><a href="a%20b.csv"><code>a b.csv</code></a></li><!-- more files --></ul>'
    """
    links = "".join(map(_link, names))
    return page.replace(_MORE_FILES, links + _MORE_FILES, 1)


def _link(name: str) -> str:
    file = PurePosixPath(name)
    words = _FILE_WORDS.get(file.name) or _FILE_WORDS.get(file.suffix, "")
    return f'<li><a href="{quote(name)}"><code>{html.escape(name)}</code></a>{f": {words}" if words else ""}</li>'


def json_for_script(value: Any) -> Markup:
    r"""JSON that may be inside a script element: nothing in it can end the element.

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
    # Megabytes of numbers with a handful of these characters: searching for each of them is faster than translating.
    for character, escape in _ESCAPES.items():
        plain = plain.replace(character, escape)
    return Markup(plain)


def policy(*scripts: str) -> str:
    """Content security policy that allows these scripts and no request at all."""
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    # Plotly styles its drawings through elements it makes itself, and saves pictures through blobs.
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"


CARD_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
"""What a card may load: nothing."""


def asset(name: str) -> str:
    """Text of a file that ships with this package."""
    return files("rotorid.report").joinpath(name).read_text(encoding="utf-8")


_NEGATIVE = re.compile(r"(?P<command>(?<![\w-])--[\w-]{1,60}[ =]-\S+)|(?<![\w.)\]:/=-])-(?=\.?\d)")
_EXPONENT = re.compile(r"(?<=\d)e([+-]\d+)\b")
_RAISED = re.compile(r"(?<=[a-z])\^-?[123]\b")


def typeset(text: str) -> str:
    """A sentence with minus signs, powers of ten and units as printed; commands in it stay as they are.

    Examples
    --------
    >>> typeset("bias -0.5 +/- 1e-05 m/s^2 on 2026-11-25; try --declination -3")
    'bias −0.5 +/- 1·10⁻⁵ m/s² on 2026-11-25; try --declination -3'
    """
    text = _NEGATIVE.sub(lambda found: found["command"] or "−", text)
    text = _EXPONENT.sub(lambda found: f"·10{superscript(str(int(found[1])))}", text)
    return _RAISED.sub(lambda found: superscript(found[0][1:]), text)
