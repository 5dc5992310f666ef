"""Damaging files on purpose, and judging what a reader makes of them: shared by the tests of this folder."""

from __future__ import annotations

import hashlib
import json
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from tests import copies

from rotorid.data.record import FlightRecord
from rotorid.errors import RotoridError
from rotorid.letters import HIDDEN

ROOT = Path(__file__).resolve().parents[2]
LONGEST_S = 20
"""A small log takes milliseconds."""
SAYING = frozenset({"corrupt_log"})
"""Kinds of findings that say that a file is damaged."""

Verdict = Literal["same", "said", "refused", "silent"]


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A sound input, and which part of it is damaged.

    Parameters
    ----------
    name
        Name of the damaged file; the readers go by content, the messages by this name.
    content
        Its bytes while it is sound.
    beside
        Sound files next to it, by name.
    read
        What is given to `rotorid.io.read`, relative to the folder of the files; the damaged file by default.
    mapping
        The mapping that goes with it, if any.
    """

    name: str
    content: bytes
    beside: dict[str, bytes] = field(default_factory=dict)
    read: str = ""
    mapping: str = ""

    def put(self, folder: Path, content: bytes) -> None:
        """Write all files, with ``content`` in place of the sound bytes."""
        for name, data in {**self.beside, self.name: content}.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(data)


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """How much damage is tried: a reproducible list of damaged contents."""

    truncations: int
    flips: int
    seed: int = 0

    def variants(self, content: bytes) -> Iterator[bytes]:
        """First the truncations, evenly spread, then the flips of one bit each, all different."""
        for cut in np.linspace(0, len(content) - 1, self.truncations).astype(int).tolist():
            yield content[:cut]
        rng = np.random.default_rng(self.seed)
        bits = 8 * len(content)
        for place in rng.choice(bits, size=min(self.flips, bits), replace=False).tolist():
            damaged = bytearray(content)
            damaged[place // 8] ^= 1 << place % 8
            yield bytes(damaged)


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Verdicts on all variants of a sample.

    Parameters
    ----------
    truncations, flips
        Verdict to how often it was given.
    faults
        What must not be: tracebacks, hangs, malformed records. Empty when all is well.
    crashes
        Indices of the variants on which a foreign parser took the process with it.
    """

    truncations: Counter[str]
    flips: Counter[str]
    faults: tuple[str, ...]
    crashes: tuple[int, ...]

    def said(self, of: Literal["truncations", "flips"]) -> float:
        """Share that was refused, or read with a finding that says the damage, of all that changed what was read."""
        found: Counter[str] = getattr(self, of)
        changed = found.total() - found["same"]
        return 1.0 if not changed else 1.0 - found["silent"] / changed


def fingerprint(record: FlightRecord) -> str:
    """A hash over everything that was measured."""
    total = hashlib.sha256()
    for topic in record.topics:
        total.update(repr([channel.name for channel in topic.channels]).encode())
        total.update(topic.time_s.tobytes() + topic.values.tobytes())
    return total.hexdigest()


def malformed(record: FlightRecord) -> str:
    """What is wrong with a record that was read from a damaged file; empty when nothing is."""
    for topic in record.topics:
        if topic.values.shape != (len(topic.channels), topic.time_s.size):
            return f"{topic.name} has values of shape {topic.values.shape}"
        if not np.isfinite(topic.time_s).all():
            return f"{topic.name} has stamps that are not finite"
        if len({channel.name for channel in topic.channels}) < len(topic.channels):
            return f"{topic.name} holds a channel twice"
    if not np.isfinite([*record.parameters.values(), record.start_s, record.stop_s]).all():
        return "a parameter is not finite"
    for finding in record.findings:
        if not (finding.message and finding.where and np.isfinite([*finding.numbers.values()]).all()):
            return f"the finding {finding.kind} says nothing, or numbers that are none"
    return ""


def is_said(record: FlightRecord) -> bool:
    """Whether a record says that its file is damaged."""
    return any(finding.kind in SAYING for finding in record.findings)


def incomplete(error: RotoridError) -> str:
    """What an error fails to say; empty when it says what is wrong, what was expected and what to do.

    An unknown name is answered by the one that was probably meant, or else by those that exist: either is enough.
    """
    missing = [name for name in ("came", "needed", "remedy") if not getattr(error, name)]
    if "unknown unit " in error.came and len(missing) == 1:
        missing.remove("needed" if error.remedy else "remedy")
    if missing:
        return f"{error} does not give {', '.join(missing)}"
    if HIDDEN.search(str(error)):
        return f"{str(error)!r} has a control"
    return "" if len(str(error).splitlines()) == 1 else f"{str(error)!r} is more than one line"


@contextmanager
def hang_limit() -> Iterator[None]:
    """End whatever takes 20 s of work, or six times as long by the clock, with a fault; no limit without alarms."""
    if not hasattr(signal, "SIGALRM"):
        yield
        return
    # Other work on the machine is no fault of a reader.
    before = [(one, signal.signal(one, _hang)) for one in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    signal.alarm(6 * LONGEST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        for number, handler in before:
            signal.signal(number, handler)


def _hang(*_: object) -> None:
    raise TimeoutError(f"the reader had not ended after {LONGEST_S} s")


def assert_complete(error: RotoridError) -> None:
    """An error is one line that says what came, what was needed and what to do."""
    assert not incomplete(error), incomplete(error)


def run(sample: Sample, campaign: Campaign, folder: Path, *, seconds: float = 120.0) -> Tally:
    """Read every variant of a sample in a child with a limit of memory, and go on behind each that kills the child.

    One child for all, since starting one takes a hundred times as long as reading a small log. The parsers that
    otherwise run behind the sandbox run in that child as they do in the sandbox's own.
    """
    job = {"sample": {**asdict(sample), "content": sample.content.hex()}, "campaign": asdict(campaign)}
    job["sample"]["beside"] = {name: data.hex() for name, data in sample.beside.items()}
    (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
    expected = campaign.truncations + min(campaign.flips, 8 * len(sample.content))
    lines: list[str] = []
    crashes: list[int] = []
    while len(lines) < expected:
        found, code, errors = _child(folder, len(lines), seconds)
        lines += found
        if code < 0:
            crashes.append(len(lines))
            lines.append("crash")
        elif code or not found:
            raise AssertionError(f"the child ended with code {code} after {len(lines)} variants: {errors[-2000:]}")
    cut, flipped = lines[: campaign.truncations], lines[campaign.truncations :]
    verdicts = {"same", "said", "refused", "silent", "crash"}
    return Tally(
        truncations=Counter(line for line in cut if line in verdicts),
        flips=Counter(line for line in flipped if line in verdicts),
        faults=tuple(line for line in lines if line not in verdicts),
        crashes=tuple(crashes),
    )


def _child(folder: Path, start: int, seconds: float) -> tuple[list[str], int, str]:
    out, errors = (folder / f"{name}-{start}.txt" for name in ("out", "errors"))
    code = copies.run("tests.hostile.reading_child", [str(folder), str(start)], out=out, errors=errors, seconds=seconds)
    found = out.read_text(encoding="utf-8").splitlines()
    return found, code, errors.read_text(encoding="utf-8")
