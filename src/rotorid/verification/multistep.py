r"""A physical model of flight over many steps: position, velocity, attitude and rates from the motors alone.

From a state of the log, the rigid body is integrated under the measured motors,

.. math::

    \dot p = v, \quad \dot v = R F(\Omega, R^T (v - W), \omega) / m + g, \quad
    \dot q = \tfrac{1}{2} q \otimes \omega, \quad I \dot\omega = M - \omega \times I \omega,

for a number of steps, and then compared with the log; so from many samples. Nothing else of the log enters: rates and
velocities after the start are what is predicted. An error is the mean over all starts of the norm of the difference;
that of attitude is the angle of the rotation between both. The naive predictor keeps the state as it is, so that a
share of its error says whether a model is worth having over that time.

In closed loop such errors are small where the model of torque is: they score a model, and must not identify one.

Sources: Busetto et al., a benchmark of system identification for nano-quadrotors, 2025, for errors over horizons and
their sums beside a state that is kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.frames import quaternion_from_euler
from rotorid.models.flight import INERTIA, Airframe, flight_loads
from rotorid.typing import FloatArray, IntArray
from rotorid.units import STANDARD_GRAVITY_M_S2

QUANTITIES: Mapping[str, str] = {"position": "m", "velocity": "m/s", "attitude": "rad", "rates": "rad/s"}
"""What is predicted, and its unit."""

_MOST_STARTS = 1000


class FlightState(NamedTuple):
    """States of a rigid body, whatever the shape after the first axis.

    Parameters
    ----------
    position, velocity
        North, east, down, in m and m/s, over ground; three rows.
    attitude
        Quaternion w, x, y, z from body to earth; four rows.
    rates
        p, q, r in rad/s; three rows.
    """

    position: FloatArray
    velocity: FloatArray
    attitude: FloatArray
    rates: FloatArray

    def at(self, samples: IntArray) -> FlightState:
        """The states at some samples."""
        return FlightState(*(rows[:, samples] for rows in self))


def measured_states(
    attitude: FloatArray, velocity: FloatArray, rates: FloatArray, *, step_s: float, position: FloatArray | None = None
) -> FlightState:
    """States of a log.

    Parameters
    ----------
    attitude
        Roll, pitch and heading in rad, shape ``(3, n)``.
    velocity
        Over ground, body axes, m/s, shape ``(3, n)``.
    rates
        rad/s, shape ``(3, n)``.
    step_s
        Between samples.
    position
        North, east, down in m; without it the velocity is integrated.
    """
    quaternion = quaternion_from_euler(attitude)
    over_ground = _to_earth(quaternion, velocity)
    if position is None:
        moved = np.cumsum(0.5 * step_s * (over_ground[:, 1:] + over_ground[:, :-1]), axis=1)
        position = np.concatenate([np.zeros((3, 1)), moved], axis=1)
    return FlightState(position, over_ground, quaternion, rates)


@dataclass(frozen=True, kw_only=True, eq=False)
class StepErrors(Immutable):
    """Errors of a model over many steps, and those of a state that is kept.

    Parameters
    ----------
    horizons_s
        Time after the start, shape ``(steps,)``.
    model, naive
        Mean norm of the error of each of :data:`QUANTITIES`, shape ``(steps,)``.
    starts
        How many samples it was predicted from.
    """

    horizons_s: FloatArray
    model: Mapping[str, FloatArray]
    naive: Mapping[str, FloatArray]
    starts: int

    def __post_init__(self) -> None:
        self._set(
            horizons_s=read_only(self.horizons_s, np.float64, ndim=1),
            model={name: read_only(row, np.float64, ndim=1) for name, row in self.model.items()},
            naive={name: read_only(row, np.float64, ndim=1) for name, row in self.naive.items()},
        )

    @property
    def ratios(self) -> dict[str, float]:
        """Sum of the errors over all steps, as a share of that of the naive predictor; infinite where that is zero."""
        sums = {name: float(row.sum()) for name, row in self.naive.items()}
        return {name: float(self.model[name].sum()) / total if total > 0.0 else np.inf for name, total in sums.items()}


def pooled(parts: Sequence[StepErrors]) -> StepErrors:
    """Errors of several stretches with the same steps, each start counting once."""
    counts = np.array([part.starts for part in parts], dtype=np.float64)

    def mean(rows: list[Mapping[str, FloatArray]]) -> dict[str, FloatArray]:
        return {name: np.average([row[name] for row in rows], axis=0, weights=counts) for name in QUANTITIES}

    return StepErrors(
        horizons_s=parts[0].horizons_s,
        model=mean([part.model for part in parts]),
        naive=mean([part.naive for part in parts]),
        starts=int(counts.sum()),
    )


def step_errors(
    values: Mapping[str, float],
    airframe: Airframe,
    states: FlightState,
    speeds: FloatArray,
    *,
    step_s: float,
    steps: int,
    wind: FloatArray | None = None,
    most_starts: int = _MOST_STARTS,
) -> StepErrors:
    """Predict a log over many steps, from samples all through it.

    Parameters
    ----------
    values
        Of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`. An axis without its inertia keeps its rate.
    states
        Of the log, with ``n`` samples.
    speeds
        Of the rotors as they turn (lag and delay have acted), going from sample to sample in lines, shape
        ``(rotors, n)``.
    step_s
        Between samples.
    steps
        How many are predicted.
    wind
        Toward north and east in m/s, shape ``(2,)``; none by default.
    most_starts
        Evenly over the log; every sample where it has fewer.

    Raises
    ------
    InsufficientDataError
        The log is shorter than the horizon.

    Examples
    --------
    A stone that falls, with its rotors at rest:

    >>> frame = Airframe(positions=np.zeros((1, 3)), spins=np.ones(1), mass_kg=1.0, disc_m2=0.1)
    >>> time_s = 0.1 * np.arange(4.0)
    >>> fall = 0.5 * STANDARD_GRAVITY_M_S2 * np.array([0, 0, 1])[:, None] * time_s**2
    >>> states = FlightState(fall, np.gradient(fall, 0.1, axis=1, edge_order=2), np.eye(4)[:, [0] * 4], 0.0 * fall)
    >>> found = step_errors({"c_2": 1.0}, frame, states, np.zeros((1, 4)), step_s=0.1, steps=2)
    >>> found.model["position"].round(9).tolist(), found.naive["position"].round(3).tolist()
    ([0.0, 0.0], [0.098, 0.294])
    """
    samples = speeds.shape[1]
    if samples <= steps:
        raise InsufficientDataError(
            f"the stretch lasts {samples * step_s:.2g} s", needed=f"more than the {steps * step_s:.2g} s of prediction"
        )
    starts = spread_starts(samples, steps=steps, most=most_starts)
    predicted = predicted_steps(values, airframe, states, speeds, step_s=step_s, steps=steps, starts=starts, wind=wind)
    return score_steps(predicted, states, starts=starts, step_s=step_s)


def spread_starts(samples: int, *, steps: int, most: int = _MOST_STARTS) -> IntArray:
    """Samples to predict from, evenly over a log that goes on for so many steps after the last.

    Examples
    --------
    >>> spread_starts(6, steps=2).tolist(), spread_starts(100, steps=50, most=3).tolist()
    ([0, 1, 2, 3], [0, 24, 49])
    """
    return np.linspace(0, samples - steps - 1, min(samples - steps, most)).round().astype(np.int64)


def predicted_steps(
    values: Mapping[str, float],
    airframe: Airframe,
    states: FlightState,
    speeds: FloatArray,
    *,
    step_s: float,
    steps: int,
    starts: IntArray,
    wind: FloatArray | None = None,
) -> FlightState:
    """States that a model predicts after each start, every quantity of shape ``(rows, steps, starts)``.

    Parameters
    ----------
    values, airframe, states, speeds, step_s, steps, wind
        As for :func:`step_errors`.
    starts
        Samples from whose measured state it begins.
    """
    body, now = _Body(values, airframe, np.zeros(2) if wind is None else wind), states.at(starts)
    reached = []
    for step in range(steps):
        now = body.advanced(now, speeds[:, starts + step], speeds[:, starts + step + 1], step_s)
        reached.append(now)
    return _stacked(reached)


def kept_steps(states: FlightState, *, steps: int, starts: IntArray) -> FlightState:
    """The naive prediction: the state of each start, unchanged; of the shape of :func:`predicted_steps`."""
    return _stacked([states.at(starts)] * steps)


def score_steps(predicted: FlightState, states: FlightState, *, starts: IntArray, step_s: float) -> StepErrors:
    """Errors of predictions, whoever made them, and of a state that is kept.

    Parameters
    ----------
    predicted
        Every quantity of shape ``(rows, steps, starts)``.
    states
        Of the log.
    starts
        Samples from which it was predicted.
    step_s
        Between samples.
    """
    first, steps = states.at(starts), predicted.position.shape[1]
    model: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    naive: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    for step in range(steps):
        there = states.at(starts + step + 1)
        reached = FlightState(*(rows[:, step] for rows in predicted))
        for kept, found in ((model, reached), (naive, first)):
            for name, error in _errors(there, found).items():
                kept[name].append(float(error.mean()))
    return StepErrors(
        horizons_s=np.arange(1, steps + 1) * np.float64(step_s),
        model={name: np.array(row) for name, row in model.items()},
        naive={name: np.array(row) for name, row in naive.items()},
        starts=starts.size,
    )


def _stacked(reached: Sequence[FlightState]) -> FlightState:
    """States after each step, shape ``(rows, steps, starts)``."""
    return FlightState(*(np.stack(rows, axis=1) for rows in zip(*reached, strict=True)))


def pieces(
    values: Mapping[str, float],
    airframe: Airframe,
    states: FlightState,
    speeds: FloatArray,
    *,
    step_s: float,
    starts: Sequence[int],
    wind: FloatArray | None = None,
) -> FlightState:
    """A whole log as a model flies it, again from the measured state at each of some samples.

    Parameters
    ----------
    values, airframe, states, speeds, step_s, wind
        As for :func:`step_errors`.
    starts
        First sample of each piece, rising; the first is zero.

    Returns
    -------
    FlightState
        Of all samples, with ``n`` columns.
    """
    begin = np.asarray(starts, dtype=np.int64)
    lengths = np.diff(np.append(begin, speeds.shape[1]))
    body, now = _Body(values, airframe, np.zeros(2) if wind is None else wind), states.at(begin)
    flown = FlightState(*(rows.copy() for rows in states))
    last = speeds.shape[1] - 1
    for step in range(1, int(lengths.max())):
        before, after = (np.minimum(begin + step + shift, last) for shift in (-1, 0))
        now = body.advanced(now, speeds[:, before], speeds[:, after], step_s)
        inside = step < lengths
        for rows, reached in zip(flown, now, strict=True):
            rows[:, begin[inside] + step] = reached[:, inside]
    return flown


def slower(states: FlightState, speeds: FloatArray, *, step_s: float, least_s: float) -> tuple[FlightState, FloatArray]:
    """A log that was faster, at steps of about ``least_s``: each so many samples, and motors as means around them.

    Means lose no impulse of the motors.

    Returns
    -------
    FlightState, FloatArray
        States and speeds; :func:`stride` says how many samples became one step.
    """
    every = stride(step_s, least_s)
    if every == 1:
        return states, speeds
    from scipy.ndimage import convolve1d

    # The trapezoidal rule, which is centered for any number of samples.
    weights = np.r_[0.5, np.ones(every - 1), 0.5] / every
    return FlightState(*(rows[:, ::every] for rows in states)), convolve1d(speeds, weights, axis=1, mode="nearest")[
        :, ::every
    ]


def stride(step_s: float, least_s: float) -> int:
    """Samples of a log in a step of ``least_s`` at most, and one at least.

    Examples
    --------
    >>> stride(0.0025, 0.01), stride(0.01, 0.01), stride(0.02, 0.01)
    (4, 1, 1)
    """
    return max(1, int(least_s / step_s + 1e-6))


class _Body:
    """A vehicle in a wind, for many starts at once."""

    def __init__(self, values: Mapping[str, float], airframe: Airframe, wind: FloatArray) -> None:
        self.values, self.airframe = values, airframe
        self.wind = np.array([wind[0], wind[1], 0.0])[:, None]
        known = [values.get(name) for name in INERTIA.values()]
        if any(value is not None and not value > 0.0 for value in known):
            raise ModelError("an inertia is not positive")
        self.inertia = np.array([value or 0.0 for value in known])[:, None]
        self.lightness = np.array([1.0 / value if value else 0.0 for value in known])[:, None]
        # What one axis gives to another needs all three.
        self.coupled = all(known)

    def advanced(self, state: FlightState, before: FloatArray, after: FloatArray, step_s: float) -> FlightState:
        """States one step later: Runge and Kutta, order 4."""
        spin_up, middle = (after - before) / step_s, 0.5 * (before + after)
        slope = total = self._slope(state, before, spin_up)
        for share, weight, speeds in ((0.5, 2.0, middle), (0.5, 2.0, middle), (1.0, 1.0, after)):
            slope = self._slope(_moved(state, slope, share * step_s), speeds, spin_up)
            total = FlightState(*(sum_of + weight * part for sum_of, part in zip(total, slope, strict=True)))
        return _moved(state, total, step_s / 6.0)

    def _slope(self, state: FlightState, speeds: FloatArray, spin_up: FloatArray) -> FlightState:
        w, x, y, z = state.attitude
        p, q, r = state.rates
        loads = flight_loads(
            self.values,
            self.airframe,
            speeds=speeds,
            velocity=to_body(state.attitude, state.velocity - self.wind),
            rates=state.rates,
            spin_up=spin_up,
        )
        acceleration = _to_earth(state.attitude, loads.force / self.airframe.mass_kg)
        acceleration[2] += STANDARD_GRAVITY_M_S2
        moment = loads.moment
        if self.coupled:
            moment = moment - np.cross(state.rates, self.inertia * state.rates, axis=0)
        turned = np.stack([-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p])
        return FlightState(state.velocity, acceleration, 0.5 * turned, self.lightness * moment)


def _moved(state: FlightState, slope: FlightState, time_s: float) -> FlightState:
    position, velocity, attitude, rates = (rows + time_s * part for rows, part in zip(state, slope, strict=True))
    return FlightState(position, velocity, attitude / np.sqrt((attitude**2).sum(axis=0)), rates)


def _errors(there: FlightState, predicted: FlightState) -> dict[str, FloatArray]:
    """Norm of the error of each quantity at each start."""
    # Both signs of a quaternion are one attitude; the chord keeps its digits where a cosine is nearly one.
    chords = [np.sqrt(((there.attitude + sign * predicted.attitude) ** 2).sum(axis=0)) for sign in (-1.0, 1.0)]
    return {
        "position": np.sqrt(((there.position - predicted.position) ** 2).sum(axis=0)),
        "velocity": np.sqrt(((there.velocity - predicted.velocity) ** 2).sum(axis=0)),
        "attitude": 4.0 * np.arcsin(0.5 * np.minimum(*chords)),
        "rates": np.sqrt(((there.rates - predicted.rates) ** 2).sum(axis=0)),
    }


def _to_earth(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    along = quaternion[1:]
    twice = 2.0 * np.cross(along, vector, axis=0)
    return np.asarray(vector + quaternion[0] * twice + np.cross(along, twice, axis=0))


def to_body(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Vectors over the earth in body axes, by quaternions from body to earth."""
    return _to_earth(quaternion * np.array([1.0, -1.0, -1.0, -1.0])[:, None], vector)
