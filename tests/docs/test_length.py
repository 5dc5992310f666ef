"""The pages are short: all together, and each by itself."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"])
GOAL, TEXT, EACH = 60_000, 52_000, 6_000
"""Most words of all pages: the goal, as ``wc -w`` counts them; those outside of code; and those of one page."""


def words(page: Path) -> int:
    return len(page.read_text(encoding="utf-8").split())


def words_of_text(page: Path) -> int:
    """Words with a letter or digit outside of code blocks: bars of tables and printed output are not counted."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return sum(bool(re.search(r"\w", word)) for word in text.split())


@pytest.mark.xfail(strict=True, raises=AssertionError, reason="code and output of tutorials are 15 000 words")
def test_all_pages_together_are_short() -> None:
    assert sum(map(words, PAGES)) <= GOAL


def test_the_text_of_all_pages_is_short() -> None:
    assert sum(map(words_of_text, PAGES)) <= TEXT


def test_every_page_is_short() -> None:
    assert {page.name: words(page) for page in PAGES if words(page) > EACH} == {}
