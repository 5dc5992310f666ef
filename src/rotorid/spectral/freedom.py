r"""How much of a disturbance is left in the residuals of a window length.

A response that is estimated from K windows fits a part of the disturbance too. With the transforms of the instruments
over the windows spanning the space of the projection P, and N the correlation that overlapping tapers give the
transforms of a white disturbance,

.. math:: E[\hat S_{vv}] = S_{vv} \left( 1 - \frac{\mathrm{tr}(P N)}{K} \right)

Of many short windows next to nothing is lost. Of a few long ones that overlap, most is: five windows of 72 s on a
record of 120 s are hardly two.
"""

from __future__ import annotations

import numpy as np

from rotorid.spectral.conditioning import Separated
from rotorid.spectral.windows import Taper
from rotorid.typing import FloatArray

_FINE = 64
_LEAST_LEFT = 0.05
"""Below that too little is left to say how large the whole was."""


def residual_share(window: Separated, taper: Taper) -> FloatArray:
    """Share of the power of a disturbance that the residuals of one window length still hold, shape ``(f,)``.

    Parameters
    ----------
    window
        Inputs told apart; its instruments span what is fitted.
    taper
        That of the windows.
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


def _overlap(taper: Taper, shift: int, blocks: int) -> float:
    """Correlation of the transforms of a white disturbance in two windows that begin ``shift`` blocks apart."""
    samples = taper.samples(_FINE * blocks)
    ahead = _FINE * shift
    return float(np.sum(samples[ahead:] * samples[: samples.size - ahead]) / np.sum(samples**2))
