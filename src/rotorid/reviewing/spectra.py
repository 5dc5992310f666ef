"""Spectra of the sensors of a flight against its throttle, and where their peaks come from.

Where the log holds motor speeds, a peak belongs to the rotor whose first, second or third harmonic it lies on within
two bins (speeds are often logged ten times a second only, and rotors move in between). Elsewhere its movement with the
throttle decides. A channel logged more slowly than twice a peak's frequency shows it folded, at a frequency where
nothing vibrates: below 200 Hz of rate, and above 0.4 of any rate, no peak is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.flights.sensor_samples import LINES_ABOVE_HZ, OF_RATE, Level, Sensor, rotor_speeds_hz
from rotorid.reviewing.values import NoiseMap, NoisePeak
from rotorid.spectral.noise import (
    HARMONICS,
    ShortSpectra,
    by_level,
    floor_db,
    lines,
    nearest_harmonic,
    peaks,
)
from rotorid.typing import FloatArray

TOLERANCE_BINS = 2.0
"""Largest distance of a peak from the harmonic of its rotor."""

MOST_PEAKS = 6
"""Most peaks that are listed of a sensor."""

_UNKNOWN_MAKER = "Rotors or frame: too few throttles, or an uneven line"

BINS = 25
"""Of the throttle, each of 4 % of its range."""

_DEGREES = 180.0 / math.pi


def plotted_factor(channel: str) -> float:
    """From SI to the unit of a map: degrees for rates."""
    return _DEGREES if channel in RATES else 1.0


def map_of(sensor: Sensor, spectra: ShortSpectra, level: Level | None) -> NoiseMap:
    """Densities of a sensor in bins of the throttle; in one bin where there is none."""
    against = np.full(spectra.time_s.size, 0.5) if level is None else level.at(spectra.time_s)
    edges = np.array([0.0, 1.0]) if level is None else np.linspace(0.0, 1.0, BINS + 1)
    # Outputs slightly beyond their calibrated range belong to the outermost bins.
    against = np.where(np.isfinite(against), np.clip(against, 1e-6, 1.0 - 1e-6), np.nan)
    found = by_level(spectra, against, edges=edges)
    unit = "(deg/s)²/Hz" if sensor.channel in RATES else "(m/s²)²/Hz"
    return NoiseMap(
        channel=sensor.channel,
        stage=sensor.stage,
        against="throttle" if level is not None else "",
        level=found.level,
        frequency_hz=spectra.frequency_hz,
        density=found.density,
        windows=found.windows.astype(np.float64),
        average=spectra.density.mean(axis=0),
        unit=unit,
    )


def peaks_of(record: FlightRecord, sensor: Sensor, spectra: ShortSpectra, made: NoiseMap) -> list[NoisePeak]:
    """Peaks of a sensor with their sources, the highest first."""
    speeds = rotor_speeds_hz(record, spectra.time_s)
    named = _by_movement(sensor, made, spectra) if speeds is None else _by_speed(sensor, spectra, speeds)
    return sorted(named, key=lambda peak: -peak.height_db)[:MOST_PEAKS]


class OnHarmonics(NamedTuple):
    """Strongest peak of each window that has one: frequency, height, harmonic, distance, all of shape ``(n,)``."""

    window: FloatArray
    frequency_hz: FloatArray
    height_db: FloatArray
    order: FloatArray
    distance_bins: FloatArray

    @property
    def share(self) -> float:
        """Part of the windows whose strongest peak lies on a rotor's harmonic."""
        return float(np.mean(self.distance_bins <= TOLERANCE_BINS)) if self.window.size else 0.0


def on_harmonics(spectra: ShortSpectra, speeds_hz: FloatArray) -> OnHarmonics:
    """Strongest peak of each window, and the rotor's harmonic nearest to it.

    Parameters
    ----------
    spectra
        Of ``n`` windows.
    speeds_hz
        Turns per second, shape ``(rotors, n)``.
    """
    # Slower, the motors idle, and their harmonics lie where the vehicle flies.
    turning = np.all(np.isfinite(speeds_hz), axis=0) & (speeds_hz.min(axis=0) > LINES_ABOVE_HZ)
    rows = np.flatnonzero(turning)
    density = spectra.density[rows]
    usable = spectra.frequency_hz >= LINES_ABOVE_HZ
    inner = usable[1:-1] & (density[:, 1:-1] > density[:, :-2]) & (density[:, 1:-1] >= density[:, 2:])
    strongest = np.argmax(np.where(inner, density[:, 1:-1], 0.0), axis=1) + 1
    height = 10.0 * np.log10(np.maximum(density, 1e-300)) - floor_db(spectra.frequency_hz, density)
    top = height[np.arange(rows.size), strongest]
    kept = top >= 6.0
    rows, strongest, top = rows[kept], strongest[kept], top[kept]
    frequency = spectra.frequency_hz[strongest]
    found = nearest_harmonic(frequency, speeds_hz[:, rows], most=HARMONICS)
    return OnHarmonics(
        rows.astype(np.float64), frequency, top, found.order.astype(np.float64), found.distance_hz / spectra.bin_hz
    )


def _by_speed(sensor: Sensor, spectra: ShortSpectra, speeds_hz: FloatArray) -> Iterator[NoisePeak]:
    found = on_harmonics(spectra, speeds_hz)
    of_rotors = found.distance_bins <= TOLERANCE_BINS
    for order in range(1, HARMONICS + 1):
        own = of_rotors & (found.order == order)
        if np.count_nonzero(own) >= max(4, 0.05 * found.window.size):
            share = float(np.mean(own))
            times = {1: "the rotors' speed", 2: "twice the rotors' speed"}.get(
                order, f"{order} times the rotors' speed"
            )
            yield _peak(
                sensor,
                found.frequency_hz[own],
                float(np.median(found.height_db[own])),
                "rotor",
                order,
                f"In {100.0 * share:.0f} % of the flight the strongest vibration is at {times}",
            )
    left = np.sort(found.frequency_hz[~of_rotors])
    if left.size >= max(4, 0.1 * found.window.size):
        # Peaks off the rotors' harmonics that share a frequency while the rotors change theirs.
        width = 2.0 * TOLERANCE_BINS * spectra.bin_hz
        counts = np.searchsorted(left, left + width) - np.arange(left.size)
        first = int(np.argmax(counts))
        together = left[first : first + int(counts[first])]
        moved = float(np.std(np.nanmean(speeds_hz, axis=0))) > TOLERANCE_BINS * spectra.bin_hz
        if together.size >= max(4, 0.1 * found.window.size):
            inside = (found.frequency_hz >= together[0]) & (found.frequency_hz <= together[-1]) & ~of_rotors
            height = float(np.median(found.height_db[inside]))
            yield _peak(
                sensor,
                together,
                height,
                "frame" if moved else "unknown",
                None,
                "Its frequency does not follow the rotors" if moved else "It is no harmonic of a rotor",
            )


def _by_movement(sensor: Sensor, made: NoiseMap, spectra: ShortSpectra) -> Iterator[NoisePeak]:
    from rotorid.spectral.noise import LevelMap

    level_map = LevelMap(made.level, made.density, made.windows.astype(np.int64))
    known = []
    for line in lines(level_map, made.frequency_hz, above_hz=LINES_ABOVE_HZ) if made.level.size > 1 else ():
        low, high = (float(line.frequency_hz[place]) for place in (0, -1))
        if max(low, high) > OF_RATE * sensor.rate_hz:
            continue
        known.append((min(low, high), max(low, high)))
        moves = f"It rises from {low:.0f} to {high:.0f} Hz with the throttle, from {line.level[0]:.2f} to "
        sentence = {
            "rotor": moves + f"{line.level[-1]:.2f}, like a rotor",
            "frame": f"It stays at {np.median(line.frequency_hz):.0f} Hz at any throttle, like a frame resonance",
            "unknown": _UNKNOWN_MAKER,
        }[line.maker]
        yield _peak(sensor, line.frequency_hz, float(np.median(line.height_db)), line.maker, None, sentence)
    for peak in peaks(made.frequency_hz, made.average, above_hz=LINES_ABOVE_HZ):
        margin = 3.0 * spectra.bin_hz
        if peak.frequency_hz > OF_RATE * sensor.rate_hz:
            continue
        if not any(low - margin <= peak.frequency_hz <= high + margin for low, high in known):
            spot = np.array([peak.frequency_hz - 0.5 * spectra.bin_hz, peak.frequency_hz + 0.5 * spectra.bin_hz])
            yield _peak(sensor, spot, peak.height_db, "unknown", None, _UNKNOWN_MAKER)


def _peak(
    sensor: Sensor,
    frequency_hz: FloatArray,
    height_db: float,
    source: Literal["rotor", "frame", "unknown"],
    harmonic: int | None,
    sentence: str,
) -> NoisePeak:
    """A peak with the range in which it was seen: rotors change their speed, which is no error of the frequency."""
    value = float(np.median(frequency_hz))
    low, high = (float(end) for end in np.percentile(frequency_hz, [2.5, 97.5]))
    return NoisePeak(
        channel=sensor.channel,
        frequency_hz=Quantity(
            value=value, std=float(np.std(frequency_hz)), lower=min(low, value), upper=max(high, value), unit="Hz"
        ),
        height_db=height_db,
        source=source,
        harmonic=harmonic,
        sentence=f"{sentence}: {height_db:.0f} dB above its surroundings.",
    )
