r"""The force of flight fitted to specific force, by variable projection.

Every coefficient of the force acts linearly once speeds, velocity and inflow are known, and so does the place of the
accelerometer. Columns of all candidates are worked out once a record, and brought to the sensor's filter in the
frequency domain, where a cut-off is a factor. What then is left of a record are products of columns, axis by axis:
every structure is a small system of equations.

Assumes that the accelerometer's filter has no phase, where its taps are not known; that what the equations leave is no
larger at times when the motors move (true of gusts, and roughly so of missing terms).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError
from rotorid.fitting.flight.motion import Motion
from rotorid.models.flight import FORCE_TERMS, Airframe, flight_columns, place_columns, rotor_air
from rotorid.typing import FloatArray

PLACE = ("x_imu", "y_imu", "z_imu")
"""Where the accelerometer is."""

FILTER_ORDER = 2
"""Of the low-pass, forward and backward, that stands for a filter of the accelerometer that is not known."""

_KEPT_HZ = 25.0
_TAPER = 0.02


class Products(NamedTuple):
    """What least squares need: products of columns ``(3, p, p)``, with the measured ``(3, p)``, its own ``(3,)``."""

    columns: FloatArray
    measured: FloatArray
    square: FloatArray
    samples: int


def total(parts: Sequence[Products]) -> Products:
    """Products of several records together."""
    columns, measured, square, samples = zip(*parts, strict=True)
    return Products(np.sum(columns, axis=0), np.sum(measured, axis=0), np.sum(square, axis=0), sum(samples))


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceRows(Immutable):
    """Columns of all candidates over a record, and what was measured.

    Parameters
    ----------
    record
        What was flown.
    names
        Of the columns: coefficients and the place of the accelerometer.
    columns
        Specific force that each makes at one, m/s², before the sensor's filter, shape ``(p, 3, n)``.
    """

    record: MotorRecord
    names: tuple[str, ...]
    columns: FloatArray

    def products(self, cutoff_hz: float | None, chosen: Sequence[str] | None = None) -> Products:
        """Products behind the filter of the accelerometer, whose cut-off counts where no taps are known.

        Parameters
        ----------
        cutoff_hz
            Of the low-pass that stands for the filter of the accelerometer; ``None`` without one.
        chosen
            Names of columns; all by default.
        """
        rows, measured = self._spectra
        if chosen is not None:
            rows = rows[[self.names.index(name) for name in chosen]]
        passed = rows * self._response(cutoff_hz)
        split = np.concatenate([passed.real, passed.imag], axis=-1)
        known = np.concatenate([measured.real, measured.imag], axis=-1)
        return Products(
            np.einsum("iak,jak->aij", split, split, optimize=True),
            np.einsum("iak,ak->ai", split, known),
            (known**2).sum(axis=-1),
            self.record.samples,
        )

    def filtered(self, cutoff_hz: float | None, chosen: Sequence[str] | None = None) -> FloatArray:
        """Columns behind the filter of the accelerometer, sample by sample, shape ``(p, 3, n)``."""
        places = slice(None) if chosen is None else [self.names.index(name) for name in chosen]
        return through_sensor(self.columns[places], self.record, cutoff_hz)

    @cached_property
    def _spectra(self) -> tuple[np.ndarray, np.ndarray]:
        """Fourier coefficients up to 25 Hz of columns and measured, sums of squares being means over samples."""
        from scipy.signal.windows import tukey

        samples = self.record.samples
        window = tukey(samples, _TAPER)
        kept = np.fft.rfftfreq(samples, 1.0 / self.record.sample_rate_hz) <= _KEPT_HZ
        scale = np.full(int(kept.sum()), np.sqrt(2.0 / samples))
        scale[0] = np.sqrt(1.0 / samples)
        rows = np.fft.rfft(self.columns * window, axis=-1)[..., kept] * scale
        return rows, np.fft.rfft(self.record.force * window, axis=-1)[..., kept] * scale

    def _response(self, cutoff_hz: float | None) -> np.ndarray:
        record = self.record
        hz = np.asarray(np.fft.rfftfreq(record.samples, 1.0 / record.sample_rate_hz), dtype=np.float64)
        hz = hz[hz <= _KEPT_HZ]
        if record.accel_taps.size > 1:
            turns = np.exp(-2j * np.pi * hz[:, None] / record.sample_rate_hz * np.arange(record.accel_taps.size))
            return np.asarray(turns @ record.accel_taps)
        return np.ones_like(hz) if cutoff_hz is None else low_pass_gain(hz, cutoff_hz)


def low_pass_gain(hz: FloatArray, cutoff_hz: float) -> FloatArray:
    """Gain of the low-pass that stands for an accelerometer's filter."""
    return np.asarray(1.0 / (1.0 + (hz / cutoff_hz) ** (2 * FILTER_ORDER)))


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


def force_rows(
    record: MotorRecord, airframe: Airframe, driven: Motion, names: Sequence[str] = (*FORCE_TERMS, *PLACE)
) -> ForceRows:
    """Columns of a record.

    Raises
    ------
    InsufficientDataError
        The record has no specific force along all axes.
    """
    if not record.force.shape[1]:
        raise InsufficientDataError(f"{record.name} holds no specific force", needed="three accelerometers")
    thrust = thrust_by_speed(record, airframe, driven.speeds) * driven.speeds**2
    air = rotor_air(airframe, driven.velocity, driven.rates, thrust)
    made = flight_columns(
        tuple(name for name in names if name not in PLACE), airframe, driven.speeds, air, driven.velocity, driven.rates
    )
    places = place_columns(driven.rates, driven.acceleration)
    columns = [places[name] if name in PLACE else made[name].force / airframe.mass_kg for name in names]
    return ForceRows(record=record, names=tuple(names), columns=np.stack(columns))


def thrust_by_speed(record: MotorRecord, airframe: Airframe, speeds: FloatArray) -> float:
    """Thrust of a rotor over the square of its speed, N s²/rad², from the mean specific force: for its inflow."""
    squares = float((speeds**2).sum(axis=0).mean())
    return airframe.mass_kg * max(-float(record.force[2].mean()), 1.0) / max(squares, 1e-300)


def solved(
    products: Products,
    names: Sequence[str],
    weights: FloatArray,
    *,
    priors: Mapping[str, tuple[float, float]] | None = None,
) -> dict[str, float]:
    """Coefficients of weighted least squares; priors (mean, deviation) count in units of the weighted residual."""
    matrix = np.einsum("a,aij->ij", weights, products.columns)
    right = weights @ products.measured
    for place, name in enumerate(names):
        mean, deviation = (priors or {}).get(name, (0.0, np.inf))
        matrix[place, place] += deviation**-2
        right[place] += mean * deviation**-2
    size = np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
    found = np.linalg.lstsq(matrix / np.outer(size, size), right / size, rcond=1e-10)[0] / size
    return dict(zip(names, map(float, found), strict=True))


def squares(products: Products, values: FloatArray) -> FloatArray:
    """Sum of squares that values leave on each axis, shape ``(3,)``."""
    left = np.einsum("i,aij,j->a", values, products.columns, values) - 2.0 * products.measured @ values
    return np.asarray(np.maximum(left + products.square, 0.0))
