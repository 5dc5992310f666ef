r"""A structure fitted to measured frequency responses: CIFER's cost, as residuals with an exact Jacobian.

.. math:: J = \frac{20}{n_\omega} \sum W \left[ (\Delta |T|_{dB})^2 + 0.01745 \, (\Delta \angle T_{deg})^2 \right]

Up to 100 is acceptable, up to 50 practically indistinguishable from the flight (Tischler and Remple, *Aircraft and
Rotorcraft System Identification*, chapter 11).

Residuals are the logarithmic errors of a model at measured points, for many parameter vectors in one sweep. A parameter
stands in few entries of the matrices. With :math:`A = j\omega M - F`, :math:`X = A^{-1} G` and
:math:`L = (H_0 + j\omega H_1) A^{-1}`, one entry of a matrix changes the response by an outer product, for instance
:math:`F_{ij}` by :math:`L_{yi} X_{ju}`. At the points alone, and entry by entry, this costs a few products per point
and parameter.

The data state their errors, which have a covariance in the residuals. Points of one response share data with their
neighbors, one gust moves several outputs at once, and one instrument may move several inputs. Of two outputs a and b,
inputs u and v, and frequencies i and j

.. math:: E[\delta H_{au}(\omega_i) \, \delta H_{bv}^*(\omega_j)]
          = \rho_{ui,vj} \, [K_i K_j^H]_{ab} \, \sigma_{au,i} \sigma_{bv,j}

with the correlation :math:`\rho`, which windows and instruments make and all outputs share, and :math:`K_i K_i^H`, that
between outputs, which the disturbance makes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from rotorid.data.base import read_only
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import trusted
from rotorid.errors import UsageError, unknown_name
from rotorid.fitting.frequency.error_shapes import response_error_shapes
from rotorid.fitting.frequency.parameter_map import Matrices, ParameterMap, Slopes
from rotorid.fitting.problem import ErrorShapes, Problem, ResidualErrors
from rotorid.models.structure import LinearStructure
from rotorid.signal.stamps import CLOCK_SAMPLES
from rotorid.spectral.composite import level_about, output_correlation
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray

PHASE_WEIGHT = 0.01745
"""Weight of a squared degree relative to a squared decibel, in CIFER's cost."""

DB_PER_NEPER = 20.0 / np.log(10.0)
DEG_PER_RAD = 180.0 / np.pi
_COST_SCALE = 20.0
_ERROR_FLOOR = 0.02
_SMALLEST_RATIO = 1e-4


def coherence_weight(coherence: FloatArray) -> FloatArray:
    r"""Weight of a point, :math:`W_\gamma = [1.58 (1 - e^{-\gamma^2})]^2`.

    Examples
    --------
    >>> coherence_weight(np.array([0.6, 1.0])).round(2)
    array([0.51, 1.  ])
    """
    return np.asarray((1.58 * (1.0 - np.exp(-coherence))) ** 2)


def point_weights(data: FrequencyResponse, used: BoolArray) -> FloatArray:
    r"""Weights of all points, shape ``(y, u, f)``; zero where a point is not used.

    Direct estimates are weighted by coherence, as CIFER does. Joint estimates are weighted by the variance of the
    instrument-variable estimate, :math:`1/(\varepsilon^2 + \varepsilon_0^2)`, because their coherence does not show how
    good a point is; the weights are scaled to the same sum, so that costs stay comparable. The floor
    :math:`\varepsilon_0 = 2\,\%` stands for what random errors leave out: leakage, calibration, the model itself.
    """
    weights = np.where(used, coherence_weight(data.coherence), 0.0)
    if data.estimate == "direct":
        return weights
    precise = np.where(used, 1.0 / (data.random_error**2 + _ERROR_FLOOR**2), 0.0)
    total = precise.sum(axis=-1, keepdims=True)
    share = weights.sum(axis=-1, keepdims=True) / np.where(total > 0.0, total, 1.0)
    return np.asarray(precise * share)


def residual_scales(weights: FloatArray, phase_weight: float = PHASE_WEIGHT) -> tuple[FloatArray, FloatArray]:
    """Factors of magnitude (neper) and phase (radian) errors whose squares sum to the cost, each ``(y, u, f)``."""
    points = np.count_nonzero(weights, axis=-1, keepdims=True)
    root = np.sqrt(_COST_SCALE * weights / np.maximum(points, 1))
    return root * DB_PER_NEPER, root * np.sqrt(phase_weight) * DEG_PER_RAD


def expansion_point(model: ComplexArray, data: ComplexArray) -> ComplexArray:
    """The model, or 1e-4 of the data where the model is smaller than that.

    The logarithm of the model is taken there, and continued as a straight line. It is the model itself wherever a
    model means anything (80 dB); below, the slope leads from a response of zero toward the data, where the logarithm
    has none.
    """
    return _expansion_point(model, data, _SMALLEST_RATIO * np.abs(data))


def _expansion_point(model: ComplexArray, data: ComplexArray, floor: FloatArray) -> ComplexArray:
    small = np.abs(model) < floor
    return np.where(small, _SMALLEST_RATIO * data, model) if small.any() else model


def log_error(model: ComplexArray, data: ComplexArray) -> ComplexArray:
    """Model over data as a complex logarithm: magnitude error in neper and phase error in radians, wrapped to ±π.

    A model below 1e-4 of the data has a finite error too, about 10 neper: :func:`expansion_point` says how.

    Examples
    --------
    >>> log_error(np.array([1j, 0.0]), np.array([1.0, 1.0])).round(2)
    array([  0.  +1.57j, -10.21+0.j  ])
    """
    return log_error_from(model, expansion_point(model, data), data)


def log_error_from(model: ComplexArray, point: ComplexArray, data: ComplexArray) -> ComplexArray:
    """The same, where the point of expansion is known."""
    error = np.log(point / data)
    return np.asarray(error if point is model else error + (model - point) / point)


def pair_costs(model: ComplexArray, data: ComplexArray, weights: FloatArray) -> FloatArray:
    """Cost of each response, shape ``(y, u)``; zero where no point is used."""
    magnitude, phase = residual_scales(weights)
    used = weights > 0.0
    error = np.zeros(used.shape, dtype=np.complex128)
    # Where no point is used, model and data may both be zero.
    error[used] = log_error(*(np.broadcast_to(values, used.shape)[used] for values in (model, data)))
    return np.asarray(np.sum((magnitude * error.real) ** 2 + (phase * error.imag) ** 2, axis=-1))


def random_costs(random_error: FloatArray, weights: FloatArray) -> FloatArray:
    """Cost of each response that random errors alone would make, shape ``(y, u)``: as large in magnitude as in phase.

    Examples
    --------
    Ten percent of a response that is weighted fully:

    >>> random_costs(np.full((1, 1, 50), 0.1), np.ones((1, 1, 50))).round().tolist()
    [[27.0]]
    """
    magnitude, phase = residual_scales(weights)
    error = np.where(weights > 0.0, random_error, 0.0)
    return np.asarray(np.sum((magnitude**2 + phase**2) * error**2, axis=-1))


@dataclass(frozen=True, eq=False)
class Points:
    """Measured points: frequencies of all, shape ``(f,)``, and for each point its indices and value, shape ``(n,)``.

    ``outputs`` and ``inputs`` count all channels, also those without a point.
    """

    omega_rad_s: FloatArray
    output: IntArray
    input: IntArray
    frequency: IntArray
    values: ComplexArray
    outputs: int
    inputs: int

    @classmethod
    def of(cls, omega_rad_s: FloatArray, values: ComplexArray, used: BoolArray) -> Points:
        """The used points of measured responses, in the order of ``values[used]``."""
        columns = used.any(axis=(0, 1))
        output, source, frequency = np.nonzero(used[:, :, columns])
        return cls(omega_rad_s[columns], output, source, frequency, values[used], *used.shape[:2])

    @cached_property
    def s(self) -> ComplexArray:
        r""":math:`j\omega` of all frequencies, shape ``(f, 1, 1)``."""
        return np.asarray(1j * self.omega_rad_s[:, None, None])

    @cached_property
    def point_s(self) -> ComplexArray:
        r""":math:`j\omega` of the points, shape ``(n,)``."""
        return np.asarray(1j * self.omega_rad_s[self.frequency])

    @cached_property
    def floor(self) -> FloatArray:
        """Below this size of the model its logarithm goes on as a straight line, shape ``(n,)``."""
        return np.asarray(_SMALLEST_RATIO * np.abs(self.values))

    @cached_property
    def of_response(self) -> IntArray:
        """Places of the points in all responses, whose axes are frequency, output and input, shape ``(n,)``."""
        return np.asarray((self.frequency * self.outputs + self.output) * self.inputs + self.input)

    @cached_property
    def of_left(self) -> IntArray:
        """Places of the points in values of all frequencies and outputs, shape ``(n,)``."""
        return np.asarray(self.frequency * self.outputs + self.output)

    @cached_property
    def of_right(self) -> IntArray:
        """Places of the points in values of all frequencies and inputs, shape ``(n,)``."""
        return np.asarray(self.frequency * self.inputs + self.input)

    @cached_property
    def of_output(self) -> tuple[ComplexArray, ...]:
        """For each output, one at its points and zero at the others, shape ``(n,)``."""
        return _one_hot(self.output, self.outputs)

    @cached_property
    def of_input(self) -> tuple[ComplexArray, ...]:
        """For each input, one at its points and zero at the others, shape ``(n,)``."""
        return _one_hot(self.input, self.inputs)


def _one_hot(channel: IntArray, count: int) -> tuple[ComplexArray, ...]:
    # Complex, as what they multiply: a cast at every product is a whole sweep over the points.
    return tuple(np.asarray(channel == place, dtype=np.complex128) for place in range(count))


class _Response(NamedTuple):
    """Response at the points, shape ``(b, n)``, with the parts of its derivatives.

    The inverse of :math:`A` at all frequencies, ``(b, f, x, x)``, rows of :math:`L` and columns of :math:`X` at the
    points, ``(b, x, n)``, and the delays as a factor, ``(b, n)``.
    """

    values: ComplexArray
    inverse: ComplexArray
    left: ComplexArray
    right: ComplexArray
    shift: ComplexArray


@np.errstate(invalid="ignore")
def log_errors(parameter_map: ParameterMap, thetas: FloatArray, points: Points) -> tuple[ComplexArray, ComplexArray]:
    """Logarithm of model over data at the points, and its derivatives.

    Parameters
    ----------
    parameter_map
        From parameters to matrices.
    thetas
        Free parameters, shape ``(b, p)``.
    points
        Where, and what was measured there.

    Returns
    -------
    numpy.ndarray
        Errors, shape ``(b, n)``; not a number where the model has a pole on the imaginary axis at a point.
    numpy.ndarray
        Their derivatives, shape ``(b, p, n)``.
    """
    system, slopes = parameter_map.tangents(thetas)
    model = _response(system, points)
    place = _expansion_point(model.values, points.values, points.floor)
    error = log_error_from(model.values, place, points.values)
    return error, _slopes(slopes, thetas.shape[1], model, place, points)


@np.errstate(invalid="ignore")
def equation_errors(
    parameter_map: ParameterMap, thetas: FloatArray, points: Points, scales: tuple[FloatArray, FloatArray]
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    r"""Errors of the model multiplied by its denominator, relative to data and denominator, and their derivatives.

    With the denominator :math:`D = \det(j\omega M - F)`, :math:`e = (D / D_0) (T / T_{data} - 1)` is linear in the
    parameters of a transfer function, where the response :math:`T` is not; :math:`D_0` is the denominator at the
    present parameters, and stands still.

    Returns
    -------
    numpy.ndarray
        Errors, shape ``(b, n)``.
    numpy.ndarray
        Their derivatives, shape ``(b, p, n)``.
    numpy.ndarray
        The cost, as that of :func:`sums_of_squares`, shape ``(b,)``.
    """
    system, slopes = parameter_map.tangents(thetas)
    model = _response(system, points)
    error = model.values / points.values - 1.0
    responses = _slopes(slopes, thetas.shape[1], model, np.broadcast_to(points.values, error.shape), points)
    determinants = _determinant_slopes(slopes, thetas.shape[1], model.inverse, points)
    return error, responses + determinants * error[:, None], _sum_of_squares(model.values, points, scales)


@np.errstate(invalid="ignore")
def sums_of_squares(
    parameter_map: ParameterMap, thetas: FloatArray, points: Points, scales: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Cost of each of many parameter vectors, shape ``(b,)``; infinite where the model has no response."""
    return _sum_of_squares(_response(parameter_map.tangents(thetas)[0], points).values, points, scales)


def _sum_of_squares(model: ComplexArray, points: Points, scales: tuple[FloatArray, FloatArray]) -> FloatArray:
    error = log_error(model, points.values)
    squares = np.sum((scales[0] * error.real) ** 2 + (scales[1] * error.imag) ** 2, axis=-1)
    return np.where(np.isfinite(squares), squares, np.inf)


def _response(system: Matrices, points: Points) -> _Response:
    jw = points.s
    inverse = _inverse(np.asarray(jw * system.M[:, None] - system.F[:, None], dtype=np.complex128))
    X = inverse @ system.G[:, None]
    H = system.H0[:, None] + jw * system.H1[:, None]
    L = H @ inverse
    rational = (H @ X).reshape(len(X), -1).take(points.of_response, axis=1)
    delays = system.output_delays_s[:, points.output] + system.input_delays_s[:, points.input]
    shift = np.exp(-points.point_s * delays)
    return _Response(
        values=rational * shift,
        inverse=inverse,
        left=_at_points(L.transpose(0, 3, 1, 2), points.of_left),
        right=_at_points(X.transpose(0, 2, 1, 3), points.of_right),
        shift=shift,
    )


def _at_points(values: ComplexArray, places: IntArray) -> ComplexArray:
    """Values ``(b, x, f, channels)`` at places in the last two axes as one, shape ``(b, x, n)``."""
    return values.reshape(*values.shape[:2], -1).take(places, axis=2)


def _inverse(matrices: ComplexArray) -> ComplexArray:
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        # One of them is singular to rounding, and the call does not say which.
        flat = matrices.reshape(-1, *matrices.shape[-2:])
        regular = np.linalg.cond(flat) < 0.01 / np.finfo(np.float64).eps
        inverse = np.full_like(flat, np.nan)
        inverse[regular] = np.linalg.inv(flat[regular])
        return inverse.reshape(matrices.shape)


def _slopes(slopes: Slopes, size: int, model: _Response, place: ComplexArray, points: Points) -> ComplexArray:
    """Derivatives of the logarithm along ``size`` parameters, shape ``(b, size, n)``."""
    relative = model.shift / place
    left, right = model.left, model.right * relative[:, None]
    jw = points.point_s
    total = np.zeros((len(place), size, place.shape[1]), dtype=np.complex128)
    M, F, G, H0, H1, input_delays, output_delays = slopes
    for k, i, j, factor in F:
        total[:, k] += _times(left[:, i] * right[:, j], factor)
    for k, i, j, factor in M:
        total[:, k] -= _times(jw * left[:, i] * right[:, j], factor)
    for k, i, j, factor in G:
        total[:, k] += _times(left[:, i] * relative * points.of_input[j], factor)
    for k, i, j, factor in H0:
        total[:, k] += _times(right[:, j] * points.of_output[i], factor)
    for k, i, j, factor in H1:
        total[:, k] += _times(jw * right[:, j] * points.of_output[i], factor)
    for k, j, _, factor in input_delays:
        total[:, k] -= _times(jw * model.values / place * points.of_input[j], factor)
    for k, i, _, factor in output_delays:
        total[:, k] -= _times(jw * model.values / place * points.of_output[i], factor)
    return total


def _times(values: ComplexArray, factor: float | FloatArray) -> ComplexArray:
    # Most parameters stand alone in their entry, and a product by one is a whole sweep over the points.
    return values if isinstance(factor, float) and factor == 1.0 else values * factor


def _determinant_slopes(slopes: Slopes, size: int, inverse: ComplexArray, points: Points) -> ComplexArray:
    r"""Derivatives of :math:`\log\det A`, :math:`\mathrm{tr}(A^{-1} \dot A)`, at the points, ``(b, size, n)``."""
    jw = points.s[:, 0, 0]
    total = np.zeros((len(inverse), size, jw.size), dtype=np.complex128)
    for k, i, j, factor in slopes[0]:
        total[:, k] += factor * jw * inverse[:, :, j, i]
    for k, i, j, factor in slopes[1]:
        total[:, k] -= factor * inverse[:, :, j, i]
    return np.asarray(total[:, :, points.frequency])


_ROUNDING = 1e-9


def pair_names(data: FrequencyResponse) -> tuple[str, ...]:
    """Names of all responses, ``output/input``, in the order of their values."""
    return tuple(f"{output}/{source}" for output in data.outputs for source in data.inputs)


def pair_index(data: FrequencyResponse, name: str) -> tuple[int, int]:
    """Indices of a response ``output/input``.

    Raises
    ------
    UsageError
        There is none of that name; the nearest one is suggested.
    """
    names = pair_names(data)
    if name not in names:
        raise unknown_name("response", name, names)
    y, u = divmod(names.index(name), len(data.inputs))
    return y, u


def only_pairs(used: BoolArray, data: FrequencyResponse, names: Iterable[str]) -> BoolArray:
    """Points of the named responses alone, shape ``(y, u, f)``.

    Parameters
    ----------
    used
        Points that could be used, shape ``(y, u, f)``.
    names
        Responses to keep, for instance ``["q/pitch_command", "ax/pitch_command"]``.

    Raises
    ------
    UsageError
        A name is unknown.
    """
    kept = np.zeros(used.shape, dtype=np.bool_)
    for name in names:
        pair = pair_index(data, name)
        kept[pair] = used[pair]
    return kept


def within_bands(used: BoolArray, data: FrequencyResponse, bands: Mapping[str, tuple[float, float]]) -> BoolArray:
    """Points inside the band of each named response, and all points of the others, shape ``(y, u, f)``.

    Parameters
    ----------
    used
        Points that could be used, shape ``(y, u, f)``.
    bands
        Lowest and highest frequency of a response, rad/s.

    Raises
    ------
    UsageError
        A name is unknown, or a band is empty.
    """
    kept = used.copy()
    for name, (low, high) in bands.items():
        pair = pair_index(data, name)
        if not 0.0 <= low < high:
            raise UsageError(f"the band {low:g} to {high:g} rad/s of {name} is empty", needed="0 <= low < high")
        omega = data.omega_rad_s
        kept[pair] &= (omega >= low * (1.0 - _ROUNDING)) & (omega <= high * (1.0 + _ROUNDING))
    return kept


_JITTER = 1e-9
"""Outputs that are integrals of others have errors equal to the last digit; a factor needs some distance."""


def residual_errors(
    data: FrequencyResponse,
    used: BoolArray,
    scales: tuple[FloatArray, FloatArray],
    *,
    model: ComplexArray | None = None,
) -> ResidualErrors:
    """Covariance of the residuals of a fit.

    Parameters
    ----------
    used
        Points that count, shape ``(y, u, f)``.
    scales
        Factors of magnitude and phase errors in the residuals of these points, each shape ``(n,)``.
    model
        The response about which errors are wanted, shape ``(y, u, f)``: that of a fit knows better than single points
        what is response and what disturbance. None for the measured one itself.
    """
    if model is not None:
        data = _about(data, used, model)
    relative = _relative_covariance(data, *np.nonzero(used))
    return ResidualErrors(relative=relative, scale=np.concatenate(scales))


def _about(data: FrequencyResponse, used: BoolArray, model: ComplexArray) -> FrequencyResponse:
    """The data with the errors that they have about a model: relative to it, and of what it leaves of the outputs."""
    factor = np.where(used, data.values / np.where(used, model, 1.0), 1.0)
    if data.disturbance is None:
        return replace(data, covariance=data.covariance * factor[..., :, None] * factor.conj()[..., None, :])
    difference = np.where(used, data.values - model, 0.0)
    correlation = output_correlation(data.disturbance, data.omega_rad_s, difference)
    factor = factor * level_about(data.disturbance, difference)
    return replace(
        data,
        covariance=data.covariance * factor[..., :, None] * factor.conj()[..., None, :],
        output_correlation=np.stack([correlation] * len(data.inputs)),
    )


def _relative_covariance(data: FrequencyResponse, output: IntArray, source: IntArray, point: IntArray) -> ComplexArray:
    """Relative covariance of points of several responses, shape ``(n, n)``."""
    values = data.values[output, source, point]
    level = np.sqrt(np.einsum("yuff->yuf", data.covariance).real)[output, source, point] / np.abs(values)
    phase = values / np.abs(values)
    # In place: a fit makes ten of these, of a million numbers each.
    together = _between_points(data, output, source, point)
    together *= _between_outputs(data, output, source, point)
    together *= level[:, None]
    together *= level
    together /= phase[:, None] * phase.conj()
    return together


def _between_points(data: FrequencyResponse, output: IntArray, source: IntArray, point: IntArray) -> ComplexArray:
    """Correlation of errors between frequencies and inputs, for a disturbance that all outputs share."""
    alike = source[:, None] == source
    if data.input_correlation is not None:
        return np.asarray(data.input_correlation[source[:, None], source, point[:, None], point])
    level = np.sqrt(np.einsum("yuff->yuf", data.covariance).real)
    each = data.covariance / (level[..., :, None] * level[..., None, :])
    if data.output_correlation is None:
        own = each[output[:, None], source[:, None], point[:, None], point]
        return np.asarray(np.where(alike, own, 0.0))
    return np.asarray(np.where(alike, each.mean(axis=0)[source[:, None], point[:, None], point], 0.0))


def _between_outputs(data: FrequencyResponse, output: IntArray, source: IntArray, point: IntArray) -> ComplexArray:
    """Correlation of errors between outputs."""
    if data.output_correlation is None:
        return np.asarray(output[:, None] == output, dtype=np.complex128)
    between = np.moveaxis(data.output_correlation, -1, 1)
    factor = np.linalg.cholesky(between + _JITTER * np.eye(between.shape[-1]))[source, point, output]
    return np.asarray(factor @ factor.conj().T)


_PLACE = "z_imu"
"""Parameter that follows where an accelerometer lies."""

ACCELEROMETER_PLACE_M = 0.01
"""Standard deviation of an accelerometer's distance from the center of gravity where nobody measured it: the board of
an autopilot is mounted by eye. What turns the vehicle moves such an accelerometer, as a force would."""

_LONGEST_DIP = 3
_FEWEST_POINTS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyProblem(Problem):
    """Fit a linear structure to frequency responses in CIFER's cost.

    Weights change what is minimized, and never what is reported: :meth:`costs` are CIFER's own numbers, comparable
    between problems, while :meth:`residuals` and the cost of a solution carry the weights.

    Parameters
    ----------
    structure
        Its inputs and outputs name the responses, in this order.
    parameters, region
        As in :class:`rotorid.fitting.problem.Problem`.
    data
        Measured responses of exactly these inputs and outputs.
    used
        Points that count, shape ``(y, u, f)``.
    pair_weights
        Factors on the costs of single responses ``output/input``; one where nothing is said.
    phase_weight
        Weight of a squared degree against a squared decibel; CIFER's 0.01745 makes 7.57° one decibel.
    """

    method: ClassVar[str] = "frequency"
    kept: ClassVar[tuple[str, ...]] = ("weights", "scales", "points", "point_scales", "errors")

    structure: LinearStructure
    data: FrequencyResponse
    used: BoolArray
    pair_weights: Mapping[str, float] = field(default_factory=dict)
    phase_weight: float = PHASE_WEIGHT

    def __post_init__(self) -> None:
        if self.data.inputs != self.structure.inputs or self.data.outputs != self.structure.outputs:
            raise UsageError(
                f"the data are responses of {', '.join(self.data.outputs)} to {', '.join(self.data.inputs)}",
                needed=f"{', '.join(self.structure.outputs)} to {', '.join(self.structure.inputs)}",
            )
        used = read_only(self.used, np.bool_, ndim=3)
        if used.shape != self.data.values.shape:
            raise UsageError(
                f"a selection of shape {used.shape} does not fit the data", needed=f"shape {self.data.values.shape}"
            )
        for name, weight in self.pair_weights.items():
            pair_index(self.data, name)
            if not 0.0 < weight < np.inf:
                raise UsageError(
                    f"the weight {weight:g} of {name} is not a positive number",
                    remedy="leave the response out of the counted points instead",
                )
        if not 0.0 <= self.phase_weight < np.inf:
            raise UsageError(f"the phase weight {self.phase_weight:g} is not zero or positive")
        self._set(used=used, pair_weights=self.pair_weights)

    @property
    def name(self) -> str:
        """Name of the structure."""
        return self.structure.name

    @cached_property
    def weights(self) -> FloatArray:
        """CIFER's weights of the points, shape ``(y, u, f)``."""
        return point_weights(self.data, self.used)

    @cached_property
    def scales(self) -> tuple[FloatArray, FloatArray]:
        """Factors of magnitude (neper) and phase (radian) errors in the residuals, each ``(y, u, f)``."""
        factors = np.ones(self.used.shape[:2])
        for name, weight in self.pair_weights.items():
            factors[pair_index(self.data, name)] = np.sqrt(weight)
        magnitude, phase = residual_scales(self.weights, self.phase_weight)
        return factors[..., None] * magnitude, factors[..., None] * phase

    @cached_property
    def parameter_map(self) -> ParameterMap:
        """From the free parameters to the matrices."""
        return ParameterMap(self.structure, self.parameters)

    @cached_property
    def points(self) -> Points:
        """The points that count, in the order of the residuals."""
        return Points.of(self.data.omega_rad_s, self.data.values, self.used)

    @cached_property
    def point_scales(self) -> tuple[FloatArray, FloatArray]:
        """The scales at these points, each shape ``(n,)``."""
        magnitude, phase = self.scales
        return magnitude[self.used], phase[self.used]

    @cached_property
    def errors(self) -> ResidualErrors:
        """Covariance of the residuals from the errors of the data."""
        return residual_errors(self.data, self.used, self.point_scales)

    def errors_about(self, theta: FloatArray) -> ResidualErrors:
        """Covariance of the residuals from the errors of the data, about the model at ``theta``."""
        model = self.structure.response(self.parameters.unpack(theta).values, self.data.omega_rad_s)
        return residual_errors(self.data, self.used, self.point_scales, model=model)

    @property
    def freedom(self) -> FloatArray:
        """Degrees of freedom with which the size of the disturbance is known at each point, shape ``(n,)``."""
        if self.data.disturbance is None:
            return np.full(self.points.frequency.size, np.inf)
        return self.data.disturbance.freedom[np.nonzero(self.used)[2]]

    def stated_errors(self, theta: FloatArray, *, weights: Literal["cifer", "covariance"] = "cifer") -> ResidualErrors:
        """The errors that the responses state; with weights of the covariance, those about the model at ``theta``."""
        return self.errors if weights == "cifer" else self.errors_about(theta)

    def error_shapes(self, theta: FloatArray) -> ErrorShapes:
        """A smooth error of each response, clocks, and an accelerometer that the model has at the center of gravity."""
        points, changes, left = self.points, self.data.slope_changes, self.data.sensor_shapes
        tilt, unchecked = self.data.lean_errors, self.data.unchecked_errors
        shapes = response_error_shapes(
            points.omega_rad_s[points.frequency],
            points.output,
            points.input,
            np.concatenate(self.point_scales),
            outputs=self.data.outputs,
            inputs=self.data.inputs,
            clock_error_s=_clock_error_s(self.data),
            sensor_errors=self.data.sensor_errors,
            slope_changes=None if changes is None else changes[points.input, points.frequency],
            lean_errors=None if tilt is None else tilt[points.input, points.frequency],
            unchecked_errors=None if unchecked is None else unchecked[:, points.input, points.frequency],
            sensor_shapes=None if left is None else left[:, points.output, points.input, points.frequency],
        )
        if self.structure.constants.get(_PLACE) != 0.0:
            return shapes
        known = np.concatenate([shapes.known, self._displaced(theta)[:, None]], axis=1)
        return replace(shapes, known=known, largest=1)

    def _displaced(self, theta: FloatArray) -> FloatArray:
        """Effect of an accelerometer off the center of gravity on the residuals, to first order, shape ``(2 n,)``.

        To first order, because the derivatives by which the fit follows it are: the logarithm of what a centimeter adds
        to a small force is none of their combinations, and would be laid on parameters that have no part in it.
        """
        values, omega = self.parameters.unpack(theta).values, self.points.omega_rad_s
        moved = self.structure.with_constants({_PLACE: ACCELEROMETER_PLACE_M})
        index = (self.points.output, self.points.input, self.points.frequency)
        there, here = (structure.response(values, omega)[index] for structure in (moved, self.structure))
        return _weighted(np.divide(there - here, here, out=np.zeros_like(here), where=here != 0.0), *self.point_scales)

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals whose squares sum to the weighted cost, shape ``(2 n,)``, and their Jacobian ``(2 n, p)``.

        Magnitudes come first, then phases. They are finite also where a response of the model is zero, see
        :func:`rotorid.fitting.frequency.problem.log_error`, and not a number where it has a pole at a point.
        """
        residual, jacobian = self.many_residuals(np.asarray(theta)[None])
        return residual[0], jacobian[0].T

    def many_residuals(self, thetas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals of many parameter vectors ``(b, p)``, shape ``(b, 2 n)``, and derivatives ``(b, p, 2 n)``."""
        error, slope = log_errors(self.parameter_map, thetas, self.points)
        magnitude, phase = self.point_scales
        return _weighted(error, magnitude, phase), _weighted(slope, magnitude, phase)

    def many_costs(self, thetas: FloatArray) -> FloatArray:
        """Sum of the squared residuals for many parameter vectors ``(b, p)``, shape ``(b,)``; infinite at a pole."""
        return sums_of_squares(self.parameter_map, thetas, self.points, self.point_scales)

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """Squared error of magnitude and phase at every point, weighted as in the cost, ``(b, p)`` to ``(b, n)``."""
        residual = self.many_residuals(thetas)[0]
        magnitude, phase = np.split(residual, 2, axis=-1)
        squares = magnitude**2 + phase**2
        return np.where(np.isfinite(squares), squares, np.inf)

    def point_weights(self, points: FloatArray) -> FloatArray:
        """Weights of points ``(n,)`` as those of magnitudes and phases, ``(2 n,)``."""
        return np.tile(points, 2)

    def costs(self, theta: FloatArray) -> FloatArray:
        """Cost of each response without weights of pairs, shape ``(y, u)``."""
        model = self.structure.response(self.parameters.unpack(theta).values, self.data.omega_rad_s)
        return pair_costs(model, self.data.values, self.weights)


def _clock_error_s(data: FrequencyResponse) -> float | None:
    """What stamps show, or the usual share of a sample."""
    if data.clock_error_s is not None or data.sample_rate_hz is None:
        return data.clock_error_s
    return CLOCK_SAMPLES / data.sample_rate_hz


def _weighted(values: ComplexArray, magnitude: FloatArray, phase: FloatArray) -> FloatArray:
    """Real and imaginary parts of ``(..., n)`` with their weights, one after the other, shape ``(..., 2 n)``."""
    parts = np.empty((*values.shape[:-1], 2 * values.shape[-1]))
    np.multiply(values.real, magnitude, out=parts[..., : magnitude.size])
    np.multiply(values.imag, phase, out=parts[..., magnitude.size :])
    return parts


def usable_points(
    data: FrequencyResponse, *, coherence: float, band_rad_s: tuple[float, float] | None = None
) -> BoolArray:
    """Points of a response that can be trusted, shape ``(y, u, f)``.

    A point counts where the coherence reaches the limit, and the random error no more than
    :data:`rotorid.data.trust.LARGEST_RANDOM_ERROR`; of these the longest stretch is taken, across dips of up to three
    points, and within the band that was asked for.
    """
    good = trusted(data.random_error, data.coherence, coherence)
    if band_rad_s is not None:
        low, high = band_rad_s
        good &= (data.omega_rad_s >= low * (1 - 1e-9)) & (data.omega_rad_s <= high * (1 + 1e-9))
    return np.apply_along_axis(_longest_stretch, -1, good)


def _longest_stretch(good: BoolArray) -> BoolArray:
    index = np.flatnonzero(good)
    if index.size == 0:
        return good
    runs = np.split(index, np.flatnonzero(np.diff(index) > _LONGEST_DIP + 1) + 1)
    longest = max(runs, key=len)
    kept = np.zeros_like(good)
    # A point or two among many are coherent by chance.
    kept[longest] = longest.size >= min(_FEWEST_POINTS, good.size)
    return kept
