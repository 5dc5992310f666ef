"""A linear system with delays, as numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import ModelError
from rotorid.typing import ComplexArray, FloatArray

_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace(Immutable):
    r"""Linear system with delayed inputs and outputs.

    .. math:: M \dot x = F x + G u(t - \tau_u), \qquad y(t + \tau_y) = H_0 x + H_1 \dot x

    ``M`` may be singular as long as its null space is algebraic: a motor lag of zero leaves ``0 = u - x``.

    Parameters
    ----------
    M, F
        Shape ``(x, x)``.
    G
        Shape ``(x, u)``.
    H0, H1
        Shape ``(y, x)``.
    input_delays_s, output_delays_s
        Shapes ``(u,)`` and ``(y,)``; a positive delay makes the system later.
    """

    M: FloatArray
    F: FloatArray
    G: FloatArray
    H0: FloatArray
    H1: FloatArray
    input_delays_s: FloatArray
    output_delays_s: FloatArray

    def __post_init__(self) -> None:
        matrices = {name: read_only(getattr(self, name), np.float64, ndim=2) for name in ("M", "F", "G", "H0", "H1")}
        states, inputs, outputs = len(matrices["F"]), matrices["G"].shape[1], len(matrices["H0"])
        shapes = {
            "M": (states, states),
            "F": (states, states),
            "G": (states, inputs),
            "H0": (outputs, states),
            "H1": (outputs, states),
        }
        for name, shape in shapes.items():
            if matrices[name].shape != shape:
                raise ModelError(f"matrix {name} has shape {matrices[name].shape}", needed=f"shape {shape}")
        delays = {
            name: read_only(getattr(self, name), np.float64, ndim=1) for name in ("input_delays_s", "output_delays_s")
        }
        if delays["input_delays_s"].size != inputs or delays["output_delays_s"].size != outputs:
            raise ModelError("the delays do not match the inputs and outputs", needed=f"{inputs} and {outputs} delays")
        self._set(**matrices, **delays)

    def response(self, omega_rad_s: FloatArray | ComplexArray) -> ComplexArray:
        r"""Frequency response, shape ``(y, u, f)``.

        .. math:: T = [H_0 + j\omega H_1] (j\omega M - F)^{-1} G \, e^{-j\omega(\tau_u + \tau_y)}

        Complex frequencies are allowed: beside the imaginary axis an integrator has no pole.
        """
        jw = 1j * np.asarray(omega_rad_s)[:, None, None]
        states = np.linalg.solve(jw * self.M - self.F, np.broadcast_to(self.G, (jw.shape[0], *self.G.shape)))
        rational = (self.H0 + jw * self.H1) @ states
        delays = self.output_delays_s[:, None] + self.input_delays_s
        response: ComplexArray = np.moveaxis(rational * np.exp(-jw * delays), 0, -1)
        return response

    def proper(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        r"""The same system, delays aside, as :math:`\dot z = A z + B u`, :math:`y = C z + D u`.

        Algebraic rows of ``M`` are eliminated exactly: with the singular value decomposition of ``M`` the states split
        into dynamic and algebraic ones, and the algebraic ones follow from the others and the input.

        Raises
        ------
        ModelError
            The algebraic rows do not determine their states, or an output needs the derivative of such a state.
        """
        left, values, right = np.linalg.svd(self.M)
        rank = int(np.sum(values > values[0] * _ROUNDING)) if values.size else 0
        if rank == values.size:
            A: FloatArray = np.asarray(np.linalg.solve(self.M, self.F), dtype=np.float64)
            B: FloatArray = np.asarray(np.linalg.solve(self.M, self.G), dtype=np.float64)
            return A, B, self.H0 + self.H1 @ A, self.H1 @ B
        F, G = left.T @ self.F @ right.T, left.T @ self.G
        F12, F22, G2 = F[:rank, rank:], F[rank:, rank:], G[rank:]
        if np.linalg.matrix_rank(F22) < F22.shape[0]:
            raise ModelError("the algebraic rows of M do not determine their states", needed="F regular there")
        to_z, to_u = -np.linalg.solve(F22, F[rank:, :rank]), -np.linalg.solve(F22, G2)
        A = (F[:rank, :rank] + F12 @ to_z) / values[:rank, None]
        B = (G[:rank] + F12 @ to_u) / values[:rank, None]
        derivative = np.abs(self.H1 @ right[rank:].T @ to_u).max(initial=0.0)
        # The decomposition rounds: an output that sees no such state may seem to see a trace of it.
        if derivative > _ROUNDING * np.abs(self.H1).max(initial=0.0) * np.abs(to_u).max(initial=0.0):
            raise ModelError("an output needs the derivative of a state that follows the input at once")
        states = right.T @ np.vstack([np.eye(rank), to_z])
        C = self.H0 @ states + self.H1 @ states @ A
        D = self.H0 @ right[rank:].T @ to_u + self.H1 @ states @ B
        return A, B, C, D

    def poles(self) -> ComplexArray:
        """Eigenvalues of the dynamic states, slowest first."""
        poles = np.linalg.eigvals(self.proper()[0]).astype(np.complex128)
        return poles[np.lexsort((poles.imag, np.abs(poles)))]
