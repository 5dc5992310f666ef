"""Poles of a model in the plane of s, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.curves import SIGMAS
from rotorid.plot.figure import Figure, Trace, numbers, text
from rotorid.plot.stack import Panel, stacked
from rotorid.plot.theme import BESIDE, MEASURED, MODEL, translucent
from rotorid.typing import ComplexArray, FloatArray

DAMPING_RATIOS = (0.2, 0.4, 0.6, 0.8)

_HEIGHT_PX = 330.0
_CORNERS = 48
_ROOM = 1.18
_LABELED = 0.9
_FAR = 20.0
"""So many times further than the poles reach lines go on, since equal scales may show more of the plane than asked."""


def s_plane(
    poles: ComplexArray, *, std: ComplexArray | None = None, words: Sequence[str] = (), unit: str = "rad/s"
) -> Figure:
    r"""Poles as crosses, each in an ellipse of two standard deviations, over lines of equal damping.

    Real and imaginary part have one scale, so that the distance from the origin is the natural frequency and the angle
    to the negative real axis is :math:`\cos^{-1}\zeta`. The half plane in which motions grow is shaded. The axes of the
    ellipses are those of the plane: how real and imaginary part vary together is not drawn.

    Parameters
    ----------
    poles
        Both of a complex pair, shape ``(n,)``, 1/s.
    std
        Standard deviations of real and imaginary part as a complex number, same shape; not finite where there is none.
    words
        What each pole says to who points at it; its value by default.
    unit
        Of the imaginary axis.

    Raises
    ------
    UsageError
        A shape does not fit, or a pole is not finite.

    Examples
    --------
    >>> figure = s_plane(np.array([-4.6, 2.6 + 4.3j, 2.6 - 4.3j]), std=np.array([0.1, 0.1 + 0.2j, 0.1 + 0.2j]))
    >>> [(trace["name"], trace["x"]) for trace in figure["data"] if trace["mode"] == "markers"]
    [('decays', [-4.6]), ('grows', [2.6, 2.6])]
    """
    spread = np.full(poles.shape, complex(np.nan, np.nan)) if std is None else std
    _require(poles, spread, words)
    said = list(words) or [f"{pole.real:.4g} {pole.imag:+.4g}j".replace("-", "−") for pole in poles.tolist()]
    reach = max(float(np.abs(poles).max(initial=0.0)), 1e-6)
    grows = poles.real > 0.0
    across, up = _ranges(poles, reach)
    traces = [*_damping_lines(reach, left=-across[0], top=up[1]), *_ellipses(poles, spread)]
    for name, color, chosen in (("decays", MEASURED, ~grows), ("grows", MODEL, grows)):
        if chosen.any():
            told = [text(one) for one, shown in zip(said, chosen, strict=True) if shown]
            traces.append(_crosses(poles[chosen], told, name, color))
    panel = Panel(
        label=f"Imaginary part [{unit}]",
        traces=traces,
        height_px=_HEIGHT_PX,
        axis={"range": up, "scaleanchor": "x", "scaleratio": 1, "zeroline": True},
        shaded=[(0.0, _FAR * reach)],
    )
    return stacked([panel], x_axis={"title": {"text": "Real part [1/s]"}, "range": across, "zeroline": True})


def _require(poles: ComplexArray, std: ComplexArray, words: Sequence[str]) -> None:
    if poles.ndim != 1 or std.shape != poles.shape or (words and len(words) != poles.size):
        raise UsageError(
            f"poles of shape {poles.shape} came with deviations of shape {std.shape} and {len(words)} texts",
            needed="one row of poles, and one of each for every pole",
        )
    if not np.isfinite(poles).all():
        raise UsageError("a pole that is not finite came", needed="finite poles")


def _ranges(poles: ComplexArray, reach: float) -> tuple[list[float], list[float]]:
    """What both axes show at least: the poles, and the origin with a piece of the growing half plane."""
    low = min(float(poles.real.min(initial=0.0)), -0.25 * reach)
    high = max(float(poles.real.max(initial=0.0)), 0.15 * reach)
    pad = (_ROOM - 1.0) * (high - low) / 2.0
    top = max(_ROOM * float(np.abs(poles.imag).max(initial=0.0)), 0.35 * reach)
    across, up = numbers(np.array([low - pad, high + pad])), numbers(np.array([-top, top]))
    return [float(end or 0.0) for end in across], [float(end or 0.0) for end in up]


def _damping_lines(reach: float, *, left: float, top: float) -> list[Trace]:
    """Rays of equal damping in the decaying half plane, above and below, each with its ratio."""
    angles = np.arccos(np.array(DAMPING_RATIOS))
    rays = np.concatenate([np.exp(1j * (np.pi - angles)), np.exp(-1j * (np.pi - angles))])
    ends = np.array([point for ray in rays for point in (0.0, _FAR * reach * ray, np.nan)])
    lines: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(np.where(np.isnan(ends), np.nan, ends.real)),
        "y": numbers(np.where(np.isnan(ends), np.nan, ends.imag)),
        "line": {"color": translucent(BESIDE, 0.55), "width": 1, "dash": "dot"},
        "hoverinfo": "skip",
        "name": "equal damping",
        "legendgroup": "equal damping",
        "showlegend": True,
    }
    # Where a ray leaves the part of the plane that is shown for sure.
    within = np.minimum(left / np.cos(angles), top / np.sin(angles))
    labeled = _LABELED * within * np.exp(1j * (np.pi - angles))
    labels: Trace = {
        "type": "scatter",
        "mode": "text",
        "x": numbers(labeled.real),
        "y": numbers(labeled.imag),
        "text": [f"{ratio:g}" for ratio in DAMPING_RATIOS],
        "textfont": {"size": 10, "color": BESIDE},
        "hoverinfo": "skip",
        "name": "equal damping",
        "legendgroup": "equal damping",
        "showlegend": False,
    }
    return [lines, labels]


def _ellipses(poles: ComplexArray, std: ComplexArray) -> list[Trace]:
    known = np.isfinite(std.real) & np.isfinite(std.imag)
    if not known.any():
        return []
    turn = np.linspace(0.0, 2.0 * np.pi, _CORNERS)
    outlines = [_outline(pole, spread, turn) for pole, spread in zip(poles[known], std[known], strict=True)]
    along = np.concatenate(outlines)
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": numbers(along[:, 0]),
            "y": numbers(along[:, 1]),
            "fill": "toself",
            "fillcolor": translucent(BESIDE, 0.35),
            "line": {"color": BESIDE, "width": 1},
            "hoverinfo": "skip",
            "name": f"± {SIGMAS:g} σ",
            "showlegend": True,
        }
    ]


def _outline(pole: complex, std: complex, turn: FloatArray) -> FloatArray:
    """Corners of one ellipse with a gap behind the last, shape ``(corners + 1, 2)``."""
    across = pole.real + SIGMAS * std.real * np.cos(turn)
    up = pole.imag + SIGMAS * std.imag * np.sin(turn)
    return np.vstack([np.column_stack([across, up]), [np.nan, np.nan]])


def _crosses(poles: ComplexArray, words: Sequence[str], name: str, color: str) -> Trace:
    marker: dict[str, Any] = {"symbol": "x-thin", "size": 10, "color": color, "line": {"color": color, "width": 2.4}}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(poles.real),
        "y": numbers(poles.imag),
        "marker": marker,
        "text": list(words),
        "hovertemplate": "%{text}<extra></extra>",
        "name": name,
        "showlegend": True,
    }
