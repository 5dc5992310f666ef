"""Ctrl-C that is not lost.

Python raises an interrupt wherever it happens to be. While a kernel is compiled that may be inside of a callback from
compiled code, which prints the exception and goes on: the interrupt would be gone. So it is remembered, and raised
again with the next thing that a command says about its progress.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType

_asked = threading.Event()


def listen() -> None:
    """End on SIGINT and SIGTERM as on Ctrl-C, so that temporary files are removed."""
    _asked.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def check() -> None:
    """Raise an interrupt that was asked for and lost.

    Raises
    ------
    KeyboardInterrupt
        Somebody asked for it.
    """
    if _asked.is_set():
        raise KeyboardInterrupt


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    _asked.set()
    raise KeyboardInterrupt
