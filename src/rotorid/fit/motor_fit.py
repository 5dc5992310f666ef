"""Fit motors, thrust and inertia to flights: by turns the parameters and the color of the errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.motor_excitation import LEAST_CORRELATION, Excitation, excitations, slow_taps
from rotorid.fit.motor_problem import Filter, MotorProblem
from rotorid.fit.solution import Solution
from rotorid.fit.time_problem import Part
from rotorid.fit.whitening import whitening_taps
from rotorid.models.parameter import ParameterSet
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

WEIGHING = Filter(np.ones(1), 0.05)
"""The mean of an accelerometer as a scale of the weight: good to its bias, 0.05 m/s² where it was calibrated."""

_MEMORY_S = 0.12
_LEAST_ORDER, _MOST_ORDER = 6, 60
_SOLVER = LevenbergMarquardt(iterations=80, tolerance=1e-8)
LEAST_SAMPLES = 10 * _LEAST_ORDER
"""Fewer in a record do not tell motors from noise."""

_AT_REST = 0.05
_SHORT = 0.1
_INERTIA = {"p": "I_xx", "q": "I_yy", "r": "kappa_per_I_zz"}


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorFit(Immutable):
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
    """

    problem: MotorProblem
    solution: Solution
    excitations: tuple[Mapping[str, Excitation], ...]
    rounds: int
    settled: bool

    @property
    def parameters(self) -> ParameterSet:
        """The identified values."""
        return self.problem.parameters.unpack(self.solution.theta)

    @property
    def moving(self) -> tuple[str, ...]:
        """Free parameters that did not end on a bound, and have an uncertainty.

        A lag far shorter than the samples is not told from a delay, and has none.
        """
        free = self.problem.parameters.free
        return tuple(name for name, kept in zip(free, self._kept, strict=True) if kept)

    @property
    def _kept(self) -> BoolArray:
        fastest_hz = max(record.sample_rate_hz for record in self.problem.records)
        names = self.problem.parameters.free
        short = [
            name == "T_motor" and value * fastest_hz < _SHORT
            for name, value in zip(names, self.solution.theta, strict=True)
        ]
        return ~(np.array(self.solution.at_bound, dtype=np.bool_) | np.array(short, dtype=np.bool_))

    def parts(self) -> list[Part]:
        """Whitened errors of each equation, with derivatives by what is :attr:`moving`."""
        return [part._replace(slopes=part.slopes[..., self._kept]) for part in self.problem.parts(self.solution.theta)]


def excited_axes(found: Sequence[Mapping[str, Excitation]]) -> tuple[str, ...]:
    """Axes that some record excites, in the order ``az p q r``."""
    return tuple(
        axis for axis in ("az", "p", "q", "r") if any(record[axis].correlation >= LEAST_CORRELATION for record in found)
    )


def fit_motors(
    problem: MotorProblem,
    *,
    solver: LevenbergMarquardt = _SOLVER,
    rounds: int = 15,
    progress: Callable[[str], None] = lambda _: None,
) -> MotorFit:
    r"""Fit the motor chain by a prediction error method.

    An axis of a record counts where the motors explain its slow motion (:mod:`rotorid.fit.motor_excitation`). The first
    fit is to slow motion. From then on the errors of each rate are whitened by the autoregression that they show, and
    the values fitted again, until both rest. Errors of the specific force are left as they are: no controller answers
    to them from sample to sample, and the curve of thrust is known from what is slow and large, which whitening against
    vibration would discount. Their color counts in the uncertainty.

    Parameters
    ----------
    problem
        Records, levers, parameters; its axes are those that some record must excite.
    solver
        Local search.
    rounds
        How often to whiten at most.
    progress
        Told after each round.

    Raises
    ------
    InsufficientDataError
        A record is too short, or no record excites one of the axes.
    """
    shortest = min(record.samples for record in problem.records)
    if shortest < LEAST_SAMPLES:
        raise InsufficientDataError(f"a record of {shortest} samples came", needed=f"{LEAST_SAMPLES} or more")
    found = excitations(problem.records, problem.levers)
    if missing := set(problem.axes) - {"weight", *excited_axes(found)}:
        raise InsufficientDataError(
            f"the motors explain the motion along {', '.join(sorted(missing))} in no record",
            needed=f"a correlation of {LEAST_CORRELATION:g} up to 5 Hz",
            remedy="fly sweeps or doublets on these axes, or leave them out",
        )
    problem = _slow(problem.with_parameters(_start(problem, found)), found)
    solution = solver.minimize(problem.residuals, problem.parameters.pack(), *problem.box)
    settled, count = False, 0
    for count in range(1, rounds + 1):
        problem = _whitened(problem, solution.theta)
        following = solver.minimize(problem.residuals, solution.theta, *problem.box)
        moved = float(np.max(_deviations(following, solution.theta), initial=0.0))
        solution, settled = following, moved <= _AT_REST
        progress(f"motors, round {count}: values moved by {moved:.2g} standard deviations")
        if settled:
            break
    return MotorFit(problem=problem, solution=solution, excitations=found, rounds=count, settled=settled)


def _deviations(solution: Solution, before: FloatArray) -> FloatArray:
    """How far the values moved, in standard deviations; those on a bound do not move."""
    slopes = np.where(np.array(solution.at_bound), 0.0, solution.jacobian)
    variances = np.diag(np.linalg.pinv(slopes.T @ slopes, hermitian=True))
    moved = np.abs(solution.theta - before)
    return np.where(variances > 0.0, moved / np.sqrt(np.where(variances > 0.0, variances, 1.0)), 0.0)


def _counted(record: Mapping[str, Excitation], axes: Sequence[str]) -> list[str]:
    """Equations of a record that count; the weight where nothing better is known of the thrust."""
    excited = [axis for axis in axes if axis in record and record[axis].correlation >= LEAST_CORRELATION]
    return excited if "az" in excited or "weight" not in axes else ["weight", *excited]


def _slow(problem: MotorProblem, found: Sequence[Mapping[str, Excitation]]) -> MotorProblem:
    """The problem of slow motion: each axis that counts in units of the errors of a first guess."""
    filters = []
    for record, errors, seen in zip(problem.records, problem.errors(problem.parameters.pack()), found, strict=True):
        taps = slow_taps(record.sample_rate_hz)
        counted = _counted(seen, problem.axes)
        filters.append({axis: WEIGHING if axis == "weight" else _fitting(taps, errors[axis]) for axis in counted})
    return problem.with_filters(filters)


def _fitting(taps: FloatArray, error: FloatArray) -> Filter:
    size = float(np.sqrt(np.mean(Filter(taps, 1.0)(error) ** 2)))
    return Filter(taps, size or 1.0)


def _whitened(problem: MotorProblem, theta: FloatArray) -> MotorProblem:
    filters = []
    for record, errors, counted in zip(problem.records, problem.errors(theta), problem.filters, strict=True):
        order = int(np.clip(round(_MEMORY_S * record.sample_rate_hz), _LEAST_ORDER, _MOST_ORDER))
        order = min(order, record.samples // 10)
        filters.append({axis: _whitening(axis, errors[axis], order) for axis in counted})
    return problem.with_filters(filters)


def _whitening(axis: str, error: FloatArray, order: int) -> Filter:
    if axis == "weight":
        return WEIGHING
    return _fitting(np.ones(1) if axis == "az" else whitening_taps(error, order), error)


def _start(problem: MotorProblem, found: Sequence[Mapping[str, Excitation]]) -> ParameterSet:
    """Thrust that carries the weight, lag of the best correlation, inertia from torque and slow acceleration."""
    parameters = problem.parameters
    free = set(parameters.free)
    lags = [one.lag_s for record in found for one in record.values() if one.correlation >= LEAST_CORRELATION]
    if "T_motor" in free and lags:
        parameters = parameters.with_values({"T_motor": float(np.median(lags))})
    parameters = parameters.with_values(_carrying(problem, parameters))
    units = {name: 1.0 for axis, name in _INERTIA.items() if axis in problem.axes and name in free}
    return parameters.with_values(_inertia(problem.with_parameters(parameters.with_values(units)), found, units))


def _carrying(problem: MotorProblem, parameters: ParameterSet) -> dict[str, float]:
    """The leading coefficient of thrust, or the mass, with which the rotors carry the weight on average."""
    curve: list[str] = [name for name in ("c_0", "c_1", "c_2") if name in parameters.names]
    sums = {name: _summed(problem, int(name[-1])) for name in curve}
    carried = sum(parameters[name].value * sums[name] for name in curve if name not in parameters.free)
    if not (open_ := [name for name in curve if name in parameters.free]):
        return {"m": carried / STANDARD_GRAVITY_M_S2} if "m" in parameters.free else {}
    weight = parameters["m"].value * STANDARD_GRAVITY_M_S2
    return dict.fromkeys(open_, 0.0) | {open_[-1]: (weight - carried) / sums[open_[-1]]}


def _summed(problem: MotorProblem, power: int) -> float:
    """Sum over the rotors of a power of their outputs, on average over the records."""
    means = [float(np.mean((record.outputs**power).sum(axis=0) * record.strength)) for record in problem.records]
    return float(np.mean(means))


def _inertia(
    probe: MotorProblem, found: Sequence[Mapping[str, Excitation]], units: Mapping[str, float]
) -> dict[str, float]:
    """Inertia from the regression of slow acceleration on the torque of a unit inertia."""
    products = {axis: np.zeros(2) for axis in probe.axes}
    for record, equations, seen in zip(probe.records, probe.equations(probe.parameters.pack()), found, strict=True):
        shape = Filter(slow_taps(record.sample_rate_hz), 1.0)
        for axis in equations:
            if axis.name in _counted(seen, probe.axes):
                motion, torque = (shape(row - row.mean()) for row in (axis.measured, axis.predicted))
                products[axis.name] += [float(motion @ torque), float(torque @ torque)]
    gains = {axis: top / bottom for axis, (top, bottom) in products.items() if top > 0.0}
    values = {
        name: gains.get(axis, 1.0) if axis == "r" else 1.0 / gains.get(axis, 1.0) for axis, name in _INERTIA.items()
    }
    return {name: value for name, value in values.items() if name in units}
