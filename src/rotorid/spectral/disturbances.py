r"""How the disturbances of several outputs go together.

A gust that moves one output moves the others, and of two outputs of which one is the integral of the other each holds
the whole error of both. Whoever fits several responses at once must not count such errors as independent. What an
output shows beside the response to the inputs,

.. math:: V_y = Y_y - j H_y' U_{w'} - \tfrac12 \sigma_\omega^2 H_y'' U - H_y U

is a mixture of the channels of a window, and so the densities of all these disturbances follow from the spectral
matrix.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rotorid.data.disturbance import Disturbance
from rotorid.spectral.composer import Composed
from rotorid.spectral.composite import smoothed
from rotorid.spectral.conditioning import OutputSpectra, Separated, condition
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_TINY = 1e-300
_ROUNDING = 1e-12
_REACH = math.log(4.0 / 3.0)
_LEAST_FACTOR, _LARGEST_FACTOR = 0.5, 10.0
"""An estimate adapts to its disturbance by less than half; far more is a model that does not fit."""


def disturbance_of(
    windows: Sequence[Separated],
    spectra: Sequence[Sequence[OutputSpectra]],
    parts: Sequence[Composed],
    left: Sequence[FloatArray],
    points: BoolArray,
) -> Disturbance:
    """The disturbance of an estimate.

    Each window counts by its share in the composite; neighboring points are averaged.

    Parameters
    ----------
    windows
        Inputs told apart, for each window length.
    spectra
        Densities that involve each output, for each output and window length.
    parts
        The composite of each output.
    left
        Share of a disturbance that the residuals of each window length still hold, see
        :func:`rotorid.spectral.freedom.residual_share`.
    points
        Frequencies of the windows to answer for, shape ``(f,)``.
    """
    share = np.mean([part.share.mean(axis=0) for part in parts], axis=0)
    count, outputs = share.shape[1], len(parts)
    inputs, own = len(windows[0].inputs), np.arange(len(parts))
    total = np.zeros((count, outputs + inputs, outputs + inputs), dtype=np.complex128)
    level = np.zeros((count, outputs))
    for index, window in enumerate(windows):
        here = slice(count - window.matrix.omega_rad_s.size, None)
        rows = [
            _disturbance(window, output[index], part.values[:, here])
            for output, part in zip(spectra, parts, strict=True)
        ]
        mixes = np.stack([*rows, *_inputs(window)], axis=1)
        densities = np.einsum("fam,fmn,fbn->fab", mixes.conj(), window.matrix.values, mixes, optimize=True)
        # Without noise there is nothing but rounding, a millionth of a millionth of the output, and no correlation.
        floor = _ROUNDING * np.stack([output[index].auto for output in spectra], axis=1)
        densities[:, own, own] += floor
        total[here] += share[index, here, None, None] * densities.conj()
        noise = np.stack([condition(window, output[index]).noise for output in spectra], axis=1)
        level[here] += share[index, here, None] * noise / left[index][:, None]
    return Disturbance(
        densities=np.moveaxis(total, 0, -1)[..., points],
        level=smoothed(level.astype(np.complex128)).real.T[:, points],
        weakness=np.stack([part.weakness for part in parts])[..., points],
    )


def output_correlation(
    disturbance: Disturbance, omega_rad_s: FloatArray, difference: ComplexArray | None = None
) -> ComplexArray:
    r"""Correlation of the disturbances of the outputs, shape ``(y, y, f)``.

    .. math:: c_{ab} = \frac{E[V_a V_b^*]}{\sqrt{E|V_a|^2 \, E|V_b|^2}}

    Averaged over a third to either side in frequency, with weights that fall to zero there: ten independent windows, as
    many as there are at low frequencies, make of six independent outputs six that seem to hang together, and whoever
    weighs by that believes too much. What the correlation does within a third is lost.

    Parameters
    ----------
    disturbance
        Of an estimate.
    omega_rad_s
        Its frequencies, shape ``(f,)``.
    difference
        The estimate minus the response about which the disturbance is wanted, shape ``(y, u, f)``; none for the
        estimate itself.
    """
    each = np.moveaxis(_normalized(_about(disturbance, difference)), -1, 0)
    distance = np.abs(np.log(omega_rad_s) - np.log(omega_rad_s)[:, None]) / _REACH
    near = np.maximum(1.0 - distance, 0.0)
    return _normalized(np.moveaxis(np.einsum("fg,gab->fab", near, each), 0, -1))


def level_about(disturbance: Disturbance, difference: ComplexArray) -> FloatArray:
    """Factor from the standard deviations that an estimate states to those about another response, ``(y, u, f)``.

    Parameters
    ----------
    disturbance, difference
        As in :func:`output_correlation`.
    """
    power = np.einsum("yyf->yf", _about(disturbance, difference)).real
    # Without noise there is nothing but rounding on either side.
    factor = np.sqrt(np.maximum(power, _TINY) / np.maximum(disturbance.level, _TINY))
    return np.asarray(np.clip(factor, _LEAST_FACTOR, _LARGEST_FACTOR)[:, None, :] / disturbance.weakness)


def _about(disturbance: Disturbance, difference: ComplexArray | None) -> ComplexArray:
    """Densities of the disturbances of the outputs about another response, smoothed, shape ``(y, y, f)``."""
    outputs = disturbance.level.shape[0]
    if difference is None:
        part = disturbance.densities[:outputs, :outputs]
        return np.moveaxis(smoothed(np.moveaxis(part, -1, 0)), 0, -1)
    frequencies = disturbance.level.shape[1]
    own = np.broadcast_to(np.eye(outputs)[:, :, None], (outputs, outputs, frequencies))
    mix = np.concatenate([own, difference], axis=1)
    about = np.einsum("amf,mnf,bnf->fab", mix, disturbance.densities, mix.conj(), optimize=True)
    return np.moveaxis(smoothed(about), 0, -1)


def _disturbance(window: Separated, output: OutputSpectra, response: ComplexArray) -> ComplexArray:
    """The mixture of channels that is left of an output without its response, shape ``(f, channels)``."""
    mix = output.mix.copy()
    mix[:, list(window.inputs)] -= response.T
    return mix


def _inputs(window: Separated) -> list[ComplexArray]:
    mixes = []
    for row in window.inputs:
        mix = np.zeros(window.matrix.values.shape[:2], dtype=np.complex128)
        mix[:, row] = 1.0
        mixes.append(mix)
    return mixes


def _normalized(densities: ComplexArray) -> ComplexArray:
    level = np.sqrt(np.maximum(np.einsum("aaf->af", densities).real, _TINY))
    scaled = densities / level[:, None, :] / level[None, :, :]
    rows = np.arange(len(densities))
    scaled[rows, rows] = 1.0
    return np.asarray(0.5 * (scaled + scaled.conj().swapaxes(0, 1)))
