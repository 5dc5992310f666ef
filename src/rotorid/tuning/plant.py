r"""An identified plant with all that is not known of it, as draws that a loop has to hold for.

.. math:: P_k(j\omega) = \hat P(j\omega) \exp\bigl(\varepsilon_k(\ln\omega)\bigr)

The covariance of the parameters is not enough: it foretells margins of true plants in half of the cases, since
structure is what fails. So the measured response has its say. :math:`\varepsilon` is a smooth complex Gaussian process
over :math:`\ln\omega`, known through :math:`\ln(\text{measured}/\hat P)` with the errors of the measurement *and their
covariance between frequencies*: inside the band a draw is the measured response, outside it returns to the model.
Beside it stand a floor, since real vehicles have structure that no short flight shows, and outside of the band an error
that grows with the distance from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.typing import ComplexArray, FloatArray

LENGTH = 0.5
"""Over which distance in ln ω the misfit of a model changes."""

_LEAST_MISFIT, _LARGEST_MISFIT = 0.02, 0.5

DRAWS = 200
"""Of a plant, by which every command states its loop. With 50, margins of equal plants differ by 1 %."""

FLOOR = 0.02
"""Share of the plant that is not known anywhere: 2 % of gain and 1.2° of phase."""

BEYOND_RATIO = 6.0
"""How far beyond the band a model that explains the measurement is followed, over the end of the band."""

KNOWN_FROM = 1.5
"""Stability is counted from this multiple of the lower end of the band: below it identified plants carry modes of the
speed, with which good loops are unstable in every draw."""

_ABOVE = 2.0
"""Over the frequency of an unstable mode of the speed: from there up it turns the phase of a rate by less than 7
degrees."""

_OUTSIDE_PER_E_FOLD = 0.15
_KNOTS = 61
_LEAST_RAD_S, _MOST_RAD_S = 0.1, 3000.0
_JITTER = 1e-9

_INDEPENDENT = 0.1
"""Share of the variance of a measured point that its neighbors do not have. Errors of neighbors from one window are
alike to some .99, so that their covariance is almost singular: without a share of its own the smallest wiggle between
them counts as known for certain and is carried far, by 40 % of gain within half an octave."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredRatio(Immutable):
    """A measured response over that of the model.

    Parameters
    ----------
    omega_rad_s
        Where the measurement is trusted, shape ``(f,)``, rising.
    ratio
        Measured over modeled, shape ``(f,)``.
    covariance
        Of the relative errors of the measurement between frequencies, shape ``(f, f)``.
    """

    omega_rad_s: FloatArray
    ratio: ComplexArray
    covariance: ComplexArray

    def __post_init__(self) -> None:
        self._set(
            omega_rad_s=read_only(self.omega_rad_s, np.float64, ndim=1),
            ratio=read_only(self.ratio, np.complex128, ndim=1),
            covariance=read_only(self.covariance, np.complex128, ndim=2),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class UncertainPlant(Immutable):
    r"""A plant and draws of it.

    Parameters
    ----------
    model
        Its response by frequencies in rad/s, shape ``(f,)`` to shape ``(f,)``.
    band_rad_s
        Where it was measured.
    knots
        :math:`\ln\omega` at which the misfit is known, shape ``(n,)``.
    mean
        What the measurement says of the misfit there, shape ``(n,)``.
    misfits
        Draws of it, shape ``(draws, n)``.
    goes_on
        Whether the model explains the measurement, and may be followed beyond the band.
    above_rad_s
        Frequency of modes of the speed that are known to be unstable. The outer loops hold them: from twice that
        frequency down the rate goes on as the integral of its command, as that of a rate model does.
    """

    model: Callable[[FloatArray], ComplexArray]
    band_rad_s: tuple[float, float]
    knots: FloatArray
    mean: ComplexArray
    misfits: ComplexArray
    goes_on: bool = True
    above_rad_s: float = 0.0

    def __post_init__(self) -> None:
        self._set(
            knots=read_only(self.knots, np.float64, ndim=1),
            mean=read_only(self.mean, np.complex128, ndim=1),
            misfits=read_only(self.misfits, np.complex128, ndim=2),
        )

    @property
    def known_from_rad_s(self) -> float:
        """Frequency from which its loops are counted, see :func:`rotorid.tuning.loops.loop_figures`."""
        return KNOWN_FROM * self.band_rad_s[0]

    @property
    def reach_rad_s(self) -> float:
        """Frequency up to which anything is said of its loops."""
        return self.band_rad_s[1] * (BEYOND_RATIO if self.goes_on else 1.0)

    @property
    def draws(self) -> int:
        """How many plants were drawn."""
        return int(self.misfits.shape[0])

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """The most likely plant, shape ``(f,)``."""
        return np.asarray(self._rows(self.mean[None], omega_rad_s)[0])

    def drawn(self, omega_rad_s: FloatArray) -> ComplexArray:
        """All plants, shape ``(draws, f)``."""
        return self._rows(self.misfits, omega_rad_s)

    def _rows(self, misfits: ComplexArray, omega_rad_s: FloatArray) -> ComplexArray:
        r"""Plants with some misfits, shape ``(rows, f)``; below :math:`\omega_0` their phase returns to -90 degrees."""
        first = _ABOVE * self.above_rad_s
        omega = np.maximum(omega_rad_s, first)
        rows = np.asarray(self.model(omega) * np.exp(self._at(misfits, omega)))
        if not first:
            return rows
        share = np.minimum(omega_rad_s / first, 1.0)
        # Twice the angle leaves the sign of the gain out.
        off_rad = 0.5 * np.angle(-(rows**2))
        return np.asarray(rows / share * np.exp(-1j * off_rad * (1.0 - share)))

    def _at(self, rows: ComplexArray, omega_rad_s: FloatArray) -> ComplexArray:
        """Rows between their knots; constant beyond them."""
        place = np.interp(np.log(np.maximum(omega_rad_s, 1e-12)), self.knots, np.arange(self.knots.size))
        low = np.clip(place.astype(int), 0, self.knots.size - 2)
        share = place - low
        return np.asarray(rows[:, low] * (1.0 - share) + rows[:, low + 1] * share)


def uncertain_plant(
    model: Callable[[FloatArray], ComplexArray],
    measured: MeasuredRatio | None,
    *,
    band_rad_s: tuple[float, float],
    draws: int = DRAWS,
    seed: int = 0,
    floor: float = FLOOR,
    relative_std: Callable[[FloatArray], FloatArray] | None = None,
) -> UncertainPlant:
    """A plant with draws of what is not known of it.

    Parameters
    ----------
    model
        Its response by frequencies in rad/s.
    measured
        The measured response over that of the model, ``None`` where none is at hand: then the misfit is as large as the
        floor and what the parameters say.
    band_rad_s
        Where the model was fitted.
    draws, seed
        How many plants are drawn, and the seed of the draws.
    floor
        Relative error that is assumed everywhere.
    relative_std
        Relative error of the model by its parameters, by frequency; counts where nothing was measured.

    Examples
    --------
    >>> plant = uncertain_plant(lambda w: 100.0 / (1j * w * (1.0 + 0.05j * w)), None, band_rad_s=(1.0, 100.0))
    >>> w = np.array([10.0])
    >>> spread = np.std(np.log(np.abs(plant.drawn(w) / plant.response(w))))
    >>> bool(0.01 < spread < 0.04)
    True
    """
    knots = np.linspace(np.log(_LEAST_RAD_S), np.log(_MOST_RAD_S), _KNOTS)
    rng = np.random.default_rng(seed)
    if measured is None or measured.omega_rad_s.size < 3:
        mean = np.zeros(knots.size, dtype=np.complex128)
        spread = np.zeros((draws, knots.size), dtype=np.complex128)
        if relative_std is not None:
            sizes = np.interp(knots, np.log(_grid(band_rad_s)), relative_std(_grid(band_rad_s)))
            spread = sizes * _smooth(knots, rng, draws)
    else:
        mean, spread = _posterior(knots, measured, rng, draws)
    outside = np.maximum(np.log(band_rad_s[0]) - knots, 0.0), np.maximum(knots - np.log(band_rad_s[1]), 0.0)
    for distance in outside:
        spread = spread + _OUTSIDE_PER_E_FOLD * distance * _complex(rng, (draws, 1))
    spread = spread + floor * _smooth(knots, rng, draws)
    return UncertainPlant(model=model, band_rad_s=band_rad_s, knots=knots, mean=mean, misfits=mean + spread)


def certain_plant(model: Callable[[FloatArray], ComplexArray], *, lowest_rad_s: float = _LEAST_RAD_S) -> UncertainPlant:
    """A plant that is known exactly, as one draw.

    Parameters
    ----------
    model
        Its response by frequencies in rad/s.
    lowest_rad_s
        Lower end of the band in which it counts as known; below it modes of the speed may act.
    """
    knots = np.log([_LEAST_RAD_S, _MOST_RAD_S])
    none = np.zeros(knots.size, dtype=np.complex128)
    return UncertainPlant(
        model=model, band_rad_s=(lowest_rad_s, _MOST_RAD_S), knots=knots, mean=none, misfits=none[None]
    )


def _grid(band_rad_s: tuple[float, float]) -> FloatArray:
    return np.geomspace(*band_rad_s, 40)


def _complex(rng: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
    """Standard normal in both parts, which are gain and phase."""
    return np.asarray(rng.standard_normal(shape) + 1j * rng.standard_normal(shape))


def _kernel(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.exp(-0.5 * ((one[:, None] - other[None]) / LENGTH) ** 2)


def _smooth(knots: FloatArray, rng: np.random.Generator, draws: int) -> ComplexArray:
    """Smooth processes of unit variance in gain and in phase, shape ``(draws, n)``."""
    root = np.linalg.cholesky(_kernel(knots, knots) + 1e-8 * np.eye(knots.size))
    return np.asarray(_complex(rng, (draws, knots.size)) @ root.T)


def _posterior(
    knots: FloatArray, measured: MeasuredRatio, rng: np.random.Generator, draws: int
) -> tuple[ComplexArray, ComplexArray]:
    """Mean and draws of the misfit given the measurement; gain and phase are alike and independent."""
    at, misfit = np.log(measured.omega_rad_s), np.log(np.abs(measured.ratio)) + 1j * np.unwrap(np.angle(measured.ratio))
    misfit = misfit - 2j * np.pi * np.round(np.median(misfit.imag) / (2.0 * np.pi))
    # Of a circular complex error half the variance lies in each part.
    noise = 0.5 * np.real(measured.covariance)
    size = float(np.clip(np.sqrt(np.mean(np.abs(misfit) ** 2) / 2.0), _LEAST_MISFIT, _LARGEST_MISFIT))
    prior = size**2 * _kernel(at, at) + noise
    prior[np.diag_indices_from(prior)] += _JITTER + 1e-6 * size**2 + _INDEPENDENT * np.diag(noise)
    across = size**2 * _kernel(knots, at)
    gain = np.linalg.solve(prior, across.T).T
    covariance = size**2 * _kernel(knots, knots) - gain @ across.T
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(gain @ misfit), np.asarray(_complex(rng, (draws, knots.size)) @ root.T)
