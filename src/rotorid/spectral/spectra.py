"""Cross-spectra of every pair of channels, window length by window length, of records that can support an estimate.

What data cannot support (samples that are not finite, a channel that never moves, a record shorter than its windows) is
refused with its name, before anything is computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import refusal
from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.spectral.kernel import BandBasis, BlockGrid, BlockWindow, band_basis, compress, transform
from rotorid.spectral.windows import HANN, PERIODS_IN_WINDOW, Taper, require_grid
from rotorid.typing import ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralMatrix(Immutable):
    r"""One-sided spectral densities of all pairs of channels, from windows of one length.

    .. math:: S_{ab}(\omega) = \frac{2}{f_s \sum w^2} \, \frac1K \sum_k A_k^*(\omega) B_k(\omega)

    Parameters
    ----------
    omega_rad_s
        Frequencies at which windows of this length count, shape ``(f,)``.
    values
        Densities in unit²/Hz, shape ``(f, channels, channels)``, Hermitian.
    channels
        Names of rows and columns.
    window_s
        Length of the windows.
    averages
        Independent windows, :math:`n_d = T_F / T_{win}`.
    transforms
        The transforms behind the densities, shape ``(positions, kept, f)``, scaled so that their products are
        densities; phases refer to the start of each window. Those of the first channels, as many as were kept.
    starts
        First block of each position, shape ``(positions,)``, counted over all records.
    window
        Length and hop in blocks.
    """

    omega_rad_s: FloatArray
    values: ComplexArray
    channels: tuple[str, ...]
    window_s: float
    averages: float
    transforms: ComplexArray
    starts: FloatArray
    window: BlockWindow

    def __post_init__(self) -> None:
        self._set(
            omega_rad_s=read_only(self.omega_rad_s, np.float64, ndim=1),
            values=read_only(self.values, np.complex128, ndim=3),
            transforms=read_only(self.transforms, np.complex128, ndim=3),
            starts=read_only(self.starts, np.int64, ndim=1),
            channels=tuple(self.channels),
        )

    @property
    def line_rad_s(self) -> float:
        """Width of a spectral line, 2 π over the length: frequencies that are closer share their data."""
        return 2.0 * np.pi / self.window_s

    def block(self, rows: Sequence[int], columns: Sequence[int]) -> ComplexArray:
        """Densities between two groups of channels, shape ``(f, rows, columns)``."""
        return self.values[:, list(rows)][:, :, list(columns)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectra(Immutable):
    """All that an estimate needs of records: their spectral matrices, and how the records were cut into windows.

    Parameters
    ----------
    matrices
        One for each window length, longest first; each knows its own frequencies, a tail of those of the longest.
    grid, blocks
        How the records were cut, and into how many blocks.
    overlap, taper
        How windows overlap and fade.
    """

    matrices: tuple[SpectralMatrix, ...]
    grid: BlockGrid
    blocks: int
    overlap: float
    taper: Taper

    @property
    def windows_s(self) -> tuple[float, ...]:
        """Lengths of the windows."""
        return tuple(matrix.window_s for matrix in self.matrices)

    @property
    def omega_rad_s(self) -> FloatArray:
        """Every frequency at which at least one window length counts, shape ``(f,)``."""
        return max((matrix.omega_rad_s for matrix in self.matrices), key=len)


def record_spectra(
    records: Sequence[TimeHistory],
    omega_rad_s: FloatArray,
    *,
    inputs: Sequence[str],
    windows_s: Sequence[float],
    overlap: float = 0.8,
    taper: Taper = HANN,
    slopes: bool = True,
    kept: int | None = None,
    within: float = math.inf,
) -> Spectra:
    """Spectra of records from which a response to ``inputs`` can be estimated.

    Parameters
    ----------
    records, omega_rad_s, windows_s, overlap, taper, kept, within
        As for :func:`spectral_matrices`.
    inputs
        Of the response. As many inputs as windows explain any output perfectly, coherence one and error zero with
        nothing behind it, so a window length that fits at no more positions than there are inputs is left out.
    slopes
        Whether the inputs are transformed with the slope of the taper too, so that leakage can be taken out.

    Raises
    ------
    UsageError
        As for :func:`spectral_matrices`.
    InsufficientDataError
        No window length is left.
    """
    matrices, grid = spectral_matrices(
        records,
        omega_rad_s,
        windows_s=sorted(windows_s, reverse=True),
        overlap=overlap,
        taper=taper,
        slopes_of=tuple(inputs) if slopes else (),
        kept=kept,
        within=within,
    )
    matrices = tuple(matrix for matrix in matrices if len(matrix.transforms) > len(inputs))
    _require_windows(matrices, records, windows_s)
    return Spectra(
        matrices=matrices,
        grid=grid,
        blocks=sum(record.values.shape[1] // grid.samples_per_block for record in records),
        overlap=overlap,
        taper=taper,
    )


def spectral_matrices(
    records: Sequence[TimeHistory],
    omega_rad_s: FloatArray,
    *,
    windows_s: Sequence[float],
    overlap: float = 0.8,
    taper: Taper = HANN,
    slopes_of: Sequence[str] = (),
    kept: int | None = None,
    within: float = math.inf,
) -> tuple[tuple[SpectralMatrix, ...], BlockGrid]:
    """Spectral matrices of several records together, one for each window length.

    Every record is used without its mean. No window straddles two records. Lengths are rounded to whole blocks (a
    fifth of the shortest window at 80 % overlap, or a part of it, see ``within``); the lengths really used stand in the
    results. A window length counts only where it holds two periods, and lengths for which no record is long enough are
    left out.

    Parameters
    ----------
    records
        Maneuvers with the same channels and one sample rate.
    omega_rad_s
        Rising grid, shape ``(f,)``, below the Nyquist frequency.
    windows_s
        Window lengths.
    overlap, taper
        How windows overlap and fade.
    slopes_of
        Channels that are transformed once more with the slope of the taper, :math:`w'(t)` in 1/s. They stand last in
        the matrices, under names from :func:`slope_name`; `rotorid.spectral.conditioning` wants them.
    kept
        Of how many channels, the first ones, the matrices keep the transforms; of all, if nothing is said. Those of
        many channels over hours of flight fill the memory.
    within
        How far a window may be from its length, as a share, where finer blocks come that close.

    Raises
    ------
    UsageError
        The records differ in channels or rate, the grid does not rise from above zero to at most the Nyquist
        frequency, there are no records or windows, or windows overlap by less than nothing or wholly.
    """
    _require_consistent(records, windows_s, overlap)
    require_grid(omega_rad_s, records[0].sample_rate_hz)
    first = records[0]
    grid = BlockGrid.for_windows(windows_s, overlap, first.sample_rate_hz, within=within)
    basis = band_basis(grid, omega_rad_s[-1] + 2.0 * np.pi / min(windows_s))
    compressed = [
        compress(record.values - record.values.mean(axis=1, keepdims=True), grid, basis) for record in records
    ]
    matrices = []
    for window in dict.fromkeys(grid.window(length, overlap) for length in windows_s):
        # A hair of tolerance, so that a grid that begins where the longest window does keeps its first point.
        lowest = PERIODS_IN_WINDOW * 2.0 * np.pi / (window.blocks * grid.block_s) * (1.0 - 1e-9)
        valid = omega_rad_s[omega_rad_s >= lowest]
        if valid.size and any(window.positions(part.shape[1]) for part in compressed):
            matrices.append(_one_window(compressed, window, valid, grid, basis, taper, slopes_of, first.names, kept))
    return tuple(matrices), grid


def slope_name(channel: str) -> str:
    """What a matrix calls the transform of a channel with the slope of the taper."""
    return f"slope of the taper on {channel}"


def _one_window(
    compressed: Sequence[FloatArray],
    window: BlockWindow,
    omega_rad_s: FloatArray,
    grid: BlockGrid,
    basis: BandBasis,
    taper: Taper,
    slopes_of: Sequence[str],
    names: tuple[str, ...],
    kept: int | None,
) -> SpectralMatrix:
    offsets = np.cumsum([0, *(part.shape[1] for part in compressed)])
    used = [index for index, part in enumerate(compressed) if window.positions(part.shape[1])]
    window_s = window.blocks * grid.block_s
    rows = [names.index(name) for name in slopes_of]
    channels = (*names, *(slope_name(name) for name in slopes_of))
    scale = np.sqrt(2.0 / (grid.sample_rate_hz * window.blocks * grid.samples_per_block * taper.mean_square))
    values = np.zeros((omega_rad_s.size, len(channels), len(channels)), dtype=np.complex128)
    counts = [window.positions(compressed[index].shape[1]) for index in used]
    ends = np.cumsum(counts)
    transforms = np.empty((omega_rad_s.size, len(channels[:kept]), ends[-1]), dtype=np.complex128).transpose(2, 1, 0)
    for index, count, end in zip(used, counts, ends, strict=True):
        blocks = compressed[index]
        part = transform(blocks, window, omega_rad_s, grid=grid, basis=basis, taper=taper)
        if rows:
            slopes = transform(blocks[rows], window, omega_rad_s, grid=grid, basis=basis, taper=taper.slope)
            part = np.concatenate([part, slopes / window_s], axis=1)
        part *= scale
        # Frequencies first, as `transform` lays them out: the products below then run over adjacent numbers.
        by_frequency = part.transpose(2, 1, 0)
        values += by_frequency.conj() @ by_frequency.swapaxes(1, 2)
        transforms[end - count : end] = part[:, :kept]
    return SpectralMatrix(
        omega_rad_s=omega_rad_s,
        values=values / ends[-1],
        channels=channels,
        window_s=window_s,
        averages=sum(compressed[i].shape[1] for i in used) / window.blocks,
        transforms=transforms,
        starts=np.concatenate([offsets[i] + window.hop * np.arange(n) for i, n in zip(used, counts, strict=True)]),
        window=window,
    )


def _require_consistent(records: Sequence[TimeHistory], windows_s: Sequence[float], overlap: float) -> None:
    if not records or not windows_s or not all(0.0 < length < np.inf for length in windows_s):
        raise UsageError(
            f"got {len(records)} records and {len(windows_s)} window lengths",
            needed="at least one record and one window length, all of them positive and finite",
        )
    if not 0.0 <= overlap < 1.0:
        raise UsageError(f"got an overlap of {overlap:g}", needed="a share of a window from 0 to below 1")
    first = records[0]
    if any(record.names != first.names or record.sample_rate_hz != first.sample_rate_hz for record in records):
        raise UsageError("the records have different channels or rates", needed="one set of channels at one rate")


def require_finite(records: Sequence[TimeHistory]) -> None:
    """Refuse samples that are not numbers: one of them would spread over every frequency.

    Raises
    ------
    InsufficientDataError
        With the finding ``gap``.
    """
    for record in records:
        for name, samples in zip(record.names, record.values, strict=True):
            missing = int(np.count_nonzero(~np.isfinite(samples)))
            if missing:
                message = f"{name} has {missing} samples that are not finite numbers."
                raise InsufficientDataError(
                    f"got {name} with {missing} samples that are not finite numbers",
                    needed="a record without gaps",
                    remedy="cut the segment around them",
                    findings=[refusal("gap", name, message, samples=missing)],
                )


def require_motion(records: Sequence[TimeHistory]) -> None:
    """Refuse channels that never change.

    Raises
    ------
    InsufficientDataError
        With the finding ``no_excitation``.
    """
    for row, name in enumerate(records[0].names):
        # The mean of a constant is off by a rounding error, so its spectrum would not be exactly zero.
        if all(record.values.shape[1] == 0 or np.ptp(record.values[row]) == 0.0 for record in records):
            raise InsufficientDataError(
                f"{name} is constant over the whole maneuver",
                needed="a channel that moves",
                remedy="check the wiring of the log and the segment",
                findings=[refusal("no_excitation", name, f"{name} never moves.")],
            )


def _require_windows(
    matrices: Sequence[SpectralMatrix], records: Sequence[TimeHistory], windows_s: Sequence[float]
) -> None:
    """Refuse records in which no window that supports the band fits often enough."""
    if matrices:
        return
    longest, shortest = max(record.duration_s for record in records), min(windows_s)
    raise InsufficientDataError(
        f"got records of at most {longest:.3g} s",
        needed=f"two periods of the band inside windows of {shortest:.3g} s and more, and several such windows",
        remedy="give longer segments, shorter windows or a higher band",
        findings=[
            refusal(
                "record_too_short",
                "record",
                f"No window of {shortest:.3g} s and more supports the band on a record of {longest:.3g} s.",
                record_s=longest,
                window_s=shortest,
            )
        ],
    )
