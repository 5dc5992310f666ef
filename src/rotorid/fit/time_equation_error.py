r"""Equation error on records: each equation of motion as a linear regression, in time or over a band of frequencies.

.. math:: \dot x = \sum_k \theta_k \, r_k(t - \tau_k) \qquad \text{or} \qquad
    \tilde{\dot x}(\omega) = \sum_k \theta_k \, \tilde r_k(\omega) \, e^{-j\omega\tau_k}

In the band nothing is differentiated, noise outside of the band does not count, and a delay of any fraction of a sample
is a turn of the phase. In time, the derivative comes from a measured acceleration or from local parabolas. Either way
noise in the regressors pulls their estimates toward zero, by its share of their power: these are values to start from,
and quick answers to which terms matter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fit.finite_transform import derivative_transform, finite_transform, late_transform
from rotorid.fit.regression import CONSTANT, Regression, regress
from rotorid.fit.stepwise import StepwiseRegression, stepwise
from rotorid.typing import ComplexArray, FloatArray

_LINES = 200
_SMOOTHING_S = 0.05
_SECTIONS = 24
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


class Domain(Protocol):
    """Where an equation is compared: rows of numbers for a channel, its derivative, and a constant."""

    @property
    def ordered(self) -> bool:
        """Whether rows follow each other in time."""

    def level(self, history: TimeHistory, name: str, delay_s: float) -> FloatArray:
        """The channel, late by a delay, shape ``(n,)``."""

    def slope(self, history: TimeHistory, name: str) -> FloatArray:
        """Its derivative, shape ``(n,)``."""

    def one(self, history: TimeHistory) -> FloatArray:
        """A constant, shape ``(n,)``."""


@dataclass(frozen=True, kw_only=True)
class InTime(Immutable):
    """Sample by sample.

    Parameters
    ----------
    smoothing_s
        Width of the local parabolas that give derivatives.
    longest_delay_s
        Samples left out at the start of each record, so that late regressors are known.
    """

    smoothing_s: float = _SMOOTHING_S
    longest_delay_s: float = 0.3
    ordered: bool = field(default=True, init=False)

    def level(self, history: TimeHistory, name: str, delay_s: float) -> FloatArray:
        """Samples, between them by straight lines."""
        index = np.arange(history.values.shape[1])
        late = np.interp(index - delay_s * history.sample_rate_hz, index, history[name])
        return np.asarray(late[self._kept(history)], dtype=np.float64)

    def slope(self, history: TimeHistory, name: str) -> FloatArray:
        """Slopes of parabolas through the samples around each."""
        from scipy.signal import savgol_filter

        width = 2 * max(1, round(0.5 * self.smoothing_s * history.sample_rate_hz)) + 1
        step_s = 1.0 / history.sample_rate_hz
        slopes = savgol_filter(history[name], max(width, 5), 2, deriv=1, delta=step_s)
        return np.asarray(slopes[self._kept(history)], dtype=np.float64)

    def one(self, history: TimeHistory) -> FloatArray:
        """Ones."""
        return np.ones(history.values.shape[1])[self._kept(history)]

    def _kept(self, history: TimeHistory) -> slice:
        return slice(int(np.ceil(self.longest_delay_s * history.sample_rate_hz)), None)


@dataclass(frozen=True, kw_only=True)
class InBand(Immutable):
    """Finite Fourier transforms over a band, real parts and then imaginary ones.

    Parameters
    ----------
    band_rad_s
        Lowest and highest frequency.
    longest_delay_s
        Start of each record that is left out, so that late regressors are known.
    """

    band_rad_s: tuple[float, float]
    longest_delay_s: float = 0.3
    ordered: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.band_rad_s[0] < self.band_rad_s[1] < np.inf:
            raise UsageError(f"the band {self.band_rad_s[0]:g}:{self.band_rad_s[1]:g} is empty", needed="0 < LO < HI")

    def level(self, history: TimeHistory, name: str, delay_s: float) -> FloatArray:
        """Transform of the channel, late by any fraction of a sample."""
        first, count = self._window(history)
        return _parts(
            late_transform(
                history[name],
                first=first,
                count=count,
                delay_s=delay_s,
                sample_rate_hz=history.sample_rate_hz,
                omega_rad_s=self._lines(history),
            )
        )

    def slope(self, history: TimeHistory, name: str) -> FloatArray:
        """Transform of the derivative, from that of the channel and its ends."""
        first, count = self._window(history)
        return _parts(
            derivative_transform(
                history[name][first : first + count],
                sample_rate_hz=history.sample_rate_hz,
                omega_rad_s=self._lines(history),
            )
        )

    def one(self, history: TimeHistory) -> FloatArray:
        """Transform of a constant over the window."""
        _, count = self._window(history)
        return _parts(
            finite_transform(np.ones(count), sample_rate_hz=history.sample_rate_hz, omega_rad_s=self._lines(history))
        )

    def _window(self, history: TimeHistory) -> tuple[int, int]:
        first = int(np.ceil(self.longest_delay_s * history.sample_rate_hz)) + 1
        return first, history.values.shape[1] - first

    def _lines(self, history: TimeHistory) -> FloatArray:
        """Frequencies no closer than the record tells apart."""
        low, high = self.band_rad_s
        duration_s = self._window(history)[1] / history.sample_rate_hz
        told_apart = int((high - low) * duration_s / (2.0 * np.pi))
        if told_apart < 2 or high > np.pi * history.sample_rate_hz:
            raise InsufficientDataError(
                f"a record of {duration_s:.3g} s at {history.sample_rate_hz:.4g} Hz came for {low:g} to {high:g} rad/s",
                needed="a band below the Nyquist frequency in which the record tells frequencies apart",
                remedy="choose another band or a longer record",
            )
        return np.linspace(low, high, min(told_apart + 1, _LINES))


def equation_error(
    histories: Sequence[TimeHistory],
    target: str,
    regressors: Sequence[str],
    *,
    domain: Domain,
    measured: bool = False,
    delays_s: Mapping[str, float] | None = None,
    constant: bool = True,
) -> Regression:
    """Regression of one equation of motion on several records together.

    Parameters
    ----------
    histories
        Records.
    target
        State whose derivative stands on the left; with ``measured`` the channel itself, such as ``q_dot`` or ``ax``.
    regressors
        Channels on the right.
    domain
        :class:`InTime` or :class:`InBand`.
    measured
        Whether the target is the left side itself and not to be differentiated.
    delays_s
        Delay of a regressor; zero for those not named. Fractions of a sample are exact in the band.
    constant
        Add a constant, one for all records.

    Raises
    ------
    InsufficientDataError
        Regressors cannot be told apart, or the records are too short.
    UsageError
        A channel is not in a record, or a delay is longer than the domain allows.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, chapters 5 and 7.
    """
    matrix, left, names = _equation(histories, target, regressors, domain, measured, delays_s or {}, constant)
    return regress(matrix, left, names, constant=False, ordered=domain.ordered and len(histories) == 1)


def stepwise_equation_error(
    histories: Sequence[TimeHistory],
    target: str,
    candidates: Sequence[str],
    *,
    domain: Domain,
    measured: bool = False,
    delays_s: Mapping[str, float] | None = None,
    keep: Sequence[str] = (),
) -> StepwiseRegression:
    """The terms that one equation of motion needs, of many; arguments as for :func:`equation_error`.

    Parameters
    ----------
    histories, target, domain, measured, delays_s
        As for :func:`equation_error`.
    candidates
        Channels that may stand on the right; a constant always does.
    keep
        Candidates that stand there in any case.
    """
    matrix, left, names = _equation(histories, target, candidates, domain, measured, delays_s or {}, True)
    return stepwise(
        matrix,
        left,
        names,
        keep=(CONSTANT, *keep),
        constant=False,
        ordered=domain.ordered and len(histories) == 1,
    )


def best_delay(
    histories: Sequence[TimeHistory],
    target: str,
    regressors: Sequence[str],
    *,
    delayed: Sequence[str],
    domain: Domain,
    longest_s: float = 0.3,
    measured: bool = False,
) -> tuple[float, Regression]:
    """The delay that some regressors share with which the equation fits best, and the regression there.

    On a grid of 24 first, and between its points by golden section.

    Parameters
    ----------
    histories, target, regressors, domain, measured
        As for :func:`equation_error`.
    delayed
        Regressors that are late, commands as a rule.
    longest_s
        Longest delay to try.
    """

    def fit(delay_s: float) -> Regression:
        late = dict.fromkeys(delayed, delay_s)
        return equation_error(histories, target, regressors, domain=domain, measured=measured, delays_s=late)

    def misfit(delay_s: float) -> float:
        residual = fit(delay_s).residual
        return float(residual @ residual)

    grid = np.linspace(0.0, longest_s, _SECTIONS + 1)
    lowest = min(grid.tolist(), key=misfit)
    found = _golden_section(misfit, max(lowest - grid[1], 0.0), min(lowest + grid[1], longest_s))
    return found, fit(found)


def _equation(
    histories: Sequence[TimeHistory],
    target: str,
    regressors: Sequence[str],
    domain: Domain,
    measured: bool,
    delays_s: Mapping[str, float],
    constant: bool,
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Rows of all records below each other: right sides ``(n, p)``, left side ``(n,)``, names."""
    if not histories:
        raise InsufficientDataError("no record came", needed="at least one")
    for name in (target, *regressors, *delays_s):
        if any(name not in history.names for history in histories):
            raise UsageError(f"there is no channel {name}", needed=f"some of {', '.join(histories[0].names)}")
    blocks, lefts = [], []
    for history in histories:
        columns = [domain.level(history, name, delays_s.get(name, 0.0)) for name in regressors]
        blocks.append(np.stack([*columns, *([domain.one(history)] if constant else [])], axis=1))
        lefts.append(domain.level(history, target, 0.0) if measured else domain.slope(history, target))
    return np.concatenate(blocks), np.concatenate(lefts), (*regressors, *([CONSTANT] if constant else []))


def _parts(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])


def _golden_section(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function with one valley is smallest, to a hundred-thousandth of the distance."""
    inner, outer = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_inner, at_outer = function(inner), function(outer)
    for _ in range(_SECTIONS):
        if at_inner <= at_outer:
            high, outer, at_outer = outer, inner, at_inner
            inner = high - _GOLDEN * (high - low)
            at_inner = function(inner)
        else:
            low, inner, at_inner = inner, outer, at_outer
            outer = low + _GOLDEN * (high - low)
            at_outer = function(outer)
    return 0.5 * (low + high)
