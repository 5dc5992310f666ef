"""Version, CHANGELOG and tag agree, and a release says what is in it."""

from __future__ import annotations

from itertools import pairwise

import pytest
from tests.docs.release import CHANGELOG, UNRELEASED, notes, sections

from rotorid import __version__

TEXT = "# Changes\n\n## Unreleased\n\n## 1.1.0 (2026-11-29)\n\n### New\n\n- All.\n\n## 1.0.0 (2026-11-22)\n"


def test_the_newest_dated_section_is_that_of_the_package_and_what_is_not_released_is_on_top() -> None:
    unreleased, *released = sections(CHANGELOG.read_text("utf-8"))
    assert (unreleased.version, unreleased.released) == (UNRELEASED, None)
    assert released[0].version == __version__
    days = [one.released for one in released if one.released is not None]
    assert len(days) == len(released)
    assert all(newer >= older for newer, older in pairwise(days))


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
