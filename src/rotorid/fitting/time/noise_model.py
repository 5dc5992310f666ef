r"""Noise model of a prediction-error fit: disturbances of the vehicle and noise of its sensors.

.. math:: M \dot x = F x + G u(t - \tau) + S (g + n), \qquad \dot g = -g / T + m, \qquad y = H_0 x + H_1 \dot x + v

The equations that hold parameters, those of forces and moments, are disturbed in two ways, and each sensor has white
noise of its own:

- *gusts* :math:`g`: forces with one correlation time T and any covariance. One gust pushes and turns a vehicle at once,
  so that the disturbances of several equations go together; independent ones describe it badly.
- *jolts* :math:`n`: white forces, one for each equation. They stand for what no sample shows, such as the motion of a
  command between its samples.

The best predictor under this noise is a steady Kalman filter, with exact derivatives. The covariance of the state's
prediction error solves the Riccati equation

.. math:: P = \Phi P \Phi^T + Q - K S K^T, \qquad S = C P C^T + R, \qquad K = \Phi P C^T S^{-1}

At its solution the gain is the best one, so that a change of it does not move :math:`P` to first order. With
:math:`\bar\Phi = \Phi - K C` what is left is linear, a Lyapunov equation for each direction:

.. math:: \dot P = \bar\Phi \dot P \bar\Phi^T + X + X^T + \dot Q + K \dot R K^T, \qquad
    X = (\dot\Phi - K \dot C) P \bar\Phi^T
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import ModelError, UsageError
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.expression import Expression
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linear import discretize
from rotorid.typing import FloatArray

_REACH = 1e5
"""A noise may be so many times larger or smaller than its natural size."""

_ONSET_S = 0.1
_LEAST_NOISE = 1e-4
_FOURTH_DIFFERENCE = 70.0**0.5
_FIRST_CORRELATION_S = 1.0


class NoiseLevels(NamedTuple):
    """Noise at some values of its parameters; where named ``d``, with the derivatives along them in front.

    Parameters
    ----------
    correlation_s
        T.
    gusts
        Covariance of the gusts, shape ``(d, d)``; zero by zero where there are none.
    jolts
        Spectral densities of the jolts, two-sided, shape ``(d,)``.
    sensors
        Variances of the sensors, shape ``(y,)``.
    """

    correlation_s: float
    gusts: FloatArray
    jolts: FloatArray
    sensors: FloatArray
    dcorrelation_s: FloatArray
    dgusts: FloatArray
    djolts: FloatArray
    dsensors: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseModel(Immutable):
    """Parameters of the noise, and where it acts.

    Only ratios of noises shape the predictor; the size of all together follows from the innovations. So the geometric
    mean of the sensors' variances, each over its natural size, is one here. Parameters are logarithms: of T, of the
    diagonal of the gusts' Cholesky factor, of the jolts, and of the sensors' ratios. What lies below that diagonal is
    linear, over its natural size.

    Parameters
    ----------
    disturbed
        Rows of the equations that are disturbed, shape ``(d,)``.
    forces
        Natural size of each disturbance, in the unit of its equation, shape ``(d,)``.
    sensors
        Natural standard deviation of each sensor, shape ``(y,)``.
    gusts, jolts
        Which disturbances there are.
    known
        Parameters of a noise that was identified before, shape ``(k,)``: then none is left to identify.
    """

    disturbed: tuple[int, ...]
    forces: FloatArray
    sensors: FloatArray
    gusts: bool = True
    jolts: bool = True
    known: FloatArray | None = None

    def __post_init__(self) -> None:
        if not self.disturbed or not (self.gusts or self.jolts):
            raise UsageError(
                "the noise model has no disturbances",
                needed="gusts or jolts on at least one equation",
                remedy="use the output-error fit if only the sensors are noisy",
            )
        forces, sensors = (read_only(values, np.float64, ndim=1) for values in (self.forces, self.sensors))
        if not (min(forces.min(), sensors.min()) > 0.0 and np.isfinite([*forces, *sensors]).all()):
            raise UsageError(
                "the typical size of a noise is not positive", remedy="leave out signals that never change"
            )
        known = None if self.known is None else read_only(self.known, np.float64, ndim=1)
        self._set(disturbed=tuple(int(row) for row in self.disturbed), forces=forces, sensors=sensors, known=known)

    @cached_property
    def _triangle(self) -> tuple[tuple[int, int], ...]:
        count = len(self.disturbed) if self.gusts else 0
        return tuple((i, j) for i in range(count) for j in range(i + 1))

    @cached_property
    def _ratios(self) -> FloatArray:
        """Orthonormal directions in which sensors change against each other, shape ``(y, y - 1)``."""
        from scipy.linalg import helmert

        count = self.sensors.size
        return np.asarray(helmert(count).T if count > 1 else np.zeros((1, 0)), dtype=np.float64)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters to identify."""
        if self.known is not None:
            return ()
        gusts = [f"gust_{i + 1}" if i == j else f"gust_{i + 1}_with_{j + 1}" for i, j in self._triangle]
        jolts = [f"jolt_{i + 1}" for i in range(len(self.disturbed))] if self.jolts else []
        ratios = [f"sensor_ratio_{i + 1}" for i in range(self._ratios.shape[1])]
        return (*(["gust_correlation"] if self.gusts else []), *gusts, *jolts, *ratios)

    @property
    def of_gusts(self) -> int:
        """How many of the parameters, the first ones, are those of gusts."""
        return len(self._triangle) + 1 if self.gusts else 0

    @property
    def start(self) -> FloatArray:
        """Natural sizes: gusts of 1 s, shape ``(k,)``; nothing where the noise is known."""
        return self.theta()[: len(self.names)]

    def theta(
        self,
        *,
        correlation_s: float = _FIRST_CORRELATION_S,
        gusts: float = 1.0,
        jolts: float = 1.0,
        sensors: Sequence[float] | None = None,
    ) -> FloatArray:
        """Parameters of given noise, shape ``(k,)``.

        Parameters
        ----------
        correlation_s
            Correlation time of the gusts.
        gusts, jolts
            Factors on their natural size.
        sensors
            Factor on the natural standard deviation of each.
        """
        gust = [np.log(gusts) if i == j else 0.0 for i, j in self._triangle]
        jolt = [np.log(jolts)] * (len(self.disturbed) if self.jolts else 0)
        factors = np.ones(self.sensors.size) if sensors is None else np.asarray(sensors, dtype=np.float64)
        ratio = self._ratios.T @ np.log(factors)
        return np.array([*([np.log(correlation_s)] if self.gusts else []), *gust, *jolt, *ratio])

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters, each shape ``(k,)``."""
        if self.known is not None:
            return np.zeros(0), np.zeros(0)
        reach = np.log(_REACH)
        first = [np.log(1e-3 * _FIRST_CORRELATION_S)] if self.gusts else []
        last = [np.log(1e3 * _FIRST_CORRELATION_S)] if self.gusts else []
        # A covariance mixes what is large with what is small: its part below the diagonal is not a logarithm.
        low = [-reach if i == j else -_REACH for i, j in self._triangle]
        rest = len(self.names) - len(low) - len(first)
        lower = np.array([*first, *low, *[-reach] * rest])
        return lower, np.array([*last, *(-value for value in low), *[reach] * rest])

    def at(self, theta: FloatArray) -> NoiseLevels:
        """Noise and its derivatives at some parameters, shape ``(k,)``."""
        if self.known is not None:
            levels = replace(self, known=None).at(self.known)
            return levels._replace(
                dcorrelation_s=levels.dcorrelation_s[:0],
                dgusts=levels.dgusts[:0],
                djolts=levels.djolts[:0],
                dsensors=levels.dsensors[:0],
            )
        count, d, y = theta.size, len(self.disturbed), self.sensors.size
        root = np.zeros((d, d)) if self.gusts else np.zeros((0, 0))
        droot = np.zeros((count, *root.shape))
        used = 1 if self.gusts else 0
        for slot, (i, j) in enumerate(self._triangle, start=used):
            size = float(self.forces[i])
            root[i, j] = size * (np.exp(theta[slot]) if i == j else theta[slot])
            droot[slot, i, j] = root[i, j] if i == j else size
        used += len(self._triangle)
        dgusts = droot @ root.T
        jolts, djolts = np.zeros(d), np.zeros((count, d))
        if self.jolts:
            slots = np.arange(used, used + d)
            jolts = self.forces**2 * _ONSET_S * np.exp(2.0 * theta[slots])
            djolts[slots, np.arange(d)] = 2.0 * jolts
            used += d
        sensors = self.sensors**2 * np.exp(2.0 * self._ratios @ theta[used:])
        dsensors = np.zeros((count, y))
        dsensors[used:] = 2.0 * sensors * self._ratios.T
        correlation_s = float(np.exp(theta[0])) if self.gusts else 1.0
        dcorrelation_s = np.zeros(count)
        dcorrelation_s[: 1 if self.gusts else 0] = correlation_s
        return NoiseLevels(
            correlation_s=correlation_s,
            gusts=root @ root.T,
            jolts=jolts,
            sensors=sensors,
            dcorrelation_s=dcorrelation_s,
            dgusts=dgusts + dgusts.swapaxes(1, 2),
            djolts=djolts,
            dsensors=dsensors,
        )


def noise_model(
    structure: LinearStructure,
    parameters: ParameterSet,
    records: Sequence[TimeData],
    *,
    gusts: bool = True,
    jolts: bool = True,
) -> NoiseModel:
    """The noise model of a structure, with natural sizes out of the records.

    A sensor's noise is what fourth differences of its output leave of it: they take away any motion that is slow
    against a sample. A disturbance has the size that shows through this noise a tenth of a second after its onset.

    Parameters
    ----------
    structure, parameters
        The model near its solution; equations with a parameter in F or G are disturbed, kinematic ones are not.
    records
        What was measured.
    gusts, jolts
        Which disturbances there are.

    Raises
    ------
    ModelError
        No equation holds a parameter, or a disturbance moves no output.
    """
    sensors = _sensor_noise(records)
    equations = zip(structure.F, structure.G, strict=True)
    rows = [i for i, (F, G) in enumerate(equations) if _moves(parameters, [*F, *G])]
    if not rows:
        raise ModelError(
            f"no equation of {structure.name} contains a parameter", needed="an equation of a force or moment"
        )
    system = structure.matrices(parameters.values)
    A, _, C, _ = system.proper()
    if len(A) < len(structure.states):
        raise ModelError("a state follows the input without lag", remedy="drop its lag, which removes the state")
    inverse = np.asarray(np.linalg.inv(system.M), dtype=np.float64)[:, rows]
    step = discretize(A, inverse, delays_s=np.zeros(len(rows)), step_s=_ONSET_S, hold="zero")
    shown = np.abs(C @ step.taps.sum(axis=0).T) + np.abs(system.H1 @ inverse)
    largest = (shown / sensors[:, None]).max(axis=0)
    if not (largest > 0.0).all():
        unseen = structure.states[rows[int(np.argmin(largest))]]
        raise ModelError(f"no output shows the disturbance of {unseen}", remedy="measure it or a motion that it causes")
    return NoiseModel(disturbed=tuple(rows), forces=1.0 / largest, sensors=sensors, gusts=gusts, jolts=jolts)


def _moves(parameters: ParameterSet, entries: Sequence[Expression]) -> bool:
    named = frozenset().union(*(entry.names for entry in entries))
    return any(name in parameters.names for name in named)


def _sensor_noise(records: Sequence[TimeData]) -> FloatArray:
    if min(record.samples for record in records) < 6:
        raise UsageError("a record has fewer than six samples", needed="records of a few seconds")
    rough = np.hstack([np.diff(record.outputs, n=4) for record in records]).std(axis=1) / _FOURTH_DIFFERENCE
    whole = np.hstack([record.outputs - record.outputs.mean(axis=1, keepdims=True) for record in records])
    return np.asarray(np.maximum(rough, _LEAST_NOISE * whole.std(axis=1)), dtype=np.float64)


_DOUBLINGS = 60
_AT_REST = 1e-14
_DEAD = 1e-18


class Predictor(NamedTuple):
    """The steady predictor.

    Parameters
    ----------
    gain
        K, shape ``(x, y)``.
    closed
        The transition of its errors, shape ``(x, x)``; all eigenvalues lie inside the unit circle.
    error
        Covariance P of the predicted state, shape ``(x, x)``.
    innovation
        Covariance S of the innovations, shape ``(y, y)``.
    """

    gain: FloatArray
    closed: FloatArray
    error: FloatArray
    innovation: FloatArray


@np.errstate(over="ignore", invalid="ignore")  # a motion that nothing shows grows without end
def steady_predictor(
    transition: FloatArray, measured: FloatArray, process: FloatArray, sensor: FloatArray
) -> Predictor:
    r"""Solve the Riccati equation by doubling.

    Each step doubles the time over which the covariance has settled, so that the slowest of errors takes few steps.
    The system may be unstable: the predictor of an unstable vehicle is stable all the same.

    Parameters
    ----------
    transition, measured
        :math:`\Phi` and C, shapes ``(x, x)`` and ``(y, x)``.
    process
        Covariance Q of what disturbs the state in a step, shape ``(x, x)``.
    sensor
        Variances R of the noise of each output, shape ``(y,)``, above zero.

    Raises
    ------
    ModelError
        There is no stable predictor: a motion that does not decay is not seen or never disturbed.

    References
    ----------
    Chu, Fan, Lin and Wang, *Structure-Preserving Algorithms for Periodic Discrete-Time Algebraic Riccati Equations*,
    International Journal of Control 77, 2004, for the doubling.

    Examples
    --------
    A random walk of unit steps, seen with unit noise, has the golden ratio as its covariance:

    >>> one = np.ones((1, 1))
    >>> float(steady_predictor(one, one, one, np.ones(1)).error[0, 0].round(12))
    1.61803398875
    """
    identity = np.eye(len(transition))
    late, information, error = transition.T, (measured.T / sensor) @ measured, process
    for _ in range(_DOUBLINGS):
        growing = identity + information @ error
        if not np.isfinite(growing).all():
            raise _unseen()
        try:
            inverse = np.linalg.inv(growing)
        except np.linalg.LinAlgError:
            raise _unseen() from None
        grown = late.T @ error @ inverse @ late
        information = information + late @ inverse @ information @ late.T
        information = 0.5 * (information + information.T)
        error = error + 0.5 * (grown + grown.T)
        late = late @ inverse @ late
        if not np.isfinite(error).all() or np.abs(grown).max() <= _AT_REST * np.abs(error).max():
            break
    if not np.isfinite(error).all():
        raise _unseen()
    innovation = measured @ error @ measured.T + np.diag(sensor)
    gain = np.asarray(np.linalg.solve(innovation, measured @ error @ transition.T).T, dtype=np.float64)
    closed = transition - gain @ measured
    if np.abs(np.linalg.eigvals(closed)).max(initial=0.0) >= 1.0:
        raise _unseen()
    return Predictor(gain=gain, closed=closed, error=error, innovation=innovation)


def _unseen() -> ModelError:
    return ModelError(
        "this model has no stable predictor",
        needed="every undamped motion measured by an output and excited by a disturbance",
        remedy="add a disturbance to its equation, or measure it",
    )


def gain_slopes(
    steady: Predictor,
    transition: FloatArray,
    measured: FloatArray,
    *,
    dtransition: FloatArray,
    dmeasured: FloatArray,
    dprocess: FloatArray,
    dsensor: FloatArray,
) -> FloatArray:
    """Exact derivatives of the gain along ``p`` directions, shape ``(p, x, y)``.

    Parameters
    ----------
    steady
        The predictor there.
    transition, measured
        As in :func:`steady_predictor`.
    dtransition, dmeasured, dprocess, dsensor
        Derivatives of its four arguments with a leading axis ``p``.
    """
    K, P, closed = steady.gain, steady.error, steady.closed
    half = (dtransition - K @ dmeasured) @ P @ closed.T
    moved = half + half.swapaxes(1, 2) + dprocess + (K * dsensor[:, None, :]) @ K.T
    dP = lyapunov(closed, moved)
    dcross = dtransition @ P @ measured.T + transition @ dP @ measured.T + transition @ P @ dmeasured.swapaxes(1, 2)
    innovation_slope = dmeasured @ P @ measured.T
    dS = (
        innovation_slope
        + innovation_slope.swapaxes(1, 2)
        + measured @ dP @ measured.T
        + dsensor[:, :, None] * np.eye(len(measured))
    )
    slopes = np.linalg.solve(steady.innovation, (dcross - K @ dS).swapaxes(1, 2)).swapaxes(1, 2)
    return np.asarray(slopes, dtype=np.float64)


def lyapunov(closed: FloatArray, forcing: FloatArray) -> FloatArray:
    r"""Solve :math:`X = A X A^T + W` for many symmetric W at once, by doubling.

    Parameters
    ----------
    closed
        A, shape ``(x, x)``, all eigenvalues inside the unit circle.
    forcing
        W, shape ``(p, x, x)``.
    """
    total, power = forcing, closed
    for _ in range(_DOUBLINGS):
        total = total + power @ total @ power.T
        power = power @ power
        if np.abs(power).max(initial=0.0) < _DEAD:
            break
    return total
