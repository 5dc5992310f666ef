"""How far estimates of the same plan will scatter from flight to flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.design.fisher import open_loop_noise
from rotorid.design.loop import LoopModel
from rotorid.design.planned import Planned
from rotorid.fit.error_covariance import ResidualErrors, residual_errors
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import Weights


def scattering_errors(problem: FrequencyProblem, loop: LoopModel, planned: Planned) -> ResidualErrors:
    """Errors of the residuals by what gusts and noise alone do to the response, leakage left out.

    Parameters
    ----------
    problem
        The expected response, and its points that are fitted.
    loop, planned
        What will fly, and what.
    """
    data = problem.data
    assert data.disturbance is not None
    noise = np.moveaxis(open_loop_noise(loop, planned, data.omega_rad_s, data.inputs, data.outputs), 0, -1)
    level = np.sqrt(np.einsum("yyf->yf", noise).real)
    factor = (level / np.sqrt(data.disturbance.level))[:, None, :]
    alone = replace(
        data,
        covariance=data.covariance * factor[..., :, None] * factor[..., None, :],
        output_correlation=np.stack([noise / level[:, None] / level[None, :]] * len(data.inputs)),
    )
    return residual_errors(alone, problem.used, problem.point_scales)


def expected_scatter(
    problem: FrequencyProblem, solution: Solution, weights: Weights, scattering: ResidualErrors
) -> FloatArray:
    r"""Standard deviations of the estimates over many flights of one plan, shape ``(p,)``.

    What an identification states holds what windows leave of leakage, too, for in one flight nothing tells it from
    noise. Of one plan it is the same in every flight: it moves the estimates, and does not scatter them. With the
    errors e that gusts and noise alone make, and the weights of the fit,

    .. math:: \mathrm{Cov}\,\theta = K \, \mathrm{Cov}(e) \, K^T, \qquad
        \delta\theta = -K e

    Parameters
    ----------
    problem, solution, weights
        The fit to the expected response.
    scattering
        Of :func:`scattering_errors`.
    """
    if weights == "cifer":
        gain = _inverse(solution.jacobian)
    else:
        stated = problem.errors_about(solution.theta)
        _, slopes = problem.residuals(solution.theta)
        gain = _inverse(stated.whitened(slopes)) @ stated.whitened(np.eye(len(slopes)))
    return np.asarray(np.sqrt(np.einsum("pn,nm,pm->p", gain, scattering.covariance, gain, optimize=True)))


def _inverse(jacobian: FloatArray) -> FloatArray:
    """What takes residuals to parameters, shape ``(p, n)``; columns of unit length make parameters comparable."""
    length = np.linalg.norm(jacobian, axis=0)
    return np.asarray(np.linalg.pinv(jacobian / length) / length[:, None])
