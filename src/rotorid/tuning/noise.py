"""Noise of the rate that a controller takes, over the whole spectrum that a log shows: rotors turn far above a loop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.models.controller import RateController
from rotorid.typing import ComplexArray, FloatArray

_SHOWN = 0.03
"""Least response of a filter behind which a log still shows noise: below, its digits are most of what is left."""


def density_behind(density: FloatArray, before: ComplexArray, after: ComplexArray) -> FloatArray:
    """Density of a noise behind other filters than those that it passed.

    Where the flown filters left next to nothing and the others leave more, the noise in front of them is taken from the
    nearest frequencies that are shown: a log divided by almost nothing is its rounding, at the Nyquist frequency of a
    digital low-pass a thousand times the noise.

    Parameters
    ----------
    density
        Behind the flown filters, shape ``(..., f)``.
    before, after
        Responses of the flown and the other filters, of a shape that goes with it.

    Examples
    --------
    >>> flown, off = np.array([1.0, 0.5, 1e-3]), np.ones(3)
    >>> density_behind(np.array([4.0, 1.0, 0.1]), flown, off).round(3).tolist()
    [4.0, 4.0, 4.0]
    """
    shape = np.broadcast_shapes(density.shape, before.shape, after.shape)
    given, had, has = (
        np.broadcast_to(each, shape).reshape(-1, shape[-1]) for each in (density, np.abs(before), np.abs(after))
    )
    shown, less = had >= _SHOWN, has <= had
    found = given * np.divide(has, had, out=np.ones(given.shape), where=had > 0.0) ** 2
    places = np.arange(shape[-1])
    for row in np.flatnonzero(np.any(~shown & ~less, axis=1) & np.any(shown, axis=1)):
        known, lacking = places[shown[row]], places[~shown[row] & ~less[row]]
        plain = given[row, known] / had[row, known] ** 2
        found[row, lacking] = np.interp(lacking, known, plain) * has[row, lacking] ** 2
    return np.asarray(found.reshape(shape))


@dataclass(frozen=True, kw_only=True, eq=False)
class RateNoise(Immutable):
    """Density of the noise of a rate behind the filters of its gyro.

    Parameters
    ----------
    omega_rad_s
        Evenly spaced, shape ``(n,)``.
    density
        One-sided, (rad/s)² per rad/s, shape ``(n,)``; zero where the vehicle moves.
    """

    omega_rad_s: FloatArray
    density: FloatArray

    def __post_init__(self) -> None:
        self._set(
            omega_rad_s=read_only(self.omega_rad_s, np.float64, ndim=1),
            density=read_only(self.density, np.float64, ndim=1),
        )

    def without(self, response: ComplexArray) -> RateNoise:
        """The noise without a filter that it passed, by its response, shape ``(n,)``."""
        return replace(self, density=density_behind(self.density, response, np.ones_like(response)))

    def of_command(self, controller: RateController) -> tuple[FloatArray, ComplexArray, FloatArray]:
        r"""Mean square of the command that each frequency adds, by P alone, P with D, and D alone, shapes ``(n,)``.

        .. math:: \sigma^2 = \sum_n P^2 a_n + 2 P D \, \mathrm{Re}(b_n) + D^2 c_n

        with :math:`a = S |C_P|^2 \Delta\omega`, :math:`b = S C_P^* C_D \Delta\omega` and
        :math:`c = S |C_D|^2 \Delta\omega`. The integral passes no noise.

        Parameters
        ----------
        controller
            Whose filters count; its gains do not.
        """
        none = replace(controller, integral=0.0, angle_1_s=0.0)
        of_p = replace(none, proportional_s=1.0, derivative_s2=0.0).response(self.omega_rad_s)
        of_d = replace(none, proportional_s=0.0, derivative_s2=1.0).response(self.omega_rad_s)
        power = self.density * float(self.omega_rad_s[1] - self.omega_rad_s[0])
        return power * np.abs(of_p) ** 2, power * of_p.conj() * of_d, power * np.abs(of_d) ** 2
