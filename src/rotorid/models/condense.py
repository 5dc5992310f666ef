"""States that have become algebraic, because a lag is zero, leave the equations."""

from __future__ import annotations

from collections.abc import Set
from typing import NamedTuple

from rotorid.models.expression import Expression

Row = tuple[Expression, ...]
Rows = tuple[Row, ...]

_MINUS_ONE = Expression(number=-1.0)


class Matrices(NamedTuple):
    """The entries of a structure, and which of its states they still have."""

    states: tuple[str, ...]
    M: Rows
    F: Rows
    G: Rows
    H0: Rows
    H1: Rows


def condense(matrices: Matrices, zero: Set[str]) -> Matrices:
    """The same equations without the states that follow the inputs at once.

    A row :math:`0 = -x_j + G_i u`, which is one only because parameters are zero, says what :math:`x_j` is; it then
    stands for it in the others, as long as no output and no derivative needs the state itself.

    Parameters
    ----------
    matrices
        Entries of the structure.
    zero
        Parameters that are zero for good.
    """
    while (found := _algebraic(matrices, zero)) is not None:
        matrices = _without(matrices, *found)
    return matrices


def _algebraic(matrices: Matrices, zero: Set[str]) -> tuple[int, int] | None:
    """The first row that says what a state is, and that state."""
    nothing = dict.fromkeys(zero, 0.0)
    lags = [[entry.substitute(nothing) if entry.names & zero else entry for entry in row] for row in matrices.M]
    for i, row in enumerate(matrices.F):
        own = [j for j, entry in enumerate(row) if not entry.is_zero]
        became = any(entry.names & zero for entry in matrices.M[i]) and all(lag.is_zero for lag in lags[i])
        if not became or len(own) != 1 or row[own[0]] != _MINUS_ONE:
            continue
        j = own[0]
        columns = (*lags, *matrices.H0, *matrices.H1)
        if all(column[j].is_zero for column in columns):
            return i, j
    return None


def _without(matrices: Matrices, i: int, j: int) -> Matrices:
    """The equations with row ``i`` used up to replace state ``j`` by the inputs."""

    def cut(row: Row) -> Row:
        return row[:j] + row[j + 1 :]

    rows = [r for r in range(len(matrices.F)) if r != i]
    said = matrices.G[i]
    return Matrices(
        states=tuple(state for k, state in enumerate(matrices.states) if k != j),
        M=tuple(cut(matrices.M[r]) for r in rows),
        F=tuple(cut(matrices.F[r]) for r in rows),
        G=tuple(
            tuple(own + matrices.F[r][j] * through for own, through in zip(matrices.G[r], said, strict=True))
            for r in rows
        ),
        H0=tuple(cut(row) for row in matrices.H0),
        H1=tuple(cut(row) for row in matrices.H1),
    )
