"""Sticks of an ordinary flight: nobody tests anything, somebody flies about."""

from __future__ import annotations

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import FloatArray

RADIO_HZ = 50.0
STEPS_OF_STICK = 500.0
"""A radio sends a stick at 50 Hz in steps of 1/500 from the middle to an end, as pulses of 1000 to 2000 µs do."""

_BAND_HZ = (0.1, 3.0)
_BURST_S, _REST_S = (2.0, 8.0), (0.5, 3.0)
_NOISE = 0.35
_MOVE_EVERY_S, _MOVE_HELD_S, _RISE_S = (1.0, 4.0), (0.2, 0.9), (0.08, 0.25)
_MOVE = (0.3, 1.0)
_FINE_HZ = 500.0


def everyday_stick(*, level: float, duration_s: float, sample_rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """A stick as a pilot moves it who is not asked for anything.

    Noise of 0.1 to 3 Hz, falling by 12 dB an octave beyond, comes in bursts of 2 to 8 s with rests between them. On
    it come moves out and back, one every 1 to 4 s, which rise and fall within 80 to 250 ms and hold for 0.2 to 0.9 s.
    The radio sends that at 50 Hz, rounded to 1/500 of full stick, and the autopilot holds it until the next value
    comes.

    Parameters
    ----------
    level
        Largest deflection; 1 is full stick.
    sample_rate_hz
        Rate at which it is given back, that of the autopilot.
    rng
        Of bursts and moves.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``; zero at both ends.

    Raises
    ------
    UsageError
        The level is not above zero and up to one, or the length not positive.

    Examples
    --------
    >>> stick = everyday_stick(level=0.5, duration_s=60.0, sample_rate_hz=250.0, rng=np.random.default_rng(0))
    >>> stick.shape, bool(np.abs(stick).max() <= 0.5), float(stick[0]), float(stick[-1])
    ((15000,), True, 0.0, 0.0)
    """
    if not (0.0 < level <= 1.0 and duration_s > 0.0 and sample_rate_hz > 0.0):
        raise UsageError(
            f"invalid stick input: level {level:g} for {duration_s:g} s at {sample_rate_hz:g} Hz",
            needed="a level above 0 and up to 1, and a positive duration and rate",
        )
    time_s = np.arange(round(duration_s * _FINE_HZ) + 1) / _FINE_HZ
    moved = _NOISE * _bursts(time_s, rng) * _noise(time_s.size, rng) + _moves(time_s, rng)
    ends = np.clip(np.minimum(time_s, time_s[-1] - time_s) / 0.5, 0.0, 1.0)
    smooth = level * ends * np.clip(moved, -1.0, 1.0)
    clock_s = np.arange(round(duration_s * sample_rate_hz)) / sample_rate_hz
    # A thousandth of a turn early, so that a value is there at the tick at which it is sent.
    sent_s = (np.floor(clock_s * RADIO_HZ + 1e-3)) / RADIO_HZ
    sent = np.round(np.interp(sent_s, time_s, smooth) * STEPS_OF_STICK) / STEPS_OF_STICK
    sent[-max(int(sample_rate_hz / RADIO_HZ), 1) :] = 0.0
    return np.asarray(np.clip(sent, -level, level))


def _noise(samples: int, rng: np.random.Generator) -> FloatArray:
    """Noise of a band with a standard deviation of one; beyond its ends it falls by 12 dB an octave, as thumbs do."""
    frequency_hz = np.fft.rfftfreq(samples, 1.0 / _FINE_HZ)
    low, high = _BAND_HZ
    shape = frequency_hz**2 / np.sqrt(frequency_hz**4 + low**4) / np.sqrt(1.0 + (frequency_hz / high) ** 4)
    values = np.fft.irfft(shape * np.fft.rfft(rng.standard_normal(samples)), samples)
    return np.asarray(values / max(float(values.std()), 1e-12))


def _bursts(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """One while the pilot is busy, zero while he rests, with smooth flanks."""
    edges, values = [0.0], [0.0]
    at = float(rng.uniform(*_REST_S))
    while at < time_s[-1]:
        busy_s, rest_s = float(rng.uniform(*_BURST_S)), float(rng.uniform(*_REST_S))
        edges += [at, at + 0.3, at + busy_s - 0.3, at + busy_s]
        values += [0.0, 1.0, 1.0, 0.0]
        at += busy_s + rest_s
    return np.interp(time_s, edges, values)


def _moves(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Moves out and back along half a cosine."""
    moved = np.zeros(time_s.size)
    at = float(rng.uniform(*_MOVE_EVERY_S))
    while at < time_s[-1]:
        size = float(rng.uniform(*_MOVE) * rng.choice([-1.0, 1.0]))
        rise_s, hold_s, fall_s = (float(rng.uniform(*span)) for span in (_RISE_S, _MOVE_HELD_S, _RISE_S))
        moved += size * (_flank(time_s - at, rise_s) - _flank(time_s - at - rise_s - hold_s, fall_s))
        at += rise_s + hold_s + fall_s + float(rng.uniform(*_MOVE_EVERY_S))
    return moved


def _flank(time_s: FloatArray, rise_s: float) -> FloatArray:
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(time_s / rise_s, 0.0, 1.0)))
