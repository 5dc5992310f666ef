"""Scripts rely on the kinds of findings: one registry knows them all, and the docs name every one."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from tests.docs.findings_table import PAGE, findings_table, refilled
from tests.sources import nodes

from rotorid.data.findings import KINDS

ROOT = Path(__file__).resolve().parents[2]
CONSTRUCTORS = {"remark", "warn", "refusal"}


def constructors(function: ast.expr) -> bool:
    names = {node.id for node in ast.walk(function) if isinstance(node, ast.Name)}
    return bool(names & CONSTRUCTORS) and not isinstance(function, ast.Attribute)


def kinds_in(path: Path) -> Iterator[str]:
    """Kinds that stand as words in calls of the constructors."""
    for node in nodes(path):
        if isinstance(node, ast.Call) and node.args and constructors(node.func):
            first = node.args[0]
            choices = [first.body, first.orelse] if isinstance(first, ast.IfExp) else [first]
            yield from (one.value for one in choices if isinstance(one, ast.Constant) and isinstance(one.value, str))


def test_every_kind_that_the_package_says_is_registered() -> None:
    said = {kind for path in (ROOT / "src").rglob("*.py") for kind in kinds_in(path)}
    assert len(said) > 70
    assert said <= set(KINDS), f"register {sorted(said - set(KINDS))} in rotorid.data.findings"


def test_the_table_in_the_docs_is_that_of_the_registry() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert findings_table() in page
    assert refilled(page) == page, "renew it with `python tests/docs/findings_table.py`"


def test_kinds_have_a_heading_and_a_meaning() -> None:
    for name, kind in KINDS.items():
        assert re.fullmatch(r"[a-z_]+", name)
        assert kind.heading[0].isupper()
        assert not kind.heading.endswith(".")
        assert kind.meaning.endswith(".")
