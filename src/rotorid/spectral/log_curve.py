r"""A measured response as a smooth curve over the logarithm of frequency, with the error of all that is read off it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.typing import BoolArray, ComplexArray, FloatArray

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
_NORMAL_95 = 1.959964


@dataclass(frozen=True, kw_only=True, slots=True)
class Estimated:
    """A number and its uncertainty.

    Parameters
    ----------
    value
        In the unit that the name of its field says.
    std
        One standard deviation, same unit.

    Examples
    --------
    >>> low, high = Estimated(value=10.0, std=1.0).interval
    >>> round(low, 2), round(high, 2)
    (8.04, 11.96)
    """

    value: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of a normal distribution."""
        return self.value - _NORMAL_95 * self.std, self.value + _NORMAL_95 * self.std


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
    def seen(self) -> str:
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
            f"a response of shape {response.values.shape} from {response.omega_rad_s[0]:g} rad/s came",
            needed="one response at positive frequencies",
        )
    values = response.values[0, 0]
    trusted = (response.random_error[0, 0] <= LARGEST_ERROR) & (np.abs(values) > 0.0)
    if response.estimate == "joint":
        trusted &= response.coherence[0, 0] >= LEAST_COHERENCE
    H = values[trusted]
    x = np.log(response.omega_rad_s[trusted])
    if H.size == 0:
        return LogCurve(x=x, logarithms=H, covariance=np.zeros((0, 0), dtype=np.complex128), bands=())
    phase = np.unwrap(np.angle(H))
    # The lowest point may lead a little or lag up to three quarters of a turn.
    phase -= 2.0 * np.pi * np.ceil((phase[0] - 0.5 * np.pi) / (2.0 * np.pi))
    covariance = response.covariance[0, 0][np.ix_(trusted, trusted)] / (H[:, None] * H.conj())
    return LogCurve(x=x, logarithms=np.log(np.abs(H)) + 1j * phase, covariance=covariance, bands=_bands(x, trusted))


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
