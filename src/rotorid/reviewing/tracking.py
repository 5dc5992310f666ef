r"""How well set-points were followed, in any mode and at any rate of the log: errors, and the delay of the answer.

Step responses and bandwidths need a set-point without feedback and a fast log. What is counted here needs neither: the
error :math:`e = y_{sp} - y` of this flight, its root mean square and the size that it stays below for 95 % of the
time, and the delay at which the answer resembles its set-point most,

.. math:: \tau = \arg\max_\tau \sum_t y_{sp}(t) \, y(t + \tau)

without what changes more slowly than a few seconds. The delay is that of the frequencies at which the set-point moved.
Where an outer loop makes the set-point, it answers gusts too, which shifts the delay by up to

.. math:: \frac{\omega_o}{\omega^2} \frac{1 - \rho^2}{\rho^2}

with the correlation :math:`\rho`, the outer loop's crossover :math:`\omega_o` and the set-point's own frequency
:math:`\omega`, as the response itself (:mod:`rotorid.reviewing.loops`). Errors are those of a jackknife over ten parts
of the flight; the interval of the delay adds that bound and half a sample of the slower channel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from rotorid.autopilots.advice import logging_advice
from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.errors import InsufficientDataError
from rotorid.flights.whole_flights import LEAST_MOTION_S, FlightData
from rotorid.reviewing.loops import LOOPS, Loop, outer_loop_rad_s
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.values import Trace, TrackingReview
from rotorid.typing import FloatArray

LEAST_RATE_HZ = 4.0
"""In slower logs what happens between the samples is most of the error."""

_CLOCK_HZ = 50.0
_PARTS = 10
_SHORTEST_S = 20.0
_TREND_S = 4.0
_LONGEST_DELAY_S = 1.0
_LEAST_CORRELATION = 0.5
_OUTER_OF_RATES_RAD_S = 10.0
"""Largest usual gain of an angle controller, which makes the set-points of rates."""

_TRACE_S = 20.0
"""Length of the part that a page draws: the liveliest one."""

_TRACKED = (*RATES, *ATTITUDE)


def tracking(flight: FlightData) -> tuple[dict[str, TrackingReview], tuple[Unavailable, ...]]:
    """How each rate and angle followed its set-point.

    Returns
    -------
    dict of TrackingReview
        By the state; a state whose set-point is not logged is absent.
    tuple of Unavailable
        What was not measured, and why.
    """
    found: dict[str, TrackingReview] = {}
    unavailable: list[Unavailable] = []
    for loop in LOOPS:
        if loop.name not in _TRACKED or not {loop.name, loop.reference} <= set(flight.record.channel_names):
            continue
        review, missing = section(f"tracking.{loop.name}", partial(_tracked, flight, loop), None)
        unavailable += missing
        if review is not None:
            found[loop.name] = review
    return found, tuple(unavailable)


def _tracked(flight: FlightData, loop: Loop) -> tuple[TrackingReview | None, list[Unavailable]]:
    what = f"tracking.{loop.name}"
    rate_hz = min(flight.rate_hz(loop.reference), flight.rate_hz(loop.name))
    if rate_hz < LEAST_RATE_HZ:
        why = f"The {loop.words} or its set-point is logged at only {rate_hz:.1f} Hz; {LEAST_RATE_HZ:g} Hz are needed."
        return None, [Unavailable(what=what, why=why, remedy=logging_advice(flight.record, rate_hz))]
    pieces = _pieces(flight, loop, min(rate_hz, _CLOCK_HZ))
    length_s = sum(float(time_s[-1] - time_s[0]) for time_s, _, _ in pieces)
    if length_s < _SHORTEST_S:
        raise InsufficientDataError(
            f"the {loop.words} and its set-point last for {length_s:.0f} s together",
            needed=f"{_SHORTEST_S:g} s in the air",
            remedy="fly longer",
        )
    asked, made = (np.concatenate([piece[place] for piece in pieces]) for place in (1, 2))
    error = asked - made
    unit = "rad" if loop.name in ATTITUDE else "rad/s"
    suffix = unit.replace("/", "_")
    numbers = {
        f"error_rms_{suffix}": _jackknife(error, lambda part: math.sqrt(float(np.mean(part**2))), unit),
        f"error_95_{suffix}": _jackknife(error, lambda part: float(np.percentile(np.abs(part), 95)), unit),
    }
    delay, gap = _delay(flight, loop, pieces, min(rate_hz, _CLOCK_HZ), rate_hz)
    if delay is not None:
        numbers["tracking_delay_s"] = delay
    review = TrackingReview(
        name=loop.name,
        reference=loop.reference,
        answer=loop.name,
        rate_hz=rate_hz,
        numbers=numbers,
        trace=_trace(pieces),
    )
    return review, [] if gap is None else [gap]


_Piece = tuple[FloatArray, FloatArray, FloatArray]


def _pieces(flight: FlightData, loop: Loop, rate_hz: float) -> list[_Piece]:
    """Time, set-point and answer of each flight on one clock; turns of an angle are taken out."""
    pieces = []
    answers = flight.samples(loop.name)
    for (stamps, asked), (other, made) in zip(flight.samples(loop.reference), answers, strict=False):
        if min(stamps.size, other.size) < 2:
            continue
        clock = np.arange(max(stamps[0], other[0]), min(stamps[-1], other[-1]), 1.0 / rate_hz)
        if clock.size < 2.0 * rate_hz:
            continue
        turning = loop.name in ATTITUDE
        # Straight lines for both, so that neither is later than the other by how it is read.
        wanted, moved = (
            np.interp(clock, at, np.unwrap(values) if turning else values)
            for at, values in ((stamps, asked), (other, made))
        )
        if turning:
            wanted = moved - np.angle(np.exp(1j * (moved - wanted)))
        pieces.append((clock, wanted, moved))
    return pieces


def _jackknife(values: FloatArray, measure: Callable[[FloatArray], float], unit: str) -> Quantity:
    """A measure of a flight with the error that leaving out each tenth of the flight gives it."""
    parts = np.array_split(values, _PARTS)
    others = [measure(np.concatenate([*parts[:place], *parts[place + 1 :]])) for place in range(_PARTS)]
    std = math.sqrt((_PARTS - 1) * float(np.var(others)))
    value = measure(values)
    lower = max(value - TWO_SIDED_95 * std, 0.0)
    return Quantity(value=value, std=std, lower=lower, upper=value + TWO_SIDED_95 * std, unit=unit)


def _delay(
    flight: FlightData, loop: Loop, pieces: list[_Piece], rate_hz: float, logged_hz: float
) -> tuple[Quantity | None, Unavailable | None]:
    """The delay of the most likeness, with half a sample of the log to both sides."""
    what = f"tracking.{loop.name}.tracking_delay_s"
    moved_s = flight.moving_s(loop.reference)
    if moved_s < LEAST_MOTION_S:
        why = f"The set-point of the {loop.words} moved for only {moved_s:.0f} s; {LEAST_MOTION_S:g} s are needed."
        return None, Unavailable(what=what, why=why, remedy=f"move the {loop.axis} stick, or fly a mission with turns")
    size = max(round(_TREND_S * rate_hz), 3)
    rows = [(_without_trend(asked, size), _without_trend(made, size)) for _, asked, made in pieces]
    asked, made = (np.concatenate([row[place] for row in rows]) for place in (0, 1))
    most = round(_LONGEST_DELAY_S * rate_hz)
    tenths = zip(np.array_split(asked, _PARTS), np.array_split(made, _PARTS), strict=True)
    parts = [_correlations(one, other, most) for one, other in tenths]
    total = np.sum(parts, axis=0)
    value, height = _peak(total)
    likeness = height / math.sqrt(float(asked @ asked) * float(made @ made)) if height > 0.0 else 0.0
    if not math.isfinite(value) or likeness < _LEAST_CORRELATION:
        why = f"The {loop.words} resembles its set-point too little (correlation {likeness:.2f})."
        return None, Unavailable(what=what, why=why, remedy="fly quicker turns in calm air")
    others = [_peak(total - part)[0] for part in parts]
    if not np.all(np.isfinite(others)):
        why = f"The delay of the {loop.words} differs between parts of the flight."
        return None, Unavailable(what=what, why=why, remedy="fly longer")
    std = math.sqrt((_PARTS - 1) * float(np.var(others))) / rate_hz
    half = TWO_SIDED_95 * std + 0.5 / logged_hz
    seconds = value / rate_hz
    # Nothing feeds a heading back into its set-point, which the pilot or the mission turns.
    if loop.name != "psi" and flight.instrument(loop.axis, of_rates=loop.of_rates)[0] != "direct":
        own_square = float(np.mean(np.diff(asked) ** 2) / np.mean(asked**2)) * rate_hz**2
        outer_rad_s = _OUTER_OF_RATES_RAD_S if loop.of_rates else outer_loop_rad_s(flight.record)
        half += outer_rad_s / own_square * (1.0 - likeness**2) / likeness**2
    if half > max(seconds, 0.0):
        why = (
            f"The delay of the {loop.words} is smaller than its error: the set-point changed too slowly, or the wind "
            "disturbed the flight."
        )
        return None, Unavailable(what=what, why=why, remedy="fly quicker turns in calm air")
    return (
        Quantity(
            value=seconds,
            std=math.hypot(std, 1.0 / logged_hz / math.sqrt(12.0)),
            lower=seconds - half,
            upper=seconds + half,
            unit="s",
        ),
        None,
    )


def _without_trend(values: FloatArray, size: int) -> FloatArray:
    from scipy.ndimage import uniform_filter1d

    return np.asarray(values - uniform_filter1d(values, min(size, values.size), mode="nearest"))


def _correlations(asked: FloatArray, made: FloatArray, most: int) -> FloatArray:
    """Sums of set-point times the answer so many samples later, from ``-most`` to ``most``."""
    if asked.size <= most:
        return np.zeros(2 * most + 1)
    from scipy.signal import correlate

    full = correlate(made, asked, mode="full", method="fft")
    middle = asked.size - 1
    return np.asarray(full[middle - most : middle + most + 1])


def _peak(correlations: FloatArray) -> tuple[float, float]:
    """Delay in samples and height of the largest correlation; not a number where it lies at an end."""
    place = int(np.argmax(correlations))
    middle = correlations.size // 2
    if place in (0, correlations.size - 1):
        return math.nan, 0.0
    before, top, after = correlations[place - 1 : place + 2]
    bend = before - 2.0 * top + after
    return place - middle + (0.5 * float((before - after) / bend) if bend < 0.0 else 0.0), float(top)


def _trace(pieces: list[_Piece]) -> Trace:
    """The liveliest part of the flight, as it was logged."""
    best: tuple[float, _Piece] | None = None
    for time_s, asked, made in pieces:
        size = min(np.searchsorted(time_s, time_s[0] + _TRACE_S), time_s.size)
        for begin in range(0, max(time_s.size - size, 0) + 1, max(size // 4, 1)):
            part = slice(begin, begin + size)
            lively = float(np.std(asked[part]))
            if best is None or lively > best[0]:
                best = lively, (time_s[part], asked[part], made[part])
    assert best is not None
    time_s, asked, made = best[1]
    return Trace(time_s=time_s, reference=asked, answer=made)
