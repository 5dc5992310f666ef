"""Logs that were named: files as they are, folders by the logs that they hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rotorid.errors import UsageError
from rotorid.io.formats import ENDINGS, PACKED


def logs_in(paths: Sequence[Path], *, archives: bool = False) -> list[Path]:
    """The logs behind what was named, each once: of a folder all logs below it, in the order of their names.

    A folder that is itself one log, of ``ulog2csv`` files, stays as it is.

    Parameters
    ----------
    archives
        Whether a ``.zip`` of any name counts, which may hold many logs.

    Raises
    ------
    UsageError
        A folder holds no log.
    """
    return list(dict.fromkeys(log for path in paths for log in _behind(path, archives)))


def _behind(path: Path, archives: bool) -> Iterator[Path]:
    from rotorid.io.px4.folder import is_folder_log

    if not path.is_dir() or is_folder_log(path):
        yield path
        return
    found = sorted(
        file
        for file in path.rglob("*")
        if file.is_file() and (is_log(file) or (archives and file.suffix.lower() == ".zip")) and not _hidden(file, path)
    )
    if not found:
        raise UsageError(
            f"{path} contains no flight log", needed=f"files that end in {', '.join(sorted(ENDINGS))}, packed or not"
        )
    yield from found


def is_log(file: Path) -> bool:
    """Whether a file is called like a log, packed or not."""
    suffixes = [suffix.lower() for suffix in file.suffixes]
    if suffixes and suffixes[-1] in PACKED:
        suffixes.pop()
    return bool(suffixes) and suffixes[-1] in ENDINGS


def _hidden(file: Path, below: Path) -> bool:
    return any(part.startswith(".") for part in file.relative_to(below).parts)
