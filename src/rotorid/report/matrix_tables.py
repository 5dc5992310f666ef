"""The identified equations as matrices, with the names of their rows and columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rotorid.pipeline.document import ResultDocument
from rotorid.report.numbers import significant


@dataclass(frozen=True, kw_only=True, slots=True)
class MatrixTable:
    """One matrix of ``M x' = F x + G u(t - tau)``, ``y = H0 x + H1 x'``."""

    symbol: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]


def matrix_tables(document: ResultDocument) -> tuple[MatrixTable, ...]:
    """All matrices that say something: one that is zero, and an identity, are left out.

    Columns of rows are named after states, inputs and outputs where their number fits.
    """
    if document.matrices is None:
        return ()
    matrices, states = document.matrices, document.states
    shapes = (
        ("M", matrices.M, states, states),
        ("F", matrices.F, states, states),
        ("G", matrices.G, states, document.inputs),
        ("H0", matrices.H0, document.outputs, states),
        ("H1", matrices.H1, document.outputs, states),
    )
    return tuple(
        _table(symbol, matrix, rows, columns) for symbol, matrix, rows, columns in shapes if not _plain(matrix)
    )


def _plain(matrix: Sequence[Sequence[float]]) -> bool:
    """Whether a matrix is empty, zero or the identity."""
    entries = [(i, j, value) for i, row in enumerate(matrix) for j, value in enumerate(row)]
    square = len(matrix) == len(matrix[0]) if matrix else True
    identity = square and all(value == float(i == j) for i, j, value in entries)
    return identity or all(value == 0.0 for _, _, value in entries)


def _table(symbol: str, matrix: Sequence[Sequence[float]], rows: Sequence[str], columns: Sequence[str]) -> MatrixTable:
    return MatrixTable(
        symbol=symbol,
        columns=_named(columns, len(matrix[0])),
        rows=tuple(
            (name, tuple(significant(value, digits=4) for value in row))
            for name, row in zip(_named(rows, len(matrix)), matrix, strict=True)
        ),
    )


def _named(names: Sequence[str], count: int) -> tuple[str, ...]:
    return tuple(names) if len(names) == count else tuple(str(number) for number in range(1, count + 1))
