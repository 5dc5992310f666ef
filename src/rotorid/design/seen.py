"""Test inputs as an identification will see them in the log: declared with their band, or found in the signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rotorid.data.flight_plan import Entry, PlannedInput
from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.signal.segment import find_excitations

_TOLD_BY_SHAPE = ("sweep", "random_binary", "multisine")


def as_seen(
    inputs: Sequence[PlannedInput], flight: TimeHistory, *, declared: Sequence[Entry] = ()
) -> tuple[Maneuver, ...]:
    """Kind and band of each test input as an identification takes them.

    An autopilot that makes a sweep itself logs its band. What comes from outside is found in the signals, with the band
    of its half waves: a sweep that goes through its lowest frequencies in less than a period begins higher than it was
    planned to. What is not recognized is taken for what was planned.

    Parameters
    ----------
    inputs
        What to look for.
    flight
        The test inputs of the whole flight as they are logged, one channel ``AXIS_excitation`` for each axis.
    declared
        Where test inputs enter that the log declares with their band.

    Examples
    --------
    >>> import numpy as np
    >>> from rotorid.data.channel import Channel
    >>> from rotorid.excitation.planned import planned
    >>> sweep = planned("roll", "pilot_sweep", start_s=3.0, amplitude=0.2, duration_s=40.0, sample_rate_hz=100.0,
    ...                 band_rad_s=(1.0, 40.0), entry="attitude_setpoint")
    >>> flight = TimeHistory(values=[sweep.at(np.arange(4600) / 100.0)], sample_rate_hz=100.0, start_s=0.0,
    ...                      channels=(Channel(name="roll_excitation", unit="1"),))
    >>> [round(edge, 1) for edge in as_seen([sweep], flight)[0].band_rad_s]
    [1.4, 37.6]
    """
    record = FlightRecord(
        source=Source(name="plan", format="plan", sha256=""),
        topics=(Topic(name="plan", time_s=flight.time_s, channels=flight.channels, values=flight.values),),
    )
    axes = dict.fromkeys(one.axis for one in inputs)
    found = [one for axis in axes for one in find_excitations(record, axis) if one.kind in _TOLD_BY_SHAPE]
    return tuple(one.maneuver if one.entry in declared else _as_found(one.maneuver, found) for one in inputs)


def _as_found(planned: Maneuver, found: Sequence[Maneuver]) -> Maneuver:
    """A test input as the maneuver of its axis that has most of it in common."""
    own = [one for one in found if one.axis == planned.axis and _shared_s(planned, one) > 0.5 * planned.duration_s]
    if not own:
        return planned
    best = max(own, key=lambda one: _shared_s(planned, one))
    return replace(planned, kind=best.kind, band_rad_s=best.band_rad_s, origin="found")


def _shared_s(a: Maneuver, b: Maneuver) -> float:
    return min(a.stop_s, b.stop_s) - max(a.start_s, b.start_s)
