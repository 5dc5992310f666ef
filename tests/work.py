"""How much work a call is, counted instead of timed: the same on every machine, however busy it is."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType


def calls(job: Callable[[], object]) -> int:
    """Functions that a job calls, those of Python and those written in C.

    Work inside a function written in C is not seen: a sort of a large array counts as a sort of a small one.

    Examples
    --------
    >>> calls(lambda: [abs(n) for n in range(100)]) - calls(lambda: [abs(n) for n in range(50)])
    50
    """
    count = 0

    def counted(frame: FrameType, event: str, argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(counted)
    try:
        job()
    finally:
        sys.setprofile(before)
    return count


def require_linear(job: Callable[[int], object], *, size: int) -> None:
    """Twice the input is at most two and a half times the work, beyond what the first call prepares."""
    job(size)
    one, two = calls(lambda: job(size)), calls(lambda: job(2 * size))
    assert two < 2.5 * one + 1000, f"{one} calls for {size}, {two} for {2 * size}"
