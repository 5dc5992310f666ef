"""Errors of sensors estimated over the maneuvers that are fitted, and taken out of all logs before anything else.

One set of sensors flew all logs of a run, so all maneuvers estimate one correction, and every log is corrected by it:
also those that are kept unseen.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.instruments import while_flying
from rotorid.signal.clock import resample
from rotorid.signal.kinematics import ACCELERATIONS, ATTITUDE, EARTH_VELOCITIES, RATES, VELOCITIES
from rotorid.signal.sensor_correction import (
    SensorCorrection,
    corrected_values,
    correction_findings,
    estimate_correction,
)
from rotorid.typing import FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")
_SHORTEST_S = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedSensors:
    """A correction, and what to say about it.

    Parameters
    ----------
    correction
        What to add to sensors.
    findings
        What was corrected, each with its interval, and what was not.
    """

    correction: SensorCorrection
    findings: tuple[Finding, ...]


def sensor_correction(flights: Sequence[Flight]) -> CorrectedSensors:
    """The errors of the sensors over some maneuvers.

    Raises
    ------
    InsufficientDataError
        The logs hold neither attitude beside rates nor velocities beside specific force.
    """
    _PROGRESS.info("errors of sensors")
    flying, _ = while_flying(flights)
    rates = [one for flight in flying for one in _histories(flight, (*RATES, *ATTITUDE), RATES)]
    forces = [one for flight in flying for one in _histories(flight, _of_forces(flight.record), ACCELERATIONS)]
    correction = estimate_correction(rates, forces)
    return CorrectedSensors(correction=correction, findings=correction_findings(correction))


def corrected_record(record: FlightRecord, correction: SensorCorrection) -> FlightRecord:
    """A log with the errors taken out of its sensors, in every topic that holds them."""
    return replace(record, topics=tuple(_corrected_topic(record, topic, correction) for topic in record.topics))


def with_sensor_errors(response: FrequencyResponse, correction: SensorCorrection) -> FrequencyResponse:
    """A response that knows how well the scales of its outputs were corrected."""
    stds = np.array([[correction.scale_std(name), 0.0] for name in response.outputs])
    if not stds.any():
        return response
    known = response.sensor_errors
    return replace(response, sensor_errors=stds if known is None else np.maximum(known, stds))


def _of_forces(record: FlightRecord) -> tuple[str, ...]:
    velocities = VELOCITIES if any(name in record.channel_names for name in VELOCITIES) else EARTH_VELOCITIES
    return (*ACCELERATIONS, *velocities, *RATES, *ATTITUDE)


def _histories(flight: Flight, wanted: Sequence[str], sensors: Sequence[str]) -> list[TimeHistory]:
    """What a maneuver holds of some channels, on one clock; nothing where no sensor is among them."""
    record, maneuver = flight
    there = [name for name in wanted if name in record.channel_names]
    if not set(there) & set(sensors) or set(there) <= set(sensors):
        return []
    try:
        found = resample(record, channels=there, start_s=maneuver.start_s, stop_s=maneuver.stop_s).histories
    except InsufficientDataError:
        # A channel that stands still or begins later: the other maneuvers tell.
        return []
    return [one for one in found if one.duration_s >= _SHORTEST_S]


def _corrected_topic(record: FlightRecord, topic: Topic, correction: SensorCorrection) -> Topic:
    touched = {*correction.matrix, *correction.constant}
    rows = {channel.name: row for row, channel in enumerate(topic.channels) if channel.name in touched}
    if correction.place_m:
        rows |= {channel.name: row for row, channel in enumerate(topic.channels) if channel.name in ACCELERATIONS}
    if not rows:
        return topic
    measured = {name: _at(record, topic, name) for name in (*RATES, *ACCELERATIONS) if name in record.channel_names}
    rates = {name: measured[name] for name in RATES if name in measured}
    right = {name: corrected_values(correction, name, rates) for name in rates}
    sensors = {**measured, **right, **_slopes(topic.time_s, right)}
    values = topic.values.copy()
    for name, row in rows.items():
        values[row] = right[name] if name in right else corrected_values(correction, name, sensors)
    return replace(topic, values=values)


def _at(record: FlightRecord, topic: Topic, name: str) -> FloatArray:
    """A channel at the stamps of a topic: its own samples where it holds them."""
    for row, channel in enumerate(topic.channels):
        if channel.name == name:
            own: FloatArray = topic.values[row]
            return own
    other, row = next(iter(record.holding(name)))
    known = np.isfinite(other.values[row])
    return np.asarray(np.interp(topic.time_s, other.time_s[known], other.values[row][known]))


def _slopes(time_s: FloatArray, rates: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Derivatives of rates; zero where stamps repeat or samples are missing."""
    slopes = {}
    for name, values in rates.items():
        known = np.isfinite(values) & np.concatenate([[True], np.diff(time_s) > 0.0])
        slope = np.zeros(values.shape)
        if known.sum() > 3:
            slope[known] = CubicSpline(time_s[known], values[known])(time_s[known], 1)
        slopes[f"{name}_dot"] = slope
    return slopes
