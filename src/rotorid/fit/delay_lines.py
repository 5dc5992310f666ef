r"""Spectral lines of one record; neighboring ones are merged where a long record has more of them than it needs.

Within a narrow group of lines a response is straight, :math:`G(\omega) = \varphi_a(\omega)\, G(\omega_a)
+ \varphi_b(\omega)\, G(\omega_b)`, and so is what the ends of the record add. All that the lines of the group say about
four numbers, two of each, is in the four equations :math:`Q^H Y = R\, x` of the decomposition :math:`Q R` of their
coefficients. A group is 1 % of its frequency wide, over which straight is true to :math:`10^{-4}` for lags of an order
up to three.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rotorid.data.immutable import Immutable, read_only
from rotorid.fit.delay_model import InputHold
from rotorid.typing import ComplexArray, FloatArray

MOST_LINES = 4000
"""Of shorter records every line is an equation of its own."""

_WIDTH = 0.01
_FEWEST_MERGED = 8
UNKNOWNS = 4
_NODE = 1.0 / np.sqrt(2.0)
_REMEMBERED = 64
"""Shifts whose equations are kept; a search comes back to the same few dozen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations(Immutable):
    """What one record says at one shift of its input: ``output = drive * G(nodes) + ends * E(nodes)``.

    Parameters
    ----------
    output
        Shape ``(r,)``.
    drive, ends
        Coefficients at the two nodes of each equation, shape ``(2, r)``.
    left
        Power of the output that no response which is straight within a group explains, shape ``(g,)``.
    """

    output: ComplexArray
    drive: ComplexArray
    ends: ComplexArray
    left: FloatArray

    def __post_init__(self) -> None:
        self._set(
            output=read_only(self.output, np.complex128, ndim=1),
            drive=read_only(self.drive, np.complex128, ndim=2),
            ends=read_only(self.ends, np.complex128, ndim=2),
            left=read_only(self.left, np.float64, ndim=1),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordPart(Immutable):
    """Finite Fourier transforms of one record, ready for any shift of the input by whole samples.

    Parameters
    ----------
    sample_s
        Sample interval.
    hold
        How the input goes on between its samples.
    omega_rad_s
        Lines of the transform that are used, shape ``(f,)``.
    bins
        Their numbers, shape ``(f,)``.
    output
        Transform of the output, shape ``(f,)``.
    drive
        Transform of the input in the window of the output, shape ``(f,)``.
    input
        Samples of the input, with a margin for the shifts on either side.
    first
        Sample of ``input`` with which the window of the output begins.
    count
        Samples in the window.
    edges
        Lines with which groups of merged lines begin, and the number of lines at the end, shape ``(g + 1,)``; lines
        before the first of them stand alone.
    """

    sample_s: float
    hold: InputHold
    omega_rad_s: FloatArray
    bins: NDArray[np.int64]
    output: ComplexArray
    drive: ComplexArray
    input: FloatArray
    first: int
    count: int
    edges: NDArray[np.int64]

    def __post_init__(self) -> None:
        self._set(
            omega_rad_s=read_only(self.omega_rad_s, np.float64, ndim=1),
            bins=read_only(self.bins, np.int64, ndim=1),
            output=read_only(self.output, np.complex128, ndim=1),
            drive=read_only(self.drive, np.complex128, ndim=1),
            input=read_only(self.input, np.float64, ndim=1),
            edges=read_only(self.edges, np.int64, ndim=1),
        )

    @property
    def lines(self) -> int:
        """Lines that are used."""
        return self.omega_rad_s.size

    @property
    def alone(self) -> int:
        """Lines that are equations of their own."""
        return int(self.edges[0])

    @property
    def groups(self) -> int:
        """Groups of merged lines."""
        return self.edges.size - 1

    @cached_property
    def nodes_rad_s(self) -> FloatArray:
        """Where a response must be known: single lines, then the lower and the upper nodes of the groups."""
        middle, half = self._spans
        return np.concatenate([self.omega_rad_s[: self.alone], middle - _NODE * half, middle + _NODE * half])

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """Nodes of each equation, shape ``(2, r)``."""
        single = np.arange(self.alone)
        low = self.alone + np.repeat(np.arange(self.groups), UNKNOWNS)
        return np.stack([np.concatenate([single, low]), np.concatenate([single, low + self.groups])])

    @cached_property
    def line_of(self) -> NDArray[np.int64]:
        """A line of each equation, to look up its noise, shape ``(r,)``."""
        return np.concatenate([np.arange(self.alone), np.repeat(self.edges[:-1], UNKNOWNS)])

    def at_rows(self, coefficients: ComplexArray, nodes: ComplexArray) -> ComplexArray:
        """Values at nodes, shape ``(..., n)``, as the equations see them, shape ``(..., r)``."""
        low, high = self.places
        return np.asarray(coefficients[0] * nodes[..., low] + coefficients[1] * nodes[..., high])

    def input_lines(self, samples: int) -> ComplexArray:
        """Transform of the input that came ``samples`` earlier than the output, shape ``(f,)``."""
        if self.lines * abs(samples) > self.count:
            begin = self.first - samples
            return np.asarray(np.fft.rfft(self.input[begin : begin + self.count])[self.bins], dtype=np.complex128)
        # A window that moves loses samples at one end and gains some at the other.
        lower = self.first - max(samples, 0)
        moved = np.arange(lower, lower + abs(samples))
        turn = np.exp(-1j * self.sample_s * np.outer(self.omega_rad_s, np.arange(abs(samples))))
        change = turn @ (self.input[moved] - self.input[moved + self.count])
        phase = np.exp(-1j * self.sample_s * samples * self.omega_rad_s)
        unmoved = self.drive if samples > 0 else self.drive - change
        return np.asarray(phase * unmoved + (change if samples > 0 else 0.0), dtype=np.complex128)

    def equations(self, samples: int) -> Equations:
        """The equations for an input that came ``samples`` earlier than the output."""
        return self._equations(samples)

    def thinned(self, step: int) -> RecordPart:
        """Every so many-th line, none merged."""
        omega = self.omega_rad_s[::step]
        return replace(
            self,
            omega_rad_s=omega,
            bins=self.bins[::step],
            output=self.output[::step],
            drive=self.drive[::step],
            edges=np.array([omega.size]),
        )

    @cached_property
    def _spans(self) -> tuple[FloatArray, FloatArray]:
        """Middles and half widths of the groups."""
        low, high = self.omega_rad_s[self.edges[:-1]], self.omega_rad_s[self.edges[1:] - 1]
        return 0.5 * (low + high), 0.5 * (high - low)

    @cached_property
    def _equations(self) -> Callable[[int], Equations]:
        return lru_cache(maxsize=_REMEMBERED)(self._made)

    def _made(self, samples: int) -> Equations:
        drive, single = self.input_lines(samples), slice(0, self.alone)
        found = [self._merged(group, drive) for group in range(self.groups)]
        zero, one = np.zeros(self.alone, dtype=np.complex128), np.ones(self.alone, dtype=np.complex128)
        return Equations(
            output=np.concatenate([self.output[single], *(out for out, _, _ in found)]),
            drive=np.concatenate([np.stack([drive[single], zero]), *(above[:2] for _, above, _ in found)], axis=1),
            ends=np.concatenate([np.stack([one, zero]), *(above[2:] for _, above, _ in found)], axis=1),
            left=np.array([left for _, _, left in found]),
        )

    def _merged(self, group: int, drive: ComplexArray) -> tuple[ComplexArray, ComplexArray, float]:
        """Equations of one group, their coefficients by unknown, and the power of the output that they leave."""
        lines = slice(self.edges[group], self.edges[group + 1])
        middle, half = (span[group] for span in self._spans)
        x = 0.5 * (self.omega_rad_s[lines] - middle) / (_NODE * half)
        straight, u, y = np.stack([0.5 - x, 0.5 + x], axis=1), drive[lines], self.output[lines]
        q, r = np.linalg.qr(np.concatenate([u[:, None] * straight, straight], axis=1))
        out = q.conj().T @ y
        return out, r.T, max(float(np.vdot(y, y).real - np.vdot(out, out).real), 0.0)


def merging(lines: int, *, much: bool) -> NDArray[np.int64]:
    """Edges of the groups of a record with so many lines; none where there are not too many of them.

    Examples
    --------
    >>> merging(3000, much=False)
    array([3000])
    >>> merging(1612, much=True)[:3]
    array([800, 808, 816])
    """
    if not much:
        return np.array([lines])
    edges = [round(_FEWEST_MERGED / _WIDTH)]
    while edges[-1] < lines:
        edges.append(edges[-1] + int(_WIDTH * edges[-1]))
    # What is left over at the end joins the last group.
    kept = [edge for edge in edges if edge <= lines - _FEWEST_MERGED]
    return np.array([*kept, lines]) if kept else np.array([lines])
