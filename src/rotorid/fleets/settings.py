"""Choices of ``rotorid fleet``."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from rotorid.errors import UsageError
from rotorid.settings.option import Option, Settings, Text, Written, require_workers
from rotorid.settings.parsing import NAMES

USUAL_MODELS = ("rate.roll", "rate.pitch", "rate.yaw")
"""What most logs with sticks or test inputs can answer."""

_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
_LEAST_MEMORY_BYTES = 512 << 20
_MEMORY = "4GiB"


def parse_memory(text: str) -> int:
    """Read a size in bytes, ``4GiB`` or ``800M``.

    Examples
    --------
    >>> parse_memory("4GiB"), parse_memory("800M")
    (4294967296, 838860800)
    """
    found = re.fullmatch(r"(\d{1,12}(?:\.\d{1,6})?)\s?([KMGT]?)(?:i?B)?", text.strip(), re.IGNORECASE)
    if found is None:
        raise UsageError(f"--memory {text!r} is not a size", needed="a size such as 4GiB or 800M")
    return int(float(found[1]) * _UNITS[found[2].upper()])


@dataclass(frozen=True, kw_only=True)
class FleetSettings(Settings):
    """Choices of a fleet; the same log, version and written settings give the same rows.

    Parameters
    ----------
    models
        What is identified on every log; see ``rotorid models``.
    review
        Whether the measures of ``rotorid review`` are rows too.
    vehicles
        CSV file ``log,vehicle``, and if wanted ``time`` and ``group``; a log is named by its file, its path or its
        hash.
    workers
        Processes; as many as there are cores by default.
    memory_bytes, timeout_s
        What one log may use.
    scheduler
        Address of a Dask cluster that does the work.
    resume
        Whether to go on from what is in the folder.
    seed
        Of everything random.

    Raises
    ------
    UsageError
        A number is out of range, or there is nothing to do.
    """

    models: Annotated[Any, Option("--models", "Models to identify, separated by commas, or none.", "Models", NAMES)] = (
        USUAL_MODELS
    )
    review: Annotated[bool, Option("--review", "Also compare the figures of rotorid review.", "Models")] = False
    vehicles: Annotated[
        Path | None,
        Option(
            "--vehicles", "CSV file log,vehicle (optional: time, group), where logs do not name their vehicle.", "Data"
        ),
        Written("never"),
    ] = None
    workers: Annotated[
        int | None, Option("--workers", "Number of processes. [default: one per core]", "Work"), Written("never")
    ] = None
    memory_bytes: Annotated[
        Any,
        Option("--memory", "Memory limit for one log.", "Work", Text("SIZE", parse_memory), default=_MEMORY),
        Written("never"),
    ] = parse_memory(_MEMORY)  # noqa: RUF009 - the number of a text
    timeout_s: Annotated[float, Option("--timeout", "Time limit for one log in s.", "Work"), Written("never")] = 600.0
    seed: Annotated[int, Option("--seed", "Random seed.")] = 0
    scheduler: Annotated[
        str | None,
        Option("--scheduler", "Run on a Dask cluster: tcp://HOST:8786.", "Work", metavar="ADDRESS"),
        Written("never"),
    ] = None
    resume: Annotated[
        bool,
        Option("--resume/--again", "Continue an earlier run in the same folder, or start again.", "Work"),
        Written("never"),
    ] = True

    def __post_init__(self) -> None:
        models = tuple(name for name in self.models if name and name != "none")
        object.__setattr__(self, "models", tuple(dict.fromkeys(models)))
        if not self.models and not self.review:
            raise UsageError(
                "--models none without --review leaves nothing to do", remedy="name a model, or add --review"
            )
        if self.workers is not None and self.scheduler is not None:
            raise UsageError(
                "--workers and --scheduler exclude each other", remedy="leave out --workers: a cluster has its own"
            )
        require_workers(self.workers)
        if not self.timeout_s > 0.0:
            raise UsageError(f"--timeout {self.timeout_s:g} is out of range", needed="more than 0 s")
        if self.memory_bytes < _LEAST_MEMORY_BYTES:
            raise UsageError(f"--memory of {self.memory_bytes >> 20} MiB is too little", needed="at least 512 MiB")
