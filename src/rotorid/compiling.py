"""Kernels compiled by Numba, and kept for the next command where there is a place for that."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_CACHES = {"darwin": "~/Library/Caches", "win32": "~/AppData/Local"}


def kept_in() -> tuple[Path, ...]:
    """Folders for compiled code, in the order in which Numba tries them.

    That is the one of the user's choice, or the package and then the user's cache, if there is a home.
    """
    if own := os.environ.get("NUMBA_CACHE_DIR"):
        return (Path(own),)
    package = Path(__file__).resolve().parent
    caches = Path(os.environ.get("XDG_CACHE_HOME") or _CACHES.get(sys.platform, "~/.cache"))
    try:
        return package, caches.expanduser() / "numba"
    except RuntimeError:
        return (package,)


def kept_apart(folder: Path) -> Path:
    """Where commands keep compiled code that may write neither to the package nor to the cache of other commands.

    Compiled code is code: a command that a hostile log has taken over must not leave any for commands that are not
    confined.

    Parameters
    ----------
    folder
        What such a command may write, for users without a cache.
    """
    *_, last = kept_in()
    return folder / "compiled" if last == Path(__file__).resolve().parent else last / "confined"


def njit(*signatures: str, **options: Any) -> Callable[[Kernel], Kernel]:
    """The decorator of Numba of the same name, which neither needs a place for compiled code nor room there.

    Where Numba can write neither to the package nor to the user's cache, as in a container that is read-only, it
    refuses to define a function; without a home it makes a folder of the name ``~``; on a full disk the first call
    fails. Here the function is then compiled anew in each process.

    Parameters
    ----------
    signatures, options
        As :func:`numba.njit` takes them.

    Examples
    --------
    >>> @njit(cache=True)
    ... def twice(x):
    ...     return 2 * x
    >>> twice(4)
    8
    """
    import numba

    untyped: Any = numba.njit

    def made_of(function: Kernel) -> Kernel:
        places = kept_in()
        homeless = len(places) == 1 and not os.access(places[0], os.W_OK) and "NUMBA_CACHE_DIR" not in os.environ
        wanted = {**options, "cache": options.get("cache", False) and not homeless}
        try:
            made: Any = untyped(*signatures, **wanted)(function)
        except (RuntimeError, OSError):
            made = untyped(*signatures, **{**options, "cache": False})(function)
        for name in ("load_overload", "save_overload"):
            setattr(made._cache, name, _or_nothing(getattr(made._cache, name)))
        compiled: Kernel = made
        return compiled

    return made_of


def _or_nothing(call: Callable[..., Any]) -> Callable[..., Any]:
    """A call to files of compiled code: what cannot be read or written is not there."""

    def tried(*given: Any) -> Any:
        try:
            return call(*given)
        except OSError:
            return None

    return tried
