"""The order of logs by their names: dates in them, else numbers as people sort them."""

from __future__ import annotations

import re

_STAMP = re.compile(
    r"(?<!\d)(20[0-4]\d)[-_.]?([01]?\d)[-_.]?([0-3]?\d)"
    r"(?:[-_ T/]{1,3}([0-2]?\d)[-_.:h]?([0-5]\d)[-_.:m]?([0-5]\d))?(?!\d)",
    re.ASCII,
)
_NUMBER = re.compile(r"([0-9]{1,18})")


def time_of(address: str) -> str:
    """Date of a log from its name or folder: an ISO date, with the time where there is one.

    Examples
    --------
    >>> time_of("logs/log_7_2025-3-9-14-05-59.ulg"), time_of("2024-05-01/12_33_10.ulg")
    ('2025-03-09T14:05:59', '2024-05-01T12:33:10')
    >>> time_of("20250309_140559.bin"), time_of("00000012.BIN")
    ('2025-03-09T14:05:59', '')
    """
    last = None
    for found in _STAMP.finditer("/".join(address.replace("\\", "/").split("/")[-2:])):
        year, month, day, hour, minute, second = found.groups()
        if not (1 <= int(month) <= 12 and 1 <= int(day) <= 31 and int(hour or 0) < 24):
            continue
        date = f"{year}-{int(month):02d}-{int(day):02d}"
        stamp = f"{date}T{int(hour):02d}:{minute}:{second}" if hour else date
        last = stamp if last is None or len(stamp) > len(last) else last
    return last or ""


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """A name as people sort it.

    Examples
    --------
    >>> sorted(["log10", "log9"], key=natural)
    ['log9', 'log10']
    """
    # Superscripts and the digits of other scripts are letters here: some are digits without a value.
    parts = filter(None, _NUMBER.split(name))
    return tuple((0, int(part), "") if _NUMBER.fullmatch(part) else (1, 0, part) for part in parts)
