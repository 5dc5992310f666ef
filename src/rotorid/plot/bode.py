"""A measured frequency response with its errors, and the model that was fitted to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.plot.curves import SIGMAS, Style, band, line, magnitude_axis, phase_axis, points
from rotorid.plot.figure import Figure, Trace
from rotorid.plot.phase import near_deg, reference_deg, unwrapped_deg
from rotorid.plot.quantity import magnitude_label
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, MEASURED, MODEL, translucent
from rotorid.plot.view import Frequency, Magnitude, View, decibels
from rotorid.typing import BoolArray, ComplexArray, FloatArray

COHERENCE_GUIDELINE = 0.6

_BAND_OPACITY = 0.22


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
    least_coherence: float = COHERENCE_GUIDELINE,
    frequency: Frequency = "rad/s",
    magnitude: Magnitude = "dB",
) -> Figure:
    r"""Magnitude, phase and coherence of one response ``output/input``, with the model over it.

    Bands are :math:`\pm 2\sigma` of the random error: a factor of :math:`1 + 2\varepsilon` to both sides, which is
    :math:`20\log_{10}(1 + 2\varepsilon)` dB, and :math:`2\varepsilon` rad. They say nothing about bias, by feedback
    for instance. Measured phases are drawn on the branch that is nearest to the model; without one, on that which the
    slope of the magnitude calls for (``rotorid.plot.phase.reference_deg``).

    Parameters
    ----------
    response
        The response that was fitted.
    output, input
        Which of its pairs.
    model
        The model on the same grid, shape ``(y, u, f)``.
    beside
        Another estimate of the same pair, drawn thin.
    fitted
        Points that entered the fit, shape ``(y, u, f)``; the others are faded. ``None`` emphasizes all.
    least_coherence
        Coherence below which points were left out, drawn as a line.
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
    used = np.isfinite(values) if fitted is None else fitted[row] & np.isfinite(values)
    exact = None if model is None else model[row]
    lean_deg = (
        reference_deg(response.omega_rad_s, values, used & (coherence >= least_coherence))
        if exact is None
        else unwrapped_deg(response.omega_rad_s, exact)
    )
    measured = measured_curve(response, output=output, input=input, lean_deg=lean_deg)
    other = _beside(beside, measured, output=output, input=input, lean_deg=lean_deg)
    name = f"{beside.estimate} estimate" if beside else ""
    panels = (
        _magnitude_panel(
            view, measured, used, exact, other, name, label=magnitude_label(output, input, in_db=magnitude == "dB")
        ),
        _phase_panel(view, measured, used, None if exact is None else lean_deg, other, name),
        coherence_panel(_points(view, measured.omega_rad_s, coherence, used, "", legend=False), least_coherence),
    )
    return stacked(panels, x_axis=view.axis(response.omega_rad_s))


def measured_curve(response: FrequencyResponse, *, output: str, input: str, lean_deg: FloatArray) -> Curve:
    """One measured pair on paper, its phase near ``lean_deg`` of shape ``(f,)``."""
    row = response.pair(output, input)
    return curve(response.omega_rad_s, response.values[row], response.random_error[row], lean_deg)


def curve(omega_rad_s: FloatArray, values: ComplexArray, random_error: FloatArray, lean_deg: FloatArray) -> Curve:
    """Values and random errors of shape ``(f,)`` on paper, the phase near ``lean_deg`` of the same shape."""
    spread = SIGMAS * random_error
    return Curve(
        omega_rad_s=omega_rad_s,
        magnitude_db=decibels(np.abs(values)),
        phase_deg=near_deg(values, lean_deg),
        magnitude_error_db=20.0 * np.log10(1.0 + spread),
        phase_error_deg=np.minimum(np.degrees(spread), 180.0),
    )


def bands(view: View, drawn: Curve, used: BoolArray, style: Style) -> tuple[list[Trace], list[Trace]]:
    """Error bands of magnitude and phase; only the first may stand in the legend."""
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
    return Panel(label="Coherence", traces=traces, height_px=95, axis=axis, level=least_coherence)


def _beside(
    beside: FrequencyResponse | None, measured: Curve, *, output: str, input: str, lean_deg: FloatArray
) -> Curve | None:
    """The other estimate on the phase branch of the measured one."""
    if beside is None or not beside.omega_rad_s.size:
        return None
    near = np.interp(beside.omega_rad_s, measured.omega_rad_s, lean_deg)
    return measured_curve(beside, output=output, input=input, lean_deg=near)


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
    traces = bands(view, measured, used, _band_style(legend=True))[0]
    if other is not None:
        traces.append(_thin(view, other.omega_rad_s, view.height(other.magnitude_db), name, legend=True))
    traces += _points(view, omega, view.height(measured.magnitude_db), used, unit, legend=True)
    if model is not None:
        traces += _model(view, omega, view.height(decibels(np.abs(model))), used, unit, legend=True)
    return Panel(label=label, traces=traces, height_px=230, axis=magnitude_axis(view, traces))


def _phase_panel(
    view: View, measured: Curve, used: BoolArray, model_deg: FloatArray | None, other: Curve | None, name: str
) -> Panel:
    omega = measured.omega_rad_s
    traces = bands(view, measured, used, _band_style(legend=False))[1]
    if other is not None:
        traces.append(_thin(view, other.omega_rad_s, other.phase_deg, name, legend=False))
    traces += _points(view, omega, measured.phase_deg, used, "°", legend=False)
    if model_deg is not None:
        traces += _model(view, omega, model_deg, used, "°", legend=False)
    return Panel(label="Phase [°]", traces=traces, height_px=160, axis=phase_axis(traces))


def _band_style(*, legend: bool) -> Style:
    return Style(name=f"± {SIGMAS:g} σ random error", color=translucent(MEASURED, _BAND_OPACITY), legend=legend)


def _points(
    view: View, omega: FloatArray, values: FloatArray, used: BoolArray, unit: str, *, legend: bool
) -> list[Trace]:
    groups = (("measured", used, 1.0, 5.0), ("measured, left out", ~used, 0.4, 4.0))
    return [
        points(
            view,
            omega[chosen],
            values[chosen],
            Style(name=name, color=MEASURED, size=size, opacity=opacity, unit=unit, legend=legend),
        )
        for name, chosen, opacity, size in groups
        if chosen.any()
    ]


def _model(
    view: View, omega: FloatArray, values: FloatArray, used: BoolArray, unit: str, *, legend: bool
) -> list[Trace]:
    inside = np.zeros(omega.size, dtype=bool)
    chosen = np.flatnonzero(used)
    if chosen.size:
        inside[chosen[0] : chosen[-1] + 1] = True
    # The whole model dotted, and solid where it was fitted: an extrapolation looks like one.
    drawn = (("dot", 1.2, np.ones(omega.size, dtype=bool), legend and not chosen.size), ("solid", 2.2, inside, legend))
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
    style = Style(name=name, color=BESIDE, width=1.2, legend=legend)
    return {**line(view, omega, values, style), "hoverinfo": "skip"}
