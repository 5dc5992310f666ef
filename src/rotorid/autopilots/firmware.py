"""The version in the name of a firmware, as it introduces itself in a log or as a person types it."""

from __future__ import annotations

import re

Version = tuple[int, int]
"""Major and minor number."""

_VERSION = re.compile(r"(\d{1,4})\.(\d{1,4})")


def version_of(firmware: str) -> Version | None:
    """Major and minor number of a firmware's name, or ``None`` where it has none.

    Examples
    --------
    >>> version_of("ArduCopter V4.6.2 (3fc7011a)"), version_of("Betaflight 2025.12.0"), version_of("PX4")
    ((4, 6), (2025, 12), None)
    """
    found = _VERSION.search(firmware)
    return (int(found[1]), int(found[2])) if found else None


def versions_of(text: str) -> tuple[Version, ...]:
    """All versions in a text.

    Examples
    --------
    >>> versions_of("Betaflight 2025.12, 2026.6")
    ((2025, 12), (2026, 6))
    """
    return tuple((int(major), int(minor)) for major, minor in _VERSION.findall(text))


def is_before(firmware: str, version: Version) -> bool:
    """Whether firmware is known to be older; one that does not say its version is taken for today's.

    Examples
    --------
    >>> is_before("PX4 v1.6.5", (1, 8)), is_before("PX4", (1, 8))
    (True, False)
    """
    found = version_of(firmware)
    return found is not None and found < version
