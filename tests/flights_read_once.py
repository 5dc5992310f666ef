"""Flights of the data folder are read once in each process of the tests.

A record does not change, nor does what the program keeps about it for as long as it lives (``cached_by_value``): tests
that ask about the same flight share both. Tests of the readers themselves read anew, see :data:`READERS`.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord

READERS = (
    "tests/hostile/",
    "tests/unit/io/",
    "tests/unit/cli/",
    "tests/unit/lab/",
    "tests/unit/mcp/",
    "tests/unit/fleets/",
    "tests/reference/test_dataflash_against_pymavlink.py",
    "tests/reference/test_every_file_reads.py",
    "tests/reference/test_large_logs.py",
    "tests/reference/test_same_answer.py",
    "tests/reference/test_ulog_against_pyulog.py",
)
"""Beginnings of the paths of tests that look at reading, or at commands in processes of their own."""

KEPT_BYTES = 400 << 20
"""Samples of the records that are kept, the latest ones."""


def reads_anew(path: Path, root: Path) -> bool:
    """Whether a file of tests is about reading, so that each of its tests reads."""
    return path.relative_to(root).as_posix().startswith(READERS)


class ReadOnce:
    """A function that reads logs, which keeps those below some folders; in a sandbox or not, they are the same.

    Examples
    --------
    >>> asked = []
    >>> once = ReadOnce(lambda path, mapping, sandbox: asked.append(path) or path.name, [Path("/data")])
    >>> [once(Path(f"/{folder}/a.ulg"), None, sandbox=True) for folder in ("data", "data", "other", "other")]
    ['a.ulg', 'a.ulg', 'a.ulg', 'a.ulg']
    >>> [str(path) for path in asked]
    ['/data/a.ulg', '/other/a.ulg', '/other/a.ulg']
    """

    def __init__(self, read: Callable[..., FlightRecord], folders: list[Path]) -> None:
        self._read = read
        self._folders = [folder.resolve() for folder in folders]
        self._known: OrderedDict[Hashable, FlightRecord] = OrderedDict()

    def __call__(self, path: Path, mapping: Any, *, sandbox: bool) -> FlightRecord:
        whole = path.resolve()
        named = mapping is None or isinstance(mapping, str | os.PathLike)
        if not named or not any(whole.is_relative_to(folder) for folder in self._folders):
            return self._read(path, mapping, sandbox=sandbox)
        # A mapping may lie anywhere, where tests write others under its name.
        key = whole, path.name, mapping and (Path(mapping).name, Path(mapping).read_bytes())
        if key not in self._known:
            self._known[key] = self._read(path, mapping, sandbox=sandbox)
        self._known.move_to_end(key)
        while len(self._known) > 1 and sum(map(_bytes, self._known.values())) > KEPT_BYTES:
            self._known.popitem(last=False)
        return self._known[key]


def _bytes(record: FlightRecord | str) -> int:
    topics = () if isinstance(record, str) else record.topics
    return sum(topic.values.nbytes + topic.time_s.nbytes for topic in topics)
