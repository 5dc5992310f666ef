"""How far motors explain the slow motion of each axis of a record: what one may fit there at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.speed import motor_speed
from rotorid.typing import FloatArray

SLOW_HZ = 5.0
"""Motion up to here is what flying does; above it noise of the sensors prevails."""

LEAST_CORRELATION = 0.8
"""Of torque and acceleration, or thrust and specific force. Where a controller alone answers to gusts and noise, motors
and motion go together less than this, and what they show is the controller."""

_LAGS_S = (0.002, 0.01, 0.02, 0.04, 0.07, 0.12)
_AXES = ("az", "p", "q", "r")


class Excitation(NamedTuple):
    """How far the motors explain the slow motion of one axis.

    Parameters
    ----------
    correlation
        Of what the motors do with the motion, at the best of several lags.
    lag_s
        That lag; an estimate of motor lag and delay together.
    opposed
        The correlation of the opposite sign, at its best lag, zero or less: far below zero the motors are not where, or
        do not turn as, the levers say.
    """

    correlation: float
    lag_s: float
    opposed: float = 0.0


def excitations(
    records: Sequence[MotorRecord], levers: FloatArray, *, spin_up: bool = False
) -> tuple[dict[str, Excitation], ...]:
    """For every record, axis to its excitation.

    Parameters
    ----------
    levers
        As for :class:`rotorid.fitting.motors.problem.MotorProblem`.
    spin_up
        Whether rotors turn the vehicle by what they gain of their speed too. A controller does not look like that: it
        slows down what turns.

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
    return tuple(_of(record, levers, spin_up=spin_up) for record in records)


def excited_axes(found: Sequence[Mapping[str, Excitation]]) -> tuple[str, ...]:
    """Axes that some record excites, in the order ``az p q r``."""
    return tuple(
        axis for axis in ("az", "p", "q", "r") if any(record[axis].correlation >= LEAST_CORRELATION for record in found)
    )


def _of(record: MotorRecord, levers: FloatArray, *, spin_up: bool) -> dict[str, Excitation]:
    mixing = np.vstack([-np.ones(levers.shape[1]), levers])
    moved = [_slow_part(row, record.sample_rate_hz) for row in (record.az[1:], *np.diff(record.rates, axis=1))]
    best = {axis: Excitation(0.0, _LAGS_S[0]) for axis in _AXES}
    for lag_s in _LAGS_S:
        motors = motor_speed(record.outputs, lag_s=lag_s, delay_s=0.0, step_s=1.0 / record.sample_rate_hz).level[:, 1:]
        for axis, mix, motion in zip(_AXES, mixing, moved, strict=True):
            made = mix @ np.asarray(motors, dtype=np.float64)
            rows = [made, np.diff(made, prepend=made[:1])] if spin_up and axis == "r" else [made]
            slow = np.stack([_slow_part(row, record.sample_rate_hz) for row in rows])
            correlation = _correlation(_positive_part(slow, motion), motion)
            opposed = min(best[axis].opposed, correlation)
            if correlation > best[axis].correlation:
                best[axis] = Excitation(correlation, lag_s, opposed)
            else:
                best[axis] = best[axis]._replace(opposed=opposed)
    return best


def slow_taps(sample_rate_hz: float) -> FloatArray:
    """Taps of a causal low-pass of :data:`SLOW_HZ`, as long as it rings."""
    from scipy.signal import butter, lfilter

    if sample_rate_hz <= 2.5 * SLOW_HZ:
        return np.ones(1)
    b, a = butter(2, SLOW_HZ, fs=sample_rate_hz)
    impulse = np.zeros(max(8, round(sample_rate_hz / SLOW_HZ)))
    impulse[0] = 1.0
    return np.asarray(lfilter(b, a, impulse), dtype=np.float64)


def _slow_part(row: FloatArray, sample_rate_hz: float) -> FloatArray:
    from scipy.signal import oaconvolve

    found: FloatArray = np.asarray(oaconvolve(row - row.mean(), slow_taps(sample_rate_hz), mode="valid"))
    centered: FloatArray = found - found.mean()
    return centered


def _positive_part(rows: FloatArray, motion: FloatArray) -> FloatArray:
    """A row, or of several what most resembles a motion with factors from zero up."""
    from scipy.optimize import nnls

    if len(rows) == 1:
        return np.asarray(rows[0])
    factors, _ = nnls(rows.T, motion)
    return np.asarray(factors @ rows if np.any(factors) else rows[0])


def _correlation(one: FloatArray, other: FloatArray) -> float:
    size = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / size if size > 0.0 else 0.0
