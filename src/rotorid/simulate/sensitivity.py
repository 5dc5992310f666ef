"""Outputs of a linear model at the samples of a record, with their exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.state_space import StateSpace
from rotorid.simulate.hold import Discretized, Hold, discretize
from rotorid.simulate.hold_tangent import DiscretizedTangent, discretize_tangent
from rotorid.typing import FloatArray, IntArray

_SINGULAR = 1e-13


class Slopes(NamedTuple):
    """Derivatives of a state space with a leading axis of directions, as ``matrices_and_jacobian`` gives them."""

    M: FloatArray
    F: FloatArray
    G: FloatArray
    H0: FloatArray
    H1: FloatArray
    input_delays_s: FloatArray
    output_delays_s: FloatArray


class Proper(NamedTuple):
    """``A, B, C, D`` of a system and what a constant in each equation does; or derivatives with a leading axis."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    constant: FloatArray
    direct: FloatArray

    def seen_by(self, rows: IntArray) -> Proper:
        """The system of some outputs."""
        return self._replace(C=self.C[..., rows, :], D=self.D[..., rows, :], direct=self.direct[..., rows, :])


def proper_tangent(system: StateSpace, slopes: Slopes) -> tuple[Proper, Proper]:
    r"""A system as :math:`\dot x = A x + B u + M^{-1} b`, :math:`y = C x + D u + H_1 M^{-1} b`, and its derivatives.

    Raises
    ------
    ModelError
        ``M`` is singular: a state follows the input at once.
    """
    if np.linalg.cond(system.M) * _SINGULAR > 1.0:
        raise ModelError(
            "a state follows the input at once, because its lag is zero",
            needed="a lag above zero",
            remedy="drop the lag, so that the state is left out",
        )
    inverse = np.asarray(np.linalg.inv(system.M), dtype=np.float64)
    A, B = inverse @ system.F, inverse @ system.G
    dA, dB = inverse @ (slopes.F - slopes.M @ A), inverse @ (slopes.G - slopes.M @ B)
    dinverse = -inverse @ slopes.M @ inverse
    value = Proper(A, B, system.H0 + system.H1 @ A, system.H1 @ B, inverse, system.H1 @ inverse)
    slope = Proper(
        dA,
        dB,
        slopes.H0 + slopes.H1 @ A + system.H1 @ dA,
        slopes.H1 @ B + system.H1 @ dB,
        dinverse,
        slopes.H1 @ inverse + system.H1 @ dinverse,
    )
    return value, slope


@dataclass(frozen=True, eq=False)
class _Group:
    """Outputs of one delay: the system with its inputs later by as much."""

    rows: IntArray
    system: Proper
    moves: Proper
    step: Discretized
    tangent: DiscretizedTangent
    inputs: FloatArray
    before: FloatArray
    step_s: float

    @cached_property
    def forcing(self) -> FloatArray:
        return self.step.forcing(self.inputs, self.before)

    @cached_property
    def fed_through(self) -> FloatArray:
        late: FloatArray = self.step.delayed(self.inputs, self.before).T @ self.system.D.T
        return late

    def constants(self, columns: FloatArray, dcolumns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What constants ``columns`` of the proper equations add to the states in a step, and its derivatives."""
        count = columns.shape[1]
        held, moving = discretize_tangent(
            self.system.A,
            columns,
            self.moves.A,
            dcolumns,
            delays_s=np.zeros(count),
            ddelays_s=np.zeros((len(dcolumns), count)),
            step_s=self.step_s,
            hold="zero",
        )
        return held.taps.sum(axis=0).T, moving.taps.sum(axis=1).swapaxes(1, 2)

    def free(self, *, starts: bool, biases: bool) -> FloatArray:
        """Responses to unit initial states and constants, shape ``(n, rows, k)``."""
        from rotorid.simulate.sensitivity_kernels import free_responses

        order, samples = len(self.system.A), self.inputs.shape[1]
        begin, growth = [np.zeros((order, 0))], [np.zeros((order, 0))]
        if starts:
            begin, growth = [*begin, np.eye(order)], [*growth, np.zeros((order, order))]
        if biases:
            held = discretize(
                self.system.A, self.system.constant, delays_s=np.zeros(order), step_s=self.step_s, hold="zero"
            )
            begin, growth = [*begin, np.zeros((order, order))], [*growth, held.taps.sum(axis=0).T]
        E, constant = np.hstack(begin), np.hstack(growth)
        if E.shape[1] == 0:
            return np.zeros((samples, len(self.rows), 0))
        free = free_responses(self.step.transition, E, constant, np.ascontiguousarray(self.system.C), samples)
        if biases:
            free[:, :, -order:] += self.system.direct
        return free

    def outputs(self) -> FloatArray:
        """From rest, shape ``(n, rows)``."""
        from rotorid.simulate.kernels import recursion

        states = recursion(self.step.transition, self.forcing, np.zeros(len(self.system.A)))
        seen: FloatArray = states @ self.system.C.T + self.fed_through
        return seen

    def slopes(self, start: FloatArray, bias: FloatArray) -> FloatArray:
        """Derivatives of the outputs, shape ``(n, rows, p)``, with the start and the constants held."""
        from rotorid.simulate.kernels import recursion
        from rotorid.simulate.sensitivity_kernels import state_sensitivities

        directions, order, inputs = len(self.moves.A), len(self.system.A), len(self.inputs)
        constant, dconstant = self.constants(
            (self.system.constant @ bias)[:, None], (self.moves.constant @ bias)[..., None]
        )
        states = recursion(self.step.transition, self.forcing + constant[:, 0], start)
        late = [self.step.shifted(self.inputs, self.before, tap).T for tap in range(3)]
        regressors = np.hstack([states, *late, np.ones((len(states), 1))])
        tangent = self.tangent
        forcing = np.concatenate(
            [
                tangent.transition.transpose(2, 1, 0),
                *tangent.taps.transpose(1, 2, 3, 0),
                dconstant.transpose(2, 1, 0),
            ]
        )
        direct = np.zeros((regressors.shape[1], len(self.rows), directions))
        direct[:order] = self.moves.C.transpose(2, 1, 0)
        for tap in range(2):
            seen = self.moves.D * self.step.weights[tap] + self.system.D * tangent.weights[:, tap, None]
            direct[order + tap * inputs : order + (tap + 1) * inputs] = seen.transpose(2, 1, 0)
        direct[-1] = (self.moves.direct @ bias).T
        used = np.any(forcing, axis=(1, 2)) | np.any(direct, axis=(1, 2))
        return state_sensitivities(
            self.step.transition,
            np.ascontiguousarray(forcing[used]).reshape(int(used.sum()), -1),
            np.ascontiguousarray(self.system.C),
            np.ascontiguousarray(direct[used]).reshape(int(used.sum()), -1),
            np.ascontiguousarray(regressors[:, used]),
            directions,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    r"""What a linear model does with the inputs of one record, with exact derivatives.

    .. math:: M \dot x = F x + G u(t - \tau_u) + b, \qquad y(t + \tau_y) = H_0 x + H_1 \dot x

    Outputs from rest, responses to a unit initial state and to a unit constant in each equation, and the derivatives
    of all of it along directions of the parameters: exact for the held input, for delays of any fraction of a sample.

    Parameters
    ----------
    outputs
        From rest, shape ``(n, y)``.
    free
        Responses to unit initial states, then to unit constants, shape ``(n, y, k)``. Outputs with different delays
        show states of different times; then each delay has its own.
    """

    outputs: FloatArray
    free: FloatArray
    _groups: tuple[_Group, ...]
    _starts: bool
    _biases: bool

    def slopes(self, coefficients: FloatArray) -> FloatArray:
        """Derivatives of ``outputs + free @ coefficients`` with the coefficients held, shape ``(n, y, p)``."""
        samples, outputs = self.outputs.shape
        slopes = np.zeros((samples, outputs, len(self._groups[0].moves.A)))
        order = len(self._groups[0].system.A)
        width = order * (self._starts + self._biases)
        for index, group in enumerate(self._groups):
            own = coefficients[index * width : (index + 1) * width]
            start = own[:order] if self._starts else np.zeros(order)
            bias = own[width - order :] if self._biases else np.zeros(order)
            slopes[:, group.rows] = group.slopes(start, bias)
        return slopes


def motion(
    system: StateSpace,
    slopes: Slopes,
    u: FloatArray,
    *,
    sample_rate_hz: float,
    before: FloatArray,
    hold: Hold,
    starts: bool = True,
    biases: bool = False,
) -> Motion:
    """Simulate a linear model on a record.

    Parameters
    ----------
    system
        The model; ``M`` regular.
    slopes
        Its derivatives along ``p`` directions.
    u
        Inputs, shape ``(u, n)``.
    sample_rate_hz
        Their rate.
    before
        Inputs before the first sample, shape ``(u,)``.
    hold
        What the inputs do between their samples.
    starts, biases
        Whether ``free`` holds the responses to initial states, and to constants in the state equations.

    Raises
    ------
    ModelError
        ``M`` is singular: a state follows the input at once.
    """
    groups = tuple(_groups(system, slopes, u, before, 1.0 / sample_rate_hz, hold))
    parts = [group.free(starts=starts, biases=biases) for group in groups]
    outputs = np.empty((u.shape[1], len(system.H0)))
    free = np.zeros((*outputs.shape, sum(part.shape[2] for part in parts)))
    for index, (group, part) in enumerate(zip(groups, parts, strict=True)):
        outputs[:, group.rows] = group.outputs()
        width = part.shape[2]
        free[:, group.rows, index * width : (index + 1) * width] = part
    return Motion(outputs=outputs, free=free, _groups=groups, _starts=starts, _biases=biases)


def _groups(
    system: StateSpace, slopes: Slopes, u: FloatArray, before: FloatArray, step_s: float, hold: Hold
) -> list[_Group]:
    proper, moves = proper_tangent(system, slopes)
    keys = np.vstack([system.output_delays_s, slopes.output_delays_s])
    _, which = np.unique(keys, axis=1, return_inverse=True)
    groups = []
    for group in range(int(which.max()) + 1):
        rows = np.flatnonzero(which.ravel() == group)
        # A late output sees the whole system late: the same as inputs that are later by as much.
        step, tangent = discretize_tangent(
            proper.A,
            proper.B,
            moves.A,
            moves.B,
            delays_s=system.input_delays_s + system.output_delays_s[rows[0]],
            ddelays_s=slopes.input_delays_s + slopes.output_delays_s[:, rows[:1]],
            step_s=step_s,
            hold=hold,
        )
        groups.append(_Group(rows, proper.seen_by(rows), moves.seen_by(rows), step, tangent, u, before, step_s))
    return groups
