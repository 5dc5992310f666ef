r"""What other filters would do to a flown loop: noise of the command, moment by moment, and phase at the crossover.

The rate that a controller took has passed the flown filters :math:`F`; others :math:`F'` would have made of its density
:math:`S` in the moment :math:`k`

.. math:: \sigma^2 = \frac{1}{n} \sum_k \int S_k \left| \frac{F'_k}{F_k} \right|^2 |C'|^2 \, df

of the command through P and D of the controller :math:`C'`, whose own filters may change too. Notches that follow the
motors have another response in each moment. The feedback is left out: at these frequencies loops have little gain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.autopilots.filters import combined_response
from rotorid.autopilots.notches import Motion, MovingNotches
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import RATE_OF
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import LogControllers, controllers_of
from rotorid.flights.gyro_noise import GyroNoise, gyro_noise
from rotorid.models.controller import RateController
from rotorid.signal.autopilot_filters import controller_filters
from rotorid.tuning.noise import RateNoise, density_behind
from rotorid.typing import Axis, ComplexArray, FloatArray

PARTS = 10
"""Parts of a flight whose scatter gives the intervals."""

NOISE_ABOVE_HZ = 30.0
"""Below it is the motion of the vehicle."""

_MODEL_ERROR = 0.03
"""Share of the noise that is left by which a prediction errs whatever the length of the flight: the next one has other
throttles, and speeds of motors are known to a per cent."""

_SLOWEST = 0.05
"""Share of the flight with lower centers of notches than those that margins are judged with."""

_LAG_AT_RAD_S = 30.0
"""Frequency whose lag orders the moments of a notch."""

_LEAST_GAIN = 1e-4
"""Least response of a flown filter that is taken off."""

LOG_SPEEDS = "log the motors' speeds at 40 Hz and more"

FilteredDensity = Mapping[str, FloatArray]
"""Rate to its density behind other notches, averaged over each part of a flight, shape ``(parts, f)``."""


def with_parameters(record: FlightRecord, values: Mapping[str, float]) -> FlightRecord:
    """The record with other parameters, by the names of its own; those that it lacks are added."""
    return replace(record, parameters={**record.parameters, **values})


def _moving(record: FlightRecord, noise: GyroNoise) -> MovingNotches:
    return autopilot_of(record).log.moving_notches(record, noise.motion)


def filtered_density(record: FlightRecord, then: FlightRecord, noise: GyroNoise) -> FilteredDensity:
    """Densities of the rates with the notches and low-passes of the gyro of another record.

    Raises
    ------
    InsufficientDataError
        A notch that changes follows something that is not in the log.
    """
    omega = noise.omega_rad_s
    pairs = (_static(record, then, omega), _moved(record, then, noise, omega))
    before, after = (np.atleast_2d(static * moved) for static, moved in zip(*pairs, strict=True))
    parts = np.array_split(np.arange(noise.time_s.size), PARTS)
    found = {name: density_behind(rows, before, after) for name, rows in noise.density.items()}
    return {name: np.stack([rows[part].mean(axis=0) for part in parts]) for name, rows in found.items()}


def _static(record: FlightRecord, then: FlightRecord, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Filters that stay where they are, of both records, shape ``(f,)`` each."""
    before, after = (combined_response(controller_filters(one), omega) for one in (record, then))
    return before, after


def _moved(
    record: FlightRecord, then: FlightRecord, noise: GyroNoise, omega: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Moving notches of both records, shape ``(n, f)`` each, or ``(f,)`` of nothing where none changes."""
    before, after = (_moving(one, noise) for one in (record, then))
    if before.settings == after.settings:
        none = np.ones(omega.size, dtype=np.complex128)
        return none, none
    if unknown := before.unknown or after.unknown:
        raise InsufficientDataError(unknown, remedy=LOG_SPEEDS)
    return before.response(omega), after.response(omega)


def _static_ratio(record: FlightRecord, then: FlightRecord, omega: FloatArray) -> ComplexArray:
    """The filters of another record that stay over the flown ones, at frequencies of the loop, shape ``(f,)``."""
    before, after = _static(record, then, omega)
    return np.asarray(after / np.where(np.abs(before) < _LEAST_GAIN, _LEAST_GAIN, before))


def _moving_ratio(record: FlightRecord, then: FlightRecord, noise: GyroNoise, omega: FloatArray) -> ComplexArray:
    """Moving notches of another record over the flown ones, shape ``(n, f)``, or ``(1, f)`` where none changes."""
    before, after = _moved(record, then, noise, omega)
    return np.atleast_2d(after / np.where(np.abs(before) < _LEAST_GAIN, _LEAST_GAIN, before))


def moving_notches_change(record: FlightRecord, then: FlightRecord) -> bool:
    """Whether a notch that follows something has other settings in another record."""
    nothing = Motion(None, None)
    before, after = (autopilot_of(one).log.moving_notches(one, nothing).settings for one in (record, then))
    return before != after


def command_powers(
    controller: RateController, noise: GyroNoise, density: FloatArray, *, above_hz: float = NOISE_ABOVE_HZ
) -> FloatArray:
    """Mean square of a command through P and D, in each part of a flight, shape ``(parts,)``.

    Parameters
    ----------
    controller
        With its gains and the filters of its terms.
    density
        Of the rate, shape ``(parts, f)``.
    above_hz
        Noise below it does not count.
    """
    omega = noise.omega_rad_s
    gain = np.abs(replace(controller, integral=0.0, angle_1_s=0.0).response(omega)) ** 2
    step_hz = float(noise.frequency_hz[1] - noise.frequency_hz[0])
    return np.asarray(density @ (gain * (noise.frequency_hz >= above_hz)) * step_hz)


def noise_of_rate(record: FlightRecord, then: FlightRecord, noise: GyroNoise, axis: Axis) -> RateNoise:
    """Noise of the rate of an axis behind the filters of another record, over the whole flight.

    Parameters
    ----------
    record, then, noise
        As for :func:`filtered_density`.
    axis
        ``roll``, ``pitch`` or ``yaw``.

    Raises
    ------
    InsufficientDataError
        A notch that changes follows something that is not in the log.
    """
    density = filtered_density(record, then, noise)[RATE_OF[axis]].mean(axis=0)
    kept = noise.frequency_hz >= NOISE_ABOVE_HZ
    return RateNoise(omega_rad_s=noise.omega_rad_s, density=density * kept / (2.0 * math.pi))


def noise_behind(noise: RateNoise, record: FlightRecord, then: FlightRecord) -> RateNoise:
    """Noise of a rate behind the filters of another record, by that behind the flown ones alone.

    Parameters
    ----------
    noise
        Behind the filters of ``record``.
    record, then
        The flown parameters, and others.

    Raises
    ------
    InsufficientDataError
        A notch that follows something changes: its moments are not known.
    """
    if moving_notches_change(record, then):
        raise InsufficientDataError("a notch that moves in flight changes", remedy="give the log with the result")
    before, after = _static(record, then, noise.omega_rad_s)
    return replace(noise, density=density_behind(noise.density, before, after))


def rate_densities(records: Sequence[FlightRecord], commands: Sequence[str]) -> Mapping[str, FloatArray]:
    """Noise of the rates of commands, each from the first log that has the command, for a result.

    Parameters
    ----------
    records
        Logs of one vehicle.
    commands
        Inputs of a model, of which only commands of roll, pitch and yaw count.

    Returns
    -------
    Mapping
        Axis to rad/s and one-sided density behind the flown filters, shape ``(2, n)``; without those whose log shows
        no noise of the gyro.
    """
    found: dict[str, FloatArray] = {}
    for axis in RATE_OF:
        command = f"{axis}_command"
        record = next((record for record in records if command in record.channel_names), None)
        if command not in commands or record is None or controllers_of(record).axis(axis) is None:
            continue
        try:
            noise = noise_of_rate(record, record, gyro_noise(record), axis)
        except InsufficientDataError:
            continue
        found[axis] = np.stack([noise.omega_rad_s, noise.density])
    return found


def saved(flown: FloatArray, then: FloatArray) -> Quantity:
    r"""Noise that is saved, per cent of the root mean square; negative where there is more of it.

    .. math:: 100 (1 - e^{x}), \qquad x = \tfrac{1}{2} \ln \frac{\sum_k \sigma_k'^2}{\sum_k \sigma_k^2}

    with a jackknife over the parts of the flight and 3 % of what is left.

    Parameters
    ----------
    flown, then
        Mean squares in each part, shape ``(parts,)``.

    Examples
    --------
    >>> found = saved(np.full(10, 4.0), np.full(10, 1.0))
    >>> round(found.value), round(found.lower), round(found.upper)
    (50, 47, 53)
    """
    if np.array_equal(flown, then) or not flown.sum() > 0.0:
        return Quantity(value=0.0, std=0.0, lower=0.0, upper=0.0, unit="%")
    ratio = 0.5 * math.log(float(then.sum() / flown.sum()))
    rest = 0.5 * np.log((then.sum() - then) / (flown.sum() - flown))
    std = math.hypot(math.sqrt((rest.size - 1) * float(np.var(rest))), _MODEL_ERROR)
    ends = [100.0 * (1.0 - math.exp(ratio + sign * TWO_SIDED_95 * std)) for sign in (1.0, -1.0)]
    left = math.exp(ratio)
    return Quantity(value=100.0 * (1.0 - left), std=100.0 * left * std, lower=ends[0], upper=ends[1], unit="%")


def ratio_at_slowest(record: FlightRecord, then: FlightRecord, omega_rad_s: FloatArray) -> ComplexArray:
    """Filters of the gyro of another record over the flown ones, for margins, shape ``(f,)``.

    A notch that follows the motors lags most where they are slowest: it is that moment.

    Raises
    ------
    InsufficientDataError
        A notch that changes follows something that is not in the log, or the log is too slow to show it.
    """
    static = _static_ratio(record, then, omega_rad_s)
    if not moving_notches_change(record, then):
        return static
    noise = gyro_noise(record)
    lags = -np.angle(_moving_ratio(record, then, noise, np.array([_LAG_AT_RAD_S]))[:, 0])
    slowest = int(np.argsort(lags, kind="stable")[math.ceil((1.0 - _SLOWEST) * (lags.size - 1))])
    moment = replace(
        noise,
        time_s=noise.time_s[slowest : slowest + 1],
        density={},
        motion=noise.motion.at(np.array([slowest])),
    )
    return np.asarray(static * _moving_ratio(record, then, moment, omega_rad_s)[0])


def phase_cost(
    record: FlightRecord,
    then: FlightRecord,
    noise: GyroNoise,
    axis: Axis,
    crossover_rad_s: float,
    *,
    flown: LogControllers,
) -> Quantity:
    """Phase that other filters cost at the crossover of an axis, degrees; negative where they give some.

    The interval is that of the centers of moving notches over the flight.

    Parameters
    ----------
    flown
        The controllers of the record.
    """
    at = np.array([crossover_rad_s])
    pair = (flown.axis(axis), flown.with_parameters(then.parameters).axis(axis))
    before, after = (1.0 if one is None else one.controller.rate_loop.response(at)[0] for one in pair)
    ratios = after / before * _static_ratio(record, then, at)[0] * _moving_ratio(record, then, noise, at)[:, 0]
    angles = -np.degrees(np.angle(ratios))
    low, middle, high = (float(value) for value in np.quantile(angles, (0.025, 0.5, 0.975)))
    return Quantity(value=middle, std=float(np.std(angles)), lower=low, upper=high, unit="deg")
