"""Every regular expression of the package against texts that are made to keep it busy: none takes more than linear
time.

The patterns are found by walking the sources, so that a new one is tried without a word, and each is a test by its own
name: the list of the tests is the list of the patterns. For each repetition without an end a text is made that leads
into it, repeats it many times, and then cannot be what the pattern wants, so that all ways to share out the repetition
are gone through. Where a caller bounds the length of the text, the table below says so.
"""

from __future__ import annotations

import ast
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

import rotorid
from rotorid.io.ardupilot.status import _FIRMWARES
from rotorid.io.ros.bag import RULES

try:  # Python 3.11 and on
    from re import _constants as constants  # type: ignore[attr-defined]
    from re import _parser as parser  # type: ignore[attr-defined]
except ImportError:  # pragma: no cover - older ones are not supported
    raise

ROOT = Path(rotorid.__file__).parent
SIZES = (20, 25, 30, 1000, 8000, 30_000)
LONGEST_S = 0.4
"""A linear pattern takes some milliseconds for the largest size, one with two ways for a letter hours for the third."""
MANY = 64
"""A repetition of at most so many is bounded."""

BOUNDED: Mapping[str, int] = MappingProxyType(
    {
        "rotorid.models.expression._TOKEN": 10_000,  # an expression is refused beyond
        "rotorid.models.expression._NAME": 10_000,
        "rotorid.cli.inspect:'\\\\d+$'": 64,  # names of channels
    }
)
"""Patterns that are given texts of a bounded length alone, and the length."""

TABLES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "rotorid.io.ardupilot.status:word": tuple(word for word, _ in _FIRMWARES),
        "rotorid.io.ros.bag:rule.topic": tuple({rule.topic for rule in RULES if rule.topic}),
    }
)
"""Places where the patterns of a table are tried one after the other."""

_CALLS = frozenset({"compile", "search", "match", "fullmatch", "findall", "finditer", "split", "sub", "subn"})


def patterns() -> Iterator[tuple[str, str | bytes, int, frozenset[str]]]:
    """Every pattern of the sources with its place and flags; one that is no constant has to have a name of its own."""
    for file in sorted(ROOT.rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if "import re" not in text:
            continue
        module = ".".join(("rotorid", *file.relative_to(ROOT).with_suffix("").parts))
        tree = ast.parse(text)
        named = {
            target.id: node.value
            for node in tree.body
            if isinstance(node, ast.Assign) and _is_call(node.value)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for name in named:
            compiled = getattr(import_module(module), name)
            yield f"{module}.{name}", compiled.pattern, compiled.flags, _methods(tree, name)
        elsewhere = [node for node in ast.walk(tree) if _is_call(node) and node not in named.values()]
        for node in elsewhere:
            assert isinstance(node, ast.Call)
            first = node.args[0]
            constant = isinstance(first, ast.Constant) and isinstance(first.value, str | bytes)
            assert isinstance(node.func, ast.Attribute)
            place = f"{module}:{ast.unparse(first)}"
            if place in TABLES:
                for pattern in TABLES[place]:
                    yield f"{place} {pattern}", pattern, 0, frozenset({node.func.attr})
            else:
                yield place, first.value if constant else "", 0, frozenset({node.func.attr})  # type: ignore[attr-defined]


def _methods(tree: ast.Module, name: str) -> frozenset[str]:
    """What is done with a pattern in its module; anything may be where nothing is."""
    done = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == name
    }
    return frozenset(done & _CALLS) or _CALLS


def _is_call(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and isinstance(node.func.value, ast.Name)
        and node.func.value.id == "re"
        and node.func.attr in _CALLS
    )


FOUND = {place: (pattern, flags, methods) for place, pattern, flags, methods in patterns()}

NOT_FOREIGN = frozenset(
    {
        "rotorid.signal.motors:f'{prefix}(\\\\d+)'",  # names of channels of the package
        "rotorid.signal.autopilot_filters:chain.source",  # patterns of the package on sources that its readers write
        "rotorid.signal.autopilot_filters:_COMMANDS",
        "rotorid.signal.autopilot_filters:_GYRO",
        "rotorid.io.px4.writer:INTEGERS",  # parameters of a vehicle of the library
        "rotorid.io.betaflight.blackbox:re.escape(MAGIC)",  # no repetition
        # A header that the export has just written itself.
        "rotorid.exports.fmu:f'\\\\b{name}(?:\\\\[\\\\] = {{([^}}]*)}}| (\\\\S+))'",
    }
)
"""Places whose pattern is no constant, and why it is none of a file."""


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


def cost_s(apply: Callable[[Any], object], given: str | bytes) -> float:
    """Seconds of processor time; the least of three where they are not far from the limit: others compute beside."""
    least = math.inf
    for _ in range(3):
        begun = time.process_time()
        apply(given)
        least = min(least, time.process_time() - begun)
        if not LONGEST_S <= least < 4.0 * LONGEST_S:
            break
    return least


def slowest(pattern: str | bytes, flags: int, methods: frozenset[str], most: int = SIZES[-1]) -> tuple[float, str]:
    """The longest time for any of the texts, and the text; no more texts once one takes too long."""
    compiled = re.compile(pattern, flags & ~re.UNICODE if isinstance(pattern, bytes) else flags)
    worst = 0.0, ""
    for size in (*(size for size in SIZES if size <= most), most):
        for text in attacks(pattern, size):
            given: Any = text.encode("latin-1", errors="replace") if isinstance(pattern, bytes) else text
            # All others search from place to place.
            names = {name if name in ("fullmatch", "match") else "search" for name in methods}
            for apply in (getattr(compiled, name) for name in names):
                taken = cost_s(apply, given)
                worst = max(worst, (taken, f"{text[:40]!r} of {len(text)} letters"))
                if taken > LONGEST_S:
                    return worst
    return worst


@pytest.mark.parametrize("place", sorted(FOUND))
def test_no_pattern_takes_more_than_linear_time(place: str) -> None:
    pattern, flags, methods = FOUND[place]
    if place in NOT_FOREIGN:
        return
    assert pattern, f"{place} is no constant: give it a name at the top of its module, or say why it is harmless"
    taken_s, text = slowest(pattern, flags, methods, BOUNDED.get(place, SIZES[-1]))
    assert taken_s < LONGEST_S, f"{pattern!r} takes {taken_s:.2f} s for {text}"


@pytest.mark.parametrize(
    "pattern",
    [
        r"(?:\d{1,18},? ?)*x",  # exponential: a digit may end one size or another
        rb"\xff{16,}\Z",  # quadratic: every beginning is tried
        r"\d+\.?\d*;",
    ],
)
def test_patterns_that_take_their_time_are_told(pattern: str | bytes) -> None:
    taken_s, _ = slowest(pattern, 0, frozenset({"search"}), most=80_000)
    assert taken_s > LONGEST_S
