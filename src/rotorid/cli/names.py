"""Names of the folders that commands write to."""

from __future__ import annotations

import re
from pathlib import Path

_PACKED = (".gz", ".xz", ".bz2", ".zip")


def default_folder(log: Path, what: str) -> Path:
    """Where the results from a log go when the user does not say.

    Examples
    --------
    >>> default_folder(Path("logs/roll.ulg.xz"), "rate.roll").as_posix()
    'rotorid-out/roll-rate.roll'
    """
    return Path("rotorid-out") / _file_name(f"{_stem(log)}-{what}")


def _file_name(text: str) -> str:
    """Text as the name of a folder: a model file may call itself anything."""
    return re.sub(r"[^\w.+-]+", "_", text).lstrip(".") or "result"


def _stem(log: Path) -> str:
    """Name of a log without the extensions of its compression and its format."""
    return Path(log.stem if log.suffix.lower() in _PACKED else log.name).stem
