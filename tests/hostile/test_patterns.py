"""Every regular expression of the package against texts that are made to keep it busy: none takes more than linear
time.

The patterns are found by walking the sources, so that a new one is tried without a word, and each is a test by its own
name: the list of the tests is the list of the patterns. Where a caller bounds the length of the text, the table below
says so.
"""

from __future__ import annotations

import ast
import os
import pickle
import re
import select
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

import pytest
from tests.hostile.patterns_child import SIZES, Case

import rotorid
from rotorid.benchmarking.catalog import BENCHMARKS
from rotorid.benchmarking.flights import _PACKED
from rotorid.io.ardupilot.status import _FIRMWARES
from rotorid.io.ros.bag import RULES

ROOT = Path(rotorid.__file__).parent
REPOSITORY = Path(__file__).resolve().parents[2]
HUNG_S, TOLD_S = 30.0, 0.5
"""A linear pattern takes some milliseconds for the largest size, a quadratic one minutes, and one with two ways for a
letter hours for the third: what has not ended by then hangs. A pattern that is to hang needs to be waited for less."""
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
        'rotorid.models.equations:f"(?<![\\\\w.]){re.escape(name)}(?![\\\\w\'])"': (r"(?<![\w.])u(?![\w'])",),
        "rotorid.io.ardupilot.status:word": tuple(word for word, _ in _FIRMWARES),
        "rotorid.benchmarking.flights:benchmark.pattern + _PACKED": tuple(
            one.pattern + _PACKED for one in BENCHMARKS.values()
        ),
        "rotorid.io.ros.bag:rule.topic": tuple({rule.topic for rule in RULES if rule.topic}),
    }
)
"""Places where the patterns of a table are tried one after the other."""

_CALLS = frozenset({"compile", "search", "match", "fullmatch", "findall", "finditer", "split", "sub", "subn"})


def patterns() -> Iterator[tuple[str, str | bytes, int, frozenset[str]]]:
    """Every pattern of the sources with its place and flags; one that is no constant has to have a name of its own."""
    for file in sorted(ROOT.rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if not re.search(r"\bimport re\b", text):
            continue
        module = ".".join(("rotorid", *file.relative_to(ROOT).with_suffix("").parts))
        tree = ast.parse(text)
        nodes = list(ast.walk(tree))
        named = {
            target.id: node.value
            for node in tree.body
            if isinstance(node, ast.Assign) and _is_call(node.value)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for name in named:
            compiled = getattr(import_module(module), name)
            yield f"{module}.{name}", compiled.pattern, compiled.flags, _methods(nodes, name)
        elsewhere = [node for node in nodes if _is_call(node) and node not in named.values()]
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


def _methods(nodes: Sequence[ast.AST], name: str) -> frozenset[str]:
    """What is done with a pattern in its module; anything may be where nothing is."""
    done = {
        node.attr
        for node in nodes
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
        "rotorid.models.families:self.pattern",  # names of models, in patterns of the package
        "rotorid.autopilots.passages:chain.source",  # patterns of the package on sources that its readers write
        "rotorid.autopilots.betaflight.filters:_COMMANDS",
        "rotorid.autopilots.betaflight.filters:_GYRO",
        "rotorid.io.px4.writer:INTEGERS",  # parameters of a vehicle of the library
        "rotorid.io.betaflight.blackbox:re.escape(MAGIC)",  # no repetition
        # Names of parameters, escaped: no repetition either.
        "rotorid.report.design:f\"({'|'.join((re.escape(name) for name in names))})\"",
        # A header that the export has just written itself.
        "rotorid.exports.fmu:f'\\\\b{name}(?:\\\\[\\\\] = {{([^}}]*)}}| (\\\\S+))'",
    }
)
"""Places whose pattern is no constant, and why it is none of a file."""


def hanging(cases: Sequence[Case], limit_s: float) -> dict[int, str]:
    """Numbers of the patterns that do not come to an end in a child, and the text that each is busy with."""
    found: dict[int, str] = {}
    begin = 0
    while begin < len(cases):
        words = [sys.executable, "-m", "tests.hostile.patterns_child"]
        with subprocess.Popen(words, cwd=REPOSITORY, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as child:
            assert child.stdin is not None
            assert child.stdout is not None
            child.stdin.write(pickle.dumps((begin, cases[begin:])))
            child.stdin.close()
            said = b""
            # The child itself has as long as it needs until it speaks.
            while select.select([child.stdout], [], [], limit_s if said else HUNG_S)[0]:
                more = os.read(child.stdout.fileno(), 1 << 16)
                if not more:
                    break
                said = (said + more)[-(1 << 16) :]
            else:
                child.kill()
                number, _, text = said.decode().splitlines()[-1].partition(" ")
                found[int(number)] = text
                begin = int(number) + 1
                continue
        assert child.returncode == 0
        break
    return found


@pytest.fixture(scope="module")
def busy() -> dict[str, str]:
    """Places whose pattern hangs, with the text."""
    places = sorted(place for place in FOUND if place not in NOT_FOREIGN and FOUND[place][0])
    cases = [(*FOUND[place], BOUNDED.get(place, SIZES[-1])) for place in places]
    return {places[number]: text for number, text in hanging(cases, HUNG_S).items()}


@pytest.mark.parametrize("place", sorted(FOUND))
def test_no_pattern_takes_more_than_linear_time(place: str, busy: dict[str, str]) -> None:
    if place in NOT_FOREIGN:
        return
    assert FOUND[place][0], (
        f"{place} is no constant: give it a name at the top of its module, or say why it is harmless"
    )
    assert place not in busy


def test_patterns_that_take_their_time_are_told() -> None:
    taking = (
        r"(?:\d{1,18},? ?)*x",  # exponential: a digit may end one size or another
        rb"\xff{16,}\Z",  # quadratic: every beginning is tried
        r"\d+\.?\d*;",
    )
    cases: list[Case] = [(pattern, 0, frozenset({"search"}), SIZES[-1]) for pattern in (*taking, r"\d;")]
    assert set(hanging(cases, TOLD_S)) == {0, 1, 2}
