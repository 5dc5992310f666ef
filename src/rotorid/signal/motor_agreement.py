"""Whether motors that follow from commands are those that were logged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.autopilot_mixer import Linearization, linearization_of
from rotorid.signal.motor_outputs import MotorHistory, at_limit, in_flight, logged_outputs
from rotorid.typing import FloatArray

EXPLAINED = 0.01
"""A reconstruction agrees when it leaves no more than this part of the variance of the logged outputs."""

_SHIFTS = range(-3, 4)
_FEWEST = 20
_RESOLUTION = 1e-3
"""Outputs are logged in microseconds, a thousandth of their range."""


@dataclass(frozen=True, kw_only=True)
class Agreement(Immutable):
    """Reconstructed against logged outputs, in flight and away from the limits.

    Parameters
    ----------
    samples
        Logged samples that were compared, of each motor.
    gain
        Factor on the demands that agrees best: one over the density of the air for ArduPilot, which compensates it.
    rms
        Of the difference, as a part of the range of the outputs.
    unexplained
        Variance of the difference over that of the logged outputs.
    shift
        Samples of the commands by which these are later than the outputs; zero where both are logged in one loop.
    correlations
        Of roll, pitch, yaw and thrust command with what the mixer, inverted, makes of the logged outputs: near one for
        the right layout, negative for a wrong sign, whatever the rates.
    """

    samples: int
    gain: float
    rms: float
    unexplained: float
    shift: int
    correlations: tuple[float, ...]

    @property
    def agrees(self) -> bool:
        """Whether what is left is small, or no more than the resolution of the log."""
        return self.samples >= _FEWEST and (self.unexplained <= EXPLAINED or self.rms <= _RESOLUTION)


def agreement_of(record: FlightRecord, demands: MotorHistory, mixer: FloatArray) -> Agreement | None:
    """Demands from commands against the logged outputs, in flight and away from limits.

    Parameters
    ----------
    record
        The log.
    demands
        Of the kind ``thrust_demand``, faster or slower than the outputs.
    mixer
        Columns roll, pitch, yaw and thrust, shape ``(motors, 4)``.

    Returns
    -------
    Agreement or None
        ``None`` where there are no or too few outputs, or how they follow from demands is not known.

    Raises
    ------
    UsageError
        The log holds another number of motors.
    """
    outputs, known = or_none(logged_outputs, record), linearization_of(record)
    if outputs is None or known is None:
        return None
    if outputs.motors != demands.motors:
        raise UsageError(
            f"a mixer of {demands.motors} motors came for a log of {outputs.motors}",
            needed="the layout of this vehicle",
        )
    clock, step_s = demands.time_s, float(np.median(np.diff(demands.time_s)))
    margin_s = max(_SHIFTS) * step_s
    inside = (outputs.time_s >= clock[0] + margin_s) & (outputs.time_s <= clock[-1] - margin_s)
    kept = inside & in_flight(record, outputs.time_s) & ~at_limit(record, outputs)
    if np.count_nonzero(kept) < _FEWEST:
        return None
    stamps, share = outputs.time_s[kept], voltage_share(record, known, outputs.time_s[kept])
    logged = known.demands(outputs.values[:, kept], voltage_share=share)
    shift = min(_SHIFTS, key=lambda one: _rest(_sampled(demands, stamps + one * step_s), logged)[1])
    wanted = _sampled(demands, stamps + shift * step_s)
    gain = _rest(wanted, logged)[0]
    actual = known.outputs(logged, voltage_share=share)
    difference = known.outputs(wanted, gain=gain, voltage_share=share) - actual
    variance, residual = float(np.mean(np.var(actual, axis=1))), float(np.mean(difference**2))
    return Agreement(
        samples=stamps.size,
        gain=gain,
        rms=float(np.sqrt(residual)) / (known.high - known.low),
        unexplained=residual / variance if variance > 0.0 else np.inf,
        shift=shift,
        correlations=_correlations(mixer, wanted, logged),
    )


def _sampled(history: MotorHistory, time_s: FloatArray) -> FloatArray:
    return np.stack([np.interp(time_s, history.time_s, row) for row in history.values])


def _rest(wanted: FloatArray, logged: FloatArray) -> tuple[float, float]:
    """Gain of the demands that agrees best, and the mean square that it leaves."""
    gain = float(np.sum(wanted * logged) / np.sum(wanted**2))
    return gain, float(np.mean((gain * wanted - logged) ** 2))


def _correlations(mixer: FloatArray, wanted: FloatArray, logged: FloatArray) -> tuple[float, ...]:
    """Of each command in the demands with that in the outputs; zero for a command that never moved."""
    inverse = np.linalg.pinv(mixer)
    pairs = zip(inverse @ wanted, inverse @ logged, strict=True)
    return tuple(
        float(np.corrcoef(one, other)[0, 1]) if np.ptp(one) > 0.0 and np.ptp(other) > 0.0 else 0.0
        for one, other in pairs
    )


def voltage_share(record: FlightRecord, known: Linearization, time_s: FloatArray) -> FloatArray:
    """What the autopilot divided its outputs by; one where the log does not hold the voltage, which the gain takes."""
    held = next(record.holding("battery_voltage"), None)
    if held is None or not known.compensates_voltage:
        return np.ones(time_s.size)
    topic, row = held
    return known.voltage_share(np.interp(time_s, topic.time_s, topic.values[row]))


def or_none(read: Callable[[FlightRecord], MotorHistory], record: FlightRecord) -> MotorHistory | None:
    """Motors that a log may not hold."""
    try:
        return read(record)
    except InsufficientDataError:
        return None
