r"""Frequency responses made of frequency responses, with their errors: products, ratios, choices, smooth curves.

What is multiplied with a known factor :math:`T(\omega)` keeps its relative error, and its covariance is scaled exactly:

.. math:: H' = T H, \qquad E[\delta H'_i \, \delta H'^*_j] = T_i T_j^* \, E[\delta H_i \, \delta H_j^*]

Coherence is that of the measured response throughout. Every function returns a new response and writes into its
``processing`` what was done. What is read off a response between its points (a crossover, a margin) comes from a smooth
curve over the logarithm of frequency, and has its error from the same covariance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rotorid.autopilots.filters import KnownFilter, combined_response
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray

_DERIVATIVE = "_dot"
_TINY = 1e-300
_ALIKE = 0.7
r"""Width in :math:`\ln\omega` over which a model errs alike: an octave."""
_FAINTEST = 0.01
"""A filter that leaves less than this has left noise and quantization in place of the signal."""


def differentiated(response: FrequencyResponse, output: str) -> FrequencyResponse:
    r"""The response of the time derivative of an output.

    .. math:: H_{\dot y} = j \omega H_y

    Exact for motion that begins and ends at rest. The derivative of ``u`` is named ``u_dot``; that of a set-point or
    of any other channel likewise.

    Parameters
    ----------
    response
        All other outputs stay as they are.
    output
        Channel to differentiate.

    Raises
    ------
    UsageError
        There is no such output, or its derivative is an output already.

    Examples
    --------
    >>> flat = FrequencyResponse(
    ...     omega_rad_s=[2.0], values=[[[3.0]]], coherence=[[[1.0]]], random_error=[[[0.1]]],
    ...     covariance=[[[[0.18]]]], inputs=("theta",), outputs=("u",), estimate="direct",
    ... )
    >>> rate = differentiated(flat, "u")
    >>> rate.outputs, rate.values[0, 0, 0], rate.covariance[0, 0, 0, 0].real.round(6), rate.processing
    (('u_dot',), np.complex128(6j), np.float64(0.72), ('u differentiated',))
    """
    factor = _ones(response)
    factor[_row(response.outputs, output, "output")] *= 1j * response.omega_rad_s
    return _named(_scaled(response, factor, f"{output} differentiated"), {output: f"{output}{_DERIVATIVE}"})


def integrated(response: FrequencyResponse, output: str) -> FrequencyResponse:
    r"""The response of the time integral of an output.

    .. math:: H_{\int y} = H_y / (j \omega)

    Offsets of the output do not matter, drifts below the band do. The integral of ``u_dot`` is named ``u``.

    Parameters
    ----------
    response
        All other outputs stay as they are.
    output
        Channel to integrate, named as a derivative; :func:`renamed` gives another one such a name.

    Raises
    ------
    UsageError
        There is no such output, it is not named as a derivative, its integral is an output already, or the grid
        begins at zero.
    """
    row = _row(response.outputs, output, "output")
    if not output.endswith(_DERIVATIVE):
        raise UsageError(
            f"the integral of {output} has no name", needed=f"a name ending in {_DERIVATIVE}", remedy="rename it first"
        )
    if response.omega_rad_s[0] <= 0.0:
        raise UsageError("the frequency grid begins at 0 rad/s", needed="positive frequencies", remedy="select a band")
    factor = _ones(response)
    factor[row] /= 1j * response.omega_rad_s
    name = output.removesuffix(_DERIVATIVE)
    return _named(_scaled(response, factor, f"{output} integrated"), {output: name})


def corrected(response: FrequencyResponse, filters: Mapping[str, Sequence[KnownFilter]]) -> FrequencyResponse:
    r"""The response without the filters that its channels have passed.

    .. math:: H = H_{measured} \, \frac{F_{input}}{F_{output}}

    Exact for linear filters that worked at a constant rate. A filter that moves with the motors' speed, a limit of slew
    or a thrust curve is none of these. Filters on an instrument cancel out and need no correction.

    Parameters
    ----------
    response
        Direct or joint.
    filters
        Name of an input or output to the filters in front of it, as
        :func:`rotorid.signal.autopilot_filters.known_filters` gives them.

    Raises
    ------
    UsageError
        A channel is not in the response, a frequency lies beyond half of a filter's rate, or a filter has left less
        than a hundredth of the amplitude there.

    Examples
    --------
    >>> from rotorid.autopilots.filters import butterworth_low_pass
    >>> gyro = butterworth_low_pass(20.0, 1000.0)
    >>> omega_rad_s = np.array([5.0, 50.0])
    >>> filtered = FrequencyResponse(
    ...     omega_rad_s=omega_rad_s, values=gyro.response(omega_rad_s)[None, None], coherence=np.ones((1, 1, 2)),
    ...     random_error=np.zeros((1, 1, 2)), covariance=np.zeros((1, 1, 2, 2)), inputs=("roll_command",),
    ...     outputs=("p",), estimate="direct",
    ... )
    >>> np.abs(corrected(filtered, {"p": [gyro]}).values[0, 0]).round(12)
    array([1., 1.])
    """
    unknown = [name for name in filters if name not in (*response.inputs, *response.outputs)]
    if unknown:
        raise UsageError(
            f"there is no {', '.join(unknown)} in the response",
            needed=f"one of {', '.join((*response.inputs, *response.outputs))}",
        )
    factor, notes = _ones(response), []
    for name, chain in filters.items():
        if not chain:
            continue
        passed = _passed(name, chain, response)
        if name in response.inputs:
            factor[:, response.inputs.index(name)] *= passed
        if name in response.outputs:
            factor[response.outputs.index(name)] /= passed
        notes.append(f"{name} corrected for {', '.join(known.name for known in chain)}")
    return _scaled(response, factor, *notes)


def multiplied(response: FrequencyResponse, factor: ComplexArray) -> FrequencyResponse:
    """The response with each output multiplied by a factor that is known exactly, and its disturbance with it.

    Parameters
    ----------
    factor
        Shape ``(y, f)``, nowhere zero.

    Examples
    --------
    >>> ones = np.ones((1, 1, 2))
    >>> plain = FrequencyResponse(omega_rad_s=[1.0, 10.0], values=ones, coherence=ones, random_error=0.02 * ones,
    ...                           covariance=8e-4 * np.eye(2)[None, None], inputs=("roll_command",), outputs=("p",),
    ...                           estimate="direct")
    >>> twice = multiplied(plain, np.full((1, 2), 2.0))
    >>> twice.values.real.tolist(), twice.random_error.tolist()
    ([[[2.0, 2.0]]], [[[0.02, 0.02]]])
    """
    disturbance = response.disturbance
    if disturbance is not None:
        channels = np.concatenate([factor, np.ones((len(response.inputs), factor.shape[1]))])
        disturbance = replace(
            disturbance,
            densities=disturbance.densities * channels[:, None] * channels.conj(),
            level=disturbance.level * np.abs(factor) ** 2,
        )
    each = np.broadcast_to(factor[:, None], response.values.shape)
    return replace(_scaled(response, each), disturbance=disturbance)


def ratio(numerator: FrequencyResponse, denominator: FrequencyResponse) -> FrequencyResponse:
    r"""Response from one output to another, out of their responses to the same input.

    .. math:: H_{y/z} = \frac{H_{y/x}}{H_{z/x}}, \qquad
        \frac{\operatorname{Cov} H_{y/z}}{|H_{y/z}|^2} = \frac{\operatorname{Cov} H_{y/x}}{|H_{y/x}|^2}
        + \frac{\operatorname{Cov} H_{z/x}}{|H_{z/x}|^2}

    which makes :math:`x` the instrument. The errors are taken as independent of each other: true of sensor noise, not
    of a gust that moves both outputs, where they partly cancel or add up. The sum holds to first order, so that points
    where the denominator is known to worse than about 30 % are biased as well. Better, where the time histories are at
    hand: :func:`rotorid.spectral.estimate.frequency_response` with :math:`z` as input and :math:`x` as instrument,
    which sees how the errors go together.

    Parameters
    ----------
    numerator, denominator
        One output, one and the same input, the same frequencies; :func:`selected` makes them so.

    Returns
    -------
    FrequencyResponse
        With the denominator's output as input. Coherence is the smaller of the two.

    Raises
    ------
    UsageError
        The responses do not match.
    """
    _require_matching(numerator, denominator)
    over, under = numerator.values[0, 0], denominator.values[0, 0]
    values = over / under
    relative = numerator.covariance[0, 0] / np.outer(over, over.conj())
    relative = relative + denominator.covariance[0, 0] / np.outer(under, under.conj())
    output, name = numerator.outputs[0], denominator.outputs[0]
    return replace(
        numerator,
        values=values[None, None],
        coherence=np.minimum(numerator.coherence, denominator.coherence),
        random_error=np.hypot(numerator.random_error, denominator.random_error),
        covariance=(np.outer(values, values.conj()) * relative)[None, None],
        inputs=(name,),
        disturbance=None,
        estimate="joint",
        instruments=numerator.instruments or numerator.inputs,
        findings=(*numerator.findings, *denominator.findings),
        processing=(
            *numerator.processing,
            *denominator.processing,
            f"ratio {output}/{name} of two responses to {numerator.inputs[0]}, errors taken as independent",
        ),
    )


def with_model_error(response: FrequencyResponse, share: float) -> FrequencyResponse:
    r"""The response with a smooth error of the model beside the random error of the measurement.

    .. math:: E[z_i z_j^*] \mathrel{+}= 2 a^2 \exp\left(-\tfrac12 (\Delta \ln\omega / 0.7)^2\right),
        \qquad z = \delta H / H

    so that :math:`\ln |H|` and the phase each err by :math:`a` more, alike over an octave. What no average takes away
    has this shape: a slope that changes with the amplitude, with the battery or the wind, a gain that is known to half
    a percent. The random error of a sweep is often less than that.

    Parameters
    ----------
    response
        All of its pairs get the same.
    share
        Standard deviation :math:`a` of magnitude, as a share, and of phase, in radians.

    Raises
    ------
    UsageError
        The share is negative or not finite.

    Examples
    --------
    >>> sure = FrequencyResponse(
    ...     omega_rad_s=[2.0], values=[[[3.0]]], coherence=[[[1.0]]], random_error=[[[0.0]]],
    ...     covariance=[[[[0.0]]]], inputs=("roll_command",), outputs=("p",), estimate="joint",
    ... )
    >>> float(with_model_error(sure, 0.01).random_error[0, 0, 0])
    0.01
    """
    if not 0.0 <= share < math.inf:
        raise UsageError(f"got a model error of {share:g}", needed="a finite share from zero up")
    x = np.log(response.omega_rad_s)
    alike = 2.0 * share**2 * np.exp(-0.5 * ((x[:, None] - x) / _ALIKE) ** 2)
    values = response.values
    return replace(
        response,
        covariance=response.covariance + alike * values[..., :, None] * values[..., None, :].conj(),
        random_error=np.hypot(response.random_error, share),
        processing=(*response.processing, f"a smooth model error of {100.0 * share:g} % added to the random error"),
    )


def inverse(response: FrequencyResponse) -> FrequencyResponse:
    r"""The response of the input to the output.

    .. math:: H' = 1 / H, \qquad \delta H' = -\delta H / H^2

    Errors to first order. It stays the estimate that it was: noise was on the output, and is now on the input.

    Parameters
    ----------
    response
        One input, one output.

    Raises
    ------
    UsageError
        There are several, or the response is zero somewhere.
    """
    _require_single(response)
    if not np.all(response.values):
        raise UsageError("a response that is zero somewhere has no inverse", needed="a band without zeros")
    return replace(
        response,
        values=1.0 / response.values,
        covariance=_scaled_covariance(response, -1.0 / response.values**2),
        inputs=response.outputs,
        outputs=response.inputs,
        disturbance=None,
        instruments=(),
        processing=(*response.processing, f"inverse of {response.outputs[0]}/{response.inputs[0]}"),
    )


def selected(
    response: FrequencyResponse,
    *,
    outputs: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    band_rad_s: tuple[float, float] | None = None,
) -> FrequencyResponse:
    """Some pairs and a band of a response.

    Of several inputs that moved together each response stays the partial one: the others remain accounted for.

    Parameters
    ----------
    response
        Whole.
    outputs, inputs
        Channels in the order wanted; all when not given.
    band_rad_s
        First and last frequency to keep, both included; all when not given.

    Raises
    ------
    UsageError
        A channel is not there, or no frequency lies in the band.
    """
    kept_outputs = response.outputs if outputs is None else tuple(outputs)
    kept_inputs = response.inputs if inputs is None else tuple(inputs)
    low, high = band_rad_s or (0.0, np.inf)
    points = np.flatnonzero((response.omega_rad_s >= low) & (response.omega_rad_s <= high))
    if not points.size:
        raise UsageError(
            f"no frequency lies in the band {low:g}:{high:g} rad/s",
            needed=f"a band within {response.omega_rad_s[0]:g}:{response.omega_rad_s[-1]:g} rad/s",
        )
    columns = [_row(response.inputs, name, "input") for name in kept_inputs]
    rows = [_row(response.outputs, name, "output") for name in kept_outputs]
    pairs = np.ix_(rows, columns)
    errors, shapes = response.sensor_errors, response.sensor_shapes
    changes, tilt = response.slope_changes, response.lean_errors
    unchecked = response.unchecked_errors
    note = () if band_rad_s is None else (f"band {low:g}:{high:g} rad/s selected",)
    down, across = (index.ravel() for index in pairs)
    return replace(
        response,
        omega_rad_s=response.omega_rad_s[points],
        values=response.values[pairs][..., points],
        coherence=response.coherence[pairs][..., points],
        random_error=response.random_error[pairs][..., points],
        covariance=response.covariance[pairs][..., points[:, None], points],
        inputs=kept_inputs,
        outputs=kept_outputs,
        instruments=tuple(response.instruments[column] for column in columns) if response.instruments else (),
        processing=(*response.processing, *note),
        output_correlation=_at(response.output_correlation, across, down, down, points),
        input_correlation=_at(response.input_correlation, across, across, points, points),
        sensor_errors=None if errors is None else errors[rows],
        slope_changes=None if changes is None else changes[columns][:, points],
        lean_errors=None if tilt is None else tilt[columns][:, points],
        unchecked_errors=None if unchecked is None else unchecked[:, columns][..., points],
        sensor_shapes=None if shapes is None else shapes[:, rows][:, :, columns][..., points],
        disturbance=None,
    )


def _at(correlation: ComplexArray | None, *indices: IntArray) -> ComplexArray | None:
    return None if correlation is None else np.asarray(correlation[np.ix_(*indices)])


def renamed(response: FrequencyResponse, names: Mapping[str, str]) -> FrequencyResponse:
    """The same response under other channel names.

    Parameters
    ----------
    response
        Its findings keep the names under which they were made.
    names
        Old to new, of inputs and outputs.

    Raises
    ------
    UsageError
        A channel is not there, or two would have one name.
    """
    for name in names:
        _row((*response.inputs, *response.outputs), name, "channel")
    notes = tuple(f"{old} renamed {new}" for old, new in names.items())
    return replace(_named(response, names), processing=(*response.processing, *notes))


def _named(response: FrequencyResponse, names: Mapping[str, str]) -> FrequencyResponse:
    inputs, outputs = (tuple(names.get(n, n) for n in group) for group in (response.inputs, response.outputs))
    for group in (inputs, outputs):
        if len(set(group)) < len(group):
            raise UsageError(f"two channels would be named alike among {', '.join(group)}", needed="one name for each")
    return replace(response, inputs=inputs, outputs=outputs)


def _passed(name: str, chain: Sequence[KnownFilter], response: FrequencyResponse) -> ComplexArray:
    """What is left of a channel behind its filters, where that is enough to go back from."""
    highest = float(response.omega_rad_s[-1])
    slowest = min(known.rate_hz for known in chain)
    if highest >= np.pi * slowest:
        raise UsageError(
            f"{name} was filtered at {slowest:g} Hz, and the response reaches {highest:.4g} rad/s",
            needed=f"less than {np.pi * slowest:.4g} rad/s",
            remedy="select a lower band",
        )
    passed = combined_response(chain, response.omega_rad_s)
    left = np.abs(passed)
    if left.min() < _FAINTEST:
        raise UsageError(
            f"the filters leave {left.min():.2g} of {name} at {response.omega_rad_s[left.argmin()]:.4g} rad/s",
            needed=f"at least {_FAINTEST:g}, below which nothing is left to correct",
            remedy="select a band without these frequencies",
        )
    return passed


def _scaled(response: FrequencyResponse, factor: ComplexArray, *notes: str) -> FrequencyResponse:
    return replace(
        response,
        values=response.values * factor,
        covariance=_scaled_covariance(response, factor),
        processing=(*response.processing, *notes),
        output_correlation=_turned(response, factor),
        disturbance=None,
    )


def _turned(response: FrequencyResponse, factor: ComplexArray) -> ComplexArray | None:
    """The correlation of outputs that were each multiplied by a factor: its phase shifts their errors."""
    if response.output_correlation is None:
        return None
    turn = np.swapaxes(factor / np.maximum(np.abs(factor), _TINY), 0, 1)
    return np.asarray(response.output_correlation * turn[:, :, None] * turn[:, None, :].conj())


def _scaled_covariance(response: FrequencyResponse, factor: ComplexArray) -> ComplexArray:
    return np.asarray(response.covariance * factor[..., :, None] * factor[..., None, :].conj())


def _ones(response: FrequencyResponse) -> ComplexArray:
    return np.ones(response.values.shape, dtype=np.complex128)


def _row(names: Sequence[str], name: str, what: str) -> int:
    if name not in names:
        raise UsageError(f"there is no {what} {name} in the response", needed=f"one of {', '.join(names)}")
    return list(names).index(name)


def _require_single(response: FrequencyResponse) -> None:
    if response.values.shape[:2] != (1, 1):
        raise UsageError(
            f"got a response of {', '.join(response.outputs)} to {', '.join(response.inputs)}",
            needed="one output and one input",
            remedy="select a pair",
        )


def _require_matching(numerator: FrequencyResponse, denominator: FrequencyResponse) -> None:
    _require_single(numerator)
    _require_single(denominator)
    same_driver = (numerator.inputs, numerator.instruments) == (denominator.inputs, denominator.instruments)
    if not same_driver or not np.array_equal(numerator.omega_rad_s, denominator.omega_rad_s):
        raise UsageError(
            f"got responses to {numerator.inputs[0]} and to {denominator.inputs[0]}",
            needed="the same input, the same instrument and the same frequencies",
            remedy="take both out of one estimate",
        )
    if not np.all(denominator.values):
        raise UsageError("the denominator is zero at some frequency", needed="a band without zeros")


Row: TypeAlias = NDArray[np.inexact[Any]]
"""How the relative errors of the points enter a number, shape ``(n,)``."""

LARGEST_ERROR = 0.3
"""Points with a larger relative error show no margin."""

LEAST_COHERENCE = 0.3
"""Of a joint estimate: below it the instrument hardly moves the input, and the published error is too small."""

_REACH = 0.3
"""Half-width of a local fit in the logarithm of frequency."""

_REACH_OF_SLOPE = 0.6
_FEWEST_POINTS = 5
_BEYOND_LAST = 1.2
_FINEST_ERROR = 0.02
"""Below this the errors of points do not decide their weight: the parabola itself is no better."""

_STEP = 0.01


@dataclass(frozen=True, kw_only=True, slots=True)
class Estimated:
    """A number and its uncertainty.

    Parameters
    ----------
    value
        In the unit that the name of its field says.
    std
        One standard deviation, same unit.
    ends
        Of its 95 % interval, where the error is not that of a normal distribution.

    Examples
    --------
    >>> low, high = Estimated(value=10.0, std=1.0).interval
    >>> round(low, 2), round(high, 2)
    (8.04, 11.96)
    """

    value: float
    std: float
    ends: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval, that of a normal distribution unless its ends are known."""
        if self.ends is not None:
            return self.ends
        return self.value - TWO_SIDED_95 * self.std, self.value + TWO_SIDED_95 * self.std

    @property
    def lower(self) -> float:
        """Lower end of the interval."""
        return self.interval[0]

    @property
    def upper(self) -> float:
        """Upper end of the interval."""
        return self.interval[1]


class Local(NamedTuple):
    r"""The curve at one point: value, slope over :math:`\ln\omega`, and weights of the points in the value."""

    x: float
    value: complex
    slope: complex
    weights: FloatArray

    @property
    def omega_rad_s(self) -> float:
        return math.exp(self.x)


@dataclass(frozen=True, kw_only=True, eq=False)
class LogCurve:
    r"""The points of a response that can be trusted, and a local parabola through them.

    .. math:: \ln H(\omega) = \ln |H| + j \angle H \approx c_0 + c_1 t + c_2 t^2, \qquad t = \ln(\omega / \omega_0)

    fitted at each :math:`\omega_0` with weights that fall to zero within 0.3 in :math:`\ln\omega`, or wider where that
    holds fewer than five points. The fit is linear in the measured logarithms, whose errors are the relative errors
    :math:`z_i = \delta H_i / H_i` of the response. So everything read off the curve has a complex row :math:`\alpha`,

    .. math:: \delta q = \mathrm{Re} \sum_i \alpha_i z_i, \qquad
        \sigma_q^2 = \tfrac12 \sum_{ij} \alpha_i \, E[z_i z_j^*] \, \alpha_j^*

    Breaks down where a response bends within the reach more than a parabola does: a resonance narrower than 30 %.

    Parameters
    ----------
    x
        :math:`\ln\omega` of the trusted points, shape ``(n,)``.
    logarithms
        :math:`\ln H`, with the phase unwrapped from the lowest point, which lies in :math:`(-3\pi/2, \pi/2]`.
    covariance
        :math:`E[z_i z_j^*]`, shape ``(n, n)``.
    bands
        Stretches of :math:`\ln\omega` in which the points lie dense enough to read the curve.
    """

    x: FloatArray
    logarithms: ComplexArray
    covariance: ComplexArray
    bands: tuple[tuple[float, float], ...]

    def near(self, x: FloatArray, *, half_width: float = _REACH) -> tuple[ComplexArray, FloatArray]:
        """Coefficients of the parabolas at ``x``, shape ``(m, 3)``, and how the points enter them, ``(m, 3, n)``."""
        distance = self.x - np.asarray(x)[:, None]
        ordered = np.sort(np.abs(distance), axis=1)
        reach = np.maximum(half_width, _BEYOND_LAST * ordered[:, _FEWEST_POINTS - 1])[:, None]
        t = distance / reach
        kernel = np.clip(1.0 - np.abs(t) ** 3, 0.0, None) ** 3
        weight = kernel / (np.einsum("ff->f", self.covariance).real + _FINEST_ERROR**2)
        basis = np.stack([np.ones_like(t), t, t**2], axis=1)
        weighted = basis * weight[:, None, :]
        rows: FloatArray = np.linalg.solve(weighted @ np.swapaxes(basis, 1, 2), weighted).astype(np.float64)
        rows /= np.concatenate([np.ones_like(reach), reach, reach**2], axis=1)[:, :, None]
        return rows @ self.logarithms, rows

    def at(self, x: float) -> Local:
        """Everything about one point."""
        place = np.array([x])
        (here,), (rows,) = self.near(place)
        # A crossing is found where the noise makes the curve steep, so the slope there is taken from farther around.
        (around,), _ = self.near(place, half_width=_REACH_OF_SLOPE)
        return Local(x, complex(here[0]), complex(around[1]), rows[0])

    def grid(self, band: tuple[float, float]) -> tuple[FloatArray, ComplexArray]:
        r"""The curve at close steps over one band: :math:`\ln\omega` and :math:`\ln H`."""
        low, high = band
        x = np.linspace(low, high, 2 + int((high - low) / _STEP))
        coefficients, _ = self.near(x)
        return x, coefficients[:, 0]

    def covers(self, x: float) -> bool:
        """Whether a point lies in a band."""
        return any(low <= x <= high for low, high in self.bands)

    def std(self, row: Row) -> float:
        """Standard deviation of what has the given row."""
        variance = 0.5 * float(np.real(row @ self.covariance @ row.conj()))
        # Rounding may leave the covariance of a quiet flight a little below zero.
        return math.sqrt(max(variance, 0.0))

    @property
    def bands_text(self) -> str:
        """The bands for a person."""
        return " and ".join(f"{math.exp(low):.3g} to {math.exp(high):.3g}" for low, high in self.bands) + " rad/s"


def log_curve(response: FrequencyResponse) -> LogCurve:
    """The curve through the trusted points of one response.

    A hole between trusted points that is wider than the reach of the fit ends a band; what lies in it is not read.

    Parameters
    ----------
    response
        Of shape ``(1, 1, f)``. Nothing is read from points with a relative error above 0.3, nor from those of a joint
        estimate with a coherence below 0.3; neighbors have to be less than half a turn of phase apart.

    Returns
    -------
    LogCurve
        Without any band when there are fewer than five trusted points together.

    Raises
    ------
    UsageError
        There is more than one response, or the grid begins at zero.
    """
    if response.values.shape[:2] != (1, 1) or response.omega_rad_s[0] <= 0.0:
        raise UsageError(
            f"got a response of shape {response.values.shape} from {response.omega_rad_s[0]:g} rad/s",
            needed="one response at positive frequencies",
        )
    values = response.values[0, 0]
    trusted = _trusted(response)
    H = values[trusted]
    x = np.log(response.omega_rad_s[trusted])
    if H.size == 0:
        return LogCurve(x=x, logarithms=H, covariance=np.zeros((0, 0), dtype=np.complex128), bands=())
    phase = np.unwrap(np.angle(H))
    # The lowest point may lead a little or lag up to three quarters of a turn.
    phase -= 2.0 * np.pi * np.ceil((phase[0] - 0.5 * np.pi) / (2.0 * np.pi))
    covariance = response.covariance[0, 0][np.ix_(trusted, trusted)] / (H[:, None] * H.conj())
    return LogCurve(x=x, logarithms=np.log(np.abs(H)) + 1j * phase, covariance=covariance, bands=_bands(x, trusted))


def read_points(response: FrequencyResponse) -> BoolArray:
    """Points of one response from which numbers are read, shape ``(f,)``: trusted ones, within the bands of its curve.

    Parameters
    ----------
    response
        Of shape ``(1, 1, f)``.
    """
    x = np.log(response.omega_rad_s)
    within = [(x >= low) & (x <= high) for low, high in log_curve(response).bands]
    return np.asarray(_trusted(response) & np.any(within, axis=0)) if within else np.zeros(x.size, dtype=np.bool_)


def _trusted(response: FrequencyResponse) -> BoolArray:
    good = (response.random_error[0, 0] <= LARGEST_ERROR) & (np.abs(response.values[0, 0]) > 0.0)
    return np.asarray(good & (response.coherence[0, 0] >= LEAST_COHERENCE) if response.estimate == "joint" else good)


def _bands(x: FloatArray, trusted: BoolArray) -> tuple[tuple[float, float], ...]:
    places = np.flatnonzero(trusted)
    # A coarse grid is the user's choice; only points that were left out make a hole.
    hole = (np.diff(places) > 1) & (np.diff(x) > _REACH)
    runs = np.split(x, np.flatnonzero(hole) + 1)
    return tuple((float(run[0]), float(run[-1])) for run in runs if run.size >= _FEWEST_POINTS)


def crossings(curve: LogCurve, level: float, *, part: Literal["magnitude", "phase"]) -> tuple[tuple[Local, bool], ...]:
    """Where the logarithm of the magnitude, or the phase, passes a level; with ``True`` for a rise.

    Parameters
    ----------
    curve
        Read inside its bands, and not beyond.
    level
        Logarithm of a magnitude, or phase in radians.
    part
        ``magnitude`` or ``phase``.
    """
    found = []
    for band in curve.bands:
        x, logarithms = curve.grid(band)
        above = (logarithms.real if part == "magnitude" else logarithms.imag) - level
        for k in np.flatnonzero((above[:-1] < 0.0) != (above[1:] < 0.0)):
            middle = x[k] - above[k] * (x[k + 1] - x[k]) / (above[k + 1] - above[k])
            found.append((curve.at(float(middle)), bool(above[k] < 0.0)))
    return tuple(found)
