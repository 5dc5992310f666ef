"""The child of `tests.hostile.damage.run`: reads one damaged file after the other, and prints a verdict for each."""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from tests.hostile.damage import Campaign, Sample, fingerprint, hang_limit, incomplete, is_said, malformed

from rotorid.errors import LogError, RotoridError
from rotorid.io import read, sandbox
from rotorid.io.sandbox import Extract

MEMORY_BYTES = 3 << 30


def begin(words: Sequence[str]) -> None:
    """The folder of the job, and the number of the first variant."""
    main(Path(words[0]), int(words[1]))


def main(folder: Path, start: int) -> None:
    """Judge the variants from number ``start`` on."""
    _limit_memory()
    # The one thing that is left out of the sandbox is the start of its process.
    sandbox.extract = _extract_here  # type: ignore[assignment]
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    about = job["sample"]
    about["content"] = bytes.fromhex(about["content"])
    about["beside"] = {name: bytes.fromhex(data) for name, data in about["beside"].items()}
    sample, campaign = Sample(**about), Campaign(**job["campaign"])
    sample.put(folder, sample.content)
    sound = fingerprint(_read(sample, folder))
    for content in islice(campaign.variants(sample.content), start, None):
        sample.put(folder, content)
        print(_verdict(sample, folder, sound), flush=True)


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows has no such limit.
        return
    if sys.platform != "darwin":
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _read(sample: Sample, folder: Path) -> Any:
    return read(folder / (sample.read or sample.name), mapping=folder / sample.mapping if sample.mapping else None)


def _verdict(sample: Sample, folder: Path, sound: str) -> str:
    try:
        with hang_limit():
            record = _read(sample, folder)
    except RotoridError as error:
        return incomplete(error) or "refused"
    # Whatever else a reader raises is a fault, and the test shows where it came from.
    except Exception:
        return " | ".join(traceback.format_exc().splitlines()[-3:])
    wrong = malformed(record)
    if wrong:
        return wrong
    if fingerprint(record) == sound:
        return "same"
    return "said" if is_said(record) else "silent"


def _extract_here(parser: str, path: Path, options: Mapping[str, Any], *, name: str = "", **_: object) -> Extract:
    """What the sandbox's child does, and what its parent makes of the answer."""
    try:
        found = sandbox.extract_here(parser, path, options)
        if any(array.dtype.hasobject for array in found.arrays.values()):
            raise TypeError("an array holds objects")
        return Extract(arrays=found.arrays, facts=json.loads(json.dumps(found.facts)))
    except LogError:
        raise
    except TimeoutError:
        raise
    # The border of the sandbox: whatever a foreign parser raises is one sentence.
    except Exception as error:
        raise LogError(f"{name} cannot be read: {error!r:.200}", needed="a log", remedy="copy it") from error


if __name__ == "__main__":
    begin(sys.argv[1:])
