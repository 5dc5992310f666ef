r"""What a person prefers: a file of a few lines that changes how results look and where they go, and no number.

``~/.config/rotorid.toml`` (``%APPDATA%\rotorid.toml`` on Windows; ``ROTORID_SETTINGS`` names another place, or none if
it is empty)::

    frequency = "Hz"         # or "rad/s": unit of frequency on pages and in the lab
    angles = "deg"           # or "rad": in what the lab shows angles and rates of a log
    magnitude = "linear"     # or "dB"
    theme = "dark"           # or "light"; without it as the system asks
    out = "~/flights/out"    # instead of rotorid-out
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from rotorid.errors import UsageError

CHOICES: Final = {
    "frequency": ("rad/s", "Hz"),
    "angles": ("rad", "deg"),
    "magnitude": ("dB", "linear"),
    "theme": ("light", "dark"),
}
"""Keys that take one of a few words."""

_MOST_BYTES = 1 << 16
_NEEDED = "settings, in lines such as theme = 'dark'"


@dataclass(frozen=True, kw_only=True)
class Preferences:
    """The preferences of the file; ``None`` where it has none.

    Parameters
    ----------
    frequency, magnitude
        Units that pages and the lab show first. Without a frequency pages are in Hz where an autopilot that counts in
        Hz flew (PX4, ArduPilot, Betaflight), else in rad/s.
    angles
        Unit of angles and rates in the tracks and spectra of the lab; pages show them in degrees anyway.
    theme
        Of pages and the lab.
    out
        Folder that results go below.
    """

    frequency: str | None = None
    angles: str | None = None
    magnitude: str | None = None
    theme: str | None = None
    out: Path | None = None


def place() -> Path | None:
    """Where the file is looked for."""
    if (named := os.environ.get("ROTORID_SETTINGS")) is not None:
        return Path(named) if named else None
    if sys.platform == "win32":
        folder = os.environ.get("APPDATA")
        return Path(folder) / "rotorid.toml" if folder else None
    folder = os.environ.get("XDG_CONFIG_HOME")
    try:
        return (Path(folder) if folder else Path.home() / ".config") / "rotorid.toml"
    except RuntimeError:
        # Without a home there is no file.
        return None


@cache
def preferences() -> Preferences:
    """What the person at this machine prefers.

    Raises
    ------
    UsageError
        The file cannot be read, or holds a key or a word that is not known.
    """
    file = place()
    if file is None:
        return Preferences()
    named = "ROTORID_SETTINGS" in os.environ
    try:
        # Not asked for, and not there.
        if not named and not file.exists():
            return Preferences()
    except OSError as error:
        raise _unreadable(file, error.strerror or str(error)) from None
    return read_preferences(file)


def read_preferences(file: Path) -> Preferences:
    """Read a file of preferences.

    Raises
    ------
    UsageError
        As :func:`preferences`.
    """
    from rotorid.io.documents import parse_toml, read_text

    text = read_text(file, needed=_NEEDED, most_bytes=_MOST_BYTES)
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise _unreadable(file, " ".join(str(error).split())) from None
    if unknown := [key for key in table if key not in (*CHOICES, "out")]:
        named = " and ".join(f"{key!r}{_line(text, key)}" for key in unknown)
        raise UsageError(
            f"{file} sets {named}, which {'is' if len(unknown) == 1 else 'are'} unknown",
            needed=f"one of {', '.join((*CHOICES, 'out'))}",
        )
    return Preferences(
        **{key: _checked(key, value, f"{file} sets {{}}{_line(text, key)}") for key, value in table.items()}
    )


_KEY = re.compile(r"""[\s\["']{0,40}([\w-]{1,80})["']?\s{0,40}[=.\]]""")
"""The first key of a line, of a table too."""


def _unreadable(file: Path, why: str) -> UsageError:
    remedy = "correct it, or set ROTORID_SETTINGS= to run without it"
    return UsageError(f"the settings in {file} cannot be read: {why}", needed=_NEEDED, remedy=remedy)


def _line(text: str, key: str) -> str:
    """Where a key is set, as a person looks for it."""
    for number, line in enumerate(text.splitlines(), start=1):
        found = _KEY.match(line)
        if found and found[1] == key:
            return f" in line {number}"
    return ""


def _checked(key: str, value: Any, text: str) -> Any:
    """A value that its key can have; ``text`` is the error, with room for both."""
    wanted = "a folder" if key == "out" else " or ".join(repr(word) for word in CHOICES[key])
    if key == "out" and isinstance(value, str) and value and "\0" not in value:
        try:
            return Path(value).expanduser()
        except RuntimeError:
            wanted = "an existing home folder behind ~"
    elif key in CHOICES and value in CHOICES[key]:
        return value
    raise UsageError(text.format(f"{key} = {value!r}"), needed=wanted)


def results_folder() -> Path:
    """The folder that results go below when no ``--out`` is given."""
    return preferences().out or Path("rotorid-out")
