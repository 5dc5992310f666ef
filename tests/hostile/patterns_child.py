"""The child of `test_patterns`: puts regular expressions to texts that are made to keep them busy, one after the other.

For each repetition without an end a text leads into it, repeats it many times, and then cannot be what the pattern
wants, so that all ways to share out the repetition are gone through. A line announces each text, so that who reads them
knows which one does not come to an end.
"""

from __future__ import annotations

import pickle
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

try:  # Python 3.11 and on
    from re import _constants as constants  # type: ignore[attr-defined]
    from re import _parser as parser  # type: ignore[attr-defined]
except ImportError:  # pragma: no cover - older ones are not supported
    raise

SIZES = (20, 25, 30, 1000, 200_000)
MANY = 64
"""A repetition of at most so many is bounded."""

Case: TypeAlias = tuple[str | bytes, int, frozenset[str], int]
"""A pattern, its flags, what is done with it, and how long its texts may be."""


def try_all(first: int, cases: Sequence[Case]) -> None:
    """Every pattern on every text, each announced by a line."""
    for number, (pattern, flags, methods, most) in enumerate(cases, start=first):
        compiled = re.compile(pattern, flags & ~re.UNICODE if isinstance(pattern, bytes) else flags)
        # All others search from place to place.
        names = sorted({name if name in ("fullmatch", "match") else "search" for name in methods})
        for size in sorted({*(size for size in SIZES if size <= most), most}):
            for text in attacks(pattern, size):
                given: Any = text.encode("latin-1", errors="replace") if isinstance(pattern, bytes) else text
                sys.stdout.write(f"{number} {text[:40]!r} of {len(text)} letters\n")
                sys.stdout.flush()
                for name in names:
                    getattr(compiled, name)(given)


def attacks(pattern: str | bytes, size: int) -> Iterator[str]:
    """Texts that lead into each unbounded repetition, repeat it, and end wrongly."""
    tree = parser.parse(pattern)
    if isinstance(pattern, bytes):
        tree = parser.parse(pattern.decode("latin-1"))
    for before, body in repetitions(tree, ""):
        for one in words(body):
            if one:
                pumped = one * max(size // len(one), 1)
                for end in ("\0", "", "!\n", before):
                    yield before + pumped + end
                yield (before + one) * max(size // len(before + one), 1) + "\0"


def repetitions(tree: Any, before: str) -> Iterator[tuple[str, Any]]:
    """Every repetition without an end, and a text that leads to it."""
    for code, value in tree:
        for inner in children(code, value):
            yield from repetitions(inner, before)
        if code in REPEATS and (value[1] is constants.MAXREPEAT or value[1] > MANY):
            yield before, value[2]
        before += word([(code, value)])


REPEATS = (constants.MAX_REPEAT, constants.MIN_REPEAT, constants.POSSESSIVE_REPEAT)


def children(code: Any, value: Any) -> list[Any]:
    """Parts of a node that are patterns themselves."""
    if code in REPEATS:
        return [value[2]]
    if code is constants.SUBPATTERN:
        return [value[3]]
    if code is constants.BRANCH:
        return list(value[1])
    if code is constants.ATOMIC_GROUP:
        return [value]
    return []


def words(tree: Any) -> list[str]:
    """Short texts that match a part, one for each way at its first fork."""
    found = [""]
    for code, value in tree:
        if code is constants.BRANCH:
            found = [a + b for a in found for branch in value[1] for b in words(branch)][:12]
        elif code is constants.SUBPATTERN:
            found = [a + b for a in found for b in words(value[3])][:12]
        elif code is constants.IN:
            found = [a + b for a in found for b in letters(value)][:12]
        else:
            found = [a + word([(code, value)]) for a in found]
    return found


def word(tree: Any) -> str:
    """A short text that matches a part."""
    text = ""
    for code, value in tree:
        if code is constants.LITERAL:
            text += chr(value)
        elif code is constants.NOT_LITERAL:
            text += "a" if value != ord("a") else "b"
        elif code is constants.ANY:
            text += "a"
        elif code is constants.IN:
            text += letters(value)[0]
        elif code in REPEATS:
            text += max(value[0], 1 if value[1] else 0) * word(value[2])
        elif code is constants.SUBPATTERN:
            text += word(value[3])
        elif code is constants.ATOMIC_GROUP:
            text += word(value)
        elif code is constants.BRANCH:
            text += word(value[1][0])
    return text


def letters(value: Any) -> list[str]:
    """Letters of a class."""
    kinds = {
        constants.CATEGORY_DIGIT: "1",
        constants.CATEGORY_WORD: "a1",
        constants.CATEGORY_SPACE: " \n",
        constants.CATEGORY_NOT_DIGIT: "a",
        constants.CATEGORY_NOT_WORD: "-",
        constants.CATEGORY_NOT_SPACE: "a1",
    }
    if value[0][0] is constants.NEGATE:
        held = re.compile("[^" + "".join(_written(item) for item in value[1:]) + "]")
        return [letter for letter in "a1 #\\\"'-.,=[]{}:\n" if held.fullmatch(letter)][:3]
    found = []
    for code, item in value:
        if code is constants.LITERAL:
            found.append(chr(item))
        elif code is constants.RANGE:
            found.append(chr(item[0]))
        elif code is constants.CATEGORY:
            found += list(kinds[item])
    return found


def _written(item: Any) -> str:
    code, value = item
    if code is constants.LITERAL:
        return re.escape(chr(value))
    if code is constants.RANGE:
        return f"{re.escape(chr(value[0]))}-{re.escape(chr(value[1]))}"
    names = {"DIGIT": r"\d", "WORD": r"\w", "SPACE": r"\s", "NOT_DIGIT": r"\D", "NOT_WORD": r"\W", "NOT_SPACE": r"\S"}
    return names[str(value).removeprefix("CATEGORY_")]


if __name__ == "__main__":
    try_all(*pickle.loads(sys.stdin.buffer.read()))
