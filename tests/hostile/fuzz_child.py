"""The child of :mod:`tests.hostile.campaign`: reads hostile inputs one after the other, and says what must not be.

A line for each input: its kind, number, seconds of work, the peak of the memory so far in kB, and what became of it or
what is wrong. Logs are read, inspected, and written as the JSON that ``rotorid inspect --json`` prints; some go through
the command line, and some through the estimation of a model. Documents are read as commands read them.
"""

from __future__ import annotations

import io
import json
import random
import resource
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from tests.hostile.damage import Sample, hang_limit, incomplete, malformed
from tests.hostile.reading_child import _extract_here
from tests.hostile.structured import BUILDERS, sound, variants
from tests.hostile.structured_documents import DOCUMENTS, Sound, hostile_documents, sound_documents

import rotorid
from rotorid.cli.app import main as command
from rotorid.documents.base import to_json
from rotorid.documents.inspection import inspect_document
from rotorid.errors import RotoridError
from rotorid.fleets import table
from rotorid.io import read, sandbox
from rotorid.letters import HIDDEN
from rotorid.reviewing.inspection import inspect
from rotorid.settings.parsing import parse_segment

MEMORY_BYTES = 3 << 30
"""Of addresses: libraries take two thirds of it (pyarrow alone reserves 1 GiB); :data:`MOST_RESIDENT_KB` bounds use."""
MOST_RESIDENT_KB = 1 << 20
COMMANDS = (
    *("inspect", "review", "delay", "track", "tune", "identify --model rate.roll"),
    *("response --inputs roll_command --outputs p", "identify --model rate.roll --segment roll:0:1e9"),
)
"""What a log without a clock goes through, one of them each."""


def prepare() -> None:
    """Import and compile what every copy needs."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "sound").mkdir()
        _prepare(Sound(Path(folder) / "sound"), Path(folder), whole=True)


def begin(words: Sequence[str]) -> None:
    """Folder, kinds, how many of each, number of the first, and whether each goes through everything."""
    folder, kinds, count, start, much = words
    main(Path(folder), kinds.split(","), int(count), int(start), whole=much == "whole")


def main(folder: Path, formats: list[str], count: int, start: int, *, whole: bool) -> None:
    """Judge the inputs of some formats from number ``start`` on; ``whole`` puts each through everything."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for module in (sandbox, table):
        module.extract = _extract_here  # type: ignore[attr-defined]
    warnings.simplefilter("error", RuntimeWarning)
    # What is identified once serves all kinds.
    made = Sound(folder.parent / "sound")
    if not DOCUMENTS.keys() >= set(formats):
        _prepare(made, folder.parent, whole=whole)
    known: set[str] = set()
    for name, number, sample in islice(_inputs(formats, count, made), start, None):
        if name not in known:
            known.add(name)
            _prepare_kind(name, made, folder)
        begin_s = time.process_time()
        sample.put(folder, sample.content)
        if name in DOCUMENTS:
            said = understood(DOCUMENTS[name].read, folder / sample.name)
        else:
            said = verdict(name, sample, folder, every=1 if whole else 40, number=number)
        peak_kb = most_resident_kb()
        said = "FAULT more than 1 GiB" if peak_kb > MOST_RESIDENT_KB else said
        print(name, number, f"{time.process_time() - begin_s:.2f}", peak_kb, said, sep="\t", flush=True)
        # The next one begins with the memory of a new program.
        if peak_kb > MOST_RESIDENT_KB:
            return


def _inputs(kinds: Sequence[str], count: int, made: Sound) -> Iterator[tuple[str, int, Sample]]:
    for name in kinds:
        samples = hostile_documents(name, count, made) if name in DOCUMENTS else variants(name, count)
        yield from ((name, number, sample) for number, sample in enumerate(samples))


def _prepare(made: Sound, folder: Path, *, whole: bool) -> None:
    """Import and compile what no hostile input may be charged with: every format may hold bytes of another."""
    log = folder / "flight.csv"
    made.write_log(log)
    spoken(["inspect", str(log)])
    sample = sound("blackbox")
    sample.put(folder, sample.content)
    read(folder / sample.name)
    if whole:
        rotorid.identify([read(log)], "rate.roll", segments=[parse_segment("roll:0:60")])


def _prepare_kind(name: str, made: Sound, folder: Path) -> None:
    """The same for what only this kind needs, by a sound input of it."""
    if name in DOCUMENTS:
        sample = sound_documents(name, made)[0]
        sample.put(folder, sample.content)
        DOCUMENTS[name].read(folder / sample.name)
        return
    sample = sound(BUILDERS[name][1][0])
    sample.put(folder, sample.content)
    read(folder / (sample.read or sample.name), mapping=folder / sample.mapping if sample.mapping else None)


def understood(read_document: Callable[[Path], object], path: Path) -> str:
    """``read``, ``refused``, or ``FAULT`` and what is wrong with what was said of a document."""
    try:
        with hang_limit():
            read_document(path)
    except RotoridError as error:
        said = str(error)
        whole = len(said) < 4000 and error.came and "\n" not in said and not HIDDEN.search(said)
        return "refused" if whole else f"FAULT {said[:200]!r} is no sentence"
    except BaseException:
        return "FAULT " + " | ".join(line.strip() for line in traceback.format_exc().splitlines()[-7:])
    return "read"


def most_resident_kb() -> int:
    """The peak of this program alone: what the system counts of a child begins with its parent's memory."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:  # Only Linux has it.
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(status.partition("VmHWM:")[2].split()[0])


def verdict(name: str, sample: Sample, folder: Path, *, every: int, number: int) -> str:
    """``read``, ``refused``, or ``FAULT`` and what is wrong."""
    path = folder / (sample.read or sample.name)
    mapping = folder / sample.mapping if sample.mapping else None
    try:
        with hang_limit():
            try:
                record = read(path, mapping=mapping)
            except RotoridError as error:
                wrong = incomplete(error)
                return f"FAULT {wrong}" if wrong else "refused"
            if wrong := malformed(record):
                return f"FAULT {wrong}"
            if name == "clocks" and number % every == 0:
                words = COMMANDS[number // every % len(COMMANDS)].split()
                return spoken([*words, str(path), "--out", str(folder / "out"), "--force"])
            if number % every and number % 10:
                return "read"
            text = to_json(inspect_document(inspect(record)))
            json.loads(text, parse_constant=lambda name: 1 / 0)
            if HIDDEN.search(text.replace("\n", "")):
                return "FAULT a control in the JSON"
            if every == 1 and number % 10 == 5:
                return estimated(record)
            if number % every == 0:
                return spoken(["inspect", str(path), *(["--map", str(mapping)] if mapping else [])])
            return "inspected"
    except MemoryError:
        return "FAULT memory " + " | ".join(traceback.format_exc().splitlines()[-3:])
    except BaseException:
        return "FAULT " + " | ".join(line.strip() for line in traceback.format_exc().splitlines()[-7:])


def estimated(record: rotorid.FlightRecord) -> str:
    """A model of whatever the record holds, over all of it."""
    axis = random.Random(record.source.sha256).choice(["roll", "pitch", "yaw"])
    segment = f"{axis}:{record.start_s!r}:{record.stop_s!r}"
    try:
        rotorid.identify([record], f"rate.{axis}", segments=[parse_segment(segment)])
    except RotoridError as error:
        return f"FAULT {wrong}" if (wrong := "" if error.came else "says nothing") else "not identified"
    return "identified"


def spoken(words: list[str]) -> str:
    """A command by its entry point: code, and what it says."""
    out, err = io.StringIO(), io.StringIO()
    code: object = 0
    with patch.object(sys, "argv", ["rotorid", *words]), redirect_stdout(out), redirect_stderr(err):
        try:
            command()
        except SystemExit as ended:
            code = ended.code or 0
    said = out.getvalue() + err.getvalue()
    if code not in (0, 1, 2) or "Traceback" in said or "Warning" in err.getvalue():
        return f"FAULT the command ended with {code}: {err.getvalue()[-300:]!r}"
    if HIDDEN.search(said):
        return "FAULT a control on the console"
    return "shown"


if __name__ == "__main__":
    begin(sys.argv[1:])
