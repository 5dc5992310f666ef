"""Which ArduPilot it is, by how it introduces itself."""

from __future__ import annotations

import re
from typing import NamedTuple

_COPTER = re.compile(r"(?:ArduCopter|APM:Copter|Copter)\s+V(\d+)\.(\d+)", re.IGNORECASE)
RATE_FROM = (3, 3)
"""The first copter firmware with a ``RATE`` message."""


class Firmware(NamedTuple):
    """What a log says of the firmware that wrote it.

    Parameters
    ----------
    text
        ``ArduCopter V4.5.7 (…)``, as the autopilot introduces itself; empty when it does not.
    copter
        Version of a copter's firmware, or ``None`` when the log does not show it or the vehicle is no copter.
    """

    text: str = ""
    copter: tuple[int, int] | None = None

    def before(self, version: tuple[int, int]) -> bool:
        """Whether it is a copter's firmware that is known to be older than ``version``.

        Examples
        --------
        >>> Firmware("ArduCopter V3.2.1", (3, 2)).before((3, 4)), Firmware().before((3, 4))
        (True, False)
        """
        return self.copter is not None and self.copter < version


def named(text: str) -> Firmware:
    """The firmware that introduces itself like this.

    Examples
    --------
    >>> named("APM:Copter V3.4-rc2 (f46a31d0)").copter, named("ArduPlane V4.5.1").copter
    ((3, 4), None)
    """
    match = _COPTER.search(text)
    return Firmware(text, (int(match[1]), int(match[2])) if match else None)
