r"""From the command of a motor to its thrust: curves with their exact derivatives and inverses.

A command is a number from 0 to 1, the output to the motor, its share of the largest thrust or its speed as a share of
the largest; a thrust is newtons or a share, in the unit of the curve's coefficients. All functions take arrays of any
shape, and complex numbers, for derivatives by a complex step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rotorid.autopilots.thrust import expo_share
from rotorid.data.base import Immutable
from rotorid.errors import ModelError
from rotorid.typing import AnyArray, FloatArray

Curve = TypeVar("Curve", bound="ThrustCurve")

_DENSE = 1001


class ThrustCurve(Protocol):
    """Thrust of a rotor as a function of its command and of a few parameters."""

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters, in the order of ``values`` and ``gradients``."""
        ...

    @property
    def values(self) -> FloatArray:
        """Values of the parameters."""
        ...

    def with_values(self: Curve, values: Sequence[float]) -> Curve:
        """The same curve with other parameters."""
        ...

    def thrust(self, command: ArrayLike) -> AnyArray:
        """Thrust, in the shape of the command."""
        ...

    def slope(self, command: ArrayLike) -> AnyArray:
        """Derivative of the thrust with respect to the command."""
        ...

    def gradients(self, command: ArrayLike) -> AnyArray:
        """Derivatives with respect to the parameters, the first dimension that of ``names``."""
        ...

    def inverse(self, thrust: ArrayLike) -> FloatArray:
        """Command that makes a thrust."""
        ...


@dataclass(frozen=True, kw_only=True)
class PolynomialCurve(Immutable):
    r"""Thrust as a polynomial of the command.

    .. math:: T(x) = c_0 + c_1 x + c_2 x^2 + \dots

    A rotor whose speed follows the command has :math:`c_2 x^2` alone; a controller that already straightens its motors'
    curve, :math:`c_1 x`. The coefficients are known well where the commands were, and far from there not at all.

    Parameters
    ----------
    coefficients
        From the constant upward.

    Examples
    --------
    >>> curve = PolynomialCurve(coefficients=(0.02272, -0.01194, 0.12837))
    >>> round(float(curve.thrust(0.6)), 5), curve.is_monotonic(0.2, 0.9)
    (0.06177, True)
    >>> round(float(curve.inverse(curve.thrust(0.6))), 9)
    0.6
    """

    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        coefficients = tuple(map(float, self.coefficients))
        if len(coefficients) < 2 or not np.isfinite(coefficients).all():
            raise ModelError(f"got the coefficients {coefficients}", needed="two finite ones or more, constant first")
        self._set(coefficients=coefficients)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"c_{power}" for power in range(len(self.coefficients)))

    @property
    def values(self) -> FloatArray:
        return np.array(self.coefficients)

    def with_values(self, values: Sequence[float]) -> PolynomialCurve:
        """The same degree with other coefficients."""
        return PolynomialCurve(coefficients=tuple(values))

    def thrust(self, command: ArrayLike) -> AnyArray:
        """Thrust, in the shape of the command."""
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(command), self.coefficients))

    def slope(self, command: ArrayLike) -> AnyArray:
        """Derivative of the thrust with respect to the command."""
        slopes = [power * coefficient for power, coefficient in enumerate(self.coefficients)][1:]
        return np.asarray(np.polynomial.polynomial.polyval(np.asarray(command), slopes))

    def gradients(self, command: ArrayLike) -> AnyArray:
        """Derivatives with respect to the coefficients: the powers of the command."""
        powers = np.polynomial.polynomial.polyvander(np.asarray(command), len(self.coefficients) - 1)
        return np.moveaxis(powers, -1, 0)

    def is_monotonic(self, low: float, high: float) -> bool:
        """Whether more command is more thrust everywhere from ``low`` to ``high``."""
        return _rises(self, low, high)

    def inverse(self, thrust: ArrayLike, *, low: float = 0.0, high: float = 1.0) -> FloatArray:
        """Command from ``low`` to ``high`` that makes a thrust; the nearer end for thrusts out of reach.

        A curve that falls somewhere in between is inverted above its last minimum, where a motor works.

        Raises
        ------
        ModelError
            The curve falls up to ``high``.
        """
        low = self._last_minimum(low, high)
        wanted = np.asarray(thrust, dtype=np.float64)
        wanted = np.clip(wanted, float(self.thrust(low)), float(self.thrust(high)))
        below, above = np.full(wanted.shape, low), np.full(wanted.shape, high)
        guess = 0.5 * (below + above)
        # Newton's method where it stays inside of the bracket, halving where it does not.
        for _ in range(100):
            excess = self.thrust(guess) - wanted
            below, above = np.where(excess < 0.0, guess, below), np.where(excess >= 0.0, guess, above)
            slope = self.slope(guess)
            step = np.divide(excess, slope, out=np.full(wanted.shape, np.inf), where=slope > 0.0)
            tried = guess - step
            better = np.where((tried >= below) & (tried <= above), tried, 0.5 * (below + above))
            if np.all(np.abs(better - guess) <= 1e-15 * max(abs(low), abs(high))):
                break
            guess = better
        return np.asarray(guess)

    def _last_minimum(self, low: float, high: float) -> float:
        slopes = np.array([power * coefficient for power, coefficient in enumerate(self.coefficients)][1:])
        roots = np.polynomial.polynomial.polyroots(np.trim_zeros(slopes, "b")) if np.any(slopes) else np.empty(0)
        real = np.sort(roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > low) & (roots.real < high)])
        start = float(real[-1]) if real.size else low
        if not float(self.thrust(high)) > float(self.thrust(start)):
            raise ModelError(
                f"the thrust of the curve {self.coefficients} falls up to the command {high:g}",
                needed="a curve that rises to its end",
            )
        return start


@dataclass(frozen=True, kw_only=True)
class ExpoCurve(Immutable):
    r"""The curve by which ArduPilot and PX4 straighten their motors: between linear and quadratic.

    .. math:: T(x) = k \left((1 - e) s + e s^2\right), \qquad s = \frac{x - x_0}{x_1 - x_0}

    ArduPilot: :math:`e` is ``MOT_THST_EXPO``, and :math:`x_0, x_1` are ``MOT_SPIN_MIN`` and ``MOT_SPIN_MAX``; PX4:
    ``THR_MDL_FAC``, 0 and 1. Thrust at the smallest output, where the rotor already turns, counts as none, as the
    autopilots count it. Below and above the range the curve goes on; a motor does not.

    Parameters
    ----------
    expo
        :math:`e`, from -1 to 1.
    largest
        :math:`k`: thrust of the full command.
    low, high
        :math:`x_0, x_1`.

    Examples
    --------
    >>> curve = ExpoCurve(expo=0.65, largest=18.83, low=0.15, high=0.95)
    >>> round(float(curve.thrust(0.95)), 2), round(float(curve.inverse(curve.thrust(0.5))), 9)
    (18.83, 0.5)
    """

    expo: float
    largest: float = 1.0
    low: float = 0.0
    high: float = 1.0

    def __post_init__(self) -> None:
        if not (-1.0 <= self.expo <= 1.0 and self.low < self.high and np.isfinite(self.largest)):
            raise ModelError(
                f"got an expo of {self.expo:g} and a range of {self.low:g} to {self.high:g}",
                needed="an expo from -1 to 1, and a range that rises",
            )

    @property
    def names(self) -> tuple[str, ...]:
        return ("expo", "largest", "low", "high")

    @property
    def values(self) -> FloatArray:
        return np.array([self.expo, self.largest, self.low, self.high])

    def with_values(self, values: Sequence[float]) -> ExpoCurve:
        """The curve with other parameters."""
        expo, largest, low, high = (float(value) for value in values)
        return ExpoCurve(expo=expo, largest=largest, low=low, high=high)

    def thrust(self, command: ArrayLike) -> AnyArray:
        """Thrust, in the shape of the command."""
        share = self._share(command)
        return np.asarray(self.largest * ((1.0 - self.expo) * share + self.expo * share**2))

    def slope(self, command: ArrayLike) -> AnyArray:
        """Derivative of the thrust with respect to the command."""
        return np.asarray(self._bend(command) / (self.high - self.low))

    def gradients(self, command: ArrayLike) -> AnyArray:
        """Derivatives with respect to expo, largest thrust, low and high end."""
        share, bend = self._share(command), self._bend(command)
        span = self.high - self.low
        return np.stack(
            [
                self.largest * (share**2 - share),
                (1.0 - self.expo) * share + self.expo * share**2,
                bend * (share - 1.0) / span,
                -bend * share / span,
            ]
        )

    def is_monotonic(self, low: float, high: float) -> bool:
        """Whether more command is more thrust everywhere from ``low`` to ``high``."""
        return _rises(self, low, high)

    def inverse(self, thrust: ArrayLike) -> FloatArray:
        """Command that makes a thrust; that of the nearer end for thrusts out of reach."""
        wanted = np.clip(np.asarray(thrust, dtype=np.float64) / self.largest, 0.0, 1.0)
        return np.asarray(self.low + (self.high - self.low) * expo_share(wanted, self.expo))

    def _share(self, command: ArrayLike) -> AnyArray:
        return np.asarray((np.asarray(command) - self.low) / (self.high - self.low))

    def _bend(self, command: ArrayLike) -> AnyArray:
        """Derivative of the thrust with respect to the share of the range."""
        return np.asarray(self.largest * (1.0 - self.expo + 2.0 * self.expo * self._share(command)))


def _rises(curve: ThrustCurve, low: float, high: float) -> bool:
    return bool(np.all(curve.slope(np.linspace(low, high, _DENSE)) > 0.0))


def ardupilot_curve(parameters: Mapping[str, float], *, largest: float = 1.0) -> ExpoCurve | None:
    """The curve that an ArduPilot's parameters state; ``None`` for firmware that has none of them.

    Parameters
    ----------
    parameters
        Of the log.
    largest
        Thrust of one motor at full output.
    """
    names = ("MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX")
    if any(name not in parameters for name in names):
        return None
    expo, low, high = (parameters[name] for name in names)
    return ExpoCurve(expo=float(np.clip(expo, -1.0, 1.0)), largest=largest, low=low, high=high)


def px4_curve(parameters: Mapping[str, float], *, largest: float = 1.0) -> ExpoCurve:
    """The curve that a PX4's parameter ``THR_MDL_FAC`` states, from the output to the motor; linear without it."""
    return ExpoCurve(expo=float(np.clip(parameters.get("THR_MDL_FAC", 0.0), 0.0, 1.0)), largest=largest)
