"""A delay as a whole number of samples, as toolboxes estimate it: for comparison with published numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import InsufficientDataError
from rotorid.typing import FloatArray

_ORDER = 2
_NEGLIGIBLE = 4.0
_ROUNDING = 1e-20
_NOTHING = 1e-300
_ENOUGH = 20_000
"""Predictions that are compared; of longer records some are left out, evenly spread."""


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
    losses = _losses(inputs, outputs, tried)
    if losses.size == 0 or not np.isfinite(losses).any():
        raise InsufficientDataError(
            "the records are shorter than the delays to try", needed=f"more than {most + 3 * _ORDER + 8} samples"
        )
    samples = min(sum(y.size for y in outputs), _ENOUGH)
    # A model whose first coefficient of the input is zero predicts as well with a delay of one sample less.
    alike = np.flatnonzero(losses <= losses.min() * (1.0 + _NEGLIGIBLE / samples) + _ROUNDING)
    return list(tried)[int(alike[-1])]


def _losses(inputs: Sequence[FloatArray], outputs: Sequence[FloatArray], tried: range) -> FloatArray:
    """Sum of squared one-step errors for each delay, over the samples that all delays can predict."""
    least, most = tried.start + 1, tried.stop
    step = 1 + sum(y.size for y in outputs) // _ENOUGH
    spans = [np.arange(max(most, 0) + _ORDER, y.size + min(least, 0), step) for y in outputs]
    if sum(k.size for k in spans) <= 2 * _ORDER:
        return np.full(len(tried), np.inf)
    past = np.concatenate([np.stack([y[k - 1], y[k - 2]], axis=1) for y, k in zip(outputs, spans, strict=True)])
    own = np.linalg.qr(past)[0]

    def beyond(signals: Sequence[FloatArray], lag: int) -> FloatArray:
        """What the past of the output does not tell of a late signal."""
        late = np.concatenate([signal[k - lag] for signal, k in zip(signals, spans, strict=True)])
        return np.asarray(late - own @ (own.T @ late))

    target, losses, here = beyond(outputs, 0), [], beyond(inputs, least)
    for delay in tried:
        before, here = here, beyond(inputs, delay + 2)
        left = _without(target, before)
        left = _without(left, _without(here, before))
        losses.append(float(left @ left))
    return np.array(losses)


def _without(values: FloatArray, other: FloatArray) -> FloatArray:
    """What is left of ``values`` beside ``other``; all of them where the other is nothing but rounding."""
    power = float(other @ other)
    return values - other * (float(other @ values) / power) if power > _NOTHING else values
