"""The table of findings in ``docs/results.md``, written from the registry: ``python tests/docs/findings_table.py``."""

from __future__ import annotations

import re
from pathlib import Path

from rotorid.data import KINDS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "results.md"
TABLE = re.compile(r"(?<=<!-- written by tests/docs/findings_table.py -->\n)(?:\|.*\n)*")


def findings_table() -> str:
    """One row a kind: the word that scripts rely on, its usual severity, what it says."""
    rows = [f"| `{word}` | {kind.severity} | {kind.meaning} |" for word, kind in sorted(KINDS.items())]
    return "\n".join(["| kind | usually | says |", "|---|---|---|", *rows]) + "\n"


def refilled(text: str) -> str:
    """The page with the table of today."""
    return TABLE.sub(lambda _: findings_table(), text)


if __name__ == "__main__":
    PAGE.write_text(refilled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
