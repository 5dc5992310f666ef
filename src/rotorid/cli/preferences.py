r"""What a person prefers: a file of a few lines that changes how results look and where they go, and no number.

``~/.config/rotorid.toml`` (``%APPDATA%\rotorid.toml`` on Windows; ``ROTORID_SETTINGS`` names another place, or none if
it is empty)::

    frequency = "Hz"         # or "rad/s": what pages and the lab show first
    magnitude = "linear"     # or "dB"
    theme = "dark"           # or "light"; without it as the system asks
    out = "~/flights/out"    # instead of rotorid-out
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from rotorid.errors import UsageError

CHOICES: Final = {"frequency": ("rad/s", "Hz"), "magnitude": ("dB", "linear"), "theme": ("light", "dark")}
"""Keys that take one of a few words."""

_MOST_BYTES = 1 << 16


@dataclass(frozen=True, kw_only=True)
class Preferences:
    """What the file says; what it does not is ``None``.

    Parameters
    ----------
    frequency, magnitude
        Units that pages and the lab show first.
    theme
        Of pages and the lab.
    out
        Folder that results go below.
    """

    frequency: str | None = None
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
    return Preferences() if file is None or not file.is_file() else read_preferences(file)


def read_preferences(file: Path) -> Preferences:
    """Read a file of preferences.

    Raises
    ------
    UsageError
        As :func:`preferences`.
    """
    import tomllib

    try:
        if file.stat().st_size > _MOST_BYTES:
            raise UsageError(f"{file} is larger than a file of settings", needed="a few lines")
        told = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise UsageError(
            f"the settings in {file} cannot be read: {why}", needed="lines such as theme = 'dark'"
        ) from None
    return Preferences(**{key: _checked(file, key, value) for key, value in told.items()})


def _checked(file: Path, key: str, value: Any) -> Any:
    if key == "out" and isinstance(value, str) and value:
        return Path(value).expanduser()
    if key in CHOICES and value in CHOICES[key]:
        return value
    if key not in (*CHOICES, "out"):
        raise UsageError(f"{file} sets {key!r}, which is not known", needed=f"one of {', '.join((*CHOICES, 'out'))}")
    wanted = "a folder" if key == "out" else " or ".join(repr(word) for word in CHOICES[key])
    raise UsageError(f"{file} sets {key} = {value!r}", needed=wanted)


def results_folder() -> Path:
    """The folder that results go below when no ``--out`` is given."""
    return preferences().out or Path("rotorid-out")
