"""A delay as a whole number of samples, as toolboxes estimate it: for comparison with published numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.fit.regression import regress
from rotorid.typing import FloatArray

_ORDER = 2
_NEGLIGIBLE = 4.0
_ROUNDING = 1e-20


def delay_in_samples(inputs: Sequence[FloatArray], outputs: Sequence[FloatArray], *, least: int, most: int) -> int:
    r"""Delay of the ARX model of second order that predicts best.

    .. math:: y_k + a_1 y_{k-1} + a_2 y_{k-2} = b_1 u_{k-d} + b_2 u_{k-d-1} + e_k

    This is what ``delayest`` of MATLAB's System Identification Toolbox does with its defaults; of delays that predict
    alike the longest is taken. A held input acts on a
    sampled output one sample later at the earliest, so :math:`d = 1` means no delay, and :math:`d - 1` is returned.
    Noise on the output makes the ARX model prefer the delay that suits its one-step prediction, not the vehicle's.

    Parameters
    ----------
    inputs, outputs
        One array of samples for each record.
    least, most
        Delays to try, in samples; negative ones look for outputs that run ahead.

    Raises
    ------
    InsufficientDataError
        No record is long enough.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> u, y = rng.choice([-1.0, 1.0], size=300), np.zeros(300)
    >>> for k in range(5, 300):
    ...     y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 4] + 0.01 * rng.normal()
    >>> delay_in_samples([u], [y], least=0, most=8)
    3
    """
    tried = range(least, most + 1)
    losses = [_loss(inputs, outputs, delay + 1, least + 1, most + 1) for delay in tried]
    if not losses or not np.isfinite(losses).any():
        raise InsufficientDataError(
            "the records are shorter than the delays to try", needed=f"more than {most + 3 * _ORDER + 8} samples"
        )
    samples = sum(y.size for y in outputs)
    # A model whose first coefficient of the input is zero predicts as well with a delay of one sample less.
    alike = np.flatnonzero(np.asarray(losses) <= min(losses) * (1.0 + _NEGLIGIBLE / samples) + _ROUNDING)
    return list(tried)[int(alike[-1])]


def _loss(inputs: Sequence[FloatArray], outputs: Sequence[FloatArray], d: int, least: int, most: int) -> float:
    """Sum of squared one-step errors over the samples that all delays can predict."""
    rows, targets = [], []
    for u, y in zip(inputs, outputs, strict=True):
        first, last = max(most, 0) + _ORDER, y.size + min(least, 0)
        k = np.arange(first, last)
        if k.size:
            rows.append(np.stack([-y[k - 1], -y[k - 2], u[k - d], u[k - d - 1]], axis=1))
            targets.append(y[k])
    if not rows:
        return np.inf
    try:
        fit = regress(np.concatenate(rows), np.concatenate(targets), ("a1", "a2", "b1", "b2"), ordered=False)
    except InsufficientDataError:
        return np.inf
    return float(fit.residual @ fit.residual)
