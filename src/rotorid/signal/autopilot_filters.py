"""Which filters stand between the motion and a logged channel: by the parameters in the log, and by the user.

A chain is known as far as the log carries its parameters. Not in any log: the sensor's own analog and hardware
filters, and the time between a sample and its stamp; the user may give these (:mod:`rotorid.data.sensor_filters`).
What each autopilot runs stands in its room (:mod:`rotorid.autopilots`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from rotorid.autopilots.filters import KnownFilter, butterworth_low_pass, cascaded_low_pass, notch
from rotorid.autopilots.passages import UNKNOWN, Passage
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.data.sensor_filters import SensorFilter
from rotorid.errors import UsageError

FAST_SENSOR_HZ = 8000.0
"""Rate of a given filter unless the user says another one: as good as continuous."""

_WORTH_SAYING_S = 5e-5


def known_filters(record: FlightRecord, source: str, *, sensor_rate_hz: float | None = None) -> tuple[KnownFilter, ...]:
    """Linear filters that a channel of a log has passed, as far as the log says.

    Empty where there are none and where none is known: :func:`filter_findings` separates these.

    Parameters
    ----------
    record
        With the autopilot's parameters.
    source
        Where the channel comes from: ``Channel.source``.
    sensor_rate_hz
        Samples per second of the sensor. When not given: for PX4, whose filters work on the raw samples of a fast
        sensor, 8 kHz; for ArduPilot 1 kHz, times what ``INS_GYRO_RATE`` says; for Betaflight the header says it.
        Simulators are slower, and a slow filter delays less: at 250 Hz a low-pass of 40 Hz delays 5.1 instead of
        5.6 ms.

    Raises
    ------
    UsageError
        ``sensor_rate_hz`` is not positive.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> record = FlightRecord(
    ...     source=Source(name="log.ulg", format="PX4 ULog", sha256=""), topics=(),
    ...     parameters={"IMU_GYRO_CUTOFF": 40.0, "IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0},
    ... )
    >>> [known.name for known in known_filters(record, "vehicle_angular_velocity.xyz[0]")]
    ['second-order low-pass at 40 Hz']
    """
    return _passage(record, source, sensor_rate_hz).filters


def controller_filters(record: FlightRecord) -> tuple[KnownFilter, ...]:
    """Linear filters between the motion and the rate controller of the autopilot, as far as the log says.

    The rate passes them, the attitude does not: it comes from the unfiltered sensor.
    """
    source = autopilot_of(record).log.rate_source
    return known_filters(record, source) if source else ()


def filter_findings(record: FlightRecord, source: str, *, sensor_rate_hz: float | None = None) -> tuple[Finding, ...]:
    """What is known of the filters in front of a channel, and what is not.

    Parameters
    ----------
    record, source, sensor_rate_hz
        As for :func:`known_filters`.

    Returns
    -------
    tuple of Finding
        ``known_filter`` with the delay at low frequency, and ``unknown_filter`` for every reason why the chain is not,
        or not wholly, known.

    Raises
    ------
    UsageError
        ``sensor_rate_hz`` is not positive.
    """
    passage = _passage(record, source, sensor_rate_hz)
    given = given_filters(record, source)
    assumed = sensor_rate_hz is None and (
        any(item.rate_hz is None and item.kind != "delay" for item in given)
        if given
        else not autopilot_of(record).log.sensor_rate_logged
    )
    return (*_known(record, source, passage, assumed), *(_unknown(source, doubt) for doubt in passage.doubts))


def _passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    if sensor_rate_hz is not None and not 0.0 < sensor_rate_hz < math.inf:
        raise UsageError(f"got a sensor rate of {sensor_rate_hz:g} Hz", needed="a positive rate")
    logged = autopilot_of(record).log.passage(record, source, sensor_rate_hz)
    given = given_filters(record, source)
    if not given:
        return logged
    filters = tuple(_known_filter(item, item.rate_hz or sensor_rate_hz or FAST_SENSOR_HZ) for item in given)
    twins = [known.name for known in filters if known.name in [other.name for other in logged.filters]]
    if twins:
        raise UsageError(
            f"{source} has passed a {twins[0]} by the parameters of the log already",
            remedy="leave this filter out of --filter and of the mapping",
        )
    # Who gives the filters of a foreign log says what nobody else can.
    doubts = tuple(doubt for doubt in logged.doubts if doubt != UNKNOWN)
    return Passage(filters=(*filters, *logged.filters), doubts=doubts)


def given_filters(record: FlightRecord, source: str) -> tuple[SensorFilter, ...]:
    """Filters of a source as the user gives them, see :mod:`rotorid.data.sensor_filters`."""
    channels = (channel for topic in record.topics for channel in topic.channels)
    return next((channel.filters for channel in channels if channel.filters and channel.source == source), ())


def _known_filter(given: SensorFilter, rate_hz: float) -> KnownFilter:
    """The digital filter of what the user gives."""
    if given.kind == "delay":
        # One step of a program that is as slow: exactly the delay, at any frequency.
        name = f"delay of {1e3 * given.delay_s:.4g} ms"
        return KnownFilter(name=name, numerator=(0.0, 1.0), denominator=(1.0,), rate_hz=1.0 / given.delay_s)
    if given.kind == "lp":
        return butterworth_low_pass(given.frequency_hz, rate_hz)
    if given.kind == "notch":
        return notch(given.frequency_hz, given.quality, rate_hz)
    order = {"lp1": 1, "pt2": 2, "pt3": 3}[given.kind]
    return cascaded_low_pass(order, given.frequency_hz, rate_hz)


def _known(record: FlightRecord, source: str, passage: Passage, assumed: bool) -> Iterator[Finding]:
    if not passage.filters:
        return
    delay_s = sum(known.delay_s for known in passage.filters)
    numbers = {"delay_s": delay_s, "rate_hz": min(known.rate_hz for known in passage.filters)}
    message = (
        f"{source} was filtered in the autopilot ({', '.join(known.name for known in passage.filters)}), which delays "
        f"it by {1e3 * delay_s:.2f} ms at low frequency"
    )
    slow = _at_logged_rate(record, source) if assumed else None
    if slow is not None and abs(slow[1] - delay_s) > _WORTH_SAYING_S:
        rate_hz, slow_s = slow
        numbers |= {"logged_rate_hz": rate_hz, "delay_at_logged_rate_s": slow_s}
        message += (
            f", if the filters work at {numbers['rate_hz']:g} Hz, which the log does not say; at the rate of the log, "
            f"{rate_hz:.0f} Hz, it would be {1e3 * slow_s:.2f} ms"
        )
    yield remark("known_filter", source, message, **numbers)


def _at_logged_rate(record: FlightRecord, source: str) -> tuple[float, float] | None:
    """Rate of the topic, below which no filter works, and the delay of the same chain there."""
    rates = [topic.sample_rate_hz for topic in record.topics if any(c.source == source for c in topic.channels)]
    if not rates or not 0.0 < max(rates) < math.inf:
        return None
    slow = _passage(record, source, max(rates))
    return None if slow.doubts else (max(rates), sum(known.delay_s for known in slow.filters))


def _unknown(source: str, doubt: str) -> Finding:
    return warn("unknown_filter", source, f"not all filters of {source} are known: {doubt}")
