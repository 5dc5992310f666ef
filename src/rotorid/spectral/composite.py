"""Composite windows: long ones for low frequencies, short ones for high, joined by their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.typing import BoolArray, ComplexArray, FloatArray

_COHERENCE_WEIGHT = 5.0
_RIDGE = 1e-9
_ITERATIONS = 30
_LARGEST_STEP = 0.3
_LEAST_SHARE = 0.05
_LARGEST_ERROR = 1e6

SMOOTHING_POINTS = 2
"""Points to either side over which densities of disturbances are averaged."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PairSpectra:
    """Spectra of one input and one output, window by window or composed.

    Parameters
    ----------
    input_auto, output_auto
        One-sided densities, shape ``(windows, f)``, or ``(f,)`` when composed.
    cross
        Cross density, same shape.
    """

    input_auto: FloatArray
    output_auto: FloatArray
    cross: ComplexArray

    @property
    def response(self) -> ComplexArray:
        """:math:`G_{xy} / G_{xx}`."""
        return np.asarray(self.cross / self.input_auto)

    @property
    def coherence(self) -> FloatArray:
        """:math:`|G_{xy}|^2 / (G_{xx} G_{yy})`."""
        return np.asarray(np.abs(self.cross) ** 2 / (self.input_auto * self.output_auto))


def smoothed(values: ComplexArray) -> ComplexArray:
    """Mean over neighboring points along the first axis: what comes from few windows scatters more than it varies."""
    reach = SMOOTHING_POINTS
    padded = np.pad(values, [(reach, reach), *[(0, 0)] * (values.ndim - 1)], mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0).mean(axis=-1))


def window_weights(error: FloatArray, valid: BoolArray) -> FloatArray:
    r"""Weights of the windows at each frequency, :math:`W_i = (\varepsilon_i / \varepsilon_{min})^{-4}`.

    Parameters
    ----------
    error
        Random error of each window, shape ``(windows, f)``.
    valid
        Where a window counts, same shape.
    """
    bounded = np.where(valid, np.clip(error, 1e-12, _LARGEST_ERROR), np.inf)
    return np.asarray((bounded.min(axis=0) / bounded) ** 4)


def minimum_variance_share(covariance: FloatArray, valid: BoolArray) -> FloatArray:
    r"""Shares of the windows that make the error of their mean least, none of them negative.

    .. math:: \min_s \; s^T V s, \qquad \sum_i s_i = 1, \quad s_i \ge 0

    Windows over the same data err together, and the covariance between them tells how much one adds to another. The
    mean never errs by more than the best window alone. Negative shares would win a little more from differences
    between windows, in which their biases do not cancel.

    Parameters
    ----------
    covariance
        :math:`V` of the windows' estimates, real, shape ``(f, windows, windows)``.
    valid
        Where a window counts, shape ``(windows, f)``.

    Returns
    -------
    numpy.ndarray
        Shape ``(windows, f)``.

    Examples
    --------
    Two windows whose errors are independent, and one that the better of two already contains:

    >>> valid = np.ones((2, 1), dtype=bool)
    >>> minimum_variance_share(np.array([[[1.0, 0.0], [0.0, 3.0]]]), valid).ravel().round(6).tolist()
    [0.75, 0.25]
    >>> minimum_variance_share(np.array([[[1.0, 1.2], [1.2, 3.0]]]), valid).ravel().round(6).tolist()
    [1.0, 0.0]
    """
    kept = valid.T.copy()
    diagonal = np.einsum("fww->fw", covariance)
    share = np.zeros_like(diagonal)
    for _ in range(valid.shape[0]):
        # What is left out stands alone with a share of zero on the right-hand side.
        both = kept[:, :, None] & kept[:, None, :]
        scale = np.where(kept, diagonal, np.inf).min(axis=1)[:, None, None]
        system = np.where(both, covariance / scale, 0.0) + np.eye(valid.shape[0]) * (~kept[:, :, None] + _RIDGE)
        share = np.linalg.solve(system, kept[..., None].astype(np.float64))[..., 0]
        share /= share.sum(axis=1, keepdims=True)
        worst = np.argmin(share, axis=1)
        negative = share[np.arange(len(share)), worst] < 0.0
        if not negative.any():
            break
        kept[negative, worst[negative]] = False
    share = np.maximum(share, 0.0)
    return np.asarray((share / share.sum(axis=1, keepdims=True)).T)


def compose_by_weights(pairs: PairSpectra, weights: FloatArray) -> PairSpectra:
    r"""Weighted mean of the windows, :math:`\sum W_i^2 G_i / \sum W_i^2`.

    References
    ----------
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, section 10.2.
    """
    share = weights**2 / np.sum(weights**2, axis=0)
    return PairSpectra(
        input_auto=np.sum(share * pairs.input_auto, axis=0),
        output_auto=np.sum(share * pairs.output_auto, axis=0),
        cross=np.sum(share * pairs.cross, axis=0),
    )


def compose_by_least_squares(pairs: PairSpectra, weights: FloatArray) -> PairSpectra:
    r"""Least-squares composite of the windows, started from the weighted mean.

    Minimizes, at each frequency,

    .. math:: \sum_i W_i \left\{ \left[\tfrac{G_{xx} - G_{xx,i}}{\bar G_{xx}}\right]^2
       + \left[\tfrac{G_{yy} - G_{yy,i}}{\bar G_{yy}}\right]^2
       + \left|\tfrac{G_{xy} - G_{xy,i}}{\bar G_{xy}}\right|^2
       + 5 \left[\tfrac{\gamma^2 - \gamma_i^2}{\bar \gamma^2}\right]^2 \right\}

    The cross-spectrum is scaled by its magnitude: its real and imaginary parts pass through zero.
    """
    start = compose_by_weights(pairs, weights)
    scale = np.stack([start.input_auto, start.output_auto, np.abs(start.cross), np.abs(start.cross)])
    targets = np.stack([pairs.input_auto, pairs.output_auto, pairs.cross.real, pairs.cross.imag]) / scale[:, None]
    x = np.stack([start.input_auto, start.output_auto, start.cross.real, start.cross.imag]) / scale
    ratio = pairs.coherence / start.coherence
    total, sum_ratio = weights.sum(axis=0), np.sum(weights * ratio, axis=0)
    pull = np.sum(weights * targets, axis=1)
    for _ in range(_ITERATIONS):
        power = x[2] ** 2 + x[3] ** 2
        coherence = power / (x[0] * x[1])
        slope = np.stack([-coherence / x[0], -coherence / x[1], 2.0 * x[2] / (x[0] * x[1]), 2.0 * x[3] / (x[0] * x[1])])
        misfit = total * coherence - sum_ratio
        gradient = total * x - pull + _COHERENCE_WEIGHT * slope * misfit
        hessian = np.einsum("if,jf->fij", slope, slope) * (_COHERENCE_WEIGHT * total)[:, None, None]
        hessian += np.eye(4) * total[:, None, None]
        step = np.linalg.solve(hessian, gradient.T[..., None])[..., 0].T
        # Windows of hardly any coherence contradict each other wildly; short steps keep such points near their start.
        x = x - np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        x[:2] = np.maximum(x[:2], _LEAST_SHARE)
        if np.abs(step).max() < 1e-12:
            break
    return PairSpectra(input_auto=x[0] * scale[0], output_auto=x[1] * scale[1], cross=(x[2] + 1j * x[3]) * scale[2])
