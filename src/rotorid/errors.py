"""What can go wrong, as one small tree.

Every error has three parts as attributes: what is wrong, what was expected, and what to do about it. Wrong use and
unreadable files end a command with exit code 2. Data that do not support an answer end it with exit code 1 and the
findings that explain why.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from rotorid.letters import visible

if TYPE_CHECKING:
    from rotorid.data.findings import Finding


class RotoridError(Exception):
    """Base of every error that rotorid raises on purpose."""

    exit_code = 2
    #: The words before what was expected.
    before_needed = "expected"

    def __init__(self, came: str, *, needed: str = "", remedy: str = "") -> None:
        # Names and words of files and people stand in all three.
        self.came, self.needed, self.remedy = (visible(" ".join(words.split("\n"))) for words in (came, needed, remedy))
        sentence = "; ".join(part.rstrip(".") for part in (self.came, self.expectation, self.remedy) if part)
        super().__init__(sentence if sentence.endswith("?") else f"{sentence}.")

    @property
    def reason(self) -> str:
        """What is wrong and what was expected, as a sentence, without the remedy."""
        text = "; ".join(part.rstrip(".") for part in (self.came, self.expectation) if part)
        word = text.partition(" ")[0]
        return f"{word.capitalize() if word.isalpha() and word.islower() else word}{text[len(word) :]}."

    @property
    def expectation(self) -> str:
        """What was expected, as part of the sentence; empty if nothing was named."""
        return f"{self.before_needed} {self.needed}" if self.needed else ""


class UsageError(RotoridError):
    """The call was wrong: an unknown name, an impossible option, a value out of range."""


class LogError(RotoridError):
    """A file cannot be read as a flight log: foreign, damaged, empty or missing."""


class ModelError(RotoridError):
    """A model description is wrong: an unknown parameter, a wrong shape, a loop of ties."""


class InsufficientDataError(RotoridError):
    """The log was read, but its data do not support what was asked. Carries the findings that explain why."""

    exit_code = 1
    before_needed = "this needs"

    def __init__(self, came: str, *, needed: str = "", remedy: str = "", findings: Sequence[Finding] = ()) -> None:
        super().__init__(came, needed=needed, remedy=remedy)
        self.findings = tuple(findings)


class FaultError(RotoridError):
    """A part of an answer ended by an exception that nobody foresaw: a fault of rotorid, not of the log."""


STRICT = "ROTORID_STRICT"
"""Variable of the environment that makes :func:`reason_of` raise faults, so that tests see them."""

_FAULTS = logging.getLogger("rotorid.errors")


def reason_of(error: Exception, part: str) -> RotoridError:
    """Why one part of an answer is missing, while the others stay.

    Errors of rotorid give their own reason. Any other exception is a fault of the program: it is logged with its
    traceback, and the reason asks the user to report it.

    Parameters
    ----------
    error
        What ended the part.
    part
        Name of the part, such as ``motors``.

    Raises
    ------
    Exception
        The fault itself, where the environment sets ``ROTORID_STRICT``; a lack of memory always.

    Examples
    --------
    >>> print(reason_of(UsageError("unknown layout 'x'"), "motors"))
    unknown layout 'x'.
    """
    if isinstance(error, RotoridError):
        return error
    if os.environ.get(STRICT) or isinstance(error, MemoryError):
        raise error
    _FAULTS.debug("%s failed", part, exc_info=error)
    words = " ".join(str(error).split())[:200]
    fault = f"{type(error).__name__}: {words}" if words else type(error).__name__
    return FaultError(
        f"{part} could not be computed because of a fault in rotorid ({fault})",
        remedy="please report it with this log",
    )


_MOST_NAMES = 5
_LIKENESS = 0.6


def unknown_name(
    kind: str,
    name: str,
    known: Iterable[str],
    *,
    synonyms: Mapping[str, str] | None = None,
    see: str = "",
) -> UsageError:
    """The error for a name that does not exist: the one that was probably meant, or else a few that do exist.

    Parameters
    ----------
    kind
        What the name is of: ``axis``, ``command``.
    known
        All names that exist.
    synonyms
        Other words to the names that are meant.
    see
        Command that lists all names.

    Examples
    --------
    >>> print(unknown_name("axis", "rolll", ["roll", "pitch", "yaw"]))
    unknown axis 'rolll'; did you mean roll?
    >>> print(unknown_name("axis", "x", ["roll", "pitch", "yaw"]))
    unknown axis 'x'; expected roll, pitch or yaw.
    """
    names = list(known)
    came = f"unknown {kind} {name!r}"
    if near := (synonyms or {}).get(name.lower(), "") or nearest_name(name, names):
        return UsageError(came, remedy=f"did you mean {near}?")
    return UsageError(came, needed=listed(names), remedy=f"{see} lists all" if see and len(names) > _MOST_NAMES else "")


def nearest_name(name: str, known: Iterable[str]) -> str:
    """The name that was probably meant; empty if none is near.

    Examples
    --------
    >>> nearest_name("Pich", ["roll", "pitch"]), nearest_name("identifying", ["identify"]), nearest_name("x", ["roll"])
    ('pitch', 'identify', '')
    """
    from difflib import get_close_matches

    lower = {other.lower(): other for other in known}
    word = name.strip().lower()
    near = get_close_matches(word, lower, n=1, cutoff=_LIKENESS)
    least = 3
    begins = [other for other in lower if len(word) >= least and (other.startswith(word) or word.startswith(other))]
    return lower[(near or begins)[0]] if near or begins else ""


def listed(names: Sequence[str]) -> str:
    """A few names as a choice.

    Examples
    --------
    >>> listed(["roll", "pitch", "yaw"]), listed("abcdefgh")
    ('roll, pitch or yaw', 'one of a, b, c, d, e, ... (8 in all)')
    """
    if len(names) > _MOST_NAMES:
        return f"one of {', '.join(names[:_MOST_NAMES])}, ... ({len(names)} in all)"
    return " or ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)
