r"""Whether the thrusts of the motors add up to one force and three moments that can be had independently.

.. math:: U = B F, \qquad U = (U_1, U_2, U_3, U_4)

are thrust, and moments of roll, pitch and yaw, of the thrusts :math:`F` of the motors. A layout of rotors has such a
matrix, :meth:`rotorid.models.rotor_layout.RotorLayout.effectiveness`; those in print need not belong to one.
"""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import ModelError
from rotorid.typing import FloatArray

MOMENTS = ("U1", "U2", "U3", "U4")
"""Rows of a mixer: thrust in N; moments of roll, pitch and yaw in N m."""

_SINGULAR = 1e-9


def check_mixer(matrix: FloatArray) -> list[Finding]:
    """A remark if thrust and moments cannot be had independently of each other.

    Parameters
    ----------
    matrix
        Shape ``(4, k)``: thrust, moments of roll, pitch and yaw of every motor.

    Raises
    ------
    ModelError
        The matrix has other rows.

    Examples
    --------
    One that is found in print, with motors in a plus and the yaw of an X:

    >>> l, kappa = 0.23, 0.05
    >>> printed = np.array([[1, 1, 1, 1], [0, -l, 0, l], [l, 0, -l, 0], [kappa, kappa, -kappa, -kappa]])
    >>> check_mixer(printed)[0].message
    'The mixer is singular, of rank 3: U4 = -0.2174 U2 + 0.2174 U3 whatever the motors do.'
    """
    mixer = np.asarray(matrix, dtype=np.float64)
    if mixer.ndim != 2 or len(mixer) != len(MOMENTS):
        raise ModelError(f"a mixer of shape {mixer.shape} came", needed="shape (4, motors): thrust, roll, pitch, yaw")
    length = np.linalg.norm(mixer, axis=1)
    scaled = mixer / np.where(length > 0.0, length, 1.0)[:, None]
    rank = int(np.sum(np.linalg.svd(scaled, compute_uv=False) > _SINGULAR))
    if rank == len(MOMENTS):
        return []
    message = f"The mixer is singular, of rank {rank}: {_dependence(mixer, scaled)} whatever the motors do."
    return [
        Finding(
            kind="singular_mixer", severity="warning", where="mixer", message=message, numbers={"rank": float(rank)}
        )
    ]


def _dependence(mixer: FloatArray, scaled: FloatArray) -> str:
    """The first moment that those before it already give, as a sum of them."""
    for row in range(len(MOMENTS)):
        before = mixer[:row]
        shares = np.linalg.lstsq(scaled[:row].T, scaled[row], rcond=None)[0]
        if np.linalg.norm(shares @ scaled[:row] - scaled[row]) <= _SINGULAR:
            length = np.where((norm := np.linalg.norm(before, axis=1)) > 0.0, norm, 1.0)
            factors = shares * np.linalg.norm(mixer[row]) / length
            terms = [
                f"{'-' if factor < 0 else '+'} {abs(factor):.4g} {name}"
                for factor, name in zip(factors.tolist(), MOMENTS, strict=False)
                if abs(factor) > _SINGULAR
            ]
            return f"{MOMENTS[row]} = {_joined(terms)}"
    raise AssertionError("a matrix without full rank has a row that the others give")


def _joined(terms: list[str]) -> str:
    if not terms:
        return "0"
    text = " ".join(terms)
    return text.removeprefix("+ ") if text.startswith("+") else text.replace("- ", "-", 1)
