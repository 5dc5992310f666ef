"""What lies between the motion and a logged channel."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rotorid.errors import UsageError
from rotorid.signal.known_filter import KnownFilter


@dataclass(frozen=True, kw_only=True, slots=True)
class Passage:
    """Filters that a channel has passed.

    Parameters
    ----------
    filters
        Those that are known.
    doubts
        Why these are not, or perhaps not, all; each the rest of a sentence.
    """

    filters: tuple[KnownFilter, ...] = ()
    doubts: tuple[str, ...] = ()


def doubtful(doubt: str) -> Passage:
    """A passage of which only this is known."""
    return Passage(doubts=(doubt,))


def moving(setting: str, value: float) -> Passage:
    """A filter that follows the motors or a spectrum: no response that is constant in time undoes it."""
    return doubtful(f"a filter that moves in flight is on ({setting} = {value:g}); what it took cannot be given back")


def built(settings: str, make: Callable[[], KnownFilter]) -> Passage:
    """The filter that settings of a log ask for, or that they ask for none that can be."""
    try:
        return Passage(filters=(make(),))
    except UsageError as error:
        return doubtful(f"{settings} makes no filter: {error.came}")


def joined(passages: Iterable[Passage]) -> Passage:
    """One passage behind the other.

    Examples
    --------
    >>> joined([doubtful("a"), Passage(), doubtful("b")]).doubts
    ('a', 'b')
    """
    parts = tuple(passages)
    return Passage(
        filters=tuple(known for part in parts for known in part.filters),
        doubts=tuple(doubt for part in parts for doubt in part.doubts),
    )
