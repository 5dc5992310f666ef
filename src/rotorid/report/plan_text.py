"""Text files made from templates: scripts and parameter files of a plan, which are no HTML."""

from __future__ import annotations

import math
import re
from typing import Any

from rotorid.report.frame import asset


def filled(template: str, **values: Any) -> str:
    """A template filled with values; a value that is missing is an error.

    Parameters
    ----------
    template
        Name of a file among the templates.
    values
        What it shows.
    """
    import jinja2

    environment = jinja2.Environment(
        autoescape=False,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.from_string(asset(f"templates/{template}")).render(**values)


def number(value: float) -> str:
    """A number that keeps all digits of a single-precision parameter, without an exponent where it is readable.

    Examples
    --------
    >>> number(0.15), number(60.0), number(1.0 / 3.0)
    ('0.15', '60', '0.333333333')
    """
    return f"{value:.9g}"


def number_above(value: float) -> str:
    """The least number of four digits that a magnitude does not exceed.

    Examples
    --------
    >>> number_above(145.069853), number_above(0.05), number_above(0.0)
    ('145.1', '0.05', '0')
    """
    if not value:
        return "0"
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return f"{math.ceil(abs(value) / step - 1e-6) * step:.4g}"


def one_line(text: str) -> str:
    r"""Text from elsewhere that may stand in a comment: no line break can end it, and nothing but plain characters.

    A percent sign stands apart from what follows, so that nothing takes both for a place to fill in.

    Examples
    --------
    >>> one_line('my quad\nSID_AXIS,13')
    'my quad SID_AXIS,13'
    >>> one_line("50%(prog)s")
    '50% (prog)s'
    """
    return re.sub(r"%(?=\S)", "% ", re.sub(r"[^\w .,;:+\-()/=%]+", " ", text)).strip()


def file_stem(text: str) -> str:
    """A name that is safe as a part of a file name.

    Examples
    --------
    >>> file_stem("Roll & pitch, 2nd/try")
    'roll-pitch-2nd-try'
    """
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "plan"
