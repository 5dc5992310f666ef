r"""Motor and inertia constants from accelerations around hover, as a genetic algorithm of the literature seeks them.

.. math::

    \tau \dot x_i + x_i = \sigma_i, \qquad F_i = c_t \, \omega_{max}^2 \, x_i, \qquad U = B(\kappa) F

    \ddot z = \frac{U_1}{m} \cos\phi \cos\theta - g, \qquad
    \dot p = \frac{U_2}{I_{xx}}, \qquad \dot q = \frac{U_3}{I_{yy}}, \qquad \dot r = \frac{U_4}{I_{zz}}

A gain of the motors, such as that of a transfer function in series with them, is one with :math:`c_t`. So are, to the
data, κ and I_zz: yaw shows their ratio only.

The local search has a closed form where there is one. With the lag of the motors held, what they carry is known,
:math:`x_c`, and each acceleration has a gain :math:`g_c`:

.. math:: f = \sum_c w_c \sum_k |a_c(k) - g_c x_c(k)|

is convex in each gain, and least at the weighted median of :math:`a_c/x_c` with the weights :math:`|x_c|`; for squares
at :math:`\sum a_c x_c / \sum x_c^2`. The logarithms of the gains are sums of those of the parameters, so the nearest
parameters with these gains are one linear solution away, or a few where bounds are in the way. Where there are none,
because some are held, bounded or tied, or where the lag is free, steps of least squares lead down.

Such sums take a time that does not depend on the samples. With :math:`r = a / x`, a sum of absolute errors is a sum of
distances,

.. math:: \sum_k |a(k) - g x(k)| = \sum_k |x(k)| \, |g - r(k)|

which is piecewise linear in the gain. Once ratios are sorted and their weights are added up, it takes a search for the
piece that the gain lies on. A sum of squares is one parabola.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, NamedTuple, Protocol, TypeAlias, get_args

import numpy as np

from rotorid.data.base import read_only
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt, Outcome, Solution
from rotorid.fitting.problem import Problem, Scale, StartBox
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.rotors import UP, RotorLayout
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.units import STANDARD_GRAVITY_M_S2


class ErrorSum(Protocol):
    """Sum of errors of one channel at any number of gains."""

    @property
    def best(self) -> float:
        """A gain with the least sum; not a number where nothing depends on it."""
        ...

    def __call__(self, gains: FloatArray) -> FloatArray:
        """Sums at gains ``(b,)``, shape ``(b,)``."""
        ...


class AbsoluteSum(NamedTuple):
    """Sum of absolute errors ``|a - g x|``.

    Parameters
    ----------
    best
        A gain with the least sum; distances are counted from there, so that rounding is small where the sum is.
    corners
        Gains less the best one at which an error changes its sign, ascending, shape ``(n,)``.
    level, slope
        The sum on each of the pieces between corners is ``level + slope (g - best)``, shapes ``(n + 1,)``.
    """

    best: float
    corners: FloatArray
    level: FloatArray
    slope: FloatArray

    def __call__(self, gains: FloatArray) -> FloatArray:
        """Sums at gains ``(b,)``, shape ``(b,)``."""
        moved = gains - self.best
        piece = np.searchsorted(self.corners, moved)
        return np.asarray(self.level[piece] + self.slope[piece] * moved)


class SquaredSum(NamedTuple):
    """Sum of squares of errors ``a - g x``: ``least`` at the best gain, and a parabola about it."""

    best: float
    least: float
    curvature: float

    def __call__(self, gains: FloatArray) -> FloatArray:
        """Sums at gains ``(b,)``, shape ``(b,)``."""
        return np.asarray(self.least + self.curvature * (gains - self.best) ** 2)


def absolute_sum(made: FloatArray, carried: FloatArray, weights: FloatArray | None = None) -> AbsoluteSum:
    """Of samples ``a`` and ``x``, both ``(n,)``, and their weights, one each by default.

    Examples
    --------
    >>> total = absolute_sum(np.array([1.0, 2.0, 9.0]), np.array([1.0, 1.0, 3.0]))
    >>> total.best, total(np.array([0.0, 2.0, 3.0])).tolist()
    (3.0, [12.0, 4.0, 3.0])
    """
    weights = np.ones(made.size) if weights is None else weights
    moves = carried != 0.0
    constant = float(np.sum((weights * np.abs(made))[~moves]))
    ratios = made[moves] / carried[moves]
    order = np.argsort(ratios, kind="stable")
    corners, sizes = ratios[order], (weights[moves] * np.abs(carried[moves]))[order]
    passed = np.concatenate([[0.0], np.cumsum(sizes)])
    best = float(corners[np.searchsorted(passed[1:], 0.5 * passed[-1])]) if corners.size else np.nan
    corners = corners - best
    lever = np.concatenate([[0.0], np.cumsum(sizes * corners)])
    return AbsoluteSum(best, corners, constant + lever[-1] - 2.0 * lever, 2.0 * passed - passed[-1])


def squared_sum(made: FloatArray, carried: FloatArray, weights: FloatArray | None = None) -> SquaredSum:
    """The same of squares.

    Examples
    --------
    >>> total = squared_sum(np.array([1.0, 2.0, 9.0]), np.array([1.0, 1.0, 3.0]))
    >>> round(total.best, 9), total(np.array([0.0, 3.0])).round(9).tolist()
    (2.727272727, [86.0, 5.0])
    """
    weights = np.ones(made.size) if weights is None else weights
    curvature = float(np.sum(weights * carried**2))
    best = float(np.sum(weights * made * carried)) / curvature if curvature else np.nan
    return SquaredSum(best, float(np.sum(weights * (made - best * carried) ** 2)), curvature)


# Corners of absolute values are rounded off over these parts of the mean error, one after the other.
_ROUNDED = (1.0, 0.1, 0.01)
_FINEST = 1e-9
_REACHED = 1e-9


def polished(problem: AccelerationProblem, start: FloatArray, points: FloatArray | None) -> Solution:
    r"""Local search from a start ``(p,)``; never ends above it.

    Absolute errors have corners. Where there is no closed form they are rounded off,
    :math:`|e| \to \sqrt{e^2 + \epsilon^2} - \epsilon`, first over the size of the mean error and in the end over a
    hundredth of it.

    Parameters
    ----------
    problem
        Data and parameters.
    start
        It is brought into the bounds.
    points
        Weights of the samples, shape ``(n,)``; one each by default.
    """
    weights = np.ones(problem.tilt.size) if points is None else points
    cost = _Cost(problem, problem.channel_weights[:, None] * weights)
    theta = np.clip(start, *problem.box)
    reached = _closed_form(problem, theta, points)
    return cost.descend(theta) if reached is None else cost.solution(reached, began=cost.sum(theta))


def error_sums(problem: AccelerationProblem, points: FloatArray | None) -> tuple[ErrorSum, ...]:
    """Sum of errors of each acceleration by its gain, at a fixed lag."""
    total = squared_sum if problem.error == "squared" else absolute_sum
    carried = problem.carried(problem.parameters.pack())
    return tuple(total(a, x, points) for a, x in zip(problem.made, carried, strict=True))


def _closed_form(problem: AccelerationProblem, theta: FloatArray, points: FloatArray | None) -> FloatArray | None:
    """The parameters with the best gains that are nearest to a start, relatively; ``None`` where there are none."""
    if problem.free_powers is None:
        return None
    sums = problem.sums if points is None else error_sums(problem, points)
    ratios = np.array([error_sum.best for error_sum in sums]) / problem.gains(theta)[0]
    if not np.all(np.isfinite(ratios) & (ratios > 0.0)):
        return None
    return _moved(theta, problem.free_powers, np.log(ratios), problem.box)


def _moved(
    theta: FloatArray, powers: FloatArray, wanted: FloatArray, box: tuple[FloatArray, FloatArray]
) -> FloatArray | None:
    """Parameters within their bounds whose products of powers have moved by ``wanted``, in logarithms.

    Those that would leave the box stay at the bound that they meet, and the others make up for them.
    """
    lower, upper = box
    with np.errstate(divide="ignore"):
        low, high = np.log(np.maximum(np.sort([lower / theta, upper / theta], axis=0), 0.0))
    steps, free = np.zeros(theta.size), np.ones(theta.size, dtype=np.bool_)
    while free.any():
        steps[free] = np.linalg.pinv(powers[:, free]) @ (wanted - powers[:, ~free] @ steps[~free])
        over = free & ~((steps >= low) & (steps <= high))
        if not over.any():
            break
        steps, free = np.clip(steps, low, high), free & ~over
    if np.abs(powers @ steps - wanted).max() > _REACHED:
        return None
    reached = np.clip(theta * np.exp(steps), lower, upper)
    met = np.where(reached - lower < upper - reached, lower, upper)
    return np.where(free, reached, met)


class _Cost:
    """Errors and derivatives as residuals; ``scales`` ``(4, n)`` weigh each error."""

    def __init__(self, problem: AccelerationProblem, scales: FloatArray) -> None:
        self.problem, self.scales, self.root = problem, scales, np.sqrt(scales)
        self.absolute = problem.error == "absolute"

    def descend(self, theta: FloatArray) -> Solution:
        """Steps of least squares, with ever sharper corners."""
        lower, upper = self.problem.box
        best = self.solution(theta, began=self.sum(theta))
        evaluations, trace = 0, [best.cost]
        for rounded in _ROUNDED if self.absolute else (0.0,):
            corner = rounded * self.mean_errors(self.errors(theta))

            def residuals(at: FloatArray, corner: FloatArray = corner) -> tuple[FloatArray, FloatArray]:
                return self.residuals(at, corner)

            found = self.sharp(LevenbergMarquardt().minimize(residuals, theta, lower, upper))
            evaluations += found.evaluations
            # Rounded corners may lead up, by as much as they take off.
            if found.cost <= best.cost:
                best, theta = found, found.theta
                trace.append(found.cost)
        return replace(best, evaluations=evaluations, trace=tuple(trace))

    def solution(self, theta: FloatArray, *, began: float) -> Solution:
        """A solution at a place that is known to be one."""
        residual, jacobian = self.sharp_residuals(theta)
        lower, upper = self.problem.box
        cost = float(residual @ residual)
        return Solution(
            theta=theta,
            cost=cost,
            outcome=Outcome.CONVERGED,
            residual=residual,
            jacobian=jacobian,
            evaluations=1,
            trace=(began, cost),
            at_bound=tuple(((theta <= lower) | (theta >= upper)).tolist()),
        )

    def sum(self, theta: FloatArray) -> float:
        """The cost."""
        errors = self.errors(theta)
        return float(np.sum(self.scales * (np.abs(errors) if self.absolute else errors**2)))

    def errors(self, theta: FloatArray) -> FloatArray:
        """Measured less modeled, shape ``(4, n)``."""
        errors: FloatArray = self.problem.made - self.problem.gains(theta)[0][:, None] * self.problem.carried(theta)
        return errors

    def residuals(self, theta: FloatArray, corner: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals ``(4 n,)`` whose squares add up to the cost with rounded corners, and derivatives ``(4 n, p)``."""
        errors = self.errors(theta)
        # Rounding off leaves e^2 / (smooth + corner), the square of this term.
        factor = self.root / np.sqrt(np.sqrt(errors**2 + corner**2) + corner) if self.absolute else self.root
        return (factor * errors).ravel(), self.derivatives(theta, errors, corner)

    def derivatives(self, theta: FloatArray, errors: FloatArray, corner: FloatArray) -> FloatArray:
        """Derivatives of the residuals, ``(4 n, p)``."""
        steep = self.root
        if self.absolute:
            smooth = np.sqrt(errors**2 + corner**2)
            steep = 0.5 * self.root * np.sqrt(smooth + corner) / smooth
        return -(steep * self.problem.slopes(theta)).reshape(len(theta), -1).T

    def mean_errors(self, errors: FloatArray) -> FloatArray:
        """Mean absolute error of each channel over samples that count, shape ``(4, 1)``; never zero."""
        counted = np.maximum(np.sum(self.scales, axis=1), np.finfo(np.float64).tiny)
        mean = np.sum(self.scales * np.abs(errors), axis=1) / counted
        size = np.abs(self.problem.made).mean(axis=1)
        return np.asarray(np.maximum(mean, _FINEST * size)[:, None])

    def sharp(self, found: Solution) -> Solution:
        """A solution of rounded corners with the cost and the residuals of the sharp ones."""
        residual = self.sharp_residual(self.errors(found.theta))
        return replace(found, residual=residual, cost=float(residual @ residual))

    def sharp_residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals ``(4 n,)`` whose squares add up to the cost, and derivatives of those with rounded corners."""
        errors = self.errors(theta)
        jacobian = self.derivatives(theta, errors, _ROUNDED[-1] * self.mean_errors(errors))
        return self.sharp_residual(errors), jacobian

    def sharp_residual(self, errors: FloatArray) -> FloatArray:
        """Residuals whose squares add up to the cost, shape ``(4 n,)``."""
        if not self.absolute:
            return (self.root * errors).ravel()
        return (np.sign(errors) * np.sqrt(self.scales * np.abs(errors))).ravel()


ErrorKind: TypeAlias = Literal["absolute", "squared"]
"""How errors of single samples are added up."""

OUTPUTS = ("z_ddot", "p_dot", "q_dot", "r_dot")
"""Vertical acceleration, upward, and those of roll, pitch and yaw."""

NAMES = ("c_t", "kappa", "I_xx", "I_yy", "I_zz", "m", "omega_max", "T_motor")

POWERS = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 2.0],
        [1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 2.0],
        [1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 2.0],
        [1.0, 1.0, 0.0, 0.0, -1.0, 0.0, 2.0],
    ]
)
"""Gains of the four accelerations as products of powers; columns follow the names without the lag."""

_DECADE = 10.0


def hover_parameters(*, m: float, omega_max: float, T_motor: float) -> ParameterSet:
    """Ranges of the parameters of a small multirotor, in decades, which bound searches.

    Parameters
    ----------
    m, omega_max, T_motor
        Mass in kg, speed of the motors at full output in rad/s, and their lag in s, held at these values;
        ``free_again`` frees one.

    Examples
    --------
    >>> hover_parameters(m=1.023, omega_max=900.0, T_motor=0.1).free
    ('c_t', 'kappa', 'I_xx', 'I_yy', 'I_zz')
    """
    ranges = (
        ("c_t", "N s^2", 1e-6, 1e-4),
        ("kappa", "m", 0.005, 0.5),
        ("I_xx", "kg m^2", 0.001, 0.2),
        ("I_yy", "kg m^2", 0.001, 0.2),
        ("I_zz", "kg m^2", 0.002, 0.4),
    )
    defaults = (
        ("m", "kg", m, 1e-3, 1e3),
        ("omega_max", "rad/s", omega_max, 1.0, 1e5),
        ("T_motor", "s", T_motor, 0.0, 1.0),
    )
    free = [
        Parameter(name=name, value=float(np.sqrt(low * high)), unit=unit, lower=low, upper=high)
        for name, unit, low, high in ranges
    ]
    fixed = [
        Parameter(name=name, value=value, unit=unit, lower=low, upper=high, status="fixed")
        for name, unit, value, low, high in defaults
    ]
    return ParameterSet((*free, *fixed))


@dataclass(frozen=True, kw_only=True, eq=False)
class AccelerationProblem(Problem):
    r"""Search motor and inertia constants with the least difference of four accelerations.

    .. math:: f = \frac{1}{4} \sum_c \frac{\sum_k |a_c(k) - \hat a_c(k)|}{\sum_k |a_c(k) - \bar a_c|}

    A model that knows nothing but the means has a cost of one, and none is better than the noise. Of the four sums, the
    published fitness is the first, over z; how they are put together was not printed. Each channel has a gain of its
    own, so that a common factor of one does not move the minimum where all inertias are free.

    Noise is assumed on the accelerations only. What differentiation has smoothed or delayed, and outputs that are
    logged less often than the motors answer, bias lag and inertia. Angles and
    rates are small: there are no gyroscopic moments and no drag.

    Parameters
    ----------
    motors
        Normalized outputs, zero to one, held until the next sample, shape ``(k, n)``.
    tilt
        cos φ cos θ, shape ``(n,)``.
    accelerations
        ``z_ddot`` upward in m/s², zero at rest, and ``p_dot q_dot r_dot`` in rad/s²; shape ``(4, n)``.
    sample_rate_hz
        Of all.
    layout
        Where the motors are, in meters, and which way they turn; they push straight up.
    region
        Where a global search looks; by default all of the bounds.
    parameters
        Named ``c_t kappa I_xx I_yy I_zz m omega_max T_motor``; their bounds are the box of the search.
    error
        ``absolute`` as published, which outliers hardly move; ``squared`` for the least variance under normal noise.

    Raises
    ------
    UsageError
        Shapes do not belong together, the arm is not known or a rotor is tilted, a parameter is missing or a free one
        is without finite bounds, or a value is not finite.
    InsufficientDataError
        A channel stands still.

    Examples
    --------
    >>> from rotorid.vehicles import hover_quadrotor
    >>> flight = hover_quadrotor.fly(np.random.default_rng(0))
    >>> problem = AccelerationProblem(
    ...     motors=flight.motors, tilt=flight.tilt, accelerations=flight.accelerations, sample_rate_hz=100.0,
    ...     layout=hover_quadrotor.layout(),
    ...     parameters=hover_parameters(m=1.023, omega_max=900.0, T_motor=0.1).fix("kappa", 0.05))
    >>> found = problem.polish(problem.parameters.pack())
    >>> {name: round(value / hover_quadrotor.TRUTH[name], 2) for name, value in problem.named(found.theta).items()}
    {'c_t': 1.0, 'I_xx': 1.0, 'I_yy': 1.0, 'I_zz': 0.99}
    """

    at_once: ClassVar[int] = 128

    motors: FloatArray
    tilt: FloatArray
    accelerations: FloatArray
    sample_rate_hz: float
    layout: RotorLayout
    error: ErrorKind = "absolute"

    def __post_init__(self) -> None:
        motors, accelerations = (read_only(rows, np.float64, ndim=2) for rows in (self.motors, self.accelerations))
        tilt = read_only(self.tilt, np.float64, ndim=1)
        count, samples = self.layout.rotors, tilt.size
        if motors.shape != (count, samples) or accelerations.shape != (len(OUTPUTS), samples):
            raise UsageError(
                f"motor outputs of shape {motors.shape}, accelerations of shape {accelerations.shape} and "
                f"{samples} tilts do not match",
                needed=f"shapes ({count}, n), ({len(OUTPUTS)}, n) and (n,)",
            )
        if not all(np.isfinite(rows).all() for rows in (motors, accelerations, tilt)):
            raise UsageError("some samples are not finite", needed="numbers", remedy="cut out the gaps")
        if missing := [name for name in NAMES if name not in self.parameters.names]:
            raise UsageError(f"the parameters lack {', '.join(missing)}", needed=", ".join(NAMES))
        if self.error not in get_args(ErrorKind):
            raise UsageError(f"unknown error={self.error!r}", needed=" or ".join(map(repr, get_args(ErrorKind))))
        if not self.layout.arm_known or np.any(self.layout.thrust_axes.T != UP):
            raise UsageError(
                f"the layout {self.layout.name} is not supported",
                needed="positions in meters and rotors that push straight up",
            )
        self._set(motors=motors, accelerations=accelerations, tilt=tilt)
        self._require_movement()
        _ = self.search_box

    def _require_movement(self) -> None:
        still = [name for name, size in zip(OUTPUTS, self._sizes.tolist(), strict=True) if size == 0.0]
        if still:
            raise InsufficientDataError(
                f"{' and '.join(still)} did not move", needed="a flight in which all accelerations move"
            )

    @property
    def name(self) -> str:
        """Name of the fit for messages."""
        return "accelerations from motor outputs"

    @cached_property
    def search_box(self) -> StartBox:
        """The whole of the bounds, where no region is given; those over a decade and more divided logarithmically."""
        if self.region is not None:
            return self.region
        free = [self.parameters[name] for name in self.parameters.free]
        wide: list[Scale] = [
            "logarithmic" if p.lower > 0.0 and p.upper >= _DECADE * p.lower else "linear" for p in free
        ]
        return StartBox(
            lower=np.array([p.lower for p in free]), upper=np.array([p.upper for p in free]), scales=tuple(wide)
        )

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals ``(4 n,)`` whose squares add up to the cost, and derivatives with corners rounded ``(4 n, p)``."""
        return _Cost(self, np.broadcast_to(self.channel_weights[:, None], self.made.shape)).sharp_residuals(theta)

    def named(self, theta: FloatArray) -> dict[str, float]:
        """Free parameters by their names."""
        return dict(zip(self.parameters.free, np.asarray(theta).tolist(), strict=True))

    def many_costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of many parameter vectors ``(b, p)``, shape ``(b,)``; infinite where the model has no value."""
        gains, kept = self._model(self._values(thetas))
        if self.holds_lag:
            sums = np.stack([total(gain) for total, gain in zip(self.sums, gains.T, strict=True)], axis=1)
        else:
            sums = self._sums_with_lags(gains, kept)
        costs: FloatArray = sums @ self.channel_weights
        return np.where(np.isfinite(costs), costs, np.inf)

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of every sample, ``(b, p)`` to ``(b, n)``."""
        gains, kept = self._model(self._values(thetas))
        rows: list[FloatArray] = []
        for gain, share in zip(gains, kept.tolist(), strict=True):
            errors = np.abs(self.made - gain[:, None] * self._settled(share))
            rows.append(self.channel_weights @ (errors**2 if self.error == "squared" else errors))
        costs: FloatArray = np.array(rows).reshape(len(gains), self.tilt.size)
        return np.where(np.isfinite(costs), costs, np.inf)

    def modeled(self, theta: FloatArray) -> FloatArray:
        """Modeled and measured accelerations, shape ``(4, n)``."""
        gains, kept = self._model(self._values(np.atleast_2d(theta)))
        model: FloatArray = gains[0][:, None] * self._settled(float(kept[0]))
        model[0] -= STANDARD_GRAVITY_M_S2
        return model

    def polish(self, start: FloatArray) -> Solution:
        """Local search from a start ``(p,)``; its cost is that of :meth:`many_costs`, never above the start's.

        Where the lag is held and each acceleration can have the gain that suits it best, which is so with all inertias
        free, this is the only minimum, in closed form: see :mod:`rotorid.search.acceleration`.
        """
        return polished(self, start, None)

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        """The same with weights of the samples, shape ``(n,)``.

        Raises
        ------
        UsageError
            There is not one weight for every sample, or one is negative.
        """
        weights = np.asarray(points, dtype=np.float64)
        if weights.shape != self.tilt.shape or not weights.min(initial=0.0) >= 0.0:
            raise UsageError(f"invalid weights of shape {weights.shape}", needed="one for every sample, none negative")
        return polished(self, start, weights)

    @cached_property
    def channel_weights(self) -> FloatArray:
        """Weight of an error of each acceleration in the cost, shape ``(4,)``."""
        weights: FloatArray = 1.0 / (len(OUTPUTS) * self._sizes)
        return weights

    @cached_property
    def made(self) -> FloatArray:
        """Accelerations that the motors must make: the vertical one with gravity, shape ``(4, n)``."""
        made = self.accelerations.copy()
        made[0] += STANDARD_GRAVITY_M_S2
        return made

    def gains(self, thetas: FloatArray) -> FloatArray:
        """Acceleration over what the motors carry, ``(b, p)`` to ``(b, 4)``."""
        return self._model(self._values(thetas))[0]

    def carried(self, theta: FloatArray) -> FloatArray:
        """Thrust and torque of the motors at a vector ``(p,)``, with unit gains, shape ``(4, n)``."""
        return self._settled(float(self._model(self._values(theta))[1][0]))

    def slopes(self, theta: FloatArray) -> FloatArray:
        """Derivatives of the modeled accelerations with the free parameters, shape ``(p, 4, n)``."""
        here = self.parameters.unpack(theta)
        values = np.array([here.values[name] for name in NAMES])
        directions = here.directions[[here.names.index(name) for name in NAMES]]
        gains, (kept,) = self._model(values[None])
        of_gains = gains[0][:, None] * (POWERS / values[:-1]) @ directions[:-1]
        # Sums over samples are fast where those of one acceleration lie side by side.
        slopes: FloatArray = np.ascontiguousarray(of_gains.T)[:, :, None] * self._settled(float(kept))
        if directions[-1].any():
            # The derivative of a lag is a lag of what it has not yet followed.
            behind = self._lagged(self._lagged(self._drives, kept) - self._drives, kept)
            behind *= kept / (1.0 - kept) / (self.sample_rate_hz * values[-1] ** 2)
            behind[0] *= self.tilt
            slopes += directions[-1][:, None, None] * gains[0][:, None] * behind
        return slopes

    @cached_property
    def holds_lag(self) -> bool:
        """Whether the motors answer alike whatever the free parameters are."""
        return self.parameters["T_motor"].status not in ("free", "tied")

    @cached_property
    def free_powers(self) -> FloatArray | None:
        """Powers of the free parameters in the gains, shape ``(4, p)``; ``None`` where that is not all: lag, ties."""
        _, free, tied = self._columns
        return None if tied or not self.holds_lag else POWERS[:, free]

    @cached_property
    def sums(self) -> tuple[ErrorSum, ...]:
        """Sum of errors of each acceleration by its gain, at a fixed lag."""
        return error_sums(self, None)

    def _sums_with_lags(self, gains: FloatArray, kept: FloatArray) -> FloatArray:
        """Sums of errors of candidates with a lag of their own each, shape ``(b, 4)``."""
        from rotorid.search.acceleration_kernels import error_sums as at_once

        squared = self.error == "squared"
        pairs = zip(gains, kept, strict=True)
        return np.array([at_once(row[None], self._carried(lag), self.made, squared)[0] for row, lag in pairs])

    @cached_property
    def _sizes(self) -> FloatArray:
        """How much each channel moves about its mean, in all, shape ``(4,)``."""
        moved: FloatArray = self.accelerations - self.accelerations.mean(axis=1, keepdims=True)
        return np.asarray(np.sum(moved**2 if self.error == "squared" else np.abs(moved), axis=1))

    @cached_property
    def _drives(self) -> FloatArray:
        """Outputs after a mixer of unit thrust and drag and before the lag, which all motors share; ``(4, n)``."""
        arms, spins = self.layout.moment_arms, self.layout.spins
        return np.stack([np.ones_like(spins), arms[0], arms[1], spins]) @ self.motors

    @cached_property
    def _columns(self) -> tuple[FloatArray, list[int], bool]:
        """Present values, the places of the free ones, and whether others depend on them."""
        here = self.parameters.values
        tied = any(parameter.status == "tied" for parameter in self.parameters)
        return np.array([here[name] for name in NAMES]), [NAMES.index(name) for name in self.parameters.free], tied

    def _values(self, thetas: FloatArray) -> FloatArray:
        """Values by name of many vectors ``(b, p)``, shape ``(b, 8)``; not a number where ties allow none."""
        rows = np.atleast_2d(np.asarray(thetas, dtype=np.float64))
        here, free, tied = self._columns
        if tied:
            return np.array([self._tied(row) for row in rows])
        values = np.empty((len(rows), here.size))
        values[:] = here
        values[:, free] = rows
        return values

    def _tied(self, theta: FloatArray) -> list[float]:
        try:
            values = self.parameters.unpack(theta).values
        except ModelError:
            return [np.nan] * len(NAMES)
        return [values[name] for name in NAMES]

    def _model(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gains ``(b, 4)`` and what the motors keep from a sample to the next ``(b,)``."""
        from rotorid.search.acceleration_kernels import products

        with np.errstate(divide="ignore"):
            kept = np.exp(-1.0 / (self.sample_rate_hz * np.maximum(values[:, -1], 0.0)))
        return products(values[:, :-1], POWERS), kept

    @cached_property
    def _carried_at_fixed_lag(self) -> FloatArray:
        """Thrust and torque of the motors at a fixed lag, shape ``(4, n)``."""
        return self._carried(float(self._model(self._values(self.parameters.pack()))[1][0]))

    def _settled(self, kept: float) -> FloatArray:
        """Thrust and torque of the motors from their drives, the first row tilted, shape ``(4, n)``."""
        return self._carried_at_fixed_lag if self.holds_lag else self._carried(kept)

    def _carried(self, kept: float) -> FloatArray:
        settled = self._lagged(self._drives, kept)
        settled[0] *= self.tilt
        return settled

    @staticmethod
    def _lagged(drives: FloatArray, kept: float) -> FloatArray:
        from rotorid.search.acceleration_kernels import lagged

        return np.asarray(lagged(drives, float(kept)))


_NEAR = 0.5
"""Errors smaller than this part of the median count as being about zero: some 26 % of normal ones."""

_FLAT = 1e-10
_UNSEEN = 1e8


def acceleration_bounds(problem: AccelerationProblem, theta: FloatArray) -> Bounds:
    r"""Covariance of the parameters at the end of a fit.

    .. math:: \mathrm{Cov}\,\theta = H^{-1} V H^{-1}, \qquad H = \sum_c k_c S_c^T S_c, \quad V = \sum_c v_c S_c^T S_c

    with the slopes :math:`S_c` of each acceleration and its weight :math:`w_c`. Absolute errors have
    :math:`k_c = 2 w_c f_c(0)`, twice the density of the errors at zero, and :math:`v_c = w_c^2`; squares have
    :math:`k_c = 2 w_c` and :math:`v_c = 4 w_c^2 \sigma_c^2`. Assumes errors that are white: those of differentiated
    signals are not, and their covariance is larger at low frequencies and smaller at high ones.

    A direction in which the cost is flat is given :math:`10^8` of what its parameters would have alone, so that
    :func:`rotorid.uncertainty.identifiability.unseen_combinations` names it.

    Parameters
    ----------
    problem
        What was fitted.
    theta
        Where it ended, shape ``(p,)``.

    Returns
    -------
    Bounds
        Of what CIFER's percents are made has no meaning here: ``cramer_rao`` is the standard deviation, and
        ``insensitivity`` that with all other parameters held.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect on the accelerations.

    References
    ----------
    R. Koenker and G. Bassett, *Regression Quantiles*, Econometrica 46(1), 1978.
    """
    errors, slopes = problem.accelerations - problem.modeled(theta), problem.slopes(theta)
    grams = np.einsum("icn,jcn->cij", slopes, slopes)
    weights = problem.channel_weights
    if problem.error == "squared":
        curvature, variance = 2.0 * weights, 4.0 * weights**2 * np.mean(errors**2, axis=1)
    else:
        curvature, variance = 2.0 * weights * _density_at_zero(errors), weights**2
    H, V = np.tensordot(curvature, grams, axes=1), np.tensordot(variance, grams, axes=1)
    length = np.sqrt(np.diag(H))
    if not np.all(length > 0.0):
        still = ", ".join(name for name, size in zip(problem.parameters.free, length, strict=True) if not size > 0.0)
        raise InsufficientDataError(f"{still} has no effect on the accelerations", remedy="fix it")
    alone = np.sqrt(np.diag(V)) / np.diag(H)
    covariance = _sandwich(H / np.outer(length, length), V / np.outer(length, length)) / np.outer(length, length)
    return Bounds(
        names=problem.parameters.free,
        cramer_rao=np.sqrt(np.diag(covariance)),
        insensitivity=alone,
        covariance=covariance,
        random=covariance,
        colored=1.0,
    )


def _density_at_zero(errors: FloatArray) -> FloatArray:
    """Probability density of each channel's errors at zero, shape ``(4,)``."""
    near = np.maximum(_NEAR * np.median(np.abs(errors), axis=1), np.finfo(np.float64).tiny)
    return np.asarray(np.mean(np.abs(errors) <= near[:, None], axis=1) / (2.0 * near))


def _sandwich(H: FloatArray, V: FloatArray) -> FloatArray:
    """``H^-1 V H^-1`` where H sees anything, and very much where it does not."""
    sizes, directions = np.linalg.eigh(H)
    significant = sizes > _FLAT * sizes.max()
    inverse = directions[:, significant] / sizes[significant] @ directions[:, significant].T
    flat = directions[:, ~significant]
    return np.asarray(inverse @ V @ inverse + _UNSEEN**2 * np.mean(np.diag(V)) * flat @ flat.T)
