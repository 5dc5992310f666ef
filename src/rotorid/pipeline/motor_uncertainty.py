"""How well a flight tells the physics of motors: random errors, and what no repetition of the flight would show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.motor_excitation import LEAST_CORRELATION
from rotorid.fit.motor_fit import MotorFit
from rotorid.models.parameter import ParameterSet
from rotorid.pipeline.motor_records import MotorData
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import Bounds
from rotorid.uncertainty.colored import colored_apart

ACCELEROMETER_BIAS_M_S2 = 0.05
"""Of a calibrated accelerometer."""

CURVE_SHARE = 0.3
"""Thrust that was not moved: its slope lies between that of a line and twice as much, that of a parabola."""

_DELAYS = ("tau_gyro", "tau_accel")
_GAINS = {"az": ("m", "c_0", "c_1", "c_2"), "p": ("I_xx",), "q": ("I_yy",), "r": ("kappa_per_I_zz",)}
_FLAT = 1e-12


def motor_bounds(fit: MotorFit) -> tuple[Bounds, int]:
    """Bounds of the parameters that did not end on a bound, and the memory of the errors.

    Raises
    ------
    InsufficientDataError
        The data do not determine all of them.
    """
    parts = fit.parts()
    slopes = np.concatenate([part.slopes[:, 0] for part in parts])
    fisher = slopes.T @ slopes
    length = np.sqrt(np.maximum(fisher.diagonal(), 1e-300))
    even = fisher / np.outer(length, length)
    weakest = np.linalg.eigh(even)
    if weakest.eigenvalues[0] <= _FLAT:
        mixed = [name for name, part in zip(fit.moving, weakest.eigenvectors[:, 0], strict=True) if abs(part) > 0.1]
        raise InsufficientDataError(
            f"the flights do not determine {' and '.join(mixed)} apart",
            needed="motion that tells them apart",
            remedy="choose a curve with fewer terms with --curve, or hold a parameter with --fix",
        )
    colored = colored_apart(parts)
    inverse = np.linalg.inv(even).diagonal() / length**2
    ratio = np.log(colored.corrected.diagonal() / colored.white.diagonal())
    bounds = Bounds(
        names=fit.moving,
        cramer_rao=2.0 * np.sqrt(inverse),
        insensitivity=1.0 / length,
        covariance=colored.corrected,
        inflation=math.exp(0.5 * float(np.mean(ratio))),
    )
    return bounds, colored.memory


def with_systematic_errors(
    bounds: Bounds, parameters: ParameterSet, fit: MotorFit, data: MotorData, *, curve_assumed: bool
) -> Bounds:
    r"""Bounds that also hold what is wrong in the same way all through a flight.

    - The accelerometer is off by up to :data:`ACCELEROMETER_BIAS_M_S2`, which thrust and inertia follow.
    - Where a known filter was put into the model, stamps and its rate are known to half a sample: delays.
    - Where thrust was not moved, its slope is a guess (:data:`CURVE_SHARE`), and inertia follows it.
    - Motors that were logged too slowly did between their samples what the log does not tell. Errors of the outputs
      pull gains toward zero by up to :math:`r^2`, errors of the motion push them away by as much: half the way from one
      regression to the other, :math:`(1/r^2 - 1)/2`, counts as one standard deviation; of lag and delays, half a step.
    """
    covariance = bounds.covariance.copy()
    shifted = _by_bias(fit)
    covariance += np.outer(shifted, shifted)
    directions: list[Mapping[str, float]] = []
    if any(record.gyro_taps.size > 1 for record in data.records):
        slowest_hz = min(record.sample_rate_hz for record in data.records)
        directions += [{name: 0.5 / slowest_hz} for name in _DELAYS]
    if curve_assumed:
        signs = {"c_0": 1.0, "c_1": 1.0, "c_2": 1.0, "I_xx": 1.0, "I_yy": 1.0, "kappa_per_I_zz": -1.0}
        values = parameters.values
        directions.append({name: CURVE_SHARE * sign * values[name] for name, sign in signs.items() if name in values})
    if data.slow:
        directions += list(_by_slow_motors(parameters, fit, data))
    for direction in directions:
        row = np.array([direction.get(name, 0.0) for name in bounds.names])
        covariance += np.outer(row, row)
    return replace(bounds, covariance=covariance)


def _by_bias(fit: MotorFit) -> FloatArray:
    """How far a bias of the accelerometer moves the parameters, shape ``(p,)``."""
    kept = np.array([name in fit.moving for name in fit.parameters.free])
    normal = np.zeros((kept.size, kept.size))
    pulled = np.zeros(kept.size)
    for place, axis, _, slopes in fit.problem.whitened(fit.solution.theta):
        normal += slopes @ slopes.T
        if axis == "az":
            pulled += slopes.sum(axis=1) * ACCELEROMETER_BIAS_M_S2 / fit.problem.filters[place][axis].scale
    moved: FloatArray = np.linalg.pinv(normal[np.ix_(kept, kept)], hermitian=True) @ pulled[kept]
    return moved


def _by_slow_motors(parameters: ParameterSet, fit: MotorFit, data: MotorData) -> Iterator[Mapping[str, float]]:
    step_s = 1.0 / min(history.sample_rate_hz for history in data.histories)
    yield from ({name: 0.5 * step_s} for name in ("T_motor", *_DELAYS))
    for axis, names in _GAINS.items():
        seen = [one[axis].correlation for one in fit.excitations if one[axis].correlation >= LEAST_CORRELATION]
        if seen:
            share = 0.5 * (1.0 / float(np.mean(seen)) ** 2 - 1.0)
            yield {name: share * parameters[name].value for name in names if name in parameters.names}
