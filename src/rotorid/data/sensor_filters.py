"""Filters of sensors that the user knows: what a data sheet says of a channel, and no log.

They are given in a mapping (``[channels.az] filter = "lp:60"``) or to a command (``--filter az=lp:60``), stay with the
channel (:attr:`rotorid.data.record.Channel.filters`), and :mod:`rotorid.signal.autopilot_filters` counts them among the
filters that the channel has passed. Everybody who asks there finds them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from rotorid.errors import UsageError, listed, unknown_name
from rotorid.units import read_measure

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord

FORM = "KIND:HZ, such as lp:60, lp1:60, pt2:60, pt3:60, notch:80:2 (center and Q) or delay:4ms"
"""How a filter is written."""

_ALIKE: Mapping[str, str] = MappingProxyType({"lp2": "lp", "pt1": "lp1"})
KINDS = ("lp", "lp1", "pt2", "pt3", "notch", "delay")
"""Low-passes of second order (Butterworth) and of first order, two and three equal ones of first order, a notch, and a
pure delay."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SensorFilter:
    """A linear filter that a channel has passed before it was logged.

    Parameters
    ----------
    kind
        One of :data:`KINDS`.
    frequency_hz
        Cutoff, or center of a notch; zero for a delay.
    quality
        Center over bandwidth of a notch.
    delay_s
        Of a pure delay.
    rate_hz
        At which the filter ran; ``None`` where that is not known.

    Examples
    --------
    >>> SensorFilter(kind="lp", frequency_hz=60.0).text
    'lp:60.0'
    """

    kind: str
    frequency_hz: float = 0.0
    quality: float = 0.0
    delay_s: float = 0.0
    rate_hz: float | None = None

    @property
    def text(self) -> str:
        """As :func:`parse_filters` reads it."""
        if self.kind == "delay":
            return f"delay:{self.delay_s!r}"
        quality = f":{self.quality!r}" if self.kind == "notch" else ""
        return f"{self.kind}:{self.frequency_hz!r}{quality}{'' if self.rate_hz is None else f'@{self.rate_hz!r}'}"


def parse_filters(text: str, *, of: str) -> tuple[SensorFilter, ...]:
    """Read ``KIND:HZ``, several with commas: the channel has passed all of them.

    Parameters
    ----------
    text
        ``lp:60``, ``notch:80:2``, ``delay:4ms``; behind ``@`` the rate at which the filter ran, as in ``lp:60@1000``.
    of
        What an error names: ``--filter az=lp:60``, or the table of a mapping.

    Raises
    ------
    UsageError
        The text cannot be read, the kind is none, or a number is impossible.

    Examples
    --------
    >>> [(found.kind, found.frequency_hz, found.rate_hz) for found in parse_filters("lp:60@1000,notch:80:2", of="az")]
    [('lp', 60.0, 1000.0), ('notch', 80.0, None)]
    >>> parse_filters("delay:4ms", of="az")[0].delay_s
    0.004
    """
    return tuple(_filter(part.strip(), of) for part in text.split(","))


def _filter(text: str, of: str) -> SensorFilter:
    body, at, rate = text.partition("@")
    kind, *numbers = (part.strip() for part in body.split(":"))
    kind, came = _ALIKE.get(kind, kind), f"{of} cannot be read"
    if kind not in KINDS:
        raise UsageError(f"{of}: unknown filter kind {kind!r}", needed=f"{listed(KINDS[:5])}, or delay: {FORM}")
    if len(numbers) != (2 if kind == "notch" else 1) or (kind == "delay" and at):
        raise UsageError(came, needed=FORM)
    first = read_measure(numbers[0], {"delay": "s"}.get(kind, "Hz"), came=came, needed=FORM)
    quality = read_measure(numbers[1], "1", came=came, needed=FORM) if kind == "notch" else 0.0
    rate_hz = read_measure(rate, "Hz", came=came, needed=FORM) if at else None
    if not 0.0 < first < math.inf or (kind == "notch" and not 0.0 < quality < math.inf):
        raise UsageError(f"{of}: {text} is impossible", needed=f"numbers above zero: {FORM}")
    if kind == "delay":
        return SensorFilter(kind=kind, delay_s=first)
    if rate_hz is not None and not first < 0.5 * rate_hz < math.inf:
        raise UsageError(
            f"{of}: {first:g} Hz is not below half of the rate of the filter, {rate_hz:g} Hz",
            needed=f"a frequency below {0.5 * rate_hz:g} Hz",
        )
    return SensorFilter(kind=kind, frequency_hz=first, quality=quality, rate_hz=rate_hz)


def with_sensor_filters(
    records: Iterable[FlightRecord], filters: Mapping[str, Sequence[SensorFilter]], *, option: str = "--filter"
) -> tuple[FlightRecord, ...]:
    """Records whose channels know the filters that they have passed.

    Parameters
    ----------
    records
        Logs of one run; a channel has to be in one of them.
    filters
        By channel.
    option
        What an error names: the option, or the mapping.

    Raises
    ------
    UsageError
        No log has the channel, it has filters from a mapping already, or a frequency is not below half of the
        rate at which the channel is logged and no rate of the filter is given.
    """
    logs = tuple(records)
    known = [name for record in logs for name in record.channel_names]
    for name in filters:
        if name not in known:
            raise unknown_name(f"channel of {option}", name, list(dict.fromkeys(known)))
    return tuple(_of_record(record, filters, option) for record in logs) if filters else logs


def _of_record(record: FlightRecord, filters: Mapping[str, Sequence[SensorFilter]], option: str) -> FlightRecord:
    topics = []
    for topic in record.topics:
        channels = list(topic.channels)
        for row, channel in enumerate(channels):
            given = tuple(filters.get(channel.name, ()))
            if not given:
                continue
            if channel.filters:
                raise UsageError(
                    f"{option} gives a filter of {channel.name}, which the mapping gives too",
                    remedy="give it in one of them",
                )
            _require_below_nyquist(channel.name, given, topic.sample_rate_hz, option)
            # Filters are asked for by source; a table that was made by hand may name none.
            channels[row] = replace(channel, filters=given, source=channel.source or channel.name)
        topics.append(topic if tuple(channels) == topic.channels else replace(topic, channels=tuple(channels)))
    return replace(record, topics=tuple(topics))


def _require_below_nyquist(name: str, filters: Sequence[SensorFilter], rate_hz: float, option: str) -> None:
    for given in filters:
        if given.rate_hz is None and given.frequency_hz >= 0.5 * rate_hz > 0.0:
            raise UsageError(
                f"{option} {name}: {given.frequency_hz:g} Hz is not below half of the {rate_hz:.4g} Hz at which "
                f"{name} is logged",
                needed=f"a frequency below {0.5 * rate_hz:.4g} Hz, or the rate at which the filter ran",
                remedy=f"add the rate behind @, such as {given.kind}:{given.frequency_hz:g}@8000",
            )
