"""What a release says of itself: ``python -m tests.docs.release v1.2.3`` prints its section of the CHANGELOG.

It refuses where the tag or the newest section of the CHANGELOG is of another version than the package, where that
section has no date, or where changes are listed as not released.
"""

from __future__ import annotations

import re
import sys
from datetime import date
from pathlib import Path
from typing import NamedTuple

from rotorid import __version__

CHANGELOG = Path(__file__).resolve().parents[2] / "CHANGELOG.md"
UNRELEASED = "Unreleased"


class Section(NamedTuple):
    """A release in the CHANGELOG: ``## 1.2.3 (2026-11-22)`` and what is below."""

    version: str
    released: date | None
    text: str


def sections(changelog: str) -> list[Section]:
    r"""Sections from the top, the first of them what is not released yet.

    Examples
    --------
    >>> [(one.version, str(one.released)) for one in sections("## Unreleased\n\n## 1.0.0 (2026-11-22)\nAll.")]
    [('Unreleased', 'None'), ('1.0.0', '2026-11-22')]
    """
    found = re.split(r"^## (\S+)(?: \((\d{4}-\d\d-\d\d)\))?$", changelog, flags=re.MULTILINE)[1:]
    parts = zip(found[::3], found[1::3], found[2::3], strict=True)
    return [Section(version, date.fromisoformat(day) if day else None, text.strip()) for version, day, text in parts]


def notes(tag: str, changelog: str, version: str) -> str:
    """What a tag releases.

    Raises
    ------
    ValueError
        Tag, package and CHANGELOG do not agree.
    """
    unreleased, newest, *_ = sections(changelog)
    if tag != f"v{version}":
        raise ValueError(f"the tag is {tag}, the package {version}")
    if newest.version != version or newest.released is None:
        raise ValueError(f"the newest section of the CHANGELOG is {newest.version} ({newest.released}), not {version}")
    if unreleased.text:
        raise ValueError(f"the CHANGELOG lists changes that are not in {version}")
    return newest.text


if __name__ == "__main__":
    try:
        print(notes(sys.argv[1], CHANGELOG.read_text(encoding="utf-8"), __version__))
    except ValueError as error:
        sys.exit(str(error))
