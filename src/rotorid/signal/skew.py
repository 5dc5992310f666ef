"""Time skew: by how much one channel lags another, to a fraction of a sample, and how to take it out.

The skew is the slope of the phase of a cross-spectrum over its coherent lines.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.quantity import milliseconds
from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import BoolArray, ComplexArray, FloatArray

Relation: TypeAlias = Literal["same", "opposite", "derivative", "opposite derivative", "integral", "opposite integral"]

_QUARTER_TURNS: Mapping[Relation, int] = {
    "same": 0,
    "derivative": 1,
    "opposite integral": 1,
    "opposite": 2,
    "integral": 3,
    "opposite derivative": 3,
}

_LONGEST_SKEW_S = 0.5
"""Skews up to this are searched."""

_WINDOW_SHARE = 0.25
"""Share of a window up to which skews are searched, where that is less."""

_GRID_STEP_RAD = 0.5
_REFINEMENTS = 8

_SURE = 3.0
"""Standard deviations beyond which a skew of more than a sample is a warning."""


@dataclass(frozen=True, kw_only=True)
class TimeSkew:
    """How far one channel comes after another.

    Parameters
    ----------
    reference, delayed
        The channels. ``seconds`` is positive when ``delayed`` comes later.
    seconds, std
        The skew and one standard deviation of it.
    coherence
        Mean coherence of the lines behind it, weighted as they were.
    relation
        What ``delayed`` is to ``reference`` apart from the skew.
    band_rad_s
        Lowest and highest line that was used.
    findings
        The skew in words: ``clock_skew``, a warning when it is surely longer than one sample.
    """

    reference: str
    delayed: str
    seconds: float
    std: float
    coherence: float
    relation: Relation
    band_rad_s: tuple[float, float]
    findings: tuple[Finding, ...] = ()


def time_skew(
    history: TimeHistory,
    *,
    reference: str,
    delayed: str,
    band_rad_s: tuple[float, float] | None = None,
    relation: Relation | None = None,
    known_lag_s: float = 0.0,
    known_delay_s: float = 0.0,
) -> TimeSkew:
    r"""Delay between two channels, from the slope of the phase between them.

    .. math:: \arg S_{rd}(\omega) = k \frac{\pi}{2} - \omega \, \tau - \omega \, \tau_0 - \arctan \omega T_0

    with the quarter turns :math:`k` of the relation, the known delay and lag :math:`\tau_0, T_0`, and every line
    weighted by the inverse variance of its phase, :math:`2 n_d \gamma^2 / (1 - \gamma^2)`. Lines below a coherence of
    0.6 are not used. The standard deviation grows with misfit: lines that do not lie on a straight line say that the
    phase is not a delay alone.

    **What can be found.** Between two channels that measure one motion (two gyros, an attitude rate and a gyro, a
    channel and its copy) the whole skew, far below one sample. Skews up to 0.5 s are searched.

    **What cannot.** Between a motor or a command and a gyro, the delay of the vehicle, the lag of its motors, the
    filter of its gyro and an error of stamps all turn the phase alike: one record gives their sum. Give what is known
    as ``known_delay_s`` and ``known_lag_s``, or subtract the skews of two records, in which the vehicle cancels. With
    feedback and little excitation the phase leans toward that of the inverse controller.

    Parameters
    ----------
    history
        Both channels on one clock.
    reference, delayed
        Channel names.
    band_rad_s
        Where to look; by default from two periods in a window to 0.8 of the Nyquist frequency.
    relation
        Found from the phase when it is not given. A narrow band far from zero cannot separate relations: give it.
    known_lag_s, known_delay_s
        What lies between the channels besides the skew.

    Raises
    ------
    UsageError
        There is no such channel, or the band or the relation makes no sense.
    InsufficientDataError
        The record is too short, or the channels are not coherent.

    References
    ----------
    J. S. Bendat and A. G. Piersol, *Random Data*, 4th edition, 2010, sections 5.2.4 and 9.2.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> motion = np.cumsum(np.random.default_rng(0).standard_normal(8000))
    >>> history = TimeHistory(
    ...     values=np.stack([motion[3:], motion[:-3]]), sample_rate_hz=200.0, start_s=0.0,
    ...     channels=(Channel(name="p", unit="rad/s"), Channel(name="p_other", unit="rad/s")),
    ... )
    >>> skew = time_skew(history, reference="p", delayed="p_other")
    >>> round(1e3 * skew.seconds, 1), skew.relation
    (15.0, 'same')
    """
    if relation is not None and relation not in _QUARTER_TURNS:
        raise UsageError(f"unknown relation {relation!r}", needed=f"one of {', '.join(_QUARTER_TURNS)}")
    lines = coherent_lines(cross_spectrum(history, reference, delayed, band_rad_s=band_rad_s), f"{delayed}/{reference}")
    known = lines.omega_rad_s * known_delay_s + np.arctan(lines.omega_rad_s * known_lag_s)
    phase = np.angle(lines.cross) + known
    weight = lines.weight
    turns, start_s = _coarse(phase, weight, lines, relation)
    seconds, std = _refined(phase - turns * np.pi / 2.0, weight, lines.omega_rad_s, start_s)
    found = relation or _named(turns, lines)
    return TimeSkew(
        reference=reference,
        delayed=delayed,
        seconds=seconds,
        std=std,
        coherence=float(np.average(lines.coherence, weights=weight)),
        relation=found,
        band_rad_s=(float(lines.omega_rad_s[0]), float(lines.omega_rad_s[-1])),
        findings=(_finding(reference, delayed, seconds, std, 1.0 / history.sample_rate_hz),),
    )


def shift(history: TimeHistory, channel: str, seconds: float) -> TimeHistory:
    r"""Delay one channel against the others, by any fraction of a sample.

    .. math:: y(t) = x(t - \tau)

    as a turn of the phase of every Fourier line: exact for what lies below the Nyquist frequency. The line through the
    first and last sample is shifted apart, and the rest continued as its own point reflection, so that ends that differ
    do not ring. Samples that would come from outside the record are cut from all channels. What remains within a few
    samples of an end still leans on the reflection.

    Parameters
    ----------
    history
        At least four samples.
    channel
        Name of the channel.
    seconds
        Positive delays it; ``-skew.seconds`` takes a :class:`TimeSkew` out of its ``delayed`` channel.

    Raises
    ------
    UsageError
        There is no such channel, or the shift is not finite.
    InsufficientDataError
        The record is no longer than the shift, or the channel holds samples that are not finite.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> history = TimeHistory(
    ...     values=np.arange(6.0)[None], channels=(Channel(name="q", unit="rad/s"),), sample_rate_hz=10.0, start_s=0.0
    ... )
    >>> shift(history, "q", 0.05)["q"].round(6).tolist()
    [0.5, 1.5, 2.5, 3.5, 4.5]
    """
    if channel not in history.names:
        raise UsageError(f"there is no channel {channel} in the data", needed=f"one of {', '.join(history.names)}")
    if not math.isfinite(seconds):
        raise UsageError(f"the shift {seconds} s is not finite", needed="a finite number")
    samples = seconds * history.sample_rate_hz
    lost = math.ceil(abs(samples) - 1e-9)
    count = history.values.shape[1]
    if count - lost < 4 or not np.isfinite(history[channel]).all():
        raise InsufficientDataError(
            f"cannot shift {count} samples of {channel} by {abs(samples):.4g}",
            needed="finite samples, at least four more than the shift",
        )
    values = history.values.copy()
    values[history.names.index(channel)] = _turned(history[channel], samples)
    kept = slice(lost, count) if samples > 0.0 else slice(0, count - lost)
    return replace(
        history,
        values=values[:, kept],
        start_s=history.start_s + kept.start / history.sample_rate_hz,
        processing=(*history.processing, f"{channel} delayed by {1e3 * seconds:.6g} ms"),
    )


def _turned(values: FloatArray, samples: float) -> FloatArray:
    slope = (values[-1] - values[0]) / (values.size - 1)
    index = np.arange(values.size)
    rest = values - (values[0] + slope * index)
    # With both ends at zero the point reflection joins smoothly, also around the period.
    period = np.concatenate([rest, -rest[-2:0:-1]])
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(period.size) * samples)
    moved = np.fft.irfft(np.fft.rfft(period) * turn, period.size)[: values.size]
    return np.asarray(moved + values[0] + slope * (index - samples))


def _coarse(
    phase: FloatArray, weight: FloatArray, lines: CrossSpectrum, relation: Relation | None
) -> tuple[int, float]:
    """Quarter turns and delay with the largest weighted cosine of the misfit: no phase needs to be unwrapped."""
    longest = min(_LONGEST_SKEW_S, _WINDOW_SHARE * lines.window_s)
    steps = math.ceil(longest * lines.omega_rad_s[-1] / _GRID_STEP_RAD)
    delays = np.linspace(-longest, longest, 2 * steps + 1)
    vectors = np.exp(1j * np.outer(delays, lines.omega_rad_s)) @ (weight * np.exp(1j * phase))
    candidates = (0, 1, 2, 3) if relation is None else (_QUARTER_TURNS[relation],)
    agreement = np.stack([(vectors * (-1j) ** turns).real for turns in candidates])
    best = np.unravel_index(int(np.argmax(agreement)), agreement.shape)
    return candidates[int(best[0])], float(delays[best[1]])


def _refined(phase: FloatArray, weight: FloatArray, omega: FloatArray, start_s: float) -> tuple[float, float]:
    """Weighted least squares of the phase on the frequency, from a start within half a turn."""
    seconds = start_s
    information = float(np.sum(weight * omega**2))
    misfit = np.zeros_like(phase)
    for _ in range(_REFINEMENTS):
        misfit = np.angle(np.exp(1j * (phase + omega * seconds)))
        seconds -= float(np.sum(weight * omega * misfit)) / information
    spread = max(1.0, float(np.sum(weight * misfit**2)) / (omega.size - 1))
    return seconds, math.sqrt(spread / information)


def _named(turns: int, lines: CrossSpectrum) -> Relation:
    """The relation behind quarter turns; a rising gain means a derivative, a falling one an integral."""
    if turns in (0, 2):
        return "same" if turns == 0 else "opposite"
    log_omega, log_gain = np.log(lines.omega_rad_s), np.log(np.abs(lines.cross) / lines.first)
    center = np.average(log_omega, weights=lines.weight)
    rising = float(np.sum(lines.weight * (log_omega - center) * log_gain)) > 0.0
    if turns == 1:
        return "derivative" if rising else "opposite integral"
    return "opposite derivative" if rising else "integral"


def _finding(reference: str, delayed: str, seconds: float, std: float, sample_s: float) -> Finding:
    long = abs(seconds) > sample_s and abs(seconds) > _SURE * std
    return (warn if long else remark)(
        "clock_skew",
        f"{delayed}/{reference}",
        f"{delayed} comes {milliseconds(abs(seconds), std)} ms {'after' if seconds >= 0.0 else 'before'} "
        f"{reference}; one sample is {1e3 * sample_s:.2f} ms.",
        skew_s=seconds,
        std_s=std,
        sample_s=sample_s,
    )


LEAST_COHERENCE = 0.6
"""Lines below it are not used, after Tischler and Remple."""

_WINDOWS = 10
_LONGEST_WINDOW_S = 20.0
_SHORTEST_WINDOW = 16
_LOWEST_PERIODS = 2
_NYQUIST_SHARE = 0.8
_LEAST_LINES = 3
_CERTAIN = 1.0 - 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossSpectrum:
    r"""Spectral lines of two channels, averaged over Hann windows that overlap by half.

    .. math:: S_{ab} = \frac1K \sum_k A_k^* B_k

    Parameters
    ----------
    omega_rad_s
        Lines, one over the window length apart, shape ``(f,)``.
    first, second, cross
        Powers of the two channels and :math:`S_{ab}`, shape ``(f,)``, on a common scale.
    averages
        Independent windows, :math:`n_d = T / T_{win}`. With lines :math:`1 / T_{win}` apart this counts every piece of
        information once, although windows and lines overlap.
    window_s
        Length of the windows.
    """

    omega_rad_s: FloatArray
    first: FloatArray
    second: FloatArray
    cross: ComplexArray
    averages: float
    window_s: float

    @property
    def coherence(self) -> FloatArray:
        """Coherence of each line, shape ``(f,)``; zero where a channel has no power."""
        power = self.first * self.second
        return np.asarray(np.divide(np.abs(self.cross) ** 2, power, out=np.zeros_like(power), where=power > 0.0))

    @property
    def weight(self) -> FloatArray:
        r"""Inverse variance of the phase and of the logarithm of the gain, :math:`2 n_d \gamma^2 / (1 - \gamma^2)`."""
        coherence = np.minimum(self.coherence, _CERTAIN)
        return np.asarray(2.0 * self.averages * coherence / (1.0 - coherence))

    def only(self, kept: BoolArray) -> CrossSpectrum:
        """Some of the lines."""
        return replace(
            self,
            omega_rad_s=self.omega_rad_s[kept],
            first=self.first[kept],
            second=self.second[kept],
            cross=self.cross[kept],
        )


def cross_spectrum(
    history: TimeHistory, first: str, second: str, *, band_rad_s: tuple[float, float] | None = None
) -> CrossSpectrum:
    """Lines of two channels from ten lengths of windows, at most 20 s each, without mean and trend.

    Parameters
    ----------
    history
        Both channels on one clock.
    first, second
        Channel names.
    band_rad_s
        Cut to two periods in a window at the low end; up to 0.8 of the Nyquist frequency when it is not given.

    Raises
    ------
    UsageError
        There is no such channel, or the band is empty.
    InsufficientDataError
        Ten windows of 16 samples do not fit, or samples are not finite.
    """
    for name in (first, second):
        if name not in history.names:
            raise UsageError(f"there is no channel {name} in the data", needed=f"one of {', '.join(history.names)}")
    count = history.values.shape[1]
    length = min(count // _WINDOWS, int(_LONGEST_WINDOW_S * history.sample_rate_hz))
    pair = np.stack([history[first], history[second]])
    if length < _SHORTEST_WINDOW or not np.isfinite(pair).all():
        raise InsufficientDataError(
            f"got {count} samples of {first} and {second}",
            needed=f"at least {_WINDOWS * _SHORTEST_WINDOW} samples, all finite",
            remedy="give a longer stretch without gaps",
        )
    spacing = 2.0 * math.pi * history.sample_rate_hz / length
    nyquist = math.pi * history.sample_rate_hz
    low, high = band_rad_s or (0.0, _NYQUIST_SHARE * nyquist)
    if not 0.0 <= low < high:
        raise UsageError(f"the band {low:g}:{high:g} rad/s is empty", needed="0 <= low < high")
    first_line = max(_LOWEST_PERIODS, math.ceil(low / spacing - 1e-9))
    last_line = math.floor(min(high, nyquist) / spacing + 1e-9)
    lines = np.arange(first_line, last_line + 1)
    a, b = _windows(pair, length)[:, :, lines]
    return CrossSpectrum(
        omega_rad_s=spacing * lines,
        first=np.mean(np.abs(a) ** 2, axis=0),
        second=np.mean(np.abs(b) ** 2, axis=0),
        cross=np.mean(a.conj() * b, axis=0),
        averages=count / length,
        window_s=length / history.sample_rate_hz,
    )


def coherent_lines(lines: CrossSpectrum, where: str) -> CrossSpectrum:
    """The lines whose coherence reaches 0.6.

    Raises
    ------
    InsufficientDataError
        They are fewer than three.
    """
    kept = lines.coherence >= LEAST_COHERENCE
    if np.count_nonzero(kept) >= _LEAST_LINES:
        return lines.only(kept)
    highest = float(lines.coherence.max(initial=0.0))
    message = f"{where} is nowhere coherent enough to see a delay; the highest coherence is {highest:.2f}."
    raise InsufficientDataError(
        message,
        needed=f"a coherence of {LEAST_COHERENCE:g} on {_LEAST_LINES} lines and more",
        remedy="choose a stretch in which both channels move, or another band",
        findings=[refusal("low_coherence", where, message, coherence=highest)],
    )


def _windows(values: FloatArray, length: int) -> ComplexArray:
    """Transforms of windows without mean and trend, shape ``(channels, windows, lines)``."""
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(length) + 0.5) / length)
    stretches = np.lib.stride_tricks.sliding_window_view(values, length, axis=1)[:, :: length // 2]
    ramp = np.arange(length) - 0.5 * (length - 1)
    slopes = stretches @ ramp / (ramp @ ramp)
    level = stretches - stretches.mean(axis=-1, keepdims=True) - slopes[..., None] * ramp
    return np.asarray(np.fft.rfft(level * taper, axis=-1))
