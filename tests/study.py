"""The long studies in parts that go on where they ended: ``make study``, or ``make study PART=twins/test_drag``.

Each module of tests with the marker ``slow`` is a part, run in a process of its own, one for each processor. What
passed stands in :data:`KEPT` with a fingerprint of the package, of the tests' common modules and of its own; a part
that passed with the same is not run again. Each part is printed as it ends, with what it took.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / ".venv" / "study.jsonl"
"""One line for each part that passed: the file may be thrown away at any time."""

_SHOWN = 30
"""Last lines of a part that failed."""


@dataclass(frozen=True)
class Passed:
    """A part that passed.

    Attributes
    ----------
    part
        Path of the module, relative to the repository.
    fingerprint
        Of all that it may depend on.
    seconds
        How long it took.
    """

    part: str
    fingerprint: str
    seconds: float


def fingerprint(files: Iterable[Path]) -> str:
    """A hash over names and contents of files."""
    total = hashlib.sha256()
    for path in sorted(files):
        total.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def left(parts: Sequence[str], passed: Iterable[Passed], fingerprints: Mapping[str, str]) -> list[str]:
    """Parts that have not passed as they are, those of unknown and of long duration first.

    Examples
    --------
    >>> passed = [Passed("a", "1", 10.0), Passed("b", "1", 20.0), Passed("c", "0", 30.0)]
    >>> left(["a", "b", "c", "d"], passed, {"a": "1", "b": "2", "c": "1", "d": "1"})
    ['d', 'c', 'b']
    """
    known = {one.part: one for one in passed}
    waiting = [part for part in parts if part not in known or known[part].fingerprint != fingerprints[part]]
    return sorted(waiting, key=lambda part: -known[part].seconds if part in known else -float("inf"))


def kept(path: Path = KEPT) -> list[Passed]:
    """What passed before; of a part that passed several times, the last."""
    if not path.is_file():
        return []
    return [Passed(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def slow_parts(words: Sequence[str]) -> list[str]:
    """Modules with slow tests whose path contains one of the words, or all of them."""
    call = [sys.executable, "-m", "pytest", "--collect-only", "-m", "slow", "-p", "no:cacheprovider"]
    listed = subprocess.run(call, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    modules = dict.fromkeys(line.partition("::")[0] for line in listed.splitlines() if "::" in line)
    return [module for module in modules if not words or any(word in module for word in words)]


def run(part: str) -> tuple[str, float, str]:
    """Run one part: its name, its seconds, and the end of what it printed where it failed."""
    began_s = time.monotonic()
    call = [sys.executable, "-m", "pytest", "-q", "-m", "slow", "-p", "no:cacheprovider", part]
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(call, cwd=ROOT, env=one_thread, capture_output=True, text=True)
    said = "\n".join((done.stdout + done.stderr).splitlines()[-_SHOWN:])
    return part, time.monotonic() - began_s, said if done.returncode else ""


def main(words: Sequence[str]) -> int:
    """Run what is left, and print each part as it ends; the number of parts that failed."""
    parts = slow_parts(words)
    common = [*(ROOT / "src").rglob("*.py"), *(ROOT / "benchmarks").glob("*.py"), *(ROOT / "tests").glob("*.py")]
    whole = fingerprint(common)
    fingerprints = {part: fingerprint([ROOT / part]) + whole for part in parts}
    waiting = left(parts, kept(), fingerprints)
    print(f"{len(parts) - len(waiting)} of {len(parts)} parts passed before, {len(waiting)} are left", flush=True)
    failed = 0
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        ends = [pool.submit(run, part) for part in waiting]
        for number, end in enumerate(as_completed(ends), start=1):
            part, seconds, fault = end.result()
            print(f"{number:3} of {len(waiting)}  {seconds:7.0f} s  {part}{'  FAILED' if fault else ''}", flush=True)
            if fault:
                failed += 1
                print(fault, flush=True)
            else:
                with KEPT.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(Passed(part, fingerprints[part], round(seconds, 1)))) + "\n")
    return failed


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
