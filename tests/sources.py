"""The program as its own tests read it: each file is parsed once, and nobody changes what comes back."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path


@cache
def syntax(path: Path) -> ast.Module:
    """The syntax tree of a file of the package."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file of the package, as ``ast.walk`` gives them."""
    return tuple(ast.walk(syntax(path)))
