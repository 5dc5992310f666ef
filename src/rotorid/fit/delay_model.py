r"""A delay in series with a lag of low order, as delays are told apart from what only looks like one.

.. math:: G(s) = \frac{b_0 + b_1 x + \dots + b_m x^m}{(x + d)\,(x^2 + c_1 x + c_0)} \, e^{-\tau s},
    \qquad x = s / \omega_0

with the first factor, the second, or both. Factors with positive coefficients are just the stable ones, which makes
stability a matter of bounds: an unstable pole near a zero on its other side turns the phase like a delay.

An input that is held between its samples reaches the vehicle as

.. math:: G_h(\omega) = \sum_k H(\omega + k \omega_s) \, G(j\omega + j k \omega_s), \qquad
    H(\omega) = \frac{1 - e^{-j\omega T}}{j\omega T}

with all its images, of which the three nearest on either side count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.typing import ComplexArray, FloatArray

InputHold: TypeAlias = Literal["held", "smooth"]
"""How an input goes on between its samples: constant until the next one, or as a band-limited signal does."""

_IMAGES = 3


class Order(NamedTuple):
    """Numbers of zeros and poles of a lag.

    Parameters
    ----------
    zeros, poles
        Fewer zeros than poles.
    """

    zeros: int
    poles: int

    @property
    def words(self) -> str:
        """The order as a person says it.

        Examples
        --------
        >>> Order(0, 1).words, Order(1, 2).words
        ('first order', 'second order with zero')
        """
        ordinal = {1: "first", 2: "second", 3: "third", 4: "fourth"}.get(self.poles, f"{self.poles}th")
        zeros = {0: "", 1: " with zero"}.get(self.zeros, f" with {self.zeros} zeros")
        return f"{ordinal} order{zeros}"

    @property
    def coefficients(self) -> int:
        """Coefficients, without the delay."""
        return self.zeros + 1 + self.poles


@dataclass(frozen=True, kw_only=True)
class LateLag:
    """The model of one response: an order, a frequency that scales its coefficients, and the hold of the input.

    Parameters
    ----------
    order
        Zeros and poles.
    scale_rad_s
        The frequency that counts as one.
    hold
        How the input goes on between its samples.
    sample_s
        Sample interval; the hold needs it.
    """

    order: Order
    scale_rad_s: float
    hold: InputHold
    sample_s: float

    def response(self, theta: FloatArray, omega_rad_s: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Response and its exact derivatives.

        Parameters
        ----------
        theta
            Coefficients of the numerator, lowest power first; then of the factors, that of first order first, ``d``,
            ``c_1``, ``c_0``; then the delay in seconds. Shape ``(p,)``.
        omega_rad_s
            Shape ``(f,)``.

        Returns
        -------
        numpy.ndarray
            Shape ``(f,)``.
        numpy.ndarray
            Derivatives, shape ``(p, f)``.
        """
        if self.hold == "smooth":
            return self._plain(theta, omega_rad_s)
        turn = 2.0 * np.pi / self.sample_s
        images = omega_rad_s + turn * np.arange(-_IMAGES, _IMAGES + 1)[:, None]
        values, slopes = self._plain(theta, images.ravel())
        held = held_spectrum(images, self.sample_s)
        total = (held * values.reshape(images.shape)).sum(axis=0)
        return total, (held * slopes.reshape(-1, *images.shape)).sum(axis=1)

    def _plain(self, theta: FloatArray, omega_rad_s: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        m, x = self.order.zeros + 1, np.asarray(1j * omega_rad_s / self.scale_rad_s, dtype=np.complex128)
        powers = x ** np.arange(m)[:, None]
        below, moves = self._denominator(theta[m:-1], x)
        late = np.exp(-1j * omega_rad_s * theta[-1])
        values = theta[:m] @ powers / below * late
        slopes = [powers / below * late, -values / below * moves, (-1j * omega_rad_s * values)[None]]
        return values, np.concatenate(slopes)

    def _denominator(self, factors: FloatArray, x: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Product of the factors, and its derivatives to their coefficients."""
        ones = np.ones_like(x)
        single = self.order.poles % 2
        first = x + factors[0] if single else ones
        if self.order.poles == 1:
            return first, ones[None]
        second = x**2 + factors[single] * x + factors[single + 1]
        moves = [first * x, first]
        return first * second, np.stack([second, *moves] if single else moves)

    def poles_rad_s(self, theta: FloatArray) -> ComplexArray:
        """Poles in rad/s, shape ``(n,)``."""
        factors, single = theta[self.order.zeros + 1 : -1], self.order.poles % 2
        poles = [-factors[0]] if single else []
        if self.order.poles > 1:
            half, product = -0.5 * factors[single], factors[single + 1]
            root = np.sqrt(complex(half**2 - product))
            poles += [half + root, half - root]
        return np.asarray(poles, dtype=np.complex128) * self.scale_rad_s

    def factors(self, poles_rad_s: ComplexArray, fastest_rad_s: float) -> FloatArray:
        """Coefficients of the factors that have given poles, shape ``(n,)``.

        Parameters
        ----------
        poles_rad_s
            Shape ``(n,)``, complex ones in pairs.
        fastest_rad_s
            Poles that grow faster than this are mirrored to the stable side.
        """
        x = np.where(poles_rad_s.real > fastest_rad_s, -poles_rad_s.conj(), poles_rad_s) / self.scale_rad_s
        x = x[np.argsort(np.abs(x.imag), kind="stable")]
        single = self.order.poles % 2
        found = [-x[0].real] if single else []
        if self.order.poles > 1:
            found += [-(x[single] + x[single + 1]).real, (x[single] * x[single + 1]).real]
        return np.asarray(found, dtype=np.float64)

    def box(self, fastest_rad_s: float, delays_s: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters, each shape ``(p,)``, that keep poles from growing faster."""
        limit = fastest_rad_s / self.scale_rad_s
        single = [-limit] if self.order.poles % 2 else []
        double = [-2.0 * limit, -(limit**2)] if self.order.poles > 1 else []
        lower = np.array([*[-np.inf] * (self.order.zeros + 1), *single, *double, delays_s[0]])
        upper = np.full(lower.size, np.inf)
        upper[-1] = delays_s[1]
        return lower, upper


def held_spectrum(omega_rad_s: FloatArray, sample_s: float) -> ComplexArray:
    r"""What holding a sample does to its spectrum, :math:`(1 - e^{-j\omega T}) / (j\omega T)`; same shape."""
    half = 0.5 * omega_rad_s * sample_s
    return np.asarray(np.sinc(half / np.pi) * np.exp(-1j * half), dtype=np.complex128)
