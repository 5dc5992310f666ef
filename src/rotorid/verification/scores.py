"""Scores of a prediction against a measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from rotorid.typing import FloatArray

GOOD_TIC = 0.25
GOOD_FIT_PERCENT = 50.0
"""An error half as large as the motion: for signals of one size the same as a Theil coefficient of 0.25."""

GUIDELINES = 2
"""Guidelines that a prediction can meet."""

FOOT_M = 0.3048
CIFER_UNITS: Mapping[str, float] = MappingProxyType(
    {
        "rad": 180.0 / math.pi,
        "rad/s": 180.0 / math.pi,
        "rad/s^2": 180.0 / math.pi,
        "m": 1.0 / FOOT_M,
        "m/s": 1.0 / FOOT_M,
        "m/s^2": 1.0 / FOOT_M,
    }
)
"""From SI to the units in which J_rms adds up: degrees and feet. A unit that is not listed counts as it is."""

JRMS_GUIDELINE = (1.0, 2.0)
"""Guideline of J_rms, before it is scaled by the size of the vehicle."""


@np.errstate(over="ignore", invalid="ignore")  # an unstable model may leave all numbers behind
def nrmse_fit_percent(measured: FloatArray, predicted: FloatArray) -> float:
    r"""Fit percent, :math:`100 (1 - ||y - \hat y|| / ||y - \bar y||)`.

    100 is perfect, 0 no better than the mean, negative worse than it.

    Parameters
    ----------
    measured
        Samples :math:`y`, shape ``(n,)``.
    predicted
        Samples :math:`\hat y`, of the same shape.

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

    Parameters
    ----------
    measured
        Samples :math:`y`, shape ``(n,)``.
    predicted
        Samples :math:`\hat y`, of the same shape.

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


@np.errstate(over="ignore", invalid="ignore")
def rms(values: FloatArray) -> float:
    """Root mean square.

    Parameters
    ----------
    values
        Of any shape.
    """
    return float(np.sqrt(np.mean(np.square(values))))


def j_rms(errors: FloatArray, units: Sequence[str]) -> float:
    r"""Cost of a verification in the time domain, over all outputs together.

    .. math:: J_{rms} = \sqrt{ \frac{1}{n_y n_t} \sum_{y,t} (w_y e_{y,t})^2 }

    with errors in degrees, degrees per second, feet per second and feet per second squared, all weights one. It is
    not free of dimension, so it grows with the amplitude of the maneuver and compares models, not flights.

    Parameters
    ----------
    errors
        Measured minus predicted, SI units, shape ``(y, samples)``.
    units
        SI unit of each output.

    References
    ----------
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, chapter 14: up to 1 to 2 is acceptable for
    aircraft of full scale.

    Examples
    --------
    >>> round(j_rms(np.full((1, 4), np.radians(2.0)), ["rad/s"]), 12)
    2.0
    """
    scale = np.array([CIFER_UNITS.get(unit, 1.0) for unit in units])
    return rms(scale[:, None] * errors)


def scaled_guidelines(scale: float) -> tuple[tuple[float, float], tuple[float, float]]:
    r"""Guideline of 1 to 2 for J_rms, Froude scaled: by :math:`\sqrt N`, and by N as it is found in print.

    With N the ratio of a full-scale rotor's diameter to the size of the vehicle, speeds go with the root of N. The
    S500 paper states the root and then prints 16 to 32 for its N of 16, which is N itself.

    Parameters
    ----------
    scale
        N, above zero.

    Examples
    --------
    >>> scaled_guidelines(16.0)
    ((4.0, 8.0), (16.0, 32.0))
    """
    low, high = JRMS_GUIDELINE
    return (low * math.sqrt(scale), high * math.sqrt(scale)), (low * scale, high * scale)
