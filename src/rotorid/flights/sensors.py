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

from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import while_flying
from rotorid.flights.measure import measure
from rotorid.settings.measuring import MeasureSettings
from rotorid.signal.clock import resample
from rotorid.signal.kinematics import ACCELERATIONS, EARTH_VELOCITIES, VELOCITIES
from rotorid.signal.sensor_correction import (
    SensorCorrection,
    corrected_values,
    correction_findings,
    estimate_correction,
)
from rotorid.typing import ComplexArray, FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")
_SHORTEST_S = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedSensors:
    """A correction, and the findings on it.

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
    _PROGRESS.info("sensor errors")
    flying, _ = while_flying(flights)
    rates = [history for flight in flying for history in _histories(flight, (*RATES, *ATTITUDE), RATES)]
    forces = [history for flight in flying for history in _histories(flight, _of_forces(flight.record), ACCELERATIONS)]
    correction = estimate_correction(rates, forces)
    return CorrectedSensors(correction=correction, findings=correction_findings(correction))


def corrected_record(record: FlightRecord, correction: SensorCorrection) -> FlightRecord:
    """A log with the errors of its sensors removed, in every topic."""
    return replace(record, topics=tuple(_corrected_topic(record, topic, correction) for topic in record.topics))


_OF_SENSOR = {"u_dot": "ax", "v_dot": "ay", "w_dot": "az"}
"""Outputs computed from a sensor, with its errors."""

_TOUCHED = (*RATES, *ACCELERATIONS)


def with_sensor_errors(
    response: FrequencyResponse,
    correction: SensorCorrection,
    flights: Sequence[Flight] = (),
    settings: MeasureSettings | None = None,
) -> FrequencyResponse:
    """A response that knows how well scale, misalignment and place of its sensors were corrected.

    Each error that is left moves an output by what its cause answers to the same input: a misalignment of q toward p by
    the response of p, a place beside the center of gravity by the derivatives of rates.

    Parameters
    ----------
    response
        Of corrected logs.
    correction
        With its covariance.
    flights, settings
        Corrected maneuvers, and how responses are measured: for causes that are no outputs of the response. Those that
        a log does not hold count as nothing.
    """
    root = _root(correction.covariance)
    if not root.size or not any(_OF_SENSOR.get(name, name) in _TOUCHED for name in response.outputs):
        return response
    caused = {name: response.values[row] for row, name in enumerate(response.outputs)}
    caused |= _further(response, correction, flights, settings)
    each = np.stack([_moved(response, unknown, caused) for unknown in correction.unknowns])
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nan_to_num(each / response.values, nan=0.0, posinf=0.0, neginf=0.0)
    return replace(response, sensor_shapes=np.einsum("nk,nyuf->kyuf", root, relative))


# Of an accelerometer at x, y, z: the rate whose derivative it shows for each coordinate, with its sign.
_LEVERS = {
    "ax": {"y": ("r", -1.0), "z": ("q", 1.0)},
    "ay": {"x": ("r", 1.0), "z": ("p", -1.0)},
    "az": {"x": ("q", -1.0), "y": ("p", 1.0)},
}


def _root(covariance: FloatArray) -> FloatArray:
    """Columns whose products sum to the covariance, shape ``(n, k)``."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _causes(unknown: tuple[str, str], output: str) -> tuple[str, float] | None:
    """Effect of a sensor error on an output: a channel, and the sign of its derivative.

    A sign of zero is the channel itself.
    """
    sensor, term = unknown
    if sensor == output:
        return term, 0.0
    if sensor == "accelerometer" and term in _LEVERS.get(output, {}):
        return _LEVERS[output][term]
    return None


def _moved(response: FrequencyResponse, unknown: tuple[str, str], caused: Mapping[str, ComplexArray]) -> ComplexArray:
    """The derivative of the responses by an error of a sensor, shape ``(y, u, f)``."""
    moved = np.zeros(response.values.shape, dtype=np.complex128)
    for row, name in enumerate(response.outputs):
        found = _causes(unknown, _OF_SENSOR.get(name, name))
        if found is not None and found[0] in caused:
            channel, sign = found
            # A place is taken out with its sign turned.
            moved[row] = -sign * 1j * response.omega_rad_s * caused[channel] if sign else caused[channel]
    return moved


def _further(
    response: FrequencyResponse,
    correction: SensorCorrection,
    flights: Sequence[Flight],
    settings: MeasureSettings | None,
) -> dict[str, ComplexArray]:
    """Responses of causes that are no outputs, on the frequencies of the response."""
    pairs = ((unknown, _OF_SENSOR.get(name, name)) for unknown in correction.unknowns for name in response.outputs)
    wanted = {found[0] for pair in pairs if (found := _causes(*pair)) is not None} - set(response.outputs)
    there = [name for name in _TOUCHED if name in wanted and all(name in pair.record.channel_names for pair in flights)]
    if not there or settings is None or not flights:
        return {}
    further = measure(flights, inputs=response.inputs, outputs=tuple(there), settings=settings).response
    return {name: _on_grid(further, row, response.omega_rad_s) for row, name in enumerate(there)}


def _on_grid(found: FrequencyResponse, row: int, omega_rad_s: FloatArray) -> ComplexArray:
    """Responses of one output at other frequencies, shape ``(u, f)``."""
    at, known = np.log(omega_rad_s), np.log(found.omega_rad_s)
    return np.array(
        [np.interp(at, known, values.real) + 1j * np.interp(at, known, values.imag) for values in found.values[row]]
    )


def _of_forces(record: FlightRecord) -> tuple[str, ...]:
    velocities = VELOCITIES if any(name in record.channel_names for name in VELOCITIES) else EARTH_VELOCITIES
    return (*ACCELERATIONS, *velocities, *RATES, *ATTITUDE)


def _histories(flight: Flight, wanted: Sequence[str], sensors: Sequence[str]) -> list[TimeHistory]:
    """Channels of a maneuver on one clock; empty without a sensor among them."""
    record, maneuver = flight.record, flight.maneuver
    there = [name for name in wanted if name in record.channel_names]
    if not set(there) & set(sensors) or set(there) <= set(sensors):
        return []
    try:
        found = resample(record, channels=there, start_s=maneuver.start_s, stop_s=maneuver.stop_s).histories
    except InsufficientDataError:
        # A channel that does not move or begins later: the other maneuvers decide.
        return []
    return [history for history in found if history.duration_s >= _SHORTEST_S]


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
    """A channel at the stamps of a topic: its own samples if it has them."""
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
