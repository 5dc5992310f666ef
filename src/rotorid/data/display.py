"""How values show themselves: at most twenty lines of text, and a table in a notebook."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import fields
from typing import Any

from rotorid.letters import visible

MOST_LINES = 20
"""No value shows more of itself than this."""

_WIDTH = 118
_FEW = 6


def lines_of(head: str, rows: Sequence[Sequence[str]], *, most: int = MOST_LINES) -> str:
    """A heading and a table below it, its columns aligned, cut to ``most`` lines.

    Examples
    --------
    >>> print(lines_of("2 channels", [("p", "rad/s"), ("roll_command", "1")]))
    2 channels
      p             rad/s
      roll_command  1
    """
    kept = rows if len(rows) < most else rows[: most - 2]
    widths = [max(map(len, column)) for column in zip(*kept, strict=True)]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in kept]
    shown = [head, *(cut(f"  {line}".rstrip()) for line in table)]
    return visible("\n".join(shown if len(kept) == len(rows) else [*shown, f"  … {len(rows) - len(kept)} more"]))


def html_table(head: str, columns: Sequence[str], rows: Iterable[Sequence[str]], *, most: int = 200) -> str:
    """The same as HTML: text is escaped, rows beyond ``most`` are counted.

    Examples
    --------
    >>> html_table("1 channel", ["name"], [["<p>"]]).partition("<tbody>")[2]
    '<tr><td>&lt;p&gt;</td></tr></tbody></table>'
    """
    listed = list(rows)
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in listed[:most])
    named = "".join(f"<th>{html.escape(column)}</th>" for column in columns)
    rest = f"<p>… {len(listed) - most} more</p>" if len(listed) > most else ""
    return f"<p><b>{html.escape(head)}</b></p><table><thead><tr>{named}</tr></thead><tbody>{body}</tbody></table>{rest}"


def dataclass_text(value: Any) -> str:
    """The usual text of a dataclass, with arrays and long texts replaced by their size.

    Examples
    --------
    >>> import numpy as np
    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Fit:
    ...     cost: float
    ...     residuals: np.ndarray
    >>> dataclass_text(Fit(1.5, np.zeros((3, 400))))
    'Fit(cost=1.5, residuals=<3 x 400 float64>)'
    """
    parts = [f"{field.name}={brief(getattr(value, field.name))}" for field in fields(value) if field.repr]
    name = type(value).__name__
    flat = f"{name}({', '.join(parts)})"
    if len(flat) <= _WIDTH:
        return flat
    kept = (
        parts if len(parts) <= MOST_LINES - 2 else [*parts[: MOST_LINES - 3], f"… {len(parts) - MOST_LINES + 3} more"]
    )
    return "\n".join([f"{name}(", *(cut(f"    {part},") for part in kept), ")"])


def brief(value: Any) -> str:
    """A value in a few words: short ones as they are, long ones by their kind and size.

    Examples
    --------
    >>> import numpy as np
    >>> brief(np.zeros((2, 900))), brief("roll"), brief({"a": 1.0}), brief(tuple(range(100)))
    ('<2 x 900 float64>', "'roll'", "{'a': 1.0}", '<100 int>')
    """
    import numpy as np

    if isinstance(value, np.ndarray):
        few = value.size <= _FEW and value.ndim == 1
        return repr(value.tolist()) if few else f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
    if isinstance(value, str | bytes):
        return cut(repr(value))
    if isinstance(value, Mapping):
        entries = ", ".join(f"{name!r}: {brief(entry)}" for name, entry in list(value.items())[: _FEW + 1])
        return f"{{{entries}}}" if len(value) <= _FEW and len(entries) < _WIDTH else f"<{len(value)} entries>"
    if isinstance(value, Sequence | AbstractSet):
        entries = ", ".join(brief(entry) for entry in list(value)[: _FEW + 1])
        if len(value) <= _FEW and len(entries) < _WIDTH:
            return f"({entries}{',' * (len(value) == 1)})" if isinstance(value, tuple) else f"[{entries}]"
        return f"<{len(value)} {_kind(value)}>"
    text = repr(value)
    return text if len(text) < _WIDTH and "\n" not in text else f"<{type(value).__name__}>"


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "log"), counted(3, "log"), counted(0, "copy", "copies")
    ('1 log', '3 logs', '0 copies')
    """
    return f"{number} {one if number == 1 else many or f'{one}s'}"


def listed(words: Sequence[str]) -> str:
    """Words as a reader lists them.

    Examples
    --------
    >>> listed(["p"]), listed(["p", "ay", "v"]), listed([])
    ('p', 'p, ay and v', '')
    """
    *first, last = words or [""]
    return f"{', '.join(first)} and {last}" if first else last


def capital(text: str) -> str:
    """A text with a capital first letter; names of files and channels stay as they are.

    Examples
    --------
    >>> capital("gain A of the angle loop"), capital("flight.csv lacks az"), capital("p_setpoint rests")
    ('Gain A of the angle loop', 'flight.csv lacks az', 'p_setpoint rests')
    """
    word = text.partition(" ")[0].rstrip(".,:;")
    return text if set(word) & set("._/") else text[:1].upper() + text[1:]


def cut(text: str, width: int = _WIDTH) -> str:
    """A text on one line of at most ``width`` characters."""
    line = " ".join(text.split()) if "\n" in text else text
    return line if len(line) <= width else f"{line[: width - 1]}…"


def _kind(values: Iterable[Any]) -> str:
    kinds = {type(value).__name__ for value in values}
    return kinds.pop() if len(kinds) == 1 else "values"


CHANNEL_WORDS = {
    "p": "roll rate",
    "q": "pitch rate",
    "r": "yaw rate",
    "phi": "roll angle",
    "theta": "pitch angle",
    "psi": "heading",
    "u": "forward speed",
    "v": "sideward speed",
    "w": "downward speed",
    "ax": "forward specific force",
    "ay": "sideward specific force",
    "az": "downward specific force",
}
"""Channels of rates, angles, speeds and accelerations in words, for pictures and tables."""
