r"""Noise of a flight as spectra: density against a level such as the throttle, and the lines in it.

The density of a window of :math:`N` samples at the rate :math:`f_s`, one-sided, with Hann's taper :math:`w`, is

.. math:: S(f_k) = \frac{2 |\sum_n w_n x_n e^{-j 2 \pi k n / N}|^2}{f_s \sum_n w_n^2}

so that its sum over frequency is the mean square. Windows overlap by three quarters and are averaged by level: the
motors' speed moves with it, and an average over a whole flight would smear every line of theirs. Of :math:`n` such
windows :math:`n / 1.92` count as independent, and the density has a :math:`\chi^2` error with twice as many degrees of
freedom. A line whose frequency moves with the level is a rotor's, one that stays is the frame's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.typing import FloatArray, IntArray

WINDOW_S = 0.3
OVERLAP = 0.75
FEWEST_WINDOWS = 4
"""Windows of a level without which its density is not known."""

LEAST_HEIGHT_DB = 6.0
"""Height above its surroundings from which a line is a peak."""

HARMONICS = 3
"""Multiples of the speed of a rotor that are looked for; the third is the passage of three blades."""

_FLOOR_HZ = 60.0
"""Half width of the surroundings over whose median a line stands."""

_FEWEST_BINS = 4
"""Levels that make a line."""

_STAYS, _MOVES = 0.25, 0.4
"""Parts of the movement to be expected of a rotor by which a line of the frame may, and one of a rotor must move."""

_LEAST_LEVEL = 0.05
"""Lowest level that counts for how far the line of a rotor is to move."""

_JUMP = 0.08
"""How far a line may lie from where it is expected at the next level."""

_LONGEST_STEP = 1.5
"""Usual steps of a clock; a longer one is a gap."""

_DELAY_WINDOW_S = 1.0
"""Length of the windows by which a delay is measured."""

_MOST_MISSES = 2
"""Levels without it that end a line."""

Maker = Literal["rotor", "frame", "unknown"]


@dataclass(frozen=True, kw_only=True, eq=False)
class ShortSpectra(Immutable):
    """Densities of short windows.

    Parameters
    ----------
    time_s
        Middle of each window, shape ``(n,)``.
    frequency_hz
        Shape ``(f,)``, from one bin above zero.
    density
        One-sided, shape ``(n, f)``.
    window_s
        Length of a window.
    """

    time_s: FloatArray
    frequency_hz: FloatArray
    density: FloatArray
    window_s: float

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            frequency_hz=read_only(self.frequency_hz, np.float64, ndim=1),
            density=read_only(self.density, np.float64, ndim=2),
        )

    @property
    def bin_hz(self) -> float:
        """Distance of two frequencies."""
        return float(self.frequency_hz[0])


def stretches(time_s: FloatArray) -> tuple[slice, ...]:
    """Samples between which no step is longer than one and a half usual ones: batches, or a log without gaps.

    Examples
    --------
    >>> stretches(np.array([0.0, 1.0, 2.0, 9.0, 10.0]))
    (slice(0, 3, None), slice(3, 5, None))
    """
    if time_s.size < 2:
        return ()
    steps = np.diff(time_s)
    edges = np.flatnonzero(steps > _LONGEST_STEP * float(np.median(steps))) + 1
    ends = [0, *edges.tolist(), time_s.size]
    return tuple(slice(begin, end) for begin, end in pairwise(ends) if end - begin > 1)


def short_spectra(time_s: FloatArray, values: FloatArray) -> ShortSpectra | None:
    """Densities of windows of 0.3 s within the stretches without gaps, mean removed; each shares 3/4 with the next.

    Windows are shorter where most of the stretches are: batches of 512 samples at 2 kHz last 0.26 s.

    Parameters
    ----------
    time_s
        Rising stamps, shape ``(samples,)``.
    values
        Shape ``(samples,)``.

    Returns
    -------
    ShortSpectra or None
        ``None`` when no stretch holds a window of 16 samples.
    """
    parts = stretches(time_s)
    if not parts:
        return None
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    lengths = np.array([part.stop - part.start for part in parts])
    # The length of the stretch in which the median sample lies.
    usual = int(np.repeat(lengths, lengths)[lengths.sum() // 2]) if lengths.size > 1 else int(lengths[0])
    size = min(round(WINDOW_S * rate_hz), usual)
    if size < 16:
        return None
    step = max(round((1.0 - OVERLAP) * size), 1)
    taper = np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2
    frequency_hz: FloatArray = np.fft.rfftfreq(size, 1.0 / rate_hz)[1:].astype(np.float64)
    middles, densities = [], []
    for part in parts:
        samples = values[part]
        if samples.size < size:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(samples, size)[::step]
        spectra = np.fft.rfft((windows - windows.mean(axis=1, keepdims=True)) * taper, axis=1)[:, 1:]
        densities.append(2.0 * np.abs(spectra) ** 2 / (rate_hz * float(np.sum(taper**2))))
        middles.append(time_s[part][: samples.size - size + 1 : step] + 0.5 * size / rate_hz)
    if not densities:
        return None
    return ShortSpectra(
        time_s=np.concatenate(middles),
        frequency_hz=frequency_hz,
        density=np.concatenate(densities),
        window_s=size / rate_hz,
    )


class LevelMap(NamedTuple):
    """Density by level: centers ``(b,)``, density ``(b, f)`` with NaN where unflown, windows ``(b,)``."""

    level: FloatArray
    density: FloatArray
    windows: IntArray


def by_level(spectra: ShortSpectra, level: FloatArray, *, edges: FloatArray) -> LevelMap:
    """Mean density of the windows within each bin of a level; bins with fewer than four windows stay empty.

    Bins below the first and above the last that was flown are cut off.

    Parameters
    ----------
    spectra
        Of ``n`` windows.
    level
        Of each window, shape ``(n,)``; NaN leaves a window out.
    edges
        Of the bins, rising, shape ``(b + 1,)``.
    """
    place = np.searchsorted(edges, level, side="right") - 1
    place = np.where(np.isfinite(level) & (place >= 0) & (place < edges.size - 1), place, -1)
    windows = np.bincount(place[place >= 0], minlength=edges.size - 1)
    density = np.full((edges.size - 1, spectra.frequency_hz.size), np.nan)
    for number in np.flatnonzero(windows >= FEWEST_WINDOWS).tolist():
        density[number] = spectra.density[place == number].mean(axis=0)
    flown = np.flatnonzero(windows >= FEWEST_WINDOWS)
    kept = slice(int(flown[0]), int(flown[-1]) + 1) if flown.size else slice(0, 0)
    return LevelMap(0.5 * (edges[:-1] + edges[1:])[kept], density[kept], windows[kept])


def floor_db(frequency_hz: FloatArray, density: FloatArray) -> FloatArray:
    """Running median of a density within 60 Hz to both sides, in dB, shape of ``density``."""
    from scipy.ndimage import median_filter

    with np.errstate(divide="ignore"):
        level = 10.0 * np.log10(np.maximum(density, np.finfo(np.float64).tiny))
    width = 2 * max(int(_FLOOR_HZ / float(frequency_hz[0])), 1) + 1
    size = (1,) * (density.ndim - 1) + (min(width, frequency_hz.size),)
    return np.asarray(median_filter(level, size=size, mode="nearest"))


class Peak(NamedTuple):
    """A local maximum: its frequency between the bins, and its height over the surroundings."""

    frequency_hz: float
    height_db: float


def peaks(frequency_hz: FloatArray, density: FloatArray, *, above_hz: float = 0.0) -> tuple[Peak, ...]:
    r"""Maxima that stand 6 dB and more above the running median, the highest first.

    The frequency is that of a parabola through three bins in dB, exact for a line within Hann's taper to 3 % of a bin.

    Parameters
    ----------
    frequency_hz
        Evenly spaced, shape ``(f,)``.
    density
        Shape ``(f,)``.
    above_hz
        Below it, where the vehicle moves, nothing counts.
    """
    if frequency_hz.size < 5 or not np.all(np.isfinite(density)):
        return ()
    with np.errstate(divide="ignore"):
        level = 10.0 * np.log10(np.maximum(density, np.finfo(np.float64).tiny))
    height = level - floor_db(frequency_hz, density)
    inner = np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] >= level[2:])) + 1
    inner = inner[(height[inner] >= LEAST_HEIGHT_DB) & (frequency_hz[inner] >= above_hz)]
    found = []
    for place in inner[np.argsort(-height[inner], kind="stable")].tolist():
        before, here, after = level[place - 1 : place + 2]
        bend = before - 2.0 * here + after
        offset = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
        found.append(Peak(float(frequency_hz[place] + offset * (frequency_hz[1] - frequency_hz[0])), height[place]))
    return tuple(found)


@dataclass(frozen=True, kw_only=True, eq=False)
class Line(Immutable):
    """A line of a map, followed from level to level.

    Parameters
    ----------
    level, frequency_hz, height_db
        Where it was seen, shape ``(points,)``, rising levels.
    slope_hz, slope_std_hz
        Change of frequency by unit of level, and its standard deviation.
    """

    level: FloatArray
    frequency_hz: FloatArray
    height_db: FloatArray
    slope_hz: float
    slope_std_hz: float

    def __post_init__(self) -> None:
        names = ("level", "frequency_hz", "height_db")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1) for name in names})

    @property
    def maker(self) -> Maker:
        r"""A rotor where the frequency rises with the level, the frame where it stays, else unknown.

        Thrust rises with the square of the speed, so that a rotor's moves by about
        :math:`\tfrac{1}{2} \ln(l_1 / l_0)` of itself: a rotor is what moves by 0.4 of that, the frame what moves by
        less than 0.25, each with two standard deviations.
        """
        middle, span = float(np.median(self.frequency_hz)), float(np.ptp(self.level))
        moved, error = self.slope_hz * span / middle, 2.0 * self.slope_std_hz * span / middle
        low = max(float(self.level.min()), _LEAST_LEVEL)
        expected = 0.5 * math.log(max(float(self.level.max()), low) / low)
        if moved - error > _MOVES * expected > 0.0:
            return "rotor"
        return "frame" if abs(moved) + error < _STAYS * expected else "unknown"


def lines(level_map: LevelMap, frequency_hz: FloatArray, *, above_hz: float = 0.0) -> tuple[Line, ...]:
    """Lines of a map: peaks of neighboring levels that go on in each other, the strongest first.

    A line is followed from its strongest peak to both sides, to the peak nearest to where it should be, within 8 % of
    its frequency; two levels without it end it. Fewer than four levels make no line.

    Parameters
    ----------
    level_map
        Of :func:`by_level`.
    frequency_hz
        Shape ``(f,)``.
    above_hz
        Below it nothing counts.
    """
    left: dict[int, list[Peak]] = {
        row: list(peaks(frequency_hz, density, above_hz=above_hz)) for row, density in enumerate(level_map.density)
    }
    found = []
    while any(left.values()):
        start = max((row for row in left if left[row]), key=lambda row: left[row][0].height_db)
        line = {start: left[start].pop(0)}
        for direction in (1, -1):
            _follow(line, left, start, direction)
        if len(line) >= _FEWEST_BINS:
            rows = sorted(line)
            found.append(_line(level_map.level[rows], [line[row] for row in rows], float(frequency_hz[0])))
    return tuple(sorted(found, key=lambda line: -float(line.height_db.mean() * math.sqrt(line.level.size))))


def _follow(line: dict[int, Peak], left: dict[int, list[Peak]], start: int, direction: int) -> None:
    row, missed = start + direction, 0
    while row in left and missed < _MOST_MISSES:
        known = sorted(line, key=lambda other: abs(other - row))[:2]
        expected = line[known[0]].frequency_hz
        if len(known) == 2:
            slope = (line[known[0]].frequency_hz - line[known[1]].frequency_hz) / (known[0] - known[1])
            expected += 0.5 * slope * (row - known[0])
        near = [peak for peak in left[row] if abs(peak.frequency_hz / expected - 1.0) < _JUMP]
        if near:
            line[row] = min(near, key=lambda peak: abs(peak.frequency_hz - expected))
            left[row].remove(line[row])
            missed = 0
        else:
            missed += 1
        row += direction


def _line(level: FloatArray, points: Sequence[Peak], bin_hz: float) -> Line:
    frequency = np.array([point.frequency_hz for point in points])
    offset = level - level.mean()
    slope = float(offset @ frequency / (offset @ offset))
    rest = frequency - frequency.mean() - slope * offset
    # A bin is known to a part of its width even where all points agree.
    spread = max(float(np.sqrt(rest @ rest / max(level.size - 2, 1))), bin_hz / math.sqrt(12.0))
    return Line(
        level=level,
        frequency_hz=frequency,
        height_db=np.array([point.height_db for point in points]),
        slope_hz=slope,
        slope_std_hz=spread / math.sqrt(float(offset @ offset)),
    )


class Harmonics(NamedTuple):
    """Which harmonic of a rotor lies nearest to each frequency, shape ``(n,)``, and how far away, in Hz."""

    order: IntArray
    distance_hz: FloatArray


def nearest_harmonic(frequency_hz: FloatArray, rotors_hz: FloatArray, *, most: int = HARMONICS) -> Harmonics:
    """The harmonic of any rotor that lies nearest to a frequency.

    Parameters
    ----------
    frequency_hz
        One for each window, shape ``(n,)``.
    rotors_hz
        Turns per second of each rotor in each window, shape ``(rotors, n)``.
    most
        Highest harmonic that counts.

    Examples
    --------
    >>> found = nearest_harmonic(np.array([101.0, 190.0]), np.array([[50.0, 95.0], [60.0, 99.0]]))
    >>> found.order.tolist(), found.distance_hz.tolist()
    ([2, 2], [1.0, 0.0])
    """
    orders = np.arange(1, most + 1)
    distance = np.abs(rotors_hz[None] * orders[:, None, None] - frequency_hz)
    nearest = distance.min(axis=1)
    best = np.argmin(nearest, axis=0)
    return Harmonics(orders[best], np.take_along_axis(nearest, best[None], axis=0)[0])


class Delay(NamedTuple):
    """A delay in seconds with its standard deviation, and the mean coherence of the band."""

    delay_s: float
    std_s: float
    coherence: float


def measured_delay(
    time_s: FloatArray,
    before: FloatArray,
    after: FloatArray,
    *,
    band_hz: tuple[float, float],
) -> Delay | None:
    r"""Delay of a filter from what goes in and what comes out, by the slope of the phase through zero.

    .. math:: \tau = -\frac{\sum \omega \varphi / \sigma^2}{\sum \omega^2 / \sigma^2}, \qquad
        \sigma^2 = \frac{1 - \gamma^2}{2 n \gamma^2}

    A filter adds no noise of its own, so that the response is the plain ratio of spectra. Over the band its delay is
    taken as constant; a low-pass delays the top of its band less than the bottom.

    Parameters
    ----------
    time_s, before, after
        On one clock, shape ``(samples,)``.

    Returns
    -------
    Delay or None
        ``None`` where fewer than eight windows, or none of the band, show it.
    """
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    size = round(_DELAY_WINDOW_S * rate_hz)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, 1.0 / rate_hz)
    chosen = (omega >= 2.0 * np.pi * band_hz[0]) & (omega <= 2.0 * np.pi * min(band_hz[1], 0.4 * rate_hz))
    taper = np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2
    auto, cross, count = np.zeros((2, omega.size)), np.zeros(omega.size, dtype=np.complex128), 0
    for part in stretches(time_s):
        for begin in range(part.start, part.stop - size + 1, max(size // 2, 1)):
            pair = np.stack([before[begin : begin + size], after[begin : begin + size]])
            spectra = np.fft.rfft((pair - pair.mean(axis=1, keepdims=True)) * taper, axis=1)
            auto += np.abs(spectra) ** 2
            cross += spectra[0].conj() * spectra[1]
            count += 1
    if count < 8 or np.count_nonzero(chosen) < 3:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.nan_to_num(np.abs(cross) ** 2 / (auto[0] * auto[1]))[chosen]
    known = np.clip(coherence, 1e-3, 1.0 - 1e-9)
    phase, omega = np.unwrap(np.angle(cross[chosen])), omega[chosen]
    phase = phase - 2.0 * np.pi * np.round(phase[0] / (2.0 * np.pi))
    weight = known / (1.0 - known) * (coherence > 0.3)
    power = float(np.sum(weight * omega**2))
    if power <= 0.0:
        return None
    delay = -float(np.sum(weight * omega * phase)) / power
    # What is left beside a constant delay spreads it too: a filter is none.
    rest = phase + omega * delay
    freedom = max(int(np.count_nonzero(weight)) - 1, 1)
    scatter = float(np.sum(weight * rest**2)) / freedom
    return Delay(delay, math.sqrt(max(scatter, 1.0 / (1.3 * count)) / power), float(coherence.mean()))


class Unexplained(NamedTuple):
    """Root mean square of what a reference does not explain in a band, and its standard deviation."""

    rms: float
    std: float


def unexplained(
    time_s: FloatArray,
    values: FloatArray,
    reference: FloatArray | None,
    *,
    bands_hz: Sequence[tuple[float, float]],
    window_s: float = 0.5,
    gain: FloatArray | None = None,
) -> tuple[Unexplained, ...] | None:
    r"""Noise of a signal: :math:`\int S_{xx} (1 - \gamma^2) df` over a band, with its spread between parts of a flight.

    Assumes that noise does not move the reference. In a loop that feeds back, the part of the noise that the reference
    follows is missing from the number.

    Parameters
    ----------
    time_s, values
        Shape ``(samples,)``.
    reference
        What was asked for; ``None`` where the whole density is noise.
    window_s
        Length of a window, about.
    gain
        What to multiply the density with at :func:`unexplained_frequencies`, shape ``(f,)``; one when not given.

    Returns
    -------
    tuple of Unexplained or None
        One for each band; ``None`` for fewer than eight windows.
    """
    frequency = unexplained_frequencies(time_s, window_s=window_s)
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    size = 2 * (frequency.size - 1)
    if size < 16:
        return None
    taper = np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2
    step, rows = size // 2, [values] if reference is None else [values, reference]
    spectra = []
    for part in stretches(time_s):
        if part.stop - part.start >= size:
            windows = np.stack([np.lib.stride_tricks.sliding_window_view(row[part], size)[::step] for row in rows])
            spectra.append(np.fft.rfft((windows - windows.mean(axis=2, keepdims=True)) * taper, axis=2))
    # Shape (signals, windows, frequencies).
    found = np.concatenate(spectra, axis=1) if spectra else np.zeros((1, 0, 1), dtype=np.complex128)
    count = found.shape[1]
    if count < 8:
        return None
    squares = np.abs(found) ** 2
    share = np.ones(frequency.size)
    if reference is not None:
        cross, auto = np.mean(found[1].conj() * found[0], axis=0), squares.mean(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            coherence = np.nan_to_num(np.abs(cross) ** 2 / (auto[0] * auto[1]))
        # Fitting a reference that explains nothing takes 1/n of n windows.
        share = np.minimum((1.0 - coherence) * count / (count - 1.0), 1.0)
    scale = 2.0 / (rate_hz * float(np.sum(taper**2))) * float(frequency[1])
    weight = scale * share * (1.0 if gain is None else gain)
    return tuple(_rms(squares[0] @ (weight * ((frequency >= low) & (frequency <= high)))) for low, high in bands_hz)


def unexplained_frequencies(time_s: FloatArray, *, window_s: float = 0.5) -> FloatArray:
    """Frequencies in Hz of the windows of :func:`unexplained`, whose length is even and has small factors."""
    from scipy.fft import next_fast_len

    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    size = 2 * int(next_fast_len(max(int(0.5 * window_s * rate_hz), 1), real=True))
    return np.asarray(np.fft.rfftfreq(size, 1.0 / rate_hz), dtype=np.float64)


def _rms(power: FloatArray) -> Unexplained:
    """Root of the mean over windows, with its spread between parts of the flight."""
    total = float(power.mean())
    if total <= 0.0:
        return Unexplained(0.0, 0.0)
    each = [float(part.mean()) for part in np.array_split(power, min(8, power.size // 4))]
    return Unexplained(math.sqrt(total), 0.5 * float(np.std(each, ddof=1)) / math.sqrt(len(each) * total))
