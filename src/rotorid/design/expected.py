r"""The frequency response that a planned flight is expected to show, with its coherence and its errors.

Every estimate is made of spectra. Those of a planned flight are the sum of two: what the test inputs move, known as a
history, because a sweep is a passing thing and no stationary noise, and what gusts and noise make of the loop,

.. math:: S_{ab} = \frac1K \sum_k A_k^* B_k + N_{ab}

with the transforms of the history in every window. From there on the estimator itself is asked what it would answer and
how sure it would be: told apart, cleared of leakage, joined over the windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.design.foreseen import foreseen_flight, loop_rows
from rotorid.design.loop import LoopModel
from rotorid.design.planned import Planned
from rotorid.spectral.composer import Composer
from rotorid.spectral.conditioning import OutputSpectra, output_spectra, separate
from rotorid.spectral.disturbances import disturbance_of, output_correlation
from rotorid.spectral.grid import refined
from rotorid.spectral.leakage import derivatives, line_variance, without_leakage
from rotorid.spectral.preconditions import require_windows
from rotorid.spectral.spectra import SpectralMatrix, spectral_matrices
from rotorid.spectral.windows import HANN
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_OVERLAP = 0.8
_BEYOND = 3.0
"""How far beyond the highest frequency the loop is followed: what is faster does not leak that far."""


class _Foreseen(Composer):
    """A composer of expected spectra: nothing was fitted to them, so they hold the whole disturbance."""

    @property
    def left(self) -> tuple[FloatArray, ...]:
        return tuple(np.ones(window.matrix.omega_rad_s.size) for window in self.windows)


def expected_response(
    loop: LoopModel,
    planned: Planned,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    joint: bool = True,
) -> FrequencyResponse:
    """What :func:`rotorid.spectral.estimate.frequency_response` is expected to answer.

    Parameters
    ----------
    loop
        What will fly.
    planned
        Its test inputs as they will be cut, the instruments of ``inputs`` first.
    inputs, outputs
        Channels of the response.
    omega_rad_s, windows_s
        As for the estimate.
    joint
        Whether the test inputs are the instruments, or the commands their own.

    Raises
    ------
    InsufficientDataError
        Too few windows fit into the records.

    Notes
    -----
    Estimates of few windows scatter about their expectation, coherence included; that of a coherence near zero is
    somewhat higher. Noise is taken as smooth over the line of a window, and what is known of leakage as known from
    expected responses: in flight it is known a little worse.
    """
    fine_rad_s, asked = refined(omega_rad_s)
    names = (*inputs, *outputs)
    records = planned.records(foreseen_flight(loop, planned, names, highest_rad_s=_BEYOND * omega_rad_s[-1]))
    flown, grid = spectral_matrices(
        records,
        fine_rad_s,
        windows_s=sorted(windows_s, reverse=True),
        overlap=_OVERLAP,
        taper=HANN,
        slopes_of=inputs,
    )
    flown = tuple(matrix for matrix in flown if len(matrix.transforms) > len(inputs))
    require_windows(flown, records, windows_s)
    sources = len(planned.axes)
    moved = loop.logged_noise(fine_rad_s)[np.ix_(loop_rows(loop, names), loop_rows(loop, names))]
    noise = np.moveaxis(moved, -1, 0).conj()
    matrices = [_expected(matrix, noise, sources, len(inputs)) for matrix in flown]
    input_rows = list(range(sources, sources + len(inputs)))
    drivers = list(range(len(inputs))) if joint else input_rows
    if not joint:
        matrices = [_self_excited(one, alone) for one, alone in zip(matrices, flown, strict=True)]
    composer = _Foreseen(
        windows=[separate(matrix, instruments=drivers, inputs=input_rows) for matrix in matrices],
        omega_rad_s=max((matrix.omega_rad_s for matrix in matrices), key=len),
        grid=grid,
        blocks=sum(record.values.shape[1] // grid.samples_per_block for record in records),
        overlap=_OVERLAP,
        taper=HANN,
        corrected=True,
        composition="minimum_variance",
    )
    instruments = records[0].names[: len(inputs)] if joint else ()
    return _composed(composer, asked, inputs=inputs, outputs=outputs, instruments=instruments)


def _expected(matrix: SpectralMatrix, noise: ComplexArray, sources: int, inputs: int) -> SpectralMatrix:
    """A spectral matrix of the history with what gusts and noise add, and of the inputs what they add to slopes."""
    here = noise[len(noise) - matrix.omega_rad_s.size :]
    values = matrix.values.copy()
    moved = slice(sources, sources + noise.shape[1])
    values[:, moved, moved] += here
    values[:, -inputs:, -inputs:] += line_variance(HANN, matrix.window_s) * here[:, :inputs, :inputs]
    return replace(matrix, values=values)


def _self_excited(matrix: SpectralMatrix, history: SpectralMatrix) -> SpectralMatrix:
    """The matrix for channels that are their own instruments, and are excited by what they do anyhow, too."""
    whole, planned = (np.einsum("fcc->cf", part.values).real for part in (matrix, history))
    scale = np.sqrt(whole / np.where(planned > 0.0, planned, whole))
    return replace(matrix, transforms=matrix.transforms * scale)


def _respond(composer: Composer, row: int, inputs: Sequence[int]) -> list[OutputSpectra]:
    """Densities of one output without what windows add to it, known from a first answer that still has it."""
    matrices = [window.matrix for window in composer.windows]
    draft = composer.responses([output_spectra(matrix, row) for matrix in matrices], draft=True)
    corrected = []
    for matrix in matrices:
        points = slice(composer.omega_rad_s.size - matrix.omega_rad_s.size, None)
        slopes = derivatives(
            matrix.omega_rad_s, draft.values[:, points], draft.random_error[:, points], line_rad_s=matrix.line_rad_s
        )
        corrected.append(without_leakage(matrix, output=row, inputs=inputs, derivatives=slopes, taper=HANN))
    return corrected


def _composed(
    composer: Composer,
    asked: BoolArray,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    instruments: Sequence[str],
) -> FrequencyResponse:
    matrices = [window.matrix for window in composer.windows]
    rows = [matrices[0].channels.index(name) for name in outputs]
    columns = [matrices[0].channels.index(name) for name in inputs]
    with np.errstate(divide="ignore", invalid="ignore"):  # an output that an input cannot move has no relative error
        densities = [_respond(composer, row, columns) for row in rows]
        whole = [composer.responses(spectra) for spectra in densities]
    asked = asked[-composer.omega_rad_s.size :]
    parts = [part.at(asked) for part in whole]
    disturbance = disturbance_of(composer.windows, densities, whole, composer.left, asked)
    omega_rad_s = composer.omega_rad_s[asked]
    share = np.mean([part.share for part in whole], axis=0)
    return FrequencyResponse(
        omega_rad_s=omega_rad_s,
        values=np.stack([part.values for part in parts]),
        coherence=np.stack([part.coherence for part in parts]),
        random_error=np.stack([part.random_error for part in parts]),
        covariance=np.stack([part.covariance for part in parts]),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        estimate="joint" if instruments else "direct",
        instruments=tuple(instruments),
        windows_s=tuple(matrix.window_s for matrix in matrices),
        output_correlation=np.stack([output_correlation(disturbance, omega_rad_s)] * len(inputs)),
        input_correlation=composer.input_correlation(share, asked) if len(inputs) > 1 else None,
        disturbance=disturbance,
    )
