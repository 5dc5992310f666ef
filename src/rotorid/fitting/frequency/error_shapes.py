r"""Shapes of systematic errors of frequency responses: smooth model errors, clocks, sensors, thrust and tilt.

Each shape is a column in the residuals, with a size of its own.

- *Model error*. A structure that leaves something out errs alike at neighboring frequencies: in magnitude and in phase
  a Gaussian process over :math:`\ln \omega` with the kernel :math:`\exp(-\frac12 (\Delta \ln\omega / 0.7)^2)`, one
  octave. The residuals of a fit show how large it is (:mod:`rotorid.uncertainty.model_error`).
- *Clocks*. Hardly a log says where within a sample a value belongs: every input and every output may be late by
  :math:`0.15 \, \Delta t`, or by what the stamps of its log show (:mod:`rotorid.signal.stamps`).
- *Scales*. No input and no output is known better than by 0.25 %, at all frequencies alike.
- *Sensors*. One that contradicts the kinematics of its log may be the wrong one of the two: its response may be off by
  all of the scale and the delay by which they differ. One that was corrected is off by what is left, with its
  covariance.
- *What a log does not show*. Errors that could not be looked at have their usual size
  (:mod:`rotorid.flights.unchecked`) and a smooth course of two octaves that nobody knows.
- *Thrust and lean*. The slope of thrust changes with its mean, for all inputs alike
  (:mod:`rotorid.flights.thrust_slope`), and derivatives of hover hold for small angles only
  (:mod:`rotorid.flights.tilt_errors`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.fitting.problem import ErrorShapes
from rotorid.typing import ComplexArray, FloatArray, IntArray

SCALE_ERROR = 0.0025
"""Standard deviation of the scale of each input and each output, which nothing in a log shows: a gain is known to no
better than 0.35 %."""

_OCTAVE = 0.7
"""Length of smooth errors over the natural logarithm of frequency: ln 2, rounded."""

_TWO_OCTAVES = 1.4
"""Length of errors by tilt, thrust and feedback over the natural logarithm of frequency."""

_KEPT = 1e-3
"""Share of the largest eigenvalue of the kernel, below which columns are left out."""

_FEWEST_POINTS = 12
"""A response of fewer points takes part in the model error of the main response to its input."""


def smooth_columns(log_omega: FloatArray, length: float = _OCTAVE) -> FloatArray:
    r"""Columns that span a smooth process of unit variance over :math:`\ln\omega`, shape ``(n, m)``.

    Eigenvectors of the kernel, each times the root of its eigenvalue, down to a thousandth of the largest.

    Parameters
    ----------
    log_omega
        Logarithms of frequencies, shape ``(n,)``.
    length
        Of the kernel.

    Examples
    --------
    >>> columns = smooth_columns(np.log(np.geomspace(1.0, 50.0, 60)))
    >>> columns.shape[1] < 12, bool(np.abs(np.sum(columns**2, axis=1) - 1.0).max() < 0.01)
    (True, True)
    """
    values, vectors = np.linalg.eigh(np.exp(-0.5 * ((log_omega[:, None] - log_omega) / length) ** 2))
    kept = values > _KEPT * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def response_error_shapes(
    omega_rad_s: FloatArray,
    output: IntArray,
    source: IntArray,
    scale: FloatArray,
    *,
    outputs: Sequence[str],
    inputs: Sequence[str],
    clock_error_s: float | None,
    sensor_errors: FloatArray | None = None,
    slope_changes: FloatArray | None = None,
    lean_errors: FloatArray | None = None,
    unchecked_errors: FloatArray | None = None,
    sensor_shapes: ComplexArray | None = None,
) -> ErrorShapes:
    """Shapes for points of frequency responses, whose residuals are magnitudes and then phases.

    Parameters
    ----------
    omega_rad_s, output, source
        Frequency and indices of output and input of each point, shape ``(n,)`` each.
    scale
        Factor from a relative error to each residual, shape ``(2 n,)``.
    clock_error_s
        Standard deviation of the delay of each channel; without it clocks count as exact.
    sensor_errors
        Relative error of the scale and delay in seconds by which each output disagrees with other sensors, ``(y, 2)``.
    slope_changes
        By how much the slope of thrust may have been another one at each point, as a logarithm, shape ``(n,)``.
    lean_errors
        Relative error that the lean of the vehicle may have made at each point, shape ``(n,)``.
    unchecked_errors
        Relative errors that nobody could look at, of the magnitudes of all responses to an input alike and of each
        response for itself, one standard deviation, shape ``(2, n)``.
    sensor_shapes
        Relative errors that corrected sensors left at each point, one standard deviation each, shape ``(k, n)``.
    """
    count = omega_rad_s.size
    magnitude, phase = scale[:count], scale[count:]
    smooth, group, names = [], [], []
    for place, (y, u, rows) in enumerate(_responses(output, source)):
        columns = smooth_columns(np.log(omega_rad_s[rows]))
        for part, offset in ((magnitude, 0), (phase, count)):
            block = np.zeros((2 * count, columns.shape[1]))
            block[rows + offset] = part[rows, None] * columns
            smooth.append(block)
            group += [place] * columns.shape[1]
        names.append(f"{outputs[y]}/{inputs[u]}")
    nothing = np.zeros(count)
    channels = [*(source == u for u in np.unique(source)), *(output == y for y in np.unique(output))]
    off = [np.concatenate([SCALE_ERROR * magnitude * channel, nothing]) for channel in channels]
    if clock_error_s is not None:
        late = phase * omega_rad_s * clock_error_s
        off += [np.concatenate([nothing, late * channel]) for channel in channels]
    known = np.stack(off, axis=1)
    if sensor_errors is not None:
        known = np.concatenate([known, _contradicted(sensor_errors, magnitude, phase * omega_rad_s, output)], axis=1)
    if slope_changes is not None:
        changed = np.concatenate([magnitude * slope_changes, np.zeros(count)])
        known = np.concatenate([known, changed[:, None]], axis=1)
    if lean_errors is not None:
        known = np.concatenate([known, _tilt_shapes(lean_errors, magnitude, phase, output, source)], axis=1)
    if unchecked_errors is not None:
        unknown = _unchecked(unchecked_errors, np.log(omega_rad_s), magnitude, phase, output, source)
        known = np.concatenate([known, unknown], axis=1)
    if sensor_shapes is not None:
        left = np.concatenate([magnitude * sensor_shapes.real, phase * sensor_shapes.imag], axis=1)
        known = np.concatenate([known, left.T], axis=1)
    shapes = ErrorShapes(names=tuple(names), smooth=np.concatenate(smooth, axis=1), group=np.array(group), known=known)
    return _shared(shapes, [(u, rows.size) for _, u, rows in _responses(output, source)])


def _tilt_shapes(
    errors: FloatArray, magnitude: FloatArray, phase: FloatArray, output: IntArray, source: IntArray
) -> FloatArray:
    """A column for the magnitude and one for the phase of each response to an input that leant the vehicle."""
    columns, nothing = [np.zeros((2 * output.size, 0))], np.zeros(output.size)
    for _, _, rows in _responses(output, source):
        own = np.zeros(output.size)
        own[rows] = errors[rows]
        if own.any():
            columns += [np.concatenate([magnitude * own, nothing])[:, None]]
            columns += [np.concatenate([nothing, phase * own])[:, None]]
    return np.concatenate(columns, axis=1)


def _unchecked(
    errors: FloatArray,
    log_omega: FloatArray,
    magnitude: FloatArray,
    phase: FloatArray,
    output: IntArray,
    source: IntArray,
) -> FloatArray:
    """Smooth columns for the magnitudes of all responses to an input, and for both parts of each response."""
    alike, own = errors
    columns = [np.zeros((2 * output.size, 0))]

    def span(rows: IntArray, size: FloatArray, part: FloatArray, offset: int) -> None:
        if size[rows].any():
            grid, place = np.unique(log_omega[rows], return_inverse=True)
            shape = smooth_columns(grid, _TWO_OCTAVES)[place]
            block = np.zeros((2 * output.size, shape.shape[1]))
            block[rows + offset] = (part * size)[rows, None] * shape
            columns.append(block)

    for u in np.unique(source):
        span(np.flatnonzero(source == u), alike, magnitude, 0)
    for _, _, rows in _responses(output, source):
        span(rows, own, magnitude, 0)
        span(rows, own, phase, output.size)
    return np.concatenate(columns, axis=1)


def _contradicted(errors: FloatArray, magnitude: FloatArray, late: FloatArray, output: IntArray) -> FloatArray:
    """A column for the scale, and one for the delay, of each output that other sensors contradict."""
    columns = [np.zeros((2 * output.size, 0))]
    for y, (scale, delay_s) in enumerate(errors):
        own, nothing = output == y, np.zeros(output.size)
        columns += [np.concatenate([scale * magnitude * own, nothing])[:, None]] if scale else []
        columns += [np.concatenate([nothing, delay_s * late * own])[:, None]] if delay_s else []
    return np.concatenate(columns, axis=1)


def _responses(output: IntArray, source: IntArray) -> list[tuple[int, int, IntArray]]:
    """Indices of output and input of every response, and its points."""
    pairs = sorted({(int(y), int(u)) for y, u in zip(output, source, strict=True)})
    return [(y, u, np.flatnonzero((output == y) & (source == u))) for y, u in pairs]


def _shared(shapes: ErrorShapes, responses: Sequence[tuple[int, int]]) -> ErrorShapes:
    """Responses of few points share the size of the longest response to their input.

    Parameters
    ----------
    shapes
        With one group for each response.
    responses
        Input and number of points of each.
    """
    longest: dict[int, int] = {}
    for place, (u, points) in enumerate(responses):
        if u not in longest or points > responses[longest[u]][1]:
            longest[u] = place
    target = [longest[u] if points < _FEWEST_POINTS else place for place, (u, points) in enumerate(responses)]
    kept = sorted(set(target))
    new = np.array([kept.index(place) for place in target])
    return replace(shapes, names=tuple(shapes.names[place] for place in kept), group=new[shapes.group])
