r"""Motors and angular accelerations of a flight on one clock, in the band in which torques of the motors prevail.

Thrust :math:`x_i` of a motor is its squared speed, or its output. All of it is averaged over the steps of one even
clock, which keeps out what the slower logger cannot show and shifts nothing, and band-passed without phase. Blocks of
one second with gaps, or with motors at their limits for most of it, are no data.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Intervals
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import longest_flight
from rotorid.models.autopilots.layouts import layout_of, mixer_of
from rotorid.models.rotors import RotorLayout
from rotorid.signal.airborne import airborne
from rotorid.signal.clock import interpolated
from rotorid.signal.motors import MotorHistory, motor_history, motor_limits
from rotorid.typing import BoolArray, FloatArray, IntArray

BAND_HZ = (1.5, 15.0)
"""Where torques of the motors prevail: below it speed turns the vehicle too, above it noise does."""

BLOCK_S, LEAST_S = 1.0, 5.0
_CLOCK_HZ, _MOST_S = 100.0, 300.0
_GROUND_S = 1.0
"""At the ends of a flight the ground may still act."""

_MOST_LIMITED = 0.5


class MotorBand(NamedTuple):
    """One flight on an even clock.

    Parameters
    ----------
    time_s
        Stamps on the log's own clock, shape ``(samples,)``.
    thrust
        Of each motor in parts of their mean, before the band-pass, shape ``(motors, samples)``.
    rates, accelerations
        Of roll, pitch and yaw in the band, rad/s and rad/s^2, shape ``(3, samples)``.
    block
        Number of the block of each sample, from zero.
    kept
        Whether a sample is in a block without gaps and motor limits.
    step_s
        Of the clock.
    """

    time_s: FloatArray
    thrust: FloatArray
    rates: FloatArray
    accelerations: FloatArray
    block: IntArray
    kept: BoolArray
    step_s: float

    def passed(self, rows: FloatArray) -> FloatArray:
        """Rows of this clock in the band."""
        return band_passed(rows, self.step_s)


def band_passed(rows: FloatArray, step_s: float) -> FloatArray:
    """Rows of an even clock, shape ``(..., samples)``, in the band, without phase."""
    from scipy.signal import butter, sosfiltfilt

    band = butter(2, (BAND_HZ[0], min(BAND_HZ[1], 0.4 / step_s)), "bandpass", fs=1.0 / step_s, output="sos")
    return np.asarray(sosfiltfilt(band, rows, axis=-1))


def flights_off_ground(record: FlightRecord) -> Intervals:
    """Flights without their first and last second: legs on the ground turn the vehicle as no motor does."""
    try:
        flights = airborne(record).intervals
    except InsufficientDataError:
        return (longest_flight(record),)
    return tuple((start + _GROUND_S, stop - _GROUND_S) for start, stop in flights if stop - start > 2.0 * _GROUND_S)


def fastest_motors(record: FlightRecord, layout: RotorLayout) -> MotorHistory:
    """The motors as fast as the log has them: by the mixer of the layout, or of the frame that the log names."""
    history = motor_history(record, mixer_of(layout, record.source.format))
    if history.sample_rate_hz >= LOWEST_RATE_HZ:
        return history
    try:
        return motor_history(record, mixer_of(layout_of(record), record.source.format))
    except (InsufficientDataError, UsageError):
        return history


def motor_bands(record: FlightRecord, history: MotorHistory, intervals: Intervals) -> Iterator[MotorBand]:
    """The flights, up to five minutes of them, as far as five seconds and some block of each serve.

    Parameters
    ----------
    record
        The log, with all rates.
    history
        Its motors.
    intervals
        Start and stop of each flight.
    """
    joined = interpolated(history.time_s, history.values)
    motors_s, motors = (history.time_s, history.values) if joined is None else (joined.time_s, joined.values)
    tracks = [record[name] for name in RATES]
    slowest_hz = min(history.sample_rate_hz, *(record.rate_hz(name) for name in RATES))
    step_s = 1.0 / min(_CLOCK_HZ, slowest_hz)
    limits = motor_limits(record)
    left_s = _MOST_S
    for start_s, stop_s in intervals:
        low = max(start_s, float(motors_s[0]), *(float(track.time_s[0]) for track in tracks))
        high = min(stop_s, float(motors_s[-1]), *(float(track.time_s[-1]) for track in tracks), low + left_s)
        count = int((high - low) / step_s)
        if count * step_s < LEAST_S:
            continue
        time_s = np.asarray(low + step_s * np.arange(count), dtype=np.float64)
        rates = np.stack([_means(track.time_s, track.values, time_s, step_s) for track in tracks])
        thrust = np.stack([_means(motors_s, row, time_s, step_s) for row in motors])
        thrust = thrust**2 if history.kind == "speed" else thrust
        thrust /= max(float(np.mean(np.abs(thrust))), 1e-12)
        known = _known(motors_s, time_s, step_s) & _known(tracks[0].time_s, time_s, step_s)
        block = np.floor((time_s - low) / BLOCK_S).astype(int)
        whole = np.bincount(block, known) == np.bincount(block)
        if limits.time_s.size and not limits.unknown:
            limited = np.interp(time_s, limits.time_s, limits.limited.astype(float))
            whole &= np.bincount(block, limited) <= _MOST_LIMITED * np.bincount(block)
        kept = whole[block]
        if kept.any():
            accelerations = band_passed(np.gradient(rates, step_s, axis=1), step_s)
            yield MotorBand(time_s, thrust, band_passed(rates, step_s), accelerations, block, kept, step_s)
            left_s -= float(np.count_nonzero(kept)) * step_s
        if left_s < LEAST_S:
            break


def _means(stamps: FloatArray, values: FloatArray, time_s: FloatArray, step_s: float) -> FloatArray:
    """Mean of a channel over the step around each time, which keeps out what the slower clock cannot show."""
    kept = np.isfinite(values)
    stamps, values = stamps[kept], values[kept]
    area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(stamps))])
    edges = np.concatenate([time_s - 0.5 * step_s, time_s[-1:] + 0.5 * step_s]).clip(stamps[0], stamps[-1])
    before = np.clip(np.searchsorted(stamps, edges, side="right") - 1, 0, stamps.size - 2)
    passed = edges - stamps[before]
    slope = np.diff(values)[before] / np.maximum(np.diff(stamps)[before], 1e-12)
    integral = area[before] + passed * (values[before] + 0.5 * slope * passed)
    # At an end of the log the step is half as long.
    return np.asarray(np.diff(integral) / np.maximum(np.diff(edges), 1e-12))


def _known(stamps: FloatArray, time_s: FloatArray, step_s: float) -> BoolArray:
    """Whether a stamp is near, so that a value is no line across a gap."""
    after = np.clip(np.searchsorted(stamps, time_s), 1, stamps.size - 1)
    return np.asarray(np.minimum(np.abs(stamps[after] - time_s), np.abs(time_s - stamps[after - 1])) <= 3.0 * step_s)
