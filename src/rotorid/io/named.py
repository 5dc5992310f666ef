"""Logs that were named: files as they are, folders by the logs that they hold."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path

from rotorid.data.display import counted
from rotorid.errors import LogError, UsageError
from rotorid.io.formats import ENDINGS, HEAD_BYTES, PACKED, READERS

_MOST_NAMES = 5
_ARCHIVE = ".zip"
_SHARED = tuple(f"{ending}{packed}" for ending in (".txt", ".log", ".data") for packed in ("", *PACKED))
"""Endings that logs and notes share."""


@dataclass(frozen=True, kw_only=True, slots=True)
class FoundLogs:
    """What lies behind the paths that a user named.

    Parameters
    ----------
    files
        The logs, each once: of a folder all logs below it, in the order of their names.
    skipped
        Other files of the folders: neither their names nor their first bytes are those of a log.
    linked
        Links in the folders that lead out of them, which are not followed.
    """

    files: tuple[Path, ...]
    skipped: tuple[Path, ...] = ()
    linked: tuple[Path, ...] = ()


def find_logs(paths: Sequence[Path], *, archives: bool = False) -> FoundLogs:
    """The logs behind what was named, and what the folders hold besides.

    A folder that is itself one log, of ``ulog2csv`` files, stays as it is. Hidden files are not looked at, and links
    that lead out of a folder are not followed: who packed it would choose what is read.

    Parameters
    ----------
    archives
        Whether a ``.zip`` of any name counts, which may hold many logs.

    Raises
    ------
    UsageError
        A folder holds no log.
    """
    files: dict[Path, None] = {}
    skipped: dict[Path, None] = {}
    linked: dict[Path, None] = {}
    for path in paths:
        logs, others, links = _behind(path, archives)
        files |= dict.fromkeys(logs)
        skipped |= dict.fromkeys(others)
        linked |= dict.fromkeys(links)
    return FoundLogs(
        files=tuple(files),
        skipped=tuple(path for path in skipped if path not in files),
        linked=tuple(path for path in linked if path not in files),
    )


def _behind(path: Path, archives: bool) -> tuple[list[Path], list[Path], list[Path]]:
    from rotorid.io.px4.folder import is_folder_log

    if not path.is_dir() or is_folder_log(path):
        return [path], [], []
    logs: list[Path] = []
    others: list[Path] = []
    links: list[Path] = []
    root = path.resolve()
    for file in sorted(_visible(path)):
        if file.is_symlink() and not file.resolve().is_relative_to(root):
            links.append(file)
            continue
        archive = archives and file.suffix.lower() == _ARCHIVE
        (logs if archive or holds_log(file, partial(_head, file)) else others).append(file)
    if not logs and links:
        raise UsageError(
            f"{path} contains no flight log, only {linked_words(links)}",
            needed="logs in the folder",
            remedy="name the folder or the files that they lead to",
        )
    if not logs:
        raise UsageError(
            f"{path} contains no flight log" + (f", only {skipped_words(others)}" if others else ""),
            needed=f"files that end in {', '.join(sorted(ENDINGS))}, packed or not, or logs without an ending",
        )
    return logs, others, links


def _visible(folder: Path) -> Iterator[Path]:
    for file in folder.rglob("*"):
        if file.is_file() and not any(part.startswith(".") for part in file.relative_to(folder).parts):
            yield file


def is_log(file: Path) -> bool:
    """Whether a file is called like a log, packed or not."""
    suffixes = [suffix.lower() for suffix in file.suffixes]
    if suffixes and suffixes[-1] in PACKED:
        suffixes.pop()
    return bool(suffixes) and suffixes[-1] in ENDINGS


def holds_log(file: Path, head: Callable[[], bytes]) -> bool:
    """Whether a file of a folder, an archive or a store is a log: by its ending, or by its first bytes.

    Parameters
    ----------
    file
        Its name.
    head
        Gives its first bytes, none where they cannot be had; asked where the name does not answer.
    """
    if not is_log(file):
        return starts_like_log(head())
    return not (file.name.lower().endswith(_SHARED) and _is_prose(head()))


def _is_prose(head: bytes) -> bool:
    """Whether a text has nothing of a log or a table in it."""
    return bool(head) and b"\0" not in head and not any(import_module(row.module).sniff(head) for row in READERS)


def _head(file: Path) -> bytes:
    """First bytes of a file, unpacked where it is compressed."""
    from rotorid.io.files import beginning

    try:
        return beginning(file, HEAD_BYTES)
    except (LogError, OSError):
        return b""


def starts_like_log(head: bytes) -> bool:
    r"""Whether a file that starts like this is a log, as on a Crazyflie's card the one that is called ``log00``.

    Examples
    --------
    >>> starts_like_log(b"ULog\x01\x12\x35\x01"), starts_like_log(b"part,grams\n")
    (True, False)
    """
    return bool(head) and any(import_module(reader.module).sniff(head) for reader in READERS if reader.by_content)


def skipped_words(skipped: Iterable[Path | str]) -> str:
    """Files that are no logs, counted and named.

    Examples
    --------
    >>> skipped_words(["a.txt", "photos/b.png"])
    '2 files that are no logs: a.txt, b.png'
    """
    names = [Path(file).name for file in skipped]
    are = "that is no log" if len(names) == 1 else "that are no logs"
    return f"{counted(len(names), 'file')} {are}: {_first(names)}"


def linked_words(linked: Iterable[Path]) -> str:
    """Links that are not followed, counted and named.

    Examples
    --------
    >>> linked_words([Path("a.ulg")])
    '1 link that leads out of the folder: a.ulg'
    """
    names = [file.name for file in linked]
    lead = "that leads" if len(names) == 1 else "that lead"
    return f"{counted(len(names), 'link')} {lead} out of the folder: {_first(names)}"


def _first(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"{', '.join(names[:_MOST_NAMES])}{more}"
