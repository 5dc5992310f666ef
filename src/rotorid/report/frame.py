"""The frame of every page: one HTML file that holds everything it shows, and asks the network for nothing."""

from __future__ import annotations

import base64
import hashlib
import json
import shlex
from collections.abc import Iterable
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from rotorid import __version__
from rotorid.plot.theme import template
from rotorid.report.picture import Picture

if TYPE_CHECKING:
    from markupsafe import Markup

# Characters that could end a script element or start a comment; inside JSON strings they may be written as escapes.
_ESCAPES = {ord(character): f"\\u{ord(character):04x}" for character in "<>&\u2028\u2029"}


def render(name: str, *, pictures: Iterable[Picture], **values: Any) -> str:
    """A page from a template that extends ``base.html``.

    Scripts and styles are embedded. A content security policy lets only these scripts run, by their hash, and forbids
    every request, so that no file name or message of a log can do anything but be read.

    Parameters
    ----------
    name
        Of the template.
    pictures
        All pictures that the page places.
    values
        What the template shows.
    """
    import jinja2
    from markupsafe import Markup

    library, script = asset("vendor/plotly-basic.min.js"), asset("page.js")
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda wanted: asset(f"templates/{wanted}")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shell"] = shlex.join
    return environment.get_template(name).render(
        **values,
        version=__version__,
        policy=policy(library, script),
        style=Markup(asset("style.css")),
        library=Markup(library),
        script=Markup(script),
        figures=json_for_script(
            {
                "pictures": {picture.key: picture.for_script() for picture in pictures},
                "light": template(),
                "dark": template(dark=True),
            }
        ),
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


def policy(*scripts: str) -> str:
    """Content security policy that allows these scripts and no request at all."""
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    # Plotly styles its drawings through elements it makes itself, and saves pictures through blobs.
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"


def asset(name: str) -> str:
    """Text of a file that ships with this package."""
    return files("rotorid.report").joinpath(name).read_text(encoding="utf-8")
