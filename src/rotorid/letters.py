"""Letters of others: a text from a file, its name or a person shows what is in it and does nothing else.

Terminals obey some letters instead of showing them. :func:`visible` writes these out; every error of rotorid passes
its words through it.
"""

from __future__ import annotations

import re

HIDDEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Letters that a terminal obeys instead of showing them, or that are none.

Controls of ASCII and of Latin-1 but for tab and line feed, ends of lines and of paragraphs, marks that turn the
direction of writing, and halves of letters, as which Python reads a file name that is no text.
"""


def visible(text: str) -> str:
    r"""Text that shows what is in it, and does nothing else to whoever reads it.

    Parameters
    ----------
    text
        From anywhere. Tabs and line feeds stay.

    Examples
    --------
    >>> print(visible("\x1b[31mred\u202e"), visible("flug\udcff.ulg"), visible("größe\t1"))
    \x1b[31mred\u202e flug\xff.ulg größe	1
    """
    return HIDDEN.sub(lambda found: _written(ord(found[0])), text)


def _written(letter: int) -> str:
    # A byte of a file name that is no UTF-8 comes as one of these.
    byte = letter - 0xDC00 if 0xDC80 <= letter <= 0xDCFF else letter
    return f"\\x{byte:02x}" if byte < 0x100 else f"\\u{byte:04x}"
