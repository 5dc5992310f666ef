"""Programs of tests that begin where their imports have ended: each run is a copy of one process.

Imports and compiled kernels take seconds, and most children work for a tenth of one (:mod:`rotorid.io.copies`).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from rotorid.io.copies import Program

ROOT = Path(__file__).resolve().parents[1]


def run(module: str, words: Sequence[str], *, out: Path, errors: Path, seconds: float | None = None) -> int:
    """Exit code of a program, negative for a signal; what it writes is appended to two files.

    Raises
    ------
    TimeoutError
        It had not ended after ``seconds``; it has then.
    """
    with out.open("ab") as to, errors.open("ab") as log:
        running = _program(module).start(words, stdout=to.fileno(), stderr=log.fileno(), environment=environment())
    try:
        return running.wait(seconds)
    except TimeoutError:
        raise TimeoutError(f"{module} {' '.join(words)} had not ended after {seconds} s") from None
    finally:
        running.end()


def environment() -> dict[str, str]:
    """That of a child which finds the tests, and whose libraries start no threads."""
    places = [str(ROOT), *(entry for entry in sys.path if entry)]
    return os.environ | {"PYTHONPATH": os.pathsep.join(places), "OPENBLAS_NUM_THREADS": "1", "NO_COLOR": "1"}


@cache
def _program(module: str) -> Program:
    return Program(module, environment={"PYTHONPATH": environment()["PYTHONPATH"], "OPENBLAS_NUM_THREADS": "1"})


class _Kept(Program):
    def close(self) -> None:
        """Stay for the next test."""


_kept: dict[tuple[object, ...], Program] = {}


def kept(module: str, *, environment: Mapping[str, str] | None = None, copied: bool = True) -> Program:
    """In the place of :class:`Program`: one for all labs and fleets of these tests, whose ends leave it as it is."""
    key = module, copied, *(environment or {}).items()
    return _kept.setdefault(key, _Kept(module, environment=environment, copied=copied))
