"""Spectra of disturbances and noises: white, gusts, and what a flight showed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.typing import ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class White:
    r"""Independent samples, :math:`S = 2 \sigma^2 / f_s`.

    Parameters
    ----------
    std
        Standard deviation of each source, per sample.
    sample_rate_hz
        Rate of the samples.

    Examples
    --------
    >>> White(std=(0.1,), sample_rate_hz=200.0).density(np.array([1.0])).real.round(6)
    array([[[0.0001]]])
    """

    std: tuple[float, ...]
    sample_rate_hz: float

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(n, n, f)``."""
        return _diagonal(2.0 * np.square(self.std) / self.sample_rate_hz, np.ones(omega_rad_s.size))


@dataclass(frozen=True, kw_only=True)
class GaussMarkov:
    r"""Gusts of :func:`rotorid.simulate.turbulence.gauss_markov`, :math:`S = 4 \sigma^2 T / (1 + \omega^2 T^2)`.

    Parameters
    ----------
    std
        Standard deviation of each source.
    correlation_s
        :math:`T`.
    """

    std: tuple[float, ...]
    correlation_s: float

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(n, n, f)``."""
        shape = 4.0 * self.correlation_s / (1.0 + (omega_rad_s * self.correlation_s) ** 2)
        return _diagonal(np.square(self.std), shape)


@dataclass(frozen=True, kw_only=True)
class Dryden:
    r"""Gusts of :func:`rotorid.simulate.wind.blown` to north, east and down.

    .. math:: S_{along} = \frac{4 \sigma^2 T}{1 + \omega^2 T^2}, \qquad
        S_{across} = 2 \sigma^2 T \frac{1 + 3 \omega^2 T^2}{(1 + \omega^2 T^2)^2}

    Parameters
    ----------
    level_std, vertical_std
        Standard deviations along and across the wind, and vertically.
    level_s, vertical_s
        :math:`T` of both.
    heading_rad
        Where the wind blows to, from north over east.
    """

    level_std: float
    vertical_std: float
    level_s: float
    vertical_s: float
    heading_rad: float = 0.0

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(3, 3, f)``."""
        along = GaussMarkov(std=(self.level_std,), correlation_s=self.level_s).density(omega_rad_s)[0, 0]
        total = np.zeros((3, 3, omega_rad_s.size), dtype=np.complex128)
        total[0, 0], total[1, 1] = along, _across(self.level_std, self.level_s, omega_rad_s)
        total[2, 2] = _across(self.vertical_std, self.vertical_s, omega_rad_s)
        cosine, sine = np.cos(self.heading_rad), np.sin(self.heading_rad)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(np.einsum("am,mnf,bn->abf", turn, total, turn))


@dataclass(frozen=True, kw_only=True, eq=False)
class Tabulated(Immutable):
    """A spectrum given at some frequencies: straight lines over the logarithm of frequency, flat beyond both ends.

    Parameters
    ----------
    omega_rad_s
        Rising, above zero, shape ``(f,)``.
    values
        One-sided densities :math:`E[a b^*]`, shape ``(n, n, f)``.
    """

    omega_rad_s: FloatArray
    values: ComplexArray

    def __post_init__(self) -> None:
        omega, values = read_only(self.omega_rad_s, np.float64, ndim=1), read_only(self.values, np.complex128, ndim=3)
        if not omega.size or omega[0] <= 0.0 or np.any(np.diff(omega) <= 0.0) or values.shape[2] != omega.size:
            raise UsageError(
                f"densities of shape {values.shape} at {omega.size} frequencies came",
                needed="rising frequencies above zero, and a density at each",
            )
        self._set(omega_rad_s=omega, values=values)

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(n, n, f)``."""
        place = np.interp(np.log(omega_rad_s), np.log(self.omega_rad_s), np.arange(self.omega_rad_s.size))
        first = np.minimum(place.astype(np.int64), max(self.omega_rad_s.size - 2, 0))
        second = np.minimum(first + 1, self.omega_rad_s.size - 1)
        share = place - first
        # A mean of covariances is one, so that no noise of negative power comes out.
        return np.asarray((1.0 - share) * self.values[..., first] + share * self.values[..., second])


def disturbances_of(response: FrequencyResponse) -> Tabulated:
    """What moved the outputs of a measured response beside its inputs, as a spectrum for the next flight.

    Of a joint estimate it is what stands at the outputs with the loop open; a direct one in closed loop takes a part of
    it for the response. The noise of the log, folded as it was, is in it: use it in a loop without ``loop_rate_hz``.

    Raises
    ------
    UsageError
        The response holds no disturbances, because it is no plain estimate any more.
    """
    if response.disturbance is None or response.output_correlation is None:
        raise UsageError("a response without its disturbances came", needed="one as it was estimated")
    level = np.sqrt(response.disturbance.level)
    return Tabulated(
        omega_rad_s=response.omega_rad_s, values=response.output_correlation[0] * level[:, None] * level[None, :]
    )


def _diagonal(powers: FloatArray, shape: FloatArray) -> ComplexArray:
    return np.asarray(np.diag(powers)[:, :, None] * shape, dtype=np.complex128)


def _across(std: float, correlation_s: float, omega_rad_s: FloatArray) -> FloatArray:
    squared = (omega_rad_s * correlation_s) ** 2
    return np.asarray(2.0 * std**2 * correlation_s * (1.0 + 3.0 * squared) / (1.0 + squared) ** 2)
