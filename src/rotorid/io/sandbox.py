"""Foreign parsers run in a child process with limits, so that a hostile or broken file costs one sentence.

A single changed byte can crash the interpreter inside a MAT parser, a definition in a ROS bag becomes code, and a small
file can ask for all of the memory. The child writes plain arrays and JSON into a temporary folder and dies; no
pickles cross the border.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from rotorid.errors import LogError
from rotorid.typing import AnyArray

Parser: TypeAlias = Literal["mat", "rosbag", "parquet"]

PARSERS: Mapping[str, str] = {
    "mat": "rotorid.io.tables.matlab",
    "rosbag": "rotorid.io.ros.containers",
    "parquet": "rotorid.io.tables.parquet",
}
"""Parser to the module whose ``extract(path, options)`` does the work, imported by the child alone."""

_MIB = 1 << 20
_PACKAGE_ROOT = str(Path(__file__).resolve().parents[2])


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """What the child may use. Memory and processor time are not enforced on Windows; the clock is."""

    memory_bytes: int
    cpu_s: int
    wall_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Extract:
    """What a foreign parser found: named arrays of numbers, and facts that fit into JSON."""

    arrays: Mapping[str, AnyArray]
    facts: Mapping[str, Any]


def limits_for(size_bytes: int) -> Limits:
    """Generous limits for a file of this size: a good log needs about a tenth of them.

    Examples
    --------
    >>> limits_for(100 * 2**20).cpu_s
    80
    """
    cpu_s = 30 + size_bytes // (2 * _MIB)
    return Limits(memory_bytes=2048 * _MIB + 8 * size_bytes, cpu_s=cpu_s, wall_s=2.0 * cpu_s)


def extract_here(parser: str, path: Path, options: Mapping[str, Any]) -> Extract:
    """Run a parser in this process: what the child does, and what a user gets who switched the sandbox off."""
    module = importlib.import_module(PARSERS[parser])
    found: Extract = module.extract(path, options)
    return found


def extract(
    parser: Parser, path: Path, options: Mapping[str, Any], *, name: str = "", limits: Limits | None = None
) -> Extract:
    """Run a parser in a child process and bring its arrays back.

    Parameters
    ----------
    parser
        One of ``PARSERS``.
    path
        The file to parse.
    options
        What the parser wants to know; must fit into JSON.
    name
        What the messages call the file.
    limits
        What the child may use; by default after the size of the file.

    Raises
    ------
    LogError
        The parser refused the file, crashed, hung, or asked for too much.
    """
    name = name or path.name
    limits = limits or limits_for(path.stat().st_size)
    with tempfile.TemporaryDirectory(prefix="rotorid-") as temporary:
        folder = Path(temporary)
        job = {
            "parser": parser,
            "path": str(path.resolve()),
            "options": dict(options),
            "memory_bytes": limits.memory_bytes,
            "cpu_s": limits.cpu_s,
        }
        (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
        code = _run_child(folder, name, limits)
        return _read_answer(folder, name, code, limits)


def _run_child(folder: Path, name: str, limits: Limits) -> int:
    # The child imports from where this process does, but never from the current folder, which may hold anything.
    places = [entry for entry in sys.path if entry]
    if _PACKAGE_ROOT not in places:
        places.append(_PACKAGE_ROOT)
    environment = dict(os.environ) | {
        "PYTHONPATH": os.pathsep.join(places),
        # Each thread of a linear-algebra library reserves memory that would count against the limit.
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-P", "-m", "rotorid.io.sandbox_worker", str(folder)]
    with (folder / "errors.txt").open("wb") as errors:
        try:
            finished = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                env=environment,
                cwd=folder,
                timeout=limits.wall_s,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise _refused(name, f"the parser had not ended after {limits.wall_s:g} s") from None
    return finished.returncode


def _refused(name: str, what: str) -> LogError:
    return LogError(
        f"{name} cannot be read: {what}",
        needed="an undamaged log",
        remedy="copy it again from the vehicle, or export it to CSV with the program that wrote it",
    )


def _read_answer(folder: Path, name: str, code: int, limits: Limits) -> Extract:
    answer = folder / "answer.json"
    if code != 0 or not answer.is_file():
        raise _refused(name, _why(code, folder / "errors.txt", limits))
    content = json.loads(answer.read_text(encoding="utf-8"))
    if "refused" in content:
        raise LogError(**content["refused"])
    if "failure" in content:
        raise _refused(name, content["failure"])
    with np.load(folder / "arrays.npz", allow_pickle=False) as stored:
        arrays = {label: stored[f"a{index}"] for index, label in enumerate(content["names"])}
    return Extract(arrays=arrays, facts=content["facts"])


def _why(code: int, errors: Path, limits: Limits) -> str:
    if code < 0:
        import signal

        if -code in {getattr(signal, "SIGXCPU", 0), getattr(signal, "SIGKILL", 0)}:
            return f"the parser was stopped after {limits.cpu_s} s of processor time or by the system's memory guard"
        return f"the parser crashed on it (signal {signal.Signals(-code).name})"
    said = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"the parser ended with code {code}" + (f" ({said[-1][:200]})" if said else "")
