"""A TOML text on its way to a model: values of the right kind, and errors that name file and line.

On which line a value stands the parser of the standard library does not say, so the text is walked once more for an
error.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

from rotorid.errors import ModelError
from rotorid.models.expression import Expression
from rotorid.models.parameter import no_such

Path: TypeAlias = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STRINGS = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'', re.DOTALL)
_PLAIN = re.compile(r"[^\s,\]}#]+")
_SPACE = re.compile(r"(?:\s|#[^\n]*+)*+")


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


_SHOWN = 100


class LocatedError(ModelError):
    """An error that already says on which line of the text it is."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Source:
    """The text of a model and the name of its file.

    Parameters
    ----------
    where
        Name of the file, for messages.
    """

    text: str
    where: str

    def error_at(self, line: int, came: str, *, needed: str = "", remedy: str = "") -> ModelError:
        """An error about one line."""
        lines = self.text.splitlines()
        shown = lines[line - 1].strip() if line <= len(lines) else ""
        shown = shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}…"
        quoted = f" ({shown})" if shown else ""
        return LocatedError(f"{self.where}, line {line}{quoted}: {came}", needed=needed, remedy=remedy)

    def error(self, path: Path, came: str, *, needed: str = "", remedy: str = "") -> ModelError:
        """An error about the value at a path of keys and places in lists."""
        return self.error_at(line_of(self.text, path), came, needed=needed, remedy=remedy)

    def unknown(self, kind: str, name: str, known: Iterable[str], path: Path) -> ModelError:
        """The error for a name that does not exist, with the nearest one that does."""
        error = no_such(kind, name, known)
        return self.error(path, error.came, needed=error.needed, remedy=error.remedy)

    @contextmanager
    def about(self, *path: str | int) -> Iterator[None]:
        """Say the line in errors that do not know it yet."""
        try:
            yield
        except LocatedError:
            raise
        except ModelError as error:
            raise self.error(path, error.came, needed=error.needed, remedy=error.remedy) from None

    def text_of(self, value: Any, path: Path) -> str:
        """A text."""
        if not isinstance(value, str):
            raise self.error(path, f"{_name(path)} is {value!r}", needed="a text in quotes")
        return value

    def texts(self, value: Any, path: Path) -> tuple[str, ...]:
        """A list of texts, each once."""
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.error(path, f"{_name(path)} is {value!r}", needed="a list of texts, each once")
        for place, item in enumerate(value):
            if item in value[:place]:
                raise self.error(
                    (*path, place), f"{_name(path)} has {item!r} twice", needed="a list of texts, each once"
                )
        return tuple(value)

    def number(self, value: Any, path: Path) -> float:
        """A number, infinite ones included."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(path, f"{_name(path)} is {value!r}", needed="a number", remedy="write it without quotes")
        if abs(value) > sys.float_info.max and not isinstance(value, float):
            came = f"{_name(path)} is too large for a number"
            raise self.error(path, came, needed=f"at most {sys.float_info.max:.3g}")
        if value != value:
            raise self.error(path, f"{_name(path)} is not a number", needed="a number that is one")
        return float(value)

    def numbers(self, value: Any, path: Path) -> dict[str, float]:
        """A table of finite numbers."""
        table = {name: self.number(entry, (*path, name)) for name, entry in self.table(value, path).items()}
        for name, number in table.items():
            if abs(number) > sys.float_info.max:
                raise self.error((*path, name), f"{name} is {number}", needed="a finite number")
        return table

    def table(self, value: Any, path: Path) -> dict[str, Any]:
        """A table."""
        if not isinstance(value, dict):
            raise self.error(path, f"{_name(path)} is no table", needed=f"[{_name(path)}] and pairs of name = value")
        return value

    def expression(self, value: Any, path: Path) -> Expression:
        """A number or an expression."""
        if not isinstance(value, (str, int, float)):
            came = f"{_name(path)} contains something other than entries"
            raise self.error(path, came, needed="numbers or texts like '-L_p'")
        with self.about(*path):
            return Expression.parse(value)


def _name(path: Path) -> str:
    """How a person calls what stands at a path: ``unit of L_p``, ``F``."""
    keys = [key for key in path if isinstance(key, str)]
    if keys[0] == "parameters" and len(keys) > 2:
        return f"{keys[2]} of {keys[1]}"
    return ".".join(keys[1:] or keys) if keys[0] == "parameters" else ".".join(keys)
