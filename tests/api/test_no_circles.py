"""No module imports another that imports it, by whatever way; not even inside of functions."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter

import pytest
from tests.sources import SOURCE, parts, syntax

MODULES = {
    ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts): path
    for path in SOURCE.rglob("*.py")
    if path.name != "__init__.py"
}


def imports(node: ast.AST) -> Iterator[str]:
    """Modules that a part of a program imports when it runs; what only a type checker reads does not count."""
    for child in parts(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if isinstance(child, ast.ImportFrom) and child.module:
            yield from {child.module, *(f"{child.module}.{one.name}" for one in child.names)} & MODULES.keys()
        yield from imports(child)


def test_no_module_imports_what_imports_it() -> None:
    graph = {name: set(imports(syntax(path))) for name, path in MODULES.items()}
    assert sum(map(len, graph.values())) > 1000
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"a circle: {' -> '.join(reversed(error.args[1]))}")


def test_an_import_in_a_function_counts_and_one_for_types_does_not() -> None:
    text = (
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from rotorid.units import HZ\n"
        "def f():\n    from rotorid.flying import settings\n    from rotorid.frames import body_rates\n"
    )
    assert set(imports(ast.parse(text))) == {"rotorid.flying.settings", "rotorid.frames"}
