"""Version, CHANGELOG and tag agree, and a release says what is in it."""

from __future__ import annotations

import pytest
from tests.docs.release import notes

TEXT = "# Changes\n\n## Unreleased\n\n## 1.1.0 (2026-11-29)\n\n### New\n\n- All.\n\n## 1.0.0 (2026-11-22)\n"


def test_a_tag_prints_its_section() -> None:
    assert notes("v1.1.0", TEXT, "1.1.0") == "### New\n\n- All."


@pytest.mark.parametrize(
    ("tag", "text", "version", "words"),
    [
        ("v1.2.0", TEXT, "1.1.0", "the tag is v1.2.0, the package 1.1.0"),
        ("1.1.0", TEXT, "1.1.0", "the tag is 1.1.0"),
        ("v1.2.0", TEXT, "1.2.0", "is 1.1.0 .2026-11-29., not 1.2.0"),
        ("v1.1.0", TEXT.replace(" (2026-11-29)", ""), "1.1.0", "is 1.1.0 .None."),
        ("v1.1.0", TEXT.replace("Unreleased\n", "Unreleased\n\n- More.\n"), "1.1.0", "not in 1.1.0"),
    ],
)
def test_what_does_not_agree_is_not_released(tag: str, text: str, version: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        notes(tag, text, version)
