"""The tests of what changed: ``make quick`` runs what this prints.

A test file belongs to a change when it is changed itself, or imports a changed module or its package. Doctests of
changed modules run too. Long studies of real flights (``tests/reference``, ``tests/twins``) are left to ``make test``.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src"
LONG = ("tests/reference", "tests/twins", "tests/peers", "tests/browser", "tests/docs")


def changed(base: str) -> set[Path]:
    """Python files that differ from a commit, or that git does not know yet."""
    told = ("git", "diff", "--name-only", base), ("git", "ls-files", "--others", "--exclude-standard")
    lines = (subprocess.run(call, cwd=ROOT, check=True, capture_output=True, text=True).stdout for call in told)
    paths = {ROOT / name for text in lines for name in text.split()}
    return {path for path in paths if path.suffix == ".py" and path.exists()}


def module_of(path: Path) -> str:
    """Dotted name of a file below ``src`` or the root."""
    folder = SOURCE if path.is_relative_to(SOURCE) else ROOT
    parts = path.relative_to(folder).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_by(path: Path) -> Iterator[str]:
    """Dotted names that a file imports, with the names it takes from them."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def tests_of(change: set[Path]) -> list[str]:
    """Test files and modules with doctests that belong to a change, as pytest takes them."""
    modules = {module_of(path) for path in change}
    tests = {path for path in change if path.is_relative_to(ROOT / "tests")}
    for path in (ROOT / "tests").rglob("test_*.py"):
        if not path.relative_to(ROOT).as_posix().startswith(LONG) and modules & set(imported_by(path)):
            tests.add(path)
    doctests = {path for path in change if path.is_relative_to(SOURCE) and ">>>" in path.read_text(encoding="utf-8")}
    chosen = {path for path in tests if path.name.startswith("test_")} | doctests
    return sorted(path.relative_to(ROOT).as_posix() for path in chosen)


if __name__ == "__main__":
    print(*(tests_of(changed(sys.argv[1] if len(sys.argv) > 1 else "HEAD")) or ["tests/api"]))
