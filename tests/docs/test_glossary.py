"""The glossary explains the numbers of loops and margins that a review shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rotorid.data.quantities import BY_PART, Part

PAGE = Path(__file__).resolve().parents[2] / "docs" / "site" / "pages" / "glossary.md"
ENTRY = re.compile(r"^(.+)\n: (.+)$", re.MULTILINE)


@pytest.mark.parametrize("part", ["loops", "margins"])
def test_every_number_has_its_entry(part: Part) -> None:
    terms = " ".join(term.lower() for term, _ in ENTRY.findall(PAGE.read_text("utf-8")))
    words = {word for row in BY_PART[part].values() for word in re.findall(r"[a-z-]{4,}", row.words.lower())}
    assert not sorted(word for word in words if word not in terms)


def test_entries_are_short_and_unique() -> None:
    entries = ENTRY.findall(PAGE.read_text("utf-8"))
    assert len({term for term, _ in entries}) == len(entries)
    assert not [term for term, meaning in entries if len(meaning.split()) > 30]
