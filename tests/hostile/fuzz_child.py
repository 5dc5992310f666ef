"""The child of `test_fuzz_structured`: reads hostile inputs one after the other, and says what must not be.

A line for each input: what became of it, or what is wrong. Each is read, inspected, and written as the JSON that
``rotorid inspect --json`` prints; some go through the command line, and some through the estimation of a model.
"""

from __future__ import annotations

import io
import json
import random
import resource
import sys
import traceback
import warnings
from contextlib import redirect_stderr, redirect_stdout
from itertools import islice
from pathlib import Path
from unittest.mock import patch

from tests.hostile.damage import Sample, hang_limit, incomplete, malformed
from tests.hostile.reading_child import _extract_here
from tests.hostile.structured import variants

import rotorid
from rotorid.cli.app import main as command
from rotorid.data.display import HIDDEN
from rotorid.documents.base import to_json
from rotorid.documents.inspection import inspect_document
from rotorid.errors import RotoridError
from rotorid.io import read, sandbox
from rotorid.reviewing.inspection import inspect
from rotorid.settings.parsing import parse_segment

MEMORY_BYTES = 3 << 30
"""Of addresses: libraries take two thirds of it (pyarrow alone reserves 1 GiB); :data:`MOST_RESIDENT_KB` bounds use."""
MOST_RESIDENT_KB = 1 << 20


def main(folder: Path, formats: list[str], count: int, start: int, *, whole: bool) -> None:
    """Judge the inputs of some formats from number ``start`` on; ``whole`` puts each through everything."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sandbox.extract = _extract_here  # type: ignore[assignment]
    warnings.simplefilter("error", RuntimeWarning)
    inputs = ((name, number, sample) for name in formats for number, sample in enumerate(variants(name, count)))
    for name, number, sample in islice(inputs, start, None):
        sample.put(folder, sample.content)
        said = verdict(sample, folder, every=1 if whole else 40, number=number)
        if most_resident_kb() > MOST_RESIDENT_KB:
            said = "FAULT more than 1 GiB"
        print(f"{name} {number} {said}", flush=True)


def most_resident_kb() -> int:
    """The peak of this program alone: what the system counts of a child begins with its parent's memory."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:  # Only Linux has it.
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(status.partition("VmHWM:")[2].split()[0])


def verdict(sample: Sample, folder: Path, *, every: int, number: int) -> str:
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
    main(Path(sys.argv[1]), sys.argv[2].split(","), int(sys.argv[3]), int(sys.argv[4]), whole=sys.argv[5] == "whole")
