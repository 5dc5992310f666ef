"""Responses that stay bounded though the model is unstable: growing motions are computed backward in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.typing import FloatArray
from rotorid.verify.sampled import Sampled


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundedResponses(Immutable):
    """What a model does with the inputs, and with each thing that no model can know.

    Parameters
    ----------
    forced
        Response to the inputs, shape ``(y, samples)``; one of many that differ by free responses.
    free
        Free responses, one for each dynamic state, shape ``(x, y, samples)``. They span all free responses.
    biased
        Response to a unit constant in each state equation, shape ``(e, y, samples)``, up to free responses.
    """

    forced: FloatArray
    free: FloatArray
    biased: FloatArray

    def __post_init__(self) -> None:
        self._set(
            forced=read_only(self.forced, np.float64, ndim=2),
            free=read_only(self.free, np.float64, ndim=3),
            biased=read_only(self.biased, np.float64, ndim=3),
        )


def bounded_responses(model: Sampled) -> BoundedResponses:
    r"""Forced, free and biased responses of a model on a record of any length.

    Since the initial state is to be estimated, any response that obeys the equations will do. Motions that grow more
    than e-fold in the record are split off and computed backward from rest at its end, where they decay:

    .. math:: s_{k+1} = \Phi_s s_k + f_{s,k}, \qquad v_k = \Phi_u^{-1} (v_{k+1} - f_{u,k}), \quad v_{end} = 0

    Forward, an unstable airframe of 3 1/s loses all digits within 12 s; so it loses none.

    Parameters
    ----------
    model
        The model on the samples of the record.
    """
    motions = _Motions.of(model)
    nothing, rest = np.zeros_like(model.forcing), np.zeros(len(model.transition))
    constants = zip(model.biases, model.direct_biases, strict=True)

    def outputs(forcing: FloatArray, ends: FloatArray) -> FloatArray:
        return model.seen(motions.states(forcing, ends)).T

    return BoundedResponses(
        forced=outputs(model.forcing, rest) + model.direct.T,
        free=np.array([outputs(nothing, end) for end in np.eye(rest.size)]),
        biased=np.array([outputs(nothing + bias, rest) + direct[:, None] for bias, direct in constants]),
    )


def bounded_states(model: Sampled) -> FloatArray:
    """States of one motion under the inputs that stays bounded, shape ``(lead + samples, x)``.

    Parameters
    ----------
    model
        The model on the samples of the record.
    """
    return _Motions.of(model).states(model.forcing, np.zeros(len(model.transition)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motions:
    """A recursion in a basis that sets what decays, ``slow``, apart from what grows, ``fast``."""

    basis: FloatArray
    inverse: FloatArray
    slow: FloatArray
    fast: FloatArray

    @classmethod
    def of(cls, model: Sampled) -> _Motions:
        basis, kept = _split(model.transition, len(model.forcing))
        inverse = np.asarray(np.linalg.inv(basis), dtype=np.float64)
        transition = inverse @ model.transition @ basis
        return cls(basis=basis, inverse=inverse, slow=transition[:kept, :kept], fast=transition[kept:, kept:])

    def states(self, forcing: FloatArray, ends: FloatArray) -> FloatArray:
        """Response to a forcing, with the start of what decays and the end of what grows."""
        kept, parts = len(self.slow), forcing @ self.inverse.T
        decaying = _forward(self.slow, parts[:, :kept], ends[:kept])
        growing = _backward(self.fast, parts[:, kept:], ends[kept:])
        both: FloatArray = np.hstack([decaying, growing]) @ self.basis.T
        return both


def _split(transition: FloatArray, steps: int) -> tuple[FloatArray, int]:
    """A basis whose first vectors span what does not grow e-fold in a record, and the number of those."""
    from scipy.linalg import schur, solve_sylvester

    # Slower growth goes forward: an integrator must not fall on both sides by rounding.
    triangle, vectors, kept = schur(transition * np.exp(-1.0 / steps), sort="iuc")
    if kept == len(transition):
        return np.eye(kept), kept
    apart = solve_sylvester(triangle[:kept, :kept], -triangle[kept:, kept:], -triangle[:kept, kept:])
    return np.hstack([vectors[:, :kept], vectors[:, :kept] @ apart + vectors[:, kept:]]), kept


def _forward(transition: FloatArray, forcing: FloatArray, start: FloatArray) -> FloatArray:
    from rotorid.simulate.kernels import recursion

    return recursion(np.ascontiguousarray(transition), np.ascontiguousarray(forcing), start)


def _backward(transition: FloatArray, forcing: FloatArray, end: FloatArray) -> FloatArray:
    """States with ``v[k] = inv(transition) (v[k+1] - forcing[k])`` that come to ``end`` after the last step."""
    from rotorid.simulate.kernels import recursion

    back = np.linalg.inv(transition)
    reverse = np.vstack([-(forcing @ back.T)[::-1], np.zeros((1, len(back)))])
    return recursion(np.ascontiguousarray(back), reverse, end)[:0:-1]
