"""Keys of a mapping file with the types that they need; every mistake names the table, the key and what to write."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

from rotorid.errors import UsageError
from rotorid.units import parse_unit


def nearest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """The known names that look most like ``name``, as words for a message; empty when none does.

    Examples
    --------
    >>> nearest("pich_command", ["pitch_command", "yaw_command", "battery_voltage"])
    'pitch_command, yaw_command'
    """
    return ", ".join(difflib.get_close_matches(name, list(known), n=3, cutoff=likeness))


def only_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Refuse a key that means nothing here."""
    for key in table:
        if key not in known:
            raise UsageError(
                f"{where} has a key `{key}`",
                needed=f"one of {', '.join(known)}",
                remedy=f"did you mean {close}?" if (close := nearest(key, known)) else "remove it",
            )


def table(value: object, where: str) -> Mapping[str, Any]:
    """A table, as ``[name]`` or ``{...}`` writes it."""
    if not isinstance(value, Mapping):
        raise UsageError(f"{where} is {value!r}", needed="a table", remedy="write it as in the documentation of --map")
    return value


def text(values: Mapping[str, Any], key: str, where: str) -> str:
    """A name that must be there."""
    value = values.get(key)
    if not isinstance(value, str) or not value:
        came = f"has no `{key}`" if value is None else f"has `{key}` = {value!r}"
        raise UsageError(f"{where} {came}", needed="a name in quotes", remedy=f'write {key} = "NAME"')
    return value


def names(values: Mapping[str, Any], key: str, count: int | None, where: str) -> tuple[str, ...]:
    """A list of names, or of whole numbers that serve as such; each once."""
    value = values.get(key)
    number = "several" if count is None else str(count)
    if (
        not isinstance(value, list)
        or not value
        or (count is not None and len(value) != count)
        or not all((isinstance(item, str) and item) or type(item) is int for item in value)
        or len({str(item) for item in value}) < len(value)
    ):
        came = f"has no `{key}`" if value is None else f"has `{key}` = {value!r}"
        raise UsageError(
            f"{where} {came}", needed=f"a list of {number} different names", remedy=f'write {key} = ["A", "B", ...]'
        )
    return tuple(str(item) for item in value)


def number(values: Mapping[str, Any], key: str, where: str) -> float | None:
    """A finite number, or ``None`` where the key is missing."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
        raise UsageError(f"{where} has `{key}` = {value!r}", needed="a finite number", remedy="write it without quotes")
    return float(value)


def band(values: Mapping[str, Any], key: str, where: str) -> tuple[float, float] | None:
    """Two rising numbers above zero, or ``None`` where the key is missing."""
    if key not in values:
        return None
    value = values[key]
    ends = {str(place): end for place, end in enumerate(value)} if isinstance(value, list) else {}
    low, high = number(ends, "0", f"{where} `{key}`"), number(ends, "1", f"{where} `{key}`")
    if len(ends) != 2 or low is None or high is None or not 0.0 < low < high:
        raise UsageError(
            f"{where} has `{key}` = {value!r}", needed="two rising numbers above zero", remedy="write [LOW, HIGH]"
        )
    return low, high


def index(values: Mapping[str, Any], key: str, where: str) -> int | None:
    """A place counted from zero, or ``None`` where the key is missing."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise UsageError(f"{where} has `{key}` = {value!r}", needed="a whole number from 0", remedy="count from zero")
    return value


def choice(values: Mapping[str, Any], key: str, known: Sequence[str], default: str, where: str) -> str:
    """One of a few words."""
    value = values.get(key, default)
    if value not in known:
        raise UsageError(f"{where} has `{key}` = {value!r}", needed=f"one of {', '.join(known)}", remedy="correct it")
    return str(value)


def unit(values: Mapping[str, Any], key: str, si: str, where: str) -> str:
    """A unit that measures what it should, or the empty text where the key is missing.

    Parameters
    ----------
    values, key, where
        The table, the key in it, and what the messages call the table.
    si
        SI unit of the quantity; empty when any known unit will do.
    """
    if key not in values:
        return ""
    found = text(values, key, where)
    try:
        measured = parse_unit(found).si
    except UsageError as error:
        raise UsageError(f"{where} `{key}`: {error.came}", needed=error.needed, remedy=error.remedy) from error
    if si and measured != si:
        raise UsageError(
            f"{where} `{key}` is {found!r}", needed=f"a unit of {si}", remedy="correct the unit or the channel name"
        )
    return found


def file_below(values: Mapping[str, Any], where: str) -> str:
    """The key ``file``: a path that cannot lead out of the log's folder, or the empty text where it is missing."""
    if "file" not in values:
        return ""
    found = text(values, "file", where)
    as_windows = PureWindowsPath(found)
    leads_away = PurePosixPath(found).is_absolute() or as_windows.anchor or ".." in as_windows.parts
    if leads_away or "\0" in found:
        raise UsageError(
            f"{where} has `file` = {found!r}",
            needed="a path below the folder of the log",
            remedy="put the file next to the log and give its name alone",
        )
    return found
