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

_REACH_LINES = 4.0
"""How far derivatives look to either side, in widths of a spectral line: within one of them a response cannot be told
from its own noise, and noise would explain itself."""

_LEAST_NEIGHBORS = 3

_LEAST_ERROR = 1e-4
_LARGEST_ERROR = 10.0
_LEAST_SLOPE = 1e-3

_DOUBTED_ERROR = 0.15
"""A point of this relative error counts half."""

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


def derivatives(
    omega_rad_s: FloatArray, response: ComplexArray, error: FloatArray, *, line_rad_s: float
) -> Derivatives:
    r"""Derivatives of measured responses, from a local parabola through :math:`\ln H` over :math:`\ln \omega`.

    The parabola spans four widths of a spectral line to either side, with weights that fall to zero there. Each
    derivative is shrunk by its own significance, :math:`c / (1 + (3 \sigma_c / |c|)^4)`, so that noise asks for no
    correction; points on one line count as one, and what the parabola misses counts as noise. Resonances narrower than
    a few lines are therefore left uncorrected.

    Parameters
    ----------
    omega_rad_s
        Rising, shape ``(f,)``.
    response, error
        Responses and their relative errors, shape ``(u, f)``.
    line_rad_s
        Width of a spectral line of the windows that are to be corrected, :math:`2 \pi / T`.

    Examples
    --------
    An integrator with a delay of 20 ms:

    >>> omega = np.geomspace(1.0, 10.0, 30)
    >>> response = np.exp(-0.02j * omega) / (1j * omega)
    >>> found = derivatives(omega, response[None], np.full((1, 30), 1e-3), line_rad_s=0.3)
    >>> exact = -response * (1.0 / omega + 0.02j)
    >>> bool(np.abs(found.first[0] / exact - 1.0).max() < 0.01)
    True
    """
    if omega_rad_s.size < 2 * _LEAST_NEIGHBORS + 1:
        return Derivatives(first=np.zeros_like(response), second=np.zeros_like(response))
    away = np.log(omega_rad_s) - np.log(omega_rad_s)[:, None]
    basis = np.stack([np.ones_like(away), away, away**2], axis=-1)
    # Unwrapped along the grid: between neighbors a measured phase turns by less than half a circle.
    values = np.log(np.abs(response)) + 1j * np.unwrap(np.angle(response), axis=-1)
    near = _nearness(omega_rad_s, line_rad_s)
    weight = near[None] * (np.clip(error, _LEAST_ERROR, _LARGEST_ERROR) ** -2.0)[:, None, :]
    inverse = np.linalg.inv(np.einsum("kni,ukn,knj->ukij", basis, weight, basis, optimize=True))
    fitted = np.einsum("ukij,knj,ukn,un->uki", inverse, basis, weight, values, optimize=True)
    misfit = np.abs(values[:, None, :] - np.einsum("kni,uki->ukn", basis, fitted)) ** 2
    repeated = np.maximum(line_rad_s / np.gradient(omega_rad_s), 1.0)
    excess = np.maximum(np.sum(weight * misfit, axis=-1) / np.sum(near, axis=-1), 1.0)
    spread = np.sqrt(np.einsum("ukii->uki", inverse) * (repeated * excess)[..., None])
    slope, bend = (_shrunk(fitted[..., i] * i, spread[..., i] * i) for i in (1, 2))
    # Where hardly anything is known of a response, nothing is known of what windows add to it.
    believed = response / (1.0 + (error / _DOUBTED_ERROR) ** 4)
    return Derivatives(
        first=believed * slope / omega_rad_s, second=believed * (bend - slope + slope**2) / omega_rad_s**2
    )


def _nearness(omega_rad_s: FloatArray, line_rad_s: float) -> FloatArray:
    """How much each point counts for the parabola at another one, shape ``(f, f)``: one there, zero from afar."""
    distance = np.abs(omega_rad_s - omega_rad_s[:, None])
    # Coarse grids take the nearest points whatever the lines are.
    least = np.sort(distance, axis=1)[:, 2 * _LEAST_NEIGHBORS] * 1.2
    reach = np.maximum(_REACH_LINES * line_rad_s, least)
    share = np.minimum(distance / reach[:, None], 1.0)
    return np.asarray((1.0 - share**3) ** 3)


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
    return OutputSpectra(cross=cross, auto=np.einsum("fa,fa->f", mix.conj(), cross).real, mix=mix)


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
