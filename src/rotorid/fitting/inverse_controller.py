r"""Whether a measured response is the inverse of the controller instead of the vehicle.

In closed loop the command is :math:`u = r - C y`. Where gusts and noise move the vehicle and not the excitation
:math:`r`, the response of the rate to the command goes to :math:`-1/C`, with high coherence. Both hypotheses have a
shape: a vehicle falls with frequency, its phase from −90° down; the inverse of a PID controller is flat or rises, near
−180°.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.trust import EXCELLENT_COST
from rotorid.fitting.frequency.problem import coherence_weight, log_error, pair_costs, residual_scales
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.typing import BoolArray, ComplexArray, FloatArray

BAND_RATIO = 5.0
"""Highest over lowest frequency of a sub-band: one flight may show the vehicle below and the controller above."""

LEAST_KNOWN_RATIO, LEAST_FITTED_RATIO = 2.0, 4.0
r"""Narrower bands give no verdict. A vehicle that crosses :math:`-1/C` departs from it by at least 20 dB per decade;
over a ratio :math:`\rho` that is an rms error of :math:`20 \log_{10}(\rho) / \sqrt{12}` dB, a cost of 60 at 2. Free
gains follow a part of it.
"""

_NO_VEHICLE_COST, _AS_NEAR = 100.0, 3.0
"""Cost above which no vehicle explains a response; if the inverse controller is not much worse, it is a mixture of
both.
"""

_STEP_RATIO = 1.5
_LEAST_POINTS = 6
_OUTLIER = 2.0
_KNOWN_DELAY_S, _FITTED_DELAY_S = 0.020, 0.015
_DELAY_STEPS = 81

# Logarithm of 1/P, I/P in 1/s, D/P in s, lag F in s, delay t in s. The bounds hold what multirotors fly with: an angle
# loop adds its gain to I/P, and yaw is filtered at 2 Hz and more.
_FREE_GAIN = 12.0
_LOWER = np.array([-_FREE_GAIN, 0.0, 0.0, 0.0, -_FITTED_DELAY_S])
_UPPER = np.array([_FREE_GAIN, 30.0, 0.1, 0.2, _FITTED_DELAY_S])
_STARTS = ((0.1, 0.001, 0.001), (3.0, 0.02, 0.01), (0.1, 0.05, 0.01), (3.0, 0.001, 0.06), (15.0, 0.01, 0.02))
_VEHICLE_LOWER = np.array([-_FREE_GAIN, 0.0, 0.0, 0.0])
_VEHICLE_UPPER = np.array([_FREE_GAIN, 10.0, 0.2, 0.05])
_VEHICLE_STARTS = ((1.0, 0.02, 0.01), (0.5, 0.1, 0.005), (5.0, 0.005, 0.02))
_SOLVER = LevenbergMarquardt(iterations=60, tolerance=1e-6)


class Controls(Protocol):
    """A controller, with everything between the logged rate and the logged command."""

    def response(self, omega_rad_s: FloatArray, /) -> ComplexArray:
        """Command by the logged rate, shape ``(f,)``."""
        ...


@dataclass(frozen=True, kw_only=True)
class SubBand:
    """Verdict on one sub-band.

    Parameters
    ----------
    low_rad_s, high_rad_s
        Its first and last point.
    known_cost
        Cost against the gains in the log; infinite where they are not known.
    fitted_cost
        Cost against the best gains; infinite where the band is too narrow to fit them.
    vehicle_cost
        Cost against the best vehicle; zero where that was not asked for.
    """

    low_rad_s: float
    high_rad_s: float
    known_cost: float
    fitted_cost: float
    vehicle_cost: float = 0.0

    @property
    def cost(self) -> float:
        """The smaller of the two."""
        return min(self.known_cost, self.fitted_cost)

    @property
    def inverse(self) -> bool:
        """Whether this is the inverse of the controller, by CIFER's guideline of cost, or a mixture."""
        return self.cost < EXCELLENT_COST or self.mixed

    @property
    def mixed(self) -> bool:
        """Whether no vehicle explains it, and the inverse of the controller is about as near."""
        return (
            self.cost >= EXCELLENT_COST
            and self.vehicle_cost > _NO_VEHICLE_COST
            and self.cost < _AS_NEAR * self.vehicle_cost
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict(Immutable):
    """Where a response is the inverse of the controller.

    Parameters
    ----------
    bands
        The sub-bands that were tested, from the lowest up; they overlap.
    inverse
        Points that are the inverse of the controller, shape ``(f,)``.
    """

    bands: tuple[SubBand, ...]
    inverse: BoolArray

    def __post_init__(self) -> None:
        self._set(bands=tuple(self.bands), inverse=read_only(self.inverse, np.bool_, ndim=1))


def inverse_controller(
    omega_rad_s: FloatArray,
    values: ComplexArray,
    coherence: FloatArray,
    *,
    controllers: Sequence[Controls] = (),
    unknown_gains: bool = True,
    vehicle_from_rad_s: float = np.inf,
) -> Verdict:
    r"""Test in sub-bands whether a response is the inverse of its controller.

    Each sub-band of ratio 5 is compared, in CIFER's cost, with :math:`-e^{-j\omega t}/C` of the controllers given,
    :math:`|t| \le 20` ms, and with the best

    .. math:: -\frac{(1 + F s)\, e^{-s t}}{P + I/s + D s}, \qquad |t| \le 15 \text{ ms}, \quad
        0 \le I/P \le 30 \text{ 1/s}, \quad D/P \le 0.1 \text{ s}, \quad F \le 0.2 \text{ s}

    A cost below 50 makes it the inverse, except for points whose own cost is more than twice that. The delay stands
    for filters on the way to the log and for stamps; it may be negative.

    Where gusts and excitation move the vehicle alike, the response lies between both. Against that stands the best
    vehicle,

    .. math:: \frac{K e^{-s t}}{(s + d)(1 + T s)}, \qquad 0 \le d \le 10 \text{ 1/s}, \quad
        0 \le T \le 0.2 \text{ s}, \quad 0 \le t \le 50 \text{ ms}

    A sub-band that it explains to no better than a cost of 100, while the inverse of the controller costs less than
    three times as much, counts as the controller's too.

    Assumes a linear controller that feeds back one rate of its own axis, by positive gains. A vehicle near the limit
    of stability over more than an octave (loop gain one at −180° throughout) would be taken for its controller.

    Parameters
    ----------
    omega_rad_s
        Points that would be fitted, rising, shape ``(f,)``.
    values
        Response of the rate to the command, rad/s per unit, shape ``(f,)``. For thrust: of the *upward* acceleration,
        :math:`-a_z`.
    coherence
        Shape ``(f,)``; points below 0.6 or so are no evidence, and should be left out.
    controllers
        Gains in the log; several when it is not known which loops were closed.
    unknown_gains
        Whether gains that nobody logged are tried too. They explain an unstable airframe near its modes as well, so a
        response that there is reason to trust should not be tested with them.
    vehicle_from_rad_s
        Frequency above which the response, if it is a vehicle's, has that form, so that mixtures can be recognized.
        What is trusted should not be tested.

    Returns
    -------
    Verdict
        Costs of the sub-bands, and the points that are the controller's.

    References
    ----------
    Ljung, *System Identification*, 1999, section 13.4: direct identification in closed loop. Tischler and Remple,
    *Aircraft and Rotorcraft System Identification*, chapters 5 and 11.

    Examples
    --------
    >>> from rotorid.models.controller import RateController
    >>> omega = np.geomspace(1.0, 50.0, 60)
    >>> controller = RateController(proportional_s=0.15, integral=0.2)
    >>> trap = inverse_controller(omega, -1.0 / controller.response(omega), np.ones(60))
    >>> bool(trap.inverse.all())
    True
    >>> vehicle = 14.0 / (1j * omega + 1.0) * np.exp(-0.02j * omega)
    >>> bool(inverse_controller(omega, vehicle, np.ones(60), controllers=[controller]).inverse.any())
    False
    """
    weights = coherence_weight(coherence)
    inverse = np.zeros(omega_rad_s.size, dtype=np.bool_)
    bands = []
    for members in _sub_bands(omega_rad_s):
        omega, data, weight = omega_rad_s[members], values[members], weights[members]
        known = _known(omega, data, weight, controllers)
        fitted = _fitted(omega, data, weight) if unknown_gains else _NONE
        band = SubBand(
            low_rad_s=float(omega[0]),
            high_rad_s=float(omega[-1]),
            known_cost=known.cost,
            fitted_cost=fitted.cost,
            vehicle_cost=_vehicle(omega, data, weight).cost if omega[0] > vehicle_from_rad_s else 0.0,
        )
        bands.append(band)
        if band.mixed:
            inverse |= members
        elif band.inverse:
            # Known gains are the sharper test, where they hold: fitted ones bend toward what is not the controller's.
            nearest = known if known.cost < EXCELLENT_COST else fitted
            inverse[members] |= nearest.point_costs < _OUTLIER * EXCELLENT_COST
    return Verdict(bands=tuple(bands), inverse=inverse)


class _Hypothesis(NamedTuple):
    """An inverse of a controller, with its cost, and the cost that each point alone would have, shape ``(f,)``."""

    cost: float
    point_costs: FloatArray


_NONE = _Hypothesis(cost=np.inf, point_costs=np.zeros(0))


def _hypothesis(model: ComplexArray, data: ComplexArray, weight: FloatArray) -> _Hypothesis:
    points = pair_costs(model[:, None, None], data[:, None, None], weight[:, None, None])[:, 0]
    return _Hypothesis(cost=float(np.mean(points)), point_costs=points)


def _sub_bands(omega_rad_s: FloatArray) -> list[BoolArray]:
    """Overlapping bands of ratio 5, or the whole where it is narrower; those with too few points left out."""
    if omega_rad_s.size < _LEAST_POINTS:
        return []
    low, high = float(omega_rad_s[0]), float(omega_rad_s[-1])
    spare = max(high / low / BAND_RATIO, 1.0)
    starts = np.geomspace(low, low * spare, 1 + int(np.ceil(np.log(spare) / np.log(_STEP_RATIO))))
    slack = 1.0 + 1e-9
    bands = [(omega_rad_s >= start / slack) & (omega_rad_s <= start * BAND_RATIO * slack) for start in starts]
    return [members for members in bands if np.count_nonzero(members) >= _LEAST_POINTS]


def _known(omega: FloatArray, data: ComplexArray, weight: FloatArray, controllers: Sequence[Controls]) -> _Hypothesis:
    """The nearest of the controllers, each with its best delay; that on a grid, because phases wrap."""
    if omega[-1] < LEAST_KNOWN_RATIO * omega[0]:
        return _NONE
    delays = np.exp(-1j * np.linspace(-_KNOWN_DELAY_S, _KNOWN_DELAY_S, _DELAY_STEPS)[:, None] * omega)
    judged = []
    for controller in controllers:
        late = -delays / controller.response(omega)
        costs = pair_costs(late[:, None], data[None, None], np.broadcast_to(weight, late.shape)[:, None])
        judged.append(_hypothesis(late[np.argmin(costs)], data, weight))
    return min(judged, key=lambda item: item.cost, default=_NONE)


def _vehicle(omega: FloatArray, data: ComplexArray, weight: FloatArray) -> _Hypothesis:
    """The nearest rate of a vehicle: gain, damping, motor lag and delay."""
    if omega[-1] < LEAST_KNOWN_RATIO * omega[0]:
        return _Hypothesis(cost=0.0, point_costs=np.zeros(0))
    s = 1j * omega
    level = float(np.mean(np.log(np.abs(data) * omega)))
    magnitude, phase = (scale[0, 0] for scale in residual_scales(weight[None, None]))

    def model(theta: FloatArray) -> ComplexArray:
        return np.asarray(np.exp(level + theta[0] - theta[3] * s) / ((s + theta[1]) * (1.0 + theta[2] * s)))

    def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        error = log_error(model(theta), data)
        slope = np.stack([np.ones_like(s), -1.0 / (s + theta[1]), -s / (1.0 + theta[2] * s), -s])
        jacobian = np.concatenate([magnitude * slope.real, phase * slope.imag], axis=1).T
        return np.concatenate([magnitude * error.real, phase * error.imag]), jacobian

    starts = (np.array([0.0, *start]) for start in _VEHICLE_STARTS)
    solutions = [_SOLVER.minimize(residuals, start, _VEHICLE_LOWER, _VEHICLE_UPPER) for start in starts]
    return _hypothesis(model(min(solutions, key=lambda solution: solution.cost).theta), data, weight)


def _fitted(omega: FloatArray, data: ComplexArray, weight: FloatArray) -> _Hypothesis:
    """The nearest inverse of a PID controller."""
    if omega[-1] < LEAST_FITTED_RATIO * omega[0]:
        return _NONE
    s = 1j * omega
    level = float(np.mean(np.log(np.abs(data))))
    magnitude, phase = (scale[0, 0] for scale in residual_scales(weight[None, None]))

    def terms(theta: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        return 1.0 + theta[3] * s, 1.0 + theta[1] / s + theta[2] * s

    def model(theta: FloatArray) -> ComplexArray:
        lag, pid = terms(theta)
        return np.asarray(-np.exp(level + theta[0] - theta[4] * s) * lag / pid)

    def residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        lag, pid = terms(theta)
        error = log_error(model(theta), data)
        slope = np.stack([np.ones_like(s), -1.0 / (s * pid), -s / pid, s / lag, -s])
        jacobian = np.concatenate([magnitude * slope.real, phase * slope.imag], axis=1).T
        return np.concatenate([magnitude * error.real, phase * error.imag]), jacobian

    starts = (np.array([0.0, *start, 0.0]) for start in _STARTS)
    solutions = [_SOLVER.minimize(residuals, start, _LOWER, _UPPER) for start in starts]
    return _hypothesis(model(min(solutions, key=lambda solution: solution.cost).theta), data, weight)
