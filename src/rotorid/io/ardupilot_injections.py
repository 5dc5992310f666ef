"""What ArduPilot's SYSTEMID mode would say of the sweeps in a flight: its runs (``SIDS``) and their samples (``SIDD``).

The mode injects one logarithmic chirp on one axis at a time. Its messages have no word for a doublet, a multisine or a
random signal: of those a log shows what arrived at the mixer (``RATE``), and no more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise, zip_longest

import numpy as np

from rotorid.data.maneuver import Maneuver
from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.io.ardupilot_systemid import ENTRIES
from rotorid.typing import FloatArray, IntArray
from rotorid.units import parse_unit

MIXER = 10
"""Entry (``SID_AXIS``) of an injection into the mixer's roll input; pitch, yaw and thrust follow."""

_STEADY = 0.01
"""A half wave within this part of the longest one's length, and one sample, has the lowest frequency."""

_FULL = 0.95
"""Half waves of this part of the magnitude are past the fade; those of what remains of one are too small to tell."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Injection:
    """One run of SYSTEMID mode.

    Parameters
    ----------
    samples
        Its samples in the flight, rising.
    entry
        ``SID_AXIS``.
    target
        The injected signal at them, in the unit of the entry.
    elapsed_s
        Time of the waveform at them; the mode counts from its first turn of the loop.
    frequency_hz
        Frequency of the waveform at them; zero when the band is not known.
    settings
        Columns of ``SIDS`` beside stamp and axis.
    """

    samples: IntArray
    entry: int
    target: FloatArray
    elapsed_s: FloatArray
    frequency_hz: FloatArray
    settings: Mapping[str, float]


def injections(flown: SimulatedFlight) -> tuple[Injection, ...]:
    """Runs in the order flown: the sweeps whose signal is an excitation that the flight holds.

    The axis of a run is the mixer's, unless ``SID_AXIS`` among the parameters of the flight names another entry of the
    same axis.

    Raises
    ------
    UsageError
        Two sweeps overlap.
    """
    swept = sorted((one for one in flown.maneuvers if _is_injected(one, flown)), key=lambda one: one.start_s)
    for one, other in pairwise(swept):
        if other.start_s < one.stop_s:
            raise UsageError(
                f"the sweeps of {one.axis} until {one.stop_s:g} s and of {other.axis} from {other.start_s:g} s on "
                "overlap",
                needed="one sweep at a time, which is what ArduPilot's SYSTEMID mode can inject",
                remedy="fly them one after the other, or write another format",
            )
    return tuple(_injections(flown, swept))


def _is_injected(maneuver: Maneuver, flown: SimulatedFlight) -> bool:
    return maneuver.kind == "sweep" and maneuver.signal.endswith("_excitation") and maneuver.signal in flown.columns


def _injections(flown: SimulatedFlight, swept: list[Maneuver]) -> Iterator[Injection]:
    slack = 0.5 / flown.sample_rate_hz
    for one, following in zip_longest(swept, swept[1:]):
        # The last sample is the one at which the sweep is over, unless the next one begins there.
        last_s = one.stop_s + slack if following is None else min(one.stop_s + slack, following.start_s - slack)
        samples = np.flatnonzero((flown.time_s > one.start_s - slack) & (flown.time_s < last_s))
        if samples.size:
            yield _injection(flown, one, samples)


def _injection(flown: SimulatedFlight, maneuver: Maneuver, samples: IntArray) -> Injection:
    entry = _entry(maneuver, flown.parameters)
    period_s = 1.0 / flown.sample_rate_hz
    target = flown.columns[maneuver.signal][samples] / parse_unit(ENTRIES[entry][1]).factor
    elapsed_s = flown.time_s[samples] - flown.time_s[samples[0]]
    low, high = (value / (2.0 * math.pi) for value in maneuver.band_rad_s or (0.0, 0.0))
    magnitude, fade_in_s, constant_s, fade_out_s = waveform_settings(target, elapsed_s, low)
    settings = {
        "Mag": magnitude,
        "FSt": low,
        "FSp": high,
        "TFin": fade_in_s,
        "TC": constant_s,
        "TR": maneuver.duration_s,
        "TFout": fade_out_s,
    }
    return Injection(
        samples=samples,
        entry=entry,
        target=target,
        elapsed_s=elapsed_s + period_s,
        frequency_hz=_frequency(elapsed_s, low, high, constant_s),
        settings=settings,
    )


def _entry(maneuver: Maneuver, parameters: Mapping[str, float]) -> int:
    named = int(parameters.get("SID_AXIS", 0.0))
    if named in ENTRIES and ENTRIES[named][0] == maneuver.axis:
        return named
    return next(entry for entry in range(MIXER, MIXER + 4) if ENTRIES[entry][0] == maneuver.axis)


def _frequency(elapsed_s: FloatArray, low: float, high: float, constant_s: float) -> FloatArray:
    """Frequency of a logarithmic chirp that stays at its lowest one for a while, Hz."""
    swept_s = np.maximum(elapsed_s - constant_s, 0.0)
    if not 0.0 < low < high or swept_s[-1] <= 0.0:
        return np.full(elapsed_s.size, low)
    frequency: FloatArray = low * np.exp(math.log(high / low) * swept_s / swept_s[-1])
    return frequency


def waveform_settings(target: FloatArray, elapsed_s: FloatArray, low_hz: float) -> tuple[float, float, float, float]:
    r"""Magnitude, fade in, time of constant frequency and fade out of a chirp, read off its half waves.

    In the middle of a half wave, at time t inside a raised-cosine fade of length T, the signal is
    :math:`A \sin^2(\tfrac{\pi}{2} t / T)`, which gives T for every half wave; the median is taken. The frequency is
    constant for as long as the half waves are as long as one of the lowest frequency, within one percent. A waveform
    that is no chirp, or that has noise on it, has a true magnitude and meaningless times.

    Parameters
    ----------
    target, elapsed_s
        The injected signal and the time since it began, shape ``(samples,)``.
    low_hz
        Its lowest frequency; zero when not known.

    Examples
    --------
    >>> time_s = np.arange(4000) / 400.0
    >>> fade = np.sin(0.5 * np.pi * np.clip(time_s / 2.0, 0.0, 1.0)) ** 2
    >>> [round(value, 1) for value in waveform_settings(0.2 * fade * np.sin(30.0 * time_s), time_s, 0.0)]
    [0.2, 2.0, 0.0, 0.0]
    """
    size = np.abs(target)
    magnitude = float(size.max())
    moving = np.flatnonzero(size)
    crossings = moving[1:][np.diff(np.signbit(target[moving]))]
    begins = np.append(0, crossings)
    centers = (begins + np.append(crossings, target.size)) // 2
    heights = size[centers] / (magnitude or 1.0)
    fade_in_s = _fade(elapsed_s[centers], heights)
    fade_out_s = _fade((elapsed_s[-1] - elapsed_s[centers])[::-1], heights[::-1])
    half_s = 0.5 / low_hz if low_hz else math.inf
    steady = np.abs(np.diff(elapsed_s[begins]) - half_s) < _STEADY * half_s + elapsed_s[1] - elapsed_s[0]
    constant_s = float(elapsed_s[begins[np.argmin(steady)]]) if steady.any() and not steady.all() else 0.0
    return magnitude, fade_in_s, constant_s, fade_out_s


def _fade(distances_s: FloatArray, heights: FloatArray) -> float:
    """Length of a raised-cosine fade, from half waves at their distances from its beginning; zero without one."""
    faded = int(np.argmax(heights > _FULL))
    inside = (heights[:faded] > 1.0 - _FULL) & (distances_s[:faded] > 0.0)
    if not inside.any():
        return 0.0
    rise = np.arcsin(np.sqrt(heights[:faded][inside])) / (0.5 * math.pi)
    return float(np.median(distances_s[:faded][inside] / rise))
