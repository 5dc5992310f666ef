"""What a flight does not show and why, part by part, and one row for those that differ in their axes alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.errors import FaultError, InsufficientDataError, RotoridError, reason_of


@dataclass(frozen=True, kw_only=True)
class Unavailable(Immutable):
    """What a flight does not show.

    Parameters
    ----------
    what
        Name of the quantity, such as ``loops.p.rise_time_s`` or ``models.rate.yaw``.
    why
        What was missing: one sentence, or two of which the first is enough.
    remedy
        The one maneuver, setting or command that would measure it, as a clause; empty where there is none.
    fault
        Whether it is missing because rotorid failed, not because of the data.
    """

    what: str
    why: str
    remedy: str = ""
    fault: bool = False


Part = TypeVar("Part")


def section(
    what: str, make: Callable[[], tuple[Part, Sequence[Unavailable]]], otherwise: Part
) -> tuple[Part, tuple[Unavailable, ...]]:
    """A part of a review with what it does not show; a part that fails leaves its reason, and all others as they are.

    Parameters
    ----------
    what
        Name of the part, as in :class:`Unavailable`.
    make
        Makes it.
    otherwise
        What stands for it where it fails.

    Raises
    ------
    Exception
        See :func:`rotorid.errors.reason_of`.
    """
    try:
        made, missing = make()
    except Exception as error:
        return otherwise, (unavailable_by(reason_of(error, what), what),)
    return made, tuple(missing)


def unavailable_by(error: RotoridError, what: str) -> Unavailable:
    """What an error leaves without an answer."""
    findings = error.findings if isinstance(error, InsufficientDataError) else ()
    why = str(findings[0].message) if findings else error.reason
    return Unavailable(what=what, why=why, remedy=error.remedy, fault=isinstance(error, FaultError))


_AXIS_WORDS = re.compile(r"\b(?:cmd_)?(roll|pitch|yaw|thrust|p|q|r|phi|theta|psi)(_setpoint|_stick|_command|Rate)?\b")
"""Words of an axis. Rows that differ in these alone become one row that lists them."""

_AXES = {"p": "roll", "phi": "roll", "q": "pitch", "theta": "pitch", "r": "yaw", "psi": "yaw"}


def merged_axes(rows: Iterable[Unavailable]) -> tuple[Unavailable, ...]:
    """One row for those that differ in their axes alone; each of these rows is about a single axis.

    Examples
    --------
    >>> idle = [Unavailable(what=f"rate.{axis}", why=f"The {axis} stick did not move.") for axis in ("roll", "yaw")]
    >>> [(row.what, row.why) for row in merged_axes(idle)]
    [('rate.roll; rate.yaw', 'The roll and yaw sticks did not move.')]
    """
    alike: dict[tuple[str, str], list[Unavailable]] = {}
    for row in rows:
        several = len({_AXES.get(found[1], found[1]) for found in _AXIS_WORDS.finditer(f"{row.why} {row.remedy}")}) > 1
        words = (row.why, row.remedy) if several else (_AXIS_WORDS.sub("…", row.why), _AXIS_WORDS.sub("…", row.remedy))
        alike.setdefault(words, []).append(row)
    return tuple(
        Unavailable(
            what="; ".join(row.what for row in same),
            why=_of_all_axes([row.why for row in same]),
            remedy=_of_all_axes([row.remedy for row in same]),
        )
        for same in alike.values()
    )


def _of_all_axes(sentences: Sequence[str]) -> str:
    """Sentences that differ in their axes as one that lists them.

    Examples
    --------
    >>> _of_all_axes(["move the roll stick", "move the pitch stick", "move the roll stick"])
    'move the roll and pitch sticks'
    >>> _of_all_axes(["the pitch stick does not move", "the yaw stick does not move"])
    'the pitch and yaw sticks do not move'
    """
    words = [[found.group() for found in _AXIS_WORDS.finditer(sentence)] for sentence in sentences]
    each = iter([listed(list(dict.fromkeys(same))) for same in zip(*words, strict=True)])
    merged = _AXIS_WORDS.sub(lambda _: next(each), sentences[0])
    return re.sub(r"( and \w+ stick)\b", r"\1s", merged).replace("sticks does not", "sticks do not")
