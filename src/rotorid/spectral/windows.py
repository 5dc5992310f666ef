"""How records are looked at: lengths of windows, their tapers, and the grid of frequencies.

Long windows see low frequencies and narrow resonances, short ones leave many averages. A taper fades a window in and
out. A grid must be fine enough to see how a response bends between its points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.record import Maneuver
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import BoolArray, FloatArray

PERIODS_IN_WINDOW = 2.0
"""A window counts from the frequency of which it holds two periods."""

WINDOWS = 5
"""How many lengths there are, unless the longest is hardly longer than the shortest."""

_SHORTEST_PERIODS = 20.0
"""Periods of the highest frequency in the shortest window."""

_RECORD_SHARE = 2.0
"""So many of the longest window fit into the shortest record."""

_TOTAL_SHARE = 5.0
"""So many of the longest window fit into all records together."""

_GIVEN_WITHIN = 0.005
"""How far a window may be from the length that was given for it, as a share."""

ENDING = ("sweep", "multisine")
"""Kinds of maneuvers that have a highest frequency."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Taper:
    r"""A taper as a sum of complex exponentials.

    .. math:: w_n = \sum_s a_s \exp\left(j \pi s \, (n + 1/2) / N\right), \qquad n = 0 \dots N - 1

    Both classic tapers need two or three terms, so a tapered transform is a sum of plain ones at shifted frequencies.
    A taper must be real, and even or odd about the middle of the window: terms come in pairs :math:`a_{-s} = a_s^*`
    with :math:`a_s e^{j \pi s / 2}` all real (even) or all imaginary (odd). The transform relies on it.

    Parameters
    ----------
    terms
        Pairs :math:`(s, a_s)`.
    mean_square
        Mean of :math:`w_n^2`, which makes spectra unbiased: 0.5 for the half-sine, 0.375 for Hann.
    odd
        Whether it is odd about the middle of the window, as slopes are.
    """

    name: str
    terms: tuple[tuple[int, complex], ...]
    mean_square: float
    odd: bool = False

    def samples(self, count: int) -> FloatArray:
        """The taper itself, shape ``(count,)``."""
        phase = np.pi * (np.arange(count) + 0.5) / count
        terms = np.array([amplitude * np.exp(1j * shift * phase) for shift, amplitude in self.terms])
        return np.asarray(terms.sum(axis=0).real)

    @property
    def slope(self) -> Taper:
        r"""Its derivative, for a window of length one: :math:`w'(t/T) / T` is what a window of length :math:`T` has."""
        terms = tuple((shift, 1j * math.pi * shift * amplitude) for shift, amplitude in self.terms if shift)
        power = sum(abs(amplitude) ** 2 for _, amplitude in terms)
        return Taper(name=f"slope of {self.name}", terms=terms, mean_square=power, odd=not self.odd)


HALF_SINE = Taper(name="half_sine", terms=((1, -0.5j), (-1, 0.5j)), mean_square=0.5)
HANN = Taper(name="hann", terms=((0, 0.5), (2, -0.25), (-2, -0.25)), mean_square=0.375)


@dataclass(frozen=True, kw_only=True, slots=True)
class WindowPlan:
    """Windows that were chosen, how closely they are kept, and what had to be said about the choice."""

    lengths_s: tuple[float, ...]
    within: float = math.inf
    """How far a window may be from its length, as a share; by rule, lengths are rounded to what is cheap."""
    findings: tuple[Finding, ...] = ()

    @property
    def lowest_rad_s(self) -> float:
        """Lowest frequency that any of the windows supports."""
        return PERIODS_IN_WINDOW * 2.0 * math.pi / max(self.lengths_s)


def plan_windows(record_s: float, total_s: float, band_rad_s: tuple[float, float]) -> WindowPlan:
    r"""Five window lengths for a set of records, after the rules of thumb of Tischler and Remple.

    Longest :math:`\le T_{rec}/2` and :math:`\le T_F/5`, shortest :math:`\ge 20 \cdot 2\pi/\omega_{max}`, evenly spread
    in the logarithm between them. On short records the rules clash; then the longest window yields first, down to one
    period of the lowest frequency, and a finding says so.

    Parameters
    ----------
    record_s
        Length of the shortest record.
    total_s
        Length of all records together.
    band_rad_s
        Lowest and highest frequency that is wanted.

    Raises
    ------
    InsufficientDataError
        The record does not hold two windows that support even the highest frequency.

    Examples
    --------
    >>> [round(length, 1) for length in plan_windows(90.0, 180.0, (0.6, 60.0)).lengths_s]
    [36.0, 17.7, 8.7, 4.3, 2.1]
    """
    low, high = band_rad_s
    if not 0.0 < low < high:
        raise UsageError(f"the band {low:g}:{high:g} rad/s is empty", needed="0 < low < high")
    period = 2.0 * math.pi / low
    longest = min(record_s / _RECORD_SHARE, total_s / _TOTAL_SHARE)
    findings: tuple[Finding, ...] = ()
    if longest < period:
        longest = min(period, record_s / _RECORD_SHARE)
        findings = (_short_record(record_s, total_s, longest, low),)
    least = PERIODS_IN_WINDOW * 2.0 * math.pi / high
    if longest < least:
        raise InsufficientDataError(
            f"got a record of {record_s:.3g} s",
            needed=f"at least two windows of {least:.3g} s for a band up to {high:.3g} rad/s",
            remedy="give a longer segment or a higher band",
            findings=[
                refusal(
                    "record_too_short",
                    "record",
                    f"The record of {record_s:.3g} s does not hold two windows of {least:.3g} s.",
                    record_s=record_s,
                    window_s=least,
                )
            ],
        )
    shortest = min(_SHORTEST_PERIODS * 2.0 * math.pi / high, longest)
    lengths = np.geomspace(longest, shortest, WINDOWS) if longest > 1.2 * shortest else [longest]
    return WindowPlan(lengths_s=tuple(float(length) for length in lengths), findings=findings)


def plan_of_records(
    lengths_s: Sequence[float], band_rad_s: tuple[float, float], given_s: Sequence[float] = ()
) -> WindowPlan:
    """Windows for records of several lengths: those given, or by rule, where half of the time lies in longer records.

    A gap may leave a stub of a second beside records of a minute. Windows that do not fit into it pass it over.

    Examples
    --------
    >>> plan_of_records([90.0, 90.0, 1.0], (0.6, 60.0)) == plan_windows(90.0, 181.0, (0.6, 60.0))
    True
    """
    lengths = np.sort(np.asarray(lengths_s, dtype=np.float64))[::-1]
    typical = float(lengths[np.searchsorted(np.cumsum(lengths), 0.5 * lengths.sum())])
    return given_windows(given_s, typical) if given_s else plan_windows(typical, float(lengths.sum()), band_rad_s)


POINTS = 100
"""Of the grid over a band."""

HIGHEST_DEFAULT_RAD_S = 100.0
"""Default end of the band without a sweep.

Coherence alone does not replace it: above, plants of 12 simulated Betaflight flights with a chopped throttle, logged at
1 kHz, read 7 % strong, and 72 % of the 95 % intervals of the gain contain the truth."""

HALF_LINE = 1.5
"""Half the width of a window's spectral line, in units of one over its length."""

LONGEST_MARGIN_S = 20.0
"""Of the quiet time that goes with a maneuver."""


def grid_rad_s(band_rad_s: tuple[float, float], plan: WindowPlan) -> FloatArray:
    """Logarithmic grid over what the windows support of a band, shape ``(f,)``."""
    low, high = max(band_rad_s[0], plan.lowest_rad_s), band_rad_s[1]
    return np.geomspace(min(low, 0.9 * high), high, POINTS)


def band_of(maneuvers: Sequence[Maneuver], sample_rate_hz: float) -> tuple[float, float]:
    """Band to look at where none was asked for: that of the sweeps, or what the sample rate carries for others."""
    carried = min(0.25 * np.pi * sample_rate_hz, HIGHEST_DEFAULT_RAD_S)
    bands = [maneuver.band_rad_s for maneuver in maneuvers if maneuver.band_rad_s is not None]
    sweeps = len(bands) == len(maneuvers) and all(maneuver.kind == "sweep" for maneuver in maneuvers)
    low = min((band[0] for band in bands), default=0.5)
    high = max((band[1] for band in bands), default=carried) if sweeps else carried
    return low, min(high, 0.8 * np.pi * sample_rate_hz)


def excited_to_rad_s(maneuvers: Sequence[Maneuver]) -> float:
    """How far up sweeps and multisines go; infinite where other maneuvers leave that to the coherence."""
    tops = [
        maneuver.band_rad_s[1] for maneuver in maneuvers if maneuver.kind in ENDING and maneuver.band_rad_s is not None
    ]
    return max(tops) if tops and len(tops) == len(maneuvers) else math.inf


def trusted_to_rad_s(top_rad_s: float, windows_s: Sequence[float]) -> float:
    """How far up a response is trusted of which the excitation ends: above shows the flank of a spectral line."""
    return top_rad_s - HALF_LINE * 2.0 * math.pi / min(windows_s)


def margin_s(maneuvers: Sequence[Maneuver]) -> float:
    """How much quiet time goes with each of some maneuvers: half of the longest of them, at most 20 s."""
    return min(0.5 * max(maneuver.duration_s for maneuver in maneuvers), LONGEST_MARGIN_S)


def given_windows(lengths_s: Sequence[float], record_s: float) -> WindowPlan:
    """Windows that the user chose: obeyed, with a remark where the longest exceeds half of the shortest record."""
    plan = tuple(sorted(lengths_s, reverse=True))
    if plan[0] <= record_s / _RECORD_SHARE:
        return WindowPlan(lengths_s=plan, within=_GIVEN_WITHIN)
    finding = warn(
        "record_too_short",
        "windows",
        f"The longest window of {plan[0]:.3g} s is more than half of the shortest record of {record_s:.3g} s, "
        "so the lowest frequencies are averages of few windows.",
        record_s=record_s,
        longest_window_s=plan[0],
    )
    return WindowPlan(lengths_s=plan, within=_GIVEN_WITHIN, findings=(finding,))


def _short_record(record_s: float, total_s: float, longest_s: float, low: float) -> Finding:
    return warn(
        "record_too_short",
        "windows",
        f"The records are short for {low:.2g} rad/s: the longest window of {longest_s:.1f} s is more than a fifth "
        f"of the {total_s:.0f} s flown, so the lowest frequencies are averages of few windows.",
        record_s=record_s,
        total_s=total_s,
        longest_window_s=longest_s,
    )


_LARGEST_STEP = 0.1
"""Of the logarithm of frequency. The slope of a response and the level of its noise are read off neighboring points;
seven of them then span a factor of two."""


def require_grid(omega_rad_s: FloatArray, sample_rate_hz: float) -> None:
    """Refuse a grid that is not a rising row of frequencies between zero and the Nyquist frequency.

    Raises
    ------
    UsageError
        It says which of these it is not.
    """
    if np.ndim(omega_rad_s) != 1:
        raise UsageError(f"got a frequency grid of shape {np.shape(omega_rad_s)}", needed="one row of frequencies")
    # Asked so that a grid with a NaN does not pass.
    if not omega_rad_s.size or not omega_rad_s[0] > 0.0 or not np.all(np.diff(omega_rad_s) > 0.0):
        raise UsageError("the frequency grid does not rise", needed="rising frequencies above zero")
    nyquist_rad_s = np.pi * sample_rate_hz
    if not omega_rad_s[-1] <= nyquist_rad_s:
        raise UsageError(
            f"got a frequency of {omega_rad_s[-1]:.4g} rad/s",
            needed=f"at most the Nyquist frequency of {nyquist_rad_s:.4g} rad/s",
            remedy="lower the upper end of the band",
        )


def refined(omega_rad_s: FloatArray) -> tuple[FloatArray, BoolArray]:
    """A grid with points between those that lie far apart, so that no answer depends on how coarse a grid was asked.

    Parameters
    ----------
    omega_rad_s
        Rising, above zero, shape ``(f,)``.

    Returns
    -------
    numpy.ndarray, numpy.ndarray
        The finer grid, and which of its points were asked for, both of shape ``(g,)`` with ``g >= f``.

    Examples
    --------
    >>> fine, asked = refined(np.array([1.0, 1.2, 1.25]))
    >>> fine.round(3).tolist(), asked.tolist()
    ([1.0, 1.095, 1.2, 1.25], [True, False, True, True])
    """
    intervals = np.ceil(np.diff(np.log(omega_rad_s)) / _LARGEST_STEP).astype(np.int64)
    place = np.concatenate([[0], np.cumsum(intervals)])
    fine = np.exp(np.interp(np.arange(place[-1] + 1), place, np.log(omega_rad_s)))
    asked = np.zeros(fine.size, dtype=bool)
    asked[place] = True
    fine[place] = omega_rad_s
    return fine, asked
