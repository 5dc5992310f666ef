r"""Model error of ``motor.speed``: what is wrong in the same way all through a log.

Errors of a fit of speeds to outputs are small and its samples many: the covariance of colored residuals alone would
state a lag to microseconds. Its interval holds more:

- How blocks of time, motors, bands of frequency and stretches fitted alone disagree
  (:mod:`rotorid.uncertainty.time_error`).
- Gusts, which hide a part of the difference of the lags.
- Clocks: where within a sample an output or a speed belongs is known to 0.15 of it. Lag and delay are separated by no
  more, and each end of the delay has a clock of its own.
- Sensors: no speed is better than 0.5 %, of all motors alike or of one; lags and the exponent of the voltage have the
  same least error.
- A speed that is logged in steps, by a step over :math:`\sqrt{12}`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.fits.motors.errors import SENSOR_SHARE
from rotorid.fits.scatter import LogEstimate, widened
from rotorid.fitting.problem import Part
from rotorid.models.motor_speed import CURVE, DELAY, EXPONENT, LAG_DOWN, LAG_UP, LEAD
from rotorid.results.model import SimulatedRecord
from rotorid.signal.stamps import CLOCK_SAMPLES
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.time_error import with_time_error

_STEPS_SEEN = 20
"""A channel with fewer different steps does not show the size of a step."""


class Leftover(NamedTuple):
    """What a fit of motor speeds has left.

    Parameters
    ----------
    parts
        Whitened residuals and slopes at the solution.
    alone
        Each stretch fitted alone.
    simulated
        Speeds as measured and as simulated.
    step_s
        Between samples of outputs or speeds, whichever are slower.
    """

    parts: Sequence[Part]
    alone: Sequence[LogEstimate]
    simulated: Sequence[SimulatedRecord]
    step_s: float


def with_model_errors(bounds: Bounds, values: Mapping[str, float], left: Leftover) -> Bounds:
    """Bounds that also hold what is wrong in the same way all through a log.

    Parameters
    ----------
    bounds
        By colored residuals, and by stretches that disagree.
    values
        All parameters.
    """
    added = [*_by_clocks(left.step_s), *_by_sensors(values, left.simulated)]
    known = with_time_error(bounds, left.parts, alone=left.alone, alike=True, added=added)
    return widened(known, _by_gusts(bounds.names, values, left.simulated))


def _by_clocks(step_s: float) -> Iterator[Mapping[str, float]]:
    """A shift of either end of the delay; lag and delay are separated by less than a sample."""
    late_s = CLOCK_SAMPLES * step_s
    yield {DELAY: late_s, LEAD: -late_s}
    yield {LAG_UP: late_s, LAG_DOWN: late_s, DELAY: -late_s, LEAD: late_s}


def _by_sensors(values: Mapping[str, float], simulated: Sequence[SimulatedRecord]) -> Iterator[Mapping[str, float]]:
    """Scale and steps of the speeds of all motors, and of each; least errors of lags and exponent."""
    mean = values[CURVE[0]]
    share = math.hypot(SENSOR_SHARE, _step_of(simulated) / math.sqrt(12.0) / mean)
    yield {name: share * values[name] for name in CURVE}
    for name, value in values.items():
        if name.startswith("f_"):
            yield {name: share * value}
    for name in (LAG_UP, LAG_DOWN, EXPONENT):
        yield {name: SENSOR_SHARE * values.get(name, 0.0)}


def _step_of(simulated: Sequence[SimulatedRecord]) -> float:
    """The step in which speeds are logged, rad/s; zero where none is seen."""
    steps = []
    for record in simulated:
        for row in record.measured:
            apart = np.unique(np.diff(np.unique(row)).round(9))
            apart = apart[apart > 0.0]
            # Multiples of one step differ in few ways; means and floats in as many as there are samples.
            steps.append(float(apart[0]) if 0 < apart.size <= _STEPS_SEEN else 0.0)
    return float(np.median(steps)) if steps else 0.0


def _by_gusts(
    names: Sequence[str], values: Mapping[str, float], simulated: Sequence[SimulatedRecord]
) -> dict[str, float]:
    r"""What gusts may have hidden of the difference of the lags, as a standard deviation of each.

    Speeds that something else pushes are at times above the curve where the simulation is below it, and the wrong lag
    acts. With residuals :math:`\sigma_r` and distances from the curve :math:`\sigma_e` that is so for a share
    :math:`p = \arctan(\sigma_r / \sigma_e) / \pi` of the time, and the difference shrinks by :math:`1 - 2 p`. Noise of
    a sensor does not do that, and looks like gusts: the shrinkage is stated as an error, not corrected.
    """
    difference, mean = values[LAG_DOWN] - values[LAG_UP], 0.5 * (values[LAG_DOWN] + values[LAG_UP])
    residual, distance = 0.0, 0.0
    for record in simulated:
        residual += float(np.sum((record.measured - record.simulated) ** 2))
        distance += float(np.sum((mean * np.gradient(record.simulated, record.time_s, axis=1)) ** 2))
    wrong = 2.0 / np.pi * float(np.arctan2(np.sqrt(residual), np.sqrt(distance)))
    extra = 0.5 * abs(difference) * wrong / max(1.0 - wrong, 0.1)
    samples = sum(record.measured.size for record in simulated)
    # The mean speed lies off the curve by the difference of the lags: what is wrong with it moves the curve.
    moved = float(np.sqrt(2.0 / np.pi * distance / samples)) * extra / mean
    added = {LAG_UP: extra, LAG_DOWN: extra, CURVE[0]: moved}
    return {name: value for name, value in added.items() if name in names}
