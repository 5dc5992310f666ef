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
from rotorid.typing import BoolArray, FloatArray, IntArray

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
    def from_rest(self) -> FloatArray:
        return self._states(self.forcing, np.zeros(len(self.system.A)))

    def _states(self, forcing: FloatArray, start: FloatArray) -> FloatArray:
        from rotorid.simulate.kernels import recursion

        states: FloatArray = recursion(self.step.transition, forcing, start)
        return states

    def _constant(self, bias: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What constants in the equations add to the states in a step, shape ``(x,)``, and its derivatives."""
        directions, order = self.moves.A.shape[:2]
        if not bias.any():
            return np.zeros(order), np.zeros((directions, order))
        held, moving = discretize_tangent(
            self.system.A,
            (self.system.constant @ bias)[:, None],
            self.moves.A,
            (self.moves.constant @ bias)[..., None],
            delays_s=np.zeros(1),
            ddelays_s=np.zeros((directions, 1)),
            step_s=self.step_s,
            hold="zero",
        )
        return held.taps.sum(axis=(0, 1)), moving.taps.sum(axis=(1, 2))

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
        seen: FloatArray = self.from_rest @ self.system.C.T
        if self.system.D.any():
            seen += self.step.delayed(self.inputs, self.before).T @ self.system.D.T
        return seen

    def add_slopes(self, start: FloatArray, bias: FloatArray, mixing: FloatArray, slopes: FloatArray) -> None:
        """Add ``mixing``, shape ``(z, rows)``, of the derivatives of the outputs to ``slopes``, shape ``(n, z p)``.

        The start and the constants are held.
        """
        from rotorid.simulate.sensitivity_kernels import add_state_sensitivities

        constant, dconstant = self._constant(bias)
        states = self._states(self.forcing + constant, start) if start.any() or bias.any() else self.from_rest
        forcing = np.concatenate(
            [
                self.tangent.transition.transpose(2, 1, 0),
                *self.tangent.taps.transpose(1, 2, 3, 0),
                dconstant.T[None],
            ]
        )
        direct = mixing @ self._direct(bias)
        used = np.any(forcing, axis=(1, 2)) | np.any(direct, axis=(1, 2))
        if not used.any():
            return
        add_state_sensitivities(
            self.step.transition,
            forcing[used].reshape(int(used.sum()), -1),
            mixing @ self.system.C,
            direct[used].reshape(int(used.sum()), -1),
            self._regressors(states, used),
            slopes,
        )

    def _direct(self, bias: FloatArray) -> FloatArray:
        """Derivatives of what states, late inputs and one add to the outputs at once, shape ``(c, rows, p)``."""
        order, inputs, weights = len(self.system.A), len(self.inputs), self.step.weights
        direct = np.zeros((order + 3 * inputs + 1, len(self.rows), len(self.moves.A)))
        direct[:order] = self.moves.C.transpose(2, 1, 0)
        for tap in range(2):
            seen = self.moves.D * weights[tap] + self.system.D * self.tangent.weights[:, tap, None]
            direct[order + tap * inputs : order + (tap + 1) * inputs] = seen.transpose(2, 1, 0)
        direct[-1] = (self.moves.direct @ bias).T
        return direct

    def _regressors(self, states: FloatArray, used: BoolArray) -> FloatArray:
        """Those used of the states, of the inputs that each tap weighs, and of one, shape ``(n, c)``."""
        samples, order = states.shape
        kept, *taps, one = np.split(used, order + len(self.inputs) * np.arange(4))
        late = [
            self.step.shifted(self.inputs, self.before, tap)[chosen].T
            for tap, chosen in enumerate(taps)
            if chosen.any()
        ]
        return np.hstack([states[:, kept], *late, np.ones((samples, int(one.sum())))])


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

    def slopes(self, coefficients: FloatArray, mixing: FloatArray | None = None) -> FloatArray:
        """Derivatives of ``outputs + free @ coefficients`` with the coefficients held, shape ``(n, y, p)``.

        Parameters
        ----------
        coefficients
            Initial states and constants, shape ``(k,)``.
        mixing
            A matrix over the outputs, shape ``(z, y)``; then its products with the derivatives, shape ``(n, z, p)``.
        """
        samples, outputs = self.outputs.shape
        mixing = np.eye(outputs) if mixing is None else mixing
        directions, order = self._groups[0].moves.A.shape[:2]
        slopes = np.zeros((samples, len(mixing) * directions))
        width = order * (self._starts + self._biases)
        for index, group in enumerate(self._groups):
            own = coefficients[index * width : (index + 1) * width]
            start = own[:order] if self._starts else np.zeros(order)
            bias = own[width - order :] if self._biases else np.zeros(order)
            group.add_slopes(start, bias, mixing[:, group.rows], slopes)
        return slopes.reshape(samples, len(mixing), directions)


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
    shared = stepped(system, slopes, sample_rate_hz=sample_rate_hz, hold=hold)
    return shared.motion(u, before, starts=starts, biases=biases)


class _View(NamedTuple):
    """The system as outputs of one delay see it, with its inputs later by as much."""

    rows: IntArray
    system: Proper
    moves: Proper
    step: Discretized
    tangent: DiscretizedTangent


@dataclass(frozen=True, kw_only=True, eq=False)
class Stepped:
    """A linear model discretized for one rate, with its derivatives: what all records of that rate share."""

    _views: tuple[_View, ...]
    _outputs: int
    _step_s: float

    def motion(self, u: FloatArray, before: FloatArray, *, starts: bool = True, biases: bool = False) -> Motion:
        """What the model does with the inputs of one record; see :func:`motion`."""
        groups = tuple(_Group(*view, u, before, self._step_s) for view in self._views)
        parts = [group.free(starts=starts, biases=biases) for group in groups]
        outputs = np.empty((u.shape[1], self._outputs))
        free = np.zeros((*outputs.shape, sum(part.shape[2] for part in parts)))
        for index, (group, part) in enumerate(zip(groups, parts, strict=True)):
            outputs[:, group.rows] = group.outputs()
            width = part.shape[2]
            free[:, group.rows, index * width : (index + 1) * width] = part
        return Motion(outputs=outputs, free=free, _groups=groups, _starts=starts, _biases=biases)


def stepped(system: StateSpace, slopes: Slopes, *, sample_rate_hz: float, hold: Hold) -> Stepped:
    """Discretize a linear model for the records of one rate.

    Parameters
    ----------
    system, slopes, sample_rate_hz, hold
        As for :func:`motion`.

    Raises
    ------
    ModelError
        ``M`` is singular: a state follows the input at once.
    """
    proper, moves = proper_tangent(system, slopes)
    keys = np.vstack([system.output_delays_s, slopes.output_delays_s])
    _, which = np.unique(keys, axis=1, return_inverse=True)
    views = []
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
            step_s=1.0 / sample_rate_hz,
            hold=hold,
        )
        views.append(_View(rows, proper.seen_by(rows), moves.seen_by(rows), step, tangent))
    return Stepped(_views=tuple(views), _outputs=len(system.H0), _step_s=1.0 / sample_rate_hz)
