"""Outputs of a linear model at the samples of a record, with their exact derivatives with respect to the parameters.

The derivatives go with the model step by step: through the algebraic rows of the system, through the matrix exponential
of its exact discretization, delays included, and through the recursion over the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import WHOLE_SAMPLE, Discretized, Hold, discretize
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

    def rows_of(self, rows: IntArray) -> Proper:
        """The system of some outputs."""
        return self._replace(C=self.C[..., rows, :], D=self.D[..., rows, :], direct=self.direct[..., rows, :])


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    r"""Outputs of a linear model for the inputs of one record, with exact derivatives.

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Stepped:
    """A linear model discretized for one rate, with its derivatives: what all records of that rate share."""

    _views: tuple[_View, ...]
    _outputs: int
    _step_s: float

    def motion(self, u: FloatArray, before: FloatArray, *, starts: bool = True, biases: bool = False) -> Motion:
        """Outputs of the model for the inputs of one record.

        Parameters
        ----------
        u
            Inputs, shape ``(u, n)``.
        before
            Inputs before the first sample, shape ``(u,)``.
        starts, biases
            Whether ``free`` holds the responses to initial states, and to constants in the state equations.
        """
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
    system
        The model; ``M`` regular.
    slopes
        Its derivatives along ``p`` directions.
    sample_rate_hz
        Rate of the inputs.
    hold
        What the inputs do between their samples.

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
        # A delayed output delays the whole system: the same as inputs that are delayed by as much.
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
        views.append(_View(rows, proper.rows_of(rows), moves.rows_of(rows), step, tangent))
    return Stepped(_views=tuple(views), _outputs=len(system.H0), _step_s=1.0 / sample_rate_hz)


@dataclass(frozen=True, eq=False)
class _Group:
    """Outputs of one delay: the system with its inputs delayed by as much."""

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
        from rotorid.simulation.linear_kernels import recursion

        states: FloatArray = recursion(self.step.transition, forcing, start)
        return states

    def _constant(self, bias: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What constants in the equations add to the states in a step, shape ``(x,)``, and its derivatives."""
        directions, order = self.moves.A.shape[:2]
        if not bias.any():
            return np.zeros(order), np.zeros((directions, order))
        constant, moving = discretize_tangent(
            self.system.A,
            (self.system.constant @ bias)[:, None],
            self.moves.A,
            (self.moves.constant @ bias)[..., None],
            delays_s=np.zeros(1),
            ddelays_s=np.zeros((directions, 1)),
            step_s=self.step_s,
            hold="zero",
        )
        return constant.taps.sum(axis=(0, 1)), moving.taps.sum(axis=(1, 2))

    def free(self, *, starts: bool, biases: bool) -> FloatArray:
        """Responses to unit initial states and constants, shape ``(n, rows, k)``."""
        from rotorid.simulation.linear_kernels import free_responses

        order, samples = len(self.system.A), self.inputs.shape[1]
        begin, growth = [np.zeros((order, 0))], [np.zeros((order, 0))]
        if starts:
            begin, growth = [*begin, np.eye(order)], [*growth, np.zeros((order, order))]
        if biases:
            discrete = discretize(
                self.system.A, self.system.constant, delays_s=np.zeros(order), step_s=self.step_s, hold="zero"
            )
            begin, growth = [*begin, np.zeros((order, order))], [*growth, discrete.taps.sum(axis=0).T]
        E, constant = np.hstack(begin), np.hstack(growth)
        if E.shape[1] == 0:
            return np.zeros((samples, len(self.rows), 0))
        free = free_responses(self.step.transition, E, constant, np.ascontiguousarray(self.system.C), samples)
        if biases:
            free[:, :, -order:] += self.system.direct
        return free

    def outputs(self) -> FloatArray:
        """From rest, shape ``(n, rows)``."""
        outputs: FloatArray = self.from_rest @ self.system.C.T
        if self.system.D.any():
            outputs += self.step.delayed(self.inputs, self.before).T @ self.system.D.T
        return outputs

    def add_slopes(self, start: FloatArray, bias: FloatArray, mixing: FloatArray, slopes: FloatArray) -> None:
        """Add ``mixing``, shape ``(z, rows)``, of the derivatives of the outputs to ``slopes``, shape ``(n, z p)``.

        The start and the constants are held.
        """
        from rotorid.simulation.linear_kernels import add_state_sensitivities

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
        """Derivatives of what states, delayed inputs and one add to the outputs at once, shape ``(c, rows, p)``."""
        order, inputs, weights = len(self.system.A), len(self.inputs), self.step.weights
        direct = np.zeros((order + 3 * inputs + 1, len(self.rows), len(self.moves.A)))
        direct[:order] = self.moves.C.transpose(2, 1, 0)
        for tap in range(2):
            direct_part = self.moves.D * weights[tap] + self.system.D * self.tangent.weights[:, tap, None]
            direct[order + tap * inputs : order + (tap + 1) * inputs] = direct_part.transpose(2, 1, 0)
        direct[-1] = (self.moves.direct @ bias).T
        return direct

    def _regressors(self, states: FloatArray, used: BoolArray) -> FloatArray:
        """Those used of the states, of the inputs that each tap weighs, and of one, shape ``(n, c)``."""
        samples, order = states.shape
        kept, *taps, constant = np.split(used, order + len(self.inputs) * np.arange(4))
        delayed = [
            self.step.shifted(self.inputs, self.before, tap)[chosen].T
            for tap, chosen in enumerate(taps)
            if chosen.any()
        ]
        return np.hstack([states[:, kept], *delayed, np.ones((samples, int(constant.sum())))])


class _View(NamedTuple):
    """The system as outputs of one delay see it, with its inputs delayed by as much."""

    rows: IntArray
    system: Proper
    moves: Proper
    step: Discretized
    tangent: DiscretizedTangent


def proper_tangent(system: StateSpace, slopes: Slopes) -> tuple[Proper, Proper]:
    r"""A system as :math:`\dot x = A x + B u + M^{-1} b`, :math:`y = C x + D u + H_1 M^{-1} b`, and its derivatives.

    Raises
    ------
    ModelError
        ``M`` is singular: a state follows the input at once.
    """
    if np.array_equal(system.M, np.eye(len(system.M))) and not slopes.M.any():
        # Every equation is solved for its rate already.
        still = np.zeros_like(slopes.M)
        own = Proper(system.F, system.G, system.H0 + system.H1 @ system.F, system.H1 @ system.G, system.M, system.H1)
        moving = Proper(
            slopes.F,
            slopes.G,
            slopes.H0 + slopes.H1 @ system.F + system.H1 @ slopes.F,
            slopes.H1 @ system.G + system.H1 @ slopes.G,
            still,
            slopes.H1,
        )
        return own, moving
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


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscretizedTangent:
    r"""How a :class:`rotorid.simulation.linear.Discretized` moves along directions of the parameters.

    Parameters
    ----------
    transition
        Derivatives of :math:`\Phi`, shape ``(p, x, x)``.
    taps
        Derivatives of :math:`\Gamma`, shape ``(p, 3, u, x)``.
    weights
        Derivatives of :math:`w`, shape ``(p, 2, u)``. A zero-order hold jumps; between two jumps they are zero.
    """

    transition: FloatArray
    taps: FloatArray
    weights: FloatArray


def discretize_tangent(
    A: FloatArray,
    B: FloatArray,
    dA: FloatArray,
    dB: FloatArray,
    *,
    delays_s: FloatArray,
    ddelays_s: FloatArray,
    step_s: float,
    hold: Hold,
) -> tuple[Discretized, DiscretizedTangent]:
    r"""Discretize :math:`\dot x = A x + B u(t - \tau)` exactly, as :func:`rotorid.simulation.linear.discretize` does.

    A delay moves the corner of the held input within a step; the integrals on both sides of it are differentiated with
    respect to their lengths, so that the derivative with respect to a delay is exact for any fraction of a sample.

    Parameters
    ----------
    A, B
        Shapes ``(x, x)`` and ``(x, u)``.
    dA, dB
        Their derivatives, shapes ``(p, x, x)`` and ``(p, x, u)``.
    delays_s, ddelays_s
        Delays, shape ``(u,)``, not negative, and their derivatives, shape ``(p, u)``.
    hold
        What the inputs do between their samples.

    Returns
    -------
    Discretized
        The step.
    DiscretizedTangent
        Its derivatives.
    """
    directions, (order, inputs) = len(dA), B.shape
    delays = np.asarray(delays_s, dtype=np.float64) / step_s
    lags = np.floor(delays + WHOLE_SAMPLE).astype(np.int64)
    fractions = np.maximum(delays - lags, 0.0)
    fractions[fractions < WHOLE_SAMPLE] = 0.0
    transition, moving = exponential_tangent(A * step_s, dA * step_s)
    taps, slopes = np.empty((3, inputs, order)), np.empty((directions, 3, inputs, order))
    for i, fraction in enumerate(fractions):
        step = _Step(A=A, b=B[:, i], dA=dA, db=dB[:, :, i], step_s=step_s, dfraction=ddelays_s[:, i] / step_s)
        taps[:, i], slopes[:, :, i] = step.zero(fraction) if hold == "zero" else step.first(fraction)
    older = (fractions > 0.0).astype(np.float64) if hold == "zero" else fractions
    dolder = np.zeros_like(ddelays_s) if hold == "zero" else ddelays_s / step_s
    return (
        Discretized(transition=transition, taps=taps, weights=np.stack([older, 1.0 - older]), lags=lags),
        DiscretizedTangent(transition=moving, taps=slopes, weights=np.stack([dolder, -dolder], axis=1)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Step:
    """One step of one delayed input; every method gives a value and its derivatives with a leading axis."""

    A: FloatArray
    b: FloatArray
    dA: FloatArray
    db: FloatArray
    step_s: float
    dfraction: FloatArray

    def zero(self, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Taps of a held input whose corner lies at a fraction of the step, oldest first."""
        taps, slopes = np.zeros((3, self.b.size)), np.zeros((len(self.db), 3, self.b.size))
        onward, donward, taps[1], slopes[:, 1], _, _ = self._integrals(1.0 - fraction, -self.dfraction, ramp=False)
        # With a whole delay the older sample has no share, but the share grows with the delay.
        if fraction > 0.0 or self.dfraction.any():
            _, _, before, dbefore, _, _ = self._integrals(fraction, self.dfraction, ramp=False)
            taps[0] = onward @ before
            slopes[:, 0] = donward @ before + dbefore @ onward.T
        return taps, slopes

    def first(self, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Taps of an input that goes straight from sample to sample."""
        h, df = self.step_s, self.dfraction[:, None]
        onward, donward, after, dafter, ramp, dramp = self._integrals(1.0 - fraction, -self.dfraction)
        _, _, before, dbefore, rising, drising = self._integrals(fraction, self.dfraction)
        ramp, dramp, rising, drising = ramp / h, dramp / h, rising / h, drising / h
        old = fraction * before - rising
        dold = df * before + fraction * dbefore - drising
        new = (1.0 - fraction) * before + rising
        dnew = -df * before + (1.0 - fraction) * dbefore + drising
        taps = np.stack([onward @ old, onward @ new + after - ramp, ramp])
        slopes = np.stack(
            [donward @ old + dold @ onward.T, donward @ new + dnew @ onward.T + dafter - dramp, dramp], axis=1
        )
        return taps, slopes

    def _integrals(self, share: float, dshare: FloatArray, *, ramp: bool = True) -> tuple[FloatArray, ...]:
        r""":math:`e^{AT}`, :math:`\int_0^T e^{A(T-s)} b \, ds`, :math:`\int_0^T e^{A(T-s)} b s \, ds`, each derived."""
        order, extra = self.b.size, 2 if ramp else 1
        block = np.zeros((order + extra, order + extra))
        block[:order, :order], block[:order, order] = self.A, self.b
        moves = np.zeros((len(self.db), *block.shape))
        moves[:, :order, :order], moves[:, :order, order] = self.dA, self.db
        if ramp:
            block[order, order + 1] = 1.0
        time_s = share * self.step_s
        value, slope = exponential_tangent(
            block * time_s, moves * time_s + block * (dshare * self.step_s)[:, None, None]
        )
        last = order + extra - 1
        return (
            value[:order, :order],
            slope[:, :order, :order],
            value[:order, order],
            slope[:, :order, order],
            value[:order, last],
            slope[:, :order, last],
        )


_LARGEST_NORM = 0.5
_ROUNDING = 2.0**-54


def exponential_tangent(matrix: FloatArray, moves: FloatArray) -> tuple[FloatArray, FloatArray]:
    r""":math:`e^X` and its Fréchet derivatives :math:`\frac{d}{d\varepsilon} e^{X + \varepsilon \dot X}`.

    A Taylor series after scaling, squared back, with the product rule applied to every product: the derivatives are
    exact to rounding, and all directions share the powers of the matrix.

    Parameters
    ----------
    matrix
        :math:`X`, shape ``(n, n)``.
    moves
        Directions :math:`\dot X`, shape ``(p, n, n)``.

    Returns
    -------
    numpy.ndarray
        Shape ``(n, n)``.
    numpy.ndarray
        Shape ``(p, n, n)``.

    Examples
    --------
    >>> value, slope = exponential_tangent(np.array([[-1.0]]), np.array([[[2.0]]]))
    >>> bool(np.allclose([value[0, 0], slope[0, 0, 0]], [np.exp(-1.0), 2.0 * np.exp(-1.0)], rtol=1e-15))
    True
    """
    from rotorid.simulation.linear_kernels import exponential_series

    norm = float(np.abs(matrix).sum(axis=0).max(initial=0.0))
    if not np.isfinite(norm):
        return np.full_like(matrix, np.nan), np.full_like(moves, np.nan)
    squarings = max(0, int(np.ceil(np.log2(norm / _LARGEST_NORM)))) if norm > 0.0 else 0
    scale = 0.5**squarings
    scaled = np.ascontiguousarray(moves.transpose(1, 2, 0)) * scale
    value, slopes = exponential_series(matrix * scale, scaled, _degree(norm * scale), squarings)
    return value, slopes.transpose(2, 0, 1)


def _degree(norm: float) -> int:
    """Terms of the series after which the next one, and its derivative, is lost in rounding."""
    degree, term = 1, 1.0
    while term > _ROUNDING:
        term *= norm / degree
        degree += 1
    return degree
