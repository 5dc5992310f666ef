"""A system split into its modes, two by two."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rotorid.errors import ModelError
from rotorid.typing import ComplexArray, FloatArray

_SAME_POLE = 1e-7


class Part(NamedTuple):
    """The share of a system that one section has, in any coordinates."""

    A: FloatArray
    B: FloatArray
    C: FloatArray


def modal_parts(A: FloatArray, B: FloatArray, C: FloatArray) -> list[Part]:
    """A system split into sections of two modes, slowest first, and one of a single mode last where the order is odd.

    Complex pairs make a section each; real poles are paired with their neighbors.

    Parameters
    ----------
    A, B, C
        Shapes ``(x, x)``, ``(x, u)`` and ``(y, x)``.

    Raises
    ------
    ModelError
        One pole stands in two sections: they cannot be split.

    Examples
    --------
    >>> parts = modal_parts(np.diag([-9.0, -1.0, -8.0, -1.1]), np.ones((4, 1)), np.ones((1, 4)))
    >>> [np.sort(np.linalg.eigvals(part.A)).round(9).tolist() for part in parts]
    [[-1.1, -1.0], [-9.0, -8.0]]
    """
    poles = np.linalg.eigvals(A).astype(np.complex128)
    groups = _groups(poles)
    if len(groups) == 1:
        return [Part(A, B, C)]
    _check_apart(poles, groups)
    basis = np.hstack([_invariant(A, poles, group) for group in groups])
    inverse = np.linalg.inv(basis)
    A, B, C = inverse @ A @ basis, inverse @ B, C @ basis
    ends = np.cumsum([len(group) for group in groups])
    slots = [slice(end - len(group), end) for end, group in zip(ends, groups, strict=True)]
    return [Part(A[slot, slot], B[slot], C[:, slot]) for slot in slots]


def _invariant(A: FloatArray, poles: ComplexArray, group: Sequence[int]) -> FloatArray:
    """An orthonormal basis of the subspace that belongs to some poles, defective or not."""
    from scipy.linalg import schur

    def inside(real: float, imaginary: float) -> bool:
        return int(np.argmin(np.abs(poles - complex(real, imaginary)))) in group

    vectors = schur(A, output="real", sort=inside)[1]
    return np.asarray(vectors[:, : len(group)], dtype=np.float64)


def _groups(poles: ComplexArray) -> list[list[int]]:
    """Which eigenvalues stand in one section, slowest first, a single one last."""
    above = [k for k, pole in enumerate(poles) if pole.imag > 0.0]
    below = [k for k, pole in enumerate(poles) if pole.imag < 0.0]
    pairs = [[k, min(below, key=lambda j: abs(poles[j] - poles[k].conjugate()))] for k in above]
    real = sorted((k for k, pole in enumerate(poles) if pole.imag == 0.0), key=lambda k: poles[k].real)
    alone: list[list[int]] = []
    if len(real) % 2:
        # The one is left alone without which the others lie closest to their neighbours.
        left = min(range(0, len(real), 2), key=lambda j: _width(poles, real[:j] + real[j + 1 :]))
        alone = [[real.pop(left)]]
    pairs += [real[k : k + 2] for k in range(0, len(real), 2)]
    return [*sorted(pairs, key=lambda group: float(np.abs(poles[group]).min())), *alone]


def _width(poles: ComplexArray, real: Sequence[int]) -> float:
    return float(sum(abs(poles[one] - poles[two]) for one, two in zip(real[::2], real[1::2], strict=True)))


def _check_apart(poles: ComplexArray, groups: Sequence[Sequence[int]]) -> None:
    """Refuse poles that two sections would share."""
    size = 1e-300 + float(np.abs(poles).max(initial=0.0))
    for number, group in enumerate(groups):
        for other in groups[number + 1 :]:
            apart = np.abs(poles[list(group)][:, None] - poles[list(other)])
            if apart.min() < _SAME_POLE * size:
                pole = poles[list(group)][int(np.argmin(apart.min(axis=1)))]
                raise ModelError(
                    f"the pole {pole:.6g} stands in two sections",
                    needed="different poles in different sections",
                    remedy="move one of them a little, or take a lower order",
                )


def least_observed(A: FloatArray, row: FloatArray) -> float:
    """How much an output shows of the mode of a section that it sees least.

    Parameters
    ----------
    A
        Of the section, shape ``(x, x)``.
    row
        What the output shows of its states, shape ``(x,)``.
    """
    rate = 1e-300 + float(np.linalg.norm(A, 2))
    shown = np.array([row @ np.linalg.matrix_power(A / rate, k) for k in range(len(A))])
    return float(np.linalg.svd(shown, compute_uv=False)[-1])
