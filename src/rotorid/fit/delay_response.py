r"""A late lag fitted to a frequency response, whose phase slope tells the delay.

.. math:: r = \ln \frac{H(\omega)}{G(j\omega)\, e^{-j\omega\tau}}

with real part the error of the magnitude and imaginary part that of the phase, weighed by the covariance of the
response between its points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.data.response import FrequencyResponse
from rotorid.fit.delay_model import LateLag, held_spectrum
from rotorid.fit.error_covariance import ResidualErrors, residual_errors
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_ROUNDS = 6
_RANK = 1e-11


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponsePoints(Immutable):
    """The usable points of one response.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    values
        Shape ``(f,)``.
    errors
        What is known of their errors.
    """

    omega_rad_s: FloatArray
    values: ComplexArray
    errors: ResidualErrors

    @classmethod
    def of(cls, response: FrequencyResponse, used: BoolArray, pair: tuple[int, int]) -> ResponsePoints:
        """Points of the response ``pair`` that are ``used``, shape ``(y, u, f)``."""
        chosen = np.zeros_like(used)
        chosen[pair] = used[pair]
        ones = np.ones(int(chosen.sum()))
        return cls(
            omega_rad_s=response.omega_rad_s[chosen[pair]],
            values=response.values[pair][chosen[pair]],
            errors=residual_errors(response, chosen, (ones, ones)),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseFit:
    """Residuals of a late lag on a frequency response."""

    data: ResponsePoints
    model: LateLag

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""
        return 2 * self.data.omega_rad_s.size

    def thinned(self) -> ResponseFit:
        """The fit itself: its points are few."""
        return self

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations and their derivatives, shapes ``(n,)`` and ``(n, p)``."""
        values, slopes = self.model.response(theta, self.data.omega_rad_s)
        safe = np.where(values == 0.0, np.finfo(np.float64).tiny, values)
        error = np.log(self.data.values / safe)
        relative = -slopes / safe
        raw = np.concatenate([error.real, error.imag])
        jacobian = np.concatenate([relative.real, relative.imag], axis=1).T
        return self.data.errors.whitened(raw), self.data.errors.whitened(jacobian)

    @cached_property
    def _weight(self) -> FloatArray:
        size = self.data.omega_rad_s.size
        variance = np.diag(self.data.errors.covariance)[:size] + self.data.errors.own[:size]
        return np.asarray(1.0 / (np.abs(self.data.values) * np.sqrt(variance)))

    def linear(self, delay_s: float, fastest_rad_s: float) -> tuple[FloatArray, float]:
        """Parameters at a given delay without a start, and their cost; as on records, see there."""
        order, omega = self.model.order, self.data.omega_rad_s
        powers = (1j * omega / self.model.scale_rad_s) ** np.arange(order.poles + 1)[:, None]
        late, scale = np.exp(-1j * omega * delay_s), self._weight
        if self.model.hold == "held":
            late = late * held_spectrum(omega, self.model.sample_s)
        found = np.zeros(order.coefficients)
        for _ in range(_ROUNDS):
            columns = [*(powers[: order.zeros + 1] * late), *(-powers[:-1] * self.data.values)]
            matrix = np.stack([_real(scale * column) for column in columns], axis=1)
            length = np.sqrt(np.sum(matrix**2, axis=0))
            right = _real(scale * powers[-1] * self.data.values)
            found = np.linalg.lstsq(matrix / length, right, rcond=_RANK)[0] / length
            below = np.abs(np.append(found[order.zeros + 1 :], 1.0) @ powers)
            scale = self._weight / np.maximum(below, 1e-9 * below.max())
        theta = np.zeros(order.coefficients + 1)
        roots = np.roots(np.append(found[order.zeros + 1 :], 1.0)[::-1])
        poles = np.asarray(roots, dtype=np.complex128) * self.model.scale_rad_s
        theta[order.zeros + 1 : -1] = self.model.factors(poles, fastest_rad_s)
        theta[-1] = delay_s
        error = self._weight * np.abs(self.data.values - self._numerator(theta))
        return theta, float(2.0 * error @ error)

    def _numerator(self, theta: FloatArray) -> ComplexArray:
        """Fit the numerator with everything else in place, into ``theta``; the response."""
        above = self.model.order.zeros + 1
        _, slopes = self.model.response(theta, self.data.omega_rad_s)
        columns = slopes[:above]
        matrix = np.stack([_real(self._weight * column) for column in columns], axis=1)
        theta[:above] = np.linalg.lstsq(matrix, _real(self._weight * self.data.values), rcond=_RANK)[0]
        return np.asarray(theta[:above] @ columns, dtype=np.complex128)


def _real(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])
