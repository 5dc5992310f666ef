"""Flights without a sweep: which of their parts serve an axis, with the stick as what excites it."""

from __future__ import annotations

from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.models.library import RATE_AXES
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.instruments import find_instrument, is_free
from rotorid.signal.airborne import airborne
from rotorid.typing import Axis

SHORTEST_ORDINARY_S = 20.0
"""Less of ordinary flying holds too few movements of a stick to average over."""


def ordinary_flights(record: FlightRecord, axis: Axis) -> tuple[Maneuver, ...]:
    """The parts in the air in which the stick, or a set-point that is the stick, moves an axis.

    Parameters
    ----------
    record
        A log that holds the command of the axis and what answers it at 40 Hz or more; of others nothing serves. A
        stick moves too slowly to show the gain by itself where neither lag nor delay can be seen.
    axis
        Which.

    Returns
    -------
    tuple of Maneuver
        Of 20 s and more each, in order of time; empty where the log cannot tell of this axis.
    """
    model = next(one for one in RATE_AXES.values() if one.input == f"{axis}_command")
    if min(record.rate_hz(name) for name in (model.input, model.output)) < LOWEST_RATE_HZ:
        return ()
    try:
        flights = airborne(record).intervals
    except InsufficientDataError:
        return ()
    parts = [
        Maneuver(axis=axis, kind="other", start_s=start_s, stop_s=stop_s, origin="given")
        for start_s, stop_s in flights
        if stop_s - start_s >= SHORTEST_ORDINARY_S
    ]
    return tuple(part for part in parts if _excited(Flight(record, part), axis))


def _excited(flight: Flight, axis: Axis) -> bool:
    instrument = find_instrument([flight], axis)
    return instrument is not None and is_free([flight], instrument)
