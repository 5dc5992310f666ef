"""What can be asked of searches and bootstraps, and what goes together."""

from __future__ import annotations

from rotorid.errors import UsageError

EVALUATIONS = 2000
"""Budget of a search unless another is asked for."""

_FEWEST_RUNS = 2


def require_search(search: str | None, evaluations: int | None, starts: str) -> None:
    """Refuse searches that there are not, and options that need one.

    Parameters
    ----------
    search
        A name of :func:`rotorid.search.catalog.searches` with its options.
    evaluations
        Its budget, where one was asked for.
    starts
        The design of starts, ``default`` for none.

    Raises
    ------
    UsageError
        There is no such search, or what came does not go together.
    """
    if search is None:
        if evaluations is not None:
            raise UsageError("--evaluations came without a search", needed="--search NAME beside it")
        return
    if starts != "default":
        raise UsageError("--search and --starts came", needed="one of them: a design of starts is a search too")
    if evaluations is not None and evaluations < 1:
        raise UsageError(f"a budget of {evaluations} evaluations came", needed="1 or more")
    from rotorid.search.catalog import search as known

    known(search)


def require_runs(runs: int | None) -> None:
    """Refuse a bootstrap of less than two runs.

    Raises
    ------
    UsageError
        There are fewer.
    """
    if runs is not None and runs < _FEWEST_RUNS:
        raise UsageError(f"a bootstrap of {runs} runs came", needed="two or more, and some hundred for intervals")
