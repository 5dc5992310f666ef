r"""The loops around a plant for any gains of a controller, and what they do: margins, rejection, steps.

A controller is linear in P, I and D, and its angle loop is their answer to the set-point times A:

.. math:: L_{rate} = \hat P\, C_y F_\omega / F_{log}, \qquad L_{whole} = L_{rate} + \hat P\, C_r A F_a / (s F_{log})

Both are broken at the command. The first is what rate modes fly, the second what a hover in attitude flies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.models.controller import RateController
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.noise import RateNoise
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray, LoopName

GRID = 170
HIGHEST_RAD_S = KINDS["roll"].highest_rad_s
_BELOW_NYQUIST = 0.9

DISTURBANCE_RAD_S = KINDS["roll"].disturbance_rad_s
"""Corner of the moment against which an attitude is held."""

_MINUS_3_DB = 10.0 ** (-3.0 / 20.0)

_MOST_LEAD_RAD = float(np.radians(30.0))
"""Phase by which a loop of a vehicle may lead at the lowest frequency that counts; it lags by less than 330 degrees."""


@dataclass(frozen=True, kw_only=True)
class Gains(Immutable):
    """Gains of one loop in SI: P and D of the rate (velocity), I of its integral, A of the angle (position)."""

    P: float
    I: float  # noqa: E741 - as everybody calls it
    D: float
    A: float

    @classmethod
    def of(cls, controller: RateController) -> Gains:
        """Those of a controller."""
        return cls(
            P=controller.proportional_s,
            I=controller.integral,
            D=controller.derivative_s2,
            A=controller.angle_1_s,
        )

    def on(self, controller: RateController) -> RateController:
        """A controller with these gains and the filters of another one."""
        return replace(controller, proportional_s=self.P, integral=self.I, derivative_s2=self.D, angle_1_s=self.A)

    def as_dict(self) -> dict[str, float]:
        """By their names."""
        return {"P": self.P, "I": self.I, "D": self.D, "A": self.A}


def frequency_grid(controller: RateController, loop: LoopName = "roll") -> FloatArray:
    """Frequencies on which a loop is looked at, below half the rate of its controller, rad/s.

    Parameters
    ----------
    controller
        Whose step counts.
    loop
        Kind of loop, which has its own ends.
    """
    kind = KINDS[loop]
    highest = kind.highest_rad_s
    if controller.step_s > 0.0:
        highest = min(highest, _BELOW_NYQUIST * np.pi / controller.step_s)
    return np.geomspace(kind.lowest_rad_s, highest, GRID)


_NONE = 1e-15


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerParts(Immutable):
    """What each gain of a controller does, by frequency.

    Parameters
    ----------
    controller
        Whose filters and steps count.
    omega_rad_s
        Shape ``(f,)``.
    filters, logged
        Filters in front of the rate that the controller takes, and in front of the rate in the log, shape ``(f,)``.
    rate_noise
        Density of the noise of the logged rate, (rad/s)² per rad/s, shape ``(f,)``; ``None`` where the log does not
        show it: then it is taken for white, and noises of gains can be compared only.
    gyro_noise
        Noise of the rate that the controller takes, over the whole spectrum of the gyro, where the log shows it: it
        goes before ``rate_noise``.
    disturbance_rad_s
        Corner of the moment, or of the force, against which the attitude, or the place, is held.
    """

    controller: RateController
    omega_rad_s: FloatArray
    filters: ComplexArray
    logged: ComplexArray
    rate_noise: FloatArray | None = None
    gyro_noise: RateNoise | None = None
    disturbance_rad_s: float = DISTURBANCE_RAD_S

    def attitude_rms(self, plants: ComplexArray, loops: ComplexArray) -> FloatArray:
        """See :func:`attitude_rms`, for the disturbance of this loop."""
        return attitude_rms(self.omega_rad_s, plants, loops, corner_rad_s=self.disturbance_rad_s)

    def noise(self, gains: Gains) -> float:
        """Root mean square of the command that the noise of the rate makes."""
        if self._noise_by_gain is not None:
            of_p, of_both, of_d = self._noise_by_gain
            return float(np.sqrt(gains.P**2 * of_p + 2.0 * gains.P * gains.D * of_both + gains.D**2 * of_d))
        density = np.ones(self.omega_rad_s.size) if self.rate_noise is None else self.rate_noise
        return float(np.sqrt(np.trapezoid(density * np.abs(self.rate(gains)) ** 2, self.omega_rad_s)))

    @cached_property
    def _noise_by_gain(self) -> tuple[float, float, float] | None:
        if self.gyro_noise is None:
            return None
        of_p, of_both, of_d = self.gyro_noise.of_command(self.controller)
        return float(of_p.sum()), float(of_both.real.sum()), float(of_d.sum())

    @property
    def shows_noise(self) -> bool:
        """Whether noise is in units of the command, and not only a ratio."""
        return self.gyro_noise is not None or self.rate_noise is not None

    def rate(self, gains: Gains) -> ComplexArray:
        """Command by the logged rate without the angle loop, shape ``(f,)``."""
        return np.asarray(gains.P * self.by_rate["P"] + gains.I * self.by_rate["I"] + gains.D * self.by_rate["D"])

    def angle(self, gains: Gains) -> ComplexArray:
        """What the angle loop adds, shape ``(f,)``."""
        inside = gains.P * self.by_angle["P"] + gains.I * self.by_angle["I"] + gains.D * self.by_angle["D"]
        return np.asarray(gains.A * (inside + self.by_angle["ahead"]))

    def whole(self, gains: Gains) -> ComplexArray:
        """Command by the logged rate with the angle loop, shape ``(f,)``."""
        return self.rate(gains) + self.angle(gains)

    def _single_gain(self, name: str, *, ahead: bool = False) -> RateController:
        ones = {"P": 0.0, "I": 0.0, "D": 0.0} | ({name: 1.0} if name else {})
        # A controller without any gain is none; what a vanishing one adds is taken off by nobody.
        ones["P"] = ones["P"] or _NONE
        return replace(
            self.controller,
            proportional_s=ones["P"],
            integral=ones["I"],
            derivative_s2=ones["D"],
            angle_1_s=1.0,
            feedforward=self.controller.feedforward if ahead else 0.0,
            feedforward_derivative_s=self.controller.feedforward_derivative_s if ahead else 0.0,
        )

    @cached_property
    def by_rate(self) -> Mapping[str, ComplexArray]:
        """Command by the logged rate of one unit of ``P``, ``I`` and ``D`` each."""
        return {
            name: np.asarray(
                replace(self._single_gain(name), angle_1_s=0.0).response(self.omega_rad_s, self.filters) / self.logged
            )
            for name in "PID"
        }

    @cached_property
    def by_angle(self) -> Mapping[str, ComplexArray]:
        """What an angle gain of one adds by one unit of ``P``, ``I`` and ``D`` each, and ``ahead`` of them all."""
        single_gains = {name: self._of_angle(self._single_gain(name)) for name in "PID"}
        return single_gains | {"ahead": self._of_angle(self._single_gain("", ahead=True))}

    def _of_angle(self, controller: RateController) -> ComplexArray:
        s = 1j * self.omega_rad_s
        late = np.exp(-s * controller.delay_s)
        return np.asarray(controller.angle_response(self.omega_rad_s) / s * late / self.logged)


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopFigures(Immutable):
    """Figures of loops, each of shape ``(draws,)``; not a number where a loop does not show it.

    Parameters
    ----------
    crossover_rad_s
        Highest frequency at which the loop has the gain one.
    phase_margin_rad
        Least phase above -180 degrees at any crossover, on the branch of :func:`loop_phases`.
    gain_margin
        Factor by which the gain may grow; infinite where the phase never falls so far.
    lower_gain_margin
        Factor to which the gain may fall; zero where it may vanish.
    delay_margin_s
        Delay that it bears: least phase margin over crossover.
    sensitivity_peak
        Largest of the sensitivity, M_s.
    rejection_bandwidth_rad_s
        Frequency up to which the sensitivity stays below -3 dB.
    stable
        One where the closed loop is stable, else zero. The other figures of an unstable loop are no margins.
    gain_margin_rad_s, lower_gain_margin_rad_s, sensitivity_peak_rad_s
        Frequencies at which these are read; not a number where nothing is.
    """

    crossover_rad_s: FloatArray
    phase_margin_rad: FloatArray
    gain_margin: FloatArray
    lower_gain_margin: FloatArray
    delay_margin_s: FloatArray
    sensitivity_peak: FloatArray
    rejection_bandwidth_rad_s: FloatArray
    stable: FloatArray
    gain_margin_rad_s: FloatArray
    lower_gain_margin_rad_s: FloatArray
    sensitivity_peak_rad_s: FloatArray

    @property
    def as_flown(self) -> LoopFigures:
        """Those of the stable draws, since a loop that flew was stable; all of them where none is."""
        kept = self.stable > 0.0
        if kept.all() or not kept.any():
            return self
        return LoopFigures(**{item.name: getattr(self, item.name)[kept] for item in fields(self)})

    @property
    def usual_crossover_rad_s(self) -> float:
        """Median over the draws that have one; zero where no loop reaches the gain one."""
        found = self.crossover_rad_s[np.isfinite(self.crossover_rad_s)]
        return float(np.median(found)) if found.size else 0.0


def loop_figures(omega_rad_s: FloatArray, loops: ComplexArray, *, from_rad_s: float = 0.0) -> LoopFigures:
    r"""Figures of broken loops.

    A closed loop is stable where 1 + L does not wind around zero. From :math:`\omega_0` to the highest frequency its
    phase turns by :math:`-\angle L(\omega_0)`, within half a turn: the rest is what the integrals of the loop make
    below. Crossings of the negative real axis beyond -1 are counted, which is the same.

    Assumes a plant and a controller whose own poles are stable or at zero, and a loop that is known from
    :math:`\omega_0` on and falls below one at the highest frequency. Poles of slow speed modes above :math:`\omega_0`
    break it: a good loop is called unstable then.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``, rising.
    loops
        Shape ``(draws, f)``.
    from_rad_s
        :math:`\omega_0`, from which crossings count; the lowest frequency of an exact loop. Of an identified one
        :attr:`rotorid.tuning.plant.UncertainPlant.known_from_rad_s`.

    Examples
    --------
    >>> w = np.geomspace(0.1, 300.0, 600)
    >>> found = loop_figures(w, (10.0 / (1j * w) * np.exp(-0.02j * w))[None])
    >>> round(float(found.crossover_rad_s[0]), 2), round(float(np.degrees(found.phase_margin_rad[0])), 1)
    (10.0, 78.5)
    >>> round(float(found.gain_margin[0]), 2), round(float(found.sensitivity_peak[0]), 2)
    (7.85, 1.19)

    A loop whose phase never rises above -180 degrees is unstable, however small its peak:

    >>> triple = loop_figures(w, (20.0 / (1j * w) ** 2 / (1.0 + 0.05j * w))[None])
    >>> float(triple.stable[0]), round(float(np.degrees(triple.phase_margin_rad[0])))
    (0.0, -12)
    """
    loops = np.atleast_2d(loops)
    start = first_counted(omega_rad_s, from_rad_s)
    return _figures_of(omega_rad_s, loops, loop_phases(loops, start), start)


def first_counted(omega_rad_s: FloatArray, from_rad_s: float) -> int:
    """Index of the first frequency from which stability counts; the last but one at most."""
    return min(int(np.searchsorted(omega_rad_s, from_rad_s)), omega_rad_s.size - 2)


def loop_phases(loops: ComplexArray, start: int) -> FloatArray:
    """Continuous phases of loops, shape ``(draws, f)``, that lie in (-330, 30] degrees at one frequency.

    A loop of a vehicle has at most three integrals there (of the rate, of the controller, of the angle), so it lags by
    270 degrees at most, and delays add a little. The highest phase says nothing of the branch: a loop that never rises
    above -180 degrees would be shifted by a whole turn, and an unstable one would be called stable.

    Parameters
    ----------
    loops
        Shape ``(draws, f)``.
    start
        Index of that frequency.
    """
    phases = _unwrapped(np.angle(loops))
    turns = np.ceil((phases[:, start] - _MOST_LEAD_RAD) / (2.0 * np.pi))
    return np.asarray(phases - 2.0 * np.pi * turns[:, None])


def _unwrapped(angles: FloatArray) -> FloatArray:
    """Angles ``(draws, f)`` without jumps, as ``np.unwrap`` gives them: a search asks for them thousands of times."""
    turns = np.cumsum(np.rint(np.diff(angles, axis=1) / (2.0 * np.pi)), axis=1)
    whole: FloatArray = angles.copy()
    whole[:, 1:] -= 2.0 * np.pi * turns
    return whole


@dataclass(frozen=True, kw_only=True, eq=False)
class AttitudeFigures(Immutable):
    """How an attitude follows its set-point, after ADS-33, each of shape ``(draws,)``.

    Parameters
    ----------
    bandwidth_rad_s
        Where the phase falls through -135 degrees.
    phase_delay_s
        How steeply it falls beyond -180 degrees, from there to twice that frequency, over two.
    """

    bandwidth_rad_s: FloatArray
    phase_delay_s: FloatArray


def attitude_figures(omega_rad_s: FloatArray, closed: ComplexArray) -> AttitudeFigures:
    """Bandwidth and phase delay of attitudes over their set-points, shape ``(draws, f)``.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``, rising.
    closed
        The responses, shape ``(draws, f)`` or ``(f,)``.

    Examples
    --------
    >>> w = np.geomspace(0.1, 300.0, 600)
    >>> found = attitude_figures(w, np.exp(-0.1j * w)[None])
    >>> round(float(found.bandwidth_rad_s[0]), 1), round(float(found.phase_delay_s[0]), 3)
    (23.6, 0.05)
    """
    ln, phases = np.log(omega_rad_s), np.unwrap(np.angle(np.atleast_2d(closed)))
    bandwidths, half_turns = (_first_fall(ln, phases, level) for level in (-0.75 * np.pi, -np.pi))
    beyond = [
        np.interp(np.log(2.0 * half_turn), ln, phase, right=np.nan) if np.isfinite(half_turn) else np.nan
        for half_turn, phase in zip(half_turns, phases, strict=True)
    ]
    return AttitudeFigures(bandwidth_rad_s=bandwidths, phase_delay_s=-(np.array(beyond) + np.pi) / (2.0 * half_turns))


def _first_fall(ln: FloatArray, phases: FloatArray, level: float) -> FloatArray:
    """Lowest frequency at which each phase passes a level."""
    falls = _Crossings.of(ln, phases, level)
    rows, first = falls.first_by(falls.ln)
    return _spread(len(phases), rows, falls.rad_s[first], np.nan)


_DEG = float(np.degrees(1.0))
_DECIBELS = 0.0
_FIGURES: Mapping[str, tuple[str, str, float]] = {
    "crossover_rad_s": ("crossover_rad_s", "rad/s", 1.0),
    "phase_margin_deg": ("phase_margin_rad", "deg", _DEG),
    "gain_margin_db": ("gain_margin", "dB", _DECIBELS),
    "delay_margin_s": ("delay_margin_s", "s", 1.0),
    "sensitivity_peak": ("sensitivity_peak", "1", 1.0),
    "rejection_bandwidth_rad_s": ("rejection_bandwidth_rad_s", "rad/s", 1.0),
    "rejection_peak_db": ("sensitivity_peak", "dB", _DECIBELS),
    "attitude_bandwidth_rad_s": ("bandwidth_rad_s", "rad/s", 1.0),
    "phase_delay_s": ("phase_delay_s", "s", 1.0),
}
_LEAST_SHARE = 0.5


def quantities(figures: LoopFigures | AttitudeFigures) -> dict[str, Quantity]:
    """Figures as numbers with intervals of 95 % over the draws; one that half of the draws do not show is left out.

    Parameters
    ----------
    figures
        Over the draws of a plant.

    Examples
    --------
    >>> w = np.geomspace(0.1, 300.0, 600)
    >>> loops = np.array([9.5, 10.0, 10.5])[:, None] / (1j * w) * np.exp(-0.02j * w)
    >>> crossover = quantities(loop_figures(w, loops))["crossover_rad_s"]
    >>> round(crossover.value, 1), round(crossover.lower, 2), round(crossover.upper, 2)
    (10.0, 9.53, 10.47)
    """
    found = {}
    for name, (field, unit, factor) in _FIGURES.items():
        if not hasattr(figures, field):
            continue
        values = np.asarray(getattr(figures, field), dtype=np.float64)
        values = values[np.isfinite(values)]
        if values.size > _LEAST_SHARE * len(getattr(figures, field)):
            found[name] = over_draws(20.0 * np.log10(values) if factor == _DECIBELS else factor * values, unit)
    return found


def over_draws(values: FloatArray, unit: str) -> Quantity:
    """Median of draws with their interval of 95 %."""
    low, middle, high = np.quantile(values, (0.025, 0.5, 0.975))
    return Quantity(value=float(middle), std=float(np.std(values)), lower=float(low), upper=float(high), unit=unit)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Crossings:
    """Places at which curves of several draws pass a level, draw by draw, each rising in frequency.

    Parameters
    ----------
    draws
        How many there are.
    row
        Draw of each crossing.
    left
        Index of the frequency in front of it.
    ln
        Logarithm of its own frequency.
    step
        From that of the frequency in front of it, as a share of the way to the next one.
    """

    draws: int
    row: IntArray
    left: IntArray
    ln: FloatArray
    step: FloatArray

    @classmethod
    def of(cls, ln: FloatArray, values: FloatArray, level: float) -> _Crossings:
        """Those of curves of shape ``(draws, f)`` over the logarithms of their frequencies."""
        over = values - level
        # A bound of the search puts a crossing right on a point: it lies below the level, and counts once.
        above = over > 0.0
        row, left = np.nonzero(above[:, :-1] != above[:, 1:])
        step = over[row, left] / (over[row, left] - over[row, left + 1])
        return cls(draws=len(values), row=row, left=left, ln=ln[left] + step * (ln[left + 1] - ln[left]), step=step)

    def of_other(self, values: FloatArray) -> FloatArray:
        """Another curve of each draw at the crossings."""
        before, after = values[self.row, self.left], values[self.row, self.left + 1]
        return np.asarray(before + self.step * (after - before))

    @property
    def rad_s(self) -> FloatArray:
        """Frequencies."""
        return np.exp(self.ln)

    def where(self, chosen: BoolArray) -> _Crossings:
        """Some of them."""
        parts = {name: getattr(self, name)[chosen] for name in ("row", "left", "ln", "step")}
        return _Crossings(draws=self.draws, **parts)

    def least(self, values: FloatArray) -> FloatArray:
        """Least of values at the crossings of each draw; infinite where it has none."""
        found = np.full(self.draws, np.inf)
        np.minimum.at(found, self.row, values)
        return found

    def first_by(self, order: FloatArray) -> tuple[IntArray, IntArray]:
        """Draws that have crossings, and of each the crossing that comes first in an order."""
        sorted_by = np.lexsort((order, self.row))
        rows, first = np.unique(self.row[sorted_by], return_index=True)
        return rows, sorted_by[first]


def _spread(draws: int, rows: IntArray, values: FloatArray, missing: float) -> FloatArray:
    """Values of some draws among all."""
    found = np.full(draws, missing)
    found[rows] = values
    return found


def _figures_of(omega: FloatArray, loops: ComplexArray, phases: FloatArray, start: int) -> LoopFigures:
    draws = len(loops)
    ln, gains = np.log(omega), np.log(np.abs(loops))
    ones = _Crossings.of(ln, gains, 0.0)
    margins = np.pi + ones.of_other(phases)
    with_one, highest = ones.first_by(-ones.ln)
    half_turns = _Crossings.of(ln, phases, -np.pi)
    at_half_turns = half_turns.of_other(gains)
    above = at_half_turns < 0.0
    up, up_at = _factor_to_critical(half_turns.where(above), at_half_turns[above], missing=np.inf)
    down, down_at = _factor_to_critical(half_turns.where(~above), at_half_turns[~above], missing=0.0)
    sensitivity = 1.0 / np.abs(1.0 + loops)
    peak = sensitivity.argmax(axis=1)
    return LoopFigures(
        crossover_rad_s=_spread(draws, with_one, ones.rad_s[highest], np.nan),
        phase_margin_rad=_spread(draws, with_one, ones.least(margins)[with_one], np.nan),
        gain_margin=up,
        lower_gain_margin=down,
        delay_margin_s=_spread(draws, with_one, ones.least(margins / ones.rad_s)[with_one], np.nan),
        sensitivity_peak=sensitivity.max(axis=1),
        rejection_bandwidth_rad_s=_bandwidth(omega, sensitivity),
        stable=_stable(gains[:, start:], phases[:, start:]).astype(np.float64),
        gain_margin_rad_s=up_at,
        lower_gain_margin_rad_s=down_at,
        # What still rises at the highest frequency has its peak somewhere else.
        sensitivity_peak_rad_s=np.where(peak < omega.size - 1, omega[peak], np.nan),
    )


def _factor_to_critical(places: _Crossings, gains: FloatArray, *, missing: float) -> tuple[FloatArray, FloatArray]:
    """The factor that brings each loop to -1 where the least is needed, and the frequency there."""
    rows, least = places.first_by(np.abs(gains))
    factors = _spread(places.draws, rows, np.exp(-gains[least]), missing)
    return factors, _spread(places.draws, rows, places.rad_s[least], np.nan)


def _bandwidth(omega: FloatArray, sensitivity: FloatArray) -> FloatArray:
    beyond = sensitivity > _MINUS_3_DB
    first = beyond.argmax(axis=1)
    rows = np.flatnonzero(first > 0)
    last = first[rows]
    before, after = sensitivity[rows, last - 1], sensitivity[rows, last]
    share = (_MINUS_3_DB - before) / (after - before)
    return _spread(len(sensitivity), rows, omega[last - 1] + share * (omega[last] - omega[last - 1]), np.nan)


def _stable(gains: FloatArray, phases: FloatArray) -> BoolArray:
    """Whether 1 + L does not wind around zero, by logarithms of gains and phases from the first frequency on."""
    # Whole turns below -180 degrees: each step of it is a crossing of the negative real axis.
    turns = np.floor((phases + np.pi) / (2.0 * np.pi))
    row, at = np.nonzero(np.diff(turns, axis=1))
    before, after = turns[row, at], turns[row, at + 1]
    levels = 2.0 * np.pi * np.maximum(before, after) - np.pi
    share = (levels - phases[row, at]) / (phases[row, at + 1] - phases[row, at])
    beyond = gains[row, at] + share * (gains[row, at + 1] - gains[row, at]) > 0.0
    rises = np.bincount(row[beyond], weights=(after - before)[beyond], minlength=len(gains))
    # A loop with three integrals begins below -180 degrees: with much gain there it has to rise above it once.
    return np.asarray(rises == np.where(gains[:, 0] > 0.0, -turns[:, 0], 0.0))


def attitude_rms(
    omega_rad_s: FloatArray,
    plants: ComplexArray,
    loops: ComplexArray,
    *,
    corner_rad_s: float = DISTURBANCE_RAD_S,
) -> FloatArray:
    r"""Root mean square of the attitude under a moment of a corner frequency, shape ``(draws,)``.

    .. math:: \int \left| \frac{P}{j\omega (1 + L)} \right|^2 \frac{d\omega}{\omega^2 + \omega_d^2}

    Its scale is arbitrary: values of one plant are to be compared.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``, rising.
    plants
        Rates by command :math:`P`, shape ``(draws, f)``.
    loops
        Whole loops :math:`L`, of the same shape.
    corner_rad_s
        Of the moment, :math:`\omega_d`.
    """
    answer = np.abs(plants / (1j * omega_rad_s * (1.0 + loops))) ** 2
    weight = 1.0 / (omega_rad_s**2 + corner_rad_s**2)
    return np.asarray(np.sqrt(np.trapezoid(answer * weight, omega_rad_s, axis=-1)))
