"""Who flew, and when: read from a log and its name, without revealing whose board it was.

A record keeps no number of a board, and neither does the table: what identifies a vehicle is hashed with a salt that
stays in the folder of the results, so that tables of two runs cannot be joined by those who have but the tables.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rotorid.data.base import Immutable
from rotorid.errors import LogError, UsageError
from rotorid.io.documents import read_text
from rotorid.io.files import beginning, write_atomically
from rotorid.letters import visible

_HEAD_BYTES = 4 << 20
_MOST_TABLE_BYTES = 64 << 20
_SALT_BYTES = 1 << 10
_SALT = re.compile(r"[0-9a-f]{32}")
_PX4 = re.compile(rb"char\[\d{1,3}\] sys_uuid([0-9A-Fa-f]{8,48})")
_ARDUPILOT = re.compile(rb"[A-Za-z][\w.+-]{1,31} ([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})")
_BETAFLIGHT = re.compile(rb"H DeviceUID:(?:0x)?([0-9A-Fa-f]{8,48})")
_NO_BOARD = re.compile(rb"0*|F*|f*")


def read_salt(path: Path) -> bytes:
    """The salt of a folder, made where there is none.

    Raises
    ------
    UsageError
        It holds something else, or there is no room for one.
    """
    needed = "the salt that an earlier run wrote"
    if os.path.lexists(path):
        salt = read_text(path, needed=needed, most_bytes=_SALT_BYTES)
        # A run that was killed before any log was read leaves an empty one, and no name that was made with it.
        if salt:
            if _SALT.fullmatch(salt) is None:
                raise UsageError(f"{path} is not a salt", needed=needed, remedy="choose another --out")
            return salt.encode()
    salt = secrets.token_hex(16)
    try:
        write_atomically(path, salt)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written: {error.strerror or error}",
            needed="free space in a folder that you may write to",
        ) from error
    return salt.encode()


def board_of(log: Path) -> bytes:
    """Number of the board that wrote a log, empty where the log has none; it is only used for a hash."""
    try:
        head = beginning(log, _HEAD_BYTES)
    # The reader reports what is wrong with the file.
    except (LogError, OSError):
        return b""
    for pattern in (_PX4, _BETAFLIGHT, _ARDUPILOT):
        if (found := pattern.search(head)) is not None:
            number = next(group for group in found.groups() if group)
            return b"" if _NO_BOARD.fullmatch(number.replace(b" ", b"")) else number
    return b""


def hidden(identity: bytes, salt: bytes) -> str:
    """The name of a vehicle whose board number is secret.

    Examples
    --------
    >>> hidden(b"003A0021", b"salt")
    'v-d622c93626'
    """
    return f"v-{hashlib.blake2b(identity, key=salt, digest_size=5).hexdigest()}"


@dataclass(frozen=True, kw_only=True)
class Named(Immutable):
    """Vehicles of a CSV file, by the name, path or hash of a log."""

    vehicle: Mapping[str, str] = field(default_factory=dict)
    time: Mapping[str, str] = field(default_factory=dict)
    group: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(vehicle=self.vehicle, time=self.time, group=self.group)

    def of(self, what: Mapping[str, str], *names: str) -> str:
        """The first that is known."""
        return next((what[name] for name in names if name in what), "")


def read_named(path: Path | None) -> Named:
    """Read a CSV file with the columns ``log`` and ``vehicle``, and if wanted ``time`` and ``group``.

    Raises
    ------
    UsageError
        The file is missing, or a column is; a log came twice.
    """
    if path is None:
        return Named()
    needed = "a CSV file with the columns log,vehicle (and, if wanted, time and group)"
    text = read_text(path, needed=needed, most_bytes=_MOST_TABLE_BYTES).removeprefix("\ufeff")
    found: dict[str, dict[str, str]] = {"vehicle": {}, "time": {}, "group": {}}
    try:
        table = csv.DictReader(io.StringIO(text), strict=True)
        names = [str(name).strip().lower() for name in table.fieldnames or ()]
        if "log" not in names or not set(names) & set(found):
            raise UsageError(f"{path} has the columns {', '.join(names) or 'none'}", needed=needed)
        table.fieldnames = names
        for line, entry in enumerate(table, start=2):
            log = (entry.get("log") or "").strip()
            if not log:
                raise UsageError(f"line {line} of {path} names no log", needed=needed)
            for what, known in found.items():
                value = visible((entry.get(what) or "").strip())[:200]
                if value and known.setdefault(log, value) != value:
                    raise UsageError(f"{path} lists {log} twice", needed="each log once")
    except csv.Error as error:
        raise UsageError(f"{path} cannot be read as CSV: {error}", needed=needed) from error
    return Named(**found)
