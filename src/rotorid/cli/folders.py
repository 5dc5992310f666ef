"""Logs in folders: other files are skipped and listed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rotorid.cli.console import log_progress, say
from rotorid.io.named import find_logs, linked_words, skipped_words

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord


@dataclass(frozen=True, kw_only=True)
class Found:
    """Files behind what a user named.

    Parameters
    ----------
    files
        Those that were named themselves, and those of folders that are logs by their names or their content.
    named
        Those that were named themselves: one that is no log is an error.
    others
        Files of folders that are no logs by their names and their content.
    linked
        Links that lead out of the folders.
    skipped
        Files of folders that were tried and are no logs.
    failed
        Files that were named themselves and cannot be read, where this ends no other.
    """

    files: Sequence[Path]
    named: frozenset[Path]
    others: Sequence[Path] = ()
    linked: Sequence[Path] = ()
    skipped: list[Path] = field(default_factory=list)
    failed: list[Path] = field(default_factory=list)

    @classmethod
    def behind(cls, paths: Sequence[Path]) -> Found:
        """The files behind paths.

        Raises
        ------
        UsageError
            A folder holds no log.
        """
        found = find_logs(paths)
        named = frozenset(paths).intersection(found.files)
        return cls(files=found.files, named=named, others=found.skipped, linked=found.linked)

    def records(self, mapping: Path | None, *, each_alone: bool = False) -> Iterator[FlightRecord]:
        """Read one file after the other; those of folders that are no logs are left out, and remembered.

        Parameters
        ----------
        mapping
            What the columns of a foreign table are.
        each_alone
            Nothing is made of all of them together: of a file that was named and cannot be read the error is said at
            once, and the next one read.

        Raises
        ------
        LogError
            A file that was named itself cannot be read and ends the others, or none of all can.
        UsageError
            The mapping is wrong.
        """
        from rotorid.errors import LogError, UsageError
        from rotorid.io.registry import read

        for number, log in enumerate(self.files):
            log_progress(f"reading {log.name}", extra={"done": number, "total": len(self.files)})
            try:
                record = read(log, mapping=mapping)
            except (LogError, UsageError) as error:
                # A foreign table is wrong use where it was named, is all that came, or where a mapping was made for it.
                if len(self.files) == 1 or (mapping is not None and isinstance(error, UsageError)):
                    raise
                if log not in self.named:
                    self.skipped.append(log)
                    continue
                if not each_alone:
                    raise
                say(f"rotorid: {error}")
                self.failed.append(log)
                continue
            yield record
        if len(self.failed) == len(self.files):
            raise LogError(f"none of {len(self.files)} files can be read", needed="at least one flight log")
        if len(self.failed) + len(self.skipped) == len(self.files):
            raise LogError(
                f"no flight log found, only {skipped_words(self._skipped())}", needed="at least one flight log"
            )

    @property
    def read(self) -> list[Path]:
        """Files that could be read."""
        return [file for file in self.files if file not in self.skipped and file not in self.failed]

    def say_skipped(self) -> None:
        """Name what was left out, in one remark."""
        if skipped := self._skipped():
            say(f"rotorid: skipped {skipped_words(skipped)}")
        if self.linked:
            say(f"rotorid: skipped {linked_words(self.linked)}")

    def _skipped(self) -> list[Path]:
        return sorted({*self.skipped, *self.others})
