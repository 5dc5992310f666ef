r"""Butterworth sections of second order, run forward and backward, without :mod:`scipy.signal`.

A section is the bilinear transform, prewarped, of

.. math:: H(s) = \frac{\omega_c^2}{s^2 + \sqrt{2} \, \omega_c s + \omega_c^2}
   \quad \text{or} \quad \frac{s^2}{s^2 + \sqrt{2} \, \omega_c s + \omega_c^2}

Results are those of :func:`scipy.signal.butter` and :func:`scipy.signal.sosfiltfilt` to the last bit. The import of
:mod:`scipy.signal` takes a third of the time of identifying a model of one axis, and Numba, which runs the recursion
here, half of that and is imported by most fits anyway.

References
----------
Oppenheim and Schafer, *Discrete-Time Signal Processing*, chapter 7; Gustafsson, "Determining the initial states in
forward-backward filtering", IEEE Transactions on Signal Processing 44, 1996.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from rotorid.typing import FloatArray


def section(cutoff: float, shape: Literal["lowpass", "highpass"]) -> FloatArray:
    """A Butterworth filter of second order as coefficients ``b0 b1 b2 1 a1 a2``.

    Parameters
    ----------
    cutoff
        Where the magnitude has fallen by 3 dB, as a share of the Nyquist frequency, between 0 and 1.
    shape
        Which side is kept.

    Examples
    --------
    >>> section(0.5, "lowpass").round(6).tolist()
    [0.292893, 0.585786, 0.292893, 1.0, -0.0, 0.171573]
    """
    rate = 4.0
    warped = rate * np.tan(np.pi * cutoff / 2.0)
    poles = -np.exp(1j * np.pi * np.array([-1.0, 1.0]) / 4.0)
    if shape == "lowpass":
        poles, gain, zero = warped * poles, warped**2 * np.real(1.0 / np.prod(rate - warped * poles)), -1.0
    else:
        scale = np.real(1.0 / np.prod(-poles))
        poles = warped / poles
        gain, zero = scale * np.real(rate**2 / np.prod(rate - poles)), 1.0
    discrete = (rate + poles) / (rate - poles)
    one, other = discrete
    return np.array([gain, -2.0 * zero * gain, gain, 1.0, -(one + other).real, (one * other).real])


def forward_backward(sections: FloatArray, values: FloatArray, padding: int) -> FloatArray:
    """Channels through sections, forward and then backward: no phase, and the magnitude squared.

    Both runs begin settled on their first sample. The signal goes on beyond its ends with its point reflection, so
    that a trend goes on there.

    Parameters
    ----------
    sections
        Rows ``b0 b1 b2 1 a1 a2``.
    values
        Finite samples, shape ``(..., n)``.
    padding
        Samples of the reflection at each end, fewer than ``n``.

    Examples
    --------
    >>> time_s = np.arange(0.0, 10.0, 0.01)
    >>> smooth = forward_backward(section(0.1, "lowpass")[None], np.sin(time_s) + np.sin(300.0 * time_s), 100)
    >>> bool(np.abs(smooth - np.sin(time_s))[100:-100].max() < 1e-3)
    True
    """
    from rotorid.signal.kernels import run_sections

    samples = values.shape[-1]
    flat = np.asarray(values, dtype=np.float64).reshape(-1, samples)
    before = 2 * flat[:, :1] - flat[:, padding:0:-1]
    after = 2 * flat[:, -1:] - flat[:, -2 : -padding - 2 : -1]
    run = np.concatenate([before, flat, after], axis=1)
    settled = _settled(sections)
    for _ in range(2):
        run_sections(sections, run, settled * run[:, :1, None])
        run = np.ascontiguousarray(run[:, ::-1])
    return run[:, padding : padding + samples].reshape(values.shape)


def _settled(sections: FloatArray) -> FloatArray:
    """Memory of each section while the first of them is given a constant one, shape ``(sections, 2)``."""
    memory, level = np.empty((len(sections), 2)), 1.0
    for row, coefficients in zip(memory, sections, strict=True):
        ahead, back = coefficients[:3], coefficients[3:]
        equations = np.array([[1.0 + back[1], -1.0], [back[2], 1.0]])
        row[:] = level * np.linalg.solve(equations, ahead[1:] - back[1:] * ahead[0])
        level *= ahead.sum() / back.sum()
    return memory
