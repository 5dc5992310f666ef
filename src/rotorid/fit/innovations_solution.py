"""What a prediction-error fit answers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.fit.innovations import InnovationsProblem, Settled
from rotorid.fit.solution import Minimum, Solution
from rotorid.models.parameter import ParameterSet
from rotorid.typing import ComplexArray, FloatArray

_WHITE_S = 0.5
_CHANCE_5_PERCENT = 1.959964
_FLAT = 1e-9


class Whiteness(NamedTuple):
    """What is left in the innovations of one output: white ones have nothing.

    Parameters
    ----------
    largest
        Largest magnitude of the autocorrelation over half a second.
    outside
        Share of those lags beyond the limits of 5 % chance; about 0.05 of white innovations.
    lags
        How many lags there are.
    """

    largest: float
    outside: float
    lags: int


class NoiseFound(NamedTuple):
    """The noise that was identified, in SI units.

    Parameters
    ----------
    gust_correlation_s
        Correlation time, ``None`` without gusts.
    gusts
        Standard deviation of the gust in each disturbed equation.
    jolts
        Root of the two-sided spectral density of the jolts in each.
    sensors
        Standard deviation of each sensor. One that the predictor does not listen to only has a least value.
    """

    gust_correlation_s: float | None
    gusts: Mapping[str, float]
    jolts: Mapping[str, float]
    sensors: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionErrorFit(Immutable):
    r"""End of a prediction-error fit.

    Parameters
    ----------
    problem
        What was fitted.
    solution
        Parameters of the model, then those of the noise. Residual and Jacobian are condensed, see
        :meth:`rotorid.fit.innovations.InnovationsProblem.residuals`.
    gain
        K, states of the model and of the gusts against outputs, shape ``(x, y)``; of the first record's rate.
    noise_covariance
        :math:`\hat R` of the innovations, shape ``(y, y)``.
    predictor_poles
        Of the predictor, inside the unit circle, shape ``(x,)``; of the first record's rate.
    information
        Fisher's information of the parameters of model and noise at the identified noise, shape ``(p, p)``.
    whiteness
        Output name to what is left in its innovations.
    log_likelihood
        Of the innovations, were they Gaussian.
    noise
        What disturbs the vehicle and its sensors.
    """

    problem: InnovationsProblem
    solution: Solution
    gain: FloatArray
    noise_covariance: FloatArray
    predictor_poles: ComplexArray
    information: FloatArray
    whiteness: Mapping[str, Whiteness]
    log_likelihood: float
    noise: NoiseFound

    def __post_init__(self) -> None:
        self._set(
            gain=read_only(self.gain, np.float64, ndim=2),
            noise_covariance=read_only(self.noise_covariance, np.float64, ndim=2),
            predictor_poles=read_only(self.predictor_poles, np.complex128, ndim=1),
            information=read_only(self.information, np.float64, ndim=2),
            whiteness=self.whiteness,
        )

    @property
    def parameters(self) -> ParameterSet:
        """The identified values of the model."""
        return self.problem.parameters.unpack(self.problem.split(self.solution.theta)[0])

    @cached_property
    def covariance(self) -> FloatArray:
        r"""Fisher's covariance of the free parameters of the model, the noise estimated with them, ``(p, p)``.

        It holds for white innovations. What color is left is told by :attr:`whiteness`, and corrected for by
        :func:`rotorid.uncertainty.colored.colored_covariance` of :meth:`InnovationsProblem.parts`.
        """
        count = len(self.problem.parameters.free)
        lower, upper = self.problem.box
        # A noise on its bound has no effect any more, and none on what is known of the model.
        inside = (self.solution.theta > lower) & (self.solution.theta < upper)
        kept = inside | (np.arange(inside.size) < count)
        information = self.information[np.ix_(kept, kept)]
        size = np.sqrt(np.where(information.diagonal() > 0.0, information.diagonal(), 1.0))
        inverse = np.linalg.pinv(information / np.outer(size, size), rcond=_FLAT, hermitian=True)
        return np.asarray((inverse / np.outer(size, size))[:count, :count])

    @property
    def std(self) -> Mapping[str, float]:
        """One standard deviation of each free parameter, in its unit."""
        return dict(zip(self.problem.parameters.free, np.sqrt(self.covariance.diagonal()).tolist(), strict=True))

    @property
    def others(self) -> tuple[Minimum, ...]:
        """Other minima that the search met, best first."""
        return self.solution.others


def answer(problem: InnovationsProblem, solution: Solution) -> PredictionErrorFit:
    """A solution with all that follows from it."""
    settled = problem.settled(solution.theta)
    steady, covariance = settled.followed[0].steady, settled.covariance
    # The condensed Jacobian carries the size of the innovations; at their own covariance it is one.
    count = problem.samples * len(problem.structure.outputs)
    information = solution.jacobian.T @ solution.jacobian * (count / solution.cost)
    return PredictionErrorFit(
        problem=problem,
        solution=solution,
        gain=steady.gain,
        noise_covariance=covariance,
        predictor_poles=np.linalg.eigvals(steady.closed).astype(np.complex128),
        information=information,
        whiteness=_whiteness(problem, settled),
        log_likelihood=-0.5 * problem.samples * _entropy(covariance),
        noise=_noise(problem, solution.theta, settled),
    )


def _entropy(covariance: FloatArray) -> float:
    return float(np.linalg.slogdet(covariance)[1]) + len(covariance) * (1.0 + math.log(2.0 * math.pi))


def _whiteness(problem: InnovationsProblem, settled: Settled) -> dict[str, Whiteness]:
    lags = max(1, round(_WHITE_S * min(record.sample_rate_hz for record in problem.records)))
    found = {}
    for row, name in enumerate(problem.structure.outputs):
        parts = [run.values[:, row] for run in settled.runs]
        power = sum(float(one @ one) for one in parts)
        products = [sum(float(one[lag:] @ one[:-lag]) for one in parts) / power for lag in range(1, lags + 1)]
        limit = _CHANCE_5_PERCENT / math.sqrt(problem.samples)
        magnitude = np.abs(products)
        found[name] = Whiteness(float(magnitude.max()), float(np.mean(magnitude > limit)), lags)
    return found


def _noise(problem: InnovationsProblem, theta: FloatArray, settled: Settled) -> NoiseFound:
    model = problem.noise_model
    levels = model.at(problem.split(theta)[1])
    # The predictor knows ratios only; the innovations tell the size of all noise.
    size = math.sqrt(
        np.trace(np.linalg.solve(settled.followed[0].steady.innovation, settled.covariance)) / len(settled.covariance)
    )
    states = [problem.structure.states[row] for row in model.disturbed]
    gusts = (np.sqrt(levels.gusts.diagonal()) * size).tolist()
    return NoiseFound(
        gust_correlation_s=levels.correlation_s if model.gusts else None,
        gusts=dict(zip(states, gusts, strict=True)) if model.gusts else {},
        jolts=dict(zip(states, (np.sqrt(levels.jolts) * size).tolist(), strict=True)) if model.jolts else {},
        sensors=dict(zip(problem.structure.outputs, (np.sqrt(levels.sensors) * size).tolist(), strict=True)),
    )
