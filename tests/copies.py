"""Programs of tests that begin where their imports have ended: each run is a copy of one process.

Imports and compiled kernels take seconds, and most children work for a tenth of one. A run is a process of its own with
its own limits, streams and end, as if it had been started anew; where the system has no copies, it is.

The program is a module with a function ``begin``, which is given the words of its command line. What it may compile or
import on the way is done once by its function ``prepare``, if it has one.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import select
import subprocess
import sys
import traceback
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import IO, Any

ROOT = Path(__file__).resolve().parents[1]


def run(module: str, words: Sequence[str], *, out: Path, errors: Path, seconds: float | None = None) -> int:
    """Exit code of a program, negative for a signal; what it writes is appended to two files.

    Raises
    ------
    TimeoutError
        It had not ended after ``seconds``; it has then.
    """
    if not hasattr(os, "fork"):
        with out.open("ab") as to, errors.open("ab") as log:
            command = [sys.executable, "-m", module, *words]
            return subprocess.run(
                command, env=environment(), stdout=to, stderr=log, check=False, timeout=seconds
            ).returncode
    return _original(module).run(words, out, errors, seconds)


def environment() -> dict[str, str]:
    """That of a child which finds the tests, and whose libraries start no threads."""
    places = [str(ROOT), *(entry for entry in sys.path if entry)]
    return os.environ | {"PYTHONPATH": os.pathsep.join(places), "OPENBLAS_NUM_THREADS": "1", "NO_COLOR": "1"}


class _Original:
    """The process that is copied; it ends with this one."""

    def __init__(self, module: str) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._module = module
        atexit.register(self.close)

    def run(self, words: Sequence[str], out: Path, errors: Path, seconds: float | None) -> int:
        """Copy it once, and wait for the end of the copy."""
        if self._process is None:
            command = [sys.executable, "-m", "tests.copies", self._module]
            self._process = subprocess.Popen(
                command, env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        asked, told = self._process.stdin, self._process.stdout
        assert asked is not None
        assert told is not None
        job = {"words": list(words), "out": str(out.resolve()), "errors": str(errors.resolve())}
        asked.write(json.dumps(job).encode() + b"\n")
        asked.flush()
        if not select.select([told], [], [], seconds)[0]:
            self.close()
            raise TimeoutError(f"{self._module} {' '.join(words)} had not ended after {seconds} s")
        line = told.readline()
        assert line, f"{self._module} cannot be imported or prepared"
        return int(line)

    def close(self) -> None:
        """End it, and a copy that still runs."""
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        process.wait()


_original = cache(_Original)


def main(module: str) -> None:
    """Copy this process for each line that comes, and answer each with the exit code of its copy."""
    from rotorid.io.children import end_with_parent

    end_with_parent()
    # What is printed on the way is no answer.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    program = import_module(module)
    if hasattr(program, "prepare"):
        program.prepare()
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            _copy(program, json.loads(line))
        _, status = os.waitpid(child, 0)
        answers.write(f"{os.waitstatus_to_exitcode(status)}\n")
        answers.flush()


def _copy(program: Any, job: dict[str, Any]) -> None:
    code: object = 1
    try:
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        for number, name in ((1, "out"), (2, "errors")):
            with Path(job[name]).open("ab") as file:
                os.dup2(file.fileno(), number)
        sys.argv = [program.__name__, *job["words"]]
        program.begin(job["words"])
        code = 0
    except SystemExit as ended:
        code = ended.code or 0
    except BaseException:
        traceback.print_exc()
    finally:
        streams: tuple[IO[str], ...] = (sys.stdout, sys.stderr)
        for stream in streams:
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code if isinstance(code, int) else 1)


if __name__ == "__main__":
    main(sys.argv[1])
