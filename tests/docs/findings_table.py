"""The list of findings in ``docs/results.md``, written from the registry: ``python tests/docs/findings_table.py``."""

from __future__ import annotations

import re
from pathlib import Path

from rotorid.data import KINDS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "results.md"
TABLE = re.compile(r"(?<=<!-- written by tests/docs/findings_table.py -->\n)(?:[|-].*\n)*")


def findings_table() -> str:
    """One line a kind: the word that scripts rely on, its usual severity if it is no warning, what it means."""
    named = {word: "" if kind.severity == "warning" else f" ({kind.severity})" for word, kind in sorted(KINDS.items())}
    return "".join(f"- `{word}`{severity}: {KINDS[word].meaning}\n" for word, severity in named.items())


def refilled(text: str) -> str:
    """The page with the list of today."""
    return TABLE.sub(lambda _: findings_table(), text)


if __name__ == "__main__":
    PAGE.write_text(refilled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
