"""How far motors explain the motion of each axis of a record, and in which band: what one may fit there at all.

Most test inputs are slow, and motion up to 5 Hz shows them. In agile flight, moments of the air hide the motors there,
and show them from 3 to 15 Hz: a rate that the motors explain up to 5 Hz in no record counts where they explain it in
two neighboring octaves or more, in those.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import cached_by_value, read_only
from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.speed import motor_speed
from rotorid.typing import FloatArray

SLOW_HZ = 5.0
"""Motion up to here is what flying does; above it noise of the sensors prevails, unless the flight is agile."""

SLOW_BAND_HZ = (0.0, SLOW_HZ)
"""The usual band."""

_OCTAVES_HZ = (0.75, 1.5, 3.0, 6.0, 12.0, 24.0)
"""Edges of the octaves in which a rate is looked for that slow motion does not show."""

_FEWEST_OCTAVES = 2
"""One octave alone may look like the motors by chance."""

_FEWEST_CYCLES = 10.0
"""Cycles of the lowest frequency of an octave that a record lasts."""

_OF_RATE = 0.4
"""Share of the sample rate up to which an octave is read."""

LEAST_CORRELATION = 0.8
"""Of torque and acceleration, or thrust and specific force. Where a controller alone answers to gusts and noise, motors
and motion go together less than this, and what they show is the controller."""

_LAGS_S = (0.002, 0.01, 0.02, 0.04, 0.07, 0.12)
_AXES = ("az", "p", "q", "r")


class Excitation(NamedTuple):
    """How far the motors explain the motion of one axis.

    Parameters
    ----------
    correlation
        Of what the motors do with the motion, at the best of several lags.
    lag_s
        That lag; an estimate of motor lag and delay together.
    opposed
        The correlation of the opposite sign, at its best lag, zero or less: far below zero the motors are not where, or
        do not turn as, the levers say.
    band_hz
        Where they do: up to 5 Hz, or a run of octaves.
    """

    correlation: float
    lag_s: float
    opposed: float = 0.0
    band_hz: tuple[float, float] = SLOW_BAND_HZ

    @property
    def counts(self) -> bool:
        """Whether the axis may be fitted."""
        return self.correlation >= LEAST_CORRELATION

    def taps(self, sample_rate_hz: float) -> FloatArray:
        """Taps of a causal filter of the band."""
        return slow_taps(sample_rate_hz) if self.band_hz == SLOW_BAND_HZ else band_taps(self.band_hz, sample_rate_hz)


def band_words(found: Iterable[Mapping[str, Excitation]], axis: str) -> str:
    """Where the motors explain an axis, over all records that count: ``up to 5 Hz``, or ``from 3 to 12 Hz``.

    Examples
    --------
    >>> agile = Excitation(0.9, 0.02, band_hz=(3.0, 12.0))
    >>> band_words([{"p": agile}], "p"), band_words([{"p": Excitation(0.3, 0.02)}], "p")
    ('from 3 to 12 Hz', 'up to 5 Hz')
    """
    bands = [record[axis].band_hz for record in found if record[axis].counts] or [SLOW_BAND_HZ]
    low, high = min(low for low, _ in bands), max(high for _, high in bands)
    return f"from {low:g} to {high:g} Hz" if low > 0.0 else f"up to {high:g} Hz"


def excitations(
    records: Sequence[MotorRecord], levers: FloatArray, *, spin_up: bool = False, in_air: bool = False
) -> tuple[dict[str, Excitation], ...]:
    """For every record, axis to its excitation.

    An axis that a record shows up to 5 Hz is looked for there in all records. Where outputs and not speeds were logged,
    octaves count only if no axis is shown up to 5 Hz: all axes share the lag of the motors, which is surer in slow
    motion, and in octaves takes up the answers of a controller to noise.

    Parameters
    ----------
    levers
        As for :class:`rotorid.fitting.motors.problem.MotorProblem`.
    spin_up
        Whether rotors turn the vehicle by what they gain of their speed too. A controller does not look like that: it
        slows down what turns.
    in_air
        Whether the vehicle flies fast, so that air moves it in what is slow: octaves then come first where they show
        an axis, whatever was logged.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> outputs = 0.5 + 0.05 * rng.standard_normal((4, 4000)).cumsum(axis=1) / 30.0
    >>> levers = np.array([[-0.2, 0.2, 0.2, -0.2], [0.2, -0.2, 0.2, -0.2], [1.0, 1.0, -1.0, -1.0]])
    >>> roll = np.cumsum(levers[0] @ outputs) / 100.0
    >>> record = MotorRecord(name="roll", sample_rate_hz=100.0, outputs=outputs,
    ...                      rates=np.stack([roll, 0.0 * roll, 0.0 * roll]), az=-9.81 + 0.0 * roll)
    >>> {axis: round(one.correlation, 1) for axis, one in excitations([record], levers)[0].items()}
    {'az': 0.0, 'p': 1.0, 'q': 0.0, 'r': 0.0}
    """
    rows = tuple(map(tuple, levers.tolist()))
    slow = [_of(record, rows, spin_up=spin_up) for record in records]
    shown = excited_axes(slow)
    lagging = any(record.between == "held" for record in records)
    hidden = set() if shown and lagging else set(RATES).difference(shown)
    if in_air:
        hidden = set(RATES)
    return tuple(_with_octaves(record, levers, found, hidden) for record, found in zip(records, slow, strict=True))


def excited_axes(found: Sequence[Mapping[str, Excitation]]) -> tuple[str, ...]:
    """Axes that some record excites, in the order ``az p q r``."""
    return tuple(axis for axis in _AXES if any(record[axis].counts for record in found))


@cached_by_value
def _of(record: MotorRecord, levers: tuple[tuple[float, ...], ...], *, spin_up: bool) -> Mapping[str, Excitation]:
    rate_hz, rows = record.sample_rate_hz, np.array(levers)
    mixing = np.vstack([-np.ones(rows.shape[1]), rows])
    moved = [_slow_part(record.az[1:], rate_hz), *_slow_part(np.diff(record.rates, axis=1), rate_hz)]
    best = {axis: Excitation(0.0, _LAGS_S[0]) for axis in _AXES}
    for lag_s in _LAGS_S:
        motors = _levels(record, lag_s)
        for axis, made, motion in zip(_AXES, mixing @ _slow_part(motors, rate_hz), moved, strict=True):
            slow = made[None]
            if spin_up and axis == "r":
                slow = _slow_part(np.stack(_made(mixing[-1] @ motors, spin_up=True)), rate_hz)
            correlation = _correlation(_positive_part(slow, motion), motion)
            opposed = min(best[axis].opposed, correlation)
            if correlation > best[axis].correlation:
                best[axis] = Excitation(correlation, lag_s, opposed)
            else:
                best[axis] = best[axis]._replace(opposed=opposed)
    return MappingProxyType(best)


def _with_octaves(
    record: MotorRecord, levers: FloatArray, slow: Mapping[str, Excitation], hidden: Collection[str]
) -> dict[str, Excitation]:
    """Excitations of a record, of the axes that slow motion hides in the octaves that show them."""
    best = dict(slow)
    for axis, lever, motion in zip(RATES, levers, np.diff(record.rates, axis=1), strict=True):
        if axis in hidden and (found := _in_octaves(record, lever, motion)) is not None:
            best[axis] = found._replace(opposed=best[axis].opposed)
    return best


def _in_octaves(record: MotorRecord, lever: FloatArray, motion: FloatArray) -> Excitation | None:
    """The longest run of octaves in which the motors explain a rate, with the correlation in all of it."""
    if not np.any(motion):
        return None
    torques = _torques(record, lever)
    runs: list[list[tuple[float, float]]] = [[]]
    for octave in octaves(record, lever, motion):
        if octave.counts:
            runs[-1].append(octave.band_hz)
        else:
            runs.append([])
    longest = max(runs, key=len)
    if len(longest) < _FEWEST_OCTAVES:
        return None
    together = _best_in((longest[0][0], longest[-1][1]), record, torques, motion)
    return together if together.counts else None


def octaves(record: MotorRecord, lever: FloatArray, motion: FloatArray, *, spin_up: bool = False) -> list[Excitation]:
    """How far the motors explain a rate in each octave.

    Parameters
    ----------
    record
        What was flown.
    lever
        Of each rotor, one row of the levers of :func:`excitations`.
    motion
        Increments of the rate, shape ``(n - 1,)``.
    spin_up
        As for :func:`excitations`.
    """
    torques = _torques(record, lever, spin_up=spin_up)
    return [_best_in(band_hz, record, torques, motion) for band_hz in pairwise(_OCTAVES_HZ)]


def _torques(record: MotorRecord, lever: FloatArray, *, spin_up: bool = False) -> dict[float, list[FloatArray]]:
    """What the motors do, at several lags."""
    return {lag_s: _made(lever @ _levels(record, lag_s), spin_up=spin_up) for lag_s in _LAGS_S}


def _levels(record: MotorRecord, lag_s: float) -> FloatArray:
    """Lagged outputs, shape ``(motors, n - 1)``."""
    step_s = 1.0 / record.sample_rate_hz
    return motor_speed(record.outputs, lag_s=lag_s, delay_s=0.0, step_s=step_s, integrals=False).level[:, 1:]


def _made(torque: FloatArray, *, spin_up: bool) -> list[FloatArray]:
    """Torque of the motors, and its change where rotors turn the vehicle by what they gain of their speed too."""
    return [torque, np.diff(torque, prepend=torque[:1])] if spin_up else [torque]


def _best_in(
    band_hz: tuple[float, float], record: MotorRecord, torques: Mapping[float, Sequence[FloatArray]], motion: FloatArray
) -> Excitation:
    rate_hz = record.sample_rate_hz
    if band_hz[1] > _OF_RATE * rate_hz or record.samples / rate_hz * band_hz[0] < _FEWEST_CYCLES:
        return Excitation(0.0, _LAGS_S[0], band_hz=band_hz)
    shown = _band_part(motion, band_hz, rate_hz)
    made = {lag_s: np.stack([_band_part(row, band_hz, rate_hz) for row in rows]) for lag_s, rows in torques.items()}
    found = {lag_s: _correlation(_positive_part(rows, shown), shown) for lag_s, rows in made.items()}
    lag_s = max(found, key=lambda lag_s: found[lag_s])
    return Excitation(found[lag_s], lag_s, band_hz=band_hz)


@cache
def slow_taps(sample_rate_hz: float) -> FloatArray:
    """Taps of a causal low-pass of :data:`SLOW_HZ`, as long as it rings."""
    from scipy.signal import butter, lfilter

    if sample_rate_hz <= 2.5 * SLOW_HZ:
        return read_only(np.ones(1), np.float64, ndim=1)
    b, a = butter(2, SLOW_HZ, fs=sample_rate_hz)
    impulse = np.zeros(max(8, round(sample_rate_hz / SLOW_HZ)))
    impulse[0] = 1.0
    return read_only(lfilter(b, a, impulse), np.float64, ndim=1)


@cache
def band_taps(band_hz: tuple[float, float], sample_rate_hz: float) -> FloatArray:
    """Taps of a causal band-pass, as long as it rings."""
    from scipy.signal import butter, lfilter

    b, a = butter(2, band_hz, btype="bandpass", fs=sample_rate_hz)
    impulse = np.zeros(max(8, round(1.5 * sample_rate_hz / band_hz[0])))
    impulse[0] = 1.0
    return read_only(lfilter(b, a, impulse), np.float64, ndim=1)


def filtered(rows: FloatArray, taps: FloatArray) -> FloatArray:
    """Rows behind a filter of some taps, from where it has filled, along the last axis: ``(..., n - taps + 1)``.

    Of rows that are shorter than the filter nothing is left.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    if taps.size == 1:
        return np.asarray(taps[0] * rows)
    samples = rows.shape[-1]
    # What wraps around falls on samples at which the filter has not filled.
    size = next_fast_len(samples, real=True)
    passed: FloatArray = irfft(rfft(rows, size) * rfft(taps, size), size)
    return passed[..., taps.size - 1 : samples]


def in_band(row: FloatArray, band_hz: tuple[float, float], sample_rate_hz: float) -> FloatArray:
    """A row through a filter of its band without phase, along the last axis; all of it where the record is slower."""
    from scipy.signal import butter, sosfiltfilt

    if band_hz != SLOW_BAND_HZ:
        sos = butter(2, band_hz, btype="bandpass", fs=sample_rate_hz, output="sos")
    elif sample_rate_hz > 2.5 * SLOW_HZ:
        sos = butter(2, SLOW_HZ, fs=sample_rate_hz, output="sos")
    else:
        return row
    return np.asarray(sosfiltfilt(sos, row), dtype=np.float64)


def _band_part(row: FloatArray, band_hz: tuple[float, float], sample_rate_hz: float) -> FloatArray:
    found = in_band(row - row.mean(), band_hz, sample_rate_hz)
    edge = max(1, round(sample_rate_hz / band_hz[0]))
    return found[edge:-edge] if found.size > 4 * edge else found


def slow_correlation(rows: FloatArray, motion: FloatArray, sample_rate_hz: float) -> float:
    """Correlation up to 5 Hz of a motion with what explains it best of some rows, each with a factor from zero up.

    Parameters
    ----------
    rows
        Shape ``(k, n)``.
    motion
        Shape ``(n,)``.
    """
    slow = _slow_part(motion, sample_rate_hz)
    return _correlation(_positive_part(_slow_part(rows, sample_rate_hz), slow), slow)


def _slow_part(rows: FloatArray, sample_rate_hz: float) -> FloatArray:
    """Motion up to 5 Hz about its mean, along the last axis."""
    found = filtered(rows - rows.mean(axis=-1, keepdims=True), slow_taps(sample_rate_hz))
    if not found.size:
        return found
    return np.asarray(found - found.mean(axis=-1, keepdims=True))


def _positive_part(rows: FloatArray, motion: FloatArray) -> FloatArray:
    """A row, or of several what most resembles a motion with factors from zero up."""
    from scipy.optimize import nnls

    if len(rows) == 1 or not motion.size:
        return np.asarray(rows[0])
    factors, _ = nnls(rows.T, motion)
    return np.asarray(factors @ rows if np.any(factors) else rows[0])


def _correlation(one: FloatArray, other: FloatArray) -> float:
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0.0 else 0.0
