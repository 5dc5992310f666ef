"""The formats of logs: one row for each, and all that follows from the rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rotorid.autopilots.autopilot import LogFormat


@dataclass(frozen=True, kw_only=True, slots=True)
class Reader:
    """A module with ``FORMAT``, ``sniff(head)`` and ``read(path, source, ...)``, and what its ``read`` understands.

    Parameters
    ----------
    module
        Its name.
    endings
        How its files are called: the files of a folder are recognized by that, one that is named itself is not.
    words
        What a message calls it among the formats that are read; empty where another row says it.
    takes_mapping, takes_sandbox
        Whether ``read`` takes a mapping of channels, and whether foreign parsers run in a sandbox.
    by_content
        Whether its first bytes alone show that a file is a log, whatever its name. A table may be of anything.
    """

    module: str
    endings: tuple[str, ...] = ()
    words: str = ""
    takes_mapping: bool = False
    takes_sandbox: bool = False
    by_content: bool = True


READERS: Sequence[Reader] = (
    Reader(module="rotorid.io.px4.log", endings=(".ulg", ".px4log"), words="PX4 .ulg"),
    Reader(module="rotorid.io.ardupilot.log", endings=(".bin",), words="ArduPilot .BIN or its text"),
    Reader(module="rotorid.io.ardupilot.text", endings=(".log", ".txt")),
    Reader(module="rotorid.io.betaflight.log", endings=(".bbl", ".bfl"), words="Betaflight .BBL"),
    Reader(module="rotorid.io.crazyflie", endings=(".usd",), words="Crazyflie uSD"),
    Reader(module="rotorid.io.paparazzi", endings=(".data",), words="Paparazzi .data"),
    Reader(module="rotorid.io.mavlink.tlog", endings=(".tlog",), words=".tlog"),
    Reader(
        module="rotorid.io.ros.bag",
        endings=(".bag", ".mcap", ".db3"),
        words="ROS bag",
        takes_mapping=True,
        takes_sandbox=True,
    ),
    Reader(
        module="rotorid.io.tables.matlab",
        endings=(".mat",),
        words=".mat",
        takes_mapping=True,
        takes_sandbox=True,
        by_content=False,
    ),
    Reader(module="rotorid.io.tables.npz", endings=(".npz",), words=".npz", takes_mapping=True, by_content=False),
    Reader(
        module="rotorid.io.tables.parquet",
        endings=(".parquet",),
        words=".parquet",
        takes_mapping=True,
        takes_sandbox=True,
        by_content=False,
    ),
    Reader(module="rotorid.io.betaflight.decoded", takes_mapping=True),
    # Last, since nearly every text looks like a table.
    Reader(module="rotorid.io.tables.csv", endings=(".csv",), words="CSV", takes_mapping=True, by_content=False),
)
"""In the order in which they are asked."""

ENDINGS = frozenset(ending for reader in READERS for ending in reader.endings)
"""What the files of a folder are recognized by, else by their content; a file that is named may be called anything."""

HEAD_BYTES = 4096
"""So much of a file shows its format."""

PACKED = (".gz", ".xz", ".bz2", ".zip")
"""Endings of files that are unpacked first."""

_WORDS = [reader.words for reader in READERS if reader.words]
READ = (
    f"{', '.join(_WORDS[:-1])} and {_WORDS[-1]}, each also as {', '.join(PACKED[:-1])} or {PACKED[-1]}, "
    "and folders of ulog2csv files"
)
"""What is read, for a message."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Writer:
    """A format in which simulated flights are written.

    Parameters
    ----------
    ending
        Of the file, as its autopilot writes it.
    module, name
        Of what writes a flight: ``name(path, flight, start_s=...)``.
    start_s
        Time since boot at which the first sample is stamped: autopilots have run for a while when a flight begins.
    """

    ending: str
    module: str
    name: str
    start_s: float = 0.0


WRITERS: Mapping[LogFormat, Writer] = MappingProxyType(
    {
        "ulg": Writer(ending="ulg", module="rotorid.io.px4.writer", name="write_px4", start_s=30.0),
        "bin": Writer(ending="BIN", module="rotorid.io.ardupilot.writer", name="write_ardupilot", start_s=60.0),
        "bbl": Writer(ending="bbl", module="rotorid.io.betaflight.writer", name="write_betaflight", start_s=20.0),
        "csv": Writer(ending="csv", module="rotorid.io.tables.csv", name="write_flight"),
    }
)
