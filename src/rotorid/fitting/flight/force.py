r"""Specific force as least squares sees it: columns of coefficients behind the accelerometer's filter, and products.

Every coefficient of the force acts linearly once speeds, velocity and inflow are known, and so does the place of the
accelerometer. Columns of all candidates are worked out once a record, and brought to the sensor's filter in the
frequency domain, where a cut-off is a factor. What then is left of a record are products of columns, axis by axis and
block by block: every structure is a small system of equations.

Assumes that the accelerometer's filter has no phase, where its taps are not known; that what the equations leave is no
larger at times when the motors move (true of gusts, and roughly so of missing terms).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.motion import Motion
from rotorid.models.flight import FORCE_TERMS, Airframe, flight_columns, place_columns, rotor_air
from rotorid.typing import ComplexArray, FloatArray

PLACE = ("x_imu", "y_imu", "z_imu")
"""Where the accelerometer is."""

FILTER_ORDER = 2
"""Of the low-pass, forward and backward, that stands for a filter of the accelerometer that is not known."""

_KEPT_HZ = 25.0
_LEAST_RATE_HZ = 80.0
_TAPER = 0.02
_BLOCK_S = 0.25
_HUBER = 1.345
"""Of the median error: least squares of normal errors lose 5 % by it."""

_SLOWEST_HZ, _BANDS = 0.2, 10
"""Bands in which the spectrum of errors is known."""

_REWEIGHTED, _SETTLED = 20, 1e-4


class Products(NamedTuple):
    """What least squares need, by blocks of a quarter of a second and by axis.

    Parameters
    ----------
    columns
        Products of columns, shape ``(blocks, 3, p, p)``.
    measured
        Products of columns with what was measured, shape ``(blocks, 3, p)``.
    square
        Of what was measured, shape ``(blocks, 3)``.
    samples
        Of each block.
    """

    columns: FloatArray
    measured: FloatArray
    square: FloatArray
    samples: int

    @property
    def blocks(self) -> int:
        return int(self.square.shape[0])

    def part(self, start: int, stop: int) -> Products:
        """Some of the blocks."""
        return Products(self.columns[start:stop], self.measured[start:stop], self.square[start:stop], self.samples)

    def thirds(self) -> list[Products]:
        """Three parts of equal length."""
        ends = np.linspace(0, self.blocks, 4).astype(int).tolist()
        return [self.part(start, stop) for start, stop in pairwise(ends)]

    def of(self, mixed: FloatArray) -> Products:
        """The same of columns that are mixed from these, by a matrix ``(p, columns)``."""
        return Products(mixed.T @ self.columns @ mixed, self.measured @ mixed, self.square, self.samples)

    def without(self, values: FloatArray) -> Products:
        """The same after columns times these values have been taken out of what was measured."""
        return Products(self.columns, self.measured - self.columns @ values, left_over(self, values), self.samples)


def total(parts: Sequence[Products]) -> Products:
    """Products of several records together."""
    columns, measured, square, samples = zip(*parts, strict=True)
    return Products(np.concatenate(columns), np.concatenate(measured), np.concatenate(square), max(samples))


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceRows(Immutable):
    """Columns of all candidates over a record, and what was measured.

    Parameters
    ----------
    names
        Of the columns: coefficients and the place of the accelerometer.
    columns
        Specific force that each makes at one, m/s², before the sensor's filter, shape ``(p, 3, n)``.
    measured
        Specific force, shape ``(3, n)``.
    sample_rate_hz
        Of both: no faster than needed, every sample the mean of those that it stands for.
    taps
        Impulse response of the accelerometer's filter at ``taps_rate_hz``; one tap where it is not known.
    taps_rate_hz
        Of the record.
    weights
        Of :func:`whitening`, by which errors of all frequencies count alike; ``None``: as they are.
    """

    names: tuple[str, ...]
    columns: FloatArray
    measured: FloatArray
    sample_rate_hz: float
    taps: FloatArray
    taps_rate_hz: float
    weights: FloatArray | None = None

    def products(self, cutoff_hz: float | None) -> Products:
        """Products behind the filter of the accelerometer.

        Parameters
        ----------
        cutoff_hz
            Of the low-pass that stands for an unknown filter; ``None`` without one.
        """
        rows, measured, hz = self._spectra
        count, length = self.measured.shape[1], max(1, round(_BLOCK_S * self.sample_rate_hz))
        blocks = max(1, count // length)
        kept = min(blocks * length, count)

        def cut(spectrum: ComplexArray) -> FloatArray:
            found = np.fft.irfft(spectrum, count, axis=-1)[..., :kept]
            return np.moveaxis(found.reshape(*found.shape[:-1], blocks, -1), -2, 0)

        # Blocks, axes, columns, samples.
        weights = 1.0 if self.weights is None else self.weights
        columns = cut(rows * self._response(hz, cutoff_hz) * weights).transpose(0, 2, 1, 3)
        known = cut(measured * weights)
        return Products(
            columns @ columns.transpose(0, 1, 3, 2),
            (columns @ known[..., None])[..., 0],
            (known**2).sum(axis=-1),
            kept // blocks,
        )

    def whitening(self, values: FloatArray, cutoff_hz: float | None) -> FloatArray:
        """Weights by frequency that make what values leave along the rotors' axis white, shape ``(3, f)``.

        A controller holds the height against gusts: as far as they move the vehicle, thrust seems to do nothing. Errors
        that are white have no such relation to what was done before.
        """
        rows, measured, hz = self._spectra
        return whitening(measured - np.tensordot(values, rows * self._response(hz, cutoff_hz), 1), hz)

    @cached_property
    def _spectra(self) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """Fourier coefficients, zero beyond 25 Hz, and their frequencies."""
        from scipy.signal.windows import tukey

        samples = self.measured.shape[1]
        window = tukey(samples, _TAPER)
        hz = np.asarray(np.fft.rfftfreq(samples, 1.0 / self.sample_rate_hz), dtype=np.float64)
        kept = hz <= _KEPT_HZ
        rows = np.fft.rfft(self.columns * window, axis=-1) * kept
        return rows, np.fft.rfft(self.measured * window, axis=-1) * kept, hz

    def _response(self, hz: FloatArray, cutoff_hz: float | None) -> ComplexArray:
        if self.taps.size > 1:
            turns = np.exp(-2j * np.pi * hz[:, None] / self.taps_rate_hz * np.arange(self.taps.size))
            return np.asarray(turns @ self.taps)
        if cutoff_hz is None:
            return np.ones(hz.size, dtype=np.complex128)
        return np.asarray(1.0 / (1.0 + (hz / cutoff_hz) ** (2 * FILTER_ORDER)), dtype=np.complex128)


def whitening(left: ComplexArray, hz: FloatArray) -> FloatArray:
    """Weights by frequency that make errors along the rotors' axis white, from their Fourier coefficients."""
    last = min(float(hz[-1]), _KEPT_HZ)
    inner = np.geomspace(_SLOWEST_HZ, _KEPT_HZ, _BANDS + 1)[:-1]
    edges = np.array([0.0, *inner[inner < last], last])
    rows = [np.abs(left[:, (hz >= low) & (hz <= high)]) ** 2 for low, high in pairwise(edges)]
    power = np.stack([row.mean(axis=1) for row in rows])
    power = np.maximum(power, 1e-6 * power.max(axis=0))
    shares = np.diff(edges)
    size = np.sqrt((shares[:, None] * power).sum(axis=0) / shares.sum() / power)
    middles = np.log([edges[1], *np.sqrt(edges[1:-1] * edges[2:])])
    at = np.log(np.maximum(hz, edges[1]))
    plain = np.ones(hz.size)
    return np.stack([plain, plain, np.exp(np.interp(at, middles, np.log(size[:, 2])))])


def through_sensor(rows: FloatArray, record: MotorRecord, cutoff_hz: float | None) -> FloatArray:
    """Rows ``(..., n)`` behind the filter of the accelerometer: its known taps, or a low-pass without phase."""
    from scipy.signal import butter, oaconvolve, sosfiltfilt

    if record.accel_taps.size > 1:
        first, taps = rows[..., :1], record.accel_taps.reshape((1,) * (rows.ndim - 1) + (-1,))
        passed = oaconvolve(rows - first, taps, axes=-1)[..., : rows.shape[-1]]
        return np.asarray(passed + taps.sum() * first)
    if cutoff_hz is None or cutoff_hz >= 0.5 * record.sample_rate_hz:
        return rows
    sections = butter(FILTER_ORDER, cutoff_hz, fs=record.sample_rate_hz, output="sos")
    return np.asarray(sosfiltfilt(sections, rows, axis=-1))


def thinned(rows: FloatArray, every: int) -> FloatArray:
    """Means of so many samples each, a rest at the end left out."""
    if every == 1:
        return rows
    kept = rows[..., : rows.shape[-1] // every * every]
    return np.asarray(kept.reshape(*rows.shape[:-1], -1, every).mean(axis=-1))


def thinning(record: MotorRecord) -> int:
    """How many samples of a record become one."""
    return max(1, int(record.sample_rate_hz / _LEAST_RATE_HZ))


def force_rows(
    record: MotorRecord,
    airframe: Airframe,
    driven: Motion,
    thrust_by_speed: float,
    names: Sequence[str] = (*FORCE_TERMS, *PLACE),
    curve: Mapping[str, FloatArray] | None = None,
) -> ForceRows:
    """Columns of a record.

    Parameters
    ----------
    record
        With specific force.
    driven
        What drives the model over it.
    thrust_by_speed
        About the thrust of a rotor over the square of its speed, N s²/rad², for its inflow.
    names
        Of the columns.
    curve
        Of :func:`rotorid.fitting.flight.motion.curve_columns`, where the curve of outputs is sought; its coefficients
        are then names too.
    """
    every = thinning(record)
    speeds, velocity, rates, acceleration = (thinned(rows, every) for rows in driven[:4])
    air = rotor_air(airframe, velocity, rates, thrust_by_speed * speeds**2)
    lifted = {name: thinned(thrust, every) for name, thrust in (curve or {}).items()}
    coefficients = tuple(name for name in names if name not in PLACE and name not in lifted)
    made = flight_columns(coefficients, airframe, speeds, air, velocity, rates)
    places = place_columns(rates, acceleration)
    still = np.zeros(rates.shape[1])
    forces = {name: column.force for name, column in made.items()}
    forces |= {name: np.stack([still, still, -thrust]) for name, thrust in lifted.items()}
    columns = [places[name] if name in PLACE else forces[name] / airframe.mass_kg for name in names]
    return ForceRows(
        names=tuple(names),
        columns=np.stack(columns),
        measured=thinned(record.force, every),
        sample_rate_hz=record.sample_rate_hz / every,
        taps=record.accel_taps,
        taps_rate_hz=record.sample_rate_hz,
    )


class Prior(NamedTuple):
    """What is known of a coefficient before: about where, and how surely, as one standard deviation."""

    mean: float
    deviation: float


def solved(
    products: Products, names: Sequence[str], priors: Mapping[str, Prior] | None = None, *, together: float = 1.0
) -> FloatArray:
    """Coefficients of all three axes by Huber's M-estimate over blocks, shape ``(p,)``.

    Where the model fails, in pull-ups and descents, it fails by several times the usual error, and least squares would
    bend the coefficients to these few seconds. Blocks whose error is beyond 1.345 times the median count by as much
    less.

    Parameters
    ----------
    products
        Of the columns of these names.
    priors
        By name; they count as of data whose errors have the size that is left.
    together
        Number of samples over which errors are alike, so that they count as one.
    """
    weights = np.ones((products.blocks, 3))
    known = [(place, priors[name]) for place, name in enumerate(names) if priors and name in priors]
    found = np.zeros(len(names))
    for _ in range(_REWEIGHTED):
        matrix = np.einsum("ba,baij->ij", weights, products.columns)
        right = np.einsum("ba,bai->i", weights, products.measured)
        if known:
            variance = _variance(products, weights, _solution(matrix, right))
            for place, prior in known:
                matrix[place, place] += variance * together / prior.deviation**2
                right[place] += variance * together / prior.deviation**2 * prior.mean
        before, found = found, _solution(matrix, right)
        if np.all(np.abs(found - before) <= _SETTLED * np.abs(found)):
            break
        sizes = np.sqrt(left_over(products, found))
        usual = np.median(sizes, axis=0)
        weights = np.minimum(1.0, _HUBER * usual / np.maximum(sizes, 1e-300))
    return found


def _variance(products: Products, weights: FloatArray, values: FloatArray) -> float:
    left = float((weights * left_over(products, values)).sum())
    return left / max(float(weights.sum()) * products.samples, 1e-300)


def _solution(matrix: FloatArray, right: FloatArray) -> FloatArray:
    size = np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
    return np.asarray(np.linalg.lstsq(matrix / np.outer(size, size), right / size, rcond=1e-10)[0] / size)


def left_over(products: Products, values: FloatArray) -> FloatArray:
    """Sum of squares that values leave in each block on each axis, (m/s²)², shape ``(blocks, 3)``."""
    left = ((products.columns @ values) - 2.0 * products.measured) @ values
    return np.asarray(np.maximum(left + products.square, 0.0))
