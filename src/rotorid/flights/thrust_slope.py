r"""How the slope of thrust changes while a sweep runs through its frequencies.

Where thrust grows with the square of what is commanded, its slope grows with the mean command. The mean is not
constant: rotors that swing lift more in the mean, a tilted vehicle asks for more, one that is late in slowing down for
less. So low and high frequencies of one sweep are measured with slopes that differ by some percent, which no residual
shows where a lag can follow. By how much is known up to a factor from zero to one,

.. math:: \Delta \ln|H(\omega)| = \gamma \, \ln \frac{\bar c(\omega)}{\bar c}, \qquad \gamma = \min(2 (n - 1), 1),
    \qquad n = \frac{|a_z / c| \, \bar c}{\overline{-a_z}}

with the mean command :math:`\bar c(\omega)` at the times when the input moved at a frequency. The elasticity n is one
of thrust in proportion to the command and two of a square; mean specific force is mean thrust, so that the response of
heave to thrust shows it, at the frequencies where it is largest. A curve of second order through zero has
:math:`\gamma = 2 (n - 1)/n`; with an offset it is more or less, so that the larger one counts. Where a log holds no
excitation of thrust, a factor of 0.6 stands for all from zero to one (its root mean square).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.record import FlightRecord, Maneuver, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import is_command
from rotorid.flights.while_moving import WeightedMean, input_weighted_mean
from rotorid.signal.clock import resample
from rotorid.signal.dead_sensors import shows_gravity
from rotorid.signal.excitations import find_excitations, rich_excitations
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_THRUST, _HEAVE = "thrust_command", "az"

_UNKNOWN = 0.6
"""Root mean square of a factor known only to lie between zero and one: 1/√3, rounded."""

_LEAST_COMMAND = 0.05
"""A mean command below this is no share of full thrust."""

_COHERENT = 0.8
"""Least coherence of thrust and heave at which the slope is read."""

_BAND_RAD_S = 2.0, 12.0
"""Where it is."""

_WINDOW_S, _LEAST_WINDOWS = 6.0, 2.0
"""Length of the windows by which it is, and how many of them an excitation must last at least."""


def with_slope_changes(response: FrequencyResponse, records: Sequence[TimeHistory], factor: float) -> FrequencyResponse:
    """A response that knows how the slope of thrust changed over its frequencies.

    Parameters
    ----------
    factor
        See :func:`curvature`.
    records
        Their data. Without ``thrust_command`` nothing is known, and the response stays as it is.
    """
    if not all(_THRUST in record.names for record in records):
        return response
    level = float(np.average([record[_THRUST].mean() for record in records], weights=[r.duration_s for r in records]))
    if level < _LEAST_COMMAND:
        return response
    moving = [index for index, name in enumerate(response.inputs) if is_command(name)]
    changes = np.zeros((len(response.inputs), response.omega_rad_s.size))
    names = [response.inputs[index] for index in moving]
    if names and factor > 0.0:
        changes[moving] = factor * mean_command_changes(records, names, response.omega_rad_s, level=level)
    return replace(response, slope_changes=changes)


def mean_command_changes(
    records: Sequence[TimeHistory], inputs: Sequence[str], omega_rad_s: FloatArray, *, level: float
) -> FloatArray:
    """Logarithm of the mean thrust command over its level, at the times when an input moves at each frequency.

    See :func:`rotorid.flights.while_moving.input_weighted_mean`.

    Parameters
    ----------
    records
        With the inputs and ``thrust_command``.
    inputs
        Channels that were excited.
    omega_rad_s
        Frequencies, shape ``(f,)``.
    level
        Mean of the command over all records.

    Returns
    -------
    numpy.ndarray
        Shape ``(inputs, f)``.

    Examples
    --------
    A chirp from 2 to 20 rad/s while the mean command falls by a tenth:

    >>> from rotorid.data.record import Channel
    >>> time_s = np.arange(0.0, 60.0, 0.02)
    >>> chirp = np.sin(2.0 * time_s + 0.15 * time_s**2)
    >>> channels = Channel(name="roll_command", unit="1"), Channel(name="thrust_command", unit="1")
    >>> record = TimeHistory(values=[chirp, 0.5 - 0.05 * time_s / 60.0], channels=channels, sample_rate_hz=50.0,
    ...                      start_s=0.0)
    >>> mean_command_changes([record], ["roll_command"], np.array([3.0, 18.0]), level=0.475).round(2)
    array([[ 0.05, -0.03]])
    """
    parts = [WeightedMean.of(record, inputs, record[_THRUST]) for record in records]
    return input_weighted_mean(parts, omega_rad_s, lambda mean: np.log(np.maximum(mean / level, _LEAST_COMMAND)))


def curvature(records: Sequence[FlightRecord], known: Sequence[Flight] = ()) -> float:
    """Factor from a change of the mean command to that of the slope of thrust, from zero to one.

    Parameters
    ----------
    records
        Logs; the largest factor of those with an excitation of thrust counts, 0.6 without any.
    known
        Excitations of thrust among them, which then need not be looked for.
    """
    flown = known or [
        Flight(record, longest)
        for record in {id(record): record for record in records}.values()
        if (longest := _longest(record)) is not None
    ]
    elasticities = [found for flight in flown if (found := _elasticity(flight)) is not None]
    if not elasticities:
        return _UNKNOWN
    steepest = max(*elasticities, 1.0)
    return min(2.0 * (steepest - 1.0), 1.0)


def _longest(record: FlightRecord) -> Maneuver | None:
    """The longest excitation of thrust in a log."""
    if not {_THRUST, _HEAVE} <= set(record.channel_names):
        return None
    flown = rich_excitations(record, "thrust") or find_excitations(record, "thrust")
    return max(flown, key=lambda maneuver: maneuver.duration_s, default=None)


def _elasticity(flight: Flight) -> float | None:
    """Relative change of thrust over that of the command, by the heave that an excitation shows."""
    record, maneuver = flight.record, flight.maneuver
    if not {_THRUST, _HEAVE} <= set(record.channel_names) or maneuver.duration_s <= _LEAST_WINDOWS * _WINDOW_S:
        return None
    flown = resample(record, channels=(_THRUST, _HEAVE), start_s=maneuver.start_s, stop_s=maneuver.stop_s)
    found = [_of_history(history) for history in flown.histories]
    return max((value for value in found if value is not None), default=None)


def _of_history(history: TimeHistory) -> float | None:
    from scipy.signal import csd, welch

    length = int(_WINDOW_S * history.sample_rate_hz)
    command, heave, level = history[_THRUST], history[_HEAVE], float(history[_THRUST].mean())
    if command.size < _LEAST_WINDOWS * length or level < _LEAST_COMMAND:
        return None
    rate_hz = history.sample_rate_hz
    hz, moved = welch(command, fs=rate_hz, nperseg=length)
    _, answered = welch(heave, fs=rate_hz, nperseg=length)
    _, together = csd(command, heave, fs=rate_hz, nperseg=length)
    coherence = np.abs(together) ** 2 / np.maximum(moved * answered, 1e-300)
    low, high = np.array(_BAND_RAD_S) / (2.0 * np.pi)
    coherent = (hz >= low) & (hz <= high) & (coherence >= _COHERENT)
    if not coherent.any():
        return None
    return float(np.max(np.abs(together[coherent]) / moved[coherent])) * level / _mean_force(heave)


def _mean_force(heave: FloatArray) -> float:
    """Mean specific force along the thrust; gravity, where the accelerometer does not show it."""
    measured = -float(heave.mean())
    return measured if shows_gravity(measured) else STANDARD_GRAVITY_M_S2
