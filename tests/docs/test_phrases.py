"""No message, page or document uses a construction of :data:`tests.phrases.FORBIDDEN`."""

from __future__ import annotations

import re

import pytest
from tests.phrases import FORBIDDEN, ROOT, Phrase, phrases

TELLING = re.compile(r"\b(?:told|tells?|untold)\b|_told\b|\bUntold")
MOST_TELLING = 20
"""Lines of the source in which something is told, docstrings and names included."""


def test_no_message_page_or_document_uses_a_forbidden_construction() -> None:
    found = [
        f"{phrase.path}:{phrase.line}: {', '.join(faults)}: {phrase.text[:120]}"
        for phrase in phrases(ROOT / "src", ROOT / "docs", ROOT / "README.md")
        if (faults := phrase.faults())
    ]
    assert found == []


def test_a_share_has_a_space_before_its_sign() -> None:
    spaceless = re.compile(r":\.\d%\}")
    files = (ROOT / "src").rglob("*.py")
    assert not [str(path) for path in files if spaceless.search(path.read_text(encoding="utf-8"))]


def test_the_source_tells_little() -> None:
    """Docstrings, comments and names: a log shows, a message reports, data separate; a pilot is told nothing."""
    files = [path for path in (ROOT / "src").rglob("*") if path.suffix in {".py", ".js", ".html"}]
    lines = [line for path in files for line in path.read_text(encoding="utf-8").splitlines() if TELLING.search(line)]
    assert len(lines) <= MOST_TELLING


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("Of pitch it cannot be told.", "tell"),
        ("the axis rolll came; needed: roll, pitch, yaw.", "needed"),
        ("the axis rolll came", "came"),
        ("p_setpoint holds feedback", "hold"),
        ("An answer that comes of it.", "of it"),
        ("below stands what to fly", "stand"),
        ("a stick beside the rate", "beside"),
        ("The pitch stick rested: gusts alone", "rest"),
        ("roll gives way to a moment", "give way"),
        ("L_p is known to no better than 266 %.", "no better than"),
    ],
)
def test_the_constructions_of_the_guide_are_found(text: str, fault: str) -> None:
    assert fault in FORBIDDEN
    assert fault in Phrase("page", 1, text).faults()


@pytest.mark.parametrize(
    "text",
    [
        "The autopilot holds its altitude.",
        "The log contains no roll stick, so the roll loop cannot be measured.",
        "unknown axis 'rolll'; use roll, pitch or yaw",
        "The data came from two logs.",
    ],
)
def test_plain_sentences_pass(text: str) -> None:
    assert Phrase("page", 1, text).faults() == []
