"""Frequency responses from time histories: the one public verb of this layer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.spectral.composite import PairSpectra, compose_by_least_squares, compose_by_weights, window_weights
from rotorid.spectral.conditioning import Conditioned, condition
from rotorid.spectral.errors import influence, overlap_constant, random_error, response_covariance, smear
from rotorid.spectral.kernel import BlockGrid
from rotorid.spectral.preconditions import require_finite, require_motion, require_windows
from rotorid.spectral.spectra import SpectralMatrix, spectral_matrices
from rotorid.spectral.windows import HALF_SINE, Taper
from rotorid.typing import ComplexArray, FloatArray

Composition: TypeAlias = Literal["least_squares", "weights"]

_SMOOTHING_POINTS = 2
_MOMENTS_IN_WINDOW = 5
_LARGEST_PUBLISHED_ERROR = 1e3


def frequency_response(
    records: Sequence[TimeHistory],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    instruments: Sequence[str] = (),
    overlap: float = 0.8,
    taper: Taper = HALF_SINE,
    composition: Composition = "least_squares",
) -> FrequencyResponse:
    r"""Composite-window frequency responses, direct or joint input–output.

    Without instruments the direct estimate :math:`G_{xx}^{-1} G_{xy}`; with one instrument for each input the joint
    estimate :math:`G_{ru}^{-1} G_{ry}`, which feedback does not bias. Every window length gives an estimate with its
    error; the composite weighs them by :math:`\varepsilon^{-4}` at each frequency.

    Parameters
    ----------
    records
        Maneuvers with the same channels and rate.
    inputs, outputs, instruments
        Channel names. Instruments must excite the inputs and contain no feedback; nothing here can prove that they
        do not.
    omega_rad_s
        Rising grid, shape ``(f,)``. Points below two periods of the longest window are left out.
    windows_s
        Window lengths. One that fits into the records at no more positions than there are inputs is left out.
    overlap, taper
        How windows overlap and fade.
    composition
        ``least_squares`` over spectra and coherence, or the weighted mean from which it starts.

    Returns
    -------
    FrequencyResponse
        Values, coherence, random error and covariance between frequencies.

    Raises
    ------
    UsageError
        Channels are missing or instruments do not match the inputs.
    InsufficientDataError
        Too few windows fit into the records, a channel is constant or holds samples that are not finite, or the
        inputs are proportional to each other.

    Notes
    -----
    A direct estimate in closed loop is biased toward the inverse of the controller wherever the disturbance rules,
    *with high coherence*. The joint one is not, as long as instrument and output stay coherent (above 0.3 or so).

    References
    ----------
    Tischler and Remple, *Aircraft and Rotorcraft System Identification*, chapters 7, 9 and 10.

    Examples
    --------
    >>> from rotorid.data.channel import Channel
    >>> u = np.random.default_rng(0).standard_normal(6000)
    >>> record = TimeHistory(
    ...     values=np.stack([u, 2.0 * u]), sample_rate_hz=100.0, start_s=0.0,
    ...     channels=(Channel(name="roll_command", unit="1"), Channel(name="p", unit="rad/s")),
    ... )
    >>> response = frequency_response(
    ...     [record], inputs=["roll_command"], outputs=["p"],
    ...     omega_rad_s=np.geomspace(3.0, 30.0, 5), windows_s=[8.0, 4.0],
    ... )
    >>> np.abs(response.values[0, 0]).round(6)
    array([2., 2., 2., 2., 2.])
    """
    drivers = tuple(instruments) or tuple(inputs)
    if len(drivers) != len(inputs):
        raise UsageError(f"{len(drivers)} instruments for {len(inputs)} inputs came", needed="one for each input")
    names = tuple(dict.fromkeys([*drivers, *inputs, *outputs]))
    chosen = [_select(record, names) for record in records]
    require_finite(chosen)
    require_motion(chosen)
    fitting, grid = spectral_matrices(chosen, omega_rad_s, windows_s=windows_s, overlap=overlap, taper=taper)
    # As many inputs as windows explain any output perfectly: coherence one, error zero, and nothing behind it.
    matrices = tuple(matrix for matrix in fitting if len(matrix.transforms) > len(inputs))
    require_windows(matrices, chosen, windows_s)
    omega = max((matrix.omega_rad_s for matrix in matrices), key=len)
    blocks = sum(record.values.shape[1] // grid.samples_per_block for record in chosen)
    composer = _Composer(matrices, omega, grid, blocks, overlap, taper, composition)
    rows = {name: index for index, name in enumerate(names)}
    driver_rows, input_rows = [rows[name] for name in drivers], [rows[name] for name in inputs]
    parts = [composer.responses(driver_rows, input_rows, rows[output]) for output in outputs]
    values, coherence, error, covariance = (np.stack(arrays) for arrays in zip(*parts, strict=True))
    return FrequencyResponse(
        omega_rad_s=omega,
        values=values,
        coherence=coherence,
        random_error=error,
        covariance=covariance,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        estimate="joint" if instruments else "direct",
        instruments=tuple(instruments),
        windows_s=tuple(matrix.window_s for matrix in matrices),
    )


class _Composer:
    """Composes one output at a time; holds what all of them share."""

    def __init__(
        self,
        matrices: Sequence[SpectralMatrix],
        omega_rad_s: FloatArray,
        grid: BlockGrid,
        blocks: int,
        overlap: float,
        taper: Taper,
        composition: Composition,
    ) -> None:
        self.matrices = matrices
        self.omega_rad_s = omega_rad_s
        self.grid = grid
        self.blocks = blocks
        self.overlap = overlap
        self.taper = taper
        self.compose = compose_by_least_squares if composition == "least_squares" else compose_by_weights
        # Least squares weigh the windows once, the weighted mean by the squares of the same weights.
        self.weight_power = 1 if composition == "least_squares" else 2
        # Little overlap makes long blocks, in which the taper would be seen too seldom for a variance.
        self.moments = math.ceil(_MOMENTS_IN_WINDOW / min(matrix.window.blocks for matrix in matrices))
        # Grids of shorter windows are tails of the longest one's.
        self.valid = np.stack([omega_rad_s >= matrix.omega_rad_s[0] for matrix in matrices])

    def responses(
        self, instruments: Sequence[int], inputs: Sequence[int], output: int
    ) -> tuple[ComplexArray, FloatArray, FloatArray, ComplexArray]:
        """Values, coherence, error and covariance of one output to every input."""
        parts = [condition(m, instruments=instruments, inputs=inputs, output=output) for m in self.matrices]
        direct = list(instruments) == list(inputs)
        columns = [self._one(parts, index, direct) for index in range(len(inputs))]
        values, coherence, error, covariance = (np.stack(arrays) for arrays in zip(*columns, strict=True))
        return values, coherence, error, covariance

    def _one(
        self, parts: Sequence[Conditioned], index: int, direct: bool
    ) -> tuple[ComplexArray, FloatArray, FloatArray, ComplexArray]:
        power = self._padded([part.input_power[index] for part in parts], 1.0)
        response = self._padded([part.response[index] for part in parts], 1.0)
        noise = self._padded([self._unbiased(part, m) for part, m in zip(parts, self.matrices, strict=True)], 1.0)
        pairs = PairSpectra(
            input_auto=power.real, output_auto=np.abs(response) ** 2 * power.real + noise.real, cross=response * power
        )
        averages = np.array([matrix.averages for matrix in self.matrices])[:, None]
        random = random_error(pairs.coherence, averages, overlap=self.overlap)
        lengths = np.array([matrix.window_s for matrix in self.matrices])[:, None]
        weights = window_weights(np.hypot(random, smear(self.omega_rad_s, lengths)), self.valid)
        total = self.compose(pairs, weights)
        share = weights**self.weight_power * pairs.input_auto
        share = share / share.sum(axis=0)
        covariance = self._covariance(parts, index, share, _smooth(np.sum(share * noise.real, axis=0)))
        spread = np.sqrt(0.5 * np.einsum("ff->f", covariance).real) / np.abs(total.response)
        coherence = total.coherence
        if not direct:
            seen = self._padded([part.instrument_coherence[index] for part in parts], 0.0).real
            coherence = np.sum(share * seen, axis=0)
        error = np.minimum(spread, _LARGEST_PUBLISHED_ERROR)
        return total.response, np.clip(coherence, 0.0, 1.0), error, covariance

    def _unbiased(self, part: Conditioned, matrix: SpectralMatrix) -> FloatArray:
        """The noise with the freedom given back that estimating the response took from it."""
        freedom = matrix.averages / overlap_constant(self.overlap) ** 2
        used = len(part.response)
        return np.asarray(part.noise * freedom / max(freedom - used, 0.5))

    def _padded(self, arrays: Sequence[FloatArray | ComplexArray], fill: float) -> ComplexArray:
        padded = np.full((len(arrays), self.omega_rad_s.size), fill, dtype=np.complex128)
        for row, array in zip(padded, arrays, strict=True):
            row[row.size - array.size :] = array
        return padded

    def _covariance(
        self, parts: Sequence[Conditioned], index: int, share: FloatArray, noise: FloatArray
    ) -> ComplexArray:
        influences = []
        for row, part, matrix in zip(share, parts, self.matrices, strict=True):
            here = influence(matrix, part.projection[index], blocks=self.blocks, taper=self.taper, moments=self.moments)
            full = np.zeros((self.omega_rad_s.size, self.blocks * self.moments), dtype=np.complex128)
            full[self.omega_rad_s.size - len(here) :] = here
            influences.append(row[:, None] * full)
        return response_covariance(influences, self.omega_rad_s, noise, self.grid.block_s / self.moments)


def _smooth(noise: FloatArray) -> FloatArray:
    """Geometric mean over neighboring points: a density from few windows scatters more than it varies."""
    reach = _SMOOTHING_POINTS
    padded = np.pad(np.log(noise), reach, mode="edge")
    kernel = np.full(2 * reach + 1, 1.0 / (2 * reach + 1))
    return np.asarray(np.exp(np.convolve(padded, kernel, mode="valid")))


def _select(record: TimeHistory, names: Sequence[str]) -> TimeHistory:
    missing = [name for name in names if name not in record.names]
    if missing:
        raise UsageError(
            f"there is no channel {', '.join(missing)} in the data", needed=f"one of {', '.join(record.names)}"
        )
    rows = [record.names.index(name) for name in names]
    return TimeHistory(
        values=record.values[rows],
        channels=tuple(record.channels[row] for row in rows),
        sample_rate_hz=record.sample_rate_hz,
        start_s=record.start_s,
        processing=record.processing,
    )
