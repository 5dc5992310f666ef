"""How a frequency response moves with the entries of its matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Places(Immutable):
    r"""Where the entries stand that move, those of matrices first and the delays behind them.

    An entry in row :math:`a` and column :math:`b` moves the response by :math:`l_a x_b^T`, and one in front of a
    derivative by :math:`j\omega` times as much. The left factor has a column for each state and then for each output,
    the right one a row for each state and then for each input.

    Parameters
    ----------
    rows, columns
        Column of the left and row of the right factor, shape ``(n,)``.
    signs
        Minus one for the entries of ``M``, shape ``(n,)``.
    derivative
        Whether the entry stands in front of a derivative, shape ``(n,)``.
    late
        Which responses a delay makes later, shape ``(y, u, delays)``.
    """

    rows: IntArray
    columns: IntArray
    signs: FloatArray
    derivative: BoolArray
    late: FloatArray

    @classmethod
    def of(cls, moving: BoolArray, states: int, inputs: int, outputs: int) -> Places:
        """The places of the moving ones among all entries: M, F, G, H0, H1 row by row, then delays."""
        blocks = (
            ("M", states, states),
            ("F", states, states),
            ("G", states, inputs),
            ("H0", outputs, states),
            ("H1", outputs, states),
        )
        every = [(name, i, j) for name, height, width in blocks for i, j in np.ndindex(height, width)]
        moved = [place for place, moves in zip(every, moving, strict=False) if moves]
        late = np.zeros((outputs, inputs, inputs + outputs))
        late[:, range(inputs), range(inputs)] = 1.0
        late[range(outputs), :, range(inputs, inputs + outputs)] = 1.0
        return cls(
            rows=np.array([states + i if name in ("H0", "H1") else i for name, i, _ in moved], dtype=int),
            columns=np.array([states + j if name == "G" else j for name, _, j in moved], dtype=int),
            signs=np.array([-1.0 if name == "M" else 1.0 for name, _, _ in moved]),
            derivative=np.array([name in ("M", "H1") for name, _, _ in moved], dtype=bool),
            late=late[:, :, moving[len(every) :]],
        )

    def jacobian(
        self,
        moves: FloatArray,
        jw: ComplexArray,
        left: tuple[ComplexArray, ComplexArray],
        right: tuple[ComplexArray, ComplexArray],
        response: ComplexArray,
    ) -> ComplexArray:
        """Derivatives of the response along the directions in which the entries move.

        Parameters
        ----------
        moves
            Derivatives of the moving entries, shape ``(n + delays, k)``.
        jw
            Imaginary frequency, shape ``(f,)``.
        left, right
            Factors of shapes ``(x, y, f)`` and ``(x, u, f)`` and the delays of outputs and inputs, ``(y, f)`` and
            ``(u, f)``.
        response
            With its delays, shape ``(y, u, f)``.

        Returns
        -------
        numpy.ndarray
            Shape ``(k, y, u, f)``.
        """
        n, (y, u, f), k = self.rows.size, response.shape, moves.shape[1]
        each = _with_diagonal(*left)[self.rows][:, :, None] * _with_diagonal(*right)[self.columns][:, None]
        each[self.derivative] *= jw
        # The moves are real: a real product is half the work.
        moved = (moves[:n] * self.signs[:, None]).T @ each.reshape(n, y * u * f).view(np.float64)
        jacobian = moved.view(np.complex128).reshape(k, y, u, f)
        delays = moves[n:]
        for direction in np.flatnonzero(delays.any(axis=0)):
            later = self.late @ delays[:, direction]
            jacobian[direction] -= later[..., None] * (jw * response)
        return jacobian


def _with_diagonal(factor: ComplexArray, late: ComplexArray) -> ComplexArray:
    """The factor, and under it the diagonal matrix of the delays: shape ``(x + n, n, f)``."""
    states, channels, points = factor.shape
    whole = np.zeros((states + channels, channels, points), dtype=np.complex128)
    whole[:states] = factor
    whole[range(states, states + channels), range(channels)] = late
    return whole
