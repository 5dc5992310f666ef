"""PX4 flight logs (``.ulg``): the ULog container, whose topics `rotorid.io.px4_topics` names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from rotorid.data.record import FlightRecord, Source
from rotorid.io.privacy import without_places
from rotorid.io.px4_topics import record_of, wanted_fields
from rotorid.io.ulog import extract
from rotorid.io.ulog_walk import MAGIC

__all__ = ["FORMAT", "MAGIC", "read", "sniff"]

FORMAT = "PX4 ULog"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a ULog."""
    return head.startswith(MAGIC)


def read(path: Path, source: Source) -> FlightRecord:
    """Read a PX4 log.

    Parameters
    ----------
    path
        A ULog file.
    source
        Name, format and hash of the file as the user gave it.

    Raises
    ------
    LogError
        The file cannot be parsed, or holds no topic that the package has a name for.
    """
    log = extract(path, wanted_fields())
    facts = {
        "parameters": without_places(log.parameters),
        "dropouts": log.dropouts,
        "damage": log.damage,
        "size_bytes": log.size_bytes,
    }
    return record_of(log.arrays, facts, replace(source, firmware=_firmware(log.info)))


def _firmware(info: Mapping[str, str | int]) -> str:
    """``PX4 1.17.0``, from the packed number that the log carries: major, minor, patch, kind of release."""
    release = info.get("ver_sw_release")
    if not isinstance(release, int) or release == 0:
        return str(info.get("sys_name", ""))
    kinds = {0: " (development)", 64: " (alpha)", 128: " (beta)", 192: " (release candidate)", 255: ""}
    kind = kinds[max(limit for limit in kinds if limit <= release & 0xFF)]
    return f"{info.get('sys_name', 'PX4')} {release >> 24 & 0xFF}.{release >> 16 & 0xFF}.{release >> 8 & 0xFF}{kind}"
