"""Random error of frequency responses: the textbook's formula, and the covariance that holds for composites."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.spectral.conditioning import Separated
from rotorid.spectral.windows import Taper
from rotorid.typing import ComplexArray, FloatArray


def overlap_constant(overlap: float) -> float:
    r"""The constant :math:`C` of :func:`random_error`.

    :math:`\sqrt{0.55}` at 50 % overlap, :math:`\sqrt{0.50}` at 80 %, linear in between, one without overlap; after
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, chapter 7.

    Examples
    --------
    >>> round(overlap_constant(0.8) ** 2, 3)
    0.5
    """
    return float(np.sqrt(np.interp(overlap, [0.0, 0.5, 0.8], [1.0, 0.55, 0.50])))


def random_error(coherence: FloatArray, n_averages: float | FloatArray, *, overlap: float = 0.8) -> FloatArray:
    r"""Normalized random error of the frequency-response magnitude.

    .. math:: \varepsilon = C \sqrt{1-\gamma^2} \,/\, (|\gamma| \sqrt{2 n_d})

    It is the relative standard deviation of the magnitude and the standard deviation of the phase in radians. Assumes
    noise on the output only. With feedback the response itself is biased; a small error here does not cure that.

    Parameters
    ----------
    coherence
        :math:`\gamma^2`, any shape.
    n_averages
        Independent windows :math:`n_d = T_F / T_{win}`, a number or an array that fits the coherence.
    overlap
        Share of a window that the next one repeats.

    References
    ----------
    Bendat and Piersol, *Random Data*, section 9.2.

    Examples
    --------
    >>> float(random_error(np.array(0.8), 10.0).round(4))
    0.0791
    """
    gamma2 = np.clip(coherence, 1e-12, 1.0)
    return np.asarray(overlap_constant(overlap) * np.sqrt((1.0 - gamma2) / (2.0 * n_averages * gamma2)))


def smear(omega_rad_s: FloatArray, window_s: float | FloatArray) -> FloatArray:
    r"""Relative bias of a response because a window sees it through a spectral line of finite width.

    .. math:: b = \tfrac12 \sigma_\omega^2 \left| H'' / H \right| = \left( \frac{\pi}{\omega T} \right)^2

    with the variance :math:`\sigma_\omega^2 = (\pi / T)^2` of a half-sine's line and :math:`|H''/H| = 2/\omega^2` of a
    response that falls like an integrator, as rates do. A measure of the size, not a correction: it keeps short windows
    from winning where only their random error is small.

    Parameters
    ----------
    omega_rad_s, window_s
        Frequencies and lengths, of shapes that fit each other.

    Examples
    --------
    Two and six periods in the window:

    >>> smear(np.array([2.0, 6.0]) * 2.0 * np.pi, 1.0).round(4)
    array([0.0625, 0.0069])
    """
    return np.asarray((np.pi / (omega_rad_s * window_s)) ** 2)


def influence(separated: Separated, index: int, *, blocks: int, taper: Taper, moments: int = 1) -> ComplexArray:
    r"""How a disturbance at each moment enters the estimate of one window length, shape ``(f, blocks * moments)``.

    The estimate errs by :math:`\delta H(\omega) = \int g(\omega, t) v(t) \, dt` with

    .. math:: g(\omega, t) = \frac{1}{K \sqrt{T \overline{w^2}}} \sum_k
       \left[\sum_r a_r(\omega) R_{r,k}^*(\omega)\right] w(t - t_k) \, e^{-j\omega (t - t_k)}

    where :math:`R_k` are the transforms of the instruments that really were flown. Sampled at the middle of equal parts
    of each block. With five and more moments in a window the variance that follows is right within 3 % (with two it
    would be wrong by up to 40 % for a Hann taper).

    Parameters
    ----------
    separated
        Inputs of one window length, told apart; :math:`a` is row ``index`` of its projection.
    index
        The input.
    blocks
        Number of blocks in all records.
    taper
        The taper of the windows.
    moments
        Moments in each block.
    """
    matrix, projection = separated.matrix, separated.projection[index]
    flown = matrix.transforms[:, list(separated.instruments)].conj()
    weights = np.einsum("fr,krf->fk", projection, flown) / len(flown)
    count = matrix.window.blocks * moments
    middle_s = (np.arange(count) + 0.5) * matrix.window_s / count
    shape = taper.samples(count) * np.exp(-1j * matrix.omega_rad_s[:, None] * middle_s)
    total = np.zeros((matrix.omega_rad_s.size, blocks * moments), dtype=np.complex128)
    for offset in range(count):
        total[:, matrix.starts * moments + offset] += weights * shape[:, offset, None]
    return np.asarray(total / np.sqrt(matrix.window_s * taper.mean_square))


def response_covariance(
    influences: Sequence[ComplexArray], omega_rad_s: FloatArray, noise: FloatArray, step_s: float
) -> ComplexArray:
    r"""Covariance of a response estimate between all frequencies, shape ``(f, f)``.

    .. math:: E[\delta H_i \, \delta H_j^*] = S_{vv} \sum_m \Delta t \, g_i(t_m) g_j^*(t_m)\,
              \mathrm{sinc}(\Delta\omega \, \Delta t / 2)

    Conditional on the flown instrument, so that sweeps, overlap, window lengths and repeated records need no rule of
    thumb. Assumes a disturbance that is stationary and smooth over the width of a window's spectral line; gusts that
    come and go break it.

    Parameters
    ----------
    influences
        Influence of each window length, already weighted by its share in the composite, each ``(f, moments)``.
    omega_rad_s
        Frequencies, shape ``(f,)``.
    noise
        One-sided density of the disturbance, shape ``(f,)``.
    step_s
        Time :math:`\Delta t` between the moments.
    """
    total = np.sum(influences, axis=0)
    spacing = omega_rad_s[:, None] - omega_rad_s
    level = np.sqrt(noise)
    covariance: ComplexArray = (
        (total @ total.conj().T) * np.sinc(0.5 * spacing * step_s / np.pi) * level[:, None] * level * step_s
    )
    return covariance
