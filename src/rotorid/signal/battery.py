"""Voltage of the battery at both ends of the flights and its lowest, as every page and document states it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord, Intervals
from rotorid.signal.airborne import within
from rotorid.typing import FloatArray

_END_S = 2.0
"""An end of a flight is a mean over so long."""

_LOWEST_PERCENTILE = 0.1
"""A single low sample may be noise: one in a thousand counts."""

_LEAST_V, _FEWEST_SAMPLES = 0.5, 5
"""A monitor that is not connected logs nothing, or zero volts."""

_LOWEST_ERROR = 0.002
"""Relative standard deviation of the lowest voltage, which is one sample: the step of a usual monitor."""


def battery_voltages(record: FlightRecord, intervals: Intervals = ()) -> Mapping[str, Quantity]:
    """``start_v``, ``stop_v`` and ``lowest_v``; empty where no voltage was logged.

    Parameters
    ----------
    intervals
        The flights, on the log's own clock. The whole log counts where there is none, as of a log from the bench.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> monitor = Topic(
    ...     name="BAT",
    ...     time_s=np.arange(60.0),
    ...     channels=(Channel(name="battery_voltage", unit="V"),),
    ...     values=np.linspace(16.8, 15.6, 60)[None],
    ... )
    >>> record = FlightRecord(source=Source(name="a.bin", format="CSV", sha256=""), topics=(monitor,))
    >>> volts = battery_voltages(record, [(10.0, 50.0)])
    >>> {name: round(one.value, 2) for name, one in volts.items()}
    {'start_v': 16.58, 'stop_v': 15.8, 'lowest_v': 15.78}
    """
    if "battery_voltage" not in record:
        return MappingProxyType({})
    track = record["battery_voltage"]
    kept = np.isfinite(track.values)
    if intervals:
        kept &= within(track.time_s, intervals)
    time_s, volts = track.time_s[kept], track.values[kept]
    usual = float(np.median(volts)) if volts.size else 0.0
    if volts.size < _FEWEST_SAMPLES or usual <= _LEAST_V:
        return MappingProxyType({})
    lowest = float(np.percentile(volts, _LOWEST_PERCENTILE))
    return MappingProxyType(
        {
            "start_v": _mean(volts[time_s <= time_s[0] + _END_S]),
            "stop_v": _mean(volts[time_s >= time_s[-1] - _END_S]),
            "lowest_v": Quantity.normal(lowest, _LOWEST_ERROR * usual, "V"),
        }
    )


def _mean(volts: FloatArray) -> Quantity:
    return Quantity.normal(float(volts.mean()), float(volts.std()) / math.sqrt(min(volts.size, 10)), "V")
