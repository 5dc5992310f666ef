"""One verb fits any problem; this chooses the method of each kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from rotorid.errors import UsageError
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.least_squares import LevenbergMarquardt, best_of
from rotorid.fitting.motors.fit import fit_motors
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.problem import Fit, Problem
from rotorid.fitting.time.nonlinear import NonlinearProblem, fit_nonlinear
from rotorid.fitting.time.output_error import fit_output_error
from rotorid.fitting.time.prediction_error import fit_prediction_error
from rotorid.typing import FloatArray

Method: TypeAlias = Callable[[Any, Sequence[FloatArray], LevenbergMarquardt | None], Fit]
"""From a problem, starts and a local solver to the end of the fit."""


def fit(problem: Problem, *, starts: Sequence[FloatArray] = (), solver: LevenbergMarquardt | None = None) -> Fit:
    """Fit the free parameters of a problem by the method that belongs to it.

    Responses are fitted in CIFER's cost (:func:`rotorid.fitting.frequency.fit.fit_frequency`), records by output error
    or prediction error (:mod:`rotorid.fitting.time`), motors by :func:`rotorid.fitting.motors.fit.fit_motors`. Any
    other problem is minimized from its starts; the best of them counts.

    Parameters
    ----------
    problem
        What is fitted to what.
    starts
        Where to begin, best first; by default where the method or the problem says. Motors begin where their excitation
        says, and take none; a nonlinear model takes one.
    solver
        Local solver; by default that of the method.

    Returns
    -------
    Fit
        Its ``problem`` and ``solution`` are what :func:`rotorid.uncertainty.cramer_rao.bounds` takes.

    Raises
    ------
    InsufficientDataError
        The data are too few, or the model has no value at any start.
    UsageError
        More starts came than the method takes.

    Examples
    --------
    >>> import numpy as np
    >>> from rotorid.fitting.time.output_error import TimeData, TimeProblem
    >>> from rotorid.models.library import response_model
    >>> lag = response_model("response.first_order", [("r_setpoint", "r")])
    >>> step = TimeData(name="step", inputs=np.ones((1, 100)), outputs=1.0 - np.exp(-np.arange(100) / 10.0)[None],
    ...                 sample_rate_hz=20.0, before=np.zeros(1))
    >>> ended = fit(TimeProblem(structure=lag, parameters=lag.parameters, records=(step,), unknowns=()))
    >>> round(ended.parameters["T_r"].value, 3)
    0.5
    """
    return _METHODS.get(problem.method, _least_squares)(problem, starts, solver)


def _frequency(problem: Any, starts: Sequence[FloatArray], solver: LevenbergMarquardt | None) -> Fit:
    return Fit(problem=problem, solution=fit_frequency(problem, starts=starts, solver=solver))


def _output_error(problem: Any, starts: Sequence[FloatArray], solver: LevenbergMarquardt | None) -> Fit:
    return fit_output_error(problem, starts=starts, solver=solver)


def _prediction_error(problem: Any, starts: Sequence[FloatArray], solver: LevenbergMarquardt | None) -> Fit:
    return fit_prediction_error(problem, starts=starts, solver=solver)


def _nonlinear(problem: NonlinearProblem, starts: Sequence[FloatArray], solver: LevenbergMarquardt | None) -> Fit:
    if len(starts) > 1:
        raise UsageError(f"{len(starts)} start values for a nonlinear model", needed="one", remedy="search first")
    return fit_nonlinear(problem, solver=solver, start=starts[0] if starts else None)


def _motors(problem: MotorProblem, starts: Sequence[FloatArray], solver: LevenbergMarquardt | None) -> Fit:
    if starts:
        raise UsageError(
            f"{len(starts)} start values for the motor model",
            remedy="leave them out; the fit starts from the excitation",
        )
    return fit_motors(problem) if solver is None else fit_motors(problem, solver=solver)


def _least_squares(problem: Problem, starts: Sequence[FloatArray], solver: LevenbergMarquardt | None) -> Fit:
    begin = starts or [problem.start]
    if solver is None:
        ends = [problem.polish(start) for start in begin]
    else:
        ends = [solver.minimize(problem.residuals, start, *problem.box) for start in begin]
    return Fit(problem=problem, solution=best_of(ends, name=problem.name))


_METHODS: Mapping[str, Method] = {
    "frequency": _frequency,
    "motors": _motors,
    "nonlinear": _nonlinear,
    "output_error": _output_error,
    "prediction_error": _prediction_error,
}
"""By the ``method`` that a problem names."""
