r"""A late lag fitted to the finite Fourier transforms of records, with the noise weighed as it is.

.. math:: Y(\omega) = G(\omega)\, e^{-j\omega\tau}\, U(\omega)
    + \frac{\sum_k c_k z^{-k}}{\prod_i (1 - e^{p_i T} z^{-1})} + V(\omega), \qquad E|V|^2 = S(\omega)

The second term is what a record of finite length adds: the state at its start and at its end. It is eliminated by
projection. The spectrum :math:`S` is that of the residuals, so that colored noise widens the interval as it should
(Whittle, *Estimation and information in stationary time series*, Arkiv för Matematik, 1953; Pintelon and Schoukens,
*System Identification: A Frequency Domain Approach*, 2012, chapters 6 and 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.fit.delay_model import LateLag, held_spectrum
from rotorid.typing import ComplexArray, FloatArray

_POWER_SHARE = 0.9999
_HIGHEST_SHARE = 0.9
_THINNED = 400
_SMOOTHING_RATIO, _SMOOTHING_BINS = 1.3, 8
_RANK = 1e-11
_ROUNDS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordPart(Immutable):
    """Finite Fourier transforms of one record, ready for any shift of the input by whole samples.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    output
        Transform of the output, shape ``(f,)``.
    input
        Samples of the input, with a margin for the shifts on either side.
    first
        Sample of ``input`` with which the window of the output begins.
    count
        Samples in the window.
    bins
        Lines of the transform that are used, shape ``(f,)``.
    noise
        Power of the noise at each line, shape ``(f,)``.
    """

    omega_rad_s: FloatArray
    output: ComplexArray
    input: FloatArray
    first: int
    count: int
    bins: np.ndarray
    noise: FloatArray

    def shifted(self, samples: int) -> ComplexArray:
        """Transform of the input that came ``samples`` earlier than the output, shape ``(f,)``."""
        begin = self.first - samples
        window = self.input[begin : begin + self.count]
        return np.asarray(np.fft.rfft(window)[self.bins], dtype=np.complex128)

    def thinned(self, lines: int) -> RecordPart:
        """Some of the lines, evenly spread."""
        kept = slice(None, None, 1 + (self.omega_rad_s.size - 1) // lines)
        return replace(
            self,
            omega_rad_s=self.omega_rad_s[kept],
            output=self.output[kept],
            bins=self.bins[kept],
            noise=self.noise[kept],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordSpectra(Immutable):
    """Records as the fit of a delay sees them.

    Parameters
    ----------
    parts
        One for each record.
    sample_s
        Their sample interval.
    delays_s
        Least and largest delay that the margins allow.
    """

    parts: tuple[RecordPart, ...]
    sample_s: float
    delays_s: tuple[float, float]
    _shifts: dict[tuple[int, int], ComplexArray] = field(default_factory=dict, init=False, repr=False)

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""
        return 2 * sum(part.omega_rad_s.size for part in self.parts)

    def shifted(self, index: int, samples: int) -> ComplexArray:
        """Transform of the input of a record, ``samples`` earlier; computed once."""
        key = (index, samples)
        if key not in self._shifts:
            self._shifts[key] = self.parts[index].shifted(samples)
        return self._shifts[key]

    def with_parts(self, parts: Sequence[RecordPart]) -> RecordSpectra:
        """The same records with other lines or noise."""
        return RecordSpectra(parts=tuple(parts), sample_s=self.sample_s, delays_s=self.delays_s)

    def thinned(self) -> RecordSpectra:
        """Some of the lines of every record."""
        return self.with_parts([part.thinned(1 + _THINNED // len(self.parts)) for part in self.parts])


def record_spectra(
    histories: Sequence[TimeHistory],
    *,
    input: str,
    output: str,
    delays_s: tuple[float, float],
    highest_rad_s: float = np.inf,
) -> RecordSpectra:
    """Transforms of one input and one output of records of one rate.

    The windows leave room for shifting the input. Lines go as far as the input has power, and no further than nine
    tenths of the Nyquist frequency; the one at zero is left out, and with it any constant.
    """
    sample_s = 1.0 / histories[0].sample_rate_hz
    ahead, behind = (int(np.ceil(max(limit, 0.0) / sample_s)) + 1 for limit in (delays_s[1], -delays_s[0]))
    parts = tuple(
        _part(history[input], history[output], ahead, behind, sample_s, highest_rad_s)
        for history in histories
        if history.values.shape[1] > 3 * (ahead + behind)
    )
    return RecordSpectra(parts=parts, sample_s=sample_s, delays_s=delays_s)


def _part(u: FloatArray, y: FloatArray, ahead: int, behind: int, sample_s: float, highest_rad_s: float) -> RecordPart:
    count = y.size - ahead - behind
    window = y[ahead : ahead + count]
    transform = np.fft.rfft(window - window.mean())
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(count, sample_s), dtype=np.float64)
    power = np.abs(np.fft.rfft(u[ahead : ahead + count]))[1:] ** 2
    reach = np.searchsorted(np.cumsum(power), _POWER_SHARE * power.sum()) + 1
    top = min(omega[min(reach, omega.size - 1)], _HIGHEST_SHARE * np.pi / sample_s, highest_rad_s)
    bins = np.flatnonzero((omega > 0.0) & (omega <= top))
    return RecordPart(
        omega_rad_s=omega[bins],
        output=transform[bins],
        input=u,
        first=ahead,
        count=count,
        bins=bins,
        noise=np.ones(bins.size),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordFit:
    """Residuals of a late lag on records; ``theta`` is that of :meth:`LateLag.response`."""

    data: RecordSpectra
    model: LateLag

    @property
    def count(self) -> int:
        """Real numbers that are fitted."""
        return self.data.count

    def thinned(self) -> RecordFit:
        """The fit of some of the lines."""
        return replace(self, data=self.data.thinned())

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals in standard deviations and their derivatives, shapes ``(n,)`` and ``(n, p)``.

        The derivatives leave out that the ends of the record depend on the poles (Kaufman's approximation), which
        changes the path to the minimum and not the minimum.
        """
        whole = round(float(theta[-1]) / self.data.sample_s)
        rest = theta.copy()
        rest[-1] -= whole * self.data.sample_s
        poles = self.model.poles_rad_s(theta)
        residuals, slopes = [], []
        for index, part in enumerate(self.data.parts):
            values, derivatives = self.model.response(rest, part.omega_rad_s)
            late = self.data.shifted(index, whole)
            weight = np.sqrt(2.0 / part.noise)
            basis = _basis(part.omega_rad_s, poles, self.data.sample_s, weight)
            error = _real(weight * (part.output - values * late))
            slope = np.stack([_real(-weight * row * late) for row in derivatives], axis=1)
            residuals.append(error - basis @ (basis.T @ error))
            slopes.append(slope - basis @ (basis.T @ slope))
        return np.concatenate(residuals), np.concatenate(slopes)

    def linear(self, delay_s: float, fastest_rad_s: float) -> tuple[FloatArray, float]:
        """Parameters at a given delay without a start, and their cost.

        The equation is multiplied by the denominator and divided by that of the round before (Sanathanan and Koerner,
        *Transfer function synthesis as a ratio of two complex polynomials*, IEEE Transactions on Automatic Control,
        1963). Poles that grow too fast are mirrored; the numerator is then found again.
        """
        order = self.model.order
        coefficients = self._iterated(delay_s)
        poles = np.asarray(np.roots(np.append(coefficients, 1.0)[::-1]), dtype=np.complex128) * self.model.scale_rad_s
        theta = np.zeros(order.coefficients + 1)
        theta[order.zeros + 1 : -1] = self.model.factors(poles, fastest_rad_s)
        theta[-1] = delay_s
        residual, jacobian = self.residuals(theta)
        above = slice(0, order.zeros + 1)
        theta[above] = np.linalg.lstsq(jacobian[:, above], -residual, rcond=_RANK)[0]
        left = residual + jacobian[:, above] @ theta[above]
        return theta, float(left @ left)

    def _iterated(self, delay_s: float) -> FloatArray:
        """Coefficients of the denominator, lowest power first, that of the highest being one."""
        order, whole = self.model.order, round(delay_s / self.data.sample_s)
        rest_s = delay_s - whole * self.data.sample_s
        scales = [np.sqrt(2.0 / part.noise) for part in self.data.parts]
        found = np.zeros(order.coefficients)
        for _ in range(_ROUNDS):
            blocks = [self._equation(index, whole, rest_s, scale) for index, scale in enumerate(scales)]
            matrix, right = np.concatenate([block for block, _ in blocks]), np.concatenate([one for _, one in blocks])
            length = np.sqrt(np.sum(matrix**2, axis=0))
            length = np.where(length > 0.0, length, 1.0)
            found = np.linalg.lstsq(matrix / length, right, rcond=_RANK)[0] / length
            for index, part in enumerate(self.data.parts):
                below = np.abs(np.append(found[order.zeros + 1 :], 1.0) @ self._powers(part))
                scales[index] = np.sqrt(2.0 / part.noise) / np.maximum(below, 1e-9 * below.max())
        return found[order.zeros + 1 :]

    def _powers(self, part: RecordPart) -> ComplexArray:
        exponents = np.arange(self.model.order.poles + 1)[:, None]
        return np.asarray((1j * part.omega_rad_s / self.model.scale_rad_s) ** exponents, dtype=np.complex128)

    def _equation(self, index: int, whole: int, rest_s: float, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows of the equation multiplied by its denominator, without what the ends of the record add."""
        part, order, powers = self.data.parts[index], self.model.order, self._powers(self.data.parts[index])
        late = self.data.shifted(index, whole) * np.exp(-1j * part.omega_rad_s * rest_s)
        if self.model.hold == "held":
            late = late * held_spectrum(part.omega_rad_s, self.data.sample_s)
        columns = [power * late for power in powers[: order.zeros + 1]]
        columns += [-power * part.output for power in powers[:-1]]
        rows, right = np.stack([_real(weight * c) for c in columns], axis=1), _real(weight * powers[-1] * part.output)
        basis = _ends(part.omega_rad_s, order.poles + 1, self.data.sample_s, weight)
        return rows - basis @ (basis.T @ rows), right - basis @ (basis.T @ right)

    def reweighted(self, theta: FloatArray) -> RecordFit:
        """The fit with the spectrum of the noise that the residuals at ``theta`` have."""
        residual, _ = self.residuals(theta)
        parts, start = [], 0
        for part in self.data.parts:
            size = part.omega_rad_s.size
            both = residual[start : start + 2 * size]
            start += 2 * size
            # The projection has taken the ends of the record and leaves complex residuals in units of the old noise.
            power = (both[:size] ** 2 + both[size:] ** 2) * part.noise / 2.0
            parts.append(replace(part, noise=_smooth(power)))
        lost = 1.0 - (theta.size + (self.model.order.poles + 1) * len(parts)) / self.data.count
        parts = [replace(part, noise=part.noise / max(lost, 0.1)) for part in parts]
        return replace(self, data=self.data.with_parts(parts))


def _real(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])


def _basis(omega: FloatArray, poles: ComplexArray, sample_s: float, weight: FloatArray) -> FloatArray:
    """Orthonormal columns of what the ends of a record add through these poles, shape ``(2 f, n + 1)``."""
    turn = np.exp(-1j * omega * sample_s)
    below = np.prod(1.0 - np.exp(poles * sample_s)[:, None] * turn, axis=0)
    return _ends(omega, poles.size + 1, sample_s, weight / below)


def _ends(omega: FloatArray, count: int, sample_s: float, weight: FloatArray | ComplexArray) -> FloatArray:
    turn = np.exp(-1j * omega * sample_s)
    columns = np.stack([_real(np.asarray(weight * turn**k, dtype=np.complex128)) for k in range(count)], axis=1)
    return np.asarray(np.linalg.qr(columns)[0])


def _smooth(power: FloatArray) -> FloatArray:
    """Mean over neighboring lines, more of them at high frequencies."""
    line = np.arange(power.size)
    low = np.minimum((line + 1) / _SMOOTHING_RATIO, line + 1 - _SMOOTHING_BINS).astype(int)
    high = np.maximum((line + 1) * _SMOOTHING_RATIO, line + 1 + _SMOOTHING_BINS).astype(int)
    low, high = np.clip(low, 0, power.size - 1), np.clip(high, 1, power.size)
    total = np.concatenate([[0.0], np.cumsum(power)])
    mean = (total[high] - total[low]) / (high - low)
    return np.asarray(np.maximum(mean, 1e-12 * mean.max()))
