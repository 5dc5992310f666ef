"""What stands behind a composite response: which window carries it, what was taken out, how inputs move together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.spectral.composer import Composed
from rotorid.spectral.conditioning import Separated
from rotorid.typing import BoolArray, ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnostics(Immutable):
    r"""Companion of a :class:`~rotorid.data.response.FrequencyResponse`, on its grid.

    Parameters
    ----------
    windows_s
        Window lengths, longest first, as in the response.
    share
        Share of each window in the composite, shape ``(y, u, w, f)``; sums to one over the windows.
    window_error
        Random error of each window alone after the textbook, shape ``(y, u, w, f)``; not a number where it does not
        count.
    multiple_coherence
        Share of each output's power that all inputs together explain, shape ``(y, f)``. For a joint estimate it may
        fall below zero, where feedback makes the explained part and the noise cancel.
    leakage
        What the windows would have added to the response, relative to it, shape ``(y, u, f)``; zero where it was not
        corrected.
    input_coherence
        Coherence between the inputs, shape ``(u, u, f)``.
    condition
        Condition number of the cross-spectra that tell the inputs apart, scaled to unit powers, shape ``(f,)``.
    """

    windows_s: tuple[float, ...]
    share: FloatArray
    window_error: FloatArray
    multiple_coherence: FloatArray
    leakage: ComplexArray
    input_coherence: FloatArray
    condition: FloatArray

    def __post_init__(self) -> None:
        dimensions = {
            "share": 4,
            "window_error": 4,
            "multiple_coherence": 2,
            "input_coherence": 3,
            "condition": 1,
        }
        arrays = {name: read_only(getattr(self, name), np.float64, ndim=ndim) for name, ndim in dimensions.items()}
        self._set(**arrays, leakage=read_only(self.leakage, np.complex128, ndim=3), windows_s=tuple(self.windows_s))


def diagnose(
    windows: Sequence[Separated], parts: Sequence[Composed], leakage: Sequence[ComplexArray], points: BoolArray
) -> Diagnostics:
    """Collect what composing every output told.

    Parameters
    ----------
    windows
        Inputs told apart, for each window length.
    parts
        Composites, one for each output.
    leakage
        What was taken out of each, shape ``(u, f)``.
    points
        Which frequencies of the windows those of the composites are, shape ``(g,)`` with ``f`` of them true.
    """
    return Diagnostics(
        windows_s=tuple(window.matrix.window_s for window in windows),
        share=np.stack([part.share for part in parts]),
        window_error=np.stack([part.window_error for part in parts]),
        multiple_coherence=np.stack([part.multiple_coherence for part in parts]),
        leakage=np.stack(leakage),
        input_coherence=_mean_over_windows(windows, _input_coherence, points.size)[..., points],
        condition=_mean_over_windows(windows, _condition, points.size)[points],
    )


def _mean_over_windows(
    windows: Sequence[Separated], quantity: Callable[[Separated], FloatArray], count: int
) -> FloatArray:
    """Mean over the windows that count at a frequency, each weighed by how often it fits."""
    total, weight = np.zeros(0), np.zeros(count)
    for window in windows:
        values = quantity(window)
        padded = np.zeros((*values.shape[:-1], count))
        padded[..., count - values.shape[-1] :] = values * window.matrix.averages
        total = padded if not total.size else total + padded
        weight[count - values.shape[-1] :] += window.matrix.averages
    return np.asarray(total / weight)


def _input_coherence(window: Separated) -> FloatArray:
    block = window.matrix.block(window.inputs, window.inputs)
    power = np.einsum("fii->fi", block).real
    return np.moveaxis(np.abs(block) ** 2 / (power[:, :, None] * power[:, None, :]), 0, -1)


def _condition(window: Separated) -> FloatArray:
    cross = window.matrix.block(window.instruments, window.inputs)
    rows = np.einsum("fii->fi", window.matrix.block(window.instruments, window.instruments)).real
    columns = np.einsum("fii->fi", window.matrix.block(window.inputs, window.inputs)).real
    singular = np.linalg.svd(cross / np.sqrt(rows[:, :, None] * columns[:, None, :]), compute_uv=False)
    return np.asarray(singular[:, 0] / singular[:, -1])
