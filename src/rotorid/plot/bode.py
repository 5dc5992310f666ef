"""A measured frequency response with its errors, and the model that was fitted to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.plot.figure import Figure, Trace, numbers
from rotorid.plot.phase import near_deg, reference_deg, unwrapped_deg
from rotorid.plot.quantity import quantity
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BAND, BESIDE, MEASURED, MODEL
from rotorid.plot.ticks import frequency_ticks, magnitude_range_db, phase_step_deg
from rotorid.typing import BoolArray, ComplexArray, FloatArray

SIGMAS = 2.0
"""Half width of the error bands in standard deviations: about 95 % for each point on its own."""

COHERENCE_GUIDELINE = 0.6

_RAD_S_PER_HZ = 2.0 * np.pi
_FREQUENCY = "%{x:.3~g} rad/s (%{customdata:.3~g} Hz)<br>"


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
) -> Figure:
    r"""Magnitude, phase and coherence of one response ``output/input``, with the model over it.

    Bands are :math:`\pm 2\sigma` of the random error: :math:`20\log_{10}(1 + 2\varepsilon)` dB to both sides and
    :math:`2\varepsilon` rad. They say nothing about bias, by feedback for instance. Measured phases are drawn on the
    branch that is nearest to the model.

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

    Raises
    ------
    ValueError
        The response does not hold the pair.
    """
    row = response.pair(output, input)
    values, coherence = response.values[row], response.coherence[row]
    used = np.isfinite(values) if fitted is None else fitted[row] & np.isfinite(values)
    exact = None if model is None else model[row]
    lean_deg = (
        reference_deg(response.omega_rad_s, values, used & (coherence >= least_coherence))
        if exact is None
        else unwrapped_deg(exact)
    )
    measured = measured_curve(response, output=output, input=input, lean_deg=lean_deg)
    other = _beside(beside, measured, output=output, input=input, lean_deg=lean_deg)
    name = f"{beside.estimate} estimate" if beside else ""
    panels = (
        _magnitude_panel(
            measured, used, exact, other, name, label=f"{quantity(output).words} over {quantity(input).words}"
        ),
        _phase_panel(measured, used, None if exact is None else lean_deg, other, name),
        Panel(
            label="Coherence",
            traces=_points(measured.omega_rad_s, coherence, used, "", legend=False),
            height_px=95,
            axis={"range": [0, 1.05], "dtick": 0.5},
            level=least_coherence,
        ),
    )
    ticks = frequency_ticks(response.omega_rad_s)
    return stacked(panels, x_axis={"type": "log", "title": {"text": "Frequency [rad/s]"}, "tickvals": ticks})


def _beside(
    beside: FrequencyResponse | None, measured: Curve, *, output: str, input: str, lean_deg: FloatArray
) -> Curve | None:
    """The other estimate on the phase branch of the measured one."""
    if beside is None or not beside.omega_rad_s.size:
        return None
    near = np.interp(beside.omega_rad_s, measured.omega_rad_s, lean_deg)
    return measured_curve(beside, output=output, input=input, lean_deg=near)


def _magnitude_panel(
    measured: Curve, used: BoolArray, model: ComplexArray | None, other: Curve | None, name: str, *, label: str
) -> Panel:
    omega = measured.omega_rad_s
    traces = _band(omega, measured.magnitude_db, measured.magnitude_error_db, used, legend=True)
    if other is not None:
        traces.append(_thin(other.omega_rad_s, other.magnitude_db, name, legend=True))
    traces += _points(omega, measured.magnitude_db, used, "dB", legend=True)
    if model is not None:
        traces += _model(omega, _db(model), used, "dB", legend=True)
    return Panel(label=f"Magnitude of {label} [dB]", traces=traces, height_px=230, axis=_magnitude_axis(traces))


def _phase_panel(
    measured: Curve, used: BoolArray, model_deg: FloatArray | None, other: Curve | None, name: str
) -> Panel:
    omega = measured.omega_rad_s
    traces = _band(omega, measured.phase_deg, measured.phase_error_deg, used, legend=False)
    if other is not None:
        traces.append(_thin(other.omega_rad_s, other.phase_deg, name, legend=False))
    traces += _points(omega, measured.phase_deg, used, "°", legend=False)
    if model_deg is not None:
        traces += _model(omega, model_deg, used, "°", legend=False)
    return Panel(label="Phase [°]", traces=traces, height_px=160, axis=_phase_axis(traces))


def measured_curve(response: FrequencyResponse, *, output: str, input: str, lean_deg: FloatArray) -> Curve:
    """One measured pair on paper, its phase near ``lean_deg`` of shape ``(f,)``."""
    row = response.pair(output, input)
    spread = SIGMAS * response.random_error[row]
    return Curve(
        omega_rad_s=response.omega_rad_s,
        magnitude_db=_db(response.values[row]),
        phase_deg=near_deg(response.values[row], lean_deg),
        magnitude_error_db=20.0 * np.log10(1.0 + spread),
        phase_error_deg=np.minimum(np.degrees(spread), 180.0),
    )


def runs(used: BoolArray) -> list[slice]:
    """Unbroken runs of ``True`` as slices.

    Examples
    --------
    >>> runs(np.array([True, True, False, True]))
    [slice(0, 2, None), slice(3, 4, None)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], used, [False])).astype(int)))
    return [slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def _db(values: ComplexArray) -> FloatArray:
    magnitude = np.abs(values)
    return 20.0 * np.log10(magnitude, out=np.full(magnitude.shape, np.nan), where=magnitude > 0.0)


def _shown(traces: list[Trace]) -> FloatArray:
    return np.array([value for trace in traces for value in trace["y"] if value is not None])


def _magnitude_axis(traces: list[Trace]) -> dict[str, Any]:
    narrow = magnitude_range_db(_shown(traces))
    return {"range": list(narrow)} if narrow else {}


def _phase_axis(traces: list[Trace]) -> dict[str, Any]:
    shown = _shown(traces)
    return {"dtick": phase_step_deg(float(np.ptp(shown)))} if shown.size else {}


def _band(omega: FloatArray, middle: FloatArray, half: FloatArray, used: BoolArray, *, legend: bool) -> list[Trace]:
    x: list[float | None] = []
    y: list[float | None] = []
    for run in runs(used & np.isfinite(middle) & np.isfinite(half)):
        there, back = omega[run], omega[run][::-1]
        low, high = middle[run] - half[run], middle[run] + half[run]
        x += [*numbers(there), *numbers(back), None]
        y += [*numbers(low), *numbers(high[::-1]), None]
    band: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": x[:-1],
        "y": y[:-1],
        "fill": "toself",
        "fillcolor": BAND,
        "line": {"width": 0, "color": MEASURED},
        "hoverinfo": "skip",
        "name": f"± {SIGMAS:g} σ random error",
        "legendgroup": "band",
        "showlegend": legend,
    }
    return [band] if x else []


def _points(omega: FloatArray, values: FloatArray, used: BoolArray, unit: str, *, legend: bool) -> list[Trace]:
    groups = (("measured", used, 1.0, 5.0), ("measured, left out", ~used, 0.4, 4.0))
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "x": numbers(omega[chosen]),
            "y": numbers(values[chosen]),
            "customdata": numbers(omega[chosen] / _RAD_S_PER_HZ),
            "hovertemplate": f"{_FREQUENCY}%{{y:.4~g}} {unit}",
            "marker": {"color": MEASURED, "size": size, "opacity": opacity},
            "name": name,
            "legendgroup": name,
            "showlegend": legend,
        }
        for name, chosen, opacity, size in groups
        if chosen.any()
    ]


def _model(omega: FloatArray, values: FloatArray, used: BoolArray, unit: str, *, legend: bool) -> list[Trace]:
    inside = np.zeros(omega.size, dtype=bool)
    chosen = np.flatnonzero(used)
    if chosen.size:
        inside[chosen[0] : chosen[-1] + 1] = True
    # The whole model dotted, and solid where it was fitted: an extrapolation looks like one.
    lines = (("dot", 1.2, np.ones(omega.size, dtype=bool), legend and not chosen.size), ("solid", 2.2, inside, legend))
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": numbers(omega[where]),
            "y": numbers(values[where]),
            "customdata": numbers(omega[where] / _RAD_S_PER_HZ),
            "hovertemplate": f"{_FREQUENCY}%{{y:.4~g}} {unit}",
            "line": {"color": MODEL, "width": width, "dash": dash},
            "name": "model",
            "legendgroup": "model",
            "showlegend": shown,
        }
        for dash, width, where, shown in lines
        if where.any()
    ]


def _thin(omega: FloatArray, values: FloatArray, name: str, *, legend: bool) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(omega),
        "y": numbers(values),
        "hoverinfo": "skip",
        "line": {"color": BESIDE, "width": 1.2},
        "name": name,
        "legendgroup": "beside",
        "showlegend": legend,
    }
