"""A worker of a fleet: one log after the other, each a line in and a line out, limited in memory.

The answers go to what was standard output; whatever a library prints goes to standard error.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from rotorid.io.children import end_with_parent

_NEEDED = (
    "fleets.work",
    "identifying.identify_many",
    "reviewing.assembly",
    "reviewing.baseline",
    "search.multistart",
    "simulation.linear_kernels",
    "verification.kernels",
)


def prepare() -> None:
    """Import what logs need, before the first one waits for it."""
    for module in _NEEDED:
        import_module(f"rotorid.{module}")


def begin(words: Sequence[str]) -> None:
    """Answer tasks until there are no more: the limit of memory, and ``module:function`` of what answers one."""
    memory_bytes, work = int(words[0]), words[1]
    end_with_parent()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    module, _, function = work.partition(":")
    answer = getattr(import_module(module), function)
    from rotorid.fleets.work import Task

    _limit(memory_bytes)
    import warnings

    warnings.simplefilter("ignore")
    answers.write("ready\n")
    answers.flush()
    for line in sys.stdin:
        result = answer(Task.from_json(json.loads(line)))
        answers.write(result.as_json() + "\n")
        answers.flush()


def _limit(memory_bytes: int) -> None:
    """Limit the memory beyond what the libraries have taken already."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        taken = 0
        with contextlib.suppress(OSError, ValueError, IndexError), open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123
            taken = int(file.read().split()[0]) * resource.getpagesize()
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = memory_bytes + taken
        resource.setrlimit(resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    begin(sys.argv[1:])
