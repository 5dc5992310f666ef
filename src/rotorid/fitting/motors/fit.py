r"""Fit the chain from motor outputs to accelerations (:mod:`rotorid.fitting.motors.problem`).

The fit takes turns between the parameters and the filters that whiten the errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.base import cached_by_value
from rotorid.errors import InsufficientDataError
from rotorid.fitting.least_squares import LevenbergMarquardt, Solution
from rotorid.fitting.motors.excitation import LEAST_CORRELATION, SLOW_BAND_HZ, Excitation, excited_axes
from rotorid.fitting.motors.problem import Filter, MotorProblem
from rotorid.fitting.motors.start import WEIGHING, sized, slow_problem, started
from rotorid.fitting.problem import Fit, Part
from rotorid.models.motors import YAW_DELAY
from rotorid.typing import FloatArray

_RIDGE = 1e-9


def whitening_taps(error: FloatArray, order: int) -> FloatArray:
    r"""Taps of :math:`A(z^{-1}) = 1 - a_1 z^{-1} - \dots`, with which an error becomes (nearly) white.

    The autoregression follows from the sample autocorrelation by the equations of Yule and Walker, so that its inverse
    is stable.

    Parameters
    ----------
    error
        Shape ``(n,)``, with n well above the order.
    order
        Number of past samples.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> noise = rng.standard_normal(20000)
    >>> colored = noise[1:] + 0.5 * noise[:-1]
    >>> white = np.convolve(colored, whitening_taps(colored, 10), mode="valid")
    >>> bool(abs(np.mean(white[1:] * white[:-1]) / np.mean(white**2)) < 0.02)
    True
    """
    from scipy.linalg import solve_toeplitz

    size = int(2 ** np.ceil(np.log2(2 * error.size)))
    power = np.abs(np.fft.rfft(error, size)) ** 2
    correlation = np.fft.irfft(power, size)[: order + 1] / error.size
    correlation[0] *= 1.0 + _RIDGE
    coefficients = solve_toeplitz(correlation[:order], correlation[1:])
    return np.concatenate([[1.0], -coefficients])


_MEMORY_S = 0.12
_LEAST_ORDER, _MOST_ORDER = 6, 60
_SOLVER = LevenbergMarquardt(iterations=80, tolerance=1e-8)
LEAST_SAMPLES = 10 * _LEAST_ORDER
"""Fewer in a record do not separate motors from noise."""

_AT_REST = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorFit(Fit):
    """End of a fit of the motor chain.

    Parameters
    ----------
    problem
        What was fitted, with the filters that whiten its errors.
    solution
        End of the last search.
    excitations
        For every record, how far the motors explain the slow motion of each axis; those that count have a filter in the
        problem.
    rounds
        How often the color of the errors was estimated.
    settled
        Whether the values came to rest.
    moved
        By how much each free parameter moved in the last round, shape ``(p,)``; nothing where there was none.
    white_force
        Whether errors of the specific force were whitened.
    """

    problem: MotorProblem
    excitations: tuple[Mapping[str, Excitation], ...]
    rounds: int
    settled: bool
    moved: FloatArray = field(default_factory=lambda: np.zeros(0))
    white_force: bool = False

    @property
    def moving(self) -> tuple[str, ...]:
        """Free parameters that have an uncertainty, see :meth:`MotorProblem.determined`."""
        kept = self.problem.determined(self.solution)
        return tuple(name for name, known in zip(self.problem.parameters.free, kept, strict=True) if known)

    def parts(self) -> list[Part]:
        """Whitened errors of each equation, with derivatives by what is :attr:`moving`."""
        kept = self.problem.determined(self.solution)
        return [part._replace(slopes=part.slopes[..., kept]) for part in self.problem.parts_at(self.solution)]


def likely_step(fit: MotorFit, more: MotorProblem, name: str) -> tuple[float, float]:
    """Where one parameter more would go from its value, to first order, and the deviation of white errors.

    Parameters
    ----------
    fit
        Without the parameter.
    more
        The same problem with it, at the end of the fit, and with its filters.
    """
    residual, jacobian = more.residuals(more.parameters.pack())
    free = more.parameters.free
    kept = [place for place, item in enumerate(free) if item == name or item in fit.moving]
    slopes = jacobian[:, kept]
    length = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    inverse = np.linalg.pinv(slopes.T @ slopes / np.outer(length, length), hermitian=True) / np.outer(length, length)
    place = kept.index(free.index(name))
    return float(-inverse[place] @ (slopes.T @ residual)), float(np.sqrt(inverse[place, place]))


def fit_motors(
    problem: MotorProblem,
    *,
    solver: LevenbergMarquardt = _SOLVER,
    rounds: int = 15,
    white_force: bool = False,
    start: Mapping[str, float] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> MotorFit:
    r"""Fit the motor chain by a prediction error method.

    An axis of a record counts where the motors explain its slow motion (:mod:`rotorid.fitting.motors.excitation`). The
    first fit is to slow motion. From then on the errors of each rate are whitened by the autoregression that they show,
    and the values fitted again, until both rest. Errors of the specific force are left as they are: no controller
    answers to them from sample to sample, and the curve of thrust is known from what is slow and large, which whitening
    against vibration would discount. Their color counts in the uncertainty. Gusts are another matter: a controller that
    answers to them moves thrust with the force that they cause, which pulls the slope of thrust down; ``white_force``
    takes their color out as that of the rates.

    Parameters
    ----------
    problem
        Records, levers, parameters; its axes are those that some record must excite.
    solver
        Local search.
    rounds
        How often to whiten at most.
    white_force
        Whether errors of the specific force are whitened too.
    start
        Values to start from, such as those of a search; by default what thrust, lag and inertia are at first sight.
    progress
        Told after each round.

    Raises
    ------
    InsufficientDataError
        A record is too short, or no record excites one of the axes.
    """
    shortest = min(record.samples for record in problem.records)
    if shortest < LEAST_SAMPLES:
        raise InsufficientDataError(f"a record of {shortest} samples is too short", needed=f"{LEAST_SAMPLES} or more")
    found = problem.excitations
    if missing := set(problem.axes) - {"weight", *excited_axes(found)}:
        raise InsufficientDataError(
            f"the motors explain the motion along {', '.join(sorted(missing))} in no record",
            needed=f"a correlation of {LEAST_CORRELATION:g} up to 5 Hz, or in two octaves above",
            remedy="fly sweeps or doublets on these axes, or leave them out",
        )
    problem, solution = _slow_fit(problem, solver, tuple((start or {}).items()))
    settled, count, last = False, 0, np.zeros(0)
    for count in range(1, rounds + 1):
        problem = _with_whitening(problem, solution.theta, found, white_force=white_force)
        following = solver.minimize(problem.residuals, solution.theta, *problem.box)
        if count == 1:
            following = at_the_best_sample(problem, following, solver)
        moved = float(np.max(_deviations(following, solution.theta), initial=0.0))
        last = following.theta - solution.theta
        solution, settled = following, moved <= _AT_REST
        progress(f"motors, round {count}: values changed by {moved:.2g} standard deviations")
        if settled:
            break
    return MotorFit(
        problem=problem,
        solution=solution,
        excitations=found,
        rounds=count,
        settled=settled,
        moved=last,
        white_force=white_force,
    )


@cached_by_value
def _slow_fit(
    problem: MotorProblem, solver: LevenbergMarquardt, start: tuple[tuple[str, float], ...]
) -> tuple[MotorProblem, Solution]:
    """The first fit, to slow motion: what the color of the force is taken for comes later."""
    found, begin = problem.excitations, dict(start)
    parameters = started(problem, found)
    parameters = parameters.with_values({name: begin[name] for name in parameters.free if name in begin})
    slow = slow_problem(problem.with_parameters(parameters), found)
    return slow, solver.minimize(slow.residuals, slow.parameters.pack(), *slow.box)


_CORNER, _WORTH, _MOST_SAMPLES = 0.25, 0.95, 4
_GLANCE = LevenbergMarquardt(iterations=4, tolerance=1e-3)


def at_the_best_sample(problem: MotorProblem, solution: Solution, solver: LevenbergMarquardt) -> Solution:
    """The minimum near a delay of another whole number of samples, where that explains clearly more.

    Outputs are held from sample to sample. At such a delay their steps meet a sample of the rates, and the cost has a
    corner, which a search that follows slopes does not pass.

    Parameters
    ----------
    problem
        With the filters of the solution.
    solution
        Where the search ended.
    solver
        Goes on from a neighbor that explains a twentieth more after four steps with the delay held.
    """
    for name in ("tau_gyro", YAW_DELAY):
        if name in problem.parameters.free:
            solution = _at_the_best_sample_of(name, problem, solution, solver)
    return solution


def _at_the_best_sample_of(
    name: str, problem: MotorProblem, solution: Solution, solver: LevenbergMarquardt
) -> Solution:
    place, step_s = problem.parameters.free.index(name), 1.0 / problem.records[0].sample_rate_hz
    lower, upper = problem.box
    for _ in range(_MOST_SAMPLES):
        here = solution.theta[place] / step_s
        for samples in (np.ceil(here - _CORNER) - 1.0, np.floor(here + _CORNER) + 1.0):
            start = solution.theta.copy()
            start[place] = samples * step_s
            if not lower[place] <= start[place] <= upper[place]:
                continue
            fixed = problem.with_parameters(problem.parameters.fix(name, float(start[place])))
            glance = _GLANCE.minimize(fixed.residuals, np.delete(start, place), *fixed.box)
            if glance.cost < _WORTH * solution.cost:
                start[np.arange(start.size) != place] = glance.theta
                solution = solver.minimize(problem.residuals, start, *problem.box)
                break
        else:
            break
    return solution


def _deviations(solution: Solution, before: FloatArray) -> FloatArray:
    """How far the values moved, in standard deviations; those on a bound do not move."""
    slopes = np.where(np.array(solution.at_bound), 0.0, solution.jacobian)
    variances = np.diag(np.linalg.pinv(slopes.T @ slopes, hermitian=True))
    moved = np.abs(solution.theta - before)
    return np.where(variances > 0.0, moved / np.sqrt(np.where(variances > 0.0, variances, 1.0)), 0.0)


def _with_whitening(
    problem: MotorProblem, theta: FloatArray, found: Sequence[Mapping[str, Excitation]], *, white_force: bool
) -> MotorProblem:
    filters = []
    for record, errors, counted, excited in zip(
        problem.records, problem.errors(theta), problem.filters, found, strict=True
    ):
        order = int(np.clip(round(_MEMORY_S * record.sample_rate_hz), _LEAST_ORDER, _MOST_ORDER))
        order = min(order, record.samples // 10)
        order_of = {axis: 0 if axis == "az" and not white_force else order for axis in counted}
        whitening = {axis: _whitening(axis, errors[axis], order_of[axis]) for axis in counted}
        # Outside of its octaves an axis shows the air, which no color of errors takes out.
        banded = {axis for axis in counted if axis in excited and excited[axis].band_hz != SLOW_BAND_HZ}
        for axis in banded:
            taps = np.convolve(whitening[axis].taps, excited[axis].taps(record.sample_rate_hz))
            whitening[axis] = sized(taps, errors[axis])
        filters.append(whitening)
    return problem.with_filters(filters)


def _whitening(axis: str, error: FloatArray, order: int) -> Filter:
    if axis == "weight":
        return WEIGHING
    return sized(whitening_taps(error, order) if order else np.ones(1), error)
