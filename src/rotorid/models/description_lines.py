"""On which line of a TOML text a value stands; the parser of the standard library does not say."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from typing import TypeAlias

Path: TypeAlias = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STRINGS = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'', re.DOTALL)
_PLAIN = re.compile(r"[^\s,\]}#]+")
_SPACE = re.compile(r"(?:\s|#[^\n]*)*")


def line_of(text: str, path: Sequence[str | int]) -> int:
    r"""Line of a value, counted from one; that of the nearest thing around it where it has none of its own.

    Parameters
    ----------
    text
        Valid TOML.
    path
        Keys and places in lists, from the top: ``("parameters", "L_p", "unit")``, ``("equations", 2)``.

    Examples
    --------
    >>> line_of('a = 1\nb = [\n  "x",\n  "y",\n]', ("b", 1))
    4
    """
    try:
        positions = _Walk(text).positions
    except (IndexError, RecursionError):  # a corner of TOML that this walk does not know must not hide the error
        return 1
    wanted = tuple(path)
    while wanted and wanted not in positions:
        wanted = wanted[:-1]
    return 1 + text.count("\n", 0, positions[wanted]) if wanted else 1


class _Walk:
    """One way through a valid text, noting where every key and every item of a list begins."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.positions: dict[Path, int] = {}
        table: Path = ()
        self.skip()
        while self.at < len(text):
            if text[self.at] == "[":
                table = self.header()
            else:
                self.pair(table)
            self.skip()

    def skip(self) -> None:
        match = _SPACE.match(self.text, self.at)
        self.at = match.end() if match else self.at

    def header(self) -> Path:
        start = self.at
        while self.text[self.at] == "[":
            self.at += 1
        path = self.keys()
        while self.at < len(self.text) and self.text[self.at] == "]":
            self.at += 1
        for length in range(1, len(path) + 1):
            self.positions.setdefault(path[:length], start)
        return path

    def keys(self) -> Path:
        """A key of one or more parts, up to what follows it."""
        parts: list[str] = []
        while True:
            self.skip()
            parts.append(self.key())
            self.skip()
            if self.text[self.at] != ".":
                return tuple(parts)
            self.at += 1

    def key(self) -> str:
        if self.text[self.at] in "\"'":
            written = self.string()
            return str(next(iter(tomllib.loads(f"{written} = 0"))))
        match = _BARE.match(self.text, self.at)
        if match is None:
            raise IndexError(self.at)
        self.at = match.end()
        return match[0]

    def string(self) -> str:
        match = _STRINGS.match(self.text, self.at)
        if match is None:
            raise IndexError(self.at)
        self.at = match.end()
        return match[0]

    def pair(self, table: Path) -> None:
        start = self.at
        path = (*table, *self.keys())
        for length in range(len(table) + 1, len(path) + 1):
            self.positions.setdefault(path[:length], start)
        self.at += 1
        self.value(path)

    def value(self, path: Path) -> None:
        self.skip()
        letter = self.text[self.at]
        if letter in "\"'":
            self.string()
        elif letter == "[":
            self.items(path, "]")
        elif letter == "{":
            self.items(path, "}")
        else:
            match = _PLAIN.match(self.text, self.at)
            if match is None:
                raise IndexError(self.at)
            self.at = match.end()

    def items(self, path: Path, end: str) -> None:
        self.at += 1
        self.skip()
        count = 0
        while self.text[self.at] != end:
            if end == "}":
                self.pair(path)
            else:
                self.positions[(*path, count)] = self.at
                self.value((*path, count))
                count += 1
            self.skip()
            if self.text[self.at] == ",":
                self.at += 1
                self.skip()
        self.at += 1
