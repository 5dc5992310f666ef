r"""Effects of tilt that the linear hover model leaves out.

Derivatives of hover hold for small angles. At a lean of :math:`\phi` the lift carries :math:`\cos\phi` of its weight,
the height controller asks for what is missing, rotors turn faster, rise and sink twice in a period and meet the air at
another speed: all of the size of :math:`1 - \cos\phi`, and at the frequency of the sweep itself. Where thrust grows
with the square of the command, responses are wrong by up to as much, in magnitude and in phase, and no residual shows
it where other parameters follow. So each response to an input has two relative errors of the standard deviation

.. math:: 0.6 \, \gamma \, \overline{\phi^2 + \theta^2}(\omega)

the mean over the times when the input moved at a frequency, which for a swing is :math:`1 - \cos` of its height;
:math:`\gamma` from zero, thrust in proportion to the command, to one, its square
(:mod:`rotorid.flights.thrust_slope`); and 0.6 for a share of which only is known that it lies between
none and all (its root mean square).

The Hummingbird of the library, swept to 0.35 rad at 4 to 5 rad/s in calm air, answers 4 to 6 % more there than its
exact linearization. Models of one axis lay that on the speed derivatives, which come out 10 % too small. Of that the
air itself makes 3 %: rotors that meet it inclined drag less, and the moment by u as flown is 5.91 of 6.09. Motion in
body axes, with the sine of the pitch angle and q w, moves u by 2 % the other way, and the control power grows by
0.7 %. The rest is what the same few percent make of a response near the speed mode.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import is_command
from rotorid.flights.while_moving import WeightedMean, input_weighted_mean
from rotorid.results.segment import Segment
from rotorid.typing import FloatArray

ANGLES: Mapping[str, str] = MappingProxyType({"roll_command": "phi", "pitch_command": "theta"})
"""Inputs that tilt a vehicle, and the tilt angle."""

_SHARE = 0.6
"""Root mean square of a share known only to lie between zero and one: 1/√3, rounded."""


def with_tilt_errors(
    response: FrequencyResponse, flights: Sequence[Flight], segments: Sequence[Segment], factor: float
) -> FrequencyResponse:
    """A response that knows how far the vehicle leaned while its inputs moved at each frequency.

    Parameters
    ----------
    flights
        Logs and maneuvers behind them. An input whose own angle a log lacks has no error here, but its usual one
        (:mod:`rotorid.flights.unchecked`).
    segments
        Their data.
    factor
        How thrust bends, see :func:`rotorid.flights.thrust_slope.curvature`.
    """
    records = {flight.record.source.name: flight.record for flight in flights}
    angles = logged_angles(records.values())
    names = [name for name in response.inputs if is_command(name) and ANGLES.get(name, "phi") in angles]
    if not names or factor == 0.0:
        return response
    parts = [
        WeightedMean.of(segment.history, names, _squared_tilt(records[segment.record], segment.history.time_s, angles))
        for segment in segments
        if segment.record in records
    ]
    if not parts:
        return response
    errors = np.zeros((len(response.inputs), response.omega_rad_s.size))
    errors[[response.inputs.index(name) for name in names]] = (
        _SHARE * factor * input_weighted_mean(parts, response.omega_rad_s)
    )
    return replace(response, lean_errors=errors)


def logged_angles(records: Iterable[FlightRecord]) -> tuple[str, ...]:
    """Tilt angles logged in all of some logs."""
    logged = [set(record.channel_names) for record in records]
    return tuple(name for name in ANGLES.values() if all(name in names for names in logged))


def _squared_tilt(record: FlightRecord, time_s: FloatArray, names: Sequence[str]) -> FloatArray:
    """Square of the tilt about its mean, in rad² and at most one, shape ``(n,)``."""
    angles = [np.interp(time_s, record[name].time_s, record[name].values) for name in names]
    return np.asarray(np.minimum(sum((angle - angle.mean()) ** 2 for angle in angles), 1.0))
