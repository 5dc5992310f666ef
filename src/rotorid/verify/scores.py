"""Numbers that say how well a prediction follows a measurement."""

from __future__ import annotations

import numpy as np

from rotorid.typing import FloatArray

GOOD_TIC = 0.25


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


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
