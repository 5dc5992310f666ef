r"""Random errors of frequency responses: from the textbook's formula to the covariance that holds for composites.

Three things make the stated error of an estimate wrong, and each has its function here. Windows that overlap, or share
data with windows of other lengths, err together: the covariance follows from how a disturbance at each moment enters
the estimate (:func:`influence`, :func:`response_covariance`). An estimate fits a part of the disturbance too, so that
the residuals hold less than the whole. With the transforms of the instruments over the K windows spanning the space of
the projection P, and N the correlation that overlapping tapers give the transforms of a white disturbance,

.. math:: E[\hat S_{vv}] = S_{vv} \left( 1 - \frac{\mathrm{tr}(P N)}{K} \right)

(:func:`residual_share`): of many short windows next to nothing is lost; of a few long ones that overlap, most is: five
windows of 72 s on a record of 120 s are hardly two. And where feedback rules the input, an instrument is weak, and the
linear formula too small (:func:`weak_instrument_factor`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import chain

import numpy as np

from rotorid.spectral.conditioning import ConditionedResponse
from rotorid.spectral.spectra import SpectralMatrix
from rotorid.spectral.windows import Taper
from rotorid.typing import ComplexArray, FloatArray

_WORTH_COMPACTING = 8
_JITTER = 1e-11
"""Neighboring points may err alike to the last digit; a factor needs some distance from that."""


def overlap_constant(overlap: float) -> float:
    r"""The constant :math:`C` of :func:`random_error`.

    :math:`\sqrt{0.55}` at 50 % overlap, :math:`\sqrt{0.50}` at 80 %, linear in between, one without overlap; after
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, chapter 7.

    Parameters
    ----------
    overlap
        Share of a window that the next one covers.

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


def influence(
    separated: ConditionedResponse, index: int, *, blocks: int, taper: Taper, moments: int = 1, first_block: int = 0
) -> ComplexArray:
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
        Inputs of one window length, separated; :math:`a` is row ``index`` of its projection.
    index
        The input.
    blocks, first_block
        How many blocks to look at, counted over all records, and the first of them.
    """
    matrix, projection = separated.matrix, separated.projection[index]
    near = (matrix.starts < first_block + blocks) & (matrix.starts + matrix.window.blocks > first_block)
    flown = matrix.transforms[near][:, list(separated.instruments)].conj()
    weights = np.einsum("fr,krf->fk", projection, flown) / len(matrix.transforms)
    starts = matrix.starts[near]
    count, step, size = matrix.window.blocks * moments, matrix.window.hop * moments, blocks * moments
    middle_s = (np.arange(count) + 0.5) * matrix.window_s / count
    shape = taper.samples(count) * np.exp(-1j * matrix.omega_rad_s[:, None] * middle_s)
    # With room for windows that begin before the stretch or end after it.
    total = np.zeros((matrix.omega_rad_s.size, count + size + count + step), dtype=np.complex128)
    for run in np.split(np.arange(starts.size), np.flatnonzero(np.diff(starts) != matrix.window.hop) + 1):
        # Windows of a run begin one step after the other, so that pieces of one step lie side by side.
        length = run.size * step
        for offset in range(0, count if run.size else 0, step):
            piece = shape[:, None, offset : offset + step]
            begin = count + (int(starts[run[0]]) - first_block) * moments + offset
            side_by_side = total[:, begin : begin + length].reshape(len(total), run.size, step)
            side_by_side[..., : piece.shape[-1]] += weights[:, run, None] * piece
    return np.asarray(total[:, count : count + size] / np.sqrt(matrix.window_s * taper.mean_square))


def compacted(chunks: Iterable[ComplexArray], size: int) -> ComplexArray:
    r"""Influences with all of their products and, over long records, fewer columns than moments.

    All that errors need of influences :math:`A` is :math:`A A^H`. Any :math:`L` with :math:`L L^H = A A^H` does as
    well, and the Cholesky factor has no more columns than rows, however long the records are.

    Parameters
    ----------
    chunks
        Influences over adjoining stretches of time, each ``(..., moments)``.
    size
        Moments in all of them.

    Returns
    -------
    numpy.ndarray
        Shape ``(..., columns)``.

    Examples
    --------
    >>> long = np.random.default_rng(0).standard_normal((3, 90)) + 0j
    >>> short = compacted([long[:, :50], long[:, 50:]], 90)
    >>> short.shape, bool(np.allclose(short @ short.T, long @ long.T))
    ((3, 3), True)
    """
    chunks = iter(chunks)
    first = next(chunks)
    rows = int(np.prod(first.shape[:-1]))
    if size <= _WORTH_COMPACTING * rows:
        return np.concatenate([first, *chunks], axis=-1)
    products = np.zeros((rows, rows), dtype=np.complex128)
    for chunk in chain([first], chunks):
        flat = chunk.reshape(rows, -1)
        products += flat @ flat.conj().T
    level = np.sqrt(np.einsum("rr->r", products).real)
    scale = np.where(level > 0.0, level, 1.0)
    factor = np.linalg.cholesky(products / (scale[:, None] * scale) + _JITTER * np.eye(rows))
    return np.asarray((level[:, None] * factor).reshape(*first.shape[:-1], rows))


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


_FINE = 64
_LEAST_LEFT = 0.05
"""Below that too little is left to say how large the whole was."""


def residual_share(window: ConditionedResponse, taper: Taper) -> FloatArray:
    """Share of the power of a disturbance that the residuals of one window length still hold, shape ``(f,)``.

    Parameters
    ----------
    window
        Inputs separated; its instruments span what is fitted.
    """
    matrix = window.matrix
    count = len(matrix.transforms)
    block_s = matrix.window_s / matrix.window.blocks
    # Phases refer to the start of each window; those of a disturbance go on from one to the next.
    turn = np.exp(-1j * matrix.omega_rad_s * matrix.starts[:, None] * block_s)
    flown = matrix.transforms[:, list(window.instruments)] * turn[:, None, :]
    basis, _ = np.linalg.qr(np.moveaxis(flown, 2, 0))
    taken = np.sum(np.abs(basis) ** 2, axis=(1, 2))
    for lag in range(1, count):
        shift = matrix.starts[lag:] - matrix.starts[:-lag]
        # Windows of two records share nothing; within one, all of a lag are equally far apart.
        near = shift < matrix.window.blocks
        if not near.any():
            break
        alike = _overlap(taper, int(shift[near].min()), matrix.window.blocks)
        taken += 2.0 * alike * np.einsum("fkr,fkr->f", basis[:, :-lag][:, near].conj(), basis[:, lag:][:, near]).real
    return np.asarray(np.clip(1.0 - taken / count, _LEAST_LEFT, 1.0))


_LINE = np.linspace(0.0, 80.0, 801)
"""Distances in frequency times the length of a window, beyond which two transforms share nothing."""


def density_freedom(matrix: SpectralMatrix, taper: Taper, *, reach: int) -> FloatArray:
    r"""Degrees of freedom of a density from overlapping windows, averaged over neighboring points, shape ``(f,)``.

    With the correlations N of the transforms of the K windows, and c of those at the n points of a mean,

    .. math:: \nu = 2 \, \frac{K^2}{\sum_{kl} N_{kl}^2} \, \frac{n^2}{\sum_{ij} |c_{ij}|^2}, \qquad
        c_{ij} = \frac{\int w^2(t) e^{j (\omega_i - \omega_j) t} \, dt}{\int w^2(t) \, dt}

    Parameters
    ----------
    reach
        Points to either side that are averaged.
    """
    count, starts, blocks = len(matrix.transforms), matrix.starts, matrix.window.blocks
    alike = float(count)
    for lag in range(1, count):
        shift = starts[lag:] - starts[:-lag]
        near = shift < blocks
        if not near.any():
            break
        alike += 2.0 * np.count_nonzero(near) * _overlap(taper, int(shift[near].min()), blocks) ** 2
    omega = matrix.omega_rad_s
    place = np.clip(np.arange(omega.size)[:, None] + np.arange(-reach, reach + 1), 0, omega.size - 1)
    apart = np.abs(omega[place][:, :, None] - omega[place][:, None, :]) * matrix.window_s
    lines = place.shape[1] ** 2 / np.interp(apart, _LINE, _shared(taper), right=0.0).sum(axis=(1, 2))
    return np.asarray(2.0 * count**2 / alike * lines)


@lru_cache(maxsize=8)
def _shared(taper: Taper) -> FloatArray:
    """Squared correlation of the transforms of one window at two frequencies, over the distances of ``_LINE``."""
    power = taper.samples(_FINE * 8) ** 2
    middle = (np.arange(power.size) + 0.5) / power.size
    return np.asarray(np.abs(np.exp(1j * _LINE[:, None] * middle) @ power / power.sum()) ** 2)


@lru_cache(maxsize=1024)
def _overlap(taper: Taper, shift: int, blocks: int) -> float:
    """Correlation of the transforms of a white disturbance in two windows that begin ``shift`` blocks apart."""
    samples = taper.samples(_FINE * blocks)
    ahead = _FINE * shift
    return float(np.sum(samples[ahead:] * samples[: samples.size - ahead]) / np.sum(samples**2))


_LEAST_STRENGTH = 0.02
_LARGEST_FACTOR = 1e3


def weak_instrument_factor(
    variance: FloatArray, noise: FloatArray, input_noise: FloatArray, input_residual: ComplexArray
) -> FloatArray:
    r"""Factor on the standard deviation of a joint estimate for the noise in its denominator.

    The estimate is a ratio, :math:`\hat H = S_{ry} / S_{ru}`, and feedback makes numerator and denominator err
    together. The textbook's linear formula :math:`\sigma^2 = s S_{vv}` evaluates the noise at the estimate, which has
    adapted to it. Those :math:`H = \hat H + \delta` whose own noise explains the data at one standard deviation are

    .. math:: |\delta|^2 \le s \left( S_{vv} - 2 \,\mathrm{Re}\, \delta^* S_{uv} + |\delta|^2 \Omega_{uu} \right)

    a disk around :math:`-s S_{uv} / A` with :math:`A = 1 - s \Omega_{uu}`; its farthest point is the honest error. For
    a strong instrument :math:`s \Omega_{uu} \to 0` and the factor is one. Where the disk is unbounded the data say
    nothing, and the factor is a thousand.

    Parameters
    ----------
    variance
        :math:`s S_{vv}` of the linear formula, any shape.
    noise
        :math:`S_{vv}`, same shape.
    input_noise
        :math:`\Omega_{uu}`, the density of the input that the instruments do not explain, same shape.
    input_residual
        :math:`S_{uv}`, same shape.

    References
    ----------
    E. C. Fieller, *Some Problems in Interval Estimation*, Journal of the Royal Statistical Society B 16, 1954;
    T. W. Anderson and H. Rubin, *Estimation of the Parameters of a Single Equation in a Complete System of Stochastic
    Equations*, Annals of Mathematical Statistics 20, 1949.

    Examples
    --------
    An instrument that explains the whole input, and one that explains as much as noise does:

    >>> half = np.array([0.5])
    >>> float(weak_instrument_factor(half, half, np.array([0.0]), np.array([0j]))[0])
    1.0
    >>> float(weak_instrument_factor(half, half, np.array([1.0]), np.array([0j]))[0])
    1000.0
    """
    scale = variance / noise
    strength = 1.0 - scale * input_noise
    bounded = np.maximum(strength, _LEAST_STRENGTH)
    center = scale * np.abs(input_residual) / bounded
    farthest = center + np.sqrt(center**2 + variance / bounded)
    factor = np.where(strength > _LEAST_STRENGTH, farthest / np.sqrt(variance), _LARGEST_FACTOR)
    return np.asarray(np.clip(factor, 1.0, _LARGEST_FACTOR))
