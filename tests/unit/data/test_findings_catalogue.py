"""The catalogue of findings is written for pilots: short headings and meanings in plain words."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest
from tests.api.test_findings_are_documented import kinds_in
from tests.phrases import PATTERNS

from rotorid.data.findings import KINDS, Kind

SOURCE = Path(__file__).resolve().parents[3] / "src"
COUNTING = (
    *("data", "flights", "fits", "fitting", "identifying", "checking", "results", "loops", "verification"),
    *("uncertainty", "search", "reduction"),
)
OF_THE_PROJECT_OUTSIDE = {"ArduPilot", "PX4", "Betaflight"}
LONGEST_HEADING, LONGEST_MEANING = 6, 25
PLURAL_BY_HAND = re.compile(
    r"""(['"])e?s\1 \* ?\(|(['"])s\2 if |\bif .{1,40} == 1 else (['"])e?s\3|[a-z]{4}\(s\)(?= )"""
)

catalogue = pytest.mark.parametrize(("name", "kind"), KINDS.items(), ids=KINDS)


@catalogue
def test_a_heading_is_a_few_words_in_sentence_case(name: str, kind: Kind) -> None:
    first, *others = kind.heading.split()
    assert len(others) < LONGEST_HEADING
    assert first[0].isupper()
    assert all(word == word.lower() or word in OF_THE_PROJECT_OUTSIDE for word in others)
    assert kind.heading[-1] not in ".:;,"


@catalogue
def test_a_meaning_is_one_short_sentence(name: str, kind: Kind) -> None:
    assert len(kind.meaning.split()) <= LONGEST_MEANING
    assert kind.meaning[0].isupper()
    assert re.findall(r"[.!?](?= [A-Z]|$)", kind.meaning) == ["."]


@catalogue
def test_no_entry_uses_a_construction_of_the_old_idiom(name: str, kind: Kind) -> None:
    for text in kind.heading, kind.meaning:
        assert not [fault for fault, pattern in PATTERNS.items() if pattern.search(text)]


def test_every_kind_has_a_heading_of_its_own() -> None:
    assert not [heading for heading, times in Counter(kind.heading for kind in KINDS.values()).items() if times > 1]


def test_the_source_uses_every_kind_of_the_catalogue_and_no_other() -> None:
    texts = [path.read_text(encoding="utf-8") for path in SOURCE.rglob("*.py") if path.name != "findings.py"]
    assert {kind for path in SOURCE.rglob("*.py") for kind in kinds_in(path)} <= set(KINDS)
    assert not [name for name in KINDS if not any(f'"{name}"' in text for text in texts)]


@pytest.mark.parametrize("package", COUNTING)
def test_plural_forms_come_from_the_one_helper(package: str) -> None:
    """``counted`` of :mod:`rotorid.data.display`: "1 log", "2 logs"."""
    lines = [
        f"{path.name}:{number}: {line.strip()}"
        for path in (SOURCE / "rotorid" / package).rglob("*.py")
        if path.name != "display.py"
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if PLURAL_BY_HAND.search(line) and '"""' not in line
    ]
    assert not lines
