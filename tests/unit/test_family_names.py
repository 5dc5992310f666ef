"""Outside their rooms nothing compares the name of a family of models, or of one of its models.

The rooms are ``rotorid/models``, where models are made and recognized, and the rooms of methods named in :data:`ROOMS`.
Everywhere else a question about a model is asked of its family. What counts as a comparison: ``==``, ``!=``, ``in``,
``startswith``, ``fullmatch`` and their like, a ``case``, and a dictionary by names, as soon as a literal or a constant
in it names a family (``rate.``, ``black_box:``) or a model of the library (``hover.lateral``, ``MODEL``).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import rotorid
from rotorid.models.library import RATE_AXES, RESPONSE_MODELS, model_names, nonlinear_model_names

SOURCE = Path(rotorid.__file__).parent

ROOMS = ("models/",)

ALLOWED: dict[str, int] = {
    "cli/identify.py": 6,
    "cli/models.py": 9,
    "fleets/runs.py": 1,
    "pipeline/checking/candidate.py": 2,
    "pipeline/designs.py": 1,
    "pipeline/fits/frequency/fit.py": 1,
    "pipeline/fits/frequency/soundness.py": 2,
    "pipeline/fits/methods.py": 2,
    "pipeline/flight_settings.py": 2,
    "pipeline/identification.py": 2,
    "pipeline/inspection.py": 4,
    "pipeline/joined.py": 2,
    "pipeline/own_vehicles.py": 1,
    "pipeline/preparation/inverse.py": 1,
    "pipeline/preparation/resolve.py": 11,
    "pipeline/preparation/selection.py": 1,
    "pipeline/preparation/supports.py": 3,
    "pipeline/settings.py": 4,
    "pipeline/several.py": 3,
    "pipeline/stitching.py": 3,
    "pipeline/tracking.py": 1,
    "planning/expected.py": 1,
    "vehicles/hummingbird.py": 1,
}
"""File to how many comparisons it holds."""

_NAMES = frozenset(
    {*RATE_AXES, *RESPONSE_MODELS, *model_names(), *nonlinear_model_names(), "physical.motors", "black_box:auto"}
)
_PREFIXES = tuple({f"{name.partition('.')[0]}." for name in _NAMES if "." in name})
_MADE = ("black_box:", "transfer:")
_LISTS = frozenset({"RATE_AXES", "RESPONSE_MODELS", "OF_MOTORS", "ALSO_OF_MOTORS", "OF_HOVER", "ALL"})
"""Constants of models and of their choices whose value holds no such name as it is written."""
_LISTINGS = frozenset({"model_names", "nonlinear_model_names"})
_TEXT = frozenset({"startswith", "endswith", "removeprefix", "partition", "fullmatch", "match", "index", "count"})


def names_family(text: object) -> bool:
    """Whether a text is the name of a model, the prefix of a family, or the pattern of one."""
    return isinstance(text, str) and (text in _NAMES or text in _PREFIXES or text.startswith(_MADE))


def _module(path: Path) -> str:
    return ".".join(("rotorid", *path.relative_to(SOURCE).with_suffix("").parts))


@cache
def _trees() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(SOURCE.rglob("*.py"))}


@cache
def _constants() -> frozenset[tuple[str, str]]:
    """Module and name of each constant that is made of names of models, or of other such constants."""
    found: frozenset[tuple[str, str]] = frozenset()
    while True:
        more = found | {
            (_module(path), name)
            for path, tree in _trees().items()
            for name in _assigned(tree, _visible(path, tree, found))
        }
        if more == found:
            return found
        found = more


def _assigned(tree: ast.Module, known: frozenset[str]) -> Iterator[str]:
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        value = getattr(node, "value", None)
        if value is not None and isinstance(targets[0], ast.Name) and _names(value, known):
            yield targets[0].id


def _names(node: ast.AST, constants: frozenset[str]) -> bool:
    """Whether an expression holds a literal or a constant that names a family or a model."""
    if isinstance(node, ast.Constant):
        return names_family(node.value)
    if isinstance(node, ast.Name):
        return node.id in constants
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _LISTINGS:
        return True
    # What is looked up in a table of models is an answer, no name.
    parts = [node.slice] if isinstance(node, ast.Subscript) else ast.iter_child_nodes(node)
    return any(_names(part, constants) for part in parts)


def _visible(path: Path, tree: ast.Module, constants: frozenset[tuple[str, str]]) -> frozenset[str]:
    """Constants that name models, as a file calls them."""
    own = {name for module, name in constants if module == _module(path)}
    imported = {
        one.asname or one.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for one in node.names
        if (node.module, one.name) in constants
    }
    return frozenset(own | imported | _LISTS)


def comparisons(node: ast.AST, constants: frozenset[str]) -> Iterator[ast.AST]:
    """The outermost comparisons with the name of a family or a model."""
    if _compares(node, constants):
        yield node
        return
    for child in ast.iter_child_nodes(node):
        yield from comparisons(child, constants)


def _compares(node: ast.AST, constants: frozenset[str]) -> bool:
    if isinstance(node, ast.Compare):
        return _names(node, constants)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in _TEXT:
        return _names(node, constants)
    if isinstance(node, ast.Dict):
        return any(key is not None and _names(key, constants) for key in node.keys)
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id != "Annotated":
        return _names(node.slice, constants)
    return isinstance(node, ast.match_case) and _names(node.pattern, constants)


@cache
def counted() -> dict[str, tuple[str, ...]]:
    """File to the comparisons in it, as ``line: text``."""
    found = {
        path.relative_to(SOURCE).as_posix(): tuple(
            f"{getattr(one, 'lineno', 0)}: {ast.unparse(one)}"
            for one in comparisons(tree, _visible(path, tree, _constants()))
        )
        for path, tree in _trees().items()
    }
    return {name: there for name, there in found.items() if there and not name.startswith(ROOMS)}


def test_no_name_of_a_family_is_compared_outside_its_rooms() -> None:
    found = {name: len(there) for name, there in counted().items()}
    new = {name: counted()[name] for name in found if found[name] > ALLOWED.get(name, 0)}
    assert not new, f"ask for what the model is instead: {new}"
    assert found == ALLOWED, "fewer than are listed: shorten the list"


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("name == 'rate.roll'", 1),
        ("name.startswith('rate.')", 1),
        ("name in ('hover.lateral', other)", 1),
        ("_BOX.fullmatch('black_box:2') is not None", 1),
        ("{'rig.roll': 1}", 1),
        ("name in model_names() and name != MODEL", 2),
        ("match name:\n    case 'drag.linear':\n        pass", 1),
        ("f'rate.{axis}'", 0),
        ("path == 'flight.csv' or name == 'response.json'", 0),
    ],
)
def test_the_counter_counts(text: str, count: int) -> None:
    assert len(list(comparisons(ast.parse(text), frozenset({"MODEL", "_BOX"})))) == count


if __name__ == "__main__":
    for file, lines in counted().items():
        print(file, *lines, sep="\n    ")
    print(sum(len(lines) for lines in counted().values()))
