"""The program as its own tests read it: each file is parsed once, and nobody changes what comes back."""

from __future__ import annotations

import ast
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1] / "src" / "rotorid"


@contextmanager
def no_collection() -> Iterator[None]:
    """Nothing is searched for garbage inside: in a million parts of syntax, that takes longer than making them."""
    searching = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if searching:
            gc.enable()


def parts(node: ast.AST) -> Iterator[ast.AST]:
    """What ``ast.iter_child_nodes`` gives without signs such as ``ast.Load``, in half the time."""
    for value in vars(node).values():
        if isinstance(value, list):
            for item in value:
                if isinstance(item, ast.AST):
                    yield item
        elif isinstance(value, ast.AST) and not isinstance(value, ast.expr_context):
            yield value


@cache
def _package() -> dict[Path, ast.Module]:
    gc.collect()
    with no_collection():
        trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(SOURCE.rglob("*.py"))}
    # They stay until the end, so that no later search for garbage goes through them.
    gc.freeze()
    return trees


@cache
def syntax(path: Path) -> ast.Module:
    """The syntax tree of a file of the package."""
    return _package().get(path) or ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file of the package, in the order of ``ast.walk``."""
    found: list[ast.AST] = [syntax(path)]
    for node in found:
        found.extend(parts(node))
    return tuple(found)
