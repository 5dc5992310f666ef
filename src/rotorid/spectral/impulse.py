r"""The impulse and step response behind a measured frequency response, with a confidence band.

A frequency response is known at some frequencies, with errors that neighbors share, and not at all beyond its band.
Division of spectra fills what is missing with zeros or constants, and bends the step response. Here the impulse
response :math:`g(t)` is a Gaussian process instead: smooth, decaying, of a fast and a slow part, and otherwise
unknown. Given the measured points, it and everything that follows from it has a mean and a covariance. No order is
chosen.

.. math::

    H(\omega_i) = \sum_k g_k d_k \operatorname{sinc}\frac{\omega_i d_k}{2 \pi} \, e^{-j \omega_i t_k} + \delta_i,
    \qquad g \sim N(0, K), \quad \delta \sim N(0, C)

    K = \lambda \omega_s^2 \left[ s(\beta) + \rho \, s(\sigma) \right], \qquad
    s(\beta)_{ij} = a^2 \left( \frac{b}{2} - \frac{a}{6} \right), \quad
    a = \min(e^{-\beta t_i}, e^{-\beta t_j}), \; b = \max(e^{-\beta t_i}, e^{-\beta t_j})

with the stable spline of second order :math:`s` and cells of width :math:`d_k` about :math:`t_k`. The four numbers of
the prior are those under which the measured points are likeliest.

References
----------
Pillonetto and De Nicolao, *A new kernel-based approach for linear system identification*, Automatica 46 (2010).
Lataire and Chen, *Transfer function and transient estimation by Gaussian process regression in the frequency domain*,
Automatica 72 (2016).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.quantity import Quantity
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import BoolArray, ComplexArray, FloatArray

DRAWS = 200
"""Draws from the posterior that carry all numbers: the ends of a 95 % interval then err by a tenth of its half."""

_CELL = 0.06
_EQUAL_CELLS = 115
_WIDER = 1.03
_EVALUATIONS = 80
_JITTER = 1e-9

_LEAST_POINTS = 8
"""Frequencies without which there is no estimate."""

# Logarithms of scale, of both rates of decay over that of the response, and of the weight of the slow part.
_STARTS = ((0.0, math.log(0.5), math.log(0.05), math.log(1e-2)), (0.0, math.log(1.5), math.log(0.2), math.log(1e-3)))
_LOW = np.array([math.log(1e-4), math.log(0.05), math.log(1e-3), math.log(1e-7)])
_HIGH = np.array([math.log(1e4), math.log(10.0), math.log(2.0), math.log(1e2)])

_HALF_POWER = 10.0 ** (-3.0 / 20.0)

_SETTLED = 0.05
"""Distance from the end within which a step response is settled."""

_PEAK_FROM = 0.2
"""Share of the bandwidth above which a peak is looked for."""

_LEAST_PEAK_DB = 0.3
"""A lower peak is none."""

_FINE = 400

_BEYOND = 2.0
"""Factor beyond the measured band up to which the interval of a bandwidth may reach."""

_FIRST_ORDER_RISE = math.log(9.0)
"""Rise time of a first-order loop, 10 to 90 %, times its bandwidth: that of the fastest loop of a band."""

_MOST_UNREACHED = 0.025
"""Share of the draws that may have no such number: what one end of a 95 % interval leaves out."""

_FLAT_FROM = 1.3
"""Factor in frequency within half a decibel of -3 dB from which a -3 dB bandwidth says little."""

_WIDENING: Mapping[str, float] = MappingProxyType(
    {"bandwidth_3db_rad_s": 1.5, "bandwidth_90deg_rad_s": 1.5, "peak_db": 1.4, "overshoot_percent": 1.2}
)
"""Factors on intervals as drawn. On 96 simulated flights these held in 84 to 92 %: a flight is no linear system, and
the floor of its errors is one for all numbers. So much wider they hold in 95 %, on other flights too."""

NUMBERS: Mapping[str, str] = MappingProxyType(
    {
        "rise_time_s": "s",
        "delay_s": "s",
        "overshoot_percent": "%",
        "settling_time_s": "s",
        "bandwidth_3db_rad_s": "rad/s",
        "bandwidth_90deg_rad_s": "rad/s",
        "peak_db": "dB",
    }
)
"""Numbers of a closed loop and their units; see :func:`step_numbers`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpulseResponse(Immutable):
    """An impulse response with its covariance.

    Parameters
    ----------
    time_s, width_s
        Middles and widths of the cells in which it is constant, shape ``(n,)``.
    values
        Mean in 1/s, shape ``(n,)``.
    covariance
        Shape ``(n, n)``; where no linear response explains the points to their errors, it is as much larger.
    misfit
        Sum of the squared errors of the points, over their degrees of freedom.
    band_rad_s
        Lowest and highest frequency of the points.
    scale_rad_s
        Where the phase falls to −90°, about.
    """

    time_s: FloatArray
    width_s: FloatArray
    values: FloatArray
    covariance: FloatArray
    misfit: float
    band_rad_s: tuple[float, float]
    scale_rad_s: float

    def __post_init__(self) -> None:
        rows = {name: read_only(getattr(self, name), np.float64, ndim=1) for name in ("time_s", "width_s", "values")}
        self._set(**rows, covariance=read_only(self.covariance, np.float64, ndim=2))

    def at(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Its frequency response, shape ``(f,)``."""
        return np.asarray(_transform(self.time_s, self.width_s, omega_rad_s) @ self.values)

    def draws(self, count: int, *, rng: np.random.Generator) -> FloatArray:
        """Impulse responses that the points allow, shape ``(count, n)``."""
        level, directions = np.linalg.eigh(self.covariance)
        root = directions * np.sqrt(np.maximum(level, 0.0))
        return np.asarray(self.values + rng.standard_normal((count, level.size)) @ root.T)

    def step(self, impulses: FloatArray | None = None) -> FloatArray:
        """Answers to a unit step at ``time_s``: its own, or those of draws of shape ``(draws, n)``."""
        filled = (self.values if impulses is None else impulses) * self.width_s
        return np.asarray(np.cumsum(filled, axis=-1) - 0.5 * filled)

    @property
    def step_std(self) -> FloatArray:
        """Standard deviation of its answer to a unit step, shape ``(n,)``."""
        sums = np.tril(np.ones(self.covariance.shape)) - 0.5 * np.eye(self.values.size)
        rows = sums * self.width_s
        return np.asarray(np.sqrt(np.maximum(np.sum((rows @ self.covariance) * rows, axis=1), 0.0)))


def phase_crossing(omega_rad_s: FloatArray, values: ComplexArray) -> float:
    """Lowest frequency at which the phase, unwrapped from the lowest one, falls through -90°; infinite where never.

    Parameters
    ----------
    omega_rad_s
        Rising, shape ``(f,)``.
    values
        Response, shape ``(f,)``.

    Examples
    --------
    >>> omega_rad_s = np.geomspace(1.0, 100.0, 200)
    >>> round(phase_crossing(omega_rad_s, 1.0 / (1.0 + 0.1j * omega_rad_s) ** 2), 2)
    10.0
    """
    phase = np.unwrap(np.angle(values))
    return float(_falls(np.log(omega_rad_s), phase[None], -0.5 * math.pi, exponential=True)[0])


def impulse_response(
    omega_rad_s: FloatArray,
    values: ComplexArray,
    covariance: ComplexArray,
    *,
    horizon_s: float = 10.0,
    scale_rad_s: float | None = None,
) -> ImpulseResponse:
    r"""Impulse response of a stable, causal linear system by its frequency response.

    Assumes that the system answers to steps within the horizon but for what is slow, and that the errors are Gaussian
    with the covariance given. An error of the model that is shared by neighbors and not part of ``covariance`` makes
    the answer too certain.

    Parameters
    ----------
    omega_rad_s
        Rising, shape ``(f,)``.
    values
        Measured response, shape ``(f,)``.
    covariance
        :math:`E[\delta_i \delta_j^*]`, shape ``(f, f)``.
    horizon_s
        The impulse response is zero from there on.
    scale_rad_s
        What the cells are scaled by; where the phase falls to −90° when none is given.

    Raises
    ------
    InsufficientDataError
        Fewer than eight points came.
    UsageError
        Shapes do not fit, or a number is none.

    Examples
    --------
    >>> omega_rad_s = np.geomspace(0.5, 100.0, 40)
    >>> exact = 20.0 / (20.0 + 1j * omega_rad_s)
    >>> found = impulse_response(omega_rad_s, exact, np.diag(1e-6 * np.abs(exact) ** 2))
    >>> bool(np.abs(found.step() - (1.0 - np.exp(-20.0 * found.time_s))).max() < 0.01)
    True
    """
    points = omega_rad_s.size
    if values.shape != (points,) or covariance.shape != (points, points):
        raise UsageError(
            f"got {points} frequencies, a response of shape {values.shape}, a covariance of shape {covariance.shape}",
            needed="one value for each frequency, and a covariance between all of them",
        )
    if not (np.isfinite(values).all() and np.isfinite(covariance).all()):
        raise UsageError("the response has points that are not finite", needed="known points only")
    if points < _LEAST_POINTS:
        raise InsufficientDataError(
            f"got a response of {points} points",
            needed=f"{_LEAST_POINTS} and more",
            remedy="fly longer, or log faster",
        )
    found = phase_crossing(omega_rad_s, values) if scale_rad_s is None else scale_rad_s
    scale = min(found, 2.0 * float(omega_rad_s[-1]))
    time_s, width_s = _cells(scale, horizon_s)
    transform = _transform(time_s, width_s, omega_rad_s)
    rows = np.concatenate([transform.real, transform.imag])
    data = np.concatenate([values.real, values.imag])
    errors = 0.5 * np.block([[covariance.real, -covariance.imag], [covariance.imag, covariance.real]])
    # Points that share all of their data cannot be separated: a billionth of their size keeps the matrix regular.
    errors = errors + _JITTER * float(np.mean(np.abs(values) ** 2)) * np.eye(data.size)
    prior = _likeliest(rows, data, errors, time_s, scale)
    across = rows @ prior
    factor = np.linalg.cholesky(across @ rows.T + errors)
    half = np.linalg.solve(factor, np.column_stack([across, data]))
    mean = half[:, :-1].T @ half[:, -1]
    spread = prior - half[:, :-1].T @ half[:, :-1]
    left = data - rows @ mean
    weighted = np.linalg.solve(errors, np.column_stack([left, rows @ spread @ rows.T]))
    # What the points have in common with their own fit leaves no degree of freedom.
    freedom = max(float(data.size - np.trace(weighted[:, 1:])), 1.0)
    misfit = float(left @ weighted[:, 0]) / freedom
    return ImpulseResponse(
        time_s=time_s,
        width_s=width_s,
        values=mean,
        covariance=max(misfit, 1.0) * 0.5 * (spread + spread.T),
        misfit=misfit,
        band_rad_s=(float(omega_rad_s[0]), float(omega_rad_s[-1])),
        scale_rad_s=scale,
    )


def step_numbers(
    impulse: ImpulseResponse, *, within_s: float = 1.0, rng: np.random.Generator | None = None
) -> dict[str, Quantity]:
    r"""What people ask of a closed loop, each with its 95 % interval; what is unknown is left out.

    All are relative to the set-point one, not to the value at which the response ends: a loop that droops shows it.

    ``rise_time_s``
        From 0.1 to 0.9; left out where more than 1 in 40 draws do not reach 0.9 in time, or beyond the band.
    ``delay_s``
        Until 0.5, of a band-limited step.
    ``overshoot_percent``
        :math:`\max(0, \max s - 1)`.
    ``settling_time_s``
        Until the answer stays within 0.05 of one; left out where it leaves that band until the end.
    ``bandwidth_3db_rad_s``, ``bandwidth_90deg_rad_s``
        Where the magnitude falls below −3 dB, and the phase below −90°; left out beyond the band.
    ``peak_db``
        Largest magnitude above a fifth of the −90° bandwidth, inside of the measured band, where it exceeds 0.3 dB.

    What lies beyond the band is a bound alone (:func:`bound_of_band`): the prior would make up the number.

    Parameters
    ----------
    impulse
        The impulse response.
    within_s
        How long an answer is waited for.
    rng
        Of the draws; the same ones for every call when none is given.
    """
    impulses = np.vstack([impulse.values, impulse.draws(DRAWS, rng=rng or np.random.default_rng(0))])
    inside = impulse.time_s <= within_s
    time_s, steps = impulse.time_s[inside], impulse.step(impulses)[:, inside]
    low, half, high = (_rises(time_s, steps, level) for level in (0.1, 0.5, 0.9))
    scale, top = impulse.scale_rad_s, impulse.band_rad_s[1]
    omega = np.geomspace(0.5 * _PEAK_FROM * scale, _BEYOND * top, _FINE)
    response = impulses @ _transform(impulse.time_s, impulse.width_s, omega).T
    magnitude, phase = np.abs(response), np.unwrap(np.angle(response), axis=1)
    from_there = omega >= _PEAK_FROM * scale
    measured = from_there & (omega <= top)
    found = {
        "rise_time_s": high - low,
        "delay_s": half,
        "overshoot_percent": 100.0 * np.maximum(steps.max(axis=1) - 1.0, 0.0),
        "settling_time_s": _settles(time_s, steps),
        "bandwidth_3db_rad_s": _falls(
            np.log(omega[from_there]), magnitude[:, from_there], _HALF_POWER, exponential=True
        ),
        "bandwidth_90deg_rad_s": _falls(np.log(omega), phase, -0.5 * math.pi, exponential=True),
        "peak_db": 20.0 * np.log10(_highest(magnitude, measured)) if measured.any() else np.full(len(impulses), np.nan),
    }
    quantities = {name: _quantity(name, numbers) for name, numbers in found.items()}
    return {
        name: quantity
        for name, quantity in quantities.items()
        if quantity is not None and not _beyond_band(name, quantity.value, impulse.band_rad_s)
    }


def bound_of_band(name: str, band_rad_s: tuple[float, float]) -> float | None:
    r"""What the end of a band says of a number beyond it: the least bandwidth, or the longest rise time.

    A loop whose bandwidth is the end of the band rises in :math:`\ln 9 / \omega`, if it is of first order.

    Parameters
    ----------
    name
        Of :data:`NUMBERS`.
    band_rad_s
        Lowest and highest measured frequency.

    Returns
    -------
    float or None
        In the unit of the number; ``None`` for numbers without such a bound.

    Examples
    --------
    >>> bound_of_band("bandwidth_90deg_rad_s", (1.0, 154.0)), round(bound_of_band("rise_time_s", (1.0, 154.0)), 4)
    (154.0, 0.0143)
    """
    if name.startswith("bandwidth"):
        return band_rad_s[1]
    return _FIRST_ORDER_RISE / band_rad_s[1] if name == "rise_time_s" else None


def _beyond_band(name: str, value: float, band_rad_s: tuple[float, float]) -> bool:
    bound = bound_of_band(name, band_rad_s)
    if bound is None:
        return False
    return value < bound if name == "rise_time_s" else value > bound


def flat_near_3db(impulse: ImpulseResponse) -> bool:
    """Whether the magnitude lies within half a decibel of −3 dB over a factor of 1.3 in frequency and more.

    The −3 dB bandwidth of such a response jumps with its noise, and says little.
    """
    omega = np.geomspace(_PEAK_FROM * impulse.scale_rad_s, _BEYOND * impulse.band_rad_s[1], _FINE)
    decibel = 20.0 * np.log10(np.abs(impulse.at(omega)))
    near = omega[np.abs(decibel + 3.0) < 0.5]
    return bool(near.size and near[-1] > _FLAT_FROM**2 * near[0])


def _quantity(name: str, numbers: FloatArray) -> Quantity | None:
    """The number of the mean, with the spread of those of the draws."""
    value, drawn = float(numbers[0]), numbers[1:]
    if not math.isfinite(value) or float(np.mean(~np.isfinite(drawn))) > _MOST_UNREACHED:
        return None
    if name == "peak_db" and value < _LEAST_PEAK_DB:
        return None
    drawn = drawn[np.isfinite(drawn)]
    lower, low, high, upper = (float(end) for end in np.percentile(drawn, [2.5, 16.0, 84.0, 97.5]))
    std, wider = 0.5 * (high - low), _WIDENING.get(name, 1.0)
    lower, upper = (min(value - wider * (value - lower), value), max(value + wider * (upper - value), value))
    return Quantity(value=value, std=wider * std, lower=max(lower, 0.0), upper=upper, unit=NUMBERS[name])


def _cells(scale_rad_s: float, horizon_s: float) -> tuple[FloatArray, FloatArray]:
    """Middles and widths of cells: equal ones where the response is fast, then wider and wider until the horizon."""
    first_s = _CELL / scale_rad_s
    widths = [first_s] * _EQUAL_CELLS
    end_s = first_s * _EQUAL_CELLS
    while end_s < horizon_s:
        widths.append(_WIDER * widths[-1])
        end_s += widths[-1]
    width_s = np.array(widths)
    return np.cumsum(width_s) - 0.5 * width_s, width_s


def _transform(time_s: FloatArray, width_s: FloatArray, omega_rad_s: FloatArray) -> ComplexArray:
    """What cells of height one add to the frequency response, shape ``(f, n)``."""
    omega = omega_rad_s[:, None]
    return np.asarray(width_s * np.sinc(omega * width_s / (2.0 * np.pi)) * np.exp(-1j * omega * time_s))


def _spline(time_s: FloatArray, decay_1_s: float) -> FloatArray:
    """Stable spline of second order, shape ``(n, n)``."""
    left = np.exp(-decay_1_s * time_s)
    small, large = np.minimum.outer(left, left), np.maximum.outer(left, left)
    return np.asarray(small**2 * (0.5 * large - small / 6.0))


def _spline_times(time_s: FloatArray, decay_1_s: float, columns: FloatArray) -> FloatArray:
    """The same times columns of shape ``(n, m)``, by running sums: of two cells, the later one is the smaller."""
    left = np.exp(-decay_1_s * time_s)[:, None]
    one, two, three = left * columns, left**2 * columns, left**3 * columns
    later = 0.5 * left * _reverse_sums(two) - _reverse_sums(three) / 6.0
    earlier = 0.5 * left**2 * (np.cumsum(one, axis=0) - one)
    earlier -= left**3 / 6.0 * (np.cumsum(columns, axis=0) - columns)
    return np.asarray(later + earlier)


def _reverse_sums(rows: FloatArray) -> FloatArray:
    return np.asarray(np.cumsum(rows[::-1], axis=0)[::-1])


def _likeliest(
    rows: FloatArray, data: FloatArray, errors: FloatArray, time_s: FloatArray, scale_rad_s: float
) -> FloatArray:
    """Covariance of the prior under which the data are likeliest, shape ``(n, n)``."""
    from scipy.linalg import LinAlgError, cholesky, solve_triangular
    from scipy.optimize import minimize

    columns = np.ascontiguousarray(rows.T)

    def numbers(logs: FloatArray) -> tuple[float, float, float, float]:
        size, fast, slow, weight = np.exp(np.clip(logs, _LOW, _HIGH)).tolist()
        return size * scale_rad_s**2, fast * scale_rad_s, slow * scale_rad_s, weight

    def cost(logs: FloatArray) -> float:
        outside = float(np.sum(np.maximum(logs - _HIGH, 0.0) + np.maximum(_LOW - logs, 0.0)))
        size, fast, slow, weight = numbers(logs)
        across = _spline_times(time_s, fast, columns) + weight * _spline_times(time_s, slow, columns)
        try:
            factor = cholesky(size * (rows @ across) + errors, lower=True, check_finite=False)
        except LinAlgError:
            return math.inf
        white = solve_triangular(factor, data, lower=True, check_finite=False)
        return float(white @ white) + 2.0 * float(np.log(np.diag(factor)).sum()) + 100.0 * outside

    ends = [
        minimize(
            cost,
            np.array(start),
            method="Nelder-Mead",
            options={"maxfev": _EVALUATIONS, "initial_simplex": _simplex(np.array(start))},
        )
        for start in _STARTS
    ]
    size, fast, slow, weight = numbers(min(ends, key=lambda end: float(end.fun)).x)
    return np.asarray(size * (_spline(time_s, fast) + weight * _spline(time_s, slow)))


def _simplex(start: FloatArray) -> FloatArray:
    return np.vstack([start, start + np.diag([1.5, 0.5, 0.7, 1.5])])


def _rises(time_s: FloatArray, steps: FloatArray, level: float) -> FloatArray:
    """When each answer first reaches a level; infinite where never, shape ``(draws,)``."""
    return _crosses(np.concatenate([[0.0], time_s]), np.pad(steps, ((0, 0), (1, 0))), lambda rows: rows >= level, level)


def _falls(logs: FloatArray, rows: FloatArray, level: float, *, exponential: bool = False) -> FloatArray:
    """Where each row first falls below a level; infinite where never, shape ``(draws,)``."""
    found = _crosses(logs, rows, lambda values: values < level, level)
    return np.exp(found) if exponential else found


def _crosses(
    places: FloatArray, rows: FloatArray, beyond: Callable[[FloatArray], BoolArray], level: float
) -> FloatArray:
    """First place, by straight lines between those given, at which each row is beyond a level."""
    passed = beyond(rows)
    first = np.maximum(passed.argmax(axis=1), 1)
    draw = np.arange(len(rows))
    before, after = rows[draw, first - 1], rows[draw, first]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.clip((level - before) / (after - before), 0.0, 1.0)
    at = places[first - 1] + np.nan_to_num(share) * (places[first] - places[first - 1])
    return np.where(passed.any(axis=1), at, np.inf)


def _settles(time_s: FloatArray, steps: FloatArray) -> FloatArray:
    """When each answer enters the band about one for good; infinite where it is outside at the end."""
    outside = np.abs(steps - 1.0) > _SETTLED
    last = steps.shape[1] - 1 - outside[:, ::-1].argmax(axis=1)
    settled = np.where(last + 1 < steps.shape[1], time_s[np.minimum(last + 1, time_s.size - 1)], np.inf)
    return np.where(outside.any(axis=1), settled, 0.0)


def _highest(magnitude: FloatArray, inside: BoolArray) -> FloatArray:
    """Largest magnitude inside of a band; no number where it lies at its upper end, beyond which it may be larger."""
    rows = magnitude[:, inside]
    at = rows.argmax(axis=1)
    return np.where(at < rows.shape[1] - 1, rows.max(axis=1), np.nan)
