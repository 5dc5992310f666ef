"""Foreign parsers run in a child process with limits, so that a hostile or broken file costs one sentence.

A single changed byte can crash the interpreter inside a MAT parser, a definition in a ROS bag becomes code, and a small
file can ask for all of the memory. The child reads the file, writes plain arrays and JSON into a temporary folder
and dies; no pickles cross the border. What it could do beyond that it takes from itself before it looks at the file
(:mod:`rotorid.io.confinement`), and it has a session of its own, which ends with it.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from rotorid.errors import LogError
from rotorid.io.children import end_session
from rotorid.io.confinement import allowed, environment
from rotorid.io.folders import scratch_folder
from rotorid.typing import AnyArray

Parser: TypeAlias = Literal["mat", "rosbag", "parquet"]

PARSERS: Mapping[str, str] = {
    "mat": "rotorid.io.tables.matlab",
    "rosbag": "rotorid.io.ros.containers",
    "parquet": "rotorid.io.tables.parquet",
}
"""Parser to the module whose ``extract(path, options)`` does the work, imported by the child alone."""

PROTECTIONS = "protections"
"""In the place of a parser: the child says how it is confined."""

_MIB = 1 << 20
_PACKAGE_ROOT = str(Path(__file__).resolve().parents[2])


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """What the child may use, and never more than this process. Windows enforces the clock alone."""

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
    return _extract(parser, path, options, name, limits)


def protections() -> dict[str, bool]:
    """Each protection of the sandbox, and whether it is active on this system.

    ``limits`` of memory, time and file sizes; ``parent``, without which the child ends; ``no_new_privileges``;
    ``files`` (nothing but the log is read, nothing but its own folder written); ``network`` and ``processes`` (none).

    Examples
    --------
    >>> sorted(protections())
    ['files', 'limits', 'network', 'no_new_privileges', 'parent', 'processes']
    """
    found = _extract(PROTECTIONS, Path(__file__), {}, "the sandbox", limits_for(0)).facts
    return {name: bool(active) for name, active in found.items()}


def _extract(parser: str, path: Path, options: Mapping[str, Any], name: str, limits: Limits) -> Extract:
    wanted = {"RLIMIT_AS": limits.memory_bytes, "RLIMIT_FSIZE": limits.memory_bytes, "RLIMIT_CPU": limits.cpu_s}
    with scratch_folder() as temporary:
        folder = temporary.resolve()
        job = {
            "parser": parser,
            "path": str(path.resolve()),
            "options": dict(options),
            "limits": wanted if os.name == "nt" else allowed(wanted),
            "parent": os.getpid(),
        }
        (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
        code = _run_child(folder, name, limits)
        return _read_answer(folder, name, code, limits, tight=job["limits"] != wanted)


def _run_child(folder: Path, name: str, limits: Limits) -> int:
    # The child imports from where this process does, but never from the current folder, which may hold anything.
    places = [entry for entry in sys.path if entry]
    if _PACKAGE_ROOT not in places:
        places.append(_PACKAGE_ROOT)
    command = [sys.executable, "-P", "-m", "rotorid.io.sandbox_worker", str(folder)]
    with (folder / "errors.txt").open("wb") as errors:
        child = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            env=environment(folder, places),
            cwd=folder,
            start_new_session=True,
        )
        try:
            return child.wait(limits.wall_s)
        except subprocess.TimeoutExpired:
            raise _refused(name, f"the parser had not ended after {limits.wall_s:g} s") from None
        finally:
            # Whatever it started ends with it, also where this process is interrupted.
            end_session(child)
            child.wait()


def _refused(name: str, what: str) -> LogError:
    return LogError(
        f"{name} cannot be read: {what}",
        needed="an undamaged log",
        remedy="copy it again from the vehicle, or export it to CSV with the program that wrote it",
    )


def _limited(name: str, what: str) -> LogError:
    """The refusal where the system gives less than a good log may need: the file need not be at fault."""
    return LogError(
        f"{name} was not read: {what}, under limits that this system has set",
        needed="more memory, time or room for files than these limits leave",
        remedy="raise them (ulimit -v, -t, -f), or export the log to CSV",
    )


def _read_answer(folder: Path, name: str, code: int, limits: Limits, *, tight: bool) -> Extract:
    refused = _limited if tight else _refused
    answer, stored_at = folder / "answer.json", folder / "arrays.npz"
    if code != 0 or not answer.is_file() or answer.is_symlink() or stored_at.is_symlink():
        raise refused(name, _why(code, folder / "errors.txt", limits))
    # What a parser that was taken over may have written is trusted no more than the file.
    try:
        content = json.loads(answer.read_text(encoding="utf-8"))
        if "refused" in content:
            error = LogError(**{part: str(content["refused"][part]) for part in ("came", "needed", "remedy")})
        elif "failure" in content:
            error = (refused if content.get("full") else _refused)(name, str(content["failure"]))
        else:
            names: list[str] = [str(label) for label in content["names"]]
            arrays: dict[str, AnyArray] = {}
            if names:
                with np.load(stored_at, allow_pickle=False) as stored:
                    arrays = {label: stored[f"a{index}"] for index, label in enumerate(names)}
            return Extract(arrays=arrays, facts=dict(content["facts"]))
    except (ValueError, KeyError, TypeError, OSError, EOFError, RecursionError, zipfile.BadZipFile):
        raise _refused(name, "the parser left no answer that can be read") from None
    raise error


def _why(code: int, errors: Path, limits: Limits) -> str:
    if code < 0:
        if -code in {getattr(signal, "SIGXCPU", 0), getattr(signal, "SIGKILL", 0)}:
            return f"the parser was stopped after {limits.cpu_s} s of processor time or by the system's memory guard"
        return f"the parser crashed on it (signal {signal.Signals(-code).name})"
    lines = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"the parser ended with code {code}" + (f" ({lines[-1][:200]})" if lines else "")
