"""Files that hold nothing from a place on: zeros of a copy or a card that failed, erased flash memory."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from rotorid.data.findings import Finding, warn
from rotorid.errors import LogError

_CHUNK_BYTES = 1 << 20
_LEAST_BYTES = 512
"""One sector of a card: a file system fills what was never written with whole ones."""
_LEAST_REMARKED_BYTES = 4096
_MOSTLY = 0.5
_FILLS = {b"\0": "zeros", b"\xff": "erased flash memory (bytes of 0xFF)"}
_AGAIN = "copy it again from the vehicle"


@dataclass(frozen=True, kw_only=True, slots=True)
class BlankTail:
    """The end of a file that holds one byte alone.

    Parameters
    ----------
    start, size
        First byte of it, and bytes of the file.
    fill
        The byte.
    """

    start: int
    size: int
    fill: bytes

    @property
    def share(self) -> float:
        """Share of the file."""
        return (self.size - self.start) / self.size

    @property
    def words(self) -> str:
        """What the file holds there, as the end of a sentence."""
        what = _FILLS[self.fill]
        if not self.start:
            return f"contains only {what}, {self.size} bytes"
        return f"contains only {what} from byte {self.start} of {self.size} on"

    def error(self, name: str, cause: LogError) -> LogError:
        """The error of a file that cannot be read for it, or also for it."""
        erased = self.fill != b"\0"
        if self.share > _MOSTLY:
            remedy = "nothing was logged: fly again" if erased else f"{_AGAIN}; the same again means a damaged card"
            return LogError(f"{name} {self.words}", needed="a log that was written to its end", remedy=remedy)
        return LogError(
            f"{name} {self.words}, and the part before cannot be read: {cause.came}",
            needed=cause.needed,
            remedy=f"{_AGAIN}; else {cause.remedy}" if cause.remedy else _AGAIN,
        )

    def finding(self) -> Finding | None:
        """The remark on a log that was read up to there; ``None`` for few bytes and for flash, which ends so."""
        if self.fill != b"\0" or self.size - self.start < _LEAST_REMARKED_BYTES:
            return None
        return warn(
            "corrupt_log",
            f"byte {self.start}",
            f"The file {self.words}: only what is before was read. Copy it again from the vehicle.",
            first_byte=self.start,
            size_bytes=self.size,
        )


def blank_tail(path: Path) -> BlankTail | None:
    """The end of a file that holds zeros, or 0xFF, alone; ``None`` where that is less than a sector.

    Parameters
    ----------
    path
        An unpacked file. It is read from its end, as far as it is blank.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder) / "log.bin"
    ...     _ = log.write_bytes(b"head" + bytes(2000))
    ...     blank_tail(log).words
    'contains only zeros from byte 4 of 2004 on'
    """
    with path.open("rb") as file:
        size = position = file.seek(0, os.SEEK_END)
        fill = b""
        while position:
            begin = max(position - _CHUNK_BYTES, 0)
            file.seek(begin)
            chunk = file.read(position - begin)
            fill = fill or chunk[-1:]
            if fill not in _FILLS:
                return None
            position = begin + len(chunk.rstrip(fill))
            if position > begin:
                break
    return BlankTail(start=position, size=size, fill=fill) if size - position >= min(_LEAST_BYTES, size) > 0 else None
