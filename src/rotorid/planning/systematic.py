r"""What an identification will state: random and model error of a planned flight, from rehearsals of it.

An identification takes its residuals as random errors, a smooth error of the structure, and errors of known size:
clocks, sensors, a slope of thrust that changes, lean (:mod:`rotorid.uncertainty.model_error`). All of them depend on
the flight. So the plan is rehearsed: it is flown in the simulator, and the logs are measured as any other. At the
parameters that are expected, the functions of the identification say what they would state, in the mean over the
rehearsals. Where there are none, they are asked at the expected response, with errors that gusts and noise alone make.
Of a structure that fits, the model error is then the floor and the clocks.

A previous result of the vehicle knows how far its structure was from that vehicle: no model error is smaller.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.fitting.frequency.fit import refine
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.frequency.screening import without_structural_zeros
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.problem import ResidualErrors
from rotorid.planning.expected import ExpectedFit
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, bounds

_DRAWS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownErrors(Immutable):
    """Errors that are known before a flight.

    Parameters
    ----------
    rehearsals
        Problems that an identification poses of logs of rehearsals.
    of_plan
        Whether that was the plan itself; of another length, only errors of known size are alike.
    sizes
        Relative model error of responses ``output/input`` in previous results of the vehicle.
    """

    rehearsals: tuple[FrequencyProblem, ...] = ()
    of_plan: bool = True
    sizes: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(rehearsals=tuple(self.rehearsals), sizes=self.sizes)


def stated_bounds(ended: ExpectedFit, scattering: ResidualErrors, known: KnownErrors) -> Bounds:
    """The bounds that an identification will state, in the mean.

    Parameters
    ----------
    ended
        The fit to the expected response.
    scattering
        Errors of gusts and noise alone, see :func:`rotorid.planning.prediction.scattering_errors`.
    known
        What rehearsals and previous results know.
    """
    quiet = bounds(ended.problem, ended.solution, weights=ended.weights, least_model_errors=known.sizes)
    found = _rehearsed(ended, known) if known.of_plan else []
    if not found:
        drawn = _drawn(ended, scattering, known)
        return _averaged(quiet, drawn).with_errors(
            quiet.random, mean_covariance([each.covariance - each.random for each in drawn])
        )
    seen = replace(
        quiet,
        cramer_rao=np.mean([each.cramer_rao for each in found], axis=0),
        insensitivity=np.mean([each.insensitivity for each in found], axis=0),
    )
    return _averaged(seen, found).with_errors(
        mean_covariance([each.random for each in found]),
        mean_covariance([each.covariance - each.random for each in found]),
    )


def _averaged(quiet: Bounds, found: Sequence[Bounds]) -> Bounds:
    """Bounds with the geometric means of the sizes of model errors."""
    sizes = [each.model_error.deviations for each in found if each.model_error is not None]
    if quiet.model_error is None or not sizes:
        return quiet
    mean = {
        name: float(np.exp(np.mean([np.log(each[name]) for each in sizes if name in each] or [np.log(size)])))
        for name, size in quiet.model_error.deviations.items()
    }
    return replace(quiet, model_error=replace(quiet.model_error, deviations=mean))


def mean_covariance(covariances: Sequence[FloatArray]) -> FloatArray:
    """The mean with variances of the geometric mean, so that one flight that is ten times worse does not rule."""
    mean = np.mean(covariances, axis=0)
    variances = np.maximum([np.diag(each) for each in covariances], np.finfo(np.float64).tiny)
    root = np.sqrt(np.exp(np.log(variances).mean(axis=0)) / np.maximum(np.diag(mean), np.finfo(np.float64).tiny))
    return np.asarray(root[:, None] * mean * root)


def _rehearsed(ended: ExpectedFit, known: KnownErrors) -> list[Bounds]:
    """Bounds of a fit to each rehearsal of the same responses, from the expected parameters."""
    found, refused = [], None
    for rehearsal in known.rehearsals:
        own, omega = ended.problem, rehearsal.data.omega_rad_s
        band = own.data.omega_rad_s[own.used.any(axis=(0, 1))]
        if (rehearsal.data.inputs, rehearsal.data.outputs) != (own.data.inputs, own.data.outputs):
            continue
        # The expected fit knows which responses take part, and whether it begins above the modes of speed.
        inside = own.used.any(axis=-1, keepdims=True) & (omega >= band[0]) & (omega <= band[-1])
        posed = replace(rehearsal.with_parameters(own.parameters), used=rehearsal.used & inside)
        posed = without_structural_zeros(posed)[0]
        solution = LevenbergMarquardt().minimize(posed.residuals, ended.solution.theta, *posed.box)
        if ended.weights == "covariance":
            solution = refine(posed, solution)
        try:
            found.append(bounds(posed, solution, weights=ended.weights, least_model_errors=known.sizes))
        except InsufficientDataError as error:
            refused = error
    if refused is not None and not found:
        raise refused
    return found


def _drawn(ended: ExpectedFit, scattering: ResidualErrors, known: KnownErrors) -> list[Bounds]:
    """Bounds of the expected fit with errors that were drawn, and with those of known size of the rehearsals."""
    values, vectors = np.linalg.eigh(scattering.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    rng, solution, found = np.random.default_rng(0), ended.solution, []
    for draw, error in enumerate((root @ rng.standard_normal((values.size, _DRAWS))).T):
        problem = _noisy(ended.problem, error)
        if known.rehearsals:
            like = known.rehearsals[draw % len(known.rehearsals)].data
            problem = replace(problem, data=with_systematic_errors(problem.data, like))
        moved = replace(solution, residual=solution.residual + error)
        found.append(bounds(problem, moved, weights=ended.weights, least_model_errors=known.sizes))
    return found


def _noisy(problem: FrequencyProblem, error: FloatArray) -> FrequencyProblem:
    """The same problem with errors in its residuals, those of magnitudes first."""
    magnitude, phase = np.split(error / np.concatenate(problem.point_scales), 2)
    values = problem.data.values.copy()
    # Residuals are those of the model over the data.
    values[problem.used] *= np.exp(-(magnitude + 1j * phase))
    return replace(problem, data=replace(problem.data, values=values))


def with_systematic_errors(response: FrequencyResponse, measured: FrequencyResponse) -> FrequencyResponse:
    """A response with the errors of known size of a measured one, which may have other frequencies.

    Where that lacks an input or output of the other, nothing is known.
    """
    if not (set(response.inputs) <= set(measured.inputs) and set(response.outputs) <= set(measured.outputs)):
        return response
    rows = [measured.outputs.index(name) for name in response.outputs]
    columns = [measured.inputs.index(name) for name in response.inputs]
    asked, there = np.log(response.omega_rad_s), np.log(measured.omega_rad_s)

    def moved(name: str) -> Any:
        values = getattr(measured, name)
        if values is None:
            return None
        own = values[:, rows][:, :, columns] if name == "sensor_shapes" else values[..., columns, :]
        return np.apply_along_axis(lambda row: np.interp(asked, there, row), -1, own)

    sensors = measured.sensor_errors
    return replace(
        response,
        sample_rate_hz=measured.sample_rate_hz,
        clock_error_s=measured.clock_error_s,
        sensor_errors=None if sensors is None else sensors[rows],
        **{name: moved(name) for name in ("slope_changes", "lean_errors", "unchecked_errors", "sensor_shapes")},
    )
