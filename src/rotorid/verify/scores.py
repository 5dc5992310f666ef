"""Numbers that say how well a prediction follows a measurement."""

from __future__ import annotations

import numpy as np

from rotorid.typing import FloatArray

GOOD_TIC = 0.25
GOOD_FIT_PERCENT = 50.0
"""An error half as large as the motion: for signals of one size the same as a Theil coefficient of 0.25."""

GUIDELINES = 2


def nrmse_fit_percent(measured: FloatArray, predicted: FloatArray) -> float:
    r"""Fit percent, :math:`100 (1 - ||y - \hat y|| / ||y - \bar y||)`.

    100 is perfect, 0 no better than the mean, negative worse than it.

    Examples
    --------
    >>> nrmse_fit_percent(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0]))
    100.0
    """
    spread = float(np.linalg.norm(measured - measured.mean()))
    miss = float(np.linalg.norm(measured - predicted))
    return 100.0 * (1.0 - miss / spread) if spread > 0.0 else (100.0 if miss == 0.0 else -np.inf)


def theil_inequality(measured: FloatArray, predicted: FloatArray) -> float:
    r"""Theil inequality coefficient, :math:`\mathrm{rms}(y - \hat y) / (\mathrm{rms}\,y + \mathrm{rms}\,\hat y)`.

    0 is perfect, 1 hopeless; up to 0.25 to 0.30 is good.

    Examples
    --------
    >>> theil_inequality(np.array([1.0, -1.0]), np.array([0.0, 0.0]))
    1.0
    """
    total = rms(measured) + rms(predicted)
    return rms(measured - predicted) / total if total > 0.0 else 0.0


def guidelines_met(tic: float, fit_percent: float) -> int:
    """How many of the two guidelines a prediction meets: a Theil coefficient up to 0.25, a fit of 50 % and more.

    One alone can flatter: the Theil coefficient forgives a prediction that is too large, because its own size stands in
    the denominator, and the fit forgives one that is too small. A number that is not finite meets nothing.

    Examples
    --------
    >>> guidelines_met(0.1, 80.0), guidelines_met(0.23, 40.0), guidelines_met(0.4, 10.0)
    (2, 1, 0)
    """
    return int(tic <= GOOD_TIC) + int(fit_percent >= GOOD_FIT_PERCENT)


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
