r"""What a window adds to a response by being a window: leakage at its edges and the smear of its spectral line.

A window of taper :math:`w` sees an output :math:`y = h * u` through

.. math:: Y(\omega) = \int w(t) \, y(t) \, e^{-j\omega t} dt
          = H U + j H' U_{w'} - \tfrac12 H'' U_{w''} - \dots

where :math:`U_{w'}` is the transform of the input with the slope of the taper: what the input did before the window
still sounds in it, and the last of what it does in the window sounds after it. Taken for noise, as is the custom, the
second term makes stated errors several times too large where a vehicle remembers long; where a record ends while it is
excited, it biases the response. Both terms follow from the response itself and are taken out here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.spectral.conditioning import OutputSpectra
from rotorid.spectral.spectra import SpectralMatrix, slope_name
from rotorid.spectral.windows import Taper
from rotorid.typing import ComplexArray, FloatArray

_REACH = 3
"""Neighbors on either side of a point that its derivatives are taken from."""

_LEAST_ERROR = 1e-4
_LARGEST_ERROR = 10.0
_LEAST_SLOPE = 1e-3

_SURE = 3.0
"""A derivative of this many standard deviations counts half."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Derivatives:
    r"""Derivatives of responses with respect to frequency.

    Parameters
    ----------
    first, second
        :math:`dH/d\omega` and :math:`d^2H/d\omega^2`, shape ``(u, f)``.
    """

    first: ComplexArray
    second: ComplexArray

    def tail(self, count: int) -> Derivatives:
        """The last ``count`` frequencies: grids of short windows are tails of the longest one's."""
        return Derivatives(first=self.first[:, -count:], second=self.second[:, -count:])


def derivatives(omega_rad_s: FloatArray, response: ComplexArray, error: FloatArray) -> Derivatives:
    r"""Derivatives of measured responses, from a local parabola through :math:`\ln H` over :math:`\ln \omega`.

    Each is shrunk by its own significance, :math:`c / (1 + (3 \sigma_c / |c|)^4)`, so that noise asks for no
    correction. Grids with fewer than four points per octave, or resonances narrower than a few points, are seen
    through the parabola.

    Parameters
    ----------
    omega_rad_s
        Rising, shape ``(f,)``.
    response, error
        Responses and their relative errors, shape ``(u, f)``.

    Examples
    --------
    An integrator with a delay of 20 ms:

    >>> omega = np.geomspace(1.0, 10.0, 30)
    >>> response = np.exp(-0.02j * omega) / (1j * omega)
    >>> found = derivatives(omega, response[None], np.full((1, 30), 1e-3))
    >>> exact = -response * (1.0 / omega + 0.02j)
    >>> bool(np.abs(found.first[0] / exact - 1.0).max() < 5e-3)
    True
    """
    count = omega_rad_s.size
    if count < 3:
        return Derivatives(first=np.zeros_like(response), second=np.zeros_like(response))
    logarithm = np.log(omega_rad_s)
    reach = min(_REACH, (count - 1) // 2)
    first = np.clip(np.arange(count) - reach, 0, count - 2 * reach - 1)
    near = first[:, None] + np.arange(2 * reach + 1)
    away = logarithm[near] - logarithm[:, None]
    basis = np.stack([np.ones_like(away), away, away**2], axis=-1)
    # Unwrapped along the grid: between neighbors a measured phase turns by less than half a circle.
    values = np.log(np.abs(response)) + 1j * np.unwrap(np.angle(response), axis=-1)
    weight = np.clip(error, _LEAST_ERROR, _LARGEST_ERROR)[:, near] ** -2.0
    normal = np.einsum("kni,ukn,knj->ukij", basis, weight, basis)
    inverse = np.linalg.inv(normal)
    fitted = np.einsum("ukij,knj,ukn,ukn->uki", inverse, basis, weight, values[:, near])
    spread = np.sqrt(np.einsum("ukii->uki", inverse))
    slope, bend = (_shrunk(fitted[..., i] * i, spread[..., i] * i) for i in (1, 2))
    return Derivatives(
        first=response * slope / omega_rad_s, second=response * (bend - slope + slope**2) / omega_rad_s**2
    )


def without_leakage(
    matrix: SpectralMatrix,
    *,
    output: int,
    inputs: Sequence[int],
    derivatives: Derivatives,
    taper: Taper,
) -> OutputSpectra:
    r"""Densities of :math:`\tilde Y = Y - j H' U_{w'} - \tfrac12 \sigma_\omega^2 H'' U`.

    :math:`\sigma_\omega^2 = \overline{w'^2} / \overline{w^2}` is the variance of the window's spectral line,
    :math:`(\pi/T)^2` for a half-sine and 4/3 of it for Hann.

    Parameters
    ----------
    matrix
        Spectra with the slopes of the inputs.
    output, inputs
        Rows of the matrix.
    derivatives
        On the grid of the matrix, shape ``(u, f)``.
    taper
        That of the windows.
    """
    variance = line_variance(taper, matrix.window_s)
    slopes = [matrix.channels.index(slope_name(matrix.channels[row])) for row in inputs]
    mix = np.zeros((matrix.omega_rad_s.size, len(matrix.channels)), dtype=np.complex128)
    mix[:, output] = 1.0
    mix[:, slopes] = -1j * derivatives.first.T
    mix[:, list(inputs)] -= 0.5 * variance * derivatives.second.T
    cross = np.einsum("fab,fb->fa", matrix.values, mix)
    return OutputSpectra(cross=cross, auto=np.einsum("fa,fa->f", mix.conj(), cross).real)


def line_variance(taper: Taper, window_s: float) -> float:
    """Variance in rad²/s² of the spectral line of a window.

    Examples
    --------
    >>> from rotorid.spectral.windows import HALF_SINE
    >>> round(line_variance(HALF_SINE, np.pi), 12)
    1.0
    """
    return taper.slope.mean_square / taper.mean_square / window_s**2


def _shrunk(value: ComplexArray, spread: FloatArray) -> ComplexArray:
    size = np.maximum(np.abs(value), _LEAST_SLOPE)
    return np.asarray(value / (1.0 + (_SURE * spread / size) ** 4))
