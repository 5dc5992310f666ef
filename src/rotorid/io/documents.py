"""Documents that somebody hands in: TOML and JSON, read within limits.

Layouts, models, mappings, controllers, plans and results come from other people and other programs. Whatever is in them
costs a sentence: the parsers of Python follow nested brackets by recursion, take time with the square of the number of
dots in a key, refuse a number of five thousand digits in words of their own, and make ``1e999`` infinite without a
word. So the text is looked at before it is parsed, in one pass, and the numbers as they are read:

========================  =================================================
size                      256 KiB of TOML, 64 MiB of JSON
depth                     64 brackets inside each other
parts of a dotted key     16
digits of a number        100
integers                  64 bits, as TOML has it
other numbers             those that a double holds; ``inf`` in TOML is one
========================  =================================================

Every fault is a :class:`DocumentError` with the line it is on; who reads says what was needed.
"""

from __future__ import annotations

import json
import os
import re
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

from rotorid.errors import LogError, UsageError

MOST_TOML_BYTES = 256 << 10
MOST_JSON_BYTES = 64 << 20
MOST_DEPTH = 64
MOST_KEY_PARTS = 16
MOST_DIGITS = 100
LARGEST_INTEGER = 2**63
"""TOML's own limit; Python would carry more, and fail to write them down."""

# Possessive quantifiers: what was taken is never given back, so that one pass over the text is all there is.
_TOML_TOKEN = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5})?'
    r"|'''(?:[^']|'(?!''))*+(?:'{3,5})?"
    r'|"(?:[^"\\\n]|\\.)*+"?'
    r"|'[^'\n]*+'?"
    r"|#[^\n]*+"
    r"|[\[\]{}.=,\n]",
    re.DOTALL,
)
_JSON_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*+"?|[\[\]{}]', re.DOTALL)
_LONE_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
_OURS = re.compile(rb'"schema": ?"rotorid\.[a-z_-]{1,40}/\d')
_HEAD_BYTES, _MOST_LOOKED_AT = 4096, 100
_AT_LINE = re.compile(r"at line (\d{1,9})")


class DocumentError(ValueError):
    """A text that is no document, with the line that is wrong.

    Parameters
    ----------
    line
        Counted from one; zero where it is not known.
    """

    def __init__(self, message: str, line: int = 0) -> None:
        super().__init__(message)
        self.line = line


def parse_toml(text: str, *, any_integer: bool = False) -> dict[str, Any]:
    r"""A TOML text as tables, lists, texts, numbers and dates.

    Parameters
    ----------
    any_integer
        Leave integers of more than 64 bits to the caller, which knows what they are.

    Raises
    ------
    DocumentError
        It is not valid TOML, or goes beyond the limits.

    Examples
    --------
    >>> parse_toml("[a]\nb = [1, 2.5]")
    {'a': {'b': [1, 2.5]}}
    >>> parse_toml("x = " + "[" * 1000)
    Traceback (most recent call last):
    rotorid.io.documents.DocumentError: brackets are nested more than 64 deep (at line 1)
    """
    _check_size(len(text), MOST_TOML_BYTES, "TOML")
    _check_toml_depth(text)
    try:
        table = tomllib.loads(text, parse_float=_number)
    except (ValueError, RecursionError) as error:  # too many digits and too deep a nesting are no decode errors
        raise _located(error, text) from error
    if not any_integer:
        _check_integers(table)
    return table


def toml_text(text: str) -> str:
    r"""A text as TOML has it: in quotes, on one line.

    Examples
    --------
    >>> print(toml_text('5" of\nθ'))
    "5\" of\U0000000aθ"
    """
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def parse_json(text: str) -> Any:
    """A JSON text as tables, lists, texts, numbers, ``None``.

    Raises
    ------
    DocumentError
        It is no JSON, or goes beyond the limits.

    Examples
    --------
    >>> parse_json('{"a": [1, 2.5, null]}')
    {'a': [1, 2.5, None]}
    >>> parse_json("NaN")
    Traceback (most recent call last):
    rotorid.io.documents.DocumentError: NaN is no number of JSON
    """
    _check_size(len(text), MOST_JSON_BYTES, "JSON")
    depth = 0
    for token in _JSON_TOKEN.finditer(text):
        if token[0].startswith('"') and _LONE_SURROGATE.search(token[0]):
            _check_letters(token[0])
        depth = _deeper(depth, token[0], text, token.start())
    try:
        table = json.loads(text, parse_float=_number, parse_int=_integer, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise error if isinstance(error, DocumentError) else DocumentError(_describe_error(error)) from error
    _check_integers(table)
    return table


def read_text(path: Path, *, needed: str, most_bytes: int = MOST_TOML_BYTES) -> str:
    """The text of a document.

    Parameters
    ----------
    needed
        What an error says was needed.
    most_bytes
        Its largest size.

    Raises
    ------
    UsageError
        It cannot be read, is no regular file, no text in UTF-8, or too large.
    """
    content = read_bytes(path, needed=needed, most_bytes=most_bytes)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path} cannot be read: it is not UTF-8 text", needed=needed) from error
    # Ends of lines as a text file has them on any system.
    return text.replace("\r\n", "\n")


def read_bytes(path: Path, *, needed: str, most_bytes: int) -> bytes:
    """The bytes of a document, for who decodes them otherwise than :func:`read_text`.

    Raises
    ------
    UsageError
        It cannot be read, is no regular file, or too large.
    """
    with _opened(path, needed) as file:
        content = file.read(most_bytes + 1)
        if len(content) > most_bytes:
            size = max(os.fstat(file.fileno()).st_size, len(content))
            raise UsageError(f"{path} has {size} bytes", needed=f"{needed}, of at most {most_bytes} bytes")
    return content


def read_lines(path: Path, *, needed: str, most_bytes: int) -> Iterator[bytes]:
    """The lines of a document that is too long to be held, each with its end; the last one may have none.

    Parameters
    ----------
    most_bytes
        The longest line; a longer one comes in pieces without an end.

    Raises
    ------
    UsageError
        It cannot be read, or is no regular file.
    """
    with _opened(path, needed) as file:
        yield from iter(lambda: file.readline(most_bytes), b"")


@contextmanager
def _opened(path: Path, needed: str) -> Iterator[BinaryIO]:
    """A file that was found to be one, open."""
    try:
        require_file(path)
        with path.open("rb") as file:
            yield file
    except LogError as error:
        raise UsageError(error.came, needed=needed, remedy=error.remedy) from None
    except OSError as error:
        came = _not_there(path) if isinstance(error, FileNotFoundError) else ""
        raise UsageError(came or f"{path} cannot be read: {error.strerror or error}", needed=needed) from error
    # Python's word for a name that no file can have.
    except ValueError as error:
        raise UsageError(f"{path} cannot be read: {error}", needed=needed) from error


def _not_there(path: Path) -> str:
    """What stands where a file was looked for; empty where that says nothing."""
    if not path.parent.is_dir():
        return f"{path.parent} does not exist"
    held = held_documents(path.parent)
    return f"{path.parent} contains {held} and no {path.name}" if held else ""


def held_documents(folder: Path) -> str:
    r"""Names of the JSON documents of rotorid in a folder, as ``review.json``; empty where there are none.

    Somebody who gives a folder of one command to another reads what it is.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     held_documents(Path(folder))
    ''
    """
    held = []
    for file in sorted(islice(folder.glob("*.json"), _MOST_LOOKED_AT)):
        try:
            require_file(file)
            with file.open("rb") as opened:
                head = opened.read(_HEAD_BYTES)
        except (OSError, LogError):
            continue
        if _OURS.search(head):
            held.append(file.name)
    return ", ".join(held)


def require_file(path: Path) -> None:
    """Refuse what is neither a file nor a folder: reading a pipe waits for ever, a device may have no end.

    Raises
    ------
    LogError
        It is a pipe, a socket or a device.
    OSError
        There is nothing, or it may not be looked at.

    Examples
    --------
    >>> require_file(Path("/dev/null"))
    Traceback (most recent call last):
    rotorid.errors.LogError: /dev/null is a device; expected a file; copy what it gives to a file first.
    """
    mode = path.stat().st_mode
    kinds = (
        (stat.S_ISFIFO, "a pipe"),
        (stat.S_ISSOCK, "a socket"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
    )
    for is_kind, word in kinds:
        if is_kind(mode):
            raise LogError(f"{path} is {word}", needed="a file", remedy="copy what it gives to a file first")


def _check_size(size: int, most: int, what: str) -> None:
    if size > most:
        raise DocumentError(f"{size} characters of {what}, and at most {most} are read")


def _deeper(depth: int, token: str, text: str, place: int) -> int:
    if token in "[{":
        if depth == MOST_DEPTH:
            line = text.count("\n", 0, place) + 1
            raise DocumentError(f"brackets are nested more than {MOST_DEPTH} deep (at line {line})", line)
        return depth + 1
    return max(depth - 1, 0) if token in "]}" else depth


def _check_toml_depth(text: str) -> None:
    """Refuse brackets inside each other and keys of many parts, which the parser takes time and stack for."""
    depth = parts = 0
    for token in _TOML_TOKEN.finditer(text):
        word = token[0]
        if word == ".":
            # The point of a number counts too, and is forgotten with the end of its value.
            parts += 1
            if parts >= MOST_KEY_PARTS:
                line = text.count("\n", 0, token.start()) + 1
                raise DocumentError(f"a key has more than {MOST_KEY_PARTS} parts (at line {line})", line)
        elif word in ("=", ",", "\n", "[", "]", "{", "}"):
            parts = 0
            depth = _deeper(depth, word, text, token.start())


def _number(text: str) -> float:
    if len(text) > MOST_DIGITS:
        raise DocumentError(f"a number of {len(text)} characters begins with {text[:12]}")
    value = float(text)
    if value in (float("inf"), float("-inf")) and "inf" not in text:
        raise DocumentError(f"{text} is more than a number may be")
    return value


def _integer(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise DocumentError(f"a number of {len(text)} digits begins with {text[:12]}")
    return int(text)


def _check_letters(text: str) -> None:
    r"""Refuse half a letter, ``"\ud800"``, which no file can hold."""
    try:
        json.loads(text).encode("utf-8")
    except UnicodeEncodeError as error:
        raise DocumentError("a text contains half a character") from error


def _no_number(text: str) -> float:
    raise DocumentError(f"{text} is no number of JSON")


def _check_integers(document: Any) -> None:
    waiting = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, int) and not -LARGEST_INTEGER <= value < LARGEST_INTEGER:
            raise DocumentError("a number has more than 64 bits")


def _describe_error(error: ValueError | RecursionError) -> str:
    message = str(error)
    return "a number has too many digits" if "integer string conversion" in message else message


def _located(error: ValueError | RecursionError, text: str) -> DocumentError:
    message = _describe_error(error)
    line = _AT_LINE.search(message)
    last = 1 + text.rstrip("\n").count("\n")
    return DocumentError(message, int(line[1]) if line else last if "end of document" in message else 0)
