"""Options of searches as text, and budgets."""

from __future__ import annotations

from rotorid.errors import UsageError


def whole_number(text: str, *, of: str, needed: str) -> int:
    """A positive whole number.

    Parameters
    ----------
    text
        As it was given.
    of
        The search whose option it is, for the message.
    needed
        What its options look like.

    Raises
    ------
    UsageError
        It is no such number.

    Examples
    --------
    >>> whole_number("64", of="sobol", needed="sobol:64")
    64
    """
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise UsageError(f"{text!r} came as an option of the search {of}", needed=f"positive numbers as in {needed}")
    return int(text)


def no_options(text: str, *, of: str) -> None:
    """Refuse options of a search that has none.

    Raises
    ------
    UsageError
        There are some.
    """
    if text:
        raise UsageError(f"{of}:{text} came", needed=f"{of}, which has no options")


def require_budget(budget: int, least: int) -> None:
    """Refuse a budget that does not pay the beginning of a search.

    Raises
    ------
    UsageError
        It is too small.
    """
    if budget < least:
        raise UsageError(f"a budget of {budget} evaluations came", needed=f"{least} or more")
