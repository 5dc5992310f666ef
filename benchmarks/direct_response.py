"""Grey boxes by direct responses, a log cost weighted by coherence, and a local optimizer of SciPy.

The way of pyAircraftIden, written anew after its published description; none of its code is here, and none runs.
The response is the direct one, cross-spectrum over input spectrum, of windows of several lengths. In closed loop it is
biased where noise or gusts come back through the controller: coherence lowers the weight of such frequencies, and takes
no bias out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from rotorid.fitting import TimeData
from rotorid.models import LinearStructure
from rotorid.typing import ComplexArray, FloatArray

DEGREE_SHARE = 0.01745
"""Weight of a squared degree against a squared decibel."""


class DirectResponse(NamedTuple):
    """A response of one input and one output over frequencies, with its coherence; shape ``(f,)``."""

    values: ComplexArray
    coherence: FloatArray


def direct_response(record: TimeData, omega_rad_s: FloatArray, windows_s: tuple[float, ...]) -> DirectResponse:
    r"""Composite of windows, :math:`H = S_{xy} / S_{xx}`.

    Spectra are those of windows that half overlap under Hann's taper; of several lengths they are averaged with the
    fourth power of the reciprocal random error as their weights. A window that is shorter than a period has no say
    beside the longest one.
    """
    spectra, weights = [], []
    for length_s in windows_s:
        found, count = _spectra(record, omega_rad_s, length_s)
        gamma2 = np.clip(_coherence(found), 1e-6, 1.0 - 1e-9)
        error = np.sqrt((1.0 - gamma2) / (gamma2 * 2.0 * count))
        spectra.append(found)
        long_enough = (omega_rad_s * length_s >= 2.0 * np.pi) | (length_s == max(windows_s))
        weights.append(np.where(long_enough, error**-4.0, 0.0))
    together = np.einsum("wf,wsf->sf", np.array(weights) / np.sum(weights, axis=0), np.array(spectra))
    return DirectResponse(values=together[1] / together[0].real, coherence=_coherence(together))


def _spectra(record: TimeData, omega_rad_s: FloatArray, length_s: float) -> tuple[ComplexArray, int]:
    """Input, cross and output spectra, shape ``(3, f)``, and how many windows they are of."""
    samples = round(length_s * record.sample_rate_hz)
    firsts = np.arange(0, record.samples - samples + 1, samples // 2)
    pieces = np.stack([record.inputs[0], record.outputs[0]])[:, firsts[:, None] + np.arange(samples)]
    taper = np.hanning(samples)
    turned = taper[:, None] * np.exp(-1j * np.arange(samples)[:, None] * omega_rad_s / record.sample_rate_hz)
    x, y = (pieces - pieces.mean(axis=-1, keepdims=True)) @ turned
    found = np.array([np.mean(x.conj() * x, axis=0), np.mean(x.conj() * y, axis=0), np.mean(y.conj() * y, axis=0)])
    return found, firsts.size


def _coherence(spectra: ComplexArray) -> FloatArray:
    return np.asarray(np.abs(spectra[1]) ** 2 / (spectra[0].real * spectra[2].real))


def fit_direct(
    structure: LinearStructure, measured: DirectResponse, omega_rad_s: FloatArray, hold: ComplexArray, least: float
) -> FloatArray:
    r"""Free parameters that minimize the weighted log error, from the start values of the structure.

    .. math:: J = \frac{20}{n} \sum W_\gamma^2 (\Delta_{dB}^2 + 0.01745\,\Delta_{deg}^2), \quad
        W_\gamma = 1.58 (1 - e^{-\gamma^2})

    Parameters
    ----------
    structure
        What is known: the equations.
    measured
        The response of a record.
    omega_rad_s
        Its frequencies.
    hold
        What the hold of the input makes of every model, known as well.
    least
        Coherence below which a frequency is left out.
    """
    used = measured.coherence >= least
    trust = (1.58 * (1.0 - np.exp(-measured.coherence[used]))) ** 2
    free = [structure.parameters[name] for name in structure.parameters.free]
    start = np.array([one.value for one in free])

    def cost(scaled: FloatArray) -> float:
        values = structure.parameters.unpack(scaled * start).values
        ratio = measured.values[used] / (structure.response(values, omega_rad_s[used])[0, 0] * hold[used])
        decibels, degrees = 20.0 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
        return float(20.0 / trust.size * np.sum(trust * (decibels**2 + DEGREE_SHARE * degrees**2)))

    limits = [tuple(sorted((one.lower / one.value, one.upper / one.value))) for one in free]
    found = minimize(cost, np.ones(start.size), method="SLSQP", bounds=limits, options={"maxiter": 500})
    return np.asarray(found.x * start)
