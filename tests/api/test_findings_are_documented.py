"""Scripts rely on the kinds of findings, so the docs name every one."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_every_kind_of_finding_stands_in_the_docs() -> None:
    sources = (path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    kinds = {kind for source in sources for kind in re.findall(r'kind="([a-z_]+)",\n\s+severity', source)}
    documented = set(re.findall(r"`([a-z_]+)`", (ROOT / "docs" / "results.md").read_text(encoding="utf-8")))
    assert len(kinds) > 10
    assert kinds <= documented, f"name {sorted(kinds - documented)} in docs/results.md"
