r"""Tests of ties: what the data say of a relation that was assumed between parameters.

A tie :math:`x = f(\theta)` makes numbers that were not measured out of some that were: inertia from a damping and the
drag of rotors, one inflow coefficient from two dampings. At the solution the tied parameter is released, and one step
of the linearized fit with whitened residuals r and slopes J, its own among them, says where the data would have it:

.. math:: \begin{pmatrix} \Delta\theta \\ \Delta x \end{pmatrix} = -J^{+} r, \qquad
          \delta = \Delta x - \nabla f \cdot \Delta\theta

The discrepancy :math:`\delta` is zero where the tie holds. Its variance is that of random and of model errors, carried
through the same step: a score test (Rao, *Large sample tests of statistical hypotheses concerning several parameters*,
Proceedings of the Cambridge Philosophical Society 44, 1948). Where the tie alone determines another parameter, nothing
is left to test it by.

The step is of first order: a tie that it doubts is judged by a fit without it. Where two ties meet in one place, either
may be wrong; ties of the main responses, thrust times lever over inertia, are what the others are judged by.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.fitting.frequency.fit import fit_frequency, refine
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import Solution
from rotorid.models.parameter import ParameterSet
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, Weights, bounds

CONTRADICTED = 3.0
"""Standard deviations from which the data contradict a tie: by chance, one of twelve ties in thirty fits."""

_SINGULAR = 1e-6
"""Singular value over the largest, of slopes of unit length, below which a parameter is known by the tie alone."""

_NO_EFFECT = 1e-12

_DOUBTED = 1.5
"""Standard deviations of a discrepancy from which the fit is repeated without the tie."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TieTest(Immutable):
    """A tie, and what the data say of it.

    Parameters
    ----------
    name
        The tied parameter.
    value, measured
        By its tie, and by the data without it.
    discrepancy, std
        How far the data have it from what the tie gives without them, with random and model errors.
    released
        How far the free parameters move where the tie is given up, shape ``(p,)``.
    implied
        How far those that no main response knows move where the data are believed and the tie kept, shape ``(p,)``.
    """

    name: str
    value: float
    measured: float
    discrepancy: float
    std: float
    released: FloatArray
    implied: FloatArray

    def __post_init__(self) -> None:
        self._set(
            released=read_only(self.released, np.float64, ndim=1), implied=read_only(self.implied, np.float64, ndim=1)
        )

    @property
    def distance(self) -> float:
        """Of the data from the tie, in standard deviations."""
        return abs(self.discrepancy) / self.std

    @property
    def contradicted(self) -> bool:
        """Whether the data contradict the tie."""
        return self.distance > CONTRADICTED


def tie_tests(problem: FrequencyProblem, solution: Solution, *, weights: Weights) -> tuple[TieTest, ...]:
    """Tests of the ties of a problem that its data can test.

    Parameters
    ----------
    problem
        With ties between its parameters.
    solution
        Where the fit ended, with ``weights``.

    Returns
    -------
    tuple of TieTest
        Without ties of main responses (``essential``), and those that alone determine another parameter.
    """
    parameters = problem.parameters.unpack(solution.theta)
    found = []
    for name in _tied(parameters):
        without = _Released.of(problem, solution, name, weights)
        test = None if without is None else without.test(solution.theta)
        if without is not None and test is not None and test.distance > _DOUBTED:
            # Far from a tie that does not hold, slopes and model error of the tied fit say little.
            test = without.fitted().test(solution.theta) or test
        if test is not None:
            found.append(test)
    return tuple(found)


SENSOR_DELAY_S = 0.005
"""Delay of an accelerometer behind a gyro by their filters, as a standard deviation: that of 30 Hz is 5 ms."""


def with_dropped_delays(limits: Bounds, problem: FrequencyProblem, solution: Solution, *, weights: Weights) -> Bounds:
    r"""Bounds that contain what sensor delays move that were dropped, as if there were none.

    The data hardly show such a delay, but other parameters follow it: the place of an accelerometer takes up the phase
    of its filter. Of a delay that the data have at :math:`\tau \pm \sigma`, and sensors usually at zero
    :math:`\pm \sigma_0`, the mean square is :math:`v + (\tau v / \sigma^2)^2` with
    :math:`1/v = 1/\sigma^2 + 1/\sigma_0^2`.
    """
    parameters = problem.parameters.unpack(solution.theta)
    delays = {name for entry in problem.structure.output_delays for name in entry.names}
    covariance = limits.covariance.copy()
    for parameter in parameters:
        if parameter.status != "dropped" or parameter.name not in delays:
            continue
        without = _Released.of(problem, solution, parameter.name, weights)
        if without is None or (test := without.test(solution.theta)) is None:
            continue
        variance = 1.0 / (1.0 / test.std**2 + 1.0 / SENSOR_DELAY_S**2)
        size = variance + (test.measured * variance / test.std**2) ** 2
        moved = without.followed()
        covariance += size * np.outer(moved, moved)
    return replace(limits, covariance=covariance)


def with_ties(limits: Bounds, tests: Sequence[TieTest]) -> Bounds:
    """Bounds that contain what the data say against ties: values without the tie, and those that the tie then asks."""
    covariance = limits.covariance.copy()
    found = [test for test in tests if test.contradicted]
    for test in found:
        covariance += np.outer(test.released, test.released) + np.outer(test.implied, test.implied)
    return replace(limits, covariance=covariance, implied={test.name: test.implied for test in found})


def _tied(parameters: ParameterSet) -> Iterator[str]:
    free = set(parameters.free)
    for parameter in parameters:
        if parameter.tied is not None and not parameter.essential and sources(parameters, parameter.name) & free:
            yield parameter.name


def sources(parameters: ParameterSet, name: str) -> set[str]:
    """Parameters that a tie is made of, those of its own ties included."""
    tied = parameters[name].tied
    if tied is None:
        return {name}
    return set().union(*(sources(parameters, one) for one in tied.names if one in parameters.names))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Released:
    """A fit with one tie given up: not moved yet, or at its own solution."""

    problem: FrequencyProblem
    parameters: ParameterSet
    name: str
    weights: Weights
    solution: Solution
    settled: bool = False

    @classmethod
    def of(cls, problem: FrequencyProblem, solution: Solution, name: str, weights: Weights) -> _Released | None:
        tied = problem.parameters.unpack(solution.theta)
        free = tied.free_again(name)
        without, theta = problem.with_parameters(free), free.pack()
        residual, slopes = without.residuals(theta)
        if weights == "covariance":
            errors = without.errors_about(theta)
            residual, slopes = errors.whitened(residual), errors.whitened(slopes)
        length = np.linalg.norm(slopes, axis=0)
        if not np.all(length > _NO_EFFECT * length.max(initial=0.0)):
            return None
        singular = np.linalg.svd(slopes / length, compute_uv=False)
        if singular[-1] <= _SINGULAR * singular[0]:
            return None
        here = replace(solution, theta=theta, residual=residual, jacobian=slopes, at_bound=(False,) * theta.size)
        return cls(problem=without, parameters=tied, name=name, weights=weights, solution=here)

    def fitted(self) -> _Released:
        """The same at its solution, from starts of its own: a tie that does not hold may lead far off."""
        again = fit_frequency(self.problem)
        if self.weights == "covariance":
            again = refine(self.problem, again)
        return replace(self, solution=again, settled=True)

    def followed(self) -> FloatArray:
        """How far the other free parameters move for a change of one of what was released, shape ``(p,)``."""
        place = self.problem.parameters.free.index(self.name)
        own, others = self.solution.jacobian[:, place], np.delete(self.solution.jacobian, place, axis=1)
        length = np.linalg.norm(others, axis=0)
        return np.asarray(-np.linalg.pinv(others / length) @ own / length)

    def test(self, tied: FloatArray) -> TieTest | None:
        """What this fit says of the tie, beside the free parameters with it."""
        here, free = self.solution, self.problem.parameters.free
        length = np.linalg.norm(here.jacobian, axis=0)
        step = -np.linalg.pinv(here.jacobian / length) @ here.residual / length
        place = free.index(self.name)
        others = [row for row in range(len(free)) if row != place]
        moved = here.theta[others] - tied if self.settled else step[others]
        values = self.parameters.unpack(tied + moved) if self.settled else self.parameters
        row = values.names.index(self.name)
        slope = values.directions[row]
        by_tie = values.values[self.name] + (0.0 if self.settled else float(slope @ moved))
        measured = float(here.theta[place]) + (0.0 if self.settled else float(step[place]))
        contrast = np.zeros(len(free))
        contrast[place], contrast[others] = 1.0, -slope
        # What the tie alone misses is no model error: that is judged without it.
        covariance = bounds(self.problem, here, weights=self.weights).covariance
        std = float(np.sqrt(contrast @ covariance @ contrast))
        if not std > 0.0:
            return None
        return TieTest(
            name=self.name,
            value=self.parameters.values[self.name],
            measured=measured,
            discrepancy=measured - by_tie,
            std=std,
            released=moved,
            implied=self._implied(measured - self.parameters.values[self.name]),
        )

    def _implied(self, change: float) -> FloatArray:
        """Changes that give the tie another value, by parameters of no main response, each in its own proportion."""
        known = self.parameters
        main = set().union(*(sources(known, one.name) for one in known if one.tied is not None and one.essential))
        own = np.array([name in sources(known, self.name) - main for name in known.free])
        slope = np.where(own, known.directions[known.names.index(self.name)], 0.0)
        scale = np.array([known.values[name] for name in known.free]) ** 2
        reach = float(slope @ (scale * slope))
        return scale * slope / reach * change if reach > 0.0 else np.zeros(own.size)
