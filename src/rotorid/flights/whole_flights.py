r"""A flight prepared for its loops: when it flew, the instrument of each axis, and channels on one fast clock.

In flight by stick the set-points contain feedback: the response to them is estimated jointly with the stick, which
contains none. In acro the set-point is the pilot's own. A stick is often logged at 5 to 50 Hz only. As an instrument it
need not follow the motion, only be correlated with it and free of feedback; so it is held up to the rate of the
channels that it explains, instead of thinning these out to its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.record import FlightRecord, Intervals, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import Airborne, airborne
from rotorid.signal.clock import missing_channel, resample, rises, source_topic
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import Axis, ComplexArray, FloatArray

Instrument: TypeAlias = Literal["injection", "excitation", "direct", "stick", "setpoint"]
"""Instruments of a loop, best first: a test signal at the mixer, another excitation, rate set-points that are the
sticks, the stick, or the rate set-point.
"""

LEAST_STICK = 0.01
"""A stick whose standard deviation is smaller counts as idle."""

LEAST_RATE_RAD_S = 0.05
"""Set-point motion below which body rates count as idle."""

LEAST_MOTION_S = 10.0
"""Sticks that moved for less give no reliable result."""

USABLE_ERROR = 0.3
"""A response is used where its magnitude is known better than this, one standard deviation."""

INDEPENDENT_FLOOR, SHARED_FLOOR, SHARED_OVER = 0.003, 0.01, 0.5
"""Relative errors that no record shortens: a flight is no linear system. What neighbors share falls to 1/e over half of
a natural logarithm of frequency."""

_WINDOWS_S = (16.0, 8.0, 4.0, 2.0, 1.0)
_SHORT_WINDOW_S = 0.5
_SLOW_WINDOWS_S = (24.0, 16.0, 8.0, 4.0, 2.0)

_SHORT_S, _REFERENCE_S, _SMEARED, _SMEARED_TO_RAD_S = 1.5, 8.0, 2.0, 100.0
"""Windows up to the first length are left out where they hold more than twice the power of one up to the second, at any
frequency up to the last: a stick whose motion ends steeply fills them beyond that end."""

_FAST_HZ = 900.0
"""From this rate on a log shows loops up to the higher end of the band."""

_POINTS = 55
_LOWEST_RAD_S, _LOWEST_SLOW_RAD_S = 0.7, 0.4
_HIGHEST_RAD_S, _HIGHEST_FAST_RAD_S = 200.0, 250.0

_OF_NYQUIST = 0.4
"""Share of the Nyquist frequency of a log up to which it is read."""

_ENOUGH_RATE_HZ = 500.0
"""Faster channels are thinned out, but not below this."""

_SHORTEST_S = 4.0
"""Shorter stretches are left out."""

_MOTION_WINDOW_S = 1.0
"""Window in which a stick moves or is idle."""

_MOSTLY = 0.5
"""Share of the flight in which a set-point has to be the pilot's own for the direct response to be taken."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightData(Immutable):
    """A record with its flights.

    Parameters
    ----------
    airborne
        Its flights, and the evidence for them.
    """

    record: FlightRecord
    airborne: Airborne

    @property
    def flights(self) -> Intervals:
        """In the air, on the log's own clock."""
        return self.airborne.intervals

    @cached_property
    def direct(self) -> Intervals:
        """Parts of the flights in which the rate set-points came straight from the sticks."""
        return _shared(self.flights, self.record.status.direct_rates)

    def during(self, instrument: Instrument) -> Intervals:
        """The parts of the flights in which an instrument may be used: ``direct`` ones in acro, others throughout."""
        return self.direct if instrument == "direct" else self.flights

    def instrument(self, axis: Axis, *, of_rates: bool = True) -> tuple[Instrument, str]:
        """The instrument of the loops of an axis, and its channel; the channel is empty without one.

        Set-points of rates that come straight from the sticks are free of feedback (``direct``). Else the stick, or a
        set-point that was excited on purpose (``stick``): whatever an outer loop asks for holds its feedback.

        Parameters
        ----------
        of_rates
            Whether the loop in question is that of the body rates.
        """
        names = self.record.channel_names
        setpoint = f"{RATE_OF.get(axis, '')}_setpoint"
        direct_s, flown_s = _length(self.direct), _length(self.flights)
        if of_rates and setpoint in names and direct_s > _MOSTLY * flown_s and direct_s >= LEAST_MOTION_S:
            return "direct", setpoint
        moving = {name: self.moving_s(name) for name in (f"{axis}_stick", f"{axis}_setpoint_excitation")}
        best = max(moving, key=moving.__getitem__)
        if moving[best] > 0.0 or f"{axis}_stick" in names:
            return "stick", best if moving[best] > 0.0 else f"{axis}_stick"
        return "stick", ""

    def moving_s(self, channel: str, intervals: Intervals | None = None) -> float:
        """Seconds of the flights in which a stick or set-point moved; zero if it was idle or not logged.

        It moves while it spreads, within a second, by more than 0.01 of full stick (0.05 rad/s, 0.01 rad).
        """
        least = LEAST_RATE_RAD_S if channel in ("p_setpoint", "q_setpoint", "r_setpoint") else LEAST_STICK
        moved_s = 0.0
        for time_s, values in self.samples(channel, intervals):
            if time_s.size < 2:
                continue
            # A stick that is logged when it changes holds its value in between.
            clock = np.arange(time_s[0], time_s[-1], 0.1)
            sampled = values[np.searchsorted(time_s, clock, side="right") - 1]
            size = round(_MOTION_WINDOW_S / 0.1)
            count = sampled.size // size
            spread = sampled[: count * size].reshape(count, size).std(axis=1)
            moved_s += _MOTION_WINDOW_S * float(np.count_nonzero(spread > least))
        return moved_s

    def samples(self, channel: str, intervals: Intervals | None = None) -> list[tuple[FloatArray, FloatArray]]:
        """Finite samples of a channel in each flight, stamps rising; empty where it was not logged."""
        found = []
        for start_s, stop_s in self.flights if intervals is None else intervals:
            try:
                topic, row = source_topic(self.record, channel, start_s, stop_s)
            except InsufficientDataError:
                continue
            time_s, values = _finite_samples(topic, row)
            inside = (time_s >= start_s) & (time_s <= stop_s)
            found.append((time_s[inside], values[inside]))
        return found

    def rate_hz(self, channel: str) -> float:
        """Median rate of a channel in the longest flight; zero where it was not logged."""
        start_s, stop_s = self.airborne.longest
        found = self.samples(channel, ((start_s, stop_s),))
        steps = np.diff(found[0][0]) if found else np.zeros(0)
        return float(1.0 / np.median(steps)) if steps.size else 0.0

    def histories(
        self, channels: Sequence[str], *, sampled: Sequence[str] = (), intervals: Intervals | None = None
    ) -> tuple[TimeHistory, ...]:
        """Channels on one clock, a history for each stretch of 4 s and more without a long gap.

        Parameters
        ----------
        channels
            The slowest of them sets the rate; above 500 Hz all are thinned out alike, to no less than half of that.
        sampled
            Instruments: slower ones are held up to that rate.
        intervals
            Parts of the record; its flights, when none are given.

        Raises
        ------
        InsufficientDataError
            A channel was not logged, or not for long enough.
        """
        names = self.record.channel_names
        for name in (*channels, *sampled):
            if name not in names:
                raise missing_channel(self.record, name)
        asked = self.flights if intervals is None else intervals
        rates = {name: self.rate_hz(name) for name in channels}
        slowest = min(rates, key=rates.__getitem__)
        fewer = int(rates[slowest] / _ENOUGH_RATE_HZ) if rates[slowest] > _ENOUGH_RATE_HZ else 1
        rate_hz = None
        found: list[TimeHistory] = []
        for start_s, stop_s in sorted(asked, key=lambda interval: interval[0] - interval[1]):
            if stop_s - start_s < _SHORTEST_S:
                continue
            record = self._with_sampled([name for name in sampled if name not in channels], slowest, start_s, stop_s)
            try:
                # Those of the longest flight say how fast the clock is.
                if rate_hz is None and fewer > 1:
                    rate_hz = rates[slowest] / fewer
                parts = resample(
                    record,
                    channels=channels,
                    auxiliary=[name for name in sampled if name not in channels],
                    start_s=start_s,
                    stop_s=stop_s,
                    sample_rate_hz=rate_hz,
                ).histories
            except InsufficientDataError:
                continue
            if parts:
                rate_hz = parts[0].sample_rate_hz
            found += [part for part in parts if part.duration_s >= _SHORTEST_S]
        if not found:
            raise InsufficientDataError(
                f"{self.record.source.name} has no {_SHORTEST_S:g} s in the air with {', '.join(channels)}",
                needed="a longer flight, or a log without gaps",
                remedy="log them throughout the flight",
            )
        return tuple(sorted(found, key=lambda history: history.start_s))

    def _with_sampled(self, names: Sequence[str], base: str, start_s: float, stop_s: float) -> FlightRecord:
        """The record with instruments resampled to the stamps of a faster channel."""
        try:
            topic, row = source_topic(self.record, base, start_s, stop_s)
        except InsufficientDataError:
            return self.record
        clock_s, _ = _finite_samples(topic, row)
        topics = []
        for name in names:
            try:
                slow, slow_row = source_topic(self.record, name, start_s, stop_s)
            except InsufficientDataError:
                continue
            time_s, values = _finite_samples(slow, slow_row)
            if not time_s.size or slow.sample_rate_hz >= topic.sample_rate_hz:
                continue
            place = np.maximum(np.searchsorted(time_s, clock_s, side="right") - 1, 0)
            sampled = values[place][None]
            topics.append(Topic(name=slow.name, time_s=clock_s, channels=(slow.channels[slow_row],), values=sampled))
        return replace(self.record, topics=(*topics, *self.record.topics)) if topics else self.record


def flown(record: FlightRecord) -> FlightData:
    """Find the flights of a record.

    Raises
    ------
    InsufficientDataError
        The vehicle never flew, or the log does not show whether it did.
    """
    return FlightData(record=record, airborne=airborne(record))


def loop_response(
    flight: FlightData,
    *,
    reference: str,
    answer: str,
    instrument: str = "",
    intervals: Intervals | None = None,
    slow: bool = False,
    histories: Sequence[TimeHistory] = (),
) -> FrequencyResponse:
    """Response of one channel to another over a whole flight, with the errors that a flight deserves.

    Parameters
    ----------
    reference, answer
        Input and output of the response: a set-point and its state, or a command and a rate.
    instrument
        Channel without feedback that moves both; the input itself or none for the direct estimate.
    intervals
        Parts of the record; its flights, when none are given.
    slow
        Whether it is a loop of attitude or velocity: lower frequencies, longer windows, double the shared floor.
    histories
        Already on one clock; otherwise they are made.

    Raises
    ------
    InsufficientDataError
        A channel was not logged, rests, or was not logged for long enough.
    """
    instruments = () if instrument in ("", reference) else (instrument,)
    records = tuple(histories) or flight.histories((reference, answer), sampled=instruments, intervals=intervals)
    rate_hz = records[0].sample_rate_hz
    logged_hz = min(flight.rate_hz(reference), flight.rate_hz(answer)) or rate_hz
    fast = logged_hz >= _FAST_HZ and not slow
    highest = min(
        _HIGHEST_FAST_RAD_S if fast else _HIGHEST_RAD_S, _OF_NYQUIST * np.pi * logged_hz, 0.8 * np.pi * rate_hz
    )
    windows: tuple[float, ...] = _SLOW_WINDOWS_S if slow else (*_WINDOWS_S, _SHORT_WINDOW_S) if fast else _WINDOWS_S
    longest_s = 0.45 * max(record.duration_s for record in records)
    # A window of less than two samples, as of a log with one in a second, shows nothing.
    windows = tuple(window for window in windows if 2.0 / rate_hz <= window <= longest_s) or (longest_s,)
    windows = _unsmeared(windows, records, reference)
    lowest = max(_LOWEST_SLOW_RAD_S if slow else _LOWEST_RAD_S, 4.0 * np.pi / max(windows))
    response = frequency_response(
        records,
        inputs=[reference],
        outputs=[answer],
        instruments=list(instruments),
        omega_rad_s=np.geomspace(min(lowest, 0.5 * highest), highest, _POINTS),
        windows_s=windows,
    )
    return with_floor(response, shared=(2.0 if slow else 1.0) * SHARED_FLOOR)


def with_floor(
    response: FrequencyResponse, *, independent: float = INDEPENDENT_FLOOR, shared: float = SHARED_FLOOR
) -> FrequencyResponse:
    r"""A response with the errors of a flight in addition to its noise, because the vehicle is not linear.

    .. math:: C_{ij} + \delta_{ij} (a |H_i|)^2 + b^2 H_i H_j^* e^{-|\ln \omega_i/\omega_j| / 0.5}

    The second part is shared by neighbors: an independent error averages out over many of them, this one does not.

    Parameters
    ----------
    response
        As estimated.
    independent, shared
        :math:`a` and :math:`b`.
    """
    distance = np.abs(np.subtract.outer(np.log(response.omega_rad_s), np.log(response.omega_rad_s)))
    values = np.nan_to_num(response.values)
    pairs: ComplexArray = values[..., :, None] * values.conj()[..., None, :]
    kernel = shared**2 * np.exp(-distance / SHARED_OVER) + independent**2 * np.eye(response.omega_rad_s.size)
    return replace(
        response,
        covariance=response.covariance + pairs * kernel,
        # A variance of the complex response is twice that of its magnitude.
        random_error=np.sqrt(response.random_error**2 + 0.5 * (independent**2 + shared**2)),
        processing=(*response.processing, f"floor of errors of {independent:g} and, shared by neighbors, {shared:g}"),
    )


def _unsmeared(windows_s: Sequence[float], records: Sequence[TimeHistory], channel: str) -> tuple[float, ...]:
    """The windows but for short ones in which a steep spectrum runs over.

    A window shows a frequency from two of its periods on, and there its lines are as wide as the frequency itself.
    Where the motion of the stick ends steeply, as behind a smoothing filter, what a short window shows above is the
    motion below, and the response too: with small errors, since there is much of it. Its density then is several times
    that of long windows.
    """
    kept = [window for window in windows_s if window > _SHORT_S]
    short = [window for window in windows_s if window <= _SHORT_S]
    fine = [window for window in kept if window <= _REFERENCE_S]
    if not short or not fine:
        return tuple(windows_s)
    for window in short:
        omega = np.geomspace(4.0 * np.pi / window, _SMEARED_TO_RAD_S, 16)
        long, own = (_density(records, channel, length, omega) for length in (fine[0], window))
        if np.all(own <= _SMEARED * long):
            kept.append(window)
        else:
            break
    return tuple(kept)


def _density(records: Sequence[TimeHistory], channel: str, window_s: float, omega_rad_s: FloatArray) -> FloatArray:
    """Power of a channel about each frequency, from windows of one length under a Hann taper, shape ``(f,)``."""
    rate_hz = records[0].sample_rate_hz
    length = round(window_s * rate_hz)
    taper = np.hanning(length)
    total, count = np.zeros(length // 2 + 1), 0
    for record in records:
        if record.values.shape[1] < length:
            continue
        signal = record[channel] - record[channel].mean()
        parts = np.lib.stride_tricks.sliding_window_view(signal, length)[:: max(length // 2, 1)]
        total += np.sum(np.abs(np.fft.rfft(parts * taper, axis=1)) ** 2, axis=0)
        count += len(parts)
    lines = 2.0 * np.pi * np.arange(total.size) / window_s
    sums = np.concatenate([[0.0], np.cumsum(total)]) / (max(count, 1) * length)
    # The mean over a tenth to both sides, or over the line itself where it is wider.
    low = np.minimum(np.searchsorted(lines, 0.9 * omega_rad_s), total.size - 1)
    high = np.clip(np.searchsorted(lines, 1.1 * omega_rad_s), low + 1, total.size)
    return np.asarray((sums[high] - sums[low]) / (high - low))


def _finite_samples(topic: Topic, row: int) -> tuple[FloatArray, FloatArray]:
    """Finite samples of a channel at stamps that rise."""
    values = topic.values[row]
    kept = np.isfinite(values) & np.isfinite(topic.time_s)
    time_s, values = topic.time_s[kept], values[kept]
    rising = rises(time_s)
    return time_s[rising], values[rising]


def _shared(one: Intervals, other: Intervals) -> Intervals:
    both = [(max(a, c), min(b, d)) for a, b in one for c, d in other]
    return tuple((start, stop) for start, stop in sorted(both) if stop > start)


def _length(intervals: Intervals) -> float:
    return sum(stop - start for start, stop in intervals)
