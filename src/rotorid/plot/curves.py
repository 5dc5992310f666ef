"""Curves of a frequency response: units of the axes, points, lines and error bands, and phases on a sensible branch.

Frequency is drawn in rad/s or Hz, magnitude in decibels or as a plain factor. Phases are unwrapped from a branch that
data and model share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.figure import Trace, frequency_ticks, magnitude_range_db, numbers, phase_step_deg, text
from rotorid.typing import BoolArray, ComplexArray, FloatArray

Frequency: TypeAlias = Literal["rad/s", "Hz"]
Magnitude: TypeAlias = Literal["dB", "linear"]

_RAD_S_PER_HZ = 2.0 * np.pi


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """The units of one picture; the arrays that come in are always rad/s.

    Parameters
    ----------
    frequency
        Unit of the horizontal axis.
    magnitude
        Decibels, or the plain factor on a linear axis.

    Raises
    ------
    UsageError
        A unit is unknown.

    Examples
    --------
    >>> View(frequency="Hz").across(np.array([6.283185307]))
    array([1.])
    """

    frequency: Frequency = "rad/s"
    magnitude: Magnitude = "dB"

    def __post_init__(self) -> None:
        for name, came, known in (
            ("frequency", self.frequency, get_args(Frequency)),
            ("magnitude", self.magnitude, get_args(Magnitude)),
        ):
            if came not in known:
                raise UsageError(f"unknown {name} {came!r}", needed=" or ".join(map(repr, known)))

    def across(self, omega_rad_s: FloatArray) -> FloatArray:
        """Frequencies in the unit of the picture, same shape."""
        return omega_rad_s / _RAD_S_PER_HZ if self.frequency == "Hz" else omega_rad_s

    def other(self, omega_rad_s: FloatArray) -> FloatArray:
        """Frequencies in the unit that the picture does not use, for those who point at it."""
        return omega_rad_s if self.frequency == "Hz" else omega_rad_s / _RAD_S_PER_HZ

    def bands(self, bands_rad_s: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        """Intervals of frequency in the unit of the picture."""
        factor = float(self.across(np.ones(1))[0])
        return [(low * factor, high * factor) for low, high in bands_rad_s]

    def height(self, level_db: FloatArray, *, decibels: float = 20.0) -> FloatArray:
        """Levels in the unit of the picture: ``decibels`` is 20 for amplitudes and 10 for powers."""
        return level_db if self.magnitude == "dB" else 10.0 ** (level_db / decibels)

    @property
    def pointed(self) -> str:
        """Start of the text that follows the pointer, which says a frequency in both units."""
        other = "rad/s" if self.frequency == "Hz" else "Hz"
        return f"%{{x:.3~g}} {self.frequency} (%{{customdata:.3~g}} {other})<br>"

    def axis(self, omega_rad_s: FloatArray) -> dict[str, Any]:
        """The logarithmic horizontal axis of a picture over these frequencies."""
        ticks = frequency_ticks(self.across(omega_rad_s[omega_rad_s > 0.0]))
        return {"type": "log", "title": {"text": f"Frequency [{self.frequency}]"}, "tickvals": ticks}


def decibels(magnitude: FloatArray, *, of_power: bool = False) -> FloatArray:
    """Levels in decibels, same shape; what is not positive has none and becomes not-a-number.

    Examples
    --------
    >>> decibels(np.array([10.0, 0.0])), decibels(np.array([10.0]), of_power=True)
    (array([20., nan]), array([10.]))
    """
    level = np.log10(magnitude, out=np.full(magnitude.shape, np.nan), where=magnitude > 0.0)
    return np.asarray((10.0 if of_power else 20.0) * level)


SIGMAS = 2.0
"""Half width of the error bands in standard deviations: about 95 % for each point on its own."""


@dataclass(frozen=True, kw_only=True)
class Style:
    """How the traces of one curve are drawn and named.

    Parameters
    ----------
    name
        In the legend; traces of one name are switched together.
    color, width, dash, symbol, size, opacity
        As plotly has them.
    legend
        Whether this trace represents its group in the legend.
    unit
        Unit of the vertical axis, for the text that follows the pointer.
    """

    name: str
    color: str
    width: float = 1.6
    dash: str = "solid"
    symbol: str = "circle"
    size: float = 5.0
    opacity: float = 1.0
    legend: bool = False
    unit: str = ""


def line(view: View, omega_rad_s: FloatArray, values: FloatArray, style: Style) -> Trace:
    """A line through values of shape ``(f,)``."""
    drawn = {"mode": "lines", "line": {"color": style.color, "width": style.width, "dash": style.dash}}
    return {**_trace(view, omega_rad_s, values, style), **drawn}


def points(view: View, omega_rad_s: FloatArray, values: FloatArray, style: Style) -> Trace:
    """Markers at values of shape ``(f,)``."""
    marker = {"color": style.color, "size": style.size, "opacity": style.opacity, "symbol": style.symbol}
    return {**_trace(view, omega_rad_s, values, style), "mode": "markers", "marker": marker}


def _trace(view: View, omega_rad_s: FloatArray, values: FloatArray, style: Style) -> Trace:
    return {
        "type": "scatter",
        "x": numbers(view.across(omega_rad_s)),
        "y": numbers(values),
        "customdata": numbers(view.other(omega_rad_s)),
        "hovertemplate": f"{view.pointed}%{{y:.4~g}} {style.unit}",
        "name": text(style.name),
        "legendgroup": text(style.name),
        "showlegend": style.legend,
    }


def band(
    view: View, omega_rad_s: FloatArray, low: FloatArray, high: FloatArray, used: BoolArray, style: Style
) -> list[Trace]:
    """The area between two curves of shape ``(f,)``, in unbroken runs of the used points; a list of one, or empty."""
    x: list[float | None] = []
    y: list[float | None] = []
    for run in runs(used & np.isfinite(low) & np.isfinite(high)):
        across = numbers(view.across(omega_rad_s[run]))
        x += [*across, *across[::-1], None]
        y += [*numbers(low[run]), *numbers(high[run][::-1]), None]
    area: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": x[:-1],
        "y": y[:-1],
        "fill": "toself",
        "fillcolor": style.color,
        "line": {"width": 0, "color": style.color},
        "hoverinfo": "skip",
        "name": text(style.name),
        "legendgroup": text(style.name),
        "showlegend": style.legend,
    }
    return [area] if x else []


def spanned(used: BoolArray) -> BoolArray:
    """From the first to the last used point, same shape.

    Examples
    --------
    >>> spanned(np.array([False, True, False, True, False]))
    array([False,  True,  True,  True, False])
    """
    chosen = np.flatnonzero(used)
    inside = np.zeros(used.size, dtype=bool)
    if chosen.size:
        inside[chosen[0] : chosen[-1] + 1] = True
    return inside


def runs(used: BoolArray) -> list[slice]:
    """Unbroken runs of ``True`` as slices.

    Examples
    --------
    >>> runs(np.array([True, True, False, True]))
    [slice(0, 2, None), slice(3, 4, None)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], used, [False])).astype(int)))
    return [slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def shown(traces: list[Trace]) -> FloatArray:
    """All heights that are drawn, to fit an axis to them."""
    return np.array([value for trace in traces for value in trace["y"] if value is not None], dtype=np.float64)


def magnitude_axis(view: View, traces: list[Trace]) -> dict[str, Any]:
    """A vertical axis of magnitudes; a linear one starts at zero, as factors are compared by their length."""
    if view.magnitude == "linear":
        return {"rangemode": "tozero"}
    narrow = magnitude_range_db(shown(traces))
    return {"range": list(narrow)} if narrow else {}


def phase_axis(traces: list[Trace]) -> dict[str, Any]:
    """A vertical axis of phases in degrees, with ticks at parts of a right angle."""
    heights = shown(traces)
    return {"dtick": phase_step_deg(float(np.ptp(heights)))} if heights.size else {}


_HIGHEST_ABOVE_SLOPE_DEG = 60.0
_LEAST_HIGHEST_DEG = -60.0
_LEAST_AGREEMENT = 0.75
_SMOOTHINGS = 4
_LEAST_RUN = 3
_ANCHOR_SHARE = 1.0 / 3.0


def unwrapped_deg(omega_rad_s: FloatArray, values: ComplexArray) -> FloatArray:
    r"""Unwrapped phase of a noiseless response in degrees, shape ``(f,)``, on the branch that its slope calls for.

    Without poles and zeros on the right, and without delay, a response whose magnitude goes as :math:`\omega^n` has
    the phase :math:`90° n` (Bode's relation). Lag and delay lower it, a reversed sign lowers it by 180°. So the lowest
    third of the points is put in the turn below :math:`90° n + 60°`, though never more than a turn below −60°: an
    integrator starts at −90°, two at −180°, three at −270° (reversed at −90°), a differentiator at +90° and a reversed
    gain at −180°.

    Assumes less than half a turn from point to point; a coarse grid breaks it.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    values
        Shape ``(f,)``; what is not finite stays a gap.

    References
    ----------
    Bode, H. W.: *Network Analysis and Feedback Amplifier Design*, 1945, chapter 14.

    Examples
    --------
    >>> omega = np.array([1.0, 2.0, 4.0])
    >>> unwrapped_deg(omega, 5.0 / (1j * omega) ** 3).round(0)
    array([-270., -270., -270.])
    """
    phase = np.full(values.shape, np.nan)
    good = np.isfinite(values) & (values != 0.0)
    if good.any():
        # A response that is exactly real may come with either sign of zero: round, so that both give one branch.
        turned = np.round(np.degrees(np.unwrap(np.angle(values[good]))), 9)
        phase[good] = turned + _branch_deg(omega_rad_s[good], values[good], turned)
    return phase


def near_deg(values: ComplexArray, reference_deg: FloatArray) -> FloatArray:
    """Phase in degrees on the branch that is nearest to a reference, shape ``(f,)``.

    Examples
    --------
    >>> near_deg(np.array([-1.0 + 0.01j]), np.array([-170.0])).round(0)
    array([-181.])
    """
    phase = np.degrees(np.angle(values))
    return phase + 360.0 * np.round((np.nan_to_num(reference_deg) - phase) / 360.0)


def reference_deg(omega_rad_s: FloatArray, values: ComplexArray, trusted: BoolArray) -> FloatArray:
    """A phase to lean on when there is no model, shape ``(f,)``.

    Trusted points whose neighbors turn as they do are unwrapped, the others are interpolated between them and held
    beyond them. The branch is that of ``unwrapped_deg``, found in the longest steady run alone: noise at the ends of a
    band moves neither it nor the middle. Noise that breaks the middle into pieces can shift them by whole turns.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    values
        Measured response, shape ``(f,)``.
    trusted
        Points that may decide, shape ``(f,)``; all of them where nothing is known.
    """
    good = trusted & np.isfinite(values) & (values != 0.0)
    if not good.any():
        return np.zeros(omega_rad_s.size)
    index = np.flatnonzero(good)
    steady = _steady(values[index])
    index = index[steady] if steady.any() else index
    turned = np.degrees(np.unwrap(np.angle(values[index])))
    # The longest run without a hole of several points decides; a point or two may be missing in it.
    home = max(np.split(np.arange(index.size), np.flatnonzero(np.diff(index) > _LEAST_RUN) + 1), key=len)
    turned += _branch_deg(omega_rad_s[index[home]], values[index[home]], turned[home])
    return np.interp(np.log(omega_rad_s), np.log(omega_rad_s[index]), turned)


def _steady(values: ComplexArray) -> BoolArray:
    """Points in runs where the turn from point to point is like that of the neighbors: noise turns anyhow."""
    if values.size < 2 * _LEAST_RUN:
        return np.ones(values.size, dtype=bool)
    unit = values / np.abs(values)
    turn = unit[1:] * unit[:-1].conj()
    for _ in range(_SMOOTHINGS):
        # Weights of 1, 2, 1: their mean keeps the direction of any constant turn.
        padded = np.concatenate((turn[:1], turn, turn[-1:]))
        turn = (padded[:-2] + 2.0 * padded[1:-1] + padded[2:]) / 4.0
    agreed = np.abs(turn) >= _LEAST_AGREEMENT
    both = np.concatenate(([True], agreed)) & np.concatenate((agreed, [True]))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], both, [False])).astype(int))).reshape(-1, 2)
    steady = np.zeros(values.size, dtype=bool)
    for start, stop in edges.tolist():
        steady[start:stop] = stop - start >= _LEAST_RUN
    return steady


def _branch_deg(omega_rad_s: FloatArray, values: ComplexArray, turned_deg: FloatArray) -> float:
    """Whole turns to add to an unwrapped phase, so that it fits the slope of its magnitude at low frequency."""
    low = slice(0, max(int(np.ceil(omega_rad_s.size * _ANCHOR_SHARE)), min(2, omega_rad_s.size)))
    slope = 0.0
    if omega_rad_s[low].size > 1:
        slope = float(np.polyfit(np.log(omega_rad_s[low]), np.log(np.abs(values[low])), 1)[0])
    highest = max(90.0 * slope + _HIGHEST_ABOVE_SLOPE_DEG, _LEAST_HIGHEST_DEG)
    return 360.0 * float(np.floor((highest - np.median(turned_deg[low])) / 360.0))
