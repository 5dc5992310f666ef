"""Outside their rooms nothing compares the name of a family of models, or of one of its models.

The rooms are ``rotorid/models``, where models are made and recognized, and ``identifying/families.py``, where each
family has its method and its choices. Everywhere else a question about a model is asked of its family. What counts as
a comparison: ``==``, ``!=``, ``in``, ``startswith``, ``fullmatch`` and their like, a ``case``, and a dictionary by
names, as soon as a literal or a constant in it names a family (``rate.``, ``RATE``) or a model of the library.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from tests.sources import SOURCE, nodes, parts, syntax

from rotorid.models import families
from rotorid.models.families import Family
from rotorid.models.library import RATE_AXES, RESPONSE_MODELS, model_names, nonlinear_model_names

ROOMS = ("models/", "identifying/families.py")

ALLOWED: dict[str, tuple[int, str]] = {
    "flying/stitching.py": (4, "longitudinal and lateral motion of one vehicle are what is stitched, and nothing else"),
    "settings/models.py": (1, "the word for all models, asked in one function"),
    "vehicles/hummingbird.py": (1, "the published values of one vehicle, by the models that have them"),
}
"""File to how many comparisons it holds, and why."""

_NAMES = frozenset(
    {*RATE_AXES, *RESPONSE_MODELS, *model_names(), *nonlinear_model_names()}
    | {"physical.motors", "physical.flight", "black_box:auto"}
)
_PREFIXES = tuple({f"{name.partition('.')[0]}." for name in _NAMES if "." in name})
_MADE = ("black_box:", "transfer:")
_LISTS = frozenset({"RATE_AXES", "RESPONSE_MODELS", "ALL"})
"""Constants of models whose value holds no such name as it is written."""
_LISTINGS = frozenset({"model_names", "nonlinear_model_names"})
_TEXT = frozenset(
    {"startswith", "endswith", "removeprefix", "partition", "fullmatch", "match", "index", "count", "has"}
)


def names_family(text: object) -> bool:
    """Whether a text is the name of a model, the prefix of a family, or the pattern of one."""
    return isinstance(text, str) and (text in _NAMES or text in _PREFIXES or text.startswith(_MADE))


@cache
def _module(path: Path) -> str:
    return ".".join(("rotorid", *path.relative_to(SOURCE).with_suffix("").parts))


@cache
def _trees() -> dict[Path, ast.Module]:
    return {path: syntax(path) for path in sorted(SOURCE.rglob("*.py"))}


@cache
def _constants() -> frozenset[tuple[str, str]]:
    """Module and name of each constant that is made of names of models, or of other such constants."""
    found = frozenset((families.__name__, name) for name, one in vars(families).items() if isinstance(one, Family))
    while True:
        more = found | {
            (_module(path), name) for path, tree in _trees().items() for name in _assigned(tree, _visible(path, found))
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
    # What is looked up in a table of models is an answer, no name; one of a list of names, by its number, is a name.
    if isinstance(node, ast.Subscript) and not isinstance(node.slice, ast.Constant):
        return _names(node.slice, constants)
    return any(_names(part, constants) for part in parts(node))


@cache
def _imported(path: Path) -> tuple[tuple[str, str, str], ...]:
    """Module, name and name in the file of everything that a file imports by name."""
    return tuple(
        (node.module or "", alias.name, alias.asname or alias.name)
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    )


def _visible(path: Path, constants: frozenset[tuple[str, str]]) -> frozenset[str]:
    """Constants that name models, as a file calls them."""
    here = _module(path)
    own = {name for module, name in constants if module == here}
    imported = {shown for module, name, shown in _imported(path) if (module, name) in constants}
    return frozenset(own | imported | _LISTS)


def comparisons(node: ast.AST, constants: frozenset[str]) -> Iterator[ast.AST]:
    """The outermost comparisons with the name of a family or a model."""
    rest = [node]
    while rest:
        node = rest.pop()
        if _compares(node, constants):
            yield node
        else:
            rest.extend(parts(node))


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
            for one in comparisons(tree, _visible(path, _constants()))
        )
        for path, tree in _trees().items()
    }
    return {name: there for name, there in found.items() if there and not name.startswith(ROOMS)}


def test_no_name_of_a_family_is_compared_outside_its_rooms() -> None:
    found = {name: len(there) for name, there in counted().items()}
    allowed = {name: count for name, (count, _) in ALLOWED.items()}
    new = {name: counted()[name] for name in found if found[name] > allowed.get(name, 0)}
    assert not new, f"ask the family of the model instead (rotorid.models.families): {new}"
    assert found == allowed, "fewer than are listed: shorten the list"


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
