"""The campaign as a whole: hostile inputs of every format and every document, and what became of them.

``python -m tests.hostile.campaign FOLDER`` tries 2000 of each kind and keeps a line for each input in ``FOLDER``, a
file for each kind. Stopped at any moment, the next run goes on behind the last line; a kind whose file was deleted is
tried anew. ``FOLDER KIND …`` tries some kinds, ``--count N`` other numbers of inputs, and ``--table`` prints the counts
of what is there.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from tests import copies
from tests.hostile.damage import LONGEST_S
from tests.hostile.structured import BUILDERS
from tests.hostile.structured_documents import DOCUMENTS

COUNT = 2000
FOREIGN = frozenset({"MAT", "HDF5", "Parquet", "ROS", "fleet table", "clocks"})
"""Kinds that are read by parsers of others, in the sandbox."""
KINDS = (*BUILDERS, *DOCUMENTS)


class Outcome(NamedTuple):
    """What became of one input.

    Attributes
    ----------
    kind, number
        Which one.
    seconds
        Of work, not of waiting for other programs.
    peak_kb
        Largest memory of the child until then.
    said
        ``read``, ``refused`` or another word, or ``FAULT`` and what is wrong.
    """

    kind: str
    number: int
    seconds: float
    peak_kb: int
    said: str

    @property
    def fault(self) -> str:
        """What is wrong; empty when nothing is."""
        if self.said.startswith("FAULT"):
            return self.said
        return "" if self.seconds < LONGEST_S else f"FAULT {self.seconds} s"


def outcomes(lines: Iterable[str]) -> list[Outcome]:
    """Lines of the child, as it prints them."""
    cells = (line.split("\t", 4) for line in lines)
    return [Outcome(kind, int(number), float(seconds), int(peak), said) for kind, number, seconds, peak, said in cells]


def tried(folder: Path, kinds: Sequence[str], count: int, *, whole: bool, kept: Path) -> list[Outcome]:
    """Put inputs through a child with limits, behind those that a file has kept, and on behind each that kills it.

    Parameters
    ----------
    folder
        Where the inputs are written.
    kinds, count
        Formats and documents, and how many of each.
    whole
        Put each through everything.
    kept
        The file of the lines.
    """
    folder.mkdir(parents=True, exist_ok=True)
    while True:
        # A line that a killed run did not end is tried again.
        text = kept.read_text(encoding="utf-8") if kept.exists() else ""
        kept.write_text(text[: text.rfind("\n") + 1], encoding="utf-8")
        found = outcomes(kept.read_text(encoding="utf-8").splitlines())
        if len(found) >= count * len(kinds):
            return found
        words = [str(folder), ",".join(kinds), str(count), str(len(found)), "whole" if whole else "part"]
        errors = kept.with_suffix(".errors")
        errors.unlink(missing_ok=True)
        code = copies.run("tests.hostile.fuzz_child", words, out=kept, errors=errors)
        now = outcomes(kept.read_text(encoding="utf-8").splitlines())
        if code > 0 or (code == 0 and len(now) == len(found)):
            said = errors.read_text(encoding="utf-8", errors="replace")[-2000:]
            raise AssertionError(f"the child ended with {code} after {len(now)} inputs: {said}")
        if code < 0:
            # Behind the sandbox a crash of a foreign parser is a sentence; here the parser runs in the child itself.
            number = len(now)
            name = kinds[number // count]
            crash = name in FOREIGN and -code in (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS)
            said = "crash of a foreign parser" if crash else f"FAULT ended by signal {-code}"
            with kept.open("a", encoding="utf-8") as lines:
                lines.write(f"{name}\t{number % count}\t0\t0\t{said}\n")


def table(found: Sequence[Outcome]) -> str:
    """Counts of each kind, in Markdown."""
    rows = ["| kind | inputs | understood | refused | tracebacks | over 20 s | over 1 GiB | slowest | most memory |"]
    rows.append("|---|---|---|---|---|---|---|---|---|")
    for kind in KINDS:
        own = [one for one in found if one.kind == kind]
        if own:
            rows.append(f"| {kind} | {' | '.join(_counts(own))} |")
    rows.append(f"| all | {' | '.join(_counts(found))} |")
    return "\n".join(rows)


def _counts(found: Sequence[Outcome]) -> list[str]:
    hangs = sum("FAULT" in one.fault and ("had not ended" in one.fault or one.seconds >= LONGEST_S) for one in found)
    large = sum("1 GiB" in one.fault or "FAULT memory" in one.fault for one in found)
    faults = sum(bool(one.fault) for one in found)
    refused = sum(one.said in ("refused", "crash of a foreign parser") for one in found)
    counts = [len(found), len(found) - refused - faults, refused, faults - hangs - large, hangs, large]
    slowest, peak = max(one.seconds for one in found), max(one.peak_kb for one in found)
    return [*map(str, counts), f"{slowest:.1f} s", f"{peak / 1024:.0f} MiB"]


def main() -> int:
    """Try, or count; the number of faults, at most one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("kinds", nargs="*", metavar="KIND")
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    found = []
    for kind in given.kinds or KINDS:
        kept = given.folder / f"{kind}.tsv"
        if given.table:
            found += outcomes(kept.read_text(encoding="utf-8").splitlines()) if kept.exists() else []
            continue
        own = tried(given.folder / "inputs" / kind, [kind], given.count, whole=True, kept=kept)
        wrong = [one for one in own if one.fault]
        print(f"{kind}: {len(own)} inputs, {len(wrong)} faults", *wrong[:3], sep="\n  ", flush=True)
        found += own
    if given.table:
        print(table(found))
    return int(any(one.fault for one in found))


if __name__ == "__main__":
    sys.exit(main())
