"""Pictures over frequency: a Bode plot with errors and model, several responses, windows, bands, densities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from rotorid.data.record import STANDARD_UNITS
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import DIRECT_COHERENCE, trusted
from rotorid.data.trust import least_coherence as coherence_needed
from rotorid.errors import UsageError
from rotorid.plot.curves import (
    SIGMAS,
    Frequency,
    Magnitude,
    Style,
    View,
    band,
    decibels,
    line,
    magnitude_axis,
    near_deg,
    phase_axis,
    points,
    reference_deg,
    spanned,
    unwrapped_deg,
)
from rotorid.plot.figure import (
    DASHES,
    INPUT,
    MEASURED,
    MODEL,
    SECONDARY,
    SERIES,
    SYMBOLS,
    Figure,
    Panel,
    Quantity,
    Trace,
    magnitude_label,
    numbers,
    quantity,
    stacked,
    text,
    translucent,
)
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_BAND_OPACITY, _LEFT_OUT_OPACITY = 0.22, 0.14


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """One response on paper, each array of shape ``(f,)``; the errors are half widths of the band."""

    omega_rad_s: FloatArray
    magnitude_db: FloatArray
    phase_deg: FloatArray
    magnitude_error_db: FloatArray
    phase_error_deg: FloatArray


def bode(
    response: FrequencyResponse,
    *,
    output: str,
    input: str,
    model: ComplexArray | None = None,
    beside: FrequencyResponse | None = None,
    fitted: BoolArray | None = None,
    least_coherence: float | None = None,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Magnitude, phase and coherence of one response ``output/input``, with the model over it.

    Bands are :math:`\pm 2\sigma` of the random error: a factor of :math:`1 + 2\varepsilon` to both sides, which is
    :math:`20\log_{10}(1 + 2\varepsilon)` dB, and :math:`2\varepsilon` rad. They say nothing about bias, by feedback
    for instance. Measured phases are drawn on the branch that is nearest to the model; without one, on that which the
    slope of the magnitude calls for (``rotorid.plot.curves.reference_deg``).

    Parameters
    ----------
    response
        The response that was fitted.
    output, input
        Which of its pairs.
    model
        The model on the same grid, shape ``(y, u, f)``.
    beside
        Another estimate of the same pair, drawn thin where its own points can be trusted.
    fitted
        Points that entered the fit or the tables, shape ``(y, u, f)``; the others are gray. ``None`` takes those that
        :func:`rotorid.data.trust.trusted` does.
    least_coherence
        Coherence below which points were left out, drawn as a line; that of the kind of estimate by default, and no
        line at zero.
    frequency, magnitude
        Units of the picture: ``"rad/s"`` or ``"Hz"``, ``"dB"`` or ``"linear"`` (SI units of output per input).

    Raises
    ------
    ValueError
        The response does not hold the pair.
    UsageError
        A unit is unknown.

    Examples
    --------
    >>> omega = np.array([6.283185307, 12.56637061])
    >>> ones = np.ones((1, 1, 2))
    >>> rate = FrequencyResponse(omega_rad_s=omega, values=10.0 / (1j * omega).reshape(1, 1, 2), coherence=ones,
    ...     random_error=0.01 * ones, covariance=np.zeros((1, 1, 2, 2), complex), inputs=("roll_command",),
    ...     outputs=("p",), estimate="direct")
    >>> figure = bode(rate, output="p", input="roll_command", frequency="Hz", magnitude="linear")
    >>> measured = [trace for trace in figure["data"] if trace["name"] == "measured"]
    >>> [trace["x"] for trace in measured[:1]], [trace["y"] for trace in measured]
    ([[1.0, 2.0]], [[1.5915, 0.79577], [-90.0, -90.0], [1.0, 1.0]])
    """
    view = View(frequency=frequency, magnitude=magnitude)
    row = response.pair(output, input)
    values, coherence = response.values[row], response.coherence[row]
    least = coherence_needed(least_coherence, joint=response.estimate == "joint")
    used = used_points(response, row, fitted, least)
    exact = None if model is None else model[row]
    lean_deg = (
        reference_deg(response.omega_rad_s, values, used & (coherence >= least))
        if exact is None
        else unwrapped_deg(response.omega_rad_s, exact)
    )
    measured = measured_curve(response, output=output, input=input, lean_deg=lean_deg)
    other = _other_estimate(beside, measured, output=output, input=input, lean_deg=lean_deg)
    name = f"{beside.estimate} estimate" if beside else ""
    panels = (
        _magnitude_panel(
            view,
            measured,
            used,
            exact,
            other,
            name,
            label=magnitude_label(output, input, in_db=magnitude == "dB", units=response.units),
        ),
        _phase_panel(view, measured, used, None if exact is None else lean_deg, other, name),
        coherence_panel(_points(view, measured.omega_rad_s, coherence, used, "", legend=False), least),
    )
    return stacked(panels, x_axis=view.axis(response.omega_rad_s))


def _other_estimate(
    other: FrequencyResponse | None, measured: Curve, *, output: str, input: str, lean_deg: FloatArray
) -> Curve | None:
    """The other estimate on the phase branch of the measured one, with gaps where it cannot be trusted."""
    if other is None or not other.omega_rad_s.size:
        return None
    near = np.interp(other.omega_rad_s, measured.omega_rad_s, lean_deg)
    drawn, row = measured_curve(other, output=output, input=input, lean_deg=near), other.pair(output, input)
    used = used_points(other, row, None, coherence_needed(None, joint=other.estimate == "joint"))
    return replace(
        drawn,
        magnitude_db=np.where(used, drawn.magnitude_db, np.nan),
        phase_deg=np.where(used, drawn.phase_deg, np.nan),
    )


def used_points(response: FrequencyResponse, row: tuple[int, int], fitted: BoolArray | None, least: float) -> BoolArray:
    """Points of one pair that are drawn as measured, shape ``(f,)``: those that were fitted, or else can be trusted."""
    if fitted is not None:
        return np.asarray(fitted[row] & np.isfinite(response.values[row]))
    good = trusted(response.random_error[row], response.coherence[row], least)
    return np.asarray(good & np.isfinite(response.values[row]))


def _magnitude_panel(
    view: View,
    measured: Curve,
    used: BoolArray,
    model: ComplexArray | None,
    other: Curve | None,
    name: str,
    *,
    label: str,
) -> Panel:
    omega, unit = measured.omega_rad_s, "dB" if view.magnitude == "dB" else ""
    faint = _left_out_band(view, measured, used)[0]
    traces = bands(view, measured, used, _band_style(legend=True))[0]
    if other is not None:
        traces.append(_thin(view, other.omega_rad_s, view.height(other.magnitude_db), name, legend=True))
    traces += _points(view, omega, view.height(measured.magnitude_db), used, unit, legend=True)
    if model is not None:
        traces += _model(view, omega, view.height(decibels(np.abs(model))), used, unit, legend=True)
    return Panel(label=label, traces=[*faint, *traces], height_px=230, axis=magnitude_axis(view, traces))


def _phase_panel(
    view: View, measured: Curve, used: BoolArray, model_deg: FloatArray | None, other: Curve | None, name: str
) -> Panel:
    omega = measured.omega_rad_s
    traces = [*_left_out_band(view, measured, used)[1], *bands(view, measured, used, _band_style(legend=False))[1]]
    if other is not None:
        traces.append(_thin(view, other.omega_rad_s, other.phase_deg, name, legend=False))
    traces += _points(view, omega, measured.phase_deg, used, "°", legend=False)
    if model_deg is not None:
        traces += _model(view, omega, model_deg, used, "°", legend=False)
    return Panel(label="Phase [°]", traces=traces, height_px=160, axis=phase_axis(traces))


def _band_style(*, legend: bool) -> Style:
    return Style(name=f"± {SIGMAS:g} σ random error", color=translucent(MEASURED, _BAND_OPACITY), legend=legend)


LEFT_OUT, LEFT_OUT_BAND = "measured, left out", f"± {SIGMAS:g} σ, left out"
"""Names of points and errors that the tables do not count."""
_KNOWN_DB = float(decibels(np.array([1.0 + SIGMAS]))[0])
"""Half width of the band of a point whose error is as large as itself: of what is known worse none is drawn."""


def _left_out_band(view: View, measured: Curve, used: BoolArray) -> tuple[list[Trace], list[Trace]]:
    """The errors of points that the tables do not count, as far as these are known at all."""
    style = Style(name=LEFT_OUT_BAND, color=translucent(SECONDARY, _LEFT_OUT_OPACITY))
    return bands(view, measured, ~used & (measured.magnitude_error_db <= _KNOWN_DB), style)


def _points(
    view: View, omega: FloatArray, values: FloatArray, used: BoolArray, unit: str, *, legend: bool
) -> list[Trace]:
    groups = (("measured", used, MEASURED, 1.0, 5.0), (LEFT_OUT, ~used, SECONDARY, 0.55, 4.0))
    return [
        points(
            view,
            omega[chosen],
            values[chosen],
            Style(name=name, color=color, size=size, opacity=opacity, unit=unit, legend=legend),
        )
        for name, chosen, color, opacity, size in groups
        if chosen.any()
    ]


def _model(
    view: View, omega: FloatArray, values: FloatArray, used: BoolArray, unit: str, *, legend: bool
) -> list[Trace]:
    inside = spanned(used)
    # The whole model dotted, and solid where it was fitted: an extrapolation looks like one.
    drawn = (("dot", 1.2, np.ones(omega.size, dtype=bool), legend and not inside.any()), ("solid", 2.2, inside, legend))
    return [
        line(
            view,
            omega[where],
            values[where],
            Style(name="model", color=MODEL, width=width, dash=dash, unit=unit, legend=listed),
        )
        for dash, width, where, listed in drawn
        if where.any()
    ]


def _thin(view: View, omega: FloatArray, values: FloatArray, name: str, *, legend: bool) -> Trace:
    style = Style(name=name, color=SECONDARY, width=1.2, legend=legend)
    return {**line(view, omega, values, style), "hoverinfo": "skip"}


def measured_curve(response: FrequencyResponse, *, output: str, input: str, lean_deg: FloatArray) -> Curve:
    """One measured pair on paper, its phase near ``lean_deg`` of shape ``(f,)``.

    Parameters
    ----------
    response
        With this pair.
    output, input
        The pair.
    lean_deg
        Phase of the model, by which whole turns are chosen.
    """
    row = response.pair(output, input)
    return curve(response.omega_rad_s, response.values[row], response.random_error[row], lean_deg)


def curve(omega_rad_s: FloatArray, values: ComplexArray, random_error: FloatArray, lean_deg: FloatArray) -> Curve:
    """Values and random errors of shape ``(f,)`` on paper, the phase near ``lean_deg`` of the same shape."""
    spread = SIGMAS * random_error
    return Curve(
        omega_rad_s=omega_rad_s,
        magnitude_db=decibels(np.abs(values)),
        phase_deg=near_deg(values, lean_deg),
        magnitude_error_db=decibels(1.0 + spread),
        phase_error_deg=np.minimum(np.degrees(spread), 180.0),
    )


def bands(view: View, drawn: Curve, used: BoolArray, style: Style) -> tuple[list[Trace], list[Trace]]:
    """Error bands of magnitude and phase; only the first may be in the legend."""
    omega, level, half = drawn.omega_rad_s, drawn.magnitude_db, drawn.magnitude_error_db
    low, high = drawn.phase_deg - drawn.phase_error_deg, drawn.phase_deg + drawn.phase_error_deg
    quiet = Style(name=style.name, color=style.color)
    return (
        band(view, omega, view.height(level - half), view.height(level + half), used, style),
        band(view, omega, low, high, used, quiet),
    )


def coherence_panel(traces: list[Trace], least_coherence: float) -> Panel:
    """The lowest panel of a Bode picture."""
    axis = {"range": [0, 1.05], "dtick": 0.5}
    return Panel(label="Coherence", traces=traces, height_px=95, axis=axis, level=least_coherence or None)


_OVERLAY_OPACITY = 0.16


@dataclass(frozen=True, kw_only=True, eq=False)
class Named:
    """One response with a name for the legend.

    Parameters
    ----------
    name
        Different from the other names.
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``; each response may have its own.
    values
        Shape ``(f,)``; what is not finite is a gap.
    random_error
        Relative standard deviation of the magnitude, which is that of the phase in radians, shape ``(f,)``.
    coherence
        Shape ``(f,)``.
    measured
        Whether it is drawn as points; a model is a line.
    units
        Of channels that the log has in another unit than the vocabulary.

    Raises
    ------
    UsageError
        An array has another shape than the frequencies.
    """

    name: str
    omega_rad_s: FloatArray
    values: ComplexArray
    random_error: FloatArray | None = None
    coherence: FloatArray | None = None
    measured: bool = True
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = {"values": self.values, "random_error": self.random_error, "coherence": self.coherence}
        for name, array in arrays.items():
            if array is not None and array.shape != self.omega_rad_s.shape:
                raise UsageError(
                    f"{name} of the curve {self.name!r} has the shape {array.shape}",
                    needed=f"the shape {self.omega_rad_s.shape} of its frequencies",
                )

    @classmethod
    def of(cls, response: FrequencyResponse, *, output: str, input: str, name: str) -> Self:
        """One pair of a measured response, with its error and coherence."""
        row = response.pair(output, input)
        return cls(
            name=name,
            omega_rad_s=response.omega_rad_s,
            values=response.values[row],
            random_error=response.random_error[row],
            coherence=response.coherence[row],
            units=response.units,
        )


def overlay(
    curves: Sequence[Named],
    *,
    output: str,
    input: str,
    least_coherence: float = DIRECT_COHERENCE,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Several responses ``output/input`` on one Bode plot, each with its band of :math:`\pm 2\sigma`.

    Each phase is unwrapped by itself and then shifted by whole turns to lie nearest to the first one. The band is
    drawn where the coherence is above its guideline, and everywhere for a curve without coherence. A click in the
    legend hides a curve with its band.

    Parameters
    ----------
    curves
        At least one. The first six differ in color, dash and symbol; then the colors return with other dashes.
    output, input
        The pair, for the words and units of the axis.
    least_coherence
        Guideline, drawn as a line.
    frequency, magnitude
        Units of the picture.

    Raises
    ------
    UsageError
        No curve was given, two have one name, or a unit is unknown.

    Examples
    --------
    >>> omega = np.geomspace(1.0, 50.0, 20)
    >>> slow, fast = (Named(name=f"{1e3 * tau:g} ms", omega_rad_s=omega, measured=False,
    ...     values=8.0 * np.exp(-1j * omega * tau) / (1j * omega)) for tau in (0.04, 0.01))
    >>> figure = overlay([slow, fast], output="p", input="roll_command")
    >>> [trace["name"] for trace in figure["data"] if trace["showlegend"]]
    ['40 ms', '10 ms']
    """
    view = View(frequency=frequency, magnitude=magnitude)
    names = [named.name for named in curves]
    if not names or len(set(names)) < len(names):
        raise UsageError(
            f"an overlay of the curves {names} was asked for", needed="at least one curve, each with a name of its own"
        )
    papers = _on_one_branch([_paper(named, least_coherence) for named in curves])
    inked = [_ink(view, *both, number, least_coherence) for number, both in enumerate(zip(curves, papers, strict=True))]
    units = {channel: unit for one in curves for channel, unit in one.units.items()}
    # All bands first: none of them may lie over the points of another curve.
    level, turn, trust = (
        sorted((trace for parts in inked for trace in parts[part]), key=lambda trace: "fill" not in trace)
        for part in range(3)
    )
    panels = [
        Panel(
            label=magnitude_label(output, input, in_db=magnitude == "dB", units=units),
            traces=level,
            height_px=250,
            axis=magnitude_axis(view, level),
        ),
        Panel(label="Phase [°]", traces=turn, height_px=180, axis=phase_axis(turn)),
    ]
    if trust:
        panels.append(coherence_panel(trust, least_coherence))
    return stacked(panels, x_axis=view.axis(np.concatenate([named.omega_rad_s for named in curves])))


def _trusted(named: Named, least_coherence: float) -> BoolArray:
    finite = np.isfinite(named.values)
    if named.coherence is None:
        return finite
    error = np.zeros(finite.size) if named.random_error is None else named.random_error
    return np.asarray(finite & trusted(error, named.coherence, least_coherence))


def _paper(named: Named, least_coherence: float) -> Curve:
    lean_deg = reference_deg(named.omega_rad_s, named.values, _trusted(named, least_coherence))
    error = np.zeros(named.omega_rad_s.size) if named.random_error is None else named.random_error
    return curve(named.omega_rad_s, named.values, error, lean_deg)


def _on_one_branch(papers: Sequence[Curve]) -> list[Curve]:
    """Each phase shifted by whole turns to lie nearest to the first where both are seen."""
    first = papers[0]
    finite = np.isfinite(first.phase_deg)
    if not finite.any():
        return list(papers)
    shifted = []
    for paper in papers:
        there = np.interp(np.log(paper.omega_rad_s), np.log(first.omega_rad_s[finite]), first.phase_deg[finite])
        gap = (there - paper.phase_deg)[np.isfinite(paper.phase_deg)]
        turns = np.round(np.median(gap) / 360.0) if gap.size else 0.0
        shifted.append(replace(paper, phase_deg=paper.phase_deg + 360.0 * turns))
    return shifted


def _ink(
    view: View, named: Named, paper: Curve, number: int, least_coherence: float
) -> tuple[list[Trace], list[Trace], list[Trace]]:
    """Traces of magnitude, phase and coherence of one curve."""
    level: list[Trace] = []
    turn: list[Trace] = []
    color = SERIES[number % len(SERIES)]
    if named.random_error is not None:
        shade = Style(name=named.name, color=translucent(color, _OVERLAY_OPACITY))
        level, turn = bands(view, paper, _trusted(named, least_coherence), shade)
    style = Style(
        name=named.name,
        color=color,
        width=1.8,
        # The second round of colors comes with other dashes.
        dash=DASHES[(number + number // len(SERIES)) % len(DASHES)],
        symbol=SYMBOLS[(number + number // len(SERIES)) % len(SYMBOLS)],
        size=4.5,
        unit="dB" if view.magnitude == "dB" else "",
        legend=True,
    )
    draw = points if named.measured else line
    used = _trusted(named, least_coherence) if named.measured else np.ones(named.omega_rad_s.size, dtype=bool)
    faint = replace(style, color=SECONDARY, size=3.5, opacity=0.55, legend=False)

    def drawn(heights: FloatArray, unit: str, *, legend: bool = False) -> list[Trace]:
        groups = ((used, replace(style, unit=unit, legend=legend)), (~used, replace(faint, unit=unit)))
        return [draw(view, named.omega_rad_s[part], heights[part], ink) for part, ink in groups if part.any()]

    level += drawn(view.height(paper.magnitude_db), style.unit, legend=True)
    turn += drawn(paper.phase_deg, "°")
    return level, turn, [] if named.coherence is None else drawn(named.coherence, "")


_AREA_OPACITY = 0.55
_LOG_AXIS = {"type": "log", "dtick": "D2", "exponentformat": "none", "tickformat": "~r"}


def window_contributions(
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    share: FloatArray,
    errors: FloatArray,
    *,
    composite_error: FloatArray | None = None,
    frequency: Frequency = "rad/s",
) -> Figure:
    r"""Share of each window length in a composite response, and the random error of each window alone.

    Where the windows are combined with weights :math:`W_i`, the share is :math:`W_i^2 / \sum_j W_j^2`
    (``rotorid.spectral.composite.window_weights``). Windows of one record share its data: the error of the composite
    lies below the best single window by less than independent windows would bring.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    windows_s
        Window lengths.
    share
        Shape ``(windows, f)``, from 0 to 1, drawn stacked in percent; frequencies that no window carries are left
        out.
    errors
        Relative standard deviation of the magnitude of each window alone, same shape; not finite where a window does
        not count.
    composite_error
        That of the composite, shape ``(f,)``.
    frequency
        Unit of the picture.

    Raises
    ------
    UsageError
        A shape does not fit, a share is negative, or the unit is unknown.

    Examples
    --------
    >>> share = np.array([[0.8, 0.0], [0.2, 1.0]])
    >>> figure = window_contributions(np.array([1.0, 10.0]), [20.0, 5.0], share, np.full((2, 2), 0.1))
    >>> [(trace["name"], trace["y"]) for trace in figure["data"][:2]]
    [('20 s', [80.0, 0.0]), ('5 s', [20.0, 100.0])]
    """
    view = View(frequency=frequency)
    _require(len(windows_s), omega_rad_s, share, errors, composite_error)
    names = [f"{window:.4g} s" for window in windows_s]
    carried = np.isfinite(share).all(axis=0) & (share.sum(axis=0) > 0.0)
    areas = [
        _area(view, omega_rad_s[carried], row[carried], name, SERIES[number % len(SERIES)])
        for number, (name, row) in enumerate(zip(names, share, strict=True))
    ]
    single = [
        line(
            view,
            omega_rad_s,
            _positive(row),
            Style(name=name, color=SERIES[number % len(SERIES)], dash=DASHES[number % len(DASHES)]),
        )
        for number, (name, row) in enumerate(zip(names, errors, strict=True))
    ]
    if composite_error is not None:
        style = Style(name="composite", color=SECONDARY, width=3.5, legend=True)
        # Below the single windows, so that the one that carries it stays in sight.
        single.insert(0, line(view, omega_rad_s, _positive(composite_error), style))
    panels = (
        Panel(label="Share in the composite [%]", traces=areas, height_px=170, axis={"range": [0, 100], "dtick": 25}),
        Panel(label="Random error of each window alone", traces=single, height_px=190, axis=_LOG_AXIS),
    )
    return stacked(panels, x_axis=view.axis(omega_rad_s))


def _require(
    windows: int, omega_rad_s: FloatArray, share: FloatArray, errors: FloatArray, composite_error: FloatArray | None
) -> None:
    shape = (windows, omega_rad_s.size)
    for name, came, needed in (
        ("share", share.shape, shape),
        ("errors", errors.shape, shape),
        ("composite_error", shape[1:] if composite_error is None else composite_error.shape, shape[1:]),
    ):
        if came != needed:
            raise UsageError(f"{name} has the shape {came}", needed=f"the shape {needed}")
    if np.nanmin(share, initial=0.0) < 0.0:
        raise UsageError("the share of a window is negative", needed="shares from 0 to 1")


def _positive(values: FloatArray) -> FloatArray:
    return np.where(values > 0.0, values, np.nan)


def _area(view: View, omega_rad_s: FloatArray, share: FloatArray, name: str, color: str) -> Trace:
    drawn = line(view, omega_rad_s, 100.0 * share, Style(name=name, color=color, width=0.8, legend=True, unit="%"))
    return {**drawn, "stackgroup": "share", "fillcolor": translucent(color, _AREA_OPACITY)}


_ROW_PX, _BAR_PX = 36.0, 9.0
_BAR_BELOW, _WORDS_ABOVE = 0.16, 0.22
_ROOM_LEFT, _ROOM_RIGHT = 0.85, 1.5
_WORDS_SHARE = 0.12
"""About how much of the axis the numbers of one band take on a wide page."""

_NONE = "no usable band"


def coherence_map(
    usable: Mapping[tuple[str, str], Sequence[tuple[float, float]]],
    *,
    asked: tuple[float, float] | None = None,
    frequency: Frequency = "rad/s",
) -> Figure:
    """Usable bands of all responses: a panel for each output, a row for each input, bars over frequency.

    Parameters
    ----------
    usable
        ``(output, input)`` to bands ``(low, high)`` in rad/s in which the response is trusted, by its coherence for
        instance; an empty sequence says so in words. Of bands so close that their numbers would cover each other the
        widest gets its numbers, and all of them show theirs to who points at them.
    asked
        The band that was asked for, shaded.
    frequency
        Unit of the picture.

    Raises
    ------
    UsageError
        There is no pair, no band to fit the axis to, or a band that does not rise from a positive frequency.

    Examples
    --------
    >>> figure = coherence_map({("p", "roll_command"): [(1.5, 40.0)], ("p", "yaw_command"): []})
    >>> [(trace["x"][:2], trace.get("text")) for trace in figure["data"]]
    [([1.5, 40.0], None), ([1.5], ['1.5 – 40']), ([1.5], ['no usable band'])]
    """
    view = View(frequency=frequency)
    every = [*(span for spans in usable.values() for span in spans), *([asked] if asked else [])]
    if not every:
        raise UsageError("there is no band to draw", needed="a usable band, or the band that was asked for")
    for low, high in every:
        if not 0.0 < low < high:
            raise UsageError(f"the band {low:g} to {high:g} rad/s is empty", needed="0 < low < high")
    edges = np.array(every)
    low, high = view.across(np.array([edges.min(), edges.max()])).tolist()
    outputs = list(dict.fromkeys(output for output, _ in usable))
    room = _WORDS_SHARE * math.log(high * _ROOM_RIGHT / (low * _ROOM_LEFT))
    panels = [
        _band_panel(view, output, {u: spans for (y, u), spans in usable.items() if y == output}, low, room, asked)
        for output in outputs
    ]
    axis = {**view.axis(edges.ravel()), "range": [math.log10(low * _ROOM_LEFT), math.log10(high * _ROOM_RIGHT)]}
    return stacked(panels, x_axis=axis)


def _band_panel(
    view: View,
    output: str,
    rows: Mapping[str, Sequence[tuple[float, float]]],
    low: float,
    room: float,
    asked: tuple[float, float] | None,
) -> Panel:
    names = [text(quantity(input).words) for input in rows]
    # Numbers instead of categories, since the words stand a little above their bars; the first row belongs on top.
    places = list(range(len(names)))[::-1]
    traces: list[Trace] = []
    for name, place, spans in zip(names, places, rows.values(), strict=True):
        traces += _bars(view, name, place, spans, room) if spans else [_words([low], [_NONE], place, SECONDARY)]
    axis: dict[str, Any] = {
        "tickvals": places,
        "ticktext": names,
        "range": [-0.5, len(names) - 0.5],
        "showgrid": False,
        "zeroline": False,
        "fixedrange": True,
    }
    shaded = view.bands([asked] if asked else [])
    return Panel(
        label=f"{quantity(output).words} over", traces=traces, height_px=_ROW_PX * len(names), axis=axis, shaded=shaded
    )


def _bars(view: View, name: str, place: int, spans: Sequence[tuple[float, float]], room: float) -> list[Trace]:
    """All bars of one row, lines of two points with a gap after each, and the numbers above where they start."""
    ends = [(float(low), float(high)) for low, high in view.bands(spans)]
    height = place - _BAR_BELOW
    bars: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": [end for low, high in ends for end in (*numbers(np.array([low, high])), None)],
        "y": [height, height, None] * len(ends),
        "line": {"color": MEASURED, "width": _BAR_PX},
        "hovertemplate": f"{name}: %{{x:.3~g}} {view.frequency}<extra></extra>",
        "showlegend": False,
    }
    labeled = _legible(ends, room)
    words = [f"{low:.3g} – {high:.3g}" for low, high in labeled]
    return [bars, _words([low for low, _ in labeled], words, place + _WORDS_ABOVE, None)]


def _legible(bands: Sequence[tuple[float, float]], room: float) -> list[tuple[float, float]]:
    """The bands whose numbers find room, the widest first; ``room`` is in the logarithm of frequency.

    Examples
    --------
    >>> _legible([(1.0, 1.1), (1.2, 4.0), (8.0, 9.0)], room=0.5)
    [(1.2, 4.0), (8.0, 9.0)]
    """
    labeled: list[tuple[float, float]] = []
    for ends in sorted(bands, key=lambda ends: ends[0] / ends[1]):
        if all(abs(math.log(ends[0] / other[0])) >= room for other in labeled):
            labeled.append(ends)
    return sorted(labeled)


def _words(across: Sequence[float], words: Sequence[str], height: float, color: str | None) -> Trace:
    return {
        "type": "scatter",
        "mode": "text",
        "x": numbers(np.array(across)),
        "y": [height] * len(across),
        "text": list(words),
        "textposition": "middle right",
        "textfont": {"size": 11, **({"color": color} if color else {})},
        "hoverinfo": "skip",
        "showlegend": False,
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Density:
    """The auto-spectral density of one channel.

    Parameters
    ----------
    channel
        Its name, which decides words and unit.
    values
        One-sided density in SI units squared per hertz, shape ``(f,)``.
    """

    channel: str
    values: FloatArray


def input_spectrum(
    omega_rad_s: FloatArray,
    density: FloatArray,
    *,
    input: str,
    instrument: Density | None = None,
    output: Density | None = None,
    noise: FloatArray | None = None,
    excited: Sequence[tuple[float, float]] = (),
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Auto-spectral densities of what drove the vehicle and what it answered.

    The noise of the output is what the input does not explain, :math:`G_{vv} = (1 - \gamma^2) G_{yy}`. With feedback
    a part of the noise returns through the input, and the coherence then understates it.

    Parameters
    ----------
    omega_rad_s
        Positive frequencies, rising, shape ``(f,)``.
    density
        One-sided density of the input in its SI unit squared per hertz, shape ``(f,)``; drawn in units of paper
        (degrees instead of radians), in decibels :math:`10\log_{10}`.
    input
        Name of the input channel.
    instrument
        Density of the injected test signal; it has a panel of its own where its unit is another one.
    output
        Density of the output, in a panel of its own.
    noise
        Density of the part of the output that the input does not explain, SI units, shape ``(f,)``.
    excited
        Bands in rad/s to shade.
    frequency, magnitude
        Units of the picture.

    Raises
    ------
    UsageError
        A shape does not fit, there is a noise without an output, or a unit is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> figure = input_spectrum(np.array([1.0, 10.0]), np.array([0.1, 0.001]), input="roll_command")
    >>> figure["data"][0]["y"], figure["layout"]["annotations"][0]["text"]
    ([-10.0, -30.0], 'Density of roll command [dB re 1/Hz]')
    """
    view = View(frequency=frequency, magnitude=magnitude)
    curves = {"density": density, "noise": noise, "instrument": instrument, "output": output}
    for name, came in curves.items():
        values = came.values if isinstance(came, Density) else came
        if values is not None and values.shape != omega_rad_s.shape:
            raise UsageError(f"{name} has the shape {values.shape}", needed=f"the shape {omega_rad_s.shape}")
    if noise is not None and output is None:
        raise UsageError("a noise density needs the density of its output")
    driven = [("input", Density(channel=input, values=density), INPUT, "solid")]
    groups = [driven]
    if instrument is not None:
        at_instrument = ("instrument", instrument, MODEL, "7 3")
        one_unit = STANDARD_UNITS.get(instrument.channel) == STANDARD_UNITS.get(input)
        groups = [[*driven, at_instrument]] if one_unit else [[at_instrument], driven]
    if output is not None:
        groups.append([("output", output, MEASURED, "solid")])
    if noise is not None and output is not None:
        unexplained = Density(channel=output.channel, values=noise)
        groups[-1].append(("not explained by the input", unexplained, SECONDARY, "2 2"))
    panels = [_density_panel(view, omega_rad_s, group, excited) for group in groups]
    return stacked(panels, x_axis=view.axis(omega_rad_s))


def _density_panel(
    view: View,
    omega_rad_s: FloatArray,
    group: Sequence[tuple[str, Density, str, str]],
    excited: Sequence[tuple[float, float]],
) -> Panel:
    papers = [quantity(density.channel) for _, density, _, _ in group]
    words = " and ".join(dict.fromkeys(paper.words for paper in papers))
    traces: list[Trace] = []
    for (name, density, color, dash), paper in zip(group, papers, strict=True):
        level = decibels(paper.factor**2 * density.values, of_power=True)
        style = Style(name=name, color=color, dash=dash, legend=True, unit=_unit(view, paper))
        traces.append(line(view, omega_rad_s, view.height(level, decibels=10.0), style))
    return Panel(
        label=f"Density of {words} [{_unit(view, papers[0])}]",
        traces=traces,
        height_px=190,
        axis={"rangemode": "tozero"} if view.magnitude == "linear" else {},
        shaded=view.bands(excited),
    )


def _unit(view: View, paper: Quantity) -> str:
    density = f"({paper.unit})²/Hz" if paper.unit else "1/Hz"
    return f"dB re {density}" if view.magnitude == "dB" else density
