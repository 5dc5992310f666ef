"""Processes that this one starts: each in a session of its own, ended with all that it started, never outliving us."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time

_LOOKS_S = 0.5


def end_session(child: subprocess.Popen[bytes]) -> None:
    """Kill a child that was started with ``start_new_session=True``, and everything in its session."""
    with contextlib.suppress(OSError):
        if hasattr(os, "killpg"):
            # The number of its session is its own; while it is not waited for, or others live in it, it is not reused.
            os.killpg(child.pid, signal.SIGKILL)
        else:
            child.kill()


def end_with_parent() -> None:
    """Let this process end when the one that started it is gone: nobody waits for its answer."""
    threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOKS_S)
    os._exit(3)
