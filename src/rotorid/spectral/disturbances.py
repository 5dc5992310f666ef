r"""How the disturbances of several outputs go together.

A gust that moves one output moves the others, and of two outputs of which one is the integral of the other each holds
the whole error of both. Whoever fits several responses at once must not count such errors as independent. What an
output shows beside the response to the inputs,

.. math:: V_y = Y_y - j H_y' U_{w'} - \tfrac12 \sigma_\omega^2 H_y'' U - H_y U

is a mixture of the channels of a window, and so the densities of all these disturbances follow from the spectral
matrix.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.spectral.composite import smoothed
from rotorid.spectral.conditioning import OutputSpectra, Separated, condition
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_TINY = 1e-300
_ROUNDING = 1e-12


def disturbance_correlation(
    windows: Sequence[Separated], spectra: Sequence[Sequence[OutputSpectra]], share: FloatArray, points: BoolArray
) -> ComplexArray:
    r"""Correlation of the disturbances of the outputs, shape ``(y, y, f)``.

    .. math:: c_{ab} = \frac{E[V_a V_b^*]}{\sqrt{E|V_a|^2 \, E|V_b|^2}}

    Each window counts by its share in the composite; neighboring points are averaged, as for the disturbance of each
    output. Few independent windows make chance look like correlation: of :math:`n` of them uncorrelated disturbances
    show :math:`|c|^2 \approx 1/n`.

    Parameters
    ----------
    windows
        Inputs told apart, for each window length.
    spectra
        Densities that involve each output, for each output and window length.
    share
        Mean share of each window, shape ``(w, f)``.
    points
        Frequencies of the windows to answer for, shape ``(f,)``.
    """
    outputs, count = len(spectra), share.shape[1]
    total = np.zeros((count, outputs, outputs), dtype=np.complex128)
    for index, window in enumerate(windows):
        mixes = np.stack([_disturbance(window, output[index]) for output in spectra], axis=1)
        densities = np.einsum("fam,fmn,fbn->fab", mixes.conj(), window.matrix.values, mixes, optimize=True)
        here = slice(count - len(densities), None)
        # Without noise there is nothing to correlate but rounding, a millionth of a millionth of the output.
        least = _ROUNDING * np.stack([output[index].auto for output in spectra], axis=1) + _TINY
        total[here] += share[index, here, None, None] * _normalized(densities.conj(), least)
    averaged = smoothed(total)
    return np.moveaxis(_normalized(averaged, np.full(averaged.shape[:2], _TINY)), 0, -1)[..., points]


def _disturbance(window: Separated, output: OutputSpectra) -> ComplexArray:
    """The mixture of channels that is left of an output without its response, shape ``(f, channels)``."""
    mix = output.mix.copy()
    mix[:, list(window.inputs)] -= condition(window, output).response.T
    return mix


def _normalized(densities: ComplexArray, least: FloatArray) -> ComplexArray:
    level = np.sqrt(np.maximum(np.einsum("faa->fa", densities).real, least))
    scaled = densities / level[:, :, None] / level[:, None, :]
    rows = np.arange(densities.shape[1])
    scaled[:, rows, rows] = 1.0
    return np.asarray(scaled)
