"""Bounds of parameters that were fitted in time: by what is left of outputs, or of equations of motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError
from rotorid.fit.structure_equation_error import EquationErrorFit
from rotorid.fit.time_problem import Part
from rotorid.models.parameter import ParameterSet
from rotorid.uncertainty.bounds import Bounds
from rotorid.uncertainty.colored import colored_covariance


def time_bounds(parts: Sequence[Part], parameters: ParameterSet) -> tuple[Bounds, int]:
    r"""Bounds from the Fisher matrix :math:`F = \sum_i S_i^T S_i`, and the memory of the residuals.

    Cramér–Rao and insensitivity are CIFER's, :math:`2 \sqrt{(F^{-1})_{ii}}` and :math:`1 / \sqrt{F_{ii}}`, so that the
    same guidelines apply. Columns of the slopes beyond the free parameters are those of a noise model, which is
    estimated with them. The covariance is corrected for the color of the residuals; ``inflation`` is how much
    larger than for white ones the standard deviations are, in the geometric mean.

    Raises
    ------
    InsufficientDataError
        A parameter has no effect, or several cannot be told apart at all.
    """
    free = parameters.free
    count = len(free)
    slopes = np.concatenate([part.slopes.reshape(-1, part.slopes.shape[2]) for part in parts])
    fisher = slopes.T @ slopes
    silent = [name for name, size in zip(free, fisher.diagonal()[:count], strict=True) if size == 0.0]
    if silent:
        raise _unseen(silent)
    try:
        colored = colored_covariance(parts)
    except np.linalg.LinAlgError as error:
        raise _unseen(free) from error
    length = np.sqrt(fisher.diagonal())
    inverse = np.linalg.inv(fisher / np.outer(length, length)).diagonal() / fisher.diagonal()
    corrected, white = colored.corrected[:count, :count], colored.white[:count, :count]
    ratio = np.log(corrected.diagonal() / white.diagonal())
    bounds = Bounds(
        names=free,
        cramer_rao=2.0 * np.sqrt(inverse[:count]),
        insensitivity=1.0 / length[:count],
        covariance=corrected,
        inflation=math.exp(0.5 * float(np.mean(ratio))),
    )
    return bounds, colored.memory


def equation_bounds(fit: EquationErrorFit) -> Bounds:
    r"""Bounds of an equation-error fit, from :math:`F = J^T J` of its weighted equations.

    Percents are formed as by :func:`time_bounds`. The covariance is that of the fit, for residuals of any color, and
    ``inflation`` compares it with white ones. None of them knows the bias by noise in measured states.
    """
    fisher = fit.solution.jacobian.T @ fit.solution.jacobian
    length = np.sqrt(fisher.diagonal())
    white = np.sqrt(np.linalg.inv(fisher / np.outer(length, length)).diagonal()) / length
    ratio = np.log(fit.covariance.diagonal() / white**2)
    return Bounds(
        names=fit.names,
        cramer_rao=2.0 * white,
        insensitivity=1.0 / length,
        covariance=fit.covariance,
        inflation=math.exp(0.5 * float(np.mean(ratio))),
    )


def _unseen(names: Sequence[str]) -> InsufficientDataError:
    message = f"The records do not determine {', '.join(names)}."
    return InsufficientDataError(
        message,
        needed="parameters that the data can see",
        remedy="fix some with --fix NAME=VALUE, or take a smaller model",
        findings=[Finding(kind="not_identifiable", severity="error", where=name, message=message) for name in names],
    )
